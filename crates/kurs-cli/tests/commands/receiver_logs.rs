//! Simulated UBX, RTCM 3 and SBF logs, solved alone, give the attitude of the RINEX files.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::rc::Rc;

use crate::program::run;

use assert_cmd::Command;
use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;
use kurs_formats::navigation;
use kurs_formats::observations::ObservationSource;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
use kurs_formats::source::Source;
use kurs_formats::ubx::UbxWriter;
use kurs_sim::noise::Noise;
use kurs_sim::nominal_orbits;

/// Two antennas at rest, a minute, all systems, clocks that are off by less than a millisecond.
const SCENARIO: &str = r#"
seed = 5
start = "2024-03-10T12:00:00"
duration_s = 60.0
interval_s = 1.0
signals = ["G1C", "G2L", "E1C", "E5Q", "C2I", "R1C", "J1C"]

[output]
formats = ["rinex", "ubx", "rtcm3", "sbf"]

[sky]
systems = ["G", "R", "E", "C", "J"]

[[body]]
name = "roof"
motion = { kind = "static", place = { latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }, heading_deg = 40.0, pitch_deg = 3.0 }
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, 0.0]
"#;

/// The scenario, simulated.
fn simulated(folder: &Path) {
    let path = |name: &str| folder.join(name).display().to_string();
    fs::write(path("scenario.toml"), SCENARIO).unwrap();
    run(&["simulate", &path("scenario.toml"), "--out", &path("simulated"), "--quiet"]);
}

/// All epochs of a file.
fn epochs(path: &Path) -> Vec<AntennaEpoch> {
    let mut source = ObservationSource::open(path).unwrap();
    let (mut all, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while source.next_epoch(&mut epoch).unwrap() {
        all.push(epoch.clone());
    }
    all
}

/// Status, heading and pitch of every row.
fn rows(folder: &Path) -> Vec<(String, f64, f64)> {
    let text = fs::read_to_string(folder.join("attitude.csv")).unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names = reader.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|n| n == name).unwrap();
    let [status, heading, pitch] = ["status", "heading_deg", "pitch_deg"].map(column);
    let number = |text: &str| text.parse().unwrap_or(f64::NAN);
    let rows = reader.records().map(Result::unwrap);
    rows.map(|r| (r[status].to_owned(), number(&r[heading]), number(&r[pitch]))).collect()
}

#[test]
fn logs_alone_give_the_attitude_of_the_rinex_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    simulated(folder.path());
    run(&["solve", &path("simulated/kurs.toml"), "--out", &path("rinex"), "--quiet"]);
    let wanted = rows(&folder.path().join("rinex"));
    assert_eq!(wanted.len(), 61);
    assert!(wanted.iter().filter(|row| row.0 == "fixed").count() > 55, "{wanted:?}");
    for format in ["ubx", "rtcm3", "sbf"] {
        let antenna = |name: &str, place: &str| {
            format!("{name}={}@{place}", path(&format!("simulated/{name}.{format}")))
        };
        let antennas = [antenna("A0", "0,0,0"), antenna("A1", "1.2,0,0")];
        let flags = ["--antenna", &antennas[0], "--antenna", &antennas[1]];
        let out = path(format);
        let exact = ["--set", "array_sd_m=0", "--out", &out, "--quiet"];
        run(&[&["solve"][..], &flags, &exact].concat());
        let found = rows(Path::new(&out));
        assert_eq!(found.len(), wanted.len());
        let mut worst_deg = 0f64;
        for (a, b) in wanted.iter().zip(&found) {
            assert_eq!(a.0, b.0, "{format} {a:?} {b:?}");
            worst_deg = worst_deg.max((a.1 - b.1).abs()).max((a.2 - b.2).abs());
        }
        println!("{format}: angles within {worst_deg:.4}° of those from RINEX");
        // C/N0 in whole dB-Hz (UBX) changes weights; half a millimetre on 1.2 m is 0.024°.
        assert!(worst_deg < 0.03, "{format} {worst_deg}");
    }
}

/// Observations of a file by time, satellite and signal.
fn by_signal(path: &Path) -> BTreeMap<(GpsTime, Satellite, Signal), Observation> {
    let all = epochs(path).into_iter();
    let key = |time, o: Observation| ((time, o.satellite, o.signal), o);
    all.flat_map(|epoch| epoch.observations.into_iter().map(move |o| key(epoch.time, o))).collect()
}

