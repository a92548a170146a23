//! `[slips]`, `[[slip]]`, `[[outage]]`, several bodies, the station, and what `ambiguities.csv` says.

use std::collections::BTreeMap;

use kurs::signal::{Satellite, Signal};
use kurs_sim::scenario::{Outage, Place, Slip, Station};
use nalgebra::Vector3;

use super::scene::{Run, by_signal, level_m, names, roof, signal};

/// A GPS satellite that the roof tracks.
fn tracked() -> Satellite {
    roof(|_| ()).satellites(0, 0)[0]
}

/// A slip that `ambiguities.csv` tells of.
#[derive(Debug, PartialEq)]
struct ToldSlip {
    epoch: usize,
    antenna: usize,
    satellite: Satellite,
    signal: Signal,
    cycles: i64,
    flagged: bool,
}

fn slips(run: &Run) -> Vec<ToldSlip> {
    let mut told = Vec::new();
    for (epoch, made) in run.epochs.iter().enumerate() {
        for change in &made.changes {
            let Some(cycles) = change.slip else { continue };
            let (satellite, signal, flagged) = (change.satellite, change.signal, change.flagged);
            let antenna = usize::from(change.antenna == "A1");
            told.push(ToldSlip { epoch, antenna, satellite, signal, cycles, flagged });
        }
    }
    told
}

/// A slip adds its cycles to one band of one satellite at one antenna, from its time on.
#[test]
fn a_slip_stays() {
    let slipping = tracked();
    let plain = roof(|_| ());
    for flagged in [true, false] {
        let with = roof(|scenario| {
            scenario.slip = vec![Slip {
                time_s: 1.5,
                antenna: "A1".to_owned(),
                satellite: slipping.to_string(),
                band: "G2".to_owned(),
                cycles: -7,
                flagged,
            }];
        });
        for change in with.less(&plain) {
            let is_hit = change.antenna == 1
                && change.satellite == slipping
                && change.signal == signal("G2W")
                && change.epoch >= 2;
            let wanted = if is_hit { -7.0 } else { 0.0 };
            assert!((change.phase_cycles - wanted).abs() < 1e-6, "{change:?}");
            assert_eq!((change.code_m, change.doppler_hz), (0.0, 0.0));
        }
        let signal = signal("G2W");
        let (epoch, antenna, satellite, cycles) = (2, 1, slipping, -7);
        assert_eq!(slips(&with), [ToldSlip { epoch, antenna, satellite, signal, cycles, flagged }]);
        for epoch in 0..with.epochs.len() {
            for (key, o) in by_signal(with.antenna(epoch, 1)) {
                let is_slip = epoch == 2 && key == (slipping, signal);
                assert_eq!(o.lock.slipped(), is_slip && flagged, "{epoch} {key:?}");
            }
        }
    }
}

/// As many slips as asked for, half of them up, and as many flagged.
#[test]
fn random_slips_come_as_often_as_asked() {
    let run = roof(|scenario| {
        (scenario.duration_s, scenario.interval_s) = (360.0, 1.0);
        scenario.slips.per_hour = 20.0;
        scenario.slips.flagged_share = 0.3;
    });
    let observations: usize = (0..run.epochs.len())
        .flat_map(|epoch| [0, 1].map(|antenna| run.antenna(epoch, antenna).observations.len()))
        .sum();
    let slips = slips(&run);
    let expected = observations as f64 * 20.0 / 3600.0;
    let off = slips.len() as f64 - expected;
    assert!(off.abs() < 3.29 * expected.sqrt(), "{} slips, {expected:.1} expected", slips.len());
    let share = |yes: fn(&ToldSlip) -> bool| {
        slips.iter().filter(|slip| yes(slip)).count() as f64 / slips.len() as f64
    };
    let band = 3.29 * (0.25 / slips.len() as f64).sqrt();
    assert!((share(|slip| slip.flagged) - 0.3).abs() < band);
    assert!((share(|slip| slip.cycles > 0) - 0.5).abs() < band);
    for slip in &slips {
        assert!((1..=10).contains(&slip.cycles.abs()));
        let seen = by_signal(run.antenna(slip.epoch, slip.antenna));
        assert_eq!(seen[&(slip.satellite, slip.signal)].lock.slipped(), slip.flagged);
    }
    // The table of whole cycles holds what the phases have: P − d = λ (Φ − N), slips and all.
    let mut cycles = BTreeMap::new();
    for (epoch, made) in run.epochs.iter().enumerate() {
        for change in &made.changes {
            let antenna = usize::from(change.antenna == "A1");
            cycles.insert((antenna, change.satellite, change.signal), change.cycles);
        }
        for antenna in [0, 1] {
            for o in &run.antenna(epoch, antenna).observations {
                let delay_m = run.record(o.satellite).group_delay_m(o.signal).unwrap_or(0.0);
                let whole = cycles[&(antenna, o.satellite, o.signal)] as f64;
                let by_phase_m =
                    (o.phase_cycles.unwrap() - whole) * run.wavelength_m(o.signal, o.satellite);
                let off_m = o.pseudorange_m.unwrap() - delay_m - by_phase_m;
                assert!(off_m.abs() < 1e-5, "{} {}: {off_m}", o.satellite, o.signal);
            }
        }
    }
}

