//! How far the phases of simulated links are from what geometry, clocks and whole cycles make them, by
//! how much weaker one antenna receives than the other. No estimator has a part in it.

use std::collections::BTreeMap;

use kurs::signal::{Satellite, Signal};
use kurs_sim::scenario::{Law, Scenario};
use kurs_sim::simulation::{Attachments, BodyEpoch, SimulatedEpoch, Simulation};

use crate::solving::sky::elevation_rad;

/// A phase is off if it is by more than this against another antenna's, cycles.
const OFF_CYCLES: f64 = 0.15;
/// Satellites below are not counted, degrees.
const MASK_DEG: f64 = 15.0;
/// Lower ends of the classes of C/N0 differences, dB.
pub(crate) const CLASSES_DB: [f64; 7] = [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0];
/// Share of the links that are off in each of them where single satellites stand behind an edge at one
/// antenna, as recorded (`docs/experiments/real-skies.md`).
pub(crate) const RECORDED: [f64; 7] = [0.0, 0.002, 0.022, 0.20, 0.39, 0.62, 0.75];

/// Links in each class of C/N0 differences.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Links {
    pub(crate) all: [usize; 7],
    pub(crate) off: [usize; 7],
}

impl Links {
    /// The links of the first body of a scenario with its first antenna.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        let mut of_pairs: BTreeMap<usize, Vec<Link>> = BTreeMap::new();
        let mut with = Phases::of(scenario.clone());
        let mut without = Phases::of(undisturbed(scenario.clone()));
        while let (Some(with), Some(without)) = (with.next(), without.next()) {
            for antenna in 1..with.len() {
                for key in with[antenna].keys() {
                    if let Some(link) = Link::between(antenna, key, &with, &without) {
                        of_pairs.entry(antenna).or_default().push(link);
                    }
                }
            }
        }
        let mut links = Self::default();
        of_pairs.into_values().for_each(|of_pair| links.take(of_pair));
        links
    }

    /// Links between two antennas: C/N0 differences against what this pair usually shows.
    fn take(&mut self, mut links: Vec<Link>) {
        links.sort_by(|a, b| a.weaker_db.total_cmp(&b.weaker_db));
        let usual_db = links[links.len() / 2].weaker_db;
        for Link { weaker_db, late_cycles } in links {
            let difference_db = (weaker_db - usual_db).abs();
            let class = CLASSES_DB.iter().rposition(|low| difference_db >= *low).unwrap_or(0);
            self.all[class] += 1;
            self.off[class] += usize::from((late_cycles - late_cycles.round()).abs() > OFF_CYCLES);
        }
    }

    /// Adds others.
    pub(crate) fn add(&mut self, others: &Self) {
        for class in 0..CLASSES_DB.len() {
            self.all[class] += others.all[class];
            self.off[class] += others.off[class];
        }
    }

    /// Share of the links of a class that are off.
    pub(crate) fn share(&self, class: usize) -> f64 {
        self.off[class] as f64 / self.all[class].max(1) as f64
    }
}

/// One satellite's signal at an antenna against the first one.
#[derive(Debug, Clone, Copy)]
struct Link {
    weaker_db: f64,
    late_cycles: f64,
}

impl Link {
    fn between(
        antenna: usize,
        key: &(Satellite, Signal),
        with: &[AntennaPhases],
        without: &[AntennaPhases],
    ) -> Option<Self> {
        let [one, first] = [antenna, 0].map(|k| Some((with[k].get(key)?, without[k].get(key)?)));
        let ((one, one_alone), (first, first_alone)) = (one?, first?);
        (one.elevation_deg >= MASK_DEG).then_some(Self {
            weaker_db: one.cn0_dbhz - first.cn0_dbhz,
            late_cycles: (one.cycles - one_alone.cycles) - (first.cycles - first_alone.cycles),
        })
    }
}

/// The same receivers and clocks without noise, reflections or anything in the way.
fn undisturbed(mut scenario: Scenario) -> Scenario {
    scenario.noise.law = Law::Flat;
    scenario.noise.code_sd_m = 0.0;
    scenario.noise.phase_sd_cycles = 0.0;
    scenario.noise.tracking_dbhz = 0.0;
    (scenario.multipath.code_sd_m, scenario.multipath.phase_sd_m) = (0.0, 0.0);
    scenario.wall.clear();
    scenario.canopy.clear();
    scenario
}

/// Phases of an antenna less their whole cycles.
type AntennaPhases = BTreeMap<(Satellite, Signal), Phase>;

#[derive(Debug, Clone, Copy)]
struct Phase {
    cycles: f64,
    cn0_dbhz: f64,
    elevation_deg: f64,
}

/// A simulation with the whole cycles that hold.
struct Phases {
    simulation: Simulation,
    epoch: SimulatedEpoch,
    cycles: BTreeMap<(String, Satellite, Signal), i64>,
}

impl Phases {
    fn of(scenario: Scenario) -> Self {
        let simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
        Self { simulation, epoch: SimulatedEpoch::default(), cycles: BTreeMap::new() }
    }

    /// For every antenna of the first body.
    fn next(&mut self) -> Option<Vec<AntennaPhases>> {
        if !self.simulation.next_epoch(&mut self.epoch) {
            return None;
        }
        for change in &self.epoch.changes {
            let key = (change.antenna.clone(), change.satellite, change.signal);
            self.cycles.insert(key, change.cycles);
        }
        let antennas = 0..self.simulation.scenario().body[0].antenna.len();
        Some(antennas.map(|antenna| self.antenna(&self.epoch.bodies[0], antenna)).collect())
    }

    fn antenna(&self, body: &BodyEpoch, antenna: usize) -> AntennaPhases {
        let name = &self.simulation.scenario().body[0].antenna[antenna].name;
        let observed = body.observed.antennas[antenna].as_ref().unwrap();
        let phase = |satellite, signal, phase_cycles: f64, cn0_dbhz| {
            let whole = self.cycles[&(name.clone(), satellite, signal)];
            let elevation_deg =
                elevation_rad(&self.simulation, &body.truth, satellite).to_degrees();
            Phase { cycles: phase_cycles - whole as f64, cn0_dbhz, elevation_deg }
        };
        let observations = observed.observations.iter();
        let of = |o: &kurs::observation::Observation| {
            let phase = phase(o.satellite, o.signal, o.phase_cycles.unwrap(), o.cn0_dbhz.unwrap());
            ((o.satellite, o.signal), phase)
        };
        observations.map(of).collect()
    }
}
