//! Everything that navigation data say, beside the ephemerides: ionosphere, UTC, time scales.

use super::store::EphemerisStore;
use crate::signal::System;
use crate::time::GpsTime;

/// All navigation data of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NavigationData {
    /// Orbits and clocks.
    pub ephemerides: EphemerisStore,
    /// Broadcast models of the ionosphere.
    pub ionosphere: IonosphereParameters,
    /// System times against UTC, in the order of the source.
    pub utc: Vec<UtcParameters>,
    /// System times against each other, in the order of the source.
    pub time_offsets: Vec<SystemTimeOffset>,
    /// GPST − UTC as the source states it, s.
    pub leap_seconds: Option<i32>,
}

/// Broadcast models of the ionosphere; of each the last one read.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct IonosphereParameters {
    /// Klobuchar model of GPS.
    pub gps: Option<Klobuchar>,
    /// Klobuchar model of BeiDou (its own axes and epoch of day).
    pub beidou: Option<Klobuchar>,
    /// Klobuchar model of QZSS.
    pub qzss: Option<Klobuchar>,
    /// Effective ionisation level of Galileo's NeQuick G: a₀ (solar flux units), a₁ (per degree),
    /// a₂ (per degree²).
    pub galileo: Option<[f64; 3]>,
}

/// The eight parameters of the Klobuchar model (IS-GPS-200N 20.3.3.5.2.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Klobuchar {
    /// Amplitude: s, s/semicircle, s/semicircle², s/semicircle³.
    pub alpha: [f64; 4],
    /// Period: s, s/semicircle, s/semicircle², s/semicircle³.
    pub beta: [f64; 4],
}

/// A system's time against UTC: `system − UTC = leap seconds + A₀ + A₁ (t − reference)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UtcParameters {
    /// Whose time.
    pub system: System,
    /// A₀, s.
    pub bias_s: f64,
    /// A₁, s/s.
    pub drift: f64,
    /// Reference time.
    pub reference_time: GpsTime,
}

/// Two system times against each other: `minuend − subtrahend = A₀ + A₁ (t − reference)`, whole
/// seconds apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SystemTimeOffset {
    /// The system whose time comes first.
    pub minuend: System,
    /// The system whose time is subtracted.
    pub subtrahend: System,
    /// A₀, s.
    pub bias_s: f64,
    /// A₁, s/s.
    pub drift: f64,
    /// Reference time.
    pub reference_time: GpsTime,
}