/// `convbin` of RTKLIB makes of the logs what the RINEX file has, within the resolution of each
/// format: of phases in RTCM one and the same number of whole cycles is missing all the time. In
/// UBX RTKLIB 2.4.3 does not know E5a, and adds half a cycle to the geostationary satellites of
/// BeiDou.
#[test]
fn convbin_reads_the_observations_of_the_logs() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    simulated(folder.path());
    let all = by_signal(&path("simulated/A1.rnx"));
    assert!(all.len() > 61 * 30, "{}", all.len());
    // Rounding of the converted file, and that of single precision, milliseconds/2²⁹ and /2³¹, 1e-4
    // m/s.
    for (format, cn0_db, code_m, cycles, hertz) in
        [("ubx", 0.501, 1.1e-3, 1.1e-3, 2e-3), ("rtcm3", 0.04, 1.5e-3, 1.5e-3, 2e-3)]
    {
        let log = path(&format!("simulated/A1.{format}"));
        let run = std::process::Command::new("convbin")
            .args(["-r", format, "-tr", "2024/03/10", "12:00:00", "-v", "3.04"])
            .args(["-od", "-os", "-f", "7", "-o"])
            .args([&path("converted.rnx"), &log])
            .output();
        if let Err(error) = run {
            crate::outside::lacking(&format!("convbin: {error}"));
            return;
        }
        let found = by_signal(&path("converted.rnx"));
        let mut wanted = all.clone();
        wanted.retain(|(.., signal), _| format != "ubx" || signal.to_string() != "E5Q");
        assert!(found.keys().eq(wanted.keys()), "{format}: {} of {}", found.len(), wanted.len());
        let mut missing = BTreeMap::new();
        for (key, a) in &wanted {
            let b = &found[key];
            let off = |of: fn(&Observation) -> Option<f64>| of(b).unwrap() - of(a).unwrap();
            assert!(off(|o| o.pseudorange_m).abs() < code_m, "{format} {key:?} {a:?} {b:?}");
            assert!(off(|o| o.doppler_hz).abs() < hertz, "{format} {key:?} {a:?} {b:?}");
            assert!(off(|o| o.cn0_dbhz).abs() < cn0_db, "{format} {key:?} {a:?} {b:?}");
            let added = if format == "ubx" && key.1.is_beidou_geo() { 0.5 } else { 0.0 };
            let apart = off(|o| o.phase_cycles) - added;
            let (whole, fraction) = (apart.round(), apart - apart.round());
            assert!(fraction.abs() < cycles, "{format} {key:?} {a:?} {b:?}");
            let first = *missing.entry((key.1, key.2)).or_insert(whole);
            assert_eq!(whole, if format == "ubx" { 0.0 } else { first }, "{format} {key:?}");
        }
        println!("{format}: {} observations as simulated", found.len());
    }
}

