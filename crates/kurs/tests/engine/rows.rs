//! Rows as text, and the numbered examples.

use serde_json::{Value, json};

use super::world::{Motion, World};
use super::{TRIANGLE_M, degrees, engine, rows, told};
use kurs::{EpochSolution, GpsTime, Reason, Settings};

#[path = "../../examples/04_attitude_from_coordinates.rs"]
mod attitude_from_coordinates;
#[path = "../../examples/03_few_satellites.rs"]
mod few_satellites;
#[path = "../../examples/01_first_heading.rs"]
mod first_heading;
#[path = "../../examples/05_plan_an_array.rs"]
mod plan_an_array;
#[path = "../../examples/02_three_antennas.rs"]
mod three_antennas;

#[test]
fn the_numbered_examples_run() {
    first_heading::main().unwrap();
    three_antennas::main().unwrap();
    few_satellites::main().unwrap();
    attitude_from_coordinates::main().unwrap();
    plan_an_array::main().unwrap();
}

#[test]
fn a_fixed_row_serialises_with_its_units_in_its_names() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(70.0, 2.0, -3.0), &TRIANGLE_M);
    let mut engine = engine(Settings { residuals: true, ..told(&body) }, &world);
    let row = &rows(&mut engine, &mut world, &body, 2)[1];
    let value = serde_json::to_value(row).unwrap();
    assert_eq!(value["status"], "fixed");
    assert_eq!(value["time"], json!({"week": 2320, "tow_s": 116_401.0}));
    let attitude = row.attitude().unwrap();
    assert_eq!(value["attitude"]["heading_rad"], attitude.heading_rad.unwrap());
    let covariance = &attitude.covariance_rad2;
    assert_eq!(value["attitude"]["covariance_rad2"][0][2], covariance[(0, 2)]);
    let quaternion = attitude.ned_from_body.unwrap().quaternion();
    assert_eq!(value["attitude"]["ned_from_body"], json!(quaternion));
    let east_m = row.baselines[1].baseline_m.xyz().x;
    assert_eq!(value["baselines"][1]["baseline_m"][0], east_m);
    assert_eq!(value["baselines"][1]["status"], "fixed");
    assert_eq!(value["position"]["origin"], "alone");
    assert_eq!(value["integers"]["checks"][2]["reason"], "weak_model");
    let residuals = &row.signals.as_ref().unwrap().residuals;
    assert_eq!(value["signals"]["residuals"][0]["signal"], residuals[0].signal.to_string());
    assert_eq!(value["signals"]["residuals"][0]["phase_m"], residuals[0].phase_m.unwrap());
}

#[test]
fn a_lost_row_serialises_with_its_reason() {
    let time = GpsTime::from_week_tow(2320, 1.5).unwrap();
    let value = serde_json::to_value(EpochSolution::lost(time, Reason::NoEphemeris)).unwrap();
    assert_eq!((&value["status"], &value["reason"]), (&json!("lost"), &json!("no_ephemeris")));
    assert_eq!(value["integers"], Value::Null);
    for reason in Reason::ALL {
        assert_eq!(serde_json::to_value(reason).unwrap(), reason.word(), "the words are one");
    }
}
