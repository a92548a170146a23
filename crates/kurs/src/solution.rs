//! Outcomes. A float solution is a result of lower quality, not an error.
//!
//! With the feature `serde` rows serialise, under the names of their fields: statuses and reasons as their words,
//! vectors as lists, matrices row by row, rotations as quaternions `w, x, y, z`, times as week and seconds,
//! satellites and signals as RINEX names them.

use core::fmt;

use nalgebra::Matrix3;

use crate::frames::{Body, Ecef, Enu, Geodetic, Ned, Rotation, Vector};
use crate::signal::{Band, Satellite, Signal, System};
use crate::time::{Calendar, GpsTime};

/// How far an epoch got; the words of the output column `status`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
#[non_exhaustive]
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
    /// Phase residuals too large for their weights; also satellites that contradict each other by tens of
    /// metres with no known geometry, and integers that a predicted attitude refutes.
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
    /// An isolated fix of a weak model, which no other epoch confirms yet; or integers that are not sure without the
    /// known geometry, which the session has not confirmed yet.
    Unproven,
    /// Integers of one arc disagree between epochs.
    Contradiction,
    /// The attitude is not of this epoch: a gyro carried it here.
    Predicted,
    /// A receiver states that satellites are imitated.
    Interference,
}

/// One check of an epoch's integers: a statistic, and how probable one as bad as this is if all is right.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct EpochSolution {
    /// Time tag of the first antenna that has an epoch.
    pub time: GpsTime,
    /// The true instant in UTC, by the receiver's clock bias and the broadcast parameters.
    pub time_utc: Option<Calendar>,
    /// How far the epoch got, with the orientation of the body.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub outcome: Outcome,
    /// Antennas with observations.
    pub antennas: usize,
    /// Antennas that have observations and no part in the row, each with the reason.
    pub idle_antennas: Vec<(usize, Reason)>,
    /// Satellites above the mask that at least two antennas see.
    pub shared_satellites: usize,
    /// Satellites with a double-differenced carrier phase.
    pub satellites: usize,
    /// Satellites by whose code the antenna was located that the position is of.
    pub located_by: usize,
    /// Root mean square of the residuals of double-difference phases, or of coordinates, m.
    pub residual_rms_m: Option<f64>,
    /// Body origin, or the first antenna that has a position while the attitude is unknown.
    pub position: Option<PositionEstimate>,
    /// From the first antenna that takes part to each other one, in the order of the configuration.
    pub baselines: Vec<BaselineEstimate>,
    /// Further points of the body, in the order of the configuration.
    pub points: Vec<PointEstimate>,
    /// Antennas by code differences to a fixed station; empty without one. The index is that of the
    /// antenna.
    pub by_code: Vec<PointEstimate>,
    /// What was found of the integers; `None` without double differences.
    pub integers: Option<IntegerReport>,
    /// What the solution leaves of each signal; `None` unless wanted.
    pub signals: Option<SignalReport>,
}

/// How far an epoch got; what is fixed has an attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(tag = "status", rename_all = "snake_case"))]
pub enum Outcome {
    /// Integer ambiguities accepted.
    Fixed {
        /// Orientation of the body.
        attitude: AttitudeEstimate,
    },
    /// Real-valued ambiguities.
    Float {
        /// Orientation of the body, as uncertain as it is.
        attitude: Option<AttitudeEstimate>,
        /// Why the epoch is not fixed; `None` for estimates that know no integers.
        reason: Option<Reason>,
    },
    /// A fix that broke a check: refused.
    Inconsistent {
        /// What the refused integers would mean.
        attitude: Option<AttitudeEstimate>,
        /// The check.
        reason: Reason,
    },
    /// No solution this epoch.
    Lost {
        /// What is missing.
        reason: Reason,
    },
    /// This input can never give an attitude: only one antenna has observations.
    NotCapable,
}

