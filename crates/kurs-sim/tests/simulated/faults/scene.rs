//! A car with four antennas, none a mirror image of another, whose observations are spoilt before
//! the engine sees them.

use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::frames::{Vector, enu_from_ned};
use kurs::observation::ArrayEpoch;
use kurs::solution::EpochSolution;
use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, BodyEpoch, SimulatedEpoch, Simulation};
use nalgebra::Vector3;

/// Forward, right, down, m: three unequal baselines and no symmetry.
pub(crate) const PLACES_M: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.10, 0.10, -0.05], [-0.20, -0.70, 0.10], [0.35, 0.85, -0.15]];

const SCENARIO: &str = r#"
seed = 11
start = "2024-03-10T12:00:00"
duration_s = 60.0
interval_s = 0.1
signals = ["G1C", "E1C"]

[sky]
systems = ["G", "E"]

[multipath]
code_sd_m = 0.3
phase_sd_m = 0.001
correlation_s = 20.0

[[body]]
name = "car"

[body.motion]
kind = "car"
place = { latitude_deg = 55.75, longitude_deg = 37.62, height_m = 200.0 }
waypoints_m = [[0, 0], [0, 60], [50, 60], [50, 10], [90, 10], [90, 120], [20, 120], [20, 0], [300, 0], [300, 300]]
speed_mps = 8.0
wait_s = 3.0
"#;

/// Everything of one run.
pub(crate) struct Scene {
    pub(crate) simulation: Simulation,
    pub(crate) settings: Settings,
}

impl Scene {
    /// Of the first `antennas` places, with changes of the scenario.
    pub(crate) fn new(antennas: usize, change: impl Fn(&mut Scenario)) -> Self {
        let mut text = SCENARIO.to_owned();
        for (index, [x, y, z]) in PLACES_M.iter().take(antennas).enumerate() {
            text += &format!(
                "[[body.antenna]]\nname = \"A{index}\"\nposition_m = [{x:?}, {y:?}, {z:?}]\n"
            );
        }
        let mut scenario: Scenario = toml::from_str(&text).unwrap();
        change(&mut scenario);
        let simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
        let settings = Settings {
            antennas,
            array: Some(array(&PLACES_M[..antennas])),
            constraint: Constraint::Array,
            ..Settings::default()
        };
        Self { simulation, settings }
    }

    /// Solves every epoch as `spoil` leaves it (`None`: the epoch never arrives; several: all of
    /// them, in this order), and tells each row with the truth of its time and seconds from start.
    pub(crate) fn run(
        mut self,
        mut spoil: impl FnMut(f64, ArrayEpoch) -> Vec<ArrayEpoch>,
        mut tell: impl FnMut(f64, &EpochSolution, Outcome),
    ) {
        let mut engine = Engine::new(self.settings, self.simulation.navigation().clone()).unwrap();
        let mut epoch = SimulatedEpoch::default();
        let mut truths: Vec<BodyEpoch> = Vec::new();
        let mut start = None;
        while self.simulation.next_epoch(&mut epoch) {
            truths.push(epoch.bodies[0].clone());
            let time = truths[truths.len() - 1].observed.time;
            let since_s = time - *start.get_or_insert(time);
            for observed in spoil(since_s, epoch.bodies[0].observed.clone()) {
                let row = engine.push(&observed);
                let near = |t: &&BodyEpoch| (t.observed.time - row.time).abs() < 0.05;
                let truth = truths.iter().find(near).unwrap();
                let at_s = row.time - start.unwrap();
                tell(at_s, &row, Outcome::of(&row, truth));
            }
        }
    }
}

pub(crate) fn array(places_m: &[[f64; 3]]) -> AntennaArray {
    AntennaArray::new(places_m.iter().map(|p| Vector::from_xyz(Vector3::from(*p))).collect())
        .unwrap()
}

/// What a row is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    Right,
    /// `fixed`, but a baseline is off by more than 5 cm and five standard deviations, as on recordings.
    Wrong,
    NotFixed,
}

impl Outcome {
    fn of(row: &EpochSolution, truth: &BodyEpoch) -> Self {
        if !row.is_fixed() {
            return Self::NotFixed;
        }
        let from = |b: usize| {
            if b == 0 { Vector::new(0.0, 0.0, 0.0) } else { truth.truth.baselines_m[b - 1] }
        };
        let off = row.baselines.iter().any(|baseline| {
            let expected = enu_from_ned() * (from(baseline.rover) - from(baseline.base));
            let error = (baseline.baseline_m - expected).xyz();
            (0..3).any(|axis| {
                let sd_m = baseline.covariance_m2[(axis, axis)].sqrt();
                error[axis].abs() > (5.0 * sd_m).max(0.05)
            })
        });
        if off { Self::Wrong } else { Self::Right }
    }
}
