//! `[atmosphere]`, wind-up and `[[bias]]`.

use kurs::ephemeris::Ephemeris;
use kurs::signal::System;
use kurs_sim::motion::RecordedPose;
use kurs_sim::scenario::{BeiDouOrbit, Bias, MotionPlan, Scenario};
use kurs_sim::simulation::Attachments;

use super::scene::{Change, PLACE, Run, roof, run, signal};

/// The ionosphere delays the code and advances the phase by as much, as the square of the wavelength,
/// and three times as much at the horizon as at the zenith.
#[test]
fn the_ionosphere_delays_code_and_advances_phase() {
    let with = roof(|scenario| scenario.atmosphere.ionosphere_zenith_m = 4.0);
    let mut lowest = 0f64;
    for change in with.less(&roof(|_| ())) {
        let l1_m = change.code_m / change.frequency_ratio().powi(2);
        assert!((change.phase_m() + change.code_m).abs() < 1e-5, "{change:?}");
        // Thin shell at 350 km over a sphere of 6371 km.
        let sin_at_shell = 6371.0 / 6721.0 * change.elevation_rad.cos();
        let wanted_m = 4.0 / (1.0 - sin_at_shell * sin_at_shell).sqrt();
        assert!((l1_m - wanted_m).abs() < 2e-3, "{change:?}: {l1_m} {wanted_m}");
        lowest = lowest.max(l1_m);
    }
    assert!(lowest > 8.5, "{lowest}");
}

/// The troposphere delays both alike on every signal, as 1/sin, and falls with the height.
#[test]
fn the_troposphere_delays_both() {
    let wet = |height_m: f64, zenith_m: f64| {
        roof(|scenario| {
            scenario.atmosphere.troposphere_zenith_m = zenith_m;
            if let MotionPlan::Static { place, .. } = &mut scenario.body[0].motion {
                place.height_m = height_m;
            }
        })
    };
    for (height_m, zenith_m) in [(0.0, 2.4), (8000.0, 2.4 / core::f64::consts::E)] {
        for change in wet(height_m, 2.4).less(&wet(height_m, 0.0)) {
            assert!((change.phase_m() - change.code_m).abs() < 1e-5, "{change:?}");
            if change.elevation_rad > 0.3 {
                let wanted_m = zenith_m / change.elevation_rad.sin();
                assert!((change.code_m / wanted_m - 1.0).abs() < 0.01, "{change:?}: {wanted_m}");
            }
        }
    }
}

/// A turn of the antenna, clockwise from above as the wave itself turns, makes the phase a cycle
/// longer (in the sense of the distance), for every satellite, and leaves the code alone.
#[test]
fn a_clockwise_turn_winds_the_phase_up_by_a_cycle() {
    let pose = |k: i32| RecordedPose {
        time_s: f64::from(k),
        place: PLACE,
        angles_deg: [30.0 * f64::from(k), 0.0, 0.0],
    };
    let table: Vec<RecordedPose> = (0..=12).map(pose).collect();
    let turning = |wind_up: bool| {
        let mut scenario = roof(|_| ()).simulation.scenario().clone();
        scenario.duration_s = 12.0;
        scenario.atmosphere.wind_up = wind_up;
        scenario.body[0].motion = MotionPlan::Recorded { file: "turn.csv".to_owned() };
        run(scenario, &Attachments { navigation: None, recorded: vec![Some(table.clone())] })
    };
    let changes = turning(true).less(&turning(false));
    assert!(changes.iter().all(|c| c.code_m == 0.0), "the code has none");
    for end in changes.iter().filter(|c| c.epoch == 12) {
        let of_link = |c: &&Change| {
            (c.antenna, c.satellite, c.signal, c.epoch)
                == (end.antenna, end.satellite, end.signal, 0)
        };
        let Some(start) = changes.iter().find(of_link) else { continue };
        let gained = end.phase_cycles - start.phase_cycles;
        // The satellite itself turns a little in twelve seconds.
        assert!((gained - 1.0).abs() < 0.02, "{}: {gained} cycles", end.satellite);
    }
}

