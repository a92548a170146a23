//! Which satellites a simulated body sees, and how high.

use kurs::frames::Geodetic;
use kurs::signal::{Satellite, System};
use kurs_sim::noise::Noise;
use kurs_sim::scenario::{Outage, Scenario};
use kurs_sim::simulation::{Attachments, BodyTruth, SimulatedEpoch, Simulation};

/// Satellites below are not chosen.
const MIN_ELEVATION_RAD: f64 = 0.26;
/// User of the seed.
const CHOICE: u64 = 7;

/// Elevation of a satellite above a body.
pub(crate) fn elevation_rad(
    simulation: &Simulation,
    truth: &BodyTruth,
    satellite: Satellite,
) -> f64 {
    let store = &simulation.navigation().ephemerides;
    let state = store.state(satellite, truth.time).unwrap();
    let to_ned = Geodetic::from_ecef(truth.position_m).ned_from_ecef();
    let sight = (to_ned * (state.position_m - truth.position_m)).direction().xyz();
    (-sight.z).asin()
}

/// Satellites of a scenario that its first antenna sees above 15° at the start, in random order.
pub(crate) fn satellites(scenario: &Scenario) -> Vec<Satellite> {
    let mut simulation = Simulation::new(scenario.clone(), &Attachments::default()).unwrap();
    let mut epoch = SimulatedEpoch::default();
    assert!(simulation.next_epoch(&mut epoch));
    let body = &epoch.bodies[0];
    let observed = body.observed.antennas[0].as_ref().unwrap();
    let mut all: Vec<Satellite> = observed.observations.iter().map(|o| o.satellite).collect();
    all.dedup();
    all.retain(|s| elevation_rad(&simulation, &body.truth, *s) > MIN_ELEVATION_RAD);
    let mut noise = Noise::stream(scenario.seed, CHOICE);
    let mut drawn: Vec<_> = all.into_iter().map(|satellite| (noise.uniform(), satellite)).collect();
    drawn.sort_by(|a, b| a.0.total_cmp(&b.0));
    drawn.into_iter().map(|(_, satellite)| satellite).collect()
}

/// Hides all but so many satellites of each system, drawn at random.
pub(crate) fn leave_only(scenario: &mut Scenario, counts: &[(System, usize)]) {
    let mut left: Vec<(System, usize)> = counts.to_vec();
    let visible = satellites(scenario);
    let is_hidden = |satellite: &Satellite| {
        let count = left.iter_mut().find(|(system, _)| *system == satellite.system);
        count.is_none_or(|(_, count)| core::mem::replace(count, count.saturating_sub(1)) == 0)
    };
    let low = all_satellites(scenario).into_iter().filter(|s| !visible.contains(s));
    let hidden: Vec<Satellite> = low.chain(visible.iter().copied().filter(is_hidden)).collect();
    scenario.outage.push(Outage {
        from_s: 0.0,
        to_s: scenario.duration_s + 1.0,
        antennas: Vec::new(),
        satellites: hidden.iter().map(Satellite::to_string).collect(),
        bands: Vec::new(),
    });
}

fn all_satellites(scenario: &Scenario) -> Vec<Satellite> {
    let simulation = Simulation::new(scenario.clone(), &Attachments::default()).unwrap();
    let mut all: Vec<Satellite> =
        simulation.navigation().ephemerides.iter().map(|record| record.satellite()).collect();
    all.dedup();
    all
}
