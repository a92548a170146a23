//! `[[wall]]`, `[[canopy]]`, `[noise] gain_sd_db` and `tracking_dbhz`.

use std::collections::BTreeMap;

use kurs::signal::{Satellite, Signal};
use kurs_sim::scenario::{Canopy, Scenario, Wall};

use super::scene::{Change, Run, assert_sd, by_signal, names, rms, roof};

/// What a change does to a run without any, epochs 10 s apart.
fn effect(change: impl Fn(&mut Scenario)) -> (Run, Vec<Change>) {
    let [with, without] = [true, false].map(|with| {
        roof(|scenario| {
            (scenario.duration_s, scenario.interval_s) = (600.0, 10.0);
            if with {
                change(scenario);
            }
        })
    });
    let changes = with.less(&without);
    (with, changes)
}

/// A long wall in the south, 5 m away and 4 m high: C/N0 falls as ITU-R P.526 says, and in the shadow
/// the phase is late by nearly λ/8 + h²/(2d) on every wavelength, the code not at all.
#[test]
fn a_wall_diffracts() {
    let wall = Wall { from_m: [-500.0, -5.0], to_m: [500.0, -5.0], height_m: 4.0, reflection: 0.0 };
    let (run, changes) = effect(|scenario| scenario.wall.push(wall));
    let (mut lit, mut shadowed) = (0, 0);
    for change in changes.iter().filter(|c| c.antenna == 0) {
        let (azimuth, elevation) = run.direction_rad(change.epoch, change.satellite);
        let south = -azimuth.cos() * elevation.cos();
        if south < 0.05 {
            assert!(south > 0.0 || change.cn0_db.abs() < 2.0, "{change:?}");
            continue;
        }
        // Where the way of the signal passes the wall, and the shortest way from there to its top.
        let d_m = 5.0 / south;
        let h_m = (4.0 - d_m * elevation.sin()) * south / south.hypot(elevation.sin());
        let v = h_m * (2.0 / (change.wavelength_m * d_m)).sqrt();
        let from = v - 0.1;
        let loss_db = 6.9 + 20.0 * (f64::hypot(from, 1.0) + from).log10();
        assert!(change.code_m.abs() < 1e-6, "{change:?}");
        if (-0.7..2.4).contains(&v) {
            // C/N0 is reported with 0.3 dB of scatter, here and without the wall.
            assert!((change.cn0_db + loss_db).abs() < 2.4, "{v}: {loss_db} dB, {change:?}");
        }
        if v < -1.2 {
            lit += 1;
            assert!(change.phase_cycles.abs() < 0.045, "{change:?}");
        } else if (0.8..1.15).contains(&v) {
            shadowed += 1;
            let late_cycles = 0.125 + h_m * h_m / (2.0 * d_m * change.wavelength_m);
            let off_cycles = (change.phase_cycles - late_cycles).abs();
            assert!(off_cycles < 0.045, "{v}: {late_cycles} cycles, {change:?}");
        }
    }
    assert!(lit > 20 && shadowed > 20, "{lit} lit, {shadowed} in the shadow");
}

/// A wall in the north throws back satellites of the south: the code of both antennas swings by up to
/// the echo's way times its amplitude, on either side, and the phase by no more than its sine.
#[test]
fn a_wall_reflects() {
    let wall = Wall { from_m: [-500.0, 6.0], to_m: [500.0, 6.0], height_m: 90.0, reflection: 0.2 };
    let (run, changes) = effect(|scenario| scenario.wall.push(wall));
    let (mut most_m, mut least_m) = (0.0, 0.0);
    for change in &changes {
        let (azimuth, elevation) = run.direction_rad(change.epoch, change.satellite);
        let delay_m = -12.0 * azimuth.cos() * elevation.cos();
        if delay_m < 2.0 || elevation > 1.2 {
            continue;
        }
        let share = change.code_m / delay_m;
        assert!((-0.27..0.18).contains(&share), "{share} of {delay_m} m: {change:?}");
        (most_m, least_m) = (f64::max(most_m, share), f64::min(least_m, share));
        let turned = (change.phase_cycles - change.phase_cycles.round()).abs();
        assert!(turned < 0.2f64.asin() / core::f64::consts::TAU + 0.005, "{change:?}");
    }
    assert!(most_m > 0.15 && least_m < -0.2, "{most_m} {least_m}");
}

