//! Antennas that take no part, what stays known without them, and where things are and how they move.

use kurs::differential::Differential;
use kurs::engine::Ambiguities;
use kurs::float_solution::recursive::Motion as Moves;
use kurs::observation::interference::{Interference, Spoofing};
use kurs::solution::{Outcome, PositionOrigin};
use kurs::{ArrayEpoch, Constraint, Engine, EpochSolution, Reason, Settings, Status, Vector};
use nalgebra::Vector3;

use super::world::{Motion, World};
use super::{RECTANGLE_M, TRIANGLE_M, degrees, engine, errors_in_sigmas, rows, told};

/// North, east, down of a row's position less where the body's origin is. Down is some metres off: the world
/// has no atmosphere, and the library takes one out.
fn position_error_m(row: &EpochSolution, body: &Motion) -> Vector3<f64> {
    let position = row.position.unwrap();
    let true_m = body.place.to_ecef()
        + body.place.ecef_from_ned() * (body.velocity_mps * (row.time - body.start));
    (body.place.ned_from_ecef() * (position.position_m - true_m)).xyz()
}

#[test]
fn a_moving_body_has_its_velocity_with_its_sign() {
    let mut world = World::new().unwrap();
    let mut body = Motion::at_rest(degrees(70.0, 0.0, 0.0), &TRIANGLE_M);
    body.velocity_mps = Vector::new(12.0, -7.0, 1.5);
    let mut engine = engine(told(&body), &world);
    for row in rows(&mut engine, &mut world, &body, 5) {
        let velocity = row.position.unwrap().velocity_mps.unwrap();
        let off_mps = (velocity - body.velocity_mps).xyz();
        assert!(off_mps.amax() < 0.05, "{velocity:?}");
        assert!(row.is_fixed(), "{:?}", row.outcome);
        let worst = errors_in_sigmas(&row, &body.attitude).map(|e| e.unwrap().abs());
        assert!(worst.into_iter().fold(0.0, f64::max) < 4.5, "{worst:?}");
    }
}

/// Nothing is made of what no receiver measured.
#[test]
fn a_silent_doppler_gives_no_velocity() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(70.0, 0.0, 0.0), &TRIANGLE_M);
    let mut epoch = world.epoch(&body, 0.0);
    for observed in epoch.antennas.iter_mut().flatten() {
        observed.observations.iter_mut().for_each(|o| o.doppler_hz = None);
    }
    let row = engine(told(&body), &world).push(&epoch);
    assert_eq!(row.position.unwrap().velocity_mps, None);
}

/// Three antennas, of which the one ahead is silent: what is left is a line across the body, which sees heading
/// and roll. Pitch is the last known one, ever less certain, and then nothing.
#[test]
fn the_angle_that_a_rest_of_the_array_does_not_see_gets_uncertain() {
    const ARRAY_M: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 1.4866, 0.0]];
    let mut world = World::new().unwrap();
    let mut body = Motion::at_rest(degrees(33.0, -1.6, 0.0), &ARRAY_M);
    let mut engine = engine(told(&body), &world);
    let (mut with_pitch, mut without, mut last_sd) = (0, 0, 0.0);
    for second in 0..60 {
        body.attitude.roll_rad = (5.0 * (0.5 * f64::from(second)).sin()).to_radians();
        let mut epoch = world.epoch(&body, f64::from(second));
        let is_silent = (10..40).contains(&second);
        if is_silent {
            epoch.antennas[1] = None;
        }
        let row = engine.push(&epoch);
        let Outcome::Fixed { attitude } = &row.outcome else { continue };
        let sigmas = errors_in_sigmas(&row, &body.attitude);
        assert!(sigmas.iter().flatten().all(|e| e.abs() < 5.0), "{second}: {sigmas:?}");
        assert!(attitude.heading_rad.is_some(), "{second}");
        if !is_silent {
            assert_eq!(sigmas.map(|e| e.is_some()), [true; 3], "{second}");
            continue;
        }
        let sd = attitude.covariance_rad2[(1, 1)].sqrt();
        if attitude.pitch_rad.is_some() {
            assert!(sd > last_sd && sd <= told(&body).max_angle_sd_rad, "{second}: {sd}");
            (with_pitch, last_sd) = (with_pitch + 1, sd);
        } else {
            without += 1;
        }
    }
    assert!(with_pitch > 0 && without > 0, "{with_pitch} {without}");
}

