//! Outcomes. A float solution is a result of lower quality, not an error.

use core::fmt;

use nalgebra::Matrix3;

use crate::frames::{Body, Ecef, Enu, Geodetic, Ned, Rotation, Vector};
use crate::signal::{Band, Satellite, Signal, System};
use crate::time::{Calendar, GpsTime};

/// How far an epoch got; the words of the output column `status`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// Integer ambiguities accepted.
    Fixed,
    /// Real-valued ambiguities.
    Float,
    /// No solution this epoch.
    Lost,
    /// A fix that broke a check of length, geometry, tilt, residuals or time: refused.
    Inconsistent,
    /// This input can never give an attitude.
    NotCapable,
}

/// Why an epoch is not fixed; the words of the output column `reason`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// Fewer usable satellites than unknowns need.
    FewSatellites,
    /// Fewer than two antennas have observations.
    FewAntennas,
    /// No usable ephemeris for the satellites in view.
    NoEphemeris,
    /// Code observations but no carrier phase.
    NoPhase,
    /// The antennas were not sampled together.
    TimeMismatch,
    /// The model is too weak for integers.
    WeakModel,
    /// The second-best integers are almost as good as the best.
    Ratio,
    /// The predicted success rate is too low.
    SuccessRate,
    /// The baseline does not have the known length.
    Length,
    /// The baselines do not fit the known array.
    Geometry,
    /// Pitch or roll beyond what the body can do.
    Tilt,
    /// Phase residuals too large for their weights.
    Residuals,
    /// Two attitudes fit equally well.
    TwoMinima,
    /// Integers around a triangle of antennas do not close.
    Closure,
    /// The search reached its node budget.
    Budget,
    /// Too many cycle slips at once.
    Slip,
    /// Observations that cannot be used.
    BadInput,
    /// An isolated fix of a weak model, which no other epoch confirms yet.
    Unproven,
    /// Integers of one arc disagree between epochs.
    Contradiction,
}

/// One check of an epoch's integers: a statistic, and how probable one as bad as this is if all is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// The reason that the row has where this check is the first to fail.
    pub reason: Reason,
    /// What was measured: a weighted sum of squares, or a value in the unit of its kind.
    pub statistic: f64,
    /// Its degrees of freedom; 0 where it has no distribution.
    pub degrees_of_freedom: usize,
    /// Probability of a value as bad as this or worse if nothing is wrong.
    pub p_value: f64,
    /// The least probability that is accepted.
    pub level: f64,
}

impl Check {
    /// Whether the epoch does not pass.
    #[must_use]
    pub fn fails(&self) -> bool {
        // A value that is no number fails too.
        self.p_value.is_nan() || self.p_value < self.level
    }
}

/// What one epoch yields: one row of the outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct EpochSolution {
    /// Time tag of the first antenna that has an epoch.
    pub time: GpsTime,
    /// The true instant in UTC, by the receiver's clock bias and the broadcast parameters.
    pub time_utc: Option<Calendar>,
    /// How far the epoch got.
    pub status: Status,
    /// Why it is not fixed; `None` when it is.
    pub reason: Option<Reason>,
    /// Antennas with observations.
    pub antennas: usize,
    /// Most satellites that two antennas share above the mask.
    pub shared_satellites: usize,
    /// Satellites with a double-differenced carrier phase.
    pub satellites: usize,
    /// Integer ambiguities.
    pub ambiguities: usize,
    /// Orientation of the body.
    pub attitude: Option<AttitudeEstimate>,
    /// Predicted probability that the integers are right (bootstrapping).
    pub success_rate: Option<f64>,
    /// Second-best over best squared distance, ≥ 1.
    pub ratio: Option<f64>,
    /// Root mean square of the double-difference phase residuals, m.
    pub residual_rms_m: Option<f64>,
    /// Body origin, or the first antenna while the attitude is unknown.
    pub position: Option<PositionEstimate>,
    /// From the first antenna to each other one, in the order of the configuration.
    pub baselines: Vec<BaselineEstimate>,
    /// Further points of the body, in the order of the configuration.
    pub points: Vec<PointEstimate>,
    /// Antennas by code differences to a fixed station; empty without one. The index is that of the
    /// antenna.
    pub by_code: Vec<PointEstimate>,
    /// What the solution leaves of each signal; empty unless wanted.
    pub residuals: Vec<SignalResidual>,
    /// The best integers, accepted or not; empty unless wanted.
    pub integers: Vec<IntegerSum>,
    /// Probability of all other integers over that of the best; `None` unless wanted.
    pub rivals: Option<f64>,
    /// What a predicted attitude had to say; `None` without one, or where it said nothing.
    pub prediction: Option<PredictionRole>,
    /// What the integers of this row do without; `None` if they are those of all observations.
    pub left_out: Option<LeftOut>,
    /// Antennas that have observations and no part in the row, each with the reason.
    pub idle_antennas: Vec<(usize, Reason)>,
    /// What the integers went through, in this order; empty if none were found.
    pub checks: Vec<Check>,
}

