//! The rotating-arm filter: h and H of the published and the corrected model, and one full step
//! (prediction, gates, update, adaptive noise) of each filter.

use kurs::frames::EARTH_RATE_RADPS;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::as_published::filter::PublishedFilter;
use kurs::fusion::arm::as_published::model as published_model;
use kurs::fusion::arm::attitude_form::Carried;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter, ArmFilterSettings, Start};
use kurs::fusion::arm::gradient::Prediction;
use kurs::fusion::arm::layout::{Layout, PAPER_STATES};
use kurs::fusion::arm::model::ArmEnd;
use kurs::fusion::arm::nhe::Angles;
use kurs::fusion::arm::process_noise::ProcessNoise;
use kurs::fusion::arm::ranging::{Measured, Ranging, SatelliteMotion};
use kurs::fusion::earth::local_level::LocalLevel;
use kurs::fusion::kalman::Gate;
use kurs::signal::{Satellite, System};
use nalgebra::{DMatrix, Vector3};
use serde_json::Value;

use crate::case::{Outcome, matrix, matrix3, number, numbers, vector3};

/// Noise of the steps: σ_D² = 10 m², σ_Ḋ² = 0.01 (m/s)²; σ_n² = 1e-4 (m/s²)² is the filters' own.
const PSEUDORANGE_VARIANCE_M2: f64 = 10.0;
const RANGE_RATE_SD_MPS: f64 = 0.1;

pub(crate) fn check(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    check_models(case, outcome)?;
    if case.get("step_paper").is_some() {
        check_published_step(case, outcome)?;
    }
    if case.get("step_full").is_some() {
        check_corrected_step(case, outcome)?;
    }
    Ok(())
}

fn check_models(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let x = numbers(&case["x"])?;
    let layout = Layout::new(false, false, false, 0);
    let here = LocalLevel::at(&Vector3::new(x[0], x[1], x[2]));
    outcome.compare("gravity", (here.gravity_mps2 - number(&case["gamma"])?).abs(), 1e-9);
    outcome.compare("T_EN", (here.nhe_from_ecef - matrix3(&case["T_EN"])?).norm(), 1e-12);
    let angles = Angles { roll_rad: x[11], pitch_rad: x[12], heading_rad: x[13] };
    outcome.compare("T_BN", (angles.nhe_from_body() - matrix3(&case["T_BN"])?).norm(), 1e-12);

    let arm = arm(case)?;
    let on_arm = arm.at_angle(arm.angle_rad(number(&case["t"])?));
    let satellites = satellites(case)?;
    let decoded = Carried::Euler.decode(&x, &layout, &here);
    let motion = &decoded.motion;
    let end = ArmEnd::new(motion, &on_arm);
    let earth_rate = match case["par"]["coriolis"].as_bool() {
        Some(false) => 0.0,
        _ => EARTH_RATE_RADPS,
    };
    let mut published: Vec<Prediction> = Vec::new();
    published.extend(satellites.iter().map(|s| published_model::pseudorange(motion, s)));
    published.extend(satellites.iter().map(|s| published_model::range_rate(motion, s)));
    published.extend(published_model::specific_force(motion, &on_arm));
    let mut corrected: Vec<Prediction> = Vec::new();
    corrected.extend(satellites.iter().map(|s| end.pseudorange(s)));
    corrected.extend(satellites.iter().map(|s| end.range_rate(s)));
    corrected.extend(end.specific_force(&here, earth_rate));

    let rows = |predictions: &[Prediction]| {
        let mut h = DMatrix::zeros(predictions.len(), PAPER_STATES);
        for (k, prediction) in predictions.iter().enumerate() {
            let mut row = [0.0; PAPER_STATES];
            decoded.write_row(&prediction.gradient, &layout, &mut row);
            row.iter().enumerate().for_each(|(column, value)| h[(k, column)] = *value);
        }
        h
    };
    // With the level axes and gravity differentiated too.
    let level = LocalLevel::derivative_at(&motion.position_m);
    let exact = |predictions: &[Prediction], with_gravity: bool| {
        let mut turned = predictions.to_vec();
        let accelerometers = turned.len() - 3;
        for (k, prediction) in turned.iter_mut().enumerate() {
            prediction.gradient.turn_level(&motion.ecef_from_body, &level);
            if with_gravity && k >= accelerometers {
                let mut axis = Vector3::zeros();
                axis[k - accelerometers] = 1.0;
                prediction.gradient.turn_gravity(&axis, &motion.ecef_from_body, &here, &level);
            }
        }
        rows(&turned)
    };
    compare_values(outcome, "h published", &published, &numbers(&case["h_paper"])?);
    compare_values(outcome, "h corrected", &corrected, &numbers(&case["h_full"])?);
    compare_matrix(outcome, "H published", &rows(&published), &case["H_paper_frozenTEN"])?;
    compare_matrix(outcome, "H corrected", &rows(&corrected), &case["H_full_frozenTEN"])?;
    let published = exact(&published, false);
    compare_matrix(outcome, "H published, exact", &published, &case["H_paper_exact"])?;
    compare_matrix(outcome, "H corrected, exact", &exact(&corrected, true), &case["H_full_exact"])
}

