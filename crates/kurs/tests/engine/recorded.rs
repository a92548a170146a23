//! A recorded epoch, frozen: whoever moves a number here says why.

use approx::assert_abs_diff_eq;
use kurs::{AntennaArray, Band, Constraint, Engine, Reason, Settings, Status, Vector};

use super::recording;

/// The two antennas with their known distance, on these bands.
fn engine(bands: &[&str]) -> Engine {
    let ends = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(recording::LENGTH_M, 0.0, 0.0)];
    let settings = Settings {
        antennas: 2,
        array: Some(AntennaArray::new(ends).unwrap()),
        constraint: Constraint::Length,
        array_sd_m: 0.005,
        bands: Some(bands.iter().map(|band| band.parse::<Band>().unwrap()).collect()),
        ..Settings::default()
    };
    let navigation = recording::navigation(&recording::orbits().unwrap()).unwrap();
    Engine::new(settings, navigation).unwrap()
}

#[test]
fn a_recorded_epoch_gives_what_it_gave() {
    let row = engine(&["G1", "E1"]).push(&recording::epochs().unwrap()[0]);
    assert_eq!((row.status(), row.reason()), (Status::Fixed, None));
    assert_eq!((row.antennas, row.satellites, row.shared_satellites), (2, 15, 15));

    let attitude = row.attitude().unwrap();
    let sd_deg = |k: usize| attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
    let close = |found: f64, frozen: f64| assert_abs_diff_eq!(found, frozen, epsilon = 1e-6);
    close(attitude.heading_rad.unwrap().to_degrees(), FROZEN[0]);
    close(attitude.pitch_rad.unwrap().to_degrees(), FROZEN[1]);
    assert_eq!(attitude.roll_rad, None, "two antennas do not see it");
    close(attitude.line_elevation_rad.unwrap().to_degrees(), FROZEN[1]);
    close(sd_deg(0), FROZEN[2]);
    close(sd_deg(1), FROZEN[3]);

    let baseline = row.baselines[0];
    let [east_m, north_m, up_m]: [f64; 3] = baseline.baseline_m.xyz().into();
    close(east_m, FROZEN[4]);
    close(north_m, FROZEN[5]);
    close(up_m, FROZEN[6]);
    close(baseline.covariance_m2.trace().sqrt(), FROZEN[7]);

    let integers = row.integers.as_ref().unwrap();
    assert_eq!(integers.ambiguities, 13);
    close(integers.success_rate.unwrap(), FROZEN[8]);
    close(integers.ratio.unwrap(), FROZEN[9]);
    close(row.residual_rms_m.unwrap(), FROZEN[10]);
    assert_eq!(integers.left_out, None);
    let reasons: Vec<Reason> = integers.checks.iter().map(|check| check.reason).collect();
    assert_eq!(
        reasons,
        [
            Reason::Length,
            Reason::Geometry,
            Reason::WeakModel,
            Reason::Ratio,
            Reason::Unproven,
            Reason::Closure,
            Reason::Residuals,
            Reason::Length,
            Reason::Length,
            Reason::Tilt,
            Reason::Contradiction,
            Reason::Unproven,
        ]
    );
    assert!(integers.checks.iter().all(|check| !check.fails()), "{:?}", integers.checks);

    let position = row.position.unwrap();
    assert_eq!(position.antenna, Some(0));
    close(position.geodetic.latitude_rad.to_degrees() * 1e3, FROZEN[11]);
    close(position.geodetic.longitude_rad.to_degrees() * 1e3, FROZEN[12]);
    assert_abs_diff_eq!(position.geodetic.height_m, FROZEN[13], epsilon = 1e-4);
    assert_abs_diff_eq!(position.clock_m.unwrap(), FROZEN[14], epsilon = 1e-4);
    close(position.velocity_mps.unwrap().xyz().norm(), FROZEN[15]);
}

/// One antenna alone is located all the same, and the row says by how many satellites.
#[test]
fn an_antenna_that_is_left_alone_has_a_position_and_its_satellites() {
    let mut epoch = recording::epochs().unwrap()[0].clone();
    epoch.antennas[1] = None;
    let row = engine(&["G1", "E1"]).push(&epoch);
    assert!(row.position.is_some());
    assert_eq!((row.antennas, row.satellites, row.shared_satellites), (1, 0, 0));
    assert_eq!((row.located_by, row.satellites_in_use()), (15, 15));
}

/// In this order as the test above reads them: heading, pitch and their standard deviations (°), baseline east,
/// north, up and the root of its variances (m), success rate, ratio, residuals (m), latitude and longitude
/// (0.001°), height, clock (m), speed of an antenna at rest (m/s).
const FROZEN: [f64; 16] = [
    193.205_728_911,
    0.405_819_635,
    0.420_487_707,
    0.470_292_792,
    -0.225_810_325,
    -0.962_337_224,
    0.006_922_907,
    0.004_793_956,
    1.0,
    11.459_407_462,
    0.002_552_724,
    35_134.702_635_693,
    136_977.557_175_478,
    104.182_331_161,
    -73_324.845_495_575,
    0.008_804_035,
];

/// One band of GPS: a single epoch is believed when another one confirms its integers.
#[test]
fn a_weak_epoch_waits_for_a_second_one() {
    let mut engine = engine(&["G1"]);
    let epochs = recording::epochs().unwrap();
    let first = engine.push(&epochs[0]);
    assert_eq!((first.status(), first.reason()), (Status::Float, Some(Reason::Unproven)));
    let second = engine.push(&epochs[1]);
    assert_eq!((second.status(), second.reason()), (Status::Fixed, None));
    let length_m = second.baselines[0].baseline_m.norm();
    assert!((length_m - recording::LENGTH_M).abs() < 0.01, "{length_m}");
}
