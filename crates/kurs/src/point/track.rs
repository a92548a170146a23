//! The satellites of one antenna's epoch, each with its state at the instant of transmission.

use crate::ephemeris::{NavigationData, SatelliteState};
use crate::observation::{AntennaEpoch, Observation};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite, System};

/// A satellite that an antenna observes and whose ephemeris is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    /// The satellite.
    pub satellite: Satellite,
    /// Its state when it sent what the antenna now receives.
    pub state: SatelliteState,
    /// The code observation of its lowest band, free of group delay.
    pub code: Code,
    /// That of a second band, whose difference tells the ionosphere.
    pub second: Option<Code>,
    /// Range rate from a Doppler shift, −λ D, m/s.
    pub range_rate_mps: Option<f64>,
}

/// A code observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Code {
    /// Less the group delay of its signal, m.
    pub pseudorange_m: f64,
    /// Its band.
    pub band: Band,
    /// Carrier frequency, Hz.
    pub frequency_hz: f64,
    /// Carrier-to-noise density ratio, dB-Hz.
    pub cn0_dbhz: Option<f64>,
}

/// Pseudoranges outside these bounds are no signal of a navigation satellite, whatever the
/// receiver's clock (GEO: 42 000 km; clocks are kept within some milliseconds).
const PLAUSIBLE_RANGE_M: core::ops::Range<f64> = 1e6..1e8;

/// Finds the satellites of the wanted systems in an epoch, each with the code of its lowest band
/// and, if possible, of a second one. Returns how many satellites had a pseudorange but no ephemeris.
///
/// Observations of one satellite stand together in every format; a satellite that comes a second
/// time is ignored. `tracked` is cleared and filled.
pub fn track(
    epoch: &AntennaEpoch,
    navigation: &NavigationData,
    wanted: impl Fn(System) -> bool,
    tracked: &mut Vec<Tracked>,
) -> usize {
    tracked.clear();
    let mut without_ephemeris = 0;
    for observations in epoch.observations.chunk_by(|a, b| a.satellite == b.satellite) {
        let satellite = observations[0].satellite;
        if !wanted(satellite.system) || !observations.iter().any(|o| plausible_range(o).is_some()) {
            continue;
        }
        if tracked.iter().any(|t| t.satellite == satellite) {
            continue;
        }
        match tracked_satellite(epoch, navigation, satellite, observations) {
            Some(found) => tracked.push(found),
            None => without_ephemeris += 1,
        }
    }
    without_ephemeris
}

fn plausible_range(observation: &Observation) -> Option<f64> {
    observation.pseudorange_m.filter(|range_m| PLAUSIBLE_RANGE_M.contains(range_m))
}

fn tracked_satellite(
    epoch: &AntennaEpoch,
    navigation: &NavigationData,
    satellite: Satellite,
    observations: &[Observation],
) -> Option<Tracked> {
    let store = &navigation.ephemerides;
    let channel = store.glonass_channel(satellite);

    // The receiver's tag minus P / c is the satellite's own clock at transmission, whatever the
    // receiver's clock says; the satellite's clock error takes it to GPS time.
    let ranging = observations.iter().filter(|o| plausible_range(o).is_some());
    let first = ranging.clone().min_by_key(|o| o.signal.band.digit)?;
    let by_satellite_clock = epoch.time + -plausible_range(first)? / SPEED_OF_LIGHT_MPS;
    let (state, broadcast) = store.at_transmission(satellite, by_satellite_clock).ok()?;

    let group_delay_m = |signal| broadcast.and_then(|record| record.group_delay_m(signal));
    let code = |observation: &Observation, delay_m: f64| {
        Some(Code {
            pseudorange_m: plausible_range(observation)? - delay_m,
            band: observation.signal.band,
            frequency_hz: observation.signal.band.frequency_hz(channel)?,
            cn0_dbhz: observation.cn0_dbhz,
        })
    };
    let lowest = code(first, group_delay_m(first.signal).unwrap_or(0.0))?;
    // A second band serves only if its delay against the first is known.
    let second = group_delay_m(first.signal).and_then(|_| {
        let others = ranging.filter(|o| o.signal.band != first.signal.band);
        let known = others.filter_map(|o| code(o, group_delay_m(o.signal)?));
        known.min_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz))
    });
    let range_rate_mps = observations
        .iter()
        .find_map(|o| Some(-o.doppler_hz? * o.signal.band.wavelength_m(channel)?));
    Some(Tracked { satellite, state, code: lowest, second, range_rate_mps })
}