fn check_published_step(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let step = &case["step_paper"];
    let step_s = number(&step["dt"])?;
    let (x, sd) = (seventeen(&case["x"])?, seventeen(&step["P0_sd"])?);
    let z = numbers(&step["z"])?;
    let (ranging, force) = measurements(case, &z)?;
    // The time of the case is that of the measurement, at the end of the step.
    let before_s = number(&case["t"])? - step_s;
    let mut filter = PublishedFilter::new(arm(case)?, before_s, x, &sd, step_s);
    filter.predict(step_s);
    compare_state(outcome, "published x predicted", filter.state(), &step["x_pred"])?;
    for (gate, key) in GATES {
        let mut gated = filter.clone();
        gated.gate = gate;
        gated.update(&ranging, &force);
        compare_gate(outcome, key, gated.batch().outcomes(), &step[key])?;
    }
    filter.gate = Gate::Open;
    filter.update(&ranging, &force);
    compare_innovations(outcome, filter.batch().innovations(), &z, &step["h_pred"])?;
    let nis = filter.batch().outcomes().iter().map(|outcome| outcome.normalised_square).sum();
    compare_update(outcome, step, filter.state(), filter.covariance(), nis)?;
    let diagonal = filter.process_noise().diagonal();
    compare_diagonal(outcome, diagonal.as_slice(), &step["Q_next_diag"])
}

fn check_corrected_step(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let step = &case["step_full"];
    let step_s = number(&step["dt"])?;
    let (x, sd) = (seventeen(&case["x"])?, seventeen(&step["P0_sd"])?);
    let z = numbers(&step["z"])?;
    let (ranging, force) = measurements(case, &z)?;
    let time_s = number(&case["t"])?;
    let settings = ArmFilterSettings {
        process_noise: ProcessNoise::PaperSteps,
        adaptive: true,
        second_order: false,
        gate: Gate::Open,
        ..ArmFilterSettings::new(arm(case)?)
    };
    let start = start(time_s - step_s, &x, &sd);
    let mut filter = ArmFilter::new(settings.clone(), &start);
    filter.predict_to(time_s).map_err(|error| error.to_string())?;
    compare_state(outcome, "corrected x predicted", filter.state(), &step["x_pred"])?;
    let epoch = ArmEpoch {
        time_s,
        specific_force_mps2: Some(force),
        satellites: &ranging,
        arm_angle_rad: None,
    };
    for (gate, key) in GATES {
        let mut gated = ArmFilter::new(ArmFilterSettings { gate, ..settings.clone() }, &start);
        gated.push(&epoch).map_err(|error| error.to_string())?;
        // The filter takes each satellite's measurements in the same order as the vector.
        compare_gate(outcome, key, gated.batch().outcomes(), &step[key])?;
    }
    let health = filter.push(&epoch).map_err(|error| error.to_string())?;
    compare_innovations(outcome, filter.batch().innovations(), &z, &step["h_pred"])?;
    let nis = health.gnss.nis + health.accelerometer.nis;
    compare_update(outcome, step, filter.state(), filter.covariance(), nis)?;
    let diagonal = filter.process_noise_diagonal();
    compare_diagonal(outcome, diagonal.as_slice(), &step["Q_next_diag"])
}

const GATES: [(Gate, &str); 2] = [
    (Gate::NoiseOnly { sigmas: 3.0 }, "gate16_pass"),
    (Gate::Innovation { sigmas: 5.0 }, "gateS_pass"),
];

fn arm(case: &Value) -> Result<RotatingArm, String> {
    let par = &case["par"];
    Ok(RotatingArm {
        phase_rad: number(&par["theta0"])?,
        centre_m: vector3(&par["rho0"])?,
        ..RotatingArm::new(number(&par["R"])?, number(&par["f"])?)
    })
}

fn satellites(case: &Value) -> Result<Vec<SatelliteMotion>, String> {
    let (positions, velocities) = (matrix(&case["sat_pos"])?, matrix(&case["sat_vel"])?);
    if positions.ncols() != 3 || velocities.shape() != positions.shape() {
        return Err("satellite positions and velocities must be rows of three".to_owned());
    }
    let motion = |j| SatelliteMotion {
        position_m: positions.fixed_view::<1, 3>(j, 0).transpose(),
        velocity_mps: velocities.fixed_view::<1, 3>(j, 0).transpose(),
    };
    Ok((0..positions.nrows()).map(motion).collect())
}

/// The measured vector of a step: all pseudoranges, all range rates, three accelerometers.
fn measurements(case: &Value, z: &[f64]) -> Result<(Vec<Ranging>, Vector3<f64>), String> {
    let satellites = satellites(case)?;
    let count = satellites.len();
    if z.len() != 2 * count + 3 {
        return Err(format!("{} measurements for {count} satellites", z.len()));
    }
    let ranging = satellites.iter().zip(1u8..).enumerate().map(|(j, (motion, number))| Ranging {
        satellite: Satellite { system: System::Gps, number },
        motion: *motion,
        pseudorange_m: Some(Measured { value: z[j], sd: PSEUDORANGE_VARIANCE_M2.sqrt() }),
        range_rate_mps: Some(Measured { value: z[count + j], sd: RANGE_RATE_SD_MPS }),
        phase_m: None,
        slipped: false,
    });
    let force = Vector3::new(z[2 * count], z[2 * count + 1], z[2 * count + 2]);
    Ok((ranging.collect(), force))
}

