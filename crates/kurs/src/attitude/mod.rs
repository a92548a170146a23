//! How the body is oriented, from baselines or phases whose ambiguities are known.
//!
//! All methods minimise one cost, the weighted squares of what was measured, over the rotations
//! ([`AttitudeProblem`]): Wahba's closed form gives the start ([`wahba`]), Newton's method the
//! minimum ([`weighted`]), and [`uniqueness`] proves that no other attitude fits as well, or finds
//! it. Rotations act from the body frame to an outside frame, `L = Q l`; kernels take bare matrices,
//! the typed entry is [`joint`]. Equations: Rapoport, *A method of determining relative
//! orientation*, in information form.

pub mod angles;
pub mod continuation;
pub mod coordinates;
pub mod direction;
pub mod installation;
pub mod joint;
pub mod line;
pub mod reduction;
mod small;
pub mod three_point;
pub mod triad;
pub mod undifferenced;
pub mod uniqueness;
pub mod vertical;
pub mod wahba;
pub mod weighted;

pub use direction::LineDirection;
pub use joint::{ArrayAttitude, ArrayDirection};
pub use line::MeasuredLine;
pub use uniqueness::{GlobalMinimum, Uniqueness};
pub use vertical::{Vertical, VerticalMemory};
pub use weighted::{AttitudeProblem, Minimum};

/// What was given cannot be an attitude problem, or leaves the attitude open.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AttitudeError {
    /// An infinite number or none at all.
    #[error("the {what} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// Counts that do not belong together.
    #[error("{found} {what} where {expected} belong")]
    Shape {
        /// What was counted.
        what: &'static str,
        /// How many were expected.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// One vector or none.
    #[error("{found} vectors, at least two are needed for an attitude")]
    TooFewVectors {
        /// How many there are.
        found: usize,
    },
    /// A weight or standard deviation that is zero, negative or not a number.
    #[error("a {what} of {value}, it must be positive")]
    NotPositive {
        /// Which quantity.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A weight matrix that differs from its transpose.
    #[error("the {what} is not symmetric (by {difference:e})")]
    NotSymmetric {
        /// Which matrix.
        what: &'static str,
        /// Largest difference between the matrix and its transpose.
        difference: f64,
    },
    /// A weight matrix with a negative eigenvalue.
    #[error("the {what} has a negative eigenvalue")]
    Indefinite {
        /// Which matrix.
        what: &'static str,
    },
    /// Some turn changes nothing that was measured: collinear antennas, or too few satellites.
    #[error("the measurements leave a turn undetermined (are the antennas on one line?)")]
    Unobservable,
    /// A right or obtuse triangle, which the published three-point method cannot take.
    #[error(
        "the triangle is not acute (products of its sides {squared_legs_m2:?} m²): use the weighted method"
    )]
    NotAcute {
        /// `d², e², f²`.
        squared_legs_m2: [f64; 3],
    },
    /// A method for `R ⊗ N` was given the general form.
    #[error("the continuation needs antennas that all see the same satellites")]
    NotSeparable,
    /// The iteration did not settle.
    #[error("no convergence within {iterations} iterations")]
    NoConvergence {
        /// Steps taken.
        iterations: usize,
    },
}
