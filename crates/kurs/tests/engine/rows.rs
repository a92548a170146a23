//! Rows as text, and the numbered examples.

use serde_json::{Value, json};

use super::world::{Motion, World};
use super::{TRIANGLE_M, degrees, engine, rows, told};
use kurs::observation::interference::Spoofing;
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

/// Codes that are metres off while a receiver states spoofing change no row before or behind, as those of the same
/// epochs do that nobody speaks of.
#[test]
fn spoofed_epochs_teach_nothing() {
    let body = Motion::at_rest(degrees(70.0, 2.0, -3.0), &TRIANGLE_M);
    let rows_of = |is_disturbed: bool, spoofing: Spoofing| -> Vec<Value> {
        let mut world = World::new().unwrap();
        let mut engine = engine(told(&body), &world);
        let row = |second: u32| {
            let mut epoch = world.epoch(&body, f64::from(second));
            if SPOOFED.contains(&second) {
                let antenna = epoch.antennas[1].as_mut().unwrap();
                antenna.interference.spoofing = spoofing;
                for (number, observation) in (0..).zip(&mut antenna.observations) {
                    let off_m = if is_disturbed { f64::from(number % 5 - 2) } else { 0.0 };
                    observation.pseudorange_m = observation.pseudorange_m.map(|m| m + off_m);
                }
            }
            serde_json::to_value(engine.push(&epoch)).unwrap()
        };
        (0..20).map(row).collect()
    };
    const SPOOFED: core::ops::Range<u32> = 8..14;
    let believed = |rows: Vec<Value>| -> Vec<Value> {
        let numbered = (0..).zip(rows).filter(|(second, _)| !SPOOFED.contains(second));
        numbered.map(|(_, row)| row).collect()
    };
    let [good, spoofed] = [false, true].map(|is_disturbed| rows_of(is_disturbed, Spoofing::Stated));
    for second in SPOOFED {
        let row = &spoofed[second as usize];
        assert_eq!(
            (&row["status"], &row["reason"]),
            (&json!("inconsistent"), &json!("interference"))
        );
    }
    assert_eq!(believed(good), believed(spoofed));
    let [good, unseen] = [false, true].map(|is_disturbed| rows_of(is_disturbed, Spoofing::None));
    assert_ne!(believed(good), believed(unseen));
}
