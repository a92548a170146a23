//! How often the nearest integers will be the right ones, known before any observation.
//!
//! Source: Teunissen (1998), *Success probability of integer GPS ambiguity rounding and
//! bootstrapping*, J. Geodesy 72; ADOP: Teunissen (1997).

use libm::erf;

/// Success rate of integer bootstrapping, a lower bound (and a close one after decorrelation) of
/// that of integer least squares:
///
/// ```text
/// P = ∏ (2 Φ(1 / (2 σᵢ)) − 1) = ∏ erf(1 / (2 √2 σᵢ))
/// ```
///
/// `conditional_variances` are those of the decorrelated ambiguities, cycles².
#[must_use]
pub fn bootstrapped_success_rate(conditional_variances: &[f64]) -> f64 {
    conditional_variances.iter().map(|variance| erf(1.0 / (8.0 * variance).sqrt())).product()
}

/// Ambiguity dilution of precision, cycles: `det(Q)^(1/2n)`, the same for every choice of integer
/// variables. `NaN` without ambiguities.
#[must_use]
pub fn ambiguity_dilution_of_precision(conditional_variances: &[f64]) -> f64 {
    let log_determinant: f64 = conditional_variances.iter().map(|variance| variance.ln()).sum();
    (log_determinant / (2.0 * conditional_variances.len() as f64)).exp()
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;
    use rand_distr::{Distribution, StandardNormal};

    use super::super::decorrelate::Decorrelation;
    use super::super::problems::{faq_covariance, random_covariance, seeded};
    use super::super::search::integer_least_squares;
    use super::*;

    fn decorrelated_variances(q: &DMatrix<f64>) -> Vec<f64> {
        let mut decorrelation = Decorrelation::default();
        decorrelation.compute(q).unwrap();
        decorrelation.conditional_variances().to_vec()
    }

    #[test]
    fn one_ambiguity_is_the_normal_distribution() {
        // 2 Φ(x) − 1 for x = 1/2, 1, 2, 5: Abramowitz & Stegun, table 26.1.
        for (x, expected) in [
            (0.5, 0.382_924_922_548_026),
            (1.0, 0.682_689_492_137_086),
            (2.0, 0.954_499_736_103_642),
            (5.0, 0.999_999_426_696_856),
        ] {
            let sigma: f64 = 1.0 / (2.0 * x);
            assert!((bootstrapped_success_rate(&[sigma * sigma]) - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn dilution_does_not_depend_on_the_variables() {
        let q = faq_covariance();
        let expected = q.determinant().powf(1.0 / 6.0);
        let found = ambiguity_dilution_of_precision(&decorrelated_variances(&q));
        assert!((found - expected).abs() < 1e-12 * expected, "{found} {expected}");
    }

    #[test]
    fn bootstrapping_bounds_the_search_from_below() {
        const EPOCHS: usize = 4000;
        let mut random = seeded(8);
        for n in [3, 6] {
            let q = random_covariance(&mut random, n) * 0.05;
            let bound = bootstrapped_success_rate(&decorrelated_variances(&q));
            let root = q.clone().cholesky().unwrap().l();
            let right = (0..EPOCHS)
                .filter(|_| {
                    let noise =
                        nalgebra::DVector::from_fn(n, |_, _| StandardNormal.sample(&mut random));
                    let float = &root * noise;
                    let found = integer_least_squares(float.as_slice(), &q, 1).unwrap();
                    found[0].integers.iter().all(|z| *z == 0)
                })
                .count();
            let rate = right as f64 / EPOCHS as f64;
            let sigma = (bound * (1.0 - bound) / EPOCHS as f64).sqrt();
            assert!(rate > bound - 3.3 * sigma, "{rate} {bound}");
            assert!(bound > 0.05 && bound < 0.999, "{bound} says something");
            assert!(rate < bound + 0.15, "the bound is close: {rate} {bound}");
        }
    }
}