/// What was left out of an epoch, because with it the integers of the others did not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeftOut {
    /// Phases that unlike receivers may have an unknown bias for: GLONASS channels that are not known
    /// yet, geostationary satellites of BeiDou. Their code is good.
    UnlikePhases,
    /// All of a system.
    System(System),
    /// All code.
    Code,
    /// The phases of one satellite at one antenna.
    Link {
        /// Index of the antenna.
        antenna: usize,
        /// The satellite.
        satellite: Satellite,
    },
    /// The phases of one band.
    Band(Band),
}

/// What a predicted attitude did for an epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PredictionRole {
    /// Nothing: the fix was sure without it, and agrees with it.
    Agreed,
    /// It decided between integers that the epoch alone was not sure of.
    Decided,
    /// It refused a fix that contradicts it.
    Refused,
}

impl PredictionRole {
    /// The word in the outputs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Agreed => "agreed",
            Self::Decided => "decided",
            Self::Refused => "refused",
        }
    }
}

/// Whole cycles of the links of one double difference, added up with their signs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IntegerSum {
    /// Antenna, satellite, signal and sign of every link.
    pub links: Vec<(usize, Satellite, Signal, i64)>,
    /// The sum, cycles.
    pub cycles: i64,
}

/// What the solution leaves of one signal at one antenna: the most probable error of the
/// observation, given all double differences that it takes part in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalResidual {
    /// Index of the antenna.
    pub antenna: usize,
    /// The satellite.
    pub satellite: Satellite,
    /// Band and tracking code.
    pub signal: Signal,
    /// Azimuth of the satellite.
    pub azimuth_rad: f64,
    /// Its elevation.
    pub elevation_rad: f64,
    /// Pseudorange, m; `None` where it was not used.
    pub code_m: Option<f64>,
    /// Carrier phase, m; `None` where it was not used or no integers were found.
    pub phase_m: Option<f64>,
    /// How much weaker it is received than usual here and than at the other antennas, dB
    /// ([`link_noise`](crate::link_noise)).
    pub missing_db: f64,
}

/// Orientation; two antennas or a collinear array leave angles unknown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeEstimate {
    /// Clockwise from true north, `0 ≤ heading_rad < 2π`.
    pub heading_rad: Option<f64>,
    /// Nose up positive.
    pub pitch_rad: Option<f64>,
    /// Right side down positive.
    pub roll_rad: Option<f64>,
    /// Covariance of heading, pitch, roll (in this order), rad², with all that they are uncertain by;
    /// rows of unknown angles mean nothing.
    pub covariance_rad2: Matrix3<f64>,
    /// The part of it that the survey of the antennas causes: the same in all epochs of a body, so
    /// that it does not average.
    pub installation_rad2: Matrix3<f64>,
    /// The full rotation, where all three angles are known.
    pub ned_from_body: Option<Rotation<Ned, Body>>,
    /// How far the line of the antennas rises above the horizon, where all of them are on one line.
    pub line_elevation_rad: Option<f64>,
}