fn start(time_s: f64, x: &[f64; PAPER_STATES], sd: &[f64; PAPER_STATES]) -> Start {
    let three = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
    Start {
        time_s,
        position_m: three(0),
        position_sd_m: sd[0],
        clock_m: x[3],
        clock_sd_m: sd[3],
        velocity_mps: three(4),
        velocity_sd_mps: sd[4],
        clock_rate_mps: x[7],
        clock_rate_sd_mps: sd[7],
        acceleration_mps2: three(8),
        acceleration_sd_mps2: sd[8],
        angles: Angles { roll_rad: x[11], pitch_rad: x[12], heading_rad: x[13] },
        tilt_sd_rad: sd[11],
        heading_sd_rad: sd[13],
        angle_rates_radps: three(14),
        rate_sd_radps: sd[14],
        angular_acceleration_sd_radps2: 0.0,
    }
}

fn seventeen(value: &Value) -> Result<[f64; PAPER_STATES], String> {
    numbers(value)?.try_into().map_err(|_| "seventeen numbers were expected".to_owned())
}

fn relative(value: f64, expected: f64) -> f64 {
    (value - expected).abs() / expected.abs().max(1.0)
}

fn compare_values(outcome: &mut Outcome, what: &str, found: &[Prediction], expected: &[f64]) {
    outcome.expect("as many values as expected", found.len() == expected.len());
    for (prediction, expected) in found.iter().zip(expected) {
        outcome.compare(what, relative(prediction.value, *expected), 1e-9);
    }
}

/// |ΔH| ≤ 1e-9 max(1, |H|), element by element.
fn compare_matrix(
    outcome: &mut Outcome,
    what: &str,
    found: &DMatrix<f64>,
    expected: &Value,
) -> Result<(), String> {
    let expected = matrix(expected)?;
    if expected.shape() != found.shape() {
        return Err(format!("{what}: shape {:?}, expected {:?}", found.shape(), expected.shape()));
    }
    outcome.compare(what, found.zip_map(&expected, relative).max(), 1e-9);
    Ok(())
}

fn compare_state(
    outcome: &mut Outcome,
    what: &str,
    found: &[f64],
    expected: &Value,
) -> Result<(), String> {
    let expected = numbers(expected)?;
    outcome.expect("as many states as expected", found.len() == expected.len());
    for (found, expected) in found.iter().zip(expected) {
        outcome.compare(what, relative(*found, expected), 1e-9);
    }
    Ok(())
}

fn compare_innovations(
    outcome: &mut Outcome,
    innovations: &[f64],
    z: &[f64],
    h_pred: &Value,
) -> Result<(), String> {
    for ((innovation, z), h) in innovations.iter().zip(z).zip(numbers(h_pred)?) {
        outcome.compare("h predicted", relative(z - innovation, h), 1e-9);
    }
    Ok(())
}

fn compare_gate(
    outcome: &mut Outcome,
    key: &str,
    found: &[kurs::fusion::kalman::UpdateOutcome],
    expected: &Value,
) -> Result<(), String> {
    let list = expected.as_array().ok_or("a list of flags was expected")?;
    let flags: Vec<Option<bool>> = list.iter().map(Value::as_bool).collect();
    let found: Vec<Option<bool>> = found.iter().map(|outcome| Some(outcome.accepted)).collect();
    outcome.expect(key, found == flags);
    Ok(())
}

fn compare_update(
    outcome: &mut Outcome,
    step: &Value,
    state: &[f64],
    covariance: &DMatrix<f64>,
    nis: f64,
) -> Result<(), String> {
    compare_state(outcome, "x updated", state, &step["x_upd"])?;
    outcome.compare("NIS", relative(nis, number(&step["nis"])?), 1e-7);
    let expected = matrix(&step["P_upd"])?;
    let mut worst: f64 = 0.0;
    for (row, column) in (0..PAPER_STATES).flat_map(|i| (0..PAPER_STATES).map(move |j| (i, j))) {
        let scale = (expected[(row, row)] * expected[(column, column)]).sqrt();
        worst = worst.max((covariance[(row, column)] - expected[(row, column)]).abs() / scale);
    }
    outcome.compare("P updated", worst, 1e-9);
    Ok(())
}

fn compare_diagonal(outcome: &mut Outcome, found: &[f64], expected: &Value) -> Result<(), String> {
    let errors = found.iter().zip(numbers(expected)?);
    let worst = errors.map(|(found, expected)| (found - expected).abs() / expected.abs());
    outcome.compare("Q of the next step", worst.fold(0.0, f64::max), 1e-6);
    Ok(())
}
