//! Observations: what one antenna measured at one instant, and the time-matched set of all antennas.

pub mod interference;
pub mod matcher;

use std::borrow::Cow;

use interference::Interference;

use crate::signal::{Satellite, Signal};
use crate::time::GpsTime;

/// Pseudoranges outside these bounds are no signal of a navigation satellite, whatever the
/// receiver's clock (GEO: 42 000 km; clocks are kept within some milliseconds).
const PLAUSIBLE_RANGE_M: core::ops::Range<f64> = 1e6..1e8;
/// Beyond, a double does not resolve a thousandth of a cycle.
const MAX_PHASE_CYCLES: f64 = 1e12;
/// In low orbit it is 40 kHz; a clock that drifts by 1e-4 adds 160 kHz.
const MAX_DOPPLER_HZ: f64 = 1e6;
/// Receivers tell 60 dB-Hz at most, and some zero for unknown.
const MAX_CN0_DBHZ: f64 = 1e3;

/// One signal of one satellite at one antenna and epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The satellite.
    pub satellite: Satellite,
    /// Band and tracking code.
    pub signal: Signal,
    /// Code observation, m.
    pub pseudorange_m: Option<f64>,
    /// Carrier phase, cycles, in the sense of the pseudorange: it grows with the distance.
    pub phase_cycles: Option<f64>,
    /// Doppler shift, Hz, positive when the satellite approaches: −λ D is the range rate.
    pub doppler_hz: Option<f64>,
    /// Carrier-to-noise density ratio, dB-Hz.
    pub cn0_dbhz: Option<f64>,
    /// What the receiver says about the continuity of the carrier phase.
    pub lock: Lock,
}

impl Observation {
    /// The pseudorange, if a navigation satellite can be so far.
    pub(crate) fn plausible_range(&self) -> Option<f64> {
        self.pseudorange_m.filter(|range_m| PLAUSIBLE_RANGE_M.contains(range_m))
    }

    /// Without the numbers that no receiver can have measured: they count as missing.
    fn plausible(&self) -> Self {
        let within = |number: Option<f64>, most: f64| number.filter(|n| n.abs() <= most);
        Self {
            pseudorange_m: self.plausible_range(),
            phase_cycles: within(self.phase_cycles, MAX_PHASE_CYCLES),
            doppler_hz: within(self.doppler_hz, MAX_DOPPLER_HZ),
            cn0_dbhz: within(self.cn0_dbhz, MAX_CN0_DBHZ),
            ..*self
        }
    }
}

/// Loss-of-lock indicator of a carrier phase, as bits of the RINEX digit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Lock(pub u8);

impl Lock {
    /// Bit 0: lock was lost since the previous observation; a cycle slip is possible.
    pub const SLIP: u8 = 1;
    /// Bit 1: the phase may be off by half a cycle.
    pub const HALF_CYCLE: u8 = 2;

    /// Whether a cycle slip may have happened since the previous observation.
    #[must_use]
    pub const fn slipped(self) -> bool {
        self.0 & Self::SLIP != 0
    }

    /// Whether the phase may be off by half a cycle: not usable as an integer.
    #[must_use]
    pub const fn half_cycle_unresolved(self) -> bool {
        self.0 & Self::HALF_CYCLE != 0
    }
}

/// Everything one antenna measured at one instant of its own clock.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AntennaEpoch {
    /// Time tag by the receiver's own clock, on the GPS scale.
    pub time: GpsTime,
    /// Observations in the order of the source; a reader reuses this buffer.
    pub observations: Vec<Observation>,
    /// The receiver lost power since the previous epoch: every phase slipped.
    pub power_failure: bool,
    /// Receiver clock offset in s, where the source states that it was *not* yet applied.
    pub clock_offset_s: Option<f64>,
    /// What the receiver states about foreign signals.
    pub interference: Interference,
}

/// The epochs of all antennas that belong together; `None` where an antenna has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ArrayEpoch {
    /// Instant of the row: the time tag of the first antenna that has an epoch.
    pub time: GpsTime,
    /// One entry an antenna, in the order of the configuration.
    pub antennas: Vec<Option<AntennaEpoch>>,
    /// The fixed station, if there is one and it has this epoch.
    pub station: Option<AntennaEpoch>,
}

impl ArrayEpoch {
    /// The epoch without the numbers that no receiver can have measured (not finite, beyond all
    /// bounds): one of them would spoil whatever is remembered of the others.
    pub(crate) fn plausible(&self) -> Cow<'_, Self> {
        let all = |epoch: &AntennaEpoch| epoch.observations.iter().all(|o| o.plausible() == *o);
        if self.antennas.iter().chain([&self.station]).flatten().all(all) {
            return Cow::Borrowed(self);
        }
        let mut epoch = self.clone();
        for antenna in epoch.antennas.iter_mut().chain([&mut epoch.station]).flatten() {
            antenna.observations.iter_mut().for_each(|o| *o = o.plausible());
        }
        Cow::Owned(epoch)
    }
}
