//! `[sky]`, `signals` and the masks of antennas.

use std::collections::{BTreeMap, BTreeSet};

use kurs::signal::Satellite;
use kurs_sim::scenario::MotionPlan;
use kurs_sim::simulation::Attachments;

use super::scene::{Run, assert_sd, by_signal, names, rms, roof, run, signal};

/// Without errors code less its group delay and phase less its whole cycles are the same distance, on
/// every signal of every system: frequencies, GLONASS channels and `ambiguities.csv` are right.
#[test]
fn code_and_phase_measure_one_distance() {
    let run = roof(|_| ());
    let mut systems = BTreeSet::new();
    for change in &run.epochs[0].changes {
        let antenna = usize::from(change.antenna == "A1");
        let key = (change.satellite, change.signal);
        for epoch in 0..run.epochs.len() {
            let Some(o) = by_signal(run.antenna(epoch, antenna)).get(&key).copied() else {
                continue;
            };
            let delay_m = run.record(change.satellite).group_delay_m(change.signal).unwrap_or(0.0);
            let by_code_m = o.pseudorange_m.unwrap() - delay_m;
            let cycles = o.phase_cycles.unwrap() - change.cycles as f64;
            let by_phase_m = cycles * run.wavelength_m(change.signal, change.satellite);
            assert!((by_code_m - by_phase_m).abs() < 1e-6, "{key:?}: {by_code_m} {by_phase_m}");
        }
        systems.insert(change.satellite.system);
    }
    assert_eq!(systems.len(), 5, "{systems:?}");
}

/// Doppler is the rate of the distance, with the sign of RINEX: positive when it shrinks.
#[test]
fn doppler_is_the_rate_of_the_phase() {
    let run = roof(|scenario| scenario.interval_s = 0.1);
    let [before, now, after] = [0, 1, 2].map(|epoch| by_signal(run.antenna(epoch, 0)));
    for (key, o) in &now {
        let (Some(before), Some(after)) = (before.get(key), after.get(key)) else { continue };
        let rate = (after.phase_cycles.unwrap() - before.phase_cycles.unwrap()) / 0.2;
        assert!((o.doppler_hz.unwrap() + rate).abs() < 0.01, "{key:?}: {o:?} {rate}");
    }
}

#[test]
fn systems_are_those_asked_for() {
    for (letter, most) in [("G", 24), ("R", 24), ("E", 24), ("C", 30), ("J", 4)] {
        let run = roof(|scenario| scenario.sky.systems = names(&[letter]));
        let satellites = run.satellites(0, 0);
        assert!((2..=most).contains(&satellites.len()), "{letter}: {satellites:?}");
        assert!(satellites.iter().all(|s| s.system.letter().to_string() == letter));
        // Every satellite that was asked for has records, the invisible ones too.
        let records = run.simulation.navigation().ephemerides.iter().map(|r| r.satellite());
        assert_eq!(records.collect::<BTreeSet<_>>().len(), most, "{letter}");
    }
}

/// Geostationary, inclined and medium orbits of BeiDou are in one sky of East Asia.
#[test]
fn beidou_has_three_kinds_of_orbits() {
    let run = roof(|scenario| scenario.sky.systems = names(&["C"]));
    let seen = run.satellites(0, 0);
    let count = |numbers: core::ops::RangeInclusive<u8>| {
        seen.iter().filter(|s| numbers.contains(&s.number)).count()
    };
    assert_eq!(count(59..=61), 3, "{seen:?}");
    assert!(count(38..=40) >= 1 && count(19..=37) + count(41..=46) >= 4, "{seen:?}");
}

/// Signals of one antenna are its own; the others keep those of the scenario.
#[test]
fn antennas_track_signals_of_their_own() {
    let run = roof(|scenario| {
        scenario.signals = names(&["G1C", "G2W", "E1C"]);
        scenario.body[0].antenna[1].signals = Some(names(&["G1W", "G5Q", "E5Q"]));
    });
    for (antenna, wanted) in [(0, ["G1C", "G2W", "E1C"]), (1, ["G1W", "G5Q", "E5Q"])] {
        let found: BTreeSet<_> =
            run.antenna(0, antenna).observations.iter().map(|o| o.signal).collect();
        assert_eq!(found, wanted.map(signal).into_iter().collect(), "antenna {antenna}");
    }
}

/// Orbits of a navigation file take the place of the built-in ones, all systems of the file.
#[test]
fn orbits_of_a_navigation_file_are_used() {
    let other = roof(|scenario| {
        scenario.seed = 99;
        scenario.sky.systems = names(&["R", "E"]);
    });
    let navigation = Some(other.simulation.navigation().clone());
    let scenario = roof(|_| ()).simulation.scenario().clone();
    let run = run(scenario, &Attachments { navigation, recorded: Vec::new() });
    assert_eq!(run.satellites(0, 0), other.satellites(0, 0));
    let changes = run.less(&other);
    assert!(changes.iter().all(|change| change.code_m.abs() < 1e-6));
}

