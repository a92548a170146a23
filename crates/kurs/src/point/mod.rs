//! Where am I: one antenna's position, clock and velocity from its code and Doppler observations.
//!
//! [`track`] finds for every satellite of an epoch its state at transmission; [`solve`] is the
//! iterated weighted least squares of the position; [`velocity`] the same for the Doppler.

mod position;
mod track;
mod velocity;

pub use position::{Exclusion, NoPosition, PointSettings, PointSolution, solve, solve_near};
pub use track::{Code, Tracked, track, track_sent};
pub use velocity::{Velocity, velocity};
