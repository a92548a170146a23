//! What reaches an antenna on several ways at once, and what a receiver makes of the sum.

use core::f64::consts::TAU;

use nalgebra::Complex;

/// Sum of the signals on all ways, against one that comes undisturbed on the straight way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReceivedField {
    /// Σ a
    sum: Complex<f64>,
    /// Σ a τ, metres
    delayed_m: Complex<f64>,
}

impl ReceivedField {
    /// What comes on the straight way, with this field.
    pub(crate) fn straight(field: Complex<f64>) -> Self {
        Self { sum: field, delayed_m: Complex::new(0.0, 0.0) }
    }

    /// Adds what comes on a way that is longer by `delay_m`.
    pub(crate) fn add_delayed(&mut self, field: Complex<f64>, delay_m: f64, wavelength_m: f64) {
        let arriving = field * Complex::cis(-TAU * delay_m / wavelength_m);
        self.sum += arriving;
        self.delayed_m += arriving * delay_m;
    }

    /// Everything passes leaves that leave so much of it, and what they scatter is added.
    pub(crate) fn pass(&mut self, straight: Complex<f64>, scattered: Complex<f64>) {
        self.sum = self.sum * straight + scattered;
        self.delayed_m *= straight;
    }

    /// How much C/N0 is lower than that of the undisturbed signal, dB.
    pub(crate) fn loss_db(&self) -> f64 {
        -20.0 * self.sum.norm().max(f64::MIN_POSITIVE).log10()
    }

    /// How late the phase is, cycles, from −½ to ½.
    pub(crate) fn late_cycles(&self) -> f64 {
        -self.sum.arg() / TAU
    }

    /// How late the code is, m: a coherent discriminator finds Re(Σaτ · conj Σa) / |Σa|², for delays
    /// within its spacing.
    pub(crate) fn late_m(&self) -> f64 {
        let power = self.sum.norm_sqr();
        if power > 0.0 { (self.delayed_m * self.sum.conj()).re / power } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A weak echo: amplitude 1 ± α, phase off by up to α/2π cycles, code by up to ±ατ; and an echo
    /// alone is late by its way.
    #[test]
    fn an_echo() {
        let one = Complex::new(1.0, 0.0);
        let (alpha, wavelength_m) = (Complex::new(0.1, 0.0), 0.2);
        let with = |delay_m: f64| {
            let mut field = ReceivedField::straight(one);
            field.add_delayed(alpha, delay_m, wavelength_m);
            field
        };
        let in_phase = with(10.0);
        assert!((in_phase.loss_db() + 20.0 * 1.1f64.log10()).abs() < 1e-9);
        assert!(in_phase.late_cycles().abs() < 1e-9);
        assert!((in_phase.late_m() - 10.0 * 0.1 / 1.1).abs() < 1e-9);
        let opposite = with(10.1);
        assert!((opposite.late_m() + 10.1 * 0.1 / 0.9).abs() < 1e-9);
        let quarter_later = with(10.05);
        assert!((quarter_later.late_cycles() - 0.1f64.atan() / TAU).abs() < 1e-9);
        let mut alone = ReceivedField::straight(Complex::new(0.0, 0.0));
        alone.add_delayed(alpha, 10.05, wavelength_m);
        assert!((alone.loss_db() - 20.0).abs() < 1e-9 && (alone.late_m() - 10.05).abs() < 1e-9);
        assert!((alone.late_cycles() - 0.25).abs() < 1e-9);
    }
}
