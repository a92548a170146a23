//! Simulation: what a body, its antennas and its sensors truly do, and what they would measure.
//!
//! The simulator has measurement equations of its own, from true positions, so that an error in an
//! estimator cannot cancel against itself. It never calls an estimator; tests and examples join the
//! two.
#![forbid(unsafe_code)]

pub mod noise;
pub mod rotating_arm;
pub mod walker;
