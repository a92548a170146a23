//! `[noise]`, `[multipath]`, `[[interference]]`.

use kurs_sim::scenario::{Interference, Law, Scenario};

use super::scene::{Change, SIGMAS, assert_sd, by_signal, names, rms, roof, signal};

/// What a change of the noise does to a run without any, long enough for statistics.
fn effect(change: impl Fn(&mut Scenario)) -> Vec<Change> {
    let [with, without] = [true, false].map(|with| {
        roof(|scenario| {
            (scenario.duration_s, scenario.interval_s) = (400.0, 10.0);
            if with {
                change(scenario);
            }
        })
    });
    with.less(&without)
}

fn noisy(law: Law) -> Vec<Change> {
    effect(|scenario| {
        scenario.noise.law = law;
        scenario.noise.code_sd_m = 0.3;
        scenario.noise.phase_sd_cycles = 0.02;
        scenario.noise.doppler_sd_hz = 0.1;
    })
}

/// Noise of all three quantities has the size that its law gives it, for satellites high and low, and
/// nothing in common between them, between antennas, or from epoch to epoch.
#[test]
fn noise_follows_its_law() {
    for (law, code, phase) in [
        (Law::Flat, (|_| 1.0) as fn(f64) -> f64, (|_| 1.0) as fn(f64) -> f64),
        (Law::Elevation, |sin| (1.0 / sin).min(3.5), |sin| (1.0 / sin).min(3.5)),
        (Law::Mixed, |sin| 1.0 / sin, |sin| (0.5 + 0.5 / (sin * sin)).sqrt()),
        // 50 dB-Hz at the zenith, 15 dB less at the horizon, against 45 dB-Hz.
        (
            Law::Cn0,
            |sin| 10f64.powf((45.0 - 50.0 + 15.0 * (1.0 - sin)) / 20.0),
            |sin| 10f64.powf((45.0 - 50.0 + 15.0 * (1.0 - sin)) / 20.0),
        ),
    ] {
        let changes = noisy(law);
        for (low_deg, high_deg) in [(5.0, 20.0), (20.0, 45.0), (45.0, 90.0)] {
            let part: Vec<&Change> = changes
                .iter()
                .filter(|c| (low_deg..high_deg).contains(&c.elevation_rad.to_degrees()))
                .collect();
            let unit = |of: fn(&Change) -> f64, sd: f64, growth: fn(f64) -> f64| {
                rms(part.iter().map(|c| of(c) / (sd * growth(c.elevation_rad.sin()))))
            };
            let what = |name: &str| format!("{law:?}, {name} from {low_deg}° to {high_deg}°");
            assert_sd(&what("code"), unit(|c| c.code_m, 0.3, code), 1.0, part.len());
            assert_sd(&what("phase"), unit(|c| c.phase_cycles, 0.02, phase), 1.0, part.len());
            assert_sd(&what("Doppler"), unit(|c| c.doppler_hz, 0.1, code), 1.0, part.len());
        }
        for pair in [(|c| c.code_m, |c| c.phase_cycles), (|c| c.code_m, |c| c.doppler_hz)]
            as [(fn(&Change) -> f64, fn(&Change) -> f64); 2]
        {
            let correlation = correlation(changes.iter().map(|c| (pair.0(c), pair.1(c))));
            assert!(correlation.abs() < SIGMAS / (changes.len() as f64).sqrt(), "{correlation}");
        }
        let pairs = paired(&changes, |c| (c.antenna == 0).then_some((1, c.epoch)));
        assert!(correlation(pairs).abs() < 0.08, "between antennas");
        let pairs = paired(&changes, |c| Some((c.antenna, c.epoch + 1)));
        assert!(correlation(pairs).abs() < 0.08, "between epochs");
    }
}

