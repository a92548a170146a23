//! Observation files of a few lines each: every rule of the format, and every way to break it.
#![allow(clippy::unwrap_used, clippy::ptr_arg)] // a test; all ways to break lines have one type

use std::io::Write;

use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::Signal;
use kurs_formats::rinex::observation::ObservationReader;

/// A header record with its label in column 61.
fn record(content: &str, label: &str) -> String {
    format!("{content:<60}{label}\n")
}

fn header_3(version: &str, system: char, records: &[(&str, &str)]) -> String {
    let first = format!("{version:>9}           OBSERVATION DATA    {system}");
    let mut header = record(&first, "RINEX VERSION / TYPE");
    for (content, label) in records {
        header += &record(content, label);
    }
    header + &record("", "END OF HEADER")
}

fn header_2(system: char, types: &str) -> String {
    let first = format!("     2.11           OBSERVATION DATA    {system}");
    let types = format!("{:>6}{types}", types.split_whitespace().count());
    record(&first, "RINEX VERSION / TYPE")
        + &record(&types, "# / TYPES OF OBSERV")
        + &record("", "END OF HEADER")
}

/// One field: number, loss-of-lock digit, strength digit.
fn field(number: f64, digits: &str) -> String {
    format!("{number:14.3}{digits:2}")
}

fn epoch_3(second: u32, flag: u8, satellites: usize) -> String {
    format!("> 2024 06 24 08 20 {second:02}.0000000  {flag}{satellites:3}\n")
}

fn epoch_2(second: u32, flag: u8, satellites: &[&str]) -> String {
    let names = satellites.concat();
    format!(" 24  6 24  8 20 {second:2}.0000000  {flag}{:3}{names}\n", satellites.len())
}

fn open(text: &str) -> ObservationReader {
    ObservationReader::new(std::io::Cursor::new(text.as_bytes().to_vec()), "test.obs").unwrap()
}

/// All epochs, and how much was damaged.
fn read(text: &str) -> (Vec<AntennaEpoch>, u64) {
    let mut reader = open(text);
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).unwrap() {
        epochs.push(epoch.clone());
    }
    (epochs, reader.damage_count())
}

/// All epochs of a file without damage.
fn read_whole(text: &str) -> Vec<AntennaEpoch> {
    let (epochs, damage) = read(text);
    assert_eq!(damage, 0, "{:?}", open_damage(text));
    epochs
}

fn open_damage(text: &str) -> Vec<kurs_formats::damage::Damage> {
    let mut reader = open(text);
    while reader.next_epoch(&mut AntennaEpoch::default()).unwrap() {}
    reader.damage().to_vec()
}

fn find<'a>(epoch: &'a AntennaEpoch, satellite: &str, signal: &str) -> &'a Observation {
    let wanted =
        |o: &&Observation| o.satellite.to_string() == satellite && o.signal.to_string() == signal;
    epoch.observations.iter().find(wanted).unwrap()
}

/// The end is reached more than once, because the last epoch waits for one behind it.
#[test]
fn packed_data_that_is_cut_is_told_once() {
    let mut text = header_3("3.05", 'G', &[GPS_TYPES]);
    for second in 0..40 {
        text += &epoch_3(second, 0, 1);
        text += &gps("G01", 2.2e7 + f64::from(second * second) * 7.7, 1.1e8, "");
    }
    let mut packed = Vec::new();
    let mut encoder = flate2::write::GzEncoder::new(&mut packed, flate2::Compression::fast());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap();
    packed.truncate(packed.len() - 4);
    let mut reader = ObservationReader::new(std::io::Cursor::new(packed), "cut.gz").unwrap();
    let mut epoch = AntennaEpoch::default();
    while reader.next_epoch(&mut epoch).unwrap() {}
    assert!(!reader.next_epoch(&mut epoch).unwrap());
    let [damage] = reader.damage() else { panic!("{:?}", reader.damage()) };
    assert!(damage.what.starts_with("the packed data is damaged"), "{}", damage.what);
}

const GPS_TYPES: (&str, &str) = ("G    4 C1C L1C D1C S1C", "SYS / # / OBS TYPES");

/// One satellite of [`GPS_TYPES`].
fn gps(name: &str, range: f64, phase: f64, digits: &str) -> String {
    let fields = [field(range, ""), field(phase, digits), field(-12.5, ""), field(45.25, "")];
    format!("{name}{}\n", fields.concat())
}

fn tow_s(epoch: &AntennaEpoch) -> f64 {
    epoch.time.tow_s()
}

#[test]
fn one_observation_for_each_signal() {
    let text = header_3("3.05", 'M', &[("G    5 C1C L1C S1C C5Q L5Q", "SYS / # / OBS TYPES")])
        + &epoch_3(0, 0, 1)
        + "G07"
        + &field(22_000_000.123, " 7")
        + &field(-115_610_000.456, "16")
        + &field(44.5, "")
        + &field(0.0, "")
        + "\n";
    let epochs = read_whole(&text);
    let only = Observation {
        satellite: "G07".parse().unwrap(),
        signal: Signal::new(kurs::signal::System::Gps, 1, b'C'),
        pseudorange_m: Some(22_000_000.123),
        phase_cycles: Some(-115_610_000.456),
        doppler_hz: None,
        cn0_dbhz: Some(44.5),
        lock: Lock(1),
    };
    assert_eq!(epochs[0].observations, [only]);
    assert_eq!(tow_s(&epochs[0]), 86_400.0 + 8.0 * 3600.0 + 1200.0);
}

