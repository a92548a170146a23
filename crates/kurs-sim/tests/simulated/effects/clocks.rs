//! `[clock]` and `tag_offset_s`.

use kurs::signal::SPEED_OF_LIGHT_MPS;
use kurs_sim::scenario::Scenario;

use super::scene::{Run, assert_sd, by_signal, rms, roof};

const MILLISECOND_S: f64 = 1e-3;

/// Clock errors of all receivers of the first body at an epoch.
fn clocks(run: &Run, epoch: usize) -> &[f64] {
    &run.epochs[epoch].bodies[0].truth.clocks_s
}

/// Values of `of` for both antennas of many seeds.
fn drawn(change: impl Fn(&mut Scenario), of: impl Fn(&Run, usize) -> f64) -> Vec<f64> {
    let mut all = Vec::new();
    for seed in 0..300 {
        let run = roof(|scenario| {
            scenario.seed = seed;
            scenario.sky.systems = vec!["J".to_owned()];
            scenario.clock.millisecond_jumps = false;
            change(scenario);
        });
        all.extend([0, 1].map(|antenna| of(&run, antenna)));
    }
    all
}

/// Error, rate and wandering of the rate are drawn with the standard deviations asked for.
#[test]
fn clocks_are_as_bad_as_asked() {
    let bias = drawn(|s| s.clock.bias_sd_s = 2e-5, |run, antenna| clocks(run, 0)[antenna]);
    assert_sd("bias", rms(bias.iter().copied()), 2e-5, bias.len());
    let gained = |run: &Run, antenna| (clocks(run, 4)[antenna] - clocks(run, 0)[antenna]) / 4.0;
    let rate = drawn(|s| s.clock.drift_sd = 3e-8, gained);
    assert_sd("rate", rms(rate.iter().copied()), 3e-8, rate.len());
    // The random walk of a rate of 1e-8 after one second: of the clock, √(T³/3) after T.
    let wander = drawn(|s| s.clock.wander = 1e-8, |run, antenna| clocks(run, 4)[antenna]);
    assert_sd("wander", rms(wander.iter().copied()), 1e-8 * f64::sqrt(64.0 / 3.0), wander.len());
}

#[test]
fn receivers_share_a_clock_or_have_their_own() {
    for common in [true, false] {
        let run = roof(|scenario| {
            scenario.clock.common = common;
            (scenario.clock.bias_sd_s, scenario.clock.drift_sd) = (1e-4, 1e-7);
        });
        for epoch in 0..run.epochs.len() {
            let [one, other] = clocks(&run, epoch) else { panic!("two receivers") };
            assert_eq!(one == other, common);
        }
    }
}

/// A clock that is ahead (its tag later than GPST) makes code and phase longer by as much, less what
/// the satellite moves in that time, and a fast clock takes from the Doppler shift.
#[test]
fn a_clock_that_is_ahead_makes_ranges_longer() {
    let with = roof(|scenario| {
        (scenario.clock.bias_sd_s, scenario.clock.drift_sd) = (1e-4, 1e-7);
        scenario.clock.millisecond_jumps = false;
    });
    let plain = roof(|_| ());
    for change in with.less(&plain) {
        let clock_s = clocks(&with, change.epoch)[change.antenna];
        let rate = (clocks(&with, 4)[change.antenna] - clocks(&with, 0)[change.antenna]) / 4.0;
        let before = by_signal(plain.antenna(change.epoch, change.antenna));
        let doppler_hz = before[&(change.satellite, change.signal)].doppler_hz.unwrap();
        let range_rate_mps = -doppler_hz * change.wavelength_m;
        let wanted_m = SPEED_OF_LIGHT_MPS * clock_s - range_rate_mps * clock_s;
        assert!((change.code_m - wanted_m).abs() < 1e-3, "{change:?}: {wanted_m}");
        assert!((change.phase_m() - wanted_m).abs() < 1e-3, "{change:?}: {wanted_m}");
        let wanted_hz = -SPEED_OF_LIGHT_MPS * rate / change.wavelength_m;
        assert!((change.doppler_hz - wanted_hz).abs() < 0.01, "{change:?}: {wanted_hz}");
    }
}