/// Two antennas of one receiver, two stations of one stream: each in one log, chosen on the command
/// line and in a configuration; without a choice the error says what there is.
#[test]
fn one_log_of_both_antennas_gives_the_same_attitude() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    simulated(folder.path());
    run(&["solve", &path("simulated/kurs.toml"), "--out", &path("rinex"), "--quiet"]);
    let wanted = rows(&folder.path().join("rinex"));

    let mut data = NavigationData::default();
    let log = path("simulated/A0.sbf");
    navigation::read(&mut Source::open(&log).unwrap(), &mut data).unwrap();
    let antennas =
        ["A0", "A1"].map(|name| epochs(&folder.path().join(format!("simulated/{name}.rnx"))));
    let place = Vector::new(3_833_000.5, 884_000.25, 5_002_000.125);
    let stream = Shared::default();
    let mut sbf = SbfWriter::new(Vec::new(), &data);
    let mut stations =
        [7, 8].map(|station| Rtcm3Writer::new(stream.clone(), station, place, &data));
    for (a, b) in antennas[0].iter().zip(&antennas[1]) {
        sbf.write(&[a, b]).unwrap();
        stations.iter_mut().zip([a, b]).for_each(|(writer, epoch)| writer.write(epoch).unwrap());
    }
    fs::write(path("both.sbf"), sbf.finish()).unwrap();
    fs::write(path("both.rtcm3"), stream.0.take()).unwrap();

    for (log, ids, key) in
        [("both.sbf", ["main", "aux1"], "antenna_id"), ("both.rtcm3", ["7", "8"], "station_id")]
    {
        let solve = |ids: [&str; 2], out: &str| {
            let [a0, a1] = [("A0", "0,0,0"), ("A1", "1.2,0,0")];
            let flag =
                |(name, place): (&str, &str), id: &str| format!("{name}={}{id}@{place}", path(log));
            let mut command = Command::cargo_bin("kurs").unwrap();
            command.args(["solve", "--antenna", &flag(a0, ids[0]), "--antenna", &flag(a1, ids[1])]);
            command.args(["--set", "array_sd_m=0", "--out", &path(out), "--quiet"]).assert()
        };
        let chosen = ids.map(|id| format!("#{id}"));
        solve([&chosen[0], &chosen[1]], log.trim_start_matches("both.")).success();
        let found = rows(&folder.path().join(log.trim_start_matches("both.")));
        assert_eq!(found.len(), wanted.len());
        for (a, b) in wanted.iter().zip(&found) {
            assert_eq!(a.0, b.0, "{log} {a:?} {b:?}");
            let apart_deg = (a.1 - b.1).abs().max((a.2 - b.2).abs());
            assert!(apart_deg < 0.03, "{log} {a:?} {b:?}");
        }
        let refused = solve(["", ""], "none").failure().code(1);
        let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
        assert!(said.contains(key) && said.contains(&ids.join(" and ")), "{said}");

        // The same with a configuration, as far as it goes: one that is not there.
        let quoted = if key == "antenna_id" { "\"aux2\"" } else { "9" };
        let antenna = |name: &str| {
            format!("[[antenna]]\nname = \"{name}\"\nobs = [\"{log}\"]\n{key} = {quoted}\n")
        };
        fs::write(path("kurs.toml"), antenna("A0") + &antenna("A1")).unwrap();
        let refused = Command::cargo_bin("kurs")
            .unwrap()
            .args(["solve", &path("kurs.toml"), "--out", &path("none"), "--quiet"])
            .assert()
            .failure()
            .code(1);
        let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
        assert!(said.contains(quoted.trim_matches('"')) && said.contains("none of"), "{said}");

        let output = Command::cargo_bin("kurs").unwrap().args(["inspect", &path(log)]).assert();
        let printed = String::from_utf8_lossy(&output.success().get_output().stdout).into_owned();
        for id in ids {
            let source = if key == "antenna_id" { "antenna" } else { "station" };
            assert!(printed.contains(&format!("{log}, {source} {id}: ")), "{printed}");
        }
        let place = "3833000.5000, 884000.2500, 5002000.1250 m ECEF";
        assert_eq!(printed.contains(place), key == "station_id", "{printed}");
    }
}

/// Ephemerides that only one of the receivers gets, and only after half a minute: what a live run
/// could not know is not used.
#[test]
fn as_received_an_ephemeris_counts_from_the_epoch_that_follows_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    simulated(folder.path());
    let mut data = NavigationData::default();
    let log = path("simulated/A0.sbf");
    navigation::read(&mut Source::open(&log).unwrap(), &mut data).unwrap();
    let none = NavigationData::default();
    for name in ["A0", "A1"] {
        let epochs = epochs(&folder.path().join(format!("simulated/{name}.rnx")));
        let write = |epochs: &[AntennaEpoch], data: &NavigationData| {
            let mut writer = SbfWriter::new(Vec::new(), data);
            epochs.iter().for_each(|epoch| writer.write(&[epoch]).unwrap());
            writer.finish()
        };
        let later = if name == "A1" { &data } else { &none };
        let log = [write(&epochs[..30], &none), write(&epochs[30..], later)].concat();
        fs::write(path(&format!("{name}.sbf")), log).unwrap();
    }
    let solve = |out: &str, as_received: &str| {
        let flag =
            |name: &str, place: &str| format!("{name}={}@{place}", path(&format!("{name}.sbf")));
        let antennas = [flag("A0", "0,0,0"), flag("A1", "1.2,0,0")];
        let as_received = format!("nav.as_received={as_received}");
        let flags = ["--antenna", &antennas[0], "--antenna", &antennas[1], "--set", &as_received];
        run(&[&["solve"][..], &flags, &["--out", &path(out), "--quiet"]].concat());
        rows(&folder.path().join(out)).into_iter().map(|row| row.0).collect::<Vec<_>>()
    };
    let at_once = solve("at-once", "false");
    assert!(at_once[..30].iter().filter(|status| *status == "fixed").count() > 25, "{at_once:?}");
    let as_received = solve("as-received", "true");
    assert_eq!(as_received.len(), at_once.len());
    assert!(as_received[..30].iter().all(|status| status == "lost"), "{as_received:?}");
    assert_eq!(as_received[30], "fixed");
    assert!(as_received[30..].iter().filter(|status| *status == "fixed").count() > 25);
}

