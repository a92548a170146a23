//! Outcomes. A float solution is a result of lower quality, not an error.

use core::fmt;

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
