//! From the observations of the antenna on the arm to the ranges that the filter takes.

use super::ranging::{Measured, Ranging, SatelliteMotion};
use crate::atmosphere::{Troposphere, ionosphere_m};
use crate::ephemeris::NavigationData;
use crate::frames::{EARTH_RATE_RADPS, Ecef, Vector};
use crate::observation::{AntennaEpoch, Observation};
use crate::point::Tracked;
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::sky::{Horizon, View};

/// Which satellites are taken and how noisy their measurements are, 1 σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceptionSettings {
    /// Satellites below are left out.
    pub elevation_mask_rad: f64,
    /// Of a pseudorange.
    pub pseudorange_sd_m: f64,
    /// Of a range rate.
    pub range_rate_sd_mps: f64,
    /// Of a carrier phase, m; `None` leaves phases out.
    pub phase_sd_m: Option<f64>,
}

/// Fills `ranges` with the tracked satellites above the mask as an antenna near `antenna_m` (ECEF,
/// m) sees them: freed of satellite clock and atmosphere, the satellites turned to where they stand
/// in the axes of the instant of reception.
pub fn ranges(
    epoch: &AntennaEpoch,
    tracked: &[Tracked],
    antenna_m: Vector<Ecef>,
    navigation: &NavigationData,
    settings: &ReceptionSettings,
    ranges: &mut Vec<Ranging>,
) {
    ranges.clear();
    let horizon = Horizon::at(antenna_m);
    let lowest = horizon.lowest_elevation_rad(settings.elevation_mask_rad).sin();
    let troposphere = Troposphere::above(&horizon.geodetic);
    for satellite in tracked {
        let view = View::new(&satellite.state, antenna_m);
        let direction = horizon.direction(view.line_of_sight);
        if direction.sin_elevation() < lowest {
            continue;
        }
        let code = &satellite.code;
        let (here, frequency_hz) = (&horizon.geodetic, code.frequency_hz);
        let ionosphere_m =
            ionosphere_m(&navigation.ionosphere, here, &direction, epoch.time, frequency_hz);
        let clock_m = satellite.state.clock_s * SPEED_OF_LIGHT_MPS;
        let drift_mps = satellite.state.clock_drift * SPEED_OF_LIGHT_MPS;
        let common_m = clock_m - troposphere.delay_m(direction.sin_elevation());
        let phase = settings.phase_sd_m.and_then(|sd| {
            let observation = carrier(epoch, satellite)?;
            let phase_m = observation.phase_cycles? * SPEED_OF_LIGHT_MPS / frequency_hz;
            let half_cycle = observation.lock.half_cycle_unresolved();
            let slipped = observation.lock.slipped() || epoch.power_failure || half_cycle;
            Some((Measured { value: phase_m + common_m + ionosphere_m, sd }, slipped))
        });
        ranges.push(Ranging {
            satellite: satellite.satellite,
            motion: motion(&view),
            pseudorange_m: Some(Measured {
                value: code.pseudorange_m + common_m - ionosphere_m,
                sd: settings.pseudorange_sd_m,
            }),
            range_rate_mps: satellite.range_rate_mps.map(|rate_mps| Measured {
                value: rate_mps + drift_mps,
                sd: settings.range_rate_sd_mps,
            }),
            phase_m: phase.map(|(measured, _)| measured),
            slipped: phase.is_some_and(|(_, slipped)| slipped),
        });
    }
}

/// The observation whose code is the satellite's.
fn carrier<'a>(epoch: &'a AntennaEpoch, satellite: &Tracked) -> Option<&'a Observation> {
    let of_satellite = epoch.observations.iter().filter(|o| o.satellite == satellite.satellite);
    of_satellite.filter(|o| o.signal.band == satellite.code.band).find(|o| o.phase_cycles.is_some())
}

/// The satellite's motion such that the range rate is e·(v − ṡ): its velocity at transmission, and
/// the change of the travel time, which is part of the range rate too (below 3 mm/s).
///
/// `ρ̇ = u·(R vₛ)(1 − τ̇) + Ω (uₓ s_y − u_y sₓ) τ̇ − u·v`, `τ̇ = ρ̇ / c`, u from antenna to satellite.
fn motion(view: &View) -> SatelliteMotion {
    let (s, u) = (view.satellite_m.xyz(), view.line_of_sight.xyz());
    let velocity_mps = view.velocity_mps.xyz();
    let radial_mps = u.dot(&velocity_mps);
    let turning_mps = EARTH_RATE_RADPS * (u.x * s.y - u.y * s.x);
    let along_mps = radial_mps * (turning_mps - radial_mps) / SPEED_OF_LIGHT_MPS;
    SatelliteMotion { position_m: s, velocity_mps: velocity_mps + u * along_mps }
}
