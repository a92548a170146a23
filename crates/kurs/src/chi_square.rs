//! The χ² distribution: how likely a sum of squared residuals is.

/// Probability that a χ² variable with `degrees` degrees of freedom exceeds `value`; 1 for no
/// degrees of freedom or a value below zero, not a number for a value that is none.
///
/// The finite sums for even and odd degrees (Abramowitz & Stegun 26.4.4, 26.4.5); below 1e-15
/// absolute error.
#[must_use]
pub fn chi_square_tail(value: f64, degrees: usize) -> f64 {
    if degrees == 0 || value <= 0.0 {
        return 1.0;
    }
    if value.is_nan() {
        return f64::NAN;
    }
    let half = 0.5 * value;
    // Even: e^(−x/2) Σ (x/2)ⁱ / i!;  odd: erfc √(x/2) + e^(−x/2) Σ (x/2)^(i−½) / Γ(i+½)
    let odd = degrees % 2 == 1;
    let mut sum = if odd { complementary_error(half.sqrt()) } else { 0.0 };
    let mut term = if odd {
        2.0 * (half / core::f64::consts::PI).sqrt() * (-half).exp()
    } else {
        (-half).exp()
    };
    let mut divisor = if odd { 1.5 } else { 1.0 };
    for _ in 0..degrees / 2 {
        sum += term;
        term *= half / divisor;
        divisor += 1.0;
    }
    sum.min(1.0)
}

/// Probability that a sum of `degrees` squares exceeds `value`, in units of a variance that is itself known
/// with `known_with` degrees of freedom only: `F = (value / degrees)` of Fisher's distribution. It tends to
/// [`chi_square_tail`] as `known_with` grows, and says as much of values that are no numbers.
///
/// `P = I_x(ν/2, d/2)` with `x = ν / (ν + value)` (Abramowitz & Stegun 26.6.2), the incomplete beta function
/// by its continued fraction (26.5.8).
#[must_use]
pub fn fisher_tail(value: f64, degrees: f64, known_with: f64) -> f64 {
    if degrees <= 0.0 || value <= 0.0 {
        return 1.0;
    }
    if value.is_nan() {
        return f64::NAN;
    }
    incomplete_beta(known_with / (known_with + value), 0.5 * known_with, 0.5 * degrees)
}

/// `I_x(a, b)`, regularised.
fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    // The fraction converges fast below the mean; beyond it the complement does.
    if x > (a + 1.0) / (a + b + 2.0) {
        return 1.0 - incomplete_beta(1.0 - x, b, a);
    }
    let log_factor =
        a * x.ln() + b * (1.0 - x).ln() + libm::lgamma(a + b) - libm::lgamma(a) - libm::lgamma(b);
    // 1 + d₁/(1 + d₂/(1 + …)) as the product of the ratios of its convergents, which tend to 1:
    // Cₖ = 1 + dₖ/Cₖ₋₁,   Dₖ = 1/(1 + dₖ Dₖ₋₁)
    let (mut fraction, mut upper, mut lower) = (1.0, 1.0, 0.0);
    for k in 1..=200 {
        let m = f64::from(k / 2);
        let d = if k % 2 == 0 {
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        } else {
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        };
        (upper, lower) = (1.0 + d / upper, 1.0 / (1.0 + d * lower));
        let ratio = upper * lower;
        fraction *= ratio;
        if (ratio - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    (log_factor.exp() / (a * fraction)).clamp(0.0, 1.0)
}

/// erfc(x) for x ≥ 0: its series near zero, its continued fraction (Lentz) beyond.
fn complementary_error(x: f64) -> f64 {
    let root_pi = core::f64::consts::PI.sqrt();
    if x < 2.0 {
        // erf x = 2/√π e^(−x²) Σ 2ⁿ x^(2n+1) / (2n+1)!!
        let mut term = x;
        let mut sum = x;
        for n in 1..60 {
            term *= 2.0 * x * x / f64::from(2 * n + 1);
            sum += term;
        }
        return 1.0 - 2.0 / root_pi * (-x * x).exp() * sum;
    }
    // √π e^(x²) erfc x = 1/(x+ ½/(x+ 1/(x+ 3/2/(x+ …)))), from the inside
    let fraction = (1..=80).rev().fold(x, |inner, k| x + 0.5 * f64::from(k) / inner);
    (-x * x).exp() / (root_pi * fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is no number must not pass for a good fit.
    #[test]
    fn no_number_has_no_probability() {
        assert!(chi_square_tail(f64::NAN, 3).is_nan() && fisher_tail(f64::NAN, 3.0, 9.0).is_nan());
        assert_eq!((chi_square_tail(-1.0, 3), fisher_tail(-1.0, 3.0, 9.0)), (1.0, 1.0));
        assert_eq!((chi_square_tail(9.0, 0), fisher_tail(9.0, 0.0, 9.0)), (1.0, 1.0));
    }

    /// Upper percentage points: Abramowitz & Stegun, table 26.8.
    #[test]
    fn tabulated_percentage_points() {
        for (degrees, value, probability) in [
            (1, 3.841_458_820_694_124, 0.05),
            (1, 10.827_566_170_662_733, 0.001),
            (2, 5.991_464_547_107_979, 0.05),
            (3, 16.266_236_196_238_13, 0.001),
            (10, 18.307_038_053_275_146, 0.05),
            (10, 2.558_212_118_0, 0.99),
        ] {
            let tail = chi_square_tail(value, degrees);
            assert!((tail - probability).abs() < 1e-9, "{degrees} {value}: {tail}");
        }
        assert_eq!(chi_square_tail(5.0, 0), 1.0);
    }

    /// Upper percentage points of F: Abramowitz & Stegun, table 26.9.
    #[test]
    fn tabulated_percentage_points_of_fisher() {
        for (degrees, known_with, value, probability) in [
            (1.0, 10.0, 4.96, 0.05),
            (5.0, 10.0, 3.33, 0.05),
            (10.0, 4.0, 5.96, 0.05),
            (4.0, 20.0, 4.43, 0.01),
            (10.0, 30.0, 4.24, 0.001),
        ] {
            let tail = fisher_tail(value * degrees, degrees, known_with);
            assert!((tail / probability - 1.0).abs() < 0.01, "{degrees} {known_with}: {tail}");
        }
        for (value, degrees) in [(3.0, 2), (30.0, 10), (80.0, 40)] {
            let (fisher, limit) =
                (fisher_tail(value, degrees as f64, 1e6), chi_square_tail(value, degrees));
            assert!((fisher / limit - 1.0).abs() < 1e-3, "{fisher} {limit}");
        }
    }
}
