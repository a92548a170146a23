//! What a receiver states about signals that are not those of the satellites.

/// Whether a receiver finds satellites imitated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Spoofing {
    /// It says nothing.
    #[default]
    Unknown,
    /// It finds nothing.
    None,
    /// It does.
    Stated,
}

/// Whether a receiver finds its bands disturbed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Jamming {
    /// It says nothing.
    #[default]
    Unknown,
    /// It finds nothing.
    None,
    /// It does, and works on.
    Warning,
    /// It does, and cannot do anything against it.
    Critical,
}

/// The newest statements of a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Interference {
    /// Imitated satellites.
    pub spoofing: Spoofing,
    /// Disturbed bands, the worst of them.
    pub jamming: Jamming,
    /// How much of a continuous wave the receiver finds, 0 to 1, in the worst of its bands.
    pub continuous_wave: Option<f64>,
    /// The gain of its amplifiers, 0 to 1, in the band where it is smallest: strong foreign signals lower it.
    pub gain: Option<f64>,
}

impl Spoofing {
    /// The word in the outputs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::None => "none",
            Self::Stated => "stated",
        }
    }
}

impl Jamming {
    /// The word in the outputs.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::None => "none",
            Self::Warning => "warning",
            Self::Critical => "critical",
        }
    }
}