/// `rinex` 0.24 goes on with the columns of the header and swaps pseudorange and phase.
#[test]
fn observation_types_change_in_mid_file() {
    let text = header_3("3.04", 'G', &[("G    2 C1C L1C", "SYS / # / OBS TYPES")])
        + &epoch_3(0, 0, 1)
        + &format!("G01{}{}\n", field(1000.0, ""), field(2000.0, ""))
        + "> 2024 06 24 08 20  0.5000000  4  2\n"
        + &record("G    2 L1C C1C", "SYS / # / OBS TYPES")
        + &record("    1.0000        2.0000        3.0000", "APPROX POSITION XYZ")
        + &epoch_3(1, 0, 1)
        + &format!("G01{}{}\n", field(2001.0, ""), field(1001.0, ""));
    let mut reader = open(&text);
    let mut epoch = AntennaEpoch::default();
    assert!(reader.next_epoch(&mut epoch).unwrap());
    assert_eq!(find(&epoch, "G01", "G1C").pseudorange_m, Some(1000.0));
    assert!(reader.next_epoch(&mut epoch).unwrap());
    assert_eq!(find(&epoch, "G01", "G1C").pseudorange_m, Some(1001.0));
    assert_eq!(find(&epoch, "G01", "G1C").phase_cycles, Some(2001.0));
    assert_eq!(reader.header().approximate_position_m.unwrap().xyz().z, 3.0);
}

/// Signals with what is in their pseudoranges.
type Ranges = Vec<(String, Option<f64>)>;

/// What stands in the columns that are named, and what is said of the header.
fn read_list(header: &str, satellite: &str) -> (Ranges, Vec<(u64, String)>) {
    let text = header.to_owned() + satellite;
    let (epochs, _) = read(&text);
    let observed = epochs.iter().flat_map(|epoch| &epoch.observations);
    let observed = observed.map(|o| (o.signal.to_string(), o.pseudorange_m)).collect();
    let damage = open_damage(&text).into_iter().map(|d| (d.line, d.what.into_owned())).collect();
    (observed, damage)
}

/// A name that is lost does not move those behind it into other columns.
#[test]
fn observation_types_that_are_fewer_than_declared_keep_their_columns() {
    let satellite = |count: u32| {
        let fields: String = (1..=count).map(|i| field(f64::from(i), "")).collect();
        format!("{}G01{fields}\n", epoch_3(0, 0, 1))
    };
    let label = "SYS / # / OBS TYPES";
    let many = "G   15 C1C S1C C1W S1W C2W S2W C2L S2L C2S S2S C5I S5I C5Q";
    let ranges = |named: &[(&str, f64)]| -> Ranges {
        named.iter().map(|(name, range)| ((*name).to_owned(), Some(*range))).collect()
    };
    let first_line = [
        ("G1C", 1.0),
        ("G1W", 3.0),
        ("G2W", 5.0),
        ("G2L", 7.0),
        ("G2S", 9.0),
        ("G5I", 11.0),
        ("G5Q", 13.0),
    ];
    let nameless = "columns without a name are not read";
    let unknown = "which columns are those behind the first line is unknown, they are not read";
    for (records, fields, expected, damage) in [
        (vec!["G    3 C1C     C5Q"], 3, &[("G1C", 1.0), ("G5Q", 3.0)][..], ("2", "3", nameless)),
        (vec!["G    3 C1C C2W"], 3, &[("G1C", 1.0), ("G2W", 2.0)], ("2", "3", nameless)),
        (
            vec![many, "           C5X"],
            15,
            &[first_line.as_slice(), &[("G5X", 15.0)]].concat(),
            ("14", "15", nameless),
        ),
        (vec![&many.replace("15", "30"), "       S5Q C5X"], 30, &first_line, ("15", "30", unknown)),
        (vec![many], 15, &first_line, ("13", "15", unknown)),
        (
            vec!["G    2 C1C C2W C5Q"],
            3,
            &[("G1C", 1.0), ("G2W", 2.0), ("G5Q", 3.0)],
            ("3", "2", "all of them are read"),
        ),
    ] {
        let records: Vec<_> = records.iter().map(|content| (*content, label)).collect();
        let (observed, told) = read_list(&header_3("3.05", 'G', &records), &satellite(fields));
        let observed: Vec<_> = observed.into_iter().filter(|(_, range)| range.is_some()).collect();
        assert_eq!(observed, ranges(expected), "{records:?}");
        let (found, declared, fate) = damage;
        let what = format!("GPS: {found} observation types instead of {declared}; {fate}");
        assert_eq!(told, [(2, what)], "{records:?}");
    }
    // Places that are free at the end of a record are no columns.
    let records = [("G    3 C1C C2W", label), ("       C5Q", label)];
    let (observed, told) = read_list(&header_3("3.05", 'G', &records), &satellite(3));
    assert_eq!(observed, ranges(&[("G1C", 1.0), ("G2W", 2.0), ("G5Q", 3.0)]));
    assert_eq!(told, []);
}

