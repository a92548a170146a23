//! Diffraction at the straight edge of an opaque screen.

use core::f64::consts::PI;

use nalgebra::Complex;

/// Field behind a knife edge against the field without it.
///
/// ```text
/// F(v) = (1 + j)/2 ∫ᵥ^∞ exp(−jπt²/2) dt,    v = h √(2 / (λ d))
/// ```
///
/// h is how far the edge stands above the straight way, d how far it is from the antenna (the satellite
/// is infinitely far), as in ITU-R P.526: without loss for v ≪ 0, half the field at the edge of the
/// shadow, and deep in it a phase that is late by λ/8 + h²/(2d), nearly alike on all bands.
pub(crate) fn knife_edge(v: f64) -> Complex<f64> {
    if v < 0.0 {
        return Complex::new(1.0, 0.0) - knife_edge(-v);
    }
    // ∫ᵥ^∞ exp(−jπt²/2) dt = (g − jf) exp(−jπv²/2) with the auxiliary functions of the Fresnel
    // integrals, rational approximations to 2e-3: Abramowitz and Stegun 7.3.32, 7.3.33.
    let f = (1.0 + 0.926 * v) / (2.0 + 1.792 * v + 3.104 * v * v);
    let g = 1.0 / (2.0 + 4.142 * v + 3.492 * v * v + 6.670 * v * v * v);
    Complex::new(0.5, 0.5) * Complex::new(g, -f) * Complex::cis(-PI * v * v / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral by Simpson's rule from v to a far end, and the far rest by its first term.
    fn by_quadrature(v: f64) -> Complex<f64> {
        const FAR: f64 = 12.0;
        const STEPS: u32 = 200_000;
        let wave = |t: f64| Complex::cis(-PI * t * t / 2.0);
        let width = (FAR - v) / f64::from(STEPS);
        let mut sum = wave(v) + wave(FAR);
        for k in 1..STEPS {
            let weight = if k % 2 == 1 { 4.0 } else { 2.0 };
            sum += wave(v + f64::from(k) * width) * weight;
        }
        let rest = wave(FAR) * Complex::new(0.0, -1.0) / (PI * FAR);
        Complex::new(0.5, 0.5) * (sum * (width / 3.0) + rest)
    }

    #[test]
    fn the_field_is_the_integral() {
        for v in [-3.0, -1.2, -0.3, 0.0, 0.4, 1.0, 2.5] {
            let (found, wanted) = (knife_edge(v), by_quadrature(v));
            assert!((found - wanted).norm() < 3e-3, "{v}: {found} {wanted}");
        }
    }

    /// The loss is that of ITU-R P.526 (equation 31, good to a few tenths of a decibel).
    #[test]
    fn the_loss_is_that_of_the_recommendation() {
        for v in [-0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.4] {
            let loss_db = -20.0 * knife_edge(v).norm().log10();
            let from: f64 = v - 0.1;
            let wanted_db = 6.9 + 20.0 * ((from * from + 1.0).sqrt() + from).log10();
            assert!((loss_db - wanted_db).abs() < 0.4, "{v}: {loss_db} dB, wanted {wanted_db} dB");
        }
    }

    /// In the shadow the way is longer by λ/8 + h²/(2d) = λ (1/8 + v²/4).
    #[test]
    fn the_phase_is_late_in_the_shadow() {
        for v in [1.0, 1.2] {
            let late_cycles = -knife_edge(v).arg() / (2.0 * PI);
            assert!((late_cycles - (0.125 + v * v / 4.0)).abs() < 0.04, "{v}: {late_cycles}");
        }
    }
}