/// The noise of the paper: 0.02 cycle at the zenith, 0.07 at the horizon.
#[test]
fn two_to_seven_hundredths_of_a_cycle() {
    let changes = noisy(Law::Elevation);
    let part = |from_deg: f64, to_deg: f64| {
        let within = move |c: &&Change| (from_deg..to_deg).contains(&c.elevation_rad.to_degrees());
        let values: Vec<f64> = changes.iter().filter(within).map(|c| c.phase_cycles).collect();
        (rms(values.iter().copied()), values.len())
    };
    let ((high, of_high), (low, of_low)) = (part(70.0, 90.0), part(5.0, 16.0));
    assert_sd("high", high, 0.0203, of_high);
    assert_sd("low", low, 0.07, of_low);
}

/// Phase changes of the same satellite and signal at the antenna and epoch that `other` names.
fn paired(
    changes: &[Change],
    other: impl Fn(&Change) -> Option<(usize, usize)>,
) -> Vec<(f64, f64)> {
    let key = |c: &Change, antenna, epoch| (antenna, epoch, c.satellite, c.signal);
    let of = |c: &Change| (key(c, c.antenna, c.epoch), (c.phase_cycles, c.elevation_rad));
    let all: std::collections::BTreeMap<_, _> = changes.iter().map(of).collect();
    let pair = |c: &Change| {
        let (antenna, epoch) = other(c)?;
        Some((c.phase_cycles, all.get(&key(c, antenna, epoch))?.0))
    };
    let pairs: Vec<_> = changes.iter().filter_map(pair).collect();
    assert!(pairs.len() > 500, "{} pairs", pairs.len());
    pairs
}

fn correlation(pairs: impl IntoIterator<Item = (f64, f64)>) -> f64 {
    let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in pairs {
        (xy, xx, yy) = (xy + x * y, xx + x * x, yy + y * y);
    }
    xy / f64::sqrt(xx * yy)
}

/// C/N0 is the stated one at the zenith and falls by 15 dB towards the horizon.
#[test]
fn cn0_falls_with_the_elevation() {
    let run = roof(|scenario| scenario.noise.cn0_zenith_dbhz = 47.0);
    let mut off_db = Vec::new();
    for epoch in 0..run.epochs.len() {
        for o in &run.antenna(epoch, 0).observations {
            let sin = run.direction_rad(epoch, o.satellite).1.sin();
            off_db.push(o.cn0_dbhz.unwrap() - (47.0 - 15.0 * (1.0 - sin)));
        }
    }
    assert_sd("C/N0", rms(off_db.iter().copied()), 0.3, off_db.len());
}

/// For its time and on its bands interference takes from C/N0, and noise is larger by as much.
#[test]
fn interference_weakens_its_bands_for_its_time() {
    let plan = |with: bool| {
        effect(|scenario| {
            (scenario.noise.code_sd_m, scenario.noise.phase_sd_cycles) = (0.3, 0.02);
            if with {
                scenario.interference = vec![Interference {
                    from_s: 100.0,
                    to_s: 200.0,
                    bands: names(&["G1", "E1"]),
                    cn0_drop_db: 12.0,
                }];
            }
        })
    };
    for (with, without) in plan(true).iter().zip(&plan(false)) {
        let jammed =
            ["G1C", "E1C"].map(signal).contains(&with.signal) && (10..20).contains(&with.epoch);
        let (drop_db, growth) = if jammed { (12.0, 10f64.powf(0.6)) } else { (0.0, 1.0) };
        assert!((with.cn0_db - without.cn0_db + drop_db).abs() < 1e-9, "{with:?}");
        assert!((with.code_m - growth * without.code_m).abs() < 1e-5, "{with:?} {without:?}");
        assert!((with.phase_cycles - growth * without.phase_cycles).abs() < 1e-5, "{with:?}");
    }
}

