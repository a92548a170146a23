//! What the crate `rinex` 0.24 is known to do wrong, each as a small file that we read right:
//!
//! ```text
//! cd tests-referees && cargo test --release --test defects -- --nocapture
//! ```
//!
//! The tests of observation files also say what the crate makes of them: if it changes, its totals
//! count again as those of a referee. Its orbits are not built here (they bring a toolkit for
//! ephemerides of their own); there the right result is checked by itself.

use std::fs;
use std::time::Instant;

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock};
use kurs::signal::{Satellite, System};
use kurs_formats::navigation::{self, ReadSummary};
use kurs_formats::rinex::observation::ObservationReader;
use kurs_formats::source::Source;
use kurs_referees::{Totals, rinex_crate};

fn record(content: &str, label: &str) -> String {
    format!("{content:<60}{label:<20}\n")
}

/// A header of RINEX 3 with these observation types of GPS and further records.
fn header_3(types: &str, further: &[(&str, &str)]) -> String {
    let mut text = record("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE");
    text += &record(types, "SYS / # / OBS TYPES");
    for (content, label) in further {
        text += &record(content, label);
    }
    text += &record("  2024     3    10    12     0    0.0000000     GPS", "TIME OF FIRST OBS");
    text + &record("", "END OF HEADER")
}

fn epoch_3(second: u32, flag: u8, count: usize) -> String {
    format!("> 2024 03 10 12 00 {second:2}.0000000  {flag}{count:3}\n")
}

/// As we read it; with the number of damaged places.
fn ours(text: &str) -> (Vec<AntennaEpoch>, u64) {
    let bytes = std::io::Cursor::new(text.as_bytes().to_vec());
    let mut reader = ObservationReader::new(bytes, "test").expect("a readable file");
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).expect("an epoch") {
        epochs.push(epoch.clone());
    }
    (epochs, reader.damage_count())
}

/// As the crate reads it.
fn theirs(name: &str, text: &str) -> Result<Totals, String> {
    let path = std::env::temp_dir().join(format!("kurs-{name}-{}.24o", std::process::id()));
    fs::write(&path, text).expect("a file");
    let totals = rinex_crate(&path);
    fs::remove_file(&path).expect("the file");
    totals
}

#[test]
fn observation_types_that_change_in_mid_file() {
    let text = header_3("G    2 C1C L1C", &[])
        + &epoch_3(0, 0, 1)
        + "G01  20000000.000 7 105100000.000 7\n"
        + ">                              4  1\n"
        + &record("G    2 L1C C1C", "SYS / # / OBS TYPES")
        + &epoch_3(1, 0, 1)
        + "G01 105100010.000 7  20000002.000 7\n";
    let (epochs, damage) = ours(&text);
    let second = epochs[1].observations[0];
    assert_eq!(second.pseudorange_m, Some(20_000_002.0));
    assert_eq!(second.phase_cycles, Some(105_100_010.0));
    assert_eq!((epochs.len(), damage), (2, 0));
    let crate_sum = theirs("types", &text).map(|totals| totals.sums[0]);
    println!("sum of pseudoranges: ours 40000002, rinex 0.24 {crate_sum:?}");
    assert_ne!(crate_sum, Ok(40_000_002.0));
}

#[test]
fn slip_records_are_no_observations() {
    let text = header_3("G    2 C1C L1C", &[])
        + &epoch_3(0, 0, 1)
        + "G01  20000000.000 7 105100000.000 7\n"
        + &epoch_3(1, 6, 1)
        + "G01                         1.000\n"
        + &epoch_3(1, 0, 1)
        + "G01  20000002.000 7 105100010.000 7\n";
    let (epochs, damage) = ours(&text);
    let phases: usize = epochs.iter().map(|epoch| epoch.observations.len()).sum();
    assert_eq!((epochs.len(), phases, damage), (2, 2, 0));
    assert!(epochs[1].observations[0].lock.slipped());
    let crate_count = theirs("slips", &text).map(|totals| totals.counts[1]);
    println!("phases: ours 2, rinex 0.24 {crate_count:?}");
    assert_ne!(crate_count, Ok(2));
}