#[test]
fn observation_types_of_rinex_2_keep_their_columns() {
    let satellite =
        epoch_2(0, 0, &["G 1"]) + &[1.0, 2.0, 3.0].map(|number| field(number, "")).concat() + "\n";
    let header = header_2('G', "    C1    L1    P2");
    let (whole, told) = read_list(&header, &satellite);
    assert_eq!((whole.len(), told.len()), (2, 0));
    let header = header.replace("    C1    L1    P2", "    C1          P2");
    let (observed, told) = read_list(&header, &satellite);
    assert_eq!(observed, whole);
    let what = "2 observation types instead of 3; columns without a name are not read";
    assert_eq!(told, [(2, what.to_owned())]);
    let (observed, told) = read_list(&header.replace("     3    C1", "     x    C1"), &satellite);
    assert_eq!(observed, whole);
    let what = "the number of observation types is unreadable, 2 are named";
    assert_eq!(told, [(2, what.to_owned())]);
}

#[test]
fn observation_types_of_rinex_2_change_in_mid_file() {
    let text = header_2('G', "    C1    L1")
        + &epoch_2(0, 0, &["G 1"])
        + &format!("{}{}\n", field(1000.0, ""), field(2000.0, ""))
        + "                            4  1\n"
        + &record("     3    L1    S1    C1", "# / TYPES OF OBSERV")
        + &epoch_2(1, 0, &["G 1"])
        + &format!("{}{}{}\n", field(2001.0, ""), field(40.0, ""), field(1001.0, ""));
    let epochs = read_whole(&text);
    let after = find(&epochs[1], "G01", "G1C");
    assert_eq!((after.pseudorange_m, after.phase_cycles), (Some(1001.0), Some(2001.0)));
    assert_eq!(after.cn0_dbhz, Some(40.0));
}

/// `rinex` 0.24 makes observations of them.
#[test]
fn slip_records_become_slips() {
    let text = header_3("3.04", 'G', &[("G    4 C1C L1C C2W L2W", "SYS / # / OBS TYPES")])
        + "> 2024 06 24 08 20  0.5000000  6  1\n"
        + &format!("G01{:16}{:16}{:16}{}\n", "", "", "", field(7.0, ""))
        + &epoch_3(1, 0, 2)
        + &["G01", "G02"]
            .map(|name| {
                let fields = [1.0, 2.0, 3.0, 4.0].map(|number| field(number, "  "));
                format!("{name}{}\n", fields.concat())
            })
            .concat();
    let epochs = read_whole(&text);
    assert_eq!(epochs.len(), 1);
    let locks: Vec<u8> = epochs[0].observations.iter().map(|o| o.lock.0).collect();
    assert_eq!(locks, [0, Lock::SLIP, 0, 0], "G01 1C, G01 2W, G02 1C, G02 2W");
}

/// `rinex` 0.24 does not apply them.
#[test]
fn scale_factors_are_divided_out() {
    let records = [
        GPS_TYPES,
        ("E    2 C1X L1X", "SYS / # / OBS TYPES"),
        ("G  100   1 L1C", "SYS / SCALE FACTOR"),
        ("E   10", "SYS / SCALE FACTOR"),
    ];
    let text = header_3("3.04", 'M', &records)
        + &epoch_3(0, 0, 2)
        + &gps("G01", 22_000_000.123, 12_345_678.901, "")
        + &format!("E02{}{}\n", field(220_000.001, ""), field(330_000.005, ""));
    let epochs = read_whole(&text);
    let g01 = find(&epochs[0], "G01", "G1C");
    assert_eq!((g01.pseudorange_m, g01.phase_cycles), (Some(22_000_000.123), Some(123_456.789_01)));
    let e02 = find(&epochs[0], "E02", "E1X");
    assert_eq!((e02.pseudorange_m, e02.phase_cycles), (Some(22_000.000_1), Some(33_000.000_5)));
}

/// `rinex` 0.24 loses such satellites.
#[test]
fn blank_system_letters_mean_the_system_of_the_file() {
    for (system, name) in [('G', "G05"), (' ', "G05"), ('R', "R05")] {
        let text = header_2(system, "    C1")
            + &epoch_2(0, 0, &["  5", " 17"])
            + &format!("{}\n{}\n", field(1.0, ""), field(2.0, ""));
        let epochs = read_whole(&text);
        assert_eq!(epochs[0].observations.len(), 2);
        assert_eq!(epochs[0].observations[0].satellite.to_string(), name);
    }
}

/// `rinex` 0.24 makes 0 of a digit above 7.
#[test]
fn loss_of_lock_digits_keep_their_bits() {
    let mut text = header_3("3.04", 'G', &[GPS_TYPES]) + &epoch_3(0, 0, 10);
    for digit in 0..10 {
        text += &gps(&format!("G{:02}", digit + 1), 1.0, 2.0, &format!("{digit} "));
    }
    let epochs = read_whole(&text);
    for (digit, o) in (0..10).zip(&epochs[0].observations) {
        assert_eq!(o.lock, Lock(digit));
        assert_eq!(o.lock.slipped(), digit % 2 == 1);
        assert_eq!(o.lock.half_cycle_unresolved(), matches!(digit, 2 | 3 | 6 | 7));
    }
}