/// Reflections have their size, which falls as cos(elevation), from the first epoch on, are forgotten
/// within their time, and are not the same for two antennas, satellites or signals.
#[test]
fn reflections_are_coloured_and_everyones_own() {
    // None at all would draw no random numbers.
    let [with, without] = [1.0, 1e-9].map(|scale| {
        roof(|scenario| {
            (scenario.duration_s, scenario.interval_s) = (400.0, 10.0);
            scenario.multipath.code_sd_m = 0.8 * scale;
            scenario.multipath.phase_sd_m = 0.004 * scale;
            scenario.multipath.correlation_s = 20.0;
        })
    });
    let changes = with.less(&without);
    let unit = |c: &Change| {
        (c.code_m / 0.8 / c.elevation_rad.cos(), c.phase_m() / 0.004 / c.elevation_rad.cos())
    };
    for epoch in [0, 20, 40] {
        let part: Vec<_> = changes.iter().filter(|c| c.epoch == epoch).map(unit).collect();
        assert_sd("code", rms(part.iter().map(|u| u.0)), 1.0, part.len());
        assert_sd("phase", rms(part.iter().map(|u| u.1)), 1.0, part.len());
    }
    // exp(−τ / 20 s) after one epoch and after two.
    let flat: Vec<Change> =
        changes.iter().map(|c| Change { phase_cycles: unit(c).1, ..*c }).collect();
    for (later, wanted) in [(1, 0.607), (2, 0.368)] {
        let found = correlation(paired(&flat, |c| Some((c.antenna, c.epoch + later))));
        assert!((found - wanted).abs() < 0.08, "after {later}: {found}, wanted {wanted}");
    }
    let antennas = correlation(paired(&flat, |c| (c.antenna == 0).then_some((1, c.epoch))));
    assert!(antennas.abs() < 0.12, "between antennas {antennas}");
    let of_code = correlation(changes.iter().map(unit));
    assert!(of_code.abs() < 0.12, "between code and phase {of_code}");
}

/// What all signals of a satellite have in common at an antenna has its share of the variance, in metres.
#[test]
fn signals_share_reflections() {
    let of_share = |common_share: f64| {
        let [with, without] = [1.0, 1e-9].map(|scale| {
            roof(|scenario| {
                (scenario.duration_s, scenario.interval_s) = (400.0, 10.0);
                scenario.multipath.code_sd_m = 0.8 * scale;
                scenario.multipath.phase_sd_m = 0.004 * scale;
                scenario.multipath.common_share = common_share;
            })
        });
        with.less(&without)
    };
    let pairs = |changes: &[Change], of: fn(&Change) -> f64| {
        let [first, second] = ["G1C", "G2W"].map(|name| {
            let chosen = changes.iter().filter(move |c| c.signal == signal(name));
            let keyed = chosen.map(move |c| ((c.antenna, c.epoch, c.satellite), of(c)));
            keyed.collect::<std::collections::BTreeMap<_, _>>()
        });
        correlation(first.iter().filter_map(|(key, x)| Some((*x, *second.get(key)?))))
    };
    for share in [0.0, 0.5, 1.0] {
        let changes = of_share(share);
        for of in [Change::phase_m, |c: &Change| c.code_m] as [fn(&Change) -> f64; 2] {
            let found = pairs(&changes, of);
            assert!((found - share).abs() < 0.12, "{found}, wanted {share}");
        }
        let unit = changes.iter().map(|c| c.phase_m() / 0.004 / c.elevation_rad.cos());
        let independent = changes.iter().filter(|c| c.signal == signal("G1C")).count() / 6;
        assert_sd("phase", rms(unit), 1.0, independent);
    }
}

/// Where noise is none, two antennas at one place agree: nothing else is drawn at random.
#[test]
fn without_noise_there_is_none() {
    let run = roof(|scenario| scenario.body[0].antenna[1].position_m = [0.0; 3]);
    let [one, other] = [0, 1].map(|antenna| by_signal(run.antenna(3, antenna)));
    for (key, o) in &one {
        let off_m = o.pseudorange_m.unwrap() - other[key].pseudorange_m.unwrap();
        assert!(off_m.abs() < 1e-6, "{key:?}: {off_m}");
    }
}
