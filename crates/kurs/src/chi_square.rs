//! The χ² distribution: how likely a sum of squared residuals is.

/// Probability that a χ² variable with `degrees` degrees of freedom exceeds `value`; 1 for no
/// degrees of freedom or a value below zero.
///
/// The finite sums for even and odd degrees (Abramowitz & Stegun 26.4.4, 26.4.5); below 1e-15
/// absolute error.
#[must_use]
pub fn chi_square_tail(value: f64, degrees: usize) -> f64 {
    if degrees == 0 || value.is_nan() || value <= 0.0 {
        return 1.0;
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
}
