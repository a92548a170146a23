//! `[body.motion]` and `[[body.antenna]] position_m`: the truth, and that the observations belong to it.

use core::f64::consts::TAU;

use kurs::frames::Geodetic;
use kurs_sim::motion::RecordedPose;
use kurs_sim::scenario::{MotionPlan, Place};
use kurs_sim::simulation::{Attachments, BodyTruth};
use nalgebra::Vector3;

use super::scene::{PLACE, Run, assert_sd, by_signal, level_m, moving, rms, roof, run};

fn truths(run: &Run) -> Vec<&BodyTruth> {
    run.epochs.iter().map(|epoch| &epoch.bodies[0].truth).collect()
}

/// Difference of two headings, rad.
fn turn_rad(from: f64, to: f64) -> f64 {
    (to - from + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
}

#[test]
fn a_static_body_is_where_and_as_it_is_said_to_be() {
    let plan =
        MotionPlan::Static { place: PLACE, heading_deg: 90.0, pitch_deg: 30.0, roll_deg: 0.0 };
    let run = moving(plan, |scenario| scenario.body[0].antenna[1].position_m = [2.0, 1.0, 0.5]);
    for truth in truths(&run) {
        let angles = &truth.attitude;
        let deg = [angles.heading_rad, angles.pitch_rad, angles.roll_rad].map(f64::to_degrees);
        assert!((Vector3::from(deg) - Vector3::new(90.0, 30.0, 0.0)).norm() < 1e-9, "{deg:?}");
        assert!(level_m(truth.position_m).norm() < 1e-6 && truth.velocity_mps.norm() < 1e-6);
        // Nose east and 30° up: forward is (0, cos, −sin), right is south, down is (0, sin, cos).
        let (sin, cos) = 30f64.to_radians().sin_cos();
        let wanted = Vector3::new(-1.0, 2.0 * cos + 0.5 * sin, -2.0 * sin + 0.5 * cos);
        assert!((truth.baselines_m[0].xyz() - wanted).norm() < 1e-9, "{:?}", truth.baselines_m);
    }
    // The observations of the second antenna are those of one that stands at that end.
    let [first, second] = [0, 1].map(|antenna| by_signal(run.antenna(0, antenna)));
    for (key, o) in first {
        let Some(there) = second.get(&key) else { continue };
        let (azimuth, elevation) = run.direction_rad(0, key.0);
        let flat = elevation.cos();
        let towards = Vector3::new(azimuth.cos() * flat, azimuth.sin() * flat, -elevation.sin());
        let found_m = there.pseudorange_m.unwrap() - o.pseudorange_m.unwrap();
        let wanted_m = -towards.dot(&truths(&run)[0].baselines_m[0].xyz());
        assert!((found_m - wanted_m).abs() < 1e-3, "{key:?}: {found_m} {wanted_m}");
    }
}

/// Waits, gathers speed, turns with its radius leaning outwards, and drives on.
#[test]
fn a_car_drives_its_way() {
    let plan = MotionPlan::Car {
        place: PLACE,
        waypoints_m: vec![[0.0, 0.0], [0.0, 100.0], [200.0, 100.0]],
        speed_mps: 10.0,
        wait_s: 5.0,
        acceleration_mps2: 2.0,
        turn_radius_m: 40.0,
        lean_deg_per_mps2: 0.8,
    };
    let run = moving(plan, |scenario| (scenario.duration_s, scenario.interval_s) = (40.0, 0.1));
    let truths = truths(&run);
    let speed = |k: usize| truths[k].velocity_mps.norm();
    assert!((0..50).all(|k| speed(k) < 1e-6), "it waits");
    assert!((speed(70) - 4.0).abs() < 0.01, "2 m/s² for 2 s: {}", speed(70));
    assert!((110..400).all(|k| (speed(k) - 10.0).abs() < 1e-3), "its speed");
    // 60 m straight, an arc of 90° with 40 m: rate v/r, roll −0.8 v²/r, both in the middle of the arc.
    let heading = |k: usize| truths[k].attitude.heading_rad;
    let middle = (0..400).find(|k| turn_rad(heading(*k), 0.25 * TAU / 2.0) < 0.0).unwrap();
    let rate_degps = (turn_rad(heading(middle - 1), heading(middle + 1)) / 0.2).to_degrees();
    assert!((rate_degps - (10f64 / 40.0).to_degrees()).abs() < 0.01, "{rate_degps}");
    let roll_deg = truths[middle].attitude.roll_rad.to_degrees();
    assert!((roll_deg + 0.8 * 100.0 / 40.0).abs() < 0.01, "{roll_deg}");
    let corner = level_m(truths[middle].position_m);
    let arc = Vector3::new(60.0 + 40.0 * 0.5f64.sqrt(), 40.0 - 40.0 * 0.5f64.sqrt(), 0.0);
    assert!((corner - arc).norm() < 1.0, "{corner}");
    let end = truths[400];
    assert!((heading(400).to_degrees() - 90.0).abs() < 1e-6 && end.attitude.roll_rad.abs() < 1e-9);
    // 30 s at 10 m/s less half of the time to speed up; the way is shorter by 2 r − π r / 2.
    let way_m = 10.0 * 35.0 - 25.0 - (60.0 + 40.0 * TAU / 4.0);
    assert!((level_m(end.position_m).y - 40.0 - way_m).abs() < 0.1, "{}", level_m(end.position_m));
}

/// RMS of every motion, and waves of the period asked for.
#[test]
fn a_ship_swings_as_asked() {
    let plan = MotionPlan::Ship {
        place: PLACE,
        heading_deg: 40.0,
        speed_mps: 5.0,
        period_s: 8.0,
        roll_rms_deg: 6.0,
        pitch_rms_deg: 2.0,
        yaw_rms_deg: 1.0,
        heave_rms_m: 0.7,
    };
    let run = moving(plan, |scenario| {
        (scenario.duration_s, scenario.interval_s) = (1600.0, 0.5);
        scenario.sky.systems = vec!["J".to_owned()];
    });
    let truths = truths(&run);
    let mean = f64::to_radians(40.0);
    for (name, found, wanted) in [
        ("roll", rms(truths.iter().map(|t| t.attitude.roll_rad.to_degrees())), 6.0),
        ("pitch", rms(truths.iter().map(|t| t.attitude.pitch_rad.to_degrees())), 2.0),
        (
            "yaw",
            rms(truths.iter().map(|t| turn_rad(mean, t.attitude.heading_rad).to_degrees())),
            1.0,
        ),
        ("heave", rms(truths.iter().map(|t| heave_m(t))), 0.7),
    ] {
        assert!((found / wanted - 1.0).abs() < 0.05, "{name}: {found}, wanted {wanted}");
    }
    let crossings = truths
        .windows(2)
        .filter(|two| two[0].attitude.roll_rad < 0.0 && two[1].attitude.roll_rad >= 0.0);
    let period_s = 1600.0 / crossings.count() as f64;
    assert!((period_s / 8.0 - 1.0).abs() < 0.1, "{period_s}");
    let (first, last) = (level_m(truths[0].position_m), level_m(truths[3200].position_m));
    let way = last - first;
    assert!(
        (way.y.atan2(way.x) - mean).abs() < 1e-3 && (way.norm() / 8000.0 - 1.0).abs() < 1e-3,
        "{way}"
    );
}

/// Height above the level plane of the start.
fn heave_m(truth: &BodyTruth) -> f64 {
    -level_m(truth.position_m).z
}

#[test]
fn an_aircraft_rolls_as_fast_as_asked() {
    let plan = MotionPlan::Uav {
        place: PLACE,
        radius_m: 50.0,
        speed_mps: 12.0,
        tilt_deg: 30.0,
        max_rate_degps: 200.0,
    };
    let run = moving(plan, |scenario| (scenario.duration_s, scenario.interval_s) = (20.0, 0.01));
    let truths = truths(&run);
    let roll = |k: usize| truths[k].attitude.roll_rad.to_degrees();
    let rates = (1..2000).map(|k| ((roll(k + 1) - roll(k - 1)) / 0.02).abs());
    let fastest = rates.fold(0.0, f64::max);
    assert!((fastest - 200.0).abs() < 1.0, "{fastest}°/s");
    for of in [|t: &BodyTruth| t.attitude.roll_rad, |t: &BodyTruth| t.attitude.pitch_rad] {
        let most = truths.iter().map(|t| of(t).to_degrees()).fold(0.0, f64::max);
        assert!((most - 30.0).abs() < 0.1, "{most}°");
    }
    for truth in &truths {
        assert!((level_m(truth.position_m).norm() - 50.0).abs() < 1e-3);
        assert!((truth.velocity_mps.norm() - 12.0).abs() < 1e-3);
        let velocity = truth.velocity_mps.xyz();
        let course = velocity.y.atan2(velocity.x);
        assert!(turn_rad(course, truth.attitude.heading_rad).abs() < 1e-4);
    }
}

/// Height, inclination, node and speed of a circular orbit; attitude against its motion.
#[test]
fn a_low_orbit_is_the_one_asked_for() {
    let plan = MotionPlan::Orbit {
        altitude_m: 500e3,
        inclination_deg: 60.0,
        node_deg: 25.0,
        latitude_argument_deg: 0.0,
        yaw_deg: 5.0,
        pitch_deg: 1.0,
        roll_deg: -2.0,
    };
    let run = moving(plan, |scenario| (scenario.duration_s, scenario.interval_s) = (1440.0, 10.0));
    let truths = truths(&run);
    let start = Geodetic::from_ecef(truths[0].position_m);
    assert!((start.longitude_rad.to_degrees() - 25.0).abs() < 1e-3, "{start:?}");
    assert!(start.latitude_rad.abs() < 1e-5 && truths[1].position_m.xyz().z > 0.0);
    let mut highest = 0f64;
    for truth in &truths {
        let position = truth.position_m.xyz();
        assert!((position.norm() - 6_878_137.0).abs() < 1e-3);
        highest = highest.max((position.z / position.norm()).asin().to_degrees());
        assert!((7000.0..7700.0).contains(&truth.velocity_mps.norm()));
        let velocity = truth.velocity_mps.xyz();
        let yaw = turn_rad(velocity.y.atan2(velocity.x), truth.attitude.heading_rad).to_degrees();
        assert!((yaw - 5.0).abs() < 1e-3, "{yaw}");
        assert!((truth.attitude.pitch_rad.to_degrees() - 1.0).abs() < 1e-9);
        assert!((truth.attitude.roll_rad.to_degrees() + 2.0).abs() < 1e-9);
    }
    // A quarter of 94.6 minutes after the node it is as far north as it is inclined.
    assert!((highest - 60.0).abs() < 0.1, "{highest}");
    assert!(run.satellites(0, 0).len() > 10);
}

#[test]
fn a_recorded_motion_goes_through_its_rows() {
    let row = |k: i32| RecordedPose {
        time_s: f64::from(k),
        place: Place { latitude_deg: 35.0 + 1e-5 * f64::from(k * k), ..PLACE },
        angles_deg: [350.0 + 7.0 * f64::from(k), f64::from(k), -2.0 * f64::from(k)],
    };
    let rows: Vec<RecordedPose> = (0..=4).map(row).collect();
    let mut scenario = roof(|_| ()).simulation.scenario().clone();
    scenario.body[0].motion = MotionPlan::Recorded { file: "way.csv".to_owned() };
    let recorded = vec![Some(rows.clone())];
    let run = run(scenario, &Attachments { navigation: None, recorded });
    for (truth, row) in truths(&run).into_iter().zip(&rows) {
        assert!((truth.position_m - row.place.geodetic().to_ecef()).norm() < 1e-6);
        let attitude = &truth.attitude;
        assert!(turn_rad(row.angles_deg[0].to_radians(), attitude.heading_rad).abs() < 1e-9);
        assert!((attitude.pitch_rad.to_degrees() - row.angles_deg[1]).abs() < 1e-7);
        assert!((attitude.roll_rad.to_degrees() - row.angles_deg[2]).abs() < 1e-7);
    }
}

/// The true places of the antennas are off from the surveyed ones by their standard deviation in every
/// coordinate, in every session by another amount, and stay so throughout it.
#[test]
fn surveys_err_once() {
    let mut errors_m = Vec::new();
    for seed in 0..150 {
        let run = roof(|scenario| (scenario.seed, scenario.array_sd_m) = (seed, 0.005));
        let baselines = run.epochs.iter().map(|epoch| epoch.bodies[0].truth.baselines_m[0].xyz());
        let baselines: Vec<Vector3<f64>> = baselines.collect();
        assert!(baselines.iter().all(|b| (b - baselines[0]).norm() < 1e-6), "{baselines:?}");
        // Heading east.
        errors_m.extend((baselines[0] - Vector3::new(0.0, 1.5, 0.0)).iter().copied());
    }
    assert_sd("survey", rms(errors_m.iter().copied()), 0.005 * 2f64.sqrt(), errors_m.len());
}
