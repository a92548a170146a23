//! The filter of the rotating-frame paper **as published**: a documented reference, not for use.
//!
//! Fed with what antenna and accelerometers really measure it rejects most of it, because gravity
//! and the antenna's own motion are not in its model; fed with its own model it loses the heading in
//! uniform motion, because that model does not contain it. [`super::super::filter`] is the filter to
//! use. Equations (1)–(16), with the typographical errors of (15) and of H at intermediate instants
//! repaired: they could not be run as printed.

use nalgebra::{DMatrix, DVector, Vector3};

use super::super::RotatingArm;
use super::super::attitude_form::{Carried, integrate_angles, translate};
use super::super::gradient::Prediction;
use super::super::layout::{
    ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, Layout, PAPER_STATES, POSITION, RATE, VELOCITY,
};
use super::super::ranging::{Measured, Ranging};
use super::model;
use crate::fusion::earth::local_level::LocalLevel;
use crate::fusion::kalman::{Batch, Estimate, Gate, add_integrated_noise};

/// Q_min a step of 0.01 s, by block: the printed matrix is missing, only its values survive.
pub(in crate::fusion::arm) const STEP_VARIANCES: [(core::ops::Range<usize>, f64); 5] =
    [(POSITION, 1e-4), (VELOCITY, 1e-6), (ACCELERATION, 1e-6), (ATTITUDE, 4e-6), (RATE, 4e-7)];
/// c² N_ξv, (m/s)²/s; not given in the paper.
const CLOCK_DENSITY: f64 = 0.01;
/// σ_n.
const ACCELEROMETER_SD_MPS2: f64 = 0.01;

/// The published filter with its 17 states.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedFilter {
    /// The arm; the published model knows nothing of its centre or mounting.
    pub arm: RotatingArm,
    /// Gate; the published one is [`Gate::NoiseOnly`] with 3 sigmas.
    pub gate: Gate,
    /// Whether Q follows the corrections, equation (15).
    pub adaptive: bool,
    time_s: f64,
    state: DVector<f64>,
    estimate: Estimate,
    process_noise: DMatrix<f64>,
    minimal_noise: DMatrix<f64>,
    layout: Layout,
    batch: Batch,
}

impl PublishedFilter {
    /// From a state and the standard deviations of its independent errors, at `time_s` after the
    /// arm's time zero; `step_s` is the fixed step between accelerometer measurements.
    #[must_use]
    pub fn new(
        arm: RotatingArm,
        time_s: f64,
        state: [f64; PAPER_STATES],
        standard_deviations: &[f64; PAPER_STATES],
        step_s: f64,
    ) -> Self {
        let mut minimal_noise = DMatrix::zeros(PAPER_STATES, PAPER_STATES);
        for (block, variance) in STEP_VARIANCES {
            for index in block {
                minimal_noise[(index, index)] = variance;
            }
        }
        add_integrated_noise(&mut minimal_noise, &[CLOCK, CLOCK_RATE], CLOCK_DENSITY, step_s);
        Self {
            arm,
            gate: Gate::NoiseOnly { sigmas: 3.0 },
            adaptive: true,
            time_s,
            state: DVector::from_row_slice(&state),
            estimate: Estimate::new(standard_deviations),
            process_noise: minimal_noise.clone(),
            minimal_noise,
            layout: Layout::new(false, false, false, 0),
            batch: Batch::default(),
        }
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> &[f64] {
        self.state.as_slice()
    }

    /// P.
    #[must_use]
    pub const fn covariance(&self) -> &DMatrix<f64> {
        &self.estimate.covariance
    }

    /// Q of the next step.
    #[must_use]
    pub const fn process_noise(&self) -> &DMatrix<f64> {
        &self.process_noise
    }

    /// The measurements of the last update: innovations, H and outcomes, in the order D, Ḋ, n.
    #[must_use]
    pub const fn batch(&self) -> &Batch {
        &self.batch
    }

    /// Equations (1) and (12), (13).
    pub fn predict(&mut self, step_s: f64) {
        let layout = &self.layout;
        // x⁻ = x + f Δt + A f Δt²/2
        translate(self.state.as_mut_slice(), step_s);
        integrate_angles(self.state.as_mut_slice(), layout, step_s);
        // Φ = I + A Δt: first order, so the acceleration does not reach the position
        self.estimate.propagate(|x| {
            for axis in 0..3 {
                x[POSITION.start + axis] += step_s * x[VELOCITY.start + axis];
                x[VELOCITY.start + axis] += step_s * x[ACCELERATION.start + axis];
                x[ATTITUDE.start + axis] += step_s * x[RATE.start + axis];
            }
            x[CLOCK] += step_s * x[CLOCK_RATE];
        });
        self.estimate.covariance += &self.process_noise;
        self.time_s += step_s;
    }

    /// Equations (9)–(11), (14)–(16): the accelerometers, with all satellites if it is their turn.
    pub fn update(&mut self, satellites: &[Ranging], specific_force_mps2: &Vector3<f64>) {
        self.linearise(satellites, specific_force_mps2);
        self.estimate.update(&mut self.batch, self.gate);
        self.state += &self.estimate.correction;
        if self.adaptive {
            // Q ← Q_min + 0.1 Q + 0.7 diag(δx δxᵀ)
            self.process_noise *= 0.1;
            self.process_noise += &self.minimal_noise;
            for (index, change) in self.estimate.correction.iter().enumerate() {
                self.process_noise[(index, index)] += 0.7 * change * change;
            }
        }
    }

    fn linearise(&mut self, satellites: &[Ranging], specific_force_mps2: &Vector3<f64>) {
        let here = LocalLevel::at(&self.state.fixed_rows::<3>(POSITION.start).into_owned());
        let decoded = Carried::Euler.decode(self.state.as_slice(), &self.layout, &here);
        let arm = self.arm.at_angle(self.arm.angle_rad(self.time_s));
        let (batch, layout) = (&mut self.batch, &self.layout);
        batch.begin(PAPER_STATES);
        let mut add = |measured: Measured, prediction: Prediction| {
            let row = batch.push(measured.value - prediction.value, measured.variance());
            decoded.write_row(&prediction.gradient, layout, row);
        };
        for Ranging { motion: satellite, pseudorange_m, .. } in satellites {
            if let Some(measured) = pseudorange_m {
                add(*measured, model::pseudorange(&decoded.motion, satellite));
            }
        }
        for Ranging { motion: satellite, range_rate_mps, .. } in satellites {
            if let Some(measured) = range_rate_mps {
                add(*measured, model::range_rate(&decoded.motion, satellite));
            }
        }
        let forces = model::specific_force(&decoded.motion, &arm);
        for (measured, prediction) in specific_force_mps2.iter().zip(forces) {
            add(Measured { value: *measured, sd: ACCELEROMETER_SD_MPS2 }, prediction);
        }
    }
}
