//! Simulation: what a body, its antennas and its sensors truly do, and what they would measure.
//!
//! The simulator has measurement equations of its own, from true positions, so that an error in an
//! estimator cannot cancel against itself. It never calls an estimator; tests and examples join the
//! two.
#![forbid(unsafe_code)]

pub mod arm_recording;
mod canopy;
mod check;
mod diffraction;
mod disturbance;
pub mod imu;
pub mod inertial;
pub mod motion;
mod motion_table;
pub mod noise;
pub mod nominal_orbits;
mod propagation;
mod receivable;
mod received_field;
mod receiver;
pub mod rotating_arm;
mod satellite_track;
pub mod scenario;
mod scenario_error;
pub mod simulation;
pub mod walker;
mod wall;

pub use receiver::AmbiguityChange;
