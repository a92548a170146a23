//! The satellites of one antenna's epoch, each with its state at the instant of transmission.

use crate::ephemeris::{
    NavigationData, SatelliteState, Transmission, Transmissions, precise_clock_signals,
};
use crate::observation::{AntennaEpoch, Observation};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite, System};

/// A satellite that an antenna observes and whose ephemeris is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tracked {
    /// The satellite.
    pub satellite: Satellite,
    /// Its state when it sent what the antenna now receives.
    pub state: SatelliteState,
    /// The code observation of its lowest band whose group delay is known, free of it; of the lowest
    /// band if none is.
    pub code: Code,
    /// That of a second band, whose difference tells the ionosphere.
    pub second: Option<Code>,
    /// How well the group delays of its codes are known, m: zero if the broadcast record tells
    /// them, else their spread from one satellite of the system to the next.
    pub delay_sd_m: f64,
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
    track_sent(epoch, &mut Transmissions::of(&navigation.ephemerides), wanted, tracked)
}

/// As [`track`], for one of several antennas of an epoch: each satellite that one of them hears is evaluated once.
pub fn track_sent(
    epoch: &AntennaEpoch,
    sent: &mut Transmissions<'_>,
    wanted: impl Fn(System) -> bool,
    tracked: &mut Vec<Tracked>,
) -> usize {
    tracked.clear();
    let mut without_ephemeris = 0;
    for observations in epoch.observations.chunk_by(|a, b| a.satellite == b.satellite) {
        let satellite = observations[0].satellite;
        if !wanted(satellite.system) || !observations.iter().any(|o| o.plausible_range().is_some())
        {
            continue;
        }
        if tracked.iter().any(|t| t.satellite == satellite) {
            continue;
        }
        match tracked_satellite(epoch, sent, satellite, observations) {
            Some(found) => tracked.push(found),
            None => without_ephemeris += 1,
        }
    }
    without_ephemeris
}

fn tracked_satellite(
    epoch: &AntennaEpoch,
    sent: &mut Transmissions<'_>,
    satellite: Satellite,
    observations: &[Observation],
) -> Option<Tracked> {
    let channel = sent.store().glonass_channel(satellite);

    // The receiver's tag minus P / c is the satellite's own clock at transmission, whatever the
    // receiver's clock says; the satellite's clock error takes it to GPS time.
    let ranging = observations.iter().filter(|o| o.plausible_range().is_some());
    let first = ranging.clone().min_by_key(|o| o.signal.band.digit)?;
    let by_satellite_clock = epoch.time + -first.plausible_range()? / SPEED_OF_LIGHT_MPS;
    let sent = sent.at(satellite, by_satellite_clock).ok()?;

    let code = |observation: &Observation, delay_m: f64| {
        Some(Code {
            pseudorange_m: observation.plausible_range()? - delay_m,
            band: observation.signal.band,
            frequency_hz: observation.signal.band.frequency_hz(channel)?,
            cn0_dbhz: observation.cn0_dbhz,
        })
    };
    let healthy = ranging.clone().filter(|o| sent.is_healthy(o.signal));
    let known = healthy.filter_map(|o| code(o, sent.group_delay_m(o.signal)?));
    let (lowest, second, delay_sd_m) = match known.clone().min_by_key(|code| code.band.digit) {
        Some(lowest) => {
            let others = known.filter(|code| code.band != lowest.band);
            (lowest, others.min_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz)), 0.0)
        }
        None => {
            let of_clock = |place| ranging.clone().find(|o| is_of_clock(&sent, o, place));
            let (lowest, second) = match (of_clock(0), of_clock(1)) {
                (Some(one), Some(other)) => (one, Some(other)),
                _ => (first, None),
            };
            let second = second.and_then(|observation| code(observation, 0.0));
            (code(lowest, 0.0)?, second, unknown_delay_sd_m(satellite.system))
        }
    };
    let range_rate_mps = observations
        .iter()
        .find_map(|o| Some(-o.doppler_hz? * o.signal.band.wavelength_m(channel)?));
    Some(Tracked { satellite, state: sent.state, code: lowest, second, delay_sd_m, range_rate_mps })
}

/// Whether the observation is on the first or second band of the combination that the clock of a
/// precise orbit refers to. The group delays of these two act like an ionosphere, and go with it.
fn is_of_clock(sent: &Transmission<'_>, observation: &Observation, place: usize) -> bool {
    let pair = precise_clock_signals(observation.satellite.system);
    sent.is_precise && pair.is_some_and(|pair| pair[place].band == observation.signal.band)
}

/// How much group delays differ from satellite to satellite, m: RMS of the broadcast ones of
/// 2023-03-12, on the lowest band (GPS 2.1, Galileo 1.4, BeiDou 9.3 against a precise clock).
const fn unknown_delay_sd_m(system: System) -> f64 {
    match system {
        System::BeiDou => 9.0,
        _ => 2.0,
    }
}