/// Bit 2 of RINEX 2 says anti-spoofing and not slip; the digit of a pseudorange says nothing.
#[test]
fn anti_spoofing_is_no_slip() {
    let text = header_2('G', "    P2    L2")
        + &epoch_2(0, 0, &["G 1"])
        + &format!("{}{}\n", field(1.0, "1 "), field(2.0, "4 "));
    let o = read_whole(&text)[0].observations[0];
    assert!(!o.lock.slipped() && !o.lock.half_cycle_unresolved());
    assert_eq!(o.lock, Lock(4));
}

/// `rinex` 0.24 lets the second overwrite the first.
#[test]
fn repeated_and_late_epochs_are_skipped() {
    let mut text = header_3("3.04", 'G', &[GPS_TYPES]);
    for (second, range) in [(0, 1.0), (1, 2.0), (1, 3.0), (0, 4.0), (2, 5.0)] {
        text += &epoch_3(second, 0, 1);
        text += &gps("G01", range, 7.0, if range == 4.0 { "1 " } else { "  " });
    }
    let (epochs, damage) = read(&text);
    let ranges: Vec<_> = epochs.iter().map(|e| e.observations[0].pseudorange_m.unwrap()).collect();
    assert_eq!((ranges, damage), (vec![1.0, 2.0, 5.0], 2));
    assert!(epochs[2].observations[0].lock.slipped(), "the slip of a skipped epoch stays");
}

#[test]
fn a_date_far_ahead_costs_its_own_epoch_only() {
    for wrong in [0, 1, 20] {
        let mut text = header_3("3.04", 'G', &[GPS_TYPES]);
        for second in 0..30 {
            let line = epoch_3(second, 0, 1);
            text += &if second == wrong { line.replace("2024", "2042") } else { line };
            text += &gps("G01", f64::from(second) + 1.0, 7.0, "");
        }
        let (epochs, damage) = read(&text);
        assert_eq!((epochs.len(), damage), (29, 1), "epoch {wrong}");
    }
}

#[test]
fn a_long_gap_costs_nothing() {
    let mut text = header_3("3.04", 'G', &[GPS_TYPES]);
    for second in [0, 1, 2, 40, 41, 42] {
        text += &epoch_3(second, 0, 1);
        text += &gps("G01", f64::from(second) + 1.0, 7.0, "");
    }
    let ranges: Vec<_> =
        read_whole(&text).iter().map(|e| e.observations[0].pseudorange_m.unwrap()).collect();
    assert_eq!(ranges, [1.0, 2.0, 3.0, 41.0, 42.0, 43.0]);
}

#[test]
fn events_of_every_kind() {
    let text = header_3("3.04", 'G', &[GPS_TYPES])
        + &epoch_3(0, 1, 1)
        + &gps("G01", 1.0, 2.0, "")
        + ">                              2  0\n"
        + ">                              3  2\n"
        + &record("NEW", "MARKER NAME")
        + &record("        1.5000        0.0000        0.0000", "ANTENNA: DELTA H/E/N")
        + "> 2024 06 24 08 20  0.1234567  5  0\n"
        + &epoch_3(1, 0, 0)
        + &epoch_3(2, 0, 1)
        + &gps("G01", 3.0, 4.0, "");
    let mut reader = open(&text);
    let mut epoch = AntennaEpoch::default();
    let mut seen = Vec::new();
    while reader.next_epoch(&mut epoch).unwrap() {
        seen.push((epoch.power_failure, epoch.observations.len()));
    }
    assert_eq!(seen, [(true, 1), (false, 0), (false, 1)]);
    assert_eq!(reader.header().marker_name, "NEW");
    assert_eq!(reader.header().antenna_delta_hen_m, [1.5, 0.0, 0.0]);
    assert_eq!(reader.damage(), []);
}

#[test]
fn more_than_twelve_satellites_in_rinex_2() {
    let names: Vec<String> = (1..=26).map(|n| format!("G{n:2}")).collect();
    let mut text = header_2('G', "    C1    L1    L2    P2    P1    S1");
    text += &format!(" 99 12 31 23 59 59.9900000  0 26{}\n", names[..12].concat());
    text += &format!("{:32}{}\n{:32}{}\n", "", names[12..24].concat(), "", names[24..].concat());
    for number in 1..=26 {
        text +=
            &(0..5).map(|column| field(f64::from(number * 10 + column), "")).collect::<String>();
        text += &format!("\n{}\n", field(40.0, ""));
    }
    let epochs = read_whole(&text);
    let calendar = epochs[0].time.calendar();
    assert_eq!((calendar.year, calendar.second), (1999, 59.99));
    assert_eq!(epochs[0].observations.len(), 3 * 26, "1C, 1W and 2W");
    let last = find(&epochs[0], "G26", "G1C");
    assert_eq!((last.pseudorange_m, last.phase_cycles), (Some(260.0), Some(261.0)));
    assert_eq!(find(&epochs[0], "G26", "G2W").phase_cycles, Some(262.0));
    assert_eq!(find(&epochs[0], "G26", "G1W").pseudorange_m, Some(264.0));
}