/// With jumps a clock stays within half a millisecond, and jumps by a whole one; code and phase with it.
#[test]
fn clocks_jump_by_milliseconds() {
    let fast = |millisecond_jumps| {
        roof(|scenario| {
            scenario.seed = 4;
            scenario.duration_s = 90.0;
            scenario.clock.drift_sd = 1e-4;
            scenario.clock.millisecond_jumps = millisecond_jumps;
        })
    };
    let (jumping, free) = (fast(true), fast(false));
    let mut jumps = 0;
    for epoch in 1..jumping.epochs.len() {
        for antenna in [0, 1] {
            let now_s = clocks(&jumping, epoch)[antenna];
            let apart = (clocks(&free, epoch)[antenna] - now_s) / MILLISECOND_S;
            assert!((apart - apart.round()).abs() < 1e-9, "{apart} ms");
            assert!(now_s.abs() <= MILLISECOND_S / 2.0 + 1e-15, "{now_s}");
            let before_s = clocks(&jumping, epoch - 1)[antenna];
            jumps += usize::from((now_s - before_s).abs() > 0.5 * MILLISECOND_S);
        }
    }
    assert!(jumps >= 3, "{jumps} jumps");
    for change in jumping.less(&free) {
        let of = |run| clocks(run, change.epoch)[change.antenna];
        let apart_s = of(&jumping) - of(&free);
        // 800 m/s of the satellite make 0.8 m in a millisecond.
        let rest = change.code_m / SPEED_OF_LIGHT_MPS - apart_s;
        assert!(rest.abs() <= 4e-6 * apart_s.abs(), "{change:?}: {apart_s}");
        assert!((change.phase_m() - change.code_m).abs() < 1e-4, "{change:?}");
    }
}

/// An antenna whose tags are off measured when its tags say: half an interval and a microsecond.
#[test]
fn tags_are_off_and_measured_at() {
    let fine = roof(|scenario| scenario.interval_s = 0.5);
    for offset_s in [0.5, -0.5, 1e-6] {
        let late = roof(|scenario| scenario.body[0].antenna[1].tag_offset_s = offset_s);
        for epoch in 1..late.epochs.len() - 1 {
            let tag = late.antenna(epoch, 1).time;
            assert!((tag - late.antenna(epoch, 0).time - offset_s).abs() < 1e-9);
            let fine_epoch = if offset_s > 0.1 { 2 * epoch + 1 } else { 2 * epoch - 1 };
            let (reference, dt_s) = match offset_s {
                1e-6 => (by_signal(late.antenna(epoch, 0)), offset_s),
                _ => (by_signal(fine.antenna(fine_epoch, 1)), 0.0),
            };
            for (key, o) in by_signal(late.antenna(epoch, 1)) {
                let Some(at) = reference.get(&key) else { continue };
                let off_m = o.pseudorange_m.unwrap() - at.pseudorange_m.unwrap();
                // A microsecond is a millimetre; both antennas are 1.5 m apart.
                let within_m = if dt_s > 0.0 { 1.5 + 1e-3 } else { 1e-5 };
                assert!(off_m.abs() < within_m, "{key:?} {offset_s}: {off_m}");
            }
        }
    }
}

/// Every receiver adds a constant fraction of a cycle to all phases of a signal: the same for every
/// satellite, another one for another signal or receiver.
#[test]
fn receivers_have_fractions_of_a_cycle() {
    let with = roof(|scenario| scenario.clock.phase_bias = true);
    let mut fractions = std::collections::BTreeMap::new();
    for change in with.less(&roof(|_| ())) {
        let fraction = change.phase_cycles.rem_euclid(1.0);
        let known = *fractions.entry((change.antenna, change.signal)).or_insert(fraction);
        let off = (fraction - known + 0.5).rem_euclid(1.0) - 0.5;
        assert!(off.abs() < 1e-5, "{change:?}: {fraction} {known}");
        assert_eq!(change.code_m, 0.0);
    }
    let mut all: Vec<f64> = fractions.into_values().collect();
    all.sort_by(f64::total_cmp);
    assert!(all.len() > 10 && all.windows(2).all(|two| two[1] - two[0] > 1e-6), "{all:?}");
}
