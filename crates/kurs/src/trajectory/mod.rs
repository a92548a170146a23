//! Trajectories from ground measurements: where a moving object is, from the angles, ranges, range
//! differences and direction cosines that stations on the ground measure.
//!
//! In the order of the work: [`station`] and [`measurement`] (what is measured and its derivatives),
//! [`closed_form`] (a point from the fewest measurements, all roots), [`minimal_set`] (which closed
//! form a mixture of measurements allows), [`problem`] (the measurements of one instant, checked),
//! [`least_squares`] (any mixture, with covariance), [`outliers`] and [`dilution`] (what to leave out,
//! and what the geometry does), [`accuracy`] (standard deviations three ways) and [`random_search`]
//! (the paper's, for comparison), [`refraction`] and [`smoother`] (whole trajectories).
//!
//! Equation numbers are those of Kisin (2017), with the corrections listed in
//! `docs/theory/trajectory.md`. Positions are in metres in one common Earth-fixed frame, angles in
//! radians: azimuth clockwise from north, elevation above the horizon of the station.

pub mod accuracy;
pub mod closed_form;
pub mod dilution;
pub mod least_squares;
pub mod measurement;
pub mod minimal_set;
pub mod outliers;
pub mod problem;
pub mod random_search;
pub mod refraction;
pub mod smoother;
pub mod station;