/// What was found of an epoch's integers.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct IntegerReport {
    /// Integer ambiguities.
    pub ambiguities: usize,
    /// Predicted probability that the integers are right (bootstrapping).
    pub success_rate: Option<f64>,
    /// Second-best over best squared distance, ≥ 1; `None` if no integers were found.
    pub ratio: Option<f64>,
    /// What the integers went through, in this order; empty if none were found.
    pub checks: Vec<Check>,
    /// What the integers of this row do without; `None` if they are those of all observations.
    pub left_out: Option<LeftOut>,
    /// What a predicted attitude had to say; `None` without one, or where it said nothing.
    pub prediction: Option<PredictionRole>,
}

/// The solution of an epoch signal by signal.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SignalReport {
    /// What the solution leaves of each signal.
    pub residuals: Vec<SignalResidual>,
    /// The best integers, accepted or not; empty if none were found.
    pub integers: Vec<IntegerSum>,
    /// Probability of all other integers over that of the best; `None` if none were found.
    pub rivals: Option<f64>,
}

/// What was left out of an epoch, because with it the integers of the others did not fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum LeftOut {
    /// Phases that mixed receivers may have an unknown bias for: GLONASS channels that are not known
    /// yet, geostationary satellites of BeiDou. Their code is good.
    MixedReceiverPhases,
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
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct IntegerSum {
    /// Antenna, satellite, signal and sign of every link.
    pub links: Vec<(usize, Satellite, Signal, i64)>,
    /// The sum, cycles.
    pub cycles: i64,
}

/// What the solution leaves of one signal at one antenna: the most probable error of the
/// observation, given all double differences that it takes part in.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct AttitudeEstimate {
    /// Clockwise from true north, `0 ≤ heading_rad < 2π`.
    pub heading_rad: Option<f64>,
    /// Nose up positive.
    pub pitch_rad: Option<f64>,
    /// Right side down positive.
    pub roll_rad: Option<f64>,
    /// Covariance of heading, pitch, roll (in this order), rad², with all that they are uncertain by;
    /// rows of unknown angles mean nothing.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::frames::serialize_rows"))]
    pub covariance_rad2: Matrix3<f64>,
    /// The part of it that the survey of the antennas causes: the same in all epochs of a body, so
    /// that it does not average.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::frames::serialize_rows"))]
    pub installation_rad2: Matrix3<f64>,
    /// The full rotation, where all three angles are known.
    pub ned_from_body: Option<Rotation<Ned, Body>>,
    /// How far the line of the antennas rises above the horizon, where all of them are on one line.
    pub line_elevation_rad: Option<f64>,
}

/// Where a point is, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PositionEstimate {
    /// Index of the antenna that stands there; `None` for the origin of the body.
    pub antenna: Option<usize>,
    /// Geodetic coordinates.
    pub geodetic: Geodetic,
    /// The point in ECEF, m.
    pub position_m: Vector<Ecef>,
    /// Covariance in local level axes (north, east, down), m².
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::frames::serialize_rows"))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
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
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::frames::serialize_rows"))]
    pub covariance_m2: Matrix3<f64>,
}

/// A point of the body, or an antenna, in the outside frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PointEstimate {
    /// Index in the configuration.
    pub index: usize,
    /// Geodetic coordinates.
    pub geodetic: Geodetic,
    /// Covariance in local level axes (north, east, down), m².
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::frames::serialize_rows"))]
    pub covariance_m2: Matrix3<f64>,
}

impl EpochSolution {
    /// A row without a solution.
    #[must_use]
    pub const fn lost(time: GpsTime, reason: Reason) -> Self {
        Self {
            time,
            time_utc: None,
            outcome: Outcome::Lost { reason },
            antennas: 0,
            idle_antennas: Vec::new(),
            shared_satellites: 0,
            satellites: 0,
            located_by: 0,
            residual_rms_m: None,
            position: None,
            baselines: Vec::new(),
            points: Vec::new(),
            by_code: Vec::new(),
            integers: None,
            signals: None,
        }
    }

    /// Refuses what the epoch would give: what is fixed or float becomes inconsistent for this reason.
    pub fn refuse(&mut self, reason: Reason) {
        if let Outcome::Fixed { .. } | Outcome::Float { .. } | Outcome::Inconsistent { .. } =
            self.outcome
        {
            let attitude = self.attitude().copied();
            self.outcome = Outcome::Inconsistent { attitude, reason };
            self.baselines.iter_mut().for_each(|baseline| baseline.status = Status::Inconsistent);
        }
    }