/// An antenna that is mounted turned by 180° differs by half a cycle, by 90° at the zenith by a
/// quarter, from one that is not; wind-up takes no part in the code.
#[test]
fn turned_antennas_differ_by_their_turn() {
    let turned = |turned_deg: f64| {
        roof(|scenario| {
            scenario.atmosphere.wind_up = true;
            scenario.body[0].antenna[1].turned_deg = turned_deg;
        })
    };
    let plain = turned(0.0);
    for (turned_deg, from_rad, wanted, within) in [(180.0, 0.0, 0.5, 1e-6), (90.0, 1.0, 0.25, 0.03)]
    {
        let mut seen = 0;
        for change in turned(turned_deg).less(&plain) {
            if change.antenna == 0 {
                assert_eq!(change.phase_cycles, 0.0);
            } else if change.elevation_rad > from_rad {
                let off = change.phase_cycles - wanted;
                assert!((off - off.round()).abs() < within, "{turned_deg}°: {change:?}");
                seen += 1;
            }
        }
        assert!(seen > 20, "{seen}");
    }
}

/// Every observation changes by what the bias says if `chosen`, and not at all otherwise.
fn assert_bias(
    bias: &Bias,
    chosen: impl Fn(&Run, &Change) -> bool,
    size: impl Fn(i8) -> (f64, f64),
) {
    let with = roof(|scenario| scenario.bias = vec![bias.clone()]);
    let (mut hit, mut spared) = (0, 0);
    for change in with.less(&roof(|_: &mut Scenario| ())) {
        let channel = match with.record(change.satellite) {
            Ephemeris::Glonass(glonass) => glonass.elements().channel,
            Ephemeris::Kepler(_) => 0,
        };
        let is_chosen = chosen(&with, &change);
        let (code_m, cycles) = if is_chosen { size(channel) } else { (0.0, 0.0) };
        assert!((change.code_m - code_m).abs() < 1e-6, "{bias:?}: {change:?}");
        assert!((change.phase_cycles - cycles).abs() < 1e-6, "{bias:?}: {change:?}");
        *(if is_chosen { &mut hit } else { &mut spared }) += 1;
    }
    assert!(hit > 10 && spared > 10, "{bias:?}: {hit} hit, {spared} spared");
}

/// Between receivers: a system, one signal, each GLONASS channel, each kind of BeiDou orbit.
#[test]
fn biases_hit_what_they_name() {
    let of_system = Bias {
        antenna: "A1".to_owned(),
        system: Some("E".to_owned()),
        code_m: 3.0,
        phase_cycles: -0.4,
        ..Bias::default()
    };
    assert_bias(
        &of_system,
        |_, c| c.antenna == 1 && c.satellite.system == System::Galileo,
        |_| (3.0, -0.4),
    );
    for cycles in [0.25, 0.5] {
        let of_signal =
            Bias { signal: Some("G2W".to_owned()), phase_cycles: cycles, ..Bias::default() };
        assert_bias(&of_signal, |_, c| c.signal == signal("G2W"), |_| (0.0, cycles));
    }
    let of_channels = Bias {
        antenna: "A0".to_owned(),
        system: Some("R".to_owned()),
        code_m_per_channel: 0.2,
        phase_cycles_per_channel: 0.03,
        ..Bias::default()
    };
    assert_bias(
        &of_channels,
        // Channel 0 exists, and has none.
        |run, c| c.antenna == 0 && matches!(run.record(c.satellite), Ephemeris::Glonass(_)),
        |channel| (0.2 * f64::from(channel), 0.03 * f64::from(channel)),
    );
    for orbit in [BeiDouOrbit::Geo, BeiDouOrbit::Igso, BeiDouOrbit::Meo] {
        let of_orbit = Bias {
            antenna: "A1".to_owned(),
            orbit: Some(orbit),
            code_m: 1.0,
            phase_cycles: 0.5,
            ..Bias::default()
        };
        let chosen = |_: &Run, c: &Change| {
            let of_number = match c.satellite.number {
                38..=40 => BeiDouOrbit::Igso,
                59.. => BeiDouOrbit::Geo,
                _ => BeiDouOrbit::Meo,
            };
            c.antenna == 1 && c.satellite.system == System::BeiDou && of_number == orbit
        };
        assert_bias(&of_orbit, chosen, |_| (1.0, 0.5));
    }
}

/// Two biases of one observation add up.
#[test]
fn biases_add_up() {
    let bias = |code_m| Bias { code_m, ..Bias::default() };
    let with = roof(|scenario| scenario.bias = vec![bias(1.0), bias(-3.5)]);
    for change in with.less(&roof(|_| ())) {
        assert!((change.code_m + 2.5).abs() < 1e-6, "{change:?}");
    }
}