/// An outage takes what it names for its time, and nothing else; then phases begin anew and say so.
#[test]
fn outages_hide_what_they_name() {
    let lost = tracked();
    let plain = roof(|_| ());
    let outage = |antennas: &[&str], satellites: &[String], bands: &[&str]| Outage {
        from_s: 1.0,
        to_s: 3.0,
        antennas: names(antennas),
        satellites: satellites.to_vec(),
        bands: names(bands),
    };
    for (plan, antenna, of_satellite, band) in [
        (outage(&["A1"], &[], &[]), Some(1), None, None),
        (outage(&[], &[lost.to_string()], &[]), None, Some(lost), None),
        (outage(&[], &[], &["G1", "E5"]), None, None, Some(["G1C", "E5Q"].map(signal))),
        (
            outage(&["A0"], &[lost.to_string()], &["G1"]),
            Some(0),
            Some(lost),
            Some(["G1C"; 2].map(signal)),
        ),
        (outage(&[], &[], &[]), None, None, None),
    ] {
        let with = roof(|scenario| scenario.outage = vec![plan.clone()]);
        for epoch in 0..with.epochs.len() {
            for index in [0, 1] {
                let found = by_signal(with.antenna(epoch, index));
                for key in by_signal(plain.antenna(epoch, index)).keys() {
                    let named = antenna.is_none_or(|named| named == index)
                        && of_satellite.is_none_or(|named| named == key.0)
                        && band.is_none_or(|named| named.contains(&key.1));
                    let hidden = named && (1..3).contains(&epoch);
                    assert_eq!(
                        !found.contains_key(key),
                        hidden,
                        "{plan:?}: {epoch} {index} {key:?}"
                    );
                    let anew = named && epoch == 3;
                    if let Some(o) = found.get(key) {
                        assert_eq!(o.lock.slipped(), anew, "{plan:?}: {epoch} {index} {key:?}");
                    }
                    let name = format!("A{index}");
                    let drawn = with.epochs[epoch].changes.iter().any(|c| {
                        (&c.antenna, c.satellite, c.signal, c.slip) == (&name, key.0, key.1, None)
                    });
                    assert_eq!(drawn, anew || epoch == 0, "{plan:?}: {epoch} {index} {key:?}");
                }
            }
        }
    }
}

/// A second body and a station receive the same satellites at the same time, each at its own place.
#[test]
fn another_body_and_a_station_are_under_the_same_sky() {
    let base = Place { latitude_deg: 35.001, longitude_deg: 110.0, height_m: 200.0 };
    let alone = roof(|_| ());
    let run = roof(|scenario| {
        let mut second = scenario.body[0].clone();
        second.name = "trailer".to_owned();
        second.antenna[0].name = "B0".to_owned();
        second.antenna[1].name = "B1".to_owned();
        second.antenna[0].position_m = [-8.0, 0.0, 0.0];
        scenario.body.push(second);
        scenario.station = Some(Station { name: "base".to_owned(), place: base, signals: None });
    });
    // The first body does not notice.
    assert!(run.less(&alone).iter().all(|c| c.code_m == 0.0 && c.phase_cycles == 0.0));
    for epoch in &run.epochs {
        let [first, second] = &epoch.bodies[..] else { panic!("two bodies") };
        let truth = &second.truth;
        assert_eq!(truth.attitude, first.truth.attitude);
        // Heading east: the second body's first antenna is 8 m west of the roof.
        let b0 = second.observed.antennas[0].as_ref().unwrap();
        let a0 = first.observed.antennas[0].as_ref().unwrap();
        let station = epoch.station.as_ref().unwrap();
        let place_m = level_m(base.geodetic().to_ecef());
        assert!((place_m.x - 110.9).abs() < 0.2 && place_m.y.abs() < 1e-6, "{place_m}");
        for (other, offset_m) in [(b0, Vector3::new(0.0, -8.0, 0.0)), (station, place_m)] {
            let seen = by_signal(other);
            assert!(seen.len() > 30, "{}", seen.len());
            for (key, o) in by_signal(a0) {
                let Some(there) = seen.get(&key) else { continue };
                let (azimuth, elevation) = run.direction_rad(0, key.0);
                let towards = Vector3::new(
                    azimuth.cos() * elevation.cos(),
                    azimuth.sin() * elevation.cos(),
                    -elevation.sin(),
                );
                let found_m = there.pseudorange_m.unwrap() - o.pseudorange_m.unwrap();
                let wanted_m = -towards.dot(&offset_m);
                // Four seconds turn the directions a little.
                assert!((found_m - wanted_m).abs() < 0.2, "{key:?}: {found_m} {wanted_m}");
            }
        }
    }
}
