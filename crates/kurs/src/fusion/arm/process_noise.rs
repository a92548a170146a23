//! How much the motion may change between measurements.

use nalgebra::DMatrix;

use super::as_published::filter::STEP_VARIANCES;
use super::layout::{ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, Layout, POSITION, RATE, VELOCITY};
use crate::fusion::kalman::add_integrated_noise;

/// Process noise of the rotating-arm filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProcessNoise {
    /// White noise in continuous time: the same motion whatever the sampling.
    Continuous(Densities),
    /// The paper's variances, added at every step whatever its length: for comparison.
    PaperSteps,
}

/// Spectral densities of the white noise that drives the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Densities {
    /// q_j: jerk of the centre, m²/s⁵.
    pub jerk: f64,
    /// q_w: angular acceleration, rad²/s³; with angular accelerations in the state, angular jerk,
    /// rad²/s⁵.
    pub turning: f64,
    /// c² N_ξv: rate of the receiver clock, (m/s)²/s.
    pub clock: f64,
}

/// Named choices, from violent to quiet motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tuning {
    /// Turns of 40°/s and lateral accelerations above 1 g, without lag.
    #[default]
    Manoeuvring,
    /// Smaller noise in steady motion for twice the lag in a turn.
    Balanced,
    /// A centre that hardly accelerates.
    Calm,
}

impl Tuning {
    /// Every tuning, in the order of the documentation.
    pub const ALL: [Self; 3] = [Self::Manoeuvring, Self::Balanced, Self::Calm];

    /// The word in configuration files.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Manoeuvring => "manoeuvring",
            Self::Balanced => "balanced",
            Self::Calm => "calm",
        }
    }

    /// The densities, with constant rates (17 states) or constant angular accelerations (20).
    #[must_use]
    pub const fn densities(self, angular_acceleration: bool) -> Densities {
        let (jerk, rate_turning) = match self {
            Self::Manoeuvring => (30.0, 0.1),
            Self::Balanced => (1.0, 0.003),
            Self::Calm => (0.01, 0.1),
        };
        let turning = if angular_acceleration { 1.0 } else { rate_turning };
        Densities { jerk, turning, clock: 0.01 }
    }
}

impl ProcessNoise {
    /// Adds Q of a step.
    pub(super) fn add_to(self, q: &mut DMatrix<f64>, layout: &Layout, step_s: f64) {
        let densities = match self {
            Self::Continuous(densities) => densities,
            Self::PaperSteps => {
                for (block, variance) in STEP_VARIANCES {
                    for index in block {
                        q[(index, index)] += variance;
                    }
                }
                add_integrated_noise(q, &[CLOCK, CLOCK_RATE], 0.01, step_s);
                return;
            }
        };
        add_integrated_noise(q, &[CLOCK, CLOCK_RATE], densities.clock, step_s);
        for axis in 0..3 {
            let translation =
                [POSITION.start, VELOCITY.start, ACCELERATION.start].map(|s| s + axis);
            add_integrated_noise(q, &translation, densities.jerk, step_s);
            let rates = [ATTITUDE.start + axis, RATE.start + axis];
            if layout.angular_acceleration.is_empty() {
                add_integrated_noise(q, &rates, densities.turning, step_s);
            } else {
                let second = layout.angular_acceleration.start + axis;
                add_integrated_noise(q, &[rates[0], rates[1], second], densities.turning, step_s);
            }
        }
    }
}