    /// Refuses the epoch together with its attitude, which means nothing.
    pub fn refuse_attitude(&mut self, reason: Reason) {
        self.outcome = Outcome::Inconsistent { attitude: None, reason };
        self.baselines.iter_mut().for_each(|baseline| baseline.status = Status::Inconsistent);
    }

    /// Satellites in use, as receivers say it beside a position: those of the double differences, or, where there are
    /// none, those that the antenna was located by.
    #[must_use]
    pub const fn satellites_in_use(&self) -> usize {
        if self.satellites > 0 { self.satellites } else { self.located_by }
    }

    /// What the solution leaves of each signal; empty unless wanted.
    #[must_use]
    pub fn residuals(&self) -> &[SignalResidual] {
        self.signals.as_ref().map_or(&[], |signals| &signals.residuals)
    }

    /// The best integers, accepted or not; empty unless wanted.
    #[must_use]
    pub fn integer_sums(&self) -> &[IntegerSum] {
        self.signals.as_ref().map_or(&[], |signals| &signals.integers)
    }

    /// How far the epoch got.
    #[must_use]
    pub const fn status(&self) -> Status {
        self.outcome.status()
    }

    /// Whether the integers are accepted.
    #[must_use]
    pub const fn is_fixed(&self) -> bool {
        matches!(self.outcome, Outcome::Fixed { .. })
    }

    /// Why the epoch is not fixed; `None` when it is.
    #[must_use]
    pub const fn reason(&self) -> Option<Reason> {
        self.outcome.reason()
    }

    /// Orientation of the body; what it is worth says [`status`](Self::status).
    #[must_use]
    pub const fn attitude(&self) -> Option<&AttitudeEstimate> {
        self.outcome.attitude()
    }

    /// What a predicted attitude had to say of the integers.
    #[must_use]
    pub fn prediction(&self) -> Option<PredictionRole> {
        self.integers.as_ref()?.prediction
    }
}

impl Outcome {
    /// The word for it.
    #[must_use]
    pub const fn status(&self) -> Status {
        match self {
            Self::Fixed { .. } => Status::Fixed,
            Self::Float { .. } => Status::Float,
            Self::Lost { .. } => Status::Lost,
            Self::Inconsistent { .. } => Status::Inconsistent,
            Self::NotCapable => Status::NotCapable,
        }
    }

    /// Why it is not fixed; `None` when it is.
    #[must_use]
    pub const fn reason(&self) -> Option<Reason> {
        match self {
            Self::Fixed { .. } => None,
            Self::Float { reason, .. } => *reason,
            Self::Inconsistent { reason, .. } | Self::Lost { reason } => Some(*reason),
            Self::NotCapable => Some(Reason::FewAntennas),
        }
    }

    /// Orientation of the body, of whatever worth.
    #[must_use]
    pub const fn attitude(&self) -> Option<&AttitudeEstimate> {
        match self {
            Self::Fixed { attitude } => Some(attitude),
            Self::Float { attitude, .. } | Self::Inconsistent { attitude, .. } => attitude.as_ref(),
            Self::Lost { .. } | Self::NotCapable => None,
        }
    }

    /// Orientation of the body, to complete it.
    #[must_use]
    pub const fn attitude_mut(&mut self) -> Option<&mut AttitudeEstimate> {
        match self {
            Self::Fixed { attitude } => Some(attitude),
            Self::Float { attitude, .. } | Self::Inconsistent { attitude, .. } => attitude.as_mut(),
            Self::Lost { .. } | Self::NotCapable => None,
        }
    }

    /// This outcome without an attitude that is not fixed.
    #[must_use]
    pub const fn without_unfixed_attitude(self) -> Self {
        match self {
            Self::Float { reason, .. } => Self::Float { attitude: None, reason },
            Self::Inconsistent { reason, .. } => Self::Inconsistent { attitude: None, reason },
            Self::Fixed { .. } | Self::Lost { .. } | Self::NotCapable => self,
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
    pub const ALL: [Self; 21] = [
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
        Self::Predicted,
        Self::Interference,
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
            Self::Predicted => "predicted",
            Self::Interference => "interference",
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
