//! The bound of Cramér and Rao for an attitude from carrier phases with known integers.

use std::collections::BTreeMap;

use kurs::attitude::angles::angle_covariance;
use kurs::engine::Constraint;
use kurs::frames::{Geodetic, skew};
use kurs::signal::{Satellite, Signal};
use kurs::sky::View;
use kurs::solution::EpochSolution;
use kurs_sim::scenario::{Law, Scenario};
use kurs_sim::simulation::{Attachments, BodyTruth, Simulation};
use nalgebra::{Matrix3, Vector3};

use crate::solving::{self, Tally, settings};

/// Solves a body that stands still: what it came to, and root mean square errors of heading, pitch
/// and roll over their mean bound.
pub(crate) fn laid_against(scenario: Scenario) -> (Tally, Vector3<f64>) {
    let simulation = Simulation::new(scenario.clone(), &Attachments::default()).unwrap();
    let known = settings(&scenario, Constraint::Array);
    let (mut tally, mut bounds) = (Tally::default(), Vector3::zeros());
    solving::solve(scenario, known, |truth, row, integers| {
        tally.add(truth, row, integers);
        bounds += angles(&simulation, truth, row).diagonal();
    });
    let bound_deg = bounds.map(|sum| (sum / tally.epochs as f64).sqrt().to_degrees());
    (tally, tally.rms_deg().component_div(&bound_deg))
}

/// Covariance of heading, pitch and roll, rad², that no unbiased estimator can be better than, with
/// the phases that `row` used.
///
/// All antennas see the same satellites with the same noise; each receiver has a clock and each
/// satellite a delay for every signal. With the antennas `p` about their centre `p̄` and the lines of
/// sight `u` about their weighted mean `ū`, the information of a turn `θ` in body axes is
///
/// ```text
/// I = Σ_signals Σᵢ [pᵢ − p̄]×ᵀ Qᵀ N Q [pᵢ − p̄]×,    N = Σₛ (uₛ − ū)(uₛ − ū)ᵀ / σₛ²
/// ```
fn angles(simulation: &Simulation, truth: &BodyTruth, row: &EpochSolution) -> Matrix3<f64> {
    let ned_from_body = truth.attitude.ned_from_body().matrix();
    let antennas: Vec<Vector3<f64>> =
        simulation.scenario().body[0].antenna.iter().map(|a| a.position_m.into()).collect();
    let centre = antennas.iter().sum::<Vector3<f64>>() / antennas.len() as f64;
    let mut information = Matrix3::zeros();
    for sights in lines_of_sight(simulation, truth, row).values() {
        let total: f64 = sights.iter().map(|(_, w)| w).sum();
        let mean = sights.iter().map(|(u, w)| u * *w).sum::<Vector3<f64>>() / total;
        let normal: Matrix3<f64> =
            sights.iter().map(|(u, w)| (u - mean) * (u - mean).transpose() * *w).sum();
        for antenna in &antennas {
            let turned = ned_from_body * skew(&(antenna - centre));
            information += turned.transpose() * normal * turned;
        }
    }
    angle_covariance(&truth.attitude, &information.try_inverse().unwrap())
}

/// For every signal the lines of sight (north-east-down) of the phases used, with their weights,
/// 1/m².
fn lines_of_sight(
    simulation: &Simulation,
    truth: &BodyTruth,
    row: &EpochSolution,
) -> BTreeMap<Signal, Vec<(Vector3<f64>, f64)>> {
    let ned_from_ecef = Geodetic::from_ecef(truth.position_m).ned_from_ecef();
    let store = &simulation.navigation().ephemerides;
    let mut sights: BTreeMap<Signal, Vec<_>> = BTreeMap::new();
    let residuals = row.residuals().iter();
    for used in residuals.filter(|r| r.antenna == 0 && r.phase_m.is_some()) {
        let state = store.state(used.satellite, truth.time).unwrap();
        let line = (ned_from_ecef * View::new(&state, truth.position_m).line_of_sight).xyz();
        let sigma_m = phase_sd_m(simulation, used.satellite, used.signal, -line.z);
        sights.entry(used.signal).or_default().push((line, sigma_m.powi(-2)));
    }
    sights
}

/// What the scenario says of the noise of a phase.
fn phase_sd_m(
    simulation: &Simulation,
    satellite: Satellite,
    signal: Signal,
    sin_elevation: f64,
) -> f64 {
    let noise = &simulation.scenario().noise;
    let growth = match noise.law {
        Law::Elevation => (1.0 / sin_elevation).min(3.5),
        Law::Mixed => (0.5 * (1.0 + sin_elevation.powi(-2))).sqrt(),
        other => panic!("{other:?} has no bound here"),
    };
    let channel = simulation.navigation().ephemerides.glonass_channel(satellite);
    noise.phase_sd_cycles * growth * signal.band.wavelength_m(channel).unwrap()
}
