//! Complementary filter of one tilt angle: the gyro for what is fast, the accelerometers for what
//! is slow.

use crate::frames::wrap_angle;

/// θ⁻ = θ + (ω − b) Δt, θ ← θ⁻ + (1 − a) e with e = θ_acc − θ⁻ the shorter way round, and a bias that may
/// follow e.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComplementaryFilter {
    /// a, 0 to 1: the share of the gyro.
    pub gyro_share: f64,
    /// k_i: b ← b − k_i e Δt, in 1/s²; 0 leaves the bias as it is.
    pub integral_gain: f64,
    /// b.
    pub bias_radps: f64,
    /// θ, −π to π.
    pub angle_rad: f64,
}

impl ComplementaryFilter {
    /// From an angle, without integral term.
    #[must_use]
    pub const fn new(gyro_share: f64, angle_rad: f64) -> Self {
        Self { gyro_share, integral_gain: 0.0, bias_radps: 0.0, angle_rad }
    }

    /// One step with the gyro's rate and the tilt that the accelerometers show; returns the angle.
    /// What is not a number is left out.
    pub fn update(&mut self, rate_radps: f64, accelerometer_rad: f64, step_s: f64) -> f64 {
        let turn = (rate_radps - self.bias_radps) * step_s;
        let predicted = if turn.is_finite() { self.angle_rad + turn } else { self.angle_rad };
        let error = wrap_angle(accelerometer_rad - predicted);
        let error = if error.is_finite() { error } else { 0.0 };
        self.bias_radps -= self.integral_gain * error * step_s;
        self.angle_rad = wrap_angle(predicted + (1.0 - self.gyro_share) * error);
        self.angle_rad
    }

    /// τ = a Δt / (1 − a): slower than this is taken from the accelerometers.
    #[must_use]
    pub fn time_constant_s(&self, step_s: f64) -> f64 {
        self.gyro_share * step_s / (1.0 - self.gyro_share)
    }

    /// Noise of the angle for white noise `accelerometer_sd_rad` of the tilt that the accelerometers
    /// show, σ √((1 − a)/(1 + a)); without integral term.
    #[must_use]
    pub fn noise_rad(&self, accelerometer_sd_rad: f64) -> f64 {
        accelerometer_sd_rad * ((1.0 - self.gyro_share) / (1.0 + self.gyro_share)).sqrt()
    }

    /// Standing error of an uncompensated gyro bias, τ b; without integral term.
    #[must_use]
    pub fn bias_error_rad(&self, bias_radps: f64, step_s: f64) -> f64 {
        self.time_constant_s(step_s) * bias_radps
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout)]
    use super::*;
    use core::f64::consts::TAU;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    const STEP_S: f64 = 0.01;

    /// Root mean square error in degrees over the reference motion: 10° sine at 0.2 Hz, gyro bias
    /// 0.5 °/s, vibration 0.5 m/s², 100 Hz; half an hour without its first minute.
    fn reference_motion(mut filter: ComplementaryFilter) -> f64 {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(5);
        let (mut sum, mut count) = (0.0, 0.0);
        let angle = |t: f64| 10f64.to_radians() * (TAU * 0.2 * t).sin();
        for step in 1..180_000 {
            let time_s = f64::from(step) * STEP_S;
            let rate = (angle(time_s) - angle(time_s - STEP_S)) / STEP_S + 0.5f64.to_radians();
            let vibration: f64 = StandardNormal.sample(&mut generator);
            let accelerometer = angle(time_s) + 0.5 * vibration / 9.81;
            let found = filter.update(rate, accelerometer, STEP_S);
            if time_s > 60.0 {
                sum += (found - angle(time_s)).to_degrees().powi(2);
                count += 1.0;
            }
        }
        (sum / count).sqrt()
    }

    /// Reference: a = 0.995 0.144° with the bias known, 0.157° with the integral term.
    #[test]
    fn errors_on_the_reference_motion() {
        let known = 0.5f64.to_radians();
        let calibrated = |share| ComplementaryFilter {
            bias_radps: known,
            ..ComplementaryFilter::new(share, 0.0)
        };
        let slow = reference_motion(calibrated(0.995));
        assert!((slow - 0.144).abs() < 0.007, "{slow}");
        let fast = reference_motion(calibrated(0.98));
        let formula = calibrated(0.98).noise_rad(0.5 / 9.81).to_degrees();
        assert!((fast / formula - 1.0).abs() < 0.05, "{fast} {formula}");
        let integral =
            ComplementaryFilter { integral_gain: 0.05, ..ComplementaryFilter::new(0.995, 0.0) };
        let learned = reference_motion(integral);
        println!("a = 0.995: {slow:.3}° calibrated, {learned:.3}° with integral term");
        assert!((learned - 0.157).abs() < 0.01, "{learned}");
        // The gyro alone drifts by its bias; here it is off by degrees within seconds.
        let drifting = reference_motion(ComplementaryFilter::new(1.0, 0.0));
        assert!(drifting > 30.0, "{drifting}");
    }

    #[test]
    fn an_unknown_bias_stands_as_tau_times_bias() {
        let mut filter = ComplementaryFilter::new(0.98, 0.0);
        let bias = 0.01;
        for _ in 0..2000 {
            filter.update(bias, 0.0, STEP_S);
        }
        assert!((filter.angle_rad - filter.bias_error_rad(bias, STEP_S)).abs() < 1e-12);
        assert!((filter.time_constant_s(STEP_S) - 0.49).abs() < 1e-12);
    }

    /// Upside down the accelerometers show now just below 180°, now just above −180°.
    #[test]
    fn an_angle_may_pass_half_a_turn() {
        let mut filter = ComplementaryFilter::new(0.98, 179f64.to_radians());
        let rate = 10f64.to_radians();
        for step in 1..=200 {
            let wanted = wrap_angle((179.0 + 0.1 * f64::from(step)).to_radians());
            let found = filter.update(rate, wanted, STEP_S);
            assert!(wrap_angle(found - wanted).abs() < 1e-9, "{step}: {found}");
        }
    }

    #[test]
    fn missing_values_do_not_stay() {
        let mut filter = ComplementaryFilter::new(0.98, 0.1);
        assert_eq!(filter.update(f64::NAN, f64::NAN, STEP_S), 0.1);
        assert!(filter.update(0.0, 0.1, STEP_S).is_finite());
    }
}