fn leaves() -> Canopy {
    Canopy {
        antennas: names(&["A1"]),
        sky_deg: vec![[0.0, 180.0, 90.0]],
        loss_db: 20.0,
        loss_sd_db: 2.0,
        loss_correlation_s: 0.1,
        late_m_per_db: 0.003,
        scattered_share: 0.0,
        scatter_correlation_s: 1.0,
        code_tails_per_hour: 0.0,
    }
}

/// Leaves take their loss from C/N0 and make phases late, alike in metres on all signals of a satellite;
/// only above their antenna, only in their part of the sky.
#[test]
fn leaves_weaken_and_delay() {
    let (run, changes) = effect(|scenario| scenario.canopy.push(leaves()));
    let mut losses_db = Vec::new();
    let mut late: BTreeMap<(usize, Satellite), Vec<f64>> = BTreeMap::new();
    for change in &changes {
        let east = run.direction_rad(change.epoch, change.satellite).0.sin();
        // Whole cycles are drawn anew where leaves take random numbers.
        let late_m = (change.phase_cycles - change.phase_cycles.round()) * change.wavelength_m;
        if change.antenna == 0 || east < -0.01 {
            assert!(late_m.abs() < 1e-5, "{change:?}");
        } else if east > 0.01 {
            losses_db.push(-change.cn0_db);
            late.entry((change.epoch, change.satellite)).or_default().push(late_m - 0.06);
        }
    }
    let mean_db = losses_db.iter().sum::<f64>() / losses_db.len() as f64;
    assert!((mean_db - 20.0).abs() < 0.3, "{mean_db} dB");
    // Scatter of the loss and, twice, of the report.
    let sd_db = f64::sqrt(2.0 * 2.0 + 2.0 * 0.3 * 0.3);
    let of_satellites: usize = late.len();
    assert_sd("loss", rms(losses_db.iter().map(|db| db - mean_db)), sd_db, of_satellites);
    for late_m in late.values() {
        assert!(late_m.iter().all(|m| (m - late_m[0]).abs() < 1e-4), "{late_m:?}");
    }
    let scatter_m = rms(late.values().map(|late_m| late_m[0]));
    assert_sd("late", scatter_m, 0.003 * 2.0, of_satellites);
}

/// Pseudoranges under leaves are off by 5 to 30 standard deviations, alike for all signals of a
/// satellite, for 10 to 100 s, as often as asked.
#[test]
fn codes_have_tails_under_leaves() {
    let (_, changes) = effect(|scenario| {
        scenario.noise.code_sd_m = 1.0;
        (scenario.duration_s, scenario.interval_s) = (3000.0, 10.0);
        let tails = Canopy { loss_db: 0.0, loss_sd_db: 0.0, code_tails_per_hour: 12.0, ..leaves() };
        scenario.canopy.push(Canopy { sky_deg: vec![[0.0, 360.0, 90.0]], ..tails });
    });
    // Noise of one standard deviation remains.
    let is_off = |c: &&Change| c.code_m.abs() > 4.5;
    assert!(!changes.iter().any(|c| c.antenna == 0 && c.code_m.abs() > 6.0));
    let off: Vec<&Change> = changes.iter().filter(|c| c.antenna == 1).filter(is_off).collect();
    assert!(off.iter().all(|c| c.code_m.abs() < 35.0), "{off:?}");
    let sizes_m = off.iter().map(|c| c.code_m.abs());
    let mean_m = sizes_m.sum::<f64>() / off.len() as f64;
    assert!((mean_m - 17.5).abs() < 2.0, "{mean_m}");
    // 12 an hour, 55 s each, not while another one lasts: r T / (1 + r T).
    let all = changes.iter().filter(|c| c.antenna == 1).count();
    let share = off.len() as f64 / all as f64;
    let wanted = 12.0 * 60.0 / 3600.0;
    let wanted = wanted / (1.0 + wanted);
    assert!((share / wanted - 1.0).abs() < 0.15, "{share}, wanted {wanted}");
    let mut runs: BTreeMap<Satellite, Vec<usize>> = BTreeMap::new();
    for change in &off {
        runs.entry(change.satellite).or_default().push(change.epoch);
    }
    let longest = runs.values_mut().map(|epochs| {
        epochs.dedup();
        let breaks = epochs.windows(2).enumerate().filter(|(_, pair)| pair[1] > pair[0] + 1);
        let mut last = 0;
        let mut longest = breaks.map(|(k, _)| k + 1 - core::mem::replace(&mut last, k + 1)).max();
        *longest.get_or_insert(epochs.len())
    });
    let longest = longest.max().unwrap();
    assert!((8..=20).contains(&longest), "{longest} epochs of 10 s");
}