#[test]
fn an_antenna_that_is_tagged_late_is_left_out_and_named() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(120.0, 2.0, 1.0), &RECTANGLE_M);
    let mut engine = engine(told(&body), &world);
    for second in 0..3 {
        let mut epoch = world.epoch(&body, f64::from(second));
        epoch.antennas[2].as_mut().unwrap().time += 0.02;
        let row = engine.push(&epoch);
        assert_eq!(row.status(), Status::Fixed, "{:?}", row.reason());
        assert_eq!(row.idle_antennas, [(2, Reason::TimeMismatch)]);
        assert_eq!((row.antennas, row.baselines.len()), (4, 2));
        assert!(errors_in_sigmas(&row, &body.attitude).iter().flatten().all(|e| e.abs() < 5.0));
    }
}

/// Where too few antennas are left, the row has the reason of most of those that are missing.
#[test]
fn the_reason_of_most_antennas_is_that_of_the_row() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(120.0, 2.0, 1.0), &RECTANGLE_M);
    let mut engine = engine(told(&body), &world);
    for late in 1..4 {
        let mut epoch = world.epoch(&body, 0.0);
        for antenna in (1..4).filter(|antenna| *antenna != late) {
            epoch.antennas[antenna].as_mut().unwrap().observations.truncate(3);
        }
        epoch.antennas[late].as_mut().unwrap().time += 0.02;
        let row = engine.push(&epoch);
        assert_eq!(row.reason(), Some(Reason::FewSatellites), "{late}: {:?}", row.idle_antennas);
        assert!(row.idle_antennas.contains(&(late, Reason::TimeMismatch)));
    }
}

/// Of two antennas whose places nobody knows the baseline is the forward axis, as certain as it is long.
#[test]
fn a_baseline_of_unknown_length_gives_heading_and_pitch() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(70.0, 10.0, 0.0), &[[0.0; 3], [4.0, 0.0, 0.0]]);
    let settings = Settings { array: None, constraint: Constraint::None, ..told(&body) };
    let mut engine = engine(settings, &world);
    for row in rows(&mut engine, &mut world, &body, 5) {
        let attitude = row.attitude().unwrap();
        let baseline = &row.baselines[0];
        let sd_up_m = baseline.covariance_m2[(2, 2)].sqrt();
        let pitch_sd_rad = attitude.covariance_rad2[(1, 1)].sqrt();
        // ∂pitch = ∂up / (b cos pitch) about a level baseline; ten degrees leave it within a few percent.
        assert!((pitch_sd_rad * 4.0 / sd_up_m - 1.0).abs() < 0.1, "{pitch_sd_rad} {sd_up_m}");
        assert!(errors_in_sigmas(&row, &body.attitude).iter().flatten().all(|e| e.abs() < 5.0));
    }
}

/// An antenna that shares too few satellites with the others has a position, but no baseline.
#[test]
fn an_antenna_among_other_satellites_is_left_out_and_named() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(120.0, 2.0, 1.0), &RECTANGLE_M);
    let mut engine = engine(told(&body), &world);
    for second in 0..3 {
        let mut epoch = world.epoch(&body, f64::from(second));
        let mut satellites: Vec<_> =
            epoch.antennas[3].as_ref().unwrap().observations.iter().map(|o| o.satellite).collect();
        satellites.dedup();
        let (apart, shared) = satellites.split_at(5);
        for (antenna, observed) in epoch.antennas.iter_mut().flatten().enumerate() {
            let seen = if antenna == 3 { [apart, &shared[..1]] } else { [shared, &[]] };
            observed.observations.retain(|o| seen.iter().any(|of| of.contains(&o.satellite)));
        }
        let row = engine.push(&epoch);
        assert_eq!(row.idle_antennas, [(3, Reason::FewSatellites)]);
        assert_eq!(row.baselines.len(), 2, "{:?}", row.reason());
        assert!(errors_in_sigmas(&row, &body.attitude).iter().flatten().all(|e| e.abs() < 5.0));
    }
}

