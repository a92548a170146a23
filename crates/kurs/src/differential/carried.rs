//! A station's epoch carried to a later instant.

use crate::ephemeris::{EphemerisStore, NavigationData};
use crate::frames::{Ecef, Vector};
use crate::observation::{AntennaEpoch, Observation};
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite};
use crate::sky::View;
use crate::time::GpsTime;

/// The instant of transmission follows from the pseudorange that is looked for. Each round makes its error smaller
/// by range rate over c, 3·10⁻⁶: of 10 km in 10 s nothing is left after three.
const ROUNDS: usize = 3;

/// What the station would have observed at `time`: code and phase change with its distance from the
/// satellite and with the satellite's clock, as broadcast; its own clock, which is the same for all
/// satellites, does not. Satellites without ephemeris or pseudorange are left out.
pub(super) fn carried(
    observed: &AntennaEpoch,
    time: GpsTime,
    station_m: Vector<Ecef>,
    navigation: &NavigationData,
) -> AntennaEpoch {
    let store = &navigation.ephemerides;
    let mut observations = Vec::with_capacity(observed.observations.len());
    for of_satellite in observed.observations.chunk_by(|a, b| a.satellite == b.satellite) {
        let Some(first) = of_satellite.first() else { continue };
        let range_m = of_satellite.iter().find_map(|o| o.pseudorange_m);
        let way = Way { store, satellite: first.satellite, station_m };
        let change_m = range_m.and_then(|range_m| way.change_m(observed.time, time, range_m));
        let Some(change_m) = change_m else { continue };
        let channel = store.glonass_channel(first.satellite);
        observations.extend(of_satellite.iter().map(|o| {
            Observation {
                pseudorange_m: o.pseudorange_m.map(|range_m| range_m + change_m),
                phase_cycles: o
                    .phase_cycles
                    .zip(o.signal.band.wavelength_m(channel))
                    .map(|(phase_cycles, wavelength_m)| phase_cycles + change_m / wavelength_m),
                ..*o
            }
        }));
    }
    AntennaEpoch { time, observations, ..*observed }
}

/// From a satellite to the station.
struct Way<'a> {
    store: &'a EphemerisStore,
    satellite: Satellite,
    station_m: Vector<Ecef>,
}

impl Way<'_> {
    /// How much longer the pseudorange is at `to` than at `from`, where it was observed, m.
    fn change_m(&self, from: GpsTime, to: GpsTime, observed_m: f64) -> Option<f64> {
        let before_m = self.range_m(from, observed_m)?;
        let mut change_m = 0.0;
        for _ in 0..ROUNDS {
            change_m = self.range_m(to, observed_m + change_m)? - before_m;
        }
        Some(change_m)
    }

    /// Distance less satellite clock at the instant of transmission that a pseudorange tells, m.
    fn range_m(&self, tag: GpsTime, pseudorange_m: f64) -> Option<f64> {
        let by_satellite_clock = tag + -pseudorange_m / SPEED_OF_LIGHT_MPS;
        let sent = self.store.at_transmission(self.satellite, by_satellite_clock).ok()?;
        let distance_m = View::new(&sent.state, self.station_m).range_m;
        Some(distance_m - SPEED_OF_LIGHT_MPS * sent.state.clock_s)
    }
}