#[test]
fn scale_factors_are_divided_out() {
    let text = header_3("G    2 C1C L1C", &[("G  100   1 L1C", "SYS / SCALE FACTOR")])
        + &epoch_3(0, 0, 1)
        + "G01  20000000.000 71051000012.345 7\n";
    let (epochs, damage) = ours(&text);
    let phase_cycles = epochs[0].observations[0].phase_cycles.unwrap_or_default();
    assert!((phase_cycles - 10_510_000.123_45).abs() < 1e-7, "{phase_cycles}");
    assert_eq!(damage, 0);
    let crate_phase = theirs("scale", &text).map(|totals| totals.sums[1]);
    println!("phase: ours {phase_cycles}, rinex 0.24 {crate_phase:?}");
    assert!(!crate_phase.is_ok_and(|sum| (sum - phase_cycles).abs() < 1e-6));
}

#[test]
fn blank_system_letters_are_those_of_the_file() {
    let text = record("     2.10           OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE")
        + &record("     2    C1    L1", "# / TYPES OF OBSERV")
        + &record("  1995     1     1     0     0    0.0000000", "TIME OF FIRST OBS")
        + &record("", "END OF HEADER")
        + " 95  1  1  0  0  0.0000000  0  3  5G12 31\n"
        + "  20000000.000   105100000.000\n"
        + "  21000000.000   110400000.000\n"
        + "  22000000.000   115600000.000\n";
    let (epochs, damage) = ours(&text);
    let names: Vec<String> =
        epochs[0].observations.iter().map(|o| o.satellite.to_string()).collect();
    assert_eq!((names, damage), (["G05", "G12", "G31"].map(str::to_owned).to_vec(), 0));
    let crate_count = theirs("letters", &text).map(|totals| totals.counts[0]);
    println!("pseudoranges: ours 3, rinex 0.24 {crate_count:?}");
    assert_ne!(crate_count, Ok(3));
}

#[test]
fn loss_of_lock_digits_above_seven() {
    let text = header_3("G    2 C1C L1C", &[])
        + &epoch_3(0, 0, 1)
        + "G01  20000000.000 7 105100000.00097\n";
    let (epochs, damage) = ours(&text);
    assert_eq!((epochs[0].observations[0].lock, damage), (Lock(9), 0));
    assert!(epochs[0].observations[0].lock.slipped());
    let crate_digits = theirs("digits", &text).map(|totals| totals.digits);
    println!("digits: ours one 9, rinex 0.24 {crate_digits:?}");
    assert!(!crate_digits.is_ok_and(|digits| digits.is_some_and(|of| of[9] == 1)));
}

#[test]
fn a_repeated_epoch_does_not_replace_the_first() {
    let text = header_3("G    2 C1C L1C", &[])
        + &epoch_3(0, 0, 1)
        + "G01  20000000.000 7 105100000.000 7\n"
        + &epoch_3(0, 0, 1)
        + "G01  29999999.000 7 105100099.000 7\n";
    let (epochs, damage) = ours(&text);
    assert_eq!((epochs.len(), damage), (1, 1));
    assert_eq!(epochs[0].observations[0].pseudorange_m, Some(2e7));
    let crate_sum = theirs("repeated", &text).map(|totals| totals.sums[0]);
    println!("sum of pseudoranges: ours 20000000, rinex 0.24 {crate_sum:?}");
    assert_ne!(crate_sum, Ok(2e7));
}

fn navigation(record_text: &str) -> (NavigationData, ReadSummary) {
    let text = record("     3.04           N: GNSS NAV DATA    M: MIXED", "RINEX VERSION / TYPE")
        + &record("", "END OF HEADER")
        + record_text;
    let mut source =
        Source::new(std::io::Cursor::new(text.into_bytes()), "test").expect("a source");
    let mut data = NavigationData::default();
    let summary = navigation::read(&mut source, &mut data).expect("a readable file");
    (data, summary)
}