/// Where a point is, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionEstimate {
    /// Index of the antenna that stands there; `None` for the origin of the body.
    pub antenna: Option<usize>,
    /// Geodetic coordinates.
    pub geodetic: Geodetic,
    /// The same point in ECEF, m.
    pub position_m: Vector<Ecef>,
    /// Covariance in local level axes (north, east, down), m².
    pub covariance_m2: Matrix3<f64>,
    /// Velocity, m/s, where there is Doppler.
    pub velocity_mps: Option<Vector<Ned>>,
    /// Clock of the first antenna's receiver times c, m, where it was estimated.
    pub clock_m: Option<f64>,
    /// Horizontal dilution of precision, where satellites were used.
    pub hdop: Option<f64>,
    /// What the coordinates rest on.
    pub origin: PositionOrigin,
}

/// What coordinates rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PositionOrigin {
    /// The antenna's own code.
    Alone,
    /// Code of the antenna and a fixed station.
    StationCode,
    /// Carrier phases of both, with integers.
    StationPhase,
}

/// A baseline in local level axes at the first antenna.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaselineEstimate {
    /// Index of the antenna where it starts.
    pub base: usize,
    /// Index of the antenna where it ends.
    pub rover: usize,
    /// Fixed, float or refused.
    pub status: Status,
    /// East, north, up, m.
    pub baseline_m: Vector<Enu>,
    /// Covariance of that, m².
    pub covariance_m2: Matrix3<f64>,
}

/// A point of the body, or an antenna, in the outside frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointEstimate {
    /// Index in the configuration.
    pub index: usize,
    /// Geodetic coordinates.
    pub geodetic: Geodetic,
    /// Covariance in local level axes (north, east, down), m².
    pub covariance_m2: Matrix3<f64>,
}

impl EpochSolution {
    /// A row without a solution.
    #[must_use]
    pub const fn lost(time: GpsTime, reason: Reason) -> Self {
        Self {
            time,
            time_utc: None,
            status: Status::Lost,
            reason: Some(reason),
            antennas: 0,
            shared_satellites: 0,
            satellites: 0,
            ambiguities: 0,
            attitude: None,
            success_rate: None,
            ratio: None,
            residual_rms_m: None,
            position: None,
            baselines: Vec::new(),
            points: Vec::new(),
            by_code: Vec::new(),
            residuals: Vec::new(),
            integers: Vec::new(),
            rivals: None,
            prediction: None,
            left_out: None,
            idle_antennas: Vec::new(),
            checks: Vec::new(),
        }
    }
}

impl Status {
    /// Every status, in the order of the documentation.
    pub const ALL: [Self; 5] =
        [Self::Fixed, Self::Float, Self::Lost, Self::Inconsistent, Self::NotCapable];

    /// The word in the outputs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Float => "float",
            Self::Lost => "lost",
            Self::Inconsistent => "inconsistent",
            Self::NotCapable => "not_capable",
        }
    }
}

impl Reason {
    /// Every reason, in the order of the documentation.
    pub const ALL: [Self; 19] = [
        Self::FewSatellites,
        Self::FewAntennas,
        Self::NoEphemeris,
        Self::NoPhase,
        Self::TimeMismatch,
        Self::WeakModel,
        Self::Ratio,
        Self::SuccessRate,
        Self::Length,
        Self::Geometry,
        Self::Tilt,
        Self::Residuals,
        Self::TwoMinima,
        Self::Closure,
        Self::Budget,
        Self::Slip,
        Self::BadInput,
        Self::Unproven,
        Self::Contradiction,
    ];

    /// The word in the outputs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::FewSatellites => "few_satellites",
            Self::FewAntennas => "few_antennas",
            Self::NoEphemeris => "no_ephemeris",
            Self::NoPhase => "no_phase",
            Self::TimeMismatch => "time_mismatch",
            Self::WeakModel => "weak_model",
            Self::Ratio => "ratio",
            Self::SuccessRate => "success_rate",
            Self::Length => "length",
            Self::Geometry => "geometry",
            Self::Tilt => "tilt",
            Self::Residuals => "residuals",
            Self::TwoMinima => "two_minima",
            Self::Closure => "closure",
            Self::Budget => "budget",
            Self::Slip => "slip",
            Self::BadInput => "bad_input",
            Self::Unproven => "unproven",
            Self::Contradiction => "contradiction",
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}