/// An antenna with three satellites has no position and no baseline; the first one that has is the position's,
/// and the body's origin follows from *its* place.
#[test]
fn the_position_names_its_antenna_when_the_first_one_has_none() {
    let far_m = RECTANGLE_M.map(|place| place.map(|axis| 20.0 * axis));
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(200.0, 1.0, -2.0), &far_m);
    let mut engine = engine(told(&body), &world);
    for second in 0..3 {
        let mut epoch = world.epoch(&body, f64::from(second));
        epoch.antennas[0].as_mut().unwrap().observations.truncate(3);
        let row = engine.push(&epoch);
        assert_eq!(row.idle_antennas, [(0, Reason::FewSatellites)]);
        let error_m = position_error_m(&row, &body);
        if row.is_fixed() {
            assert_eq!(row.position.unwrap().antenna, None, "the origin of the body");
            assert!(error_m.xy().norm() < 5.0, "{error_m}");
        }
    }
    assert!(engine.push(&world.epoch(&body, 3.0)).is_fixed());
}

#[test]
fn each_lack_has_its_reason() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(0.0, 0.0, 0.0), &TRIANGLE_M);
    let whole = world.epoch(&body, 0.0);
    let reason = |navigation: kurs::NavigationData, change: &dyn Fn(&mut kurs::ArrayEpoch)| {
        let mut epoch = whole.clone();
        change(&mut epoch);
        let row = Engine::new(told(&body), navigation).unwrap().push(&epoch);
        (row.status(), row.reason().unwrap())
    };
    let known = || world.navigation.clone();
    let few_antennas = reason(known(), &|epoch| {
        (epoch.antennas[0], epoch.antennas[2]) = (None, None);
    });
    assert_eq!(few_antennas, (Status::Lost, Reason::FewAntennas));
    let nothing = reason(known(), &|epoch| epoch.antennas.fill(None));
    assert_eq!(nothing, (Status::Lost, Reason::FewAntennas));
    let no_ephemeris = reason(kurs::NavigationData::default(), &|_| {});
    assert_eq!(no_ephemeris, (Status::Lost, Reason::NoEphemeris));
    let few_satellites = reason(known(), &|epoch| {
        epoch.antennas.iter_mut().flatten().for_each(|a| a.observations.truncate(3));
    });
    assert_eq!(few_satellites, (Status::Lost, Reason::FewSatellites));
    let apart = reason(known(), &|epoch| {
        epoch.antennas[1].as_mut().unwrap().time += 0.05;
        epoch.antennas[2].as_mut().unwrap().time += 0.1;
    });
    assert_eq!(apart, (Status::Lost, Reason::TimeMismatch));
    let no_phase = reason(known(), &|epoch| {
        let all = epoch.antennas.iter_mut().flatten().flat_map(|a| &mut a.observations);
        all.for_each(|o| o.phase_cycles = None);
    });
    assert_eq!(no_phase, (Status::Float, Reason::NoPhase));
}

/// How well the antennas are surveyed is in the attitude: half a metre long arms, 5 cm.
#[test]
fn the_survey_of_the_array_is_in_the_covariance() {
    let half_m = TRIANGLE_M.map(|place| place.map(|axis| 0.5 * axis));
    let body = Motion::at_rest(degrees(10.0, 0.0, 0.0), &half_m);
    let sd_deg = |array_sd_m: f64| {
        let mut world = World::new().unwrap();
        let mut engine = engine(Settings { array_sd_m, ..told(&body) }, &world);
        let row = rows(&mut engine, &mut world, &body, 2).pop().unwrap();
        let attitude = *row.attitude().unwrap();
        let noise = attitude.noise_rad2()[(0, 0)].sqrt().to_degrees();
        (attitude.covariance_rad2[(0, 0)].sqrt().to_degrees(), noise)
    };
    let (exact, exact_noise) = sd_deg(0.0);
    assert!((exact - exact_noise).abs() < 1e-9, "{exact} {exact_noise}");
    let (rough, rough_noise) = sd_deg(0.02);
    // Two antennas at 2 cm each on half a metre: 2 √2 / 50 rad, a little less with the third one.
    assert!((1.8..3.3).contains(&rough), "{rough}");
    assert!(rough_noise < 0.7 * rough, "what does not average is not noise: {rough_noise}");
}