/// Both pseudoranges of a band stay; the phase goes with one of them.
#[test]
fn codes_of_rinex_2() {
    for (types, signals) in [
        ("    C1    L1", "G1C"),
        ("    P1    L1", "G1W"),
        ("    C2    L2", "G2C"),
        ("    P2    L2", "G2W"),
        ("    C2    L2    P2", "G2C G2W+"),
        ("    P1    L1    C1", "G1W G1C+"),
        ("    C5    L5", "G5X"),
    ] {
        let count = types.split_whitespace().count();
        let fields = [1.0, 2.0, 3.0].map(|number| field(number, ""))[..count].concat();
        let text = header_2('G', types) + &epoch_2(0, 0, &["G 1"]) + &fields + "\n";
        let epochs = read_whole(&text);
        let found = signals.split(' ').map(|signal| {
            let phase = signal.ends_with('+') || !signals.contains('+');
            let o = find(&epochs[0], "G01", signal.trim_end_matches('+'));
            o.pseudorange_m.is_some() && o.phase_cycles.is_some() == phase
        });
        assert!(found.clone().all(|right| right), "{types}: {:?}", epochs[0].observations);
        assert_eq!(epochs[0].observations.len(), found.count());
    }
}

#[test]
fn squared_phases_are_half_cycles() {
    let text = header_2('G', "    L1    L2").replace(
        "     2    L1",
        &(record("     1     2", "WAVELENGTH FACT L1/2") + "     2    L1"),
    ) + &epoch_2(0, 0, &["G 1"])
        + &format!("{}{}\n", field(1.0, ""), field(2.0, "1 "))
        + &epoch_2(1, 0, &["G 1"])
        + &format!("{}{}\n", field(1.0, "2 "), field(2.0, "2 "));
    let epochs = read_whole(&text);
    let locks: Vec<u8> = epochs.iter().flat_map(|e| &e.observations).map(|o| o.lock.0).collect();
    assert_eq!(locks, [0, 3, 2, 0]);
}

#[test]
fn b1i_is_band_2_in_every_version() {
    for (version, code, signal) in [
        ("3.02", "C1I", "C2I"),
        ("3.02", "C1X", "C2X"),
        ("3.03", "C2I", "C2I"),
        ("3.04", "C1I", "C2I"),
        ("3.04", "C1P", "C1P"),
        ("4.02", "C1X", "C1X"),
    ] {
        let types = format!("C    1 {code}");
        let text = header_3(version, 'C', &[(&types, "SYS / # / OBS TYPES")])
            + &epoch_3(0, 0, 1)
            + &format!("C11{}\n", field(1.0, ""));
        assert_eq!(read_whole(&text)[0].observations[0].signal.to_string(), signal, "{version}");
    }
}

#[test]
fn time_scales() {
    for (system, name, offset_s) in [
        ('G', "GPS", 0.0),
        ('R', "GLO", 18.0),
        ('C', "BDT", 14.0),
        ('M', "GAL", 0.0),
        ('R', "   ", 18.0),
    ] {
        let first = format!("  2024     6    24     8    20    0.0000000     {name}");
        let text = header_3("3.04", system, &[GPS_TYPES, (&first, "TIME OF FIRST OBS")])
            + &epoch_3(0, 0, 1)
            + &gps("G01", 1.0, 2.0, "");
        assert_eq!(tow_s(&read_whole(&text)[0]), 116_400.0 + offset_s, "{system} {name}");
    }
}

#[test]
fn clock_offsets() {
    for (applied, offset_s) in [("     0", Some(-0.000_123_456_789)), ("     1", None)] {
        let records = [GPS_TYPES, (applied, "RCV CLOCK OFFS APPL")];
        let text = header_3("3.04", 'G', &records)
            + &epoch_3(0, 0, 1).replace("  1\n", "  1      -0.000123456789\n")
            + &gps("G01", 1.0, 2.0, "");
        assert_eq!(read_whole(&text)[0].clock_offset_s, offset_s);
    }
}

#[test]
fn glonass_channels_and_biases() {
    let records = [
        ("R    2 C1C L1C", "SYS / # / OBS TYPES"),
        ("  3 R01  1 R02 -4 R24  2", "GLONASS SLOT / FRQ #"),
        (" C1C  -71.940 C1P  -71.940 C2C  -71.940 C2P  -71.940", "GLONASS COD/PHS/BIS"),
        ("    18", "LEAP SECONDS"),
        ("R L1C  0.25000  02 R01 R02", "SYS / PHASE SHIFT"),
    ];
    let reader = open(&header_3("3.04", 'R', &records));
    let channels: Vec<_> = reader.glonass_channels().iter().map(|(slot, k)| (*slot, *k)).collect();
    assert_eq!(channels, [(1, 1), (2, -4), (24, 2)]);
    assert_eq!(reader.header().glonass_biases_m.len(), 4);
    assert_eq!(reader.header().glonass_biases_m[0].1, -71.94);
    assert_eq!(reader.header().leap_seconds, Some(18));
    assert_eq!(reader.header().phase_shifts[0].correction_cycles, Some(0.25));
    assert_eq!(reader.header().phase_shifts[0].satellites.len(), 2);
    assert_eq!(reader.damage(), []);
}