/// R05, 2020-06-25 04:45 UTC, from station MOJN.
const GLONASS: &str = "\
R05 2020 06 25 04 45 00 5.293264985085E-05 9.094947017729E-13 3.600000000000E+05
    -6.018835449219E+03 2.992804527283E+00-9.313225746155E-10 0.000000000000E+00
    -9.376655761719E+03-9.520215988159E-01 1.862645149231E-09 1.000000000000E+00
     2.296187207031E+04 3.942489624023E-01-1.862645149231E-09 0.000000000000E+00
";

#[test]
fn glonass_orbits_move() {
    let (data, _) = navigation(GLONASS);
    let record = data.ephemerides.iter().next().expect("a record");
    let at = |later_s: f64| record.state(record.reference_time() + later_s).expect("an orbit");
    // 850 s at about 3.9 km/s in the turning axes; RTKLIB's position then.
    let [start, end] = [at(0.0), at(850.0)];
    assert!((end.position_m - start.position_m).norm() > 2.5e6);
    let rtklib = Vector::new(-3_494_077.779_61, -10_277_756.762_95, 23_097_438.268_49);
    let apart_m = (end.position_m - rtklib).norm();
    println!("850 s later {apart_m:.4} m from RTKLIB");
    assert!(apart_m < 0.01, "{apart_m}");
}

/// Velocities of every BeiDou GEO satellite of the broadcast file of 2020-06-25.
#[test]
fn velocity_of_geostationary_beidou() {
    let Some(folder) = kurs_referees::recordings() else {
        println!("skipped: no recordings");
        return;
    };
    let mut data = NavigationData::default();
    let path = folder.join("orbits/MOJN00DNK_R_20201770000_01D_MN.rnx.gz");
    navigation::read(&mut Source::open(path).expect("the file"), &mut data).expect("records");
    let mut worst_mps = 0.0f64;
    let mut count = 0;
    for record in data.ephemerides.iter().filter(|e| e.satellite().is_beidou_geo()) {
        let time = record.reference_time() + 1000.0;
        let at = |later_s: f64| record.state(time + later_s).expect("an orbit");
        let by_position = (at(1.0).position_m - at(-1.0).position_m) * 0.5;
        worst_mps = worst_mps.max((at(0.0).velocity_mps - by_position).norm());
        count += 1;
    }
    println!("{count} records, velocity within {:.5} mm/s", 1e3 * worst_mps);
    assert!(count > 20 && worst_mps < 1e-3, "{count} {worst_mps}");
}

/// G15 of the same day with a square root of the axis of zero, and as it was.
#[test]
fn a_square_root_of_zero_is_refused_at_once() {
    let record_of = |root: &str| {
        format!(
            "\
G15 2020 06 25 04 00 00-2.219416201115E-04 2.614797267597E-12 0.000000000000E+00
     8.800000000000E+01-1.656250000000E+00 5.422368720565E-09 1.932456693161E+00
    -1.508742570877E-07 1.236872794107E-02 9.519979357719E-06 {root}
     3.600000000000E+05-3.073364496231E-07-1.729840202902E+00-2.346932888031E-07
     9.279236419157E-01 1.816562500000E+02 8.856049299601E-01-8.295345534438E-09
     5.157357681791E-10 1.000000000000E+00 2.111000000000E+03 0.000000000000E+00
     2.000000000000E+00 0.000000000000E+00-1.071020960808E-08 8.800000000000E+01
     3.528180000000E+05 4.000000000000E+00
"
        )
    };
    let started = Instant::now();
    let (data, summary) =
        navigation(&(record_of("0.000000000000E+00") + &record_of("5.153706258774E+03")));
    assert!(started.elapsed().as_secs() < 1);
    assert_eq!(
        data.ephemerides.iter().map(Ephemeris::satellite).collect::<Vec<_>>(),
        [Satellite::new(System::Gps, 15)]
    );
    let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage.listed()) };
    println!("line {}: {}", damage.line, damage.what);
    assert_eq!(damage.line, 3);
}