#[test]
fn the_highest_satellites_are_kept() {
    let all = roof(|_| ());
    let few = roof(|scenario| scenario.sky.max_satellites = Some(7));
    let mut by_height = all.satellites(0, 0);
    let height = |s: &Satellite| all.direction_rad(0, *s).1;
    by_height.sort_by(|a, b| height(b).total_cmp(&height(a)));
    let mut wanted = by_height[..7].to_vec();
    wanted.sort_unstable();
    assert_eq!(few.satellites(0, 0), wanted);
    assert_eq!(few.satellites(4, 1), wanted);
}

/// Satellites that `less` tracks are those of `all` for which `stays` holds; some are hidden.
fn assert_hidden(all: &Run, less: &Run, antenna: usize, stays: impl Fn(f64, f64) -> bool) {
    let wanted: Vec<Satellite> = all
        .satellites(0, antenna)
        .into_iter()
        .filter(|s| {
            let (azimuth, elevation) = all.direction_rad(0, *s);
            stays(azimuth.to_degrees().rem_euclid(360.0), elevation.to_degrees())
        })
        .collect();
    assert_eq!(less.satellites(0, antenna), wanted);
    assert!(wanted.len() < all.satellites(0, antenna).len(), "nothing was hidden");
}

#[test]
fn nothing_is_tracked_below_the_mask() {
    let all = roof(|_| ());
    let less = roof(|scenario| scenario.sky.elevation_mask_deg = 25.0);
    assert_hidden(&all, &less, 0, |_, elevation| elevation > 25.0);
    // A lower mask shows more, but never through the Earth.
    let more = roof(|scenario| scenario.sky.elevation_mask_deg = -90.0);
    assert_hidden(&more, &all, 0, |_, elevation| elevation > 5.0);
    let lowest =
        more.satellites(0, 0).iter().map(|s| more.direction_rad(0, *s).1).fold(9.0, f64::min);
    assert!(lowest.to_degrees() > -0.6, "{}°", lowest.to_degrees());
}

#[test]
fn obstacles_of_the_place_are_from_north() {
    let all = roof(|_| ());
    let less = roof(|scenario| scenario.sky.horizon_deg = vec![[60.0, 200.0, 40.0]]);
    for antenna in [0, 1] {
        assert_hidden(&all, &less, antenna, |azimuth, elevation| {
            !(60.0..=200.0).contains(&azimuth) || elevation >= 40.0
        });
    }
}

/// The body heads east: what is forward of it is at 90°. Only the antenna with the mask is blind.
#[test]
fn masks_of_the_body_turn_with_it() {
    let all = roof(|_| ());
    let less = roof(|scenario| scenario.body[0].antenna[1].mask_deg = vec![[-40.0, 70.0, 50.0]]);
    assert_eq!(less.satellites(0, 0), all.satellites(0, 0));
    assert_hidden(&all, &less, 1, |azimuth, elevation| {
        !(50.0..=160.0).contains(&azimuth) || elevation >= 50.0
    });
    // Rolled by 90° to the right, heading east, the body's upward axis points to the south.
    let rolled = |mask_deg| {
        roof(|scenario| {
            if let MotionPlan::Static { roll_deg, .. } = &mut scenario.body[0].motion {
                *roll_deg = 90.0;
            }
            scenario.body[0].antenna[1].mask_deg = mask_deg;
        })
    };
    let (all, less) = (rolled(vec![]), rolled(vec![[0.0, 360.0, 30.0]]));
    assert_hidden(&all, &less, 1, |azimuth, elevation| {
        let south = -azimuth.to_radians().cos() * elevation.to_radians().cos();
        south >= 0.5
    });
}

/// True orbits and clocks differ from the broadcast ones by this, code and phase alike, for all
/// antennas alike.
#[test]
fn orbits_and_clocks_are_off_as_asked() {
    for orbits in [true, false] {
        let mut all = Vec::new();
        for seed in 0..8 {
            let [with, without] = [1.5, 0.0].map(|sd_m| {
                roof(|scenario| {
                    scenario.seed = 100 + seed;
                    let sky = &mut scenario.sky;
                    *(if orbits { &mut sky.orbit_error_sd_m } else { &mut sky.clock_error_sd_m }) =
                        sd_m;
                })
            });
            let changes = with.less(&without);
            for change in &changes {
                assert!((change.phase_m() - change.code_m).abs() < 1e-5, "{change:?}");
            }
            let first = |antenna| {
                let of_first = changes.iter().filter(move |c| c.epoch == 0 && c.antenna == antenna);
                of_first.map(|c| (c.satellite, c.code_m)).collect::<BTreeMap<_, _>>()
            };
            for ((_, a), (_, b)) in first(0).into_iter().zip(first(1)) {
                assert!((a - b).abs() < 1e-5, "{a} {b}");
            }
            all.extend(first(0).into_values());
        }
        // An error of an orbit counts by its part along the line of sight: one axis of three.
        assert_sd(
            if orbits { "orbits" } else { "clocks" },
            rms(all.iter().copied()),
            1.5,
            all.len(),
        );
    }
}