/// Every hour of a week, the edges of its days, a leap second: whenever a log begins, it has all
/// ephemerides that its receiver has, and they say where the satellites are.
#[test]
fn logs_of_all_start_times_have_their_ephemerides() {
    let systems = [System::Gps, System::Galileo, System::BeiDou, System::Glonass, System::Qzss];
    let at = |week: i32, tow_s: f64| GpsTime::from_week_tow(week, tow_s).unwrap();
    let hours = (0..168).map(|hour| at(2305, 3600.0 * f64::from(hour) + 61.0));
    let edges = (0..7).flat_map(|day| {
        [-1.0, 0.0, 17.0, 19.0].map(|off_s| at(2306, 86_400.0 * f64::from(day)) + off_s)
    });
    // 2016-12-31 23:59:60 UTC.
    let leap = [-7200.0, -600.0, -1.0, 0.0, 1.0, 600.0].map(|off_s| at(1930, 17.0) + off_s);
    for start in hours.chain(edges).chain(leap) {
        let mut noise = Noise::seeded(7);
        let sky = nominal_orbits::navigation(&systems, start, 3600.0, &mut noise).unwrap();
        for (format, log, left_out) in logs_of(&sky, start) {
            assert_eq!(left_out, BTreeSet::new(), "{format} of {start}");
            let mut source = Source::new(io::Cursor::new(log), format).unwrap();
            let mut read = NavigationData::default();
            let summary = navigation::read_near(&mut source, Some(start), &mut read).unwrap();
            assert_eq!(summary.damage.listed(), [], "{format} of {start}");
            let satellites: BTreeSet<Satellite> =
                sky.ephemerides.iter().map(Ephemeris::satellite).collect();
            for satellite in satellites {
                for ahead_s in [0.0, 5.0] {
                    let time = start + ahead_s;
                    let true_m = sky.ephemerides.state(satellite, time).unwrap().position_m;
                    let found = read.ephemerides.state(satellite, time);
                    let found_m = found.map(|state| state.position_m);
                    let off_m = found_m.map(|found_m| (found_m - true_m).norm());
                    // Units of GLONASS: 0.5 m, and 1 mm/s over a quarter of an hour.
                    assert!(off_m.is_ok_and(|m| m < 5.0), "{format} {satellite} {time} {off_m:?}");
                }
            }
        }
    }
}

/// The first epochs of logs that begin at a time: name, bytes, satellites without ephemerides.
fn logs_of(
    sky: &NavigationData,
    start: GpsTime,
) -> [(&'static str, Vec<u8>, BTreeSet<Satellite>); 3] {
    let epoch = |ahead_s: f64| AntennaEpoch {
        time: start + ahead_s,
        observations: vec![Observation {
            satellite: Satellite::new(System::Gps, 5),
            signal: "G1C".parse().unwrap(),
            pseudorange_m: Some(22e6),
            phase_cycles: Some(22e6 / 0.19),
            doppler_hz: Some(100.0),
            cn0_dbhz: Some(45.0),
            lock: Lock::default(),
        }],
        ..AntennaEpoch::default()
    };
    let epochs = [epoch(0.0), epoch(1.0)];
    let place = Vector::new(3_833_000.5, 884_000.25, 5_002_000.125);
    let mut ubx = UbxWriter::new(Vec::new(), sky);
    let mut rtcm = Rtcm3Writer::new(Vec::new(), 1, place, sky);
    let mut sbf = SbfWriter::new(Vec::new(), sky);
    for epoch in &epochs {
        ubx.write(epoch).unwrap();
        rtcm.write(epoch).unwrap();
        sbf.write(&[epoch]).unwrap();
    }
    let left_out = [ubx.left_out(), rtcm.left_out(), sbf.left_out()].map(Clone::clone);
    let [in_ubx, in_rtcm, in_sbf] = left_out;
    [
        ("UBX", ubx.finish(), in_ubx),
        ("RTCM 3", rtcm.finish(), in_rtcm),
        ("SBF", sbf.finish(), in_sbf),
    ]
}

/// An output that several writers write to.
#[derive(Debug, Clone, Default)]
struct Shared(Rc<RefCell<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