#[test]
fn hundred_epochs_a_second_and_missing_fractions() {
    let mut text = header_3("3.04", 'G', &[GPS_TYPES]);
    for hundredth in 0..100 {
        let second = if hundredth == 0 { " 0".to_owned() } else { format!(" 0.{hundredth:02}") };
        text += &format!("> 2024 06 24 08 20{second:<11}  0  1\n");
        text += &gps("G01", 1.0, 2.0, "");
    }
    let epochs = read_whole(&text);
    assert_eq!(epochs.len(), 100);
    assert_eq!(epochs[99].time.as_nanoseconds() - epochs[0].time.as_nanoseconds(), 990_000_000);
}

#[test]
fn windows_line_ends_comments_and_bytes_that_are_no_text() {
    let records = [GPS_TYPES, ("Stra\u{df}e \u{fffd}", "MARKER NAME"), ("any", "COMMENT")];
    let text = header_3("3.04", 'G', &records)
        + &epoch_3(0, 0, 2)
        + &gps("G01", 1.0, 2.0, "")
        + &record("between", "COMMENT")
        + &gps("G02", 1.0, 2.0, "")
        + "\n"
        + &epoch_3(1, 0, 1)
        + &gps("G02", 1.0, 2.0, "");
    let counts: Vec<_> =
        read_whole(&text.replace('\n', "\r\n")).iter().map(|e| e.observations.len()).collect();
    assert_eq!(counts, [2, 1]);
}

#[test]
fn other_files_are_refused() {
    for (text, found) in [
        (record("     3.04           N: GNSS NAV DATA", "RINEX VERSION / TYPE"), "navigation"),
        (record("     5.00           OBSERVATION DATA    M", "RINEX VERSION / TYPE"), "version"),
        (record("     3.04           OBSERVATION DATA    M", "RINEX VERSION / TYPE"), "header"),
        (header_3("3.04", 'M', &[]), "observation types"),
        (record("2.0   COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE"), "compact"),
    ] {
        let input = std::io::Cursor::new(text.into_bytes());
        let error = ObservationReader::new(input, "x.obs").unwrap_err().to_string();
        assert!(error.contains(found) && error.starts_with("x.obs"), "{error}");
    }
}

/// Ten epochs of five satellites.
fn healthy_3() -> Vec<String> {
    let mut lines = Vec::new();
    for second in 0..10 {
        lines.push(epoch_3(second, 0, 5));
        for number in 1..=5 {
            let range = f64::from(second * 100 + number);
            lines.push(gps(&format!("G{number:02}"), range, range + 0.5, ""));
        }
    }
    lines
}

/// Ten epochs of five satellites with two lines each.
fn healthy_2() -> Vec<String> {
    let mut lines = Vec::new();
    for second in 0..10 {
        lines.push(epoch_2(second, 0, &["G 1", "G 2", "G 3", "G 4", "G 5"]));
        for number in 1..=5 {
            let numbers = (0..5).map(|column| f64::from(second * 100 + number * 10 + column));
            lines.push(numbers.map(|number| field(number + 0.5, "")).collect::<String>() + "\n");
            lines.push(field(45.0, "") + "\n");
        }
    }
    lines
}

/// Breaks each line in turn: no epoch but its own may change (slips aside), nothing false appears.
fn break_each_line(
    header: &str,
    lines: &[String],
    breaks: impl Fn(&mut Vec<String>, usize),
    lost_at_most: usize,
) {
    let whole = read_whole(&(header.to_owned() + &lines.concat()));
    for index in 0..lines.len() {
        let mut broken = lines.to_vec();
        breaks(&mut broken, index);
        let (epochs, damage) = read(&(header.to_owned() + &broken.concat()));
        assert!(damage > 0, "line {index}: nothing noticed");
        let changed = whole.iter().filter(|epoch| !epochs.iter().any(|e| same(e, epoch)));
        assert!(changed.count() <= lost_at_most, "line {index}");
        for o in epochs.iter().flat_map(|e| e.observations.iter().map(move |o| (e.time, o))) {
            let known =
                whole.iter().any(|e| e.time == o.0 && e.observations.iter().any(|w| part(o.1, w)));
            assert!(known, "line {index}: {:?} at {} is false", o.1, o.0);
        }
    }
}

fn same(a: &AntennaEpoch, b: &AntennaEpoch) -> bool {
    a.time == b.time
        && a.observations.len() == b.observations.len()
        && a.observations
            .iter()
            .zip(&b.observations)
            .all(|(a, b)| Observation { lock: b.lock, ..*a } == *b)
}

/// Whether nothing in `a` differs from `b`, but values may be missing.
fn part(a: &Observation, b: &Observation) -> bool {
    let fits = |a: Option<f64>, b: Option<f64>| a.is_none() || a == b;
    (a.satellite, a.signal) == (b.satellite, b.signal)
        && fits(a.pseudorange_m, b.pseudorange_m)
        && fits(a.phase_cycles, b.phase_cycles)
        && fits(a.doppler_hz, b.doppler_hz)
        && fits(a.cn0_dbhz, b.cn0_dbhz)
}