/// The first epoch of a right array, whose noise nobody knows yet, is not refused.
#[test]
fn a_right_array_is_not_refused_at_the_start() {
    let body = Motion::at_rest(degrees(300.0, 3.0, -4.0), &RECTANGLE_M);
    let (mut fixed, mut refused) = (0, 0);
    for seed in 1..=60 {
        let mut world = World::new().unwrap().with_seed(seed);
        (world.code_sd_m, world.phase_sd_m) = (0.3, 0.003);
        let row = engine(told(&body), &world).push(&world.epoch(&body, 0.0));
        fixed += usize::from(row.is_fixed());
        refused += usize::from(row.status() == Status::Inconsistent);
    }
    assert_eq!((fixed, refused), (60, 0));
}

/// What is known of the lengths never costs a fix that nothing known gives.
#[test]
fn lengths_fix_what_the_free_search_fixes() {
    let body = Motion::at_rest(degrees(300.0, 3.0, -4.0), &TRIANGLE_M);
    let fixed = |constraint| {
        let mut world = World::new().unwrap().with_seed(7);
        world.mask_rad = 25f64.to_radians();
        let mut engine = engine(Settings { constraint, ..told(&body) }, &world);
        rows(&mut engine, &mut world, &body, 30).iter().filter(|row| row.is_fixed()).count()
    };
    let (free, lengths, array) =
        (fixed(Constraint::None), fixed(Constraint::Length), fixed(Constraint::Array));
    assert!(free <= lengths && lengths <= array, "{free} {lengths} {array}");
    assert!(array >= 28, "{array}");
}

/// Ambiguities carried on from epoch to epoch find the same body.
#[test]
fn carried_ambiguities_find_the_same_body() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(15.0, -3.0, 4.0), &TRIANGLE_M);
    let ambiguities = Ambiguities::Continuous(Moves::Free);
    let mut engine = engine(Settings { ambiguities, ..told(&body) }, &world);
    for row in rows(&mut engine, &mut world, &body, 10).iter().skip(1) {
        assert!(row.is_fixed(), "{:?}", row.outcome);
        assert!(errors_in_sigmas(row, &body.attitude).iter().flatten().all(|e| e.abs() < 4.5));
    }
}

/// A body and a station 2 km away that is antenna 3 of the world, after what `change` does to their epochs.
fn beside_a_station(change: impl Fn(&mut ArrayEpoch)) -> (Motion, Vec<EpochSolution>) {
    let with_station = [TRIANGLE_M.to_vec(), vec![[2000.0, 0.0, 0.0]]].concat();
    let all = Motion::at_rest(degrees(0.0, 0.0, 0.0), &with_station);
    let body = Motion::at_rest(all.attitude, &TRIANGLE_M);
    let mut world = World::new().unwrap();
    let station_m = all.antenna_m(3, all.start);
    let mut engine = Differential::new(engine(told(&body), &world), Some(station_m)).unwrap();
    let rows = (0..3).map(|second| {
        let mut epoch = world.epoch(&all, f64::from(second));
        epoch.station = epoch.antennas.pop().unwrap();
        change(&mut epoch);
        engine.push(&epoch, None)
    });
    let rows = rows.collect();
    (body, rows)
}

