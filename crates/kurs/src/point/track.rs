//! The satellites of one antenna's epoch, each with its state at the instant of transmission.

use crate::ephemeris::{NavigationData, SatelliteState};
use crate::observation::{AntennaEpoch, Observation};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite};

/// A satellite that an antenna observes and whose ephemeris is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    /// The satellite.
    pub satellite: Satellite,
    /// Its state when it sent what the antenna now receives.
    pub state: SatelliteState,
    /// The code observation that the position uses.
    pub pseudorange_m: f64,
    /// Its band.
    pub band: Band,
    /// Carrier frequency of that band, Hz.
    pub frequency_hz: f64,
    /// Its carrier-to-noise density ratio, dB-Hz.
    pub cn0_dbhz: Option<f64>,
    /// Range rate from a Doppler shift, −λ D, m/s.
    pub range_rate_mps: Option<f64>,
}

/// Pseudoranges outside these bounds are no signal of a navigation satellite, whatever the
/// receiver's clock (GEO: 42 000 km; clocks are kept within some milliseconds).
const PLAUSIBLE_RANGE_M: core::ops::Range<f64> = 1e6..1e8;

/// Finds the satellites of an epoch, with one pseudorange each: the first of the wanted bands in
/// the order of their digits. Returns how many satellites had a pseudorange but no ephemeris.
///
/// Observations of one satellite stand together in every format; a satellite that comes a second
/// time is ignored. `tracked` is cleared and filled.
pub fn track(
    epoch: &AntennaEpoch,
    navigation: &NavigationData,
    wanted: impl Fn(Band) -> bool,
    tracked: &mut Vec<Tracked>,
) -> usize {
    tracked.clear();
    let mut without_ephemeris = 0;
    for observations in epoch.observations.chunk_by(|a, b| a.satellite == b.satellite) {
        let satellite = observations[0].satellite;
        let ranging = observations
            .iter()
            .filter(|o| wanted(o.signal.band) && plausible_range(o).is_some())
            .min_by_key(|o| o.signal.band.digit);
        let Some(observation) = ranging else { continue };
        if tracked.iter().any(|t| t.satellite == satellite) {
            continue;
        }
        match tracked_satellite(epoch, navigation, observation, observations) {
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
    ranging: &Observation,
    all: &[Observation],
) -> Option<Tracked> {
    let satellite = ranging.satellite;
    let pseudorange_m = plausible_range(ranging)?;
    let store = &navigation.ephemerides;
    let channel = store.glonass_channel(satellite);
    let frequency_hz = ranging.signal.band.frequency_hz(channel)?;

    // The receiver's tag minus P / c is the satellite's own clock at transmission, whatever the
    // receiver's clock says; the satellite's clock error takes it to GPS time.
    let by_satellite_clock = epoch.time + -pseudorange_m / SPEED_OF_LIGHT_MPS;
    let (state, broadcast) = store.at_transmission(satellite, by_satellite_clock).ok()?;

    let group_delay_m = broadcast.and_then(|b| b.group_delay_m(ranging.signal)).unwrap_or(0.0);
    let range_rate_mps =
        all.iter().find_map(|o| Some(-o.doppler_hz? * o.signal.band.wavelength_m(channel)?));
    Some(Tracked {
        satellite,
        state,
        pseudorange_m: pseudorange_m - group_delay_m,
        band: ranging.signal.band,
        frequency_hz,
        cn0_dbhz: ranging.cn0_dbhz,
        range_rate_mps,
    })
}