fn delete(lines: &mut Vec<String>, index: usize) {
    lines.remove(index);
}

fn garble(lines: &mut Vec<String>, index: usize) {
    lines[index] = "#?%$ nothing of this is right\n".to_owned();
}

fn insert(lines: &mut Vec<String>, index: usize) {
    lines.insert(index, "#?%$ nothing of this is right\n".to_owned());
}

fn join_with_next(lines: &mut Vec<String>, index: usize) {
    if index + 1 == lines.len() {
        return garble(lines, index);
    }
    let length = lines[index].len() - 1;
    lines[index].truncate(length);
}

fn shift(lines: &mut Vec<String>, index: usize) {
    lines[index].insert(5, '1');
}

#[test]
fn one_bad_line_in_rinex_3() {
    let header = header_3("3.04", 'G', &[GPS_TYPES]);
    for breaks in [delete, garble, insert, shift] {
        break_each_line(&header, &healthy_3(), breaks, 1);
    }
    // Two lines become one.
    break_each_line(&header, &healthy_3(), join_with_next, 2);
}

#[test]
fn one_bad_line_in_rinex_2() {
    let header = header_2('G', "    C1    L1    L2    P2    P1    S1");
    for breaks in [delete, garble, insert, shift] {
        break_each_line(&header, &healthy_2(), breaks, 1);
    }
    break_each_line(&header, &healthy_2(), join_with_next, 2);
}

/// Files joined one behind the other: the second header is obeyed, its phases begin anew.
#[test]
fn joined_files_are_read_with_their_own_headers() {
    let first = header_3("3.05", 'M', &[GPS_TYPES])
        + &epoch_3(0, 0, 1)
        + &gps("G05", 2e7, 1e8, "")
        + &epoch_3(1, 0, 1)
        + &gps("G05", 2e7, 1e8, "");
    let second = header_3("3.04", 'M', &[("G    2 L1C C1C", "SYS / # / OBS TYPES")])
        + &epoch_3(2, 0, 1)
        + &format!("G05{}{}\n", field(1.2e8, ""), field(2.1e7, ""))
        + &epoch_3(3, 0, 1)
        + &format!("G05{}{}\n", field(1.2e8, ""), field(2.1e7, ""));
    let (epochs, damage) = read(&(first.clone() + &second));
    let g05: Vec<&Observation> = epochs.iter().map(|e| find(e, "G05", "G1C")).collect();
    assert_eq!(
        g05.iter().map(|o| o.phase_cycles.unwrap()).collect::<Vec<_>>(),
        [1e8, 1e8, 1.2e8, 1.2e8]
    );
    assert_eq!(g05[2].pseudorange_m, Some(2.1e7));
    assert_eq!(
        g05.iter().map(|o| o.lock.slipped()).collect::<Vec<_>>(),
        [false, false, true, false]
    );
    assert_eq!(damage, 1);

    let older = header_2('G', "    C1    L1") + &epoch_2(4, 0, &["G05"]) + &field(2e7, "") + "\n";
    let damaged = second.replacen("3.04", "9.04", 1);
    for (behind, told) in [(older, "joined"), (damaged, "RINEX version \"9.04\"")] {
        let mut reader = open(&(first.clone() + &behind));
        let mut epoch = AntennaEpoch::default();
        let error = loop {
            match reader.next_epoch(&mut epoch) {
                Ok(true) => {}
                Ok(false) => panic!("no error"),
                Err(error) => break error.to_string(),
            }
        };
        assert!(error.contains("line 8") && error.contains(told), "{error}");
    }
}

/// Codes that the format does not have are named, and nothing else takes their place.
#[test]
fn codes_that_do_not_exist_are_named() {
    let types = [
        ("C    4 C1C L1C C7I L7I", "SYS / # / OBS TYPES"),
        ("G    6 C1  L1  D1  S1  C2W L2W", "SYS / # / OBS TYPES"),
        ("E    1 C7P", "SYS / # / OBS TYPES"),
        ("J    1 I1 ", "SYS / # / OBS TYPES"),
    ];
    let text = header_3("3.04", 'M', &types)
        + &epoch_3(0, 0, 2)
        + &format!("C30{}{}{}\n", field(2e7, ""), field(1e8, ""), field(2.1e7, ""))
        + &format!("G05{}{}\n", " ".repeat(64), field(2.3e7, ""));
    let mut reader = open(&text);
    let mut epoch = AntennaEpoch::default();
    assert!(reader.next_epoch(&mut epoch).unwrap());
    let signals: Vec<String> = epoch.observations.iter().map(|o| o.signal.to_string()).collect();
    assert_eq!(signals, ["C7I", "G2W"]);
    let damage: Vec<String> = reader.damage().iter().map(|d| d.what.to_string()).collect();
    assert_eq!(damage.len(), 3, "{damage:?}");
    for named in
        ["GPS has no observations C1, L1, D1, S1", "BeiDou has no observations C1C, L1C", "C7P"]
    {
        assert!(damage.iter().any(|what| what.contains(named)), "{named}: {damage:?}");
    }
}