#[test]
fn coordinates_relative_to_a_station() {
    let (body, rows) = beside_a_station(|_| ());
    for row in rows {
        assert_eq!(row.by_code.iter().map(|place| place.index).collect::<Vec<_>>(), [0, 1, 2]);
        for place in &row.by_code {
            let true_m = body.antenna_m(place.index, row.time);
            let off_m = (place.geodetic.to_ecef() - true_m).norm();
            assert!(off_m < 3.0, "{off_m}");
        }
        let position = row.position.unwrap();
        if position.origin == PositionOrigin::StationPhase {
            assert!(position_error_m(&row, &body).norm() < 0.05);
        }
    }
}

/// A station with three satellites has nothing to say; it is not replaced by an antenna.
#[test]
fn a_station_with_three_satellites_is_no_antenna() {
    let (body, rows) = beside_a_station(|epoch| {
        epoch.station.as_mut().unwrap().observations.truncate(3);
    });
    for row in rows {
        assert!(row.is_fixed());
        assert_eq!(row.position.unwrap().origin, PositionOrigin::Alone);
        assert!(position_error_m(&row, &body).xy().norm() < 5.0);
        for place in &row.by_code {
            let off_m = (place.geodetic.to_ecef() - body.antenna_m(place.index, row.time)).norm();
            assert!(off_m < 30.0, "{off_m}");
        }
    }
}

/// What a receiver says to be spoofed moves no coordinates; the attitude has nothing of the station.
#[test]
fn no_coordinates_come_of_a_spoofed_station_or_antenna() {
    let spoofed = Interference { spoofing: Spoofing::Stated, ..Interference::default() };
    let (_, rows) = beside_a_station(|epoch| {
        epoch.station.as_mut().unwrap().interference = spoofed;
    });
    for row in rows {
        assert!(row.is_fixed() && row.by_code.is_empty());
        assert_eq!(row.position.unwrap().origin, PositionOrigin::Alone);
    }
    let (_, rows) = beside_a_station(|epoch| {
        epoch.antennas[1].as_mut().unwrap().interference = spoofed;
    });
    for row in rows {
        assert_eq!(row.reason(), Some(Reason::Interference));
        assert!(row.by_code.is_empty());
    }
}

/// A first antenna at a known place that is silent: no other is put there.
#[test]
fn nothing_takes_the_place_of_a_silent_station() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(120.0, 2.0, 1.0), &RECTANGLE_M);
    let far_m = body.antenna_m(0, body.start) + Vector::new(3000.0, 2000.0, -1000.0);
    let mut engine = engine(Settings { first_antenna_m: Some(far_m), ..told(&body) }, &world);
    for second in 0..3 {
        let mut epoch = world.epoch(&body, f64::from(second));
        epoch.antennas[0] = None;
        let row = engine.push(&epoch);
        assert!(row.is_fixed(), "{:?}", row.outcome);
        assert!(errors_in_sigmas(&row, &body.attitude).iter().flatten().all(|e| e.abs() < 5.0));
        assert!(position_error_m(&row, &body).xy().norm() < 5.0);
    }
}

/// Reflections put six to forty metres on the code of every fourth satellite for as long as the session lasts: its
/// outliers do not tell how noisy the phases are.
#[test]
fn reflected_code_of_a_quarter_of_the_satellites_costs_no_fix() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(70.0, 2.0, -3.0), &TRIANGLE_M);
    world.signals = ["G1C", "G2L", "E1C", "E5Q"].map(|signal| signal.parse().unwrap()).to_vec();
    let mut engine = engine(told(&body), &world);
    let mut fixed = 0;
    for second in 0..150 {
        let mut epoch = world.epoch(&body, f64::from(second));
        for (antenna, observed) in epoch.antennas.iter_mut().enumerate() {
            for observation in &mut observed.as_mut().unwrap().observations {
                let number = usize::from(observation.satellite.number) + antenna;
                let late_m = 6.0 + 34.0 * ((7 * number) % 10) as f64 / 9.0;
                if let (0, Some(code_m)) = (number % 4, &mut observation.pseudorange_m) {
                    *code_m += late_m;
                }
            }
        }
        let row = engine.push(&epoch);
        fixed += usize::from(second >= 50 && row.is_fixed());
    }
    assert!(fixed >= 98, "{fixed} of 100");
}