/// Where scattered fields outweigh the straight one, phases go round: whole cycles slip, flagged or not
/// as asked, and the phase less its whole cycles stays within half a cycle of the straight way.
#[test]
fn fading_phases_slip() {
    let [with, without] = [0.05, 0.0].map(|scattered_share| {
        roof(|scenario| {
            (scenario.duration_s, scenario.interval_s) = (600.0, 10.0);
            scenario.slips.flagged_share = 0.4;
            let fading = Canopy { scattered_share, late_m_per_db: 0.0, ..leaves() };
            scenario.canopy.push(fading);
        })
    });
    let changes = with.epochs.iter().flat_map(|epoch| &epoch.changes);
    let slips: Vec<_> = changes.filter(|change| change.slip.is_some()).collect();
    assert!(slips.len() > 200, "{}", slips.len());
    assert!(slips.iter().all(|slip| slip.antenna == "A1" && slip.slip.unwrap().abs() == 1));
    let flagged = slips.iter().filter(|slip| slip.flagged).count() as f64 / slips.len() as f64;
    assert!((flagged - 0.4).abs() < 0.1, "{flagged}");
    let [cycles_with, cycles_without] = [&with, &without].map(last_cycles);
    for change in with.less(&without).iter().filter(|c| c.epoch == with.epochs.len() - 1) {
        let key = (["A0", "A1"][change.antenna], change.satellite, change.signal);
        let drawn = (cycles_with[&key] - cycles_without[&key]) as f64;
        assert!((change.phase_cycles - drawn).abs() < 0.5 + 1e-5, "{change:?} {drawn}");
    }
}

/// The whole cycles that hold at the end.
fn last_cycles(run: &Run) -> BTreeMap<(&str, Satellite, Signal), i64> {
    let changes = run.epochs.iter().flat_map(|epoch| &epoch.changes);
    changes.map(|c| ((c.antenna.as_str(), c.satellite, c.signal), c.cycles)).collect()
}

/// The gain of an antenna towards a satellite has its size, is the antenna's own and lasts.
#[test]
fn antennas_have_gains_of_their_own() {
    let (_, changes) = effect(|scenario| scenario.noise.gain_sd_db = 3.0);
    let first: Vec<&Change> = changes.iter().filter(|c| c.epoch == 0).collect();
    let mut gains: BTreeMap<(usize, Satellite), f64> = BTreeMap::new();
    for change in &first {
        gains.insert((change.antenna, change.satellite), change.cn0_db);
    }
    let sd_db = f64::sqrt(3.0 * 3.0 + 2.0 * 0.3 * 0.3);
    assert_sd("gain", rms(gains.values().copied()), sd_db, gains.len());
    let of_second = gains.iter().filter(|((antenna, _), _)| *antenna == 1);
    let difference = of_second.map(|((_, satellite), db)| db - gains[&(0, *satellite)]);
    assert_sd("difference", rms(difference), sd_db * 2f64.sqrt(), gains.len() / 2);
    let later = changes.iter().filter(|c| c.epoch == 6);
    let moved = rms(later.map(|c| c.cn0_db - gains[&(c.antenna, c.satellite)]));
    assert!(moved < 1.2, "{moved} dB in a minute");
}

/// Signals below the threshold are not there, and come back with a flag.
#[test]
fn weak_signals_are_not_tracked() {
    let run = roof(|scenario| scenario.noise.tracking_dbhz = 45.0);
    let (mut strong, mut all) = (0, 0);
    let plain = roof(|_| ());
    for observation in by_signal(plain.antenna(0, 0)).values() {
        let sin = plain.direction_rad(0, observation.satellite).1.sin();
        let is_strong = 50.0 - 15.0 * (1.0 - sin) >= 45.0;
        let key = (observation.satellite, observation.signal);
        assert_eq!(by_signal(run.antenna(0, 0)).contains_key(&key), is_strong, "{observation:?}");
        (strong, all) = (strong + usize::from(is_strong), all + 1);
    }
    assert!(strong > 10 && strong < all, "{strong} of {all}");
}