/// B2b, the whole signal and its parts.
#[test]
fn new_codes_of_beidou_are_read() {
    let types = ("C    3 C7D C7P C7Z", "SYS / # / OBS TYPES");
    let text = header_3("3.04", 'C', &[types])
        + &epoch_3(0, 0, 1)
        + &format!("C30{}{}{}\n", field(2e7, ""), field(2.1e7, ""), field(2.2e7, ""));
    let epochs = read_whole(&text);
    assert_eq!(find(&epochs[0], "C30", "C7Z").pseudorange_m, Some(2.2e7));
    assert_eq!(epochs[0].observations.len(), 3);
}

/// What writers do wrong without spoiling an observation is no damage to the phases.
#[test]
fn harmless_faults_touch_no_phase() {
    let shifts = [
        GPS_TYPES,
        ("G 1C", "SYS / PHASE SHIFT"),
        ("G 2X  0.25000", "SYS / PHASE SHIFT"),
        ("?", "SYS / PHASE SHIFT"),
    ];
    let nan = format!("{:>14}  ", "NaN");
    let with_nan = format!("G07{}{nan}{}{}\n", field(2.1e7, ""), field(-12.5, ""), field(45.0, ""));
    let epoch = |second: u32| epoch_3(second, 0, 2) + &gps("G05", 2e7, 1e8, "") + &with_nan;
    let text = header_3("3.05", 'M', &shifts) + &epoch(0) + &epoch(1) + "END OF FILE\n";
    let epochs = read_whole(&text);
    assert_eq!(find(&epochs[1], "G07", "G1C").phase_cycles, None);
    assert_eq!(find(&epochs[1], "G07", "G1C").pseudorange_m, Some(2.1e7));
    assert!(epochs.iter().flat_map(|e| &e.observations).all(|o| o.lock.0 == 0));
    let header = open(&text).header().clone();
    assert_eq!(header.phase_shifts.len(), 2);
    assert_eq!(header.phase_shifts[0].correction_cycles, None);
    assert_eq!(header.phase_shifts[1].correction_cycles, Some(0.25));
}

/// An epoch line that states a satellite more than follow: only one that was there before and is
/// missing can have lost its digit.
#[test]
fn a_wrong_count_of_satellites_slips_nothing_that_is_there() {
    let g05 = gps("G05", 2e7, 1e8, "");
    let g07 = gps("G07", 2.1e7, 1.1e8, "");
    let text = header_3("3.05", 'M', &[GPS_TYPES])
        + &(epoch_3(0, 0, 3) + &g05 + &g07)
        + &(epoch_3(1, 0, 3) + &g05 + &g07)
        + &(epoch_3(2, 0, 2) + &g05)
        + &(epoch_3(3, 0, 3) + &g05 + &g07)
        + &(epoch_3(4, 0, 1) + &g05 + &g07);
    let (epochs, damage) = read(&text);
    let slipped = |second: usize| -> Vec<String> {
        let slipped = epochs[second].observations.iter().filter(|o| o.lock.slipped());
        slipped.map(|o| o.satellite.to_string()).collect()
    };
    assert_eq!([0, 1, 2, 4].map(slipped), [const { Vec::<String>::new() }; 4]);
    assert_eq!(slipped(3), ["G07"]);
    assert_eq!(damage, 5);
}

/// A phase that is lost in damage takes its digit along: the next one may have slipped.
#[test]
fn a_lost_digit_is_a_slip() {
    let header = header_3("3.04", 'G', &[GPS_TYPES]);
    let lines = healthy_3();
    let mut damaged = lines.clone();
    damaged[8] = damaged[8].replacen(".500", ".5x0", 1);
    let (epochs, damage) = read(&(header + &damaged.concat()));
    assert_eq!(damage, 1);
    assert_eq!(find(&epochs[1], "G02", "G1C").phase_cycles, None);
    let slips = |epoch: &AntennaEpoch| {
        let slipped = epoch.observations.iter().filter(|o| o.lock.slipped());
        slipped.map(|o| o.satellite.to_string()).collect::<Vec<_>>()
    };
    assert_eq!(epochs.iter().map(|e| slips(e).len()).sum::<usize>(), 1);
    assert_eq!(slips(&epochs[2]), ["G02"]);
}

#[test]
fn files_cut_at_every_byte() {
    for (header, lines) in [
        (header_3("3.04", 'G', &[GPS_TYPES]), healthy_3()),
        (header_2('G', "    C1    L1    L2    P2    P1    S1"), healthy_2()),
    ] {
        let text = header.clone() + &lines.concat();
        let whole = read_whole(&text);
        for end in header.len()..text.len() {
            let (epochs, _) = read(&text[..end]);
            let complete = text[header.len()..end].lines().count() / (lines.len() / 10);
            assert!(epochs.len() + 1 >= complete, "cut at {end}");
            for (epoch, whole) in epochs.iter().zip(&whole) {
                assert_eq!(epoch.time, whole.time);
                let known = |o: &Observation| whole.observations.iter().any(|w| part(o, w));
                assert!(epoch.observations.iter().all(known), "cut at {end}");
            }
        }
    }
}
