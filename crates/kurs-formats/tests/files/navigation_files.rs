//! Navigation files of a few records each: what every record means, and every way to break it.
#![allow(clippy::unwrap_used)] // a test

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::Vector;
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;
use kurs_formats::navigation::{self, ReadSummary};
use kurs_formats::source::{ReadError, Source};
use proptest::prelude::*;

/// Records of station MOJN, 2020-06-25, one for each layout.
const RECORDS: &str = "\
G15 2020 06 25 04 00 00-2.219416201115e-04 2.614797267597e-12 0.000000000000e+00
     8.800000000000e+01-1.656250000000e+00 5.422368720565e-09 1.932456693161e+00
    -1.508742570877e-07 1.236872794107e-02 9.519979357719e-06 5.153706258774e+03
     3.600000000000e+05-3.073364496231e-07-1.729840202902e+00-2.346932888031e-07
     9.279236419157e-01 1.816562500000e+02 8.856049299601e-01-8.295345534438e-09
     5.157357681791e-10 1.000000000000e+00 2.111000000000e+03 0.000000000000e+00
     2.000000000000e+00 0.000000000000e+00-1.071020960808e-08 8.800000000000e+01
     3.528180000000e+05 4.000000000000e+00
E12 2020 06 25 02 50 00 5.738438514527e-03-1.884359335236e-11 0.000000000000e+00
     8.100000000000e+01 2.353125000000e+01 2.895477751128e-09 4.954544388089e-02
     1.104548573494e-06 3.694026963785e-04-4.675239324570e-07 5.440605503082e+03
     3.558000000000e+05-5.774199962616e-08 2.295360174165e+00 3.725290298462e-09
     9.883732807087e-01 3.639062500000e+02 2.563638737386e-01-5.910960500945e-09
     1.871506527187e-10 5.170000000000e+02 2.111000000000e+03
     3.120000000000e+00 0.000000000000e+00-1.303851604462e-08-1.280568540096e-08
     3.570350000000e+05
E12 2020 06 25 02 50 00 5.738438921981e-03-1.884359335236e-11 0.000000000000e+00
     8.100000000000e+01 2.353125000000e+01 2.895477751128e-09 4.954544388089e-02
     1.104548573494e-06 3.694026963785e-04-4.675239324570e-07 5.440605503082e+03
     3.558000000000e+05-5.774199962616e-08 2.295360174165e+00 3.725290298462e-09
     9.883732807087e-01 3.639062500000e+02 2.563638737386e-01-5.910960500945e-09
     1.871506527187e-10 2.580000000000e+02 2.111000000000e+03
     3.120000000000e+00 0.000000000000e+00-1.303851604462e-08 0.000000000000e+00
     3.570900000000e+05
C05 2020 06 25 01 00 00-5.161854205653e-04-6.704770072474e-11 0.000000000000e+00
     1.000000000000e+00-5.448906250000e+02-8.828939189327e-10-3.217802993496e-01
    -1.811934635043e-05 3.731949254870e-04 6.132759153843e-06 6.493354141235e+03
     3.492000000000e+05 1.396983861923e-09-2.974700793988e+00 6.891787052155e-08
     1.082992475555e-01-1.850625000000e+02-1.631268101001e+00 1.955081436989e-09
     5.096640866978e-10 0.000000000000e+00 7.550000000000e+02
     2.000000000000e+00 0.000000000000e+00 1.000000000000e-10-9.300000000000e-09
     3.492276000000e+05 0.000000000000e+00
C10 2020 06 25 02 00 00-2.534879604355e-04 9.965361869035e-12 0.000000000000e+00
     1.000000000000e+00 1.555312500000e+02 9.532539925693e-10-1.959446962648e+00
     5.124136805534e-06 6.820128997788e-03 2.304650843143e-05 6.492976007462e+03
     3.528000000000e+05-3.222376108170e-07 4.917753388168e-01-3.622844815254e-07
     9.005347360293e-01-4.737187500000e+02-2.592951008966e+00-1.702213761179e-09
    -9.321816862518e-10 0.000000000000e+00 7.550000000000e+02
     2.000000000000e+00 0.000000000000e+00 6.200000000000e-09 2.600000000000e-09
     3.528180000000e+05 0.000000000000e+00
J02 2020 06 25 18 00 00-7.427297532558e-07-2.273736754432e-13 0.000000000000e+00
     5.000000000000e+00-2.418125000000e+02 2.694755104509e-09 2.462372588456e+00
    -7.109716534615e-06 7.533840765245e-02 1.084804534912e-05 6.493149652481e+03
     4.104000000000e+05 8.959323167801e-07 8.282420863502e-02-5.289912223816e-07
     7.506218927919e-01-1.735000000000e+02-1.583493914443e+00-2.819760311478e-09
    -6.714565402886e-10 2.000000000000e+00 2.111000000000e+03 1.000000000000e+00
     2.800000000000e+00 0.000000000000e+00 9.313225746155e-10 7.730000000000e+02
     4.097880000000e+05 0.000000000000e+00
R05 2020 06 25 04 45 00 5.293264985085e-05 9.094947017729e-13 3.618000000000e+05
    -6.018835449219e+03 2.992804527283e+00-9.313225746155e-10 0.000000000000e+00
    -9.376655761719e+03-9.520215988159e-01 1.862645149231e-09 1.000000000000e+00
     2.296187207031e+04 3.942489624023e-01-1.862645149231e-09 0.000000000000e+00
                         .999999999999e+09 1.500000000000e+01
";

/// A header record with its label in column 61.
fn header(content: &str, label: &str) -> String {
    format!("{content:<60}{label}\n")
}

fn file_3(records: &str) -> String {
    let first = "     3.05           NAVIGATION DATA     MIXED";
    [&header(first, "RINEX VERSION / TYPE"), &header("", "END OF HEADER"), records].concat()
}

fn try_read(bytes: &[u8]) -> Result<(NavigationData, ReadSummary), ReadError> {
    let mut data = NavigationData::default();
    let mut source = Source::new(std::io::Cursor::new(bytes.to_vec()), "test.nav")?;
    let summary = navigation::read(&mut source, &mut data)?;
    Ok((data, summary))
}

fn read(text: &str) -> (NavigationData, ReadSummary) {
    try_read(text.as_bytes()).unwrap()
}

fn satellites(data: &NavigationData) -> Vec<String> {
    data.ephemerides.iter().map(|record| record.satellite().to_string()).collect()
}

/// Positions and clocks that RTKLIB 2.4.3 (pyrtklib 0.2.7) reads and computes from the same lines,
/// 2500 s after the reference time (GLONASS: 850 s; its steps and its gravitational constant make
/// 1 mm).
#[test]
fn every_layout_as_rtklib_reads_it() {
    let (data, summary) = read(&file_3(RECORDS));
    assert_eq!(summary.damage.total(), 0, "{:?}", summary.damage);
    let expected = [
        (
            "G15",
            2500.0,
            [26_465_625.336_18, 3_897_152.179_04, -1_272_861.898_69],
            -2.219_560_832_050_842e-4,
        ),
        (
            "E12",
            2500.0,
            [-2_613_909.048_6, 25_784_173.488_57, 14_279_974.783_83],
            5.738_391_091_318_106e-3,
        ),
        (
            "E12",
            2500.0,
            [-2_613_909.048_6, 25_784_173.488_57, 14_279_974.783_83],
            5.738_391_498_772_105e-3,
        ),
        (
            "C05",
            2500.0,
            [21_875_118.939_91, 36_011_951.330_05, -1_036_556.172_38],
            -5.163_528_900_853_255e-4,
        ),
        (
            "C10",
            2500.0,
            [-6_129_290.563_26, 27_650_185.112_98, 31_311_497.646_87],
            -2.534_438_174_887_063e-4,
        ),
        (
            "R05",
            850.0,
            [-3_494_077.779_61, -10_277_756.762_95, 23_097_438.268_49],
            5.293_342_292_134_651e-5,
        ),
        (
            "J02",
            2500.0,
            [-25_762_735.198_92, 24_343_836.330_93, 27_728_792.446_76],
            -8.404_112_940_782_738e-7,
        ),
    ];
    let records: Vec<&Ephemeris> = data.ephemerides.iter().collect();
    assert_eq!(records.len(), expected.len());
    for (record, (name, age_s, [x, y, z], clock_s)) in records.iter().zip(expected) {
        assert_eq!(record.satellite().to_string(), name);
        let state = record.state(record.reference_time() + age_s).unwrap();
        let apart_m = (state.position_m - Vector::new(x, y, z)).norm();
        let limit_m = if name == "R05" { 2e-3 } else { 2e-5 };
        assert!(apart_m < limit_m, "{name}: {apart_m} m");
        assert!((state.clock_s - clock_s).abs() < 1e-13, "{name}: {}", state.clock_s);
    }
}

#[test]
fn times_are_on_the_gps_scale() {
    let (data, _) = read(&file_3(RECORDS));
    let tow_s = |name: &str| {
        let satellite: Satellite = name.parse().unwrap();
        let record = data.ephemerides.iter().find(|record| record.satellite() == satellite);
        record.unwrap().reference_time().tow_s()
    };
    assert_eq!(tow_s("G15"), 360_000.0);
    assert_eq!(tow_s("C05"), 349_200.0 + 14.0); // BDT
    assert_eq!(tow_s("R05"), 4.0 * 86_400.0 + 4.75 * 3600.0 + 18.0); // UTC
    assert_eq!(data.ephemerides.glonass_channel(Satellite::new(System::Glonass, 5)), Some(1));
}

/// The GPS record of above as RINEX 2.11 writes it.
#[test]
fn rinex_2() {
    let mut lines = RECORDS.lines().take(8).map(|line| line[1..].replace('e', "D"));
    let first = lines.next().unwrap().replace("15 2020 06 25 04 00 00", "15 20  6 25  4  0  0.0");
    let records: String = core::iter::once(first).chain(lines).map(|line| line + "\r\n").collect();
    let text = [
        header("     2.11           N: GPS NAV DATA", "RINEX VERSION / TYPE"),
        header("    0.1118D-07  0.7451D-08 -0.5960D-07 -0.5960D-07", "ION ALPHA"),
        header("    0.9011D+05  0.0000D+00 -0.1966D+06 -0.6554D+05", "ION BETA"),
        header(
            "    0.130385160446D-07 0.373034936274D-13   589824     1575",
            "DELTA-UTC: A0,A1,T,W",
        ),
        header("    15", "LEAP SECONDS"),
        header("", "END OF HEADER"),
        records,
    ];
    let (data, summary) = read(&text.concat());
    assert_eq!((satellites(&data), summary.damage.total()), (vec!["G15".to_owned()], 0));
    let (newer, _) = read(&file_3(RECORDS));
    assert_eq!(data.ephemerides.iter().next(), newer.ephemerides.iter().next());
    let gps = data.ionosphere.gps.unwrap();
    assert_eq!((gps.alpha[0], gps.beta[3]), (1.118e-8, -6.554e4));
    assert_eq!(data.leap_seconds, Some(15));
    assert_eq!(data.utc[0].bias_s, 1.303_851_604_46e-8);
    assert_eq!(data.utc[0].reference_time, GpsTime::from_week_tow(1575, 589_824.0).unwrap());
}

/// The GLONASS record of above as RINEX 2.11 writes it.
#[test]
fn rinex_2_glonass() {
    let lines: Vec<String> = RECORDS
        .lines()
        .skip_while(|line| !line.starts_with("R05"))
        .take(4)
        .map(|line| line[1..].to_owned())
        .collect();
    let first = lines[0].replace("05 2020 06 25 04 45 00", " 5 20  6 25  4 45  0.0");
    let records = [first, lines[1..].join("\n")].join("\n");
    let text = [
        header("     2.11           G: GLONASS NAV DATA", "RINEX VERSION / TYPE"),
        header("", "END OF HEADER"),
        records,
    ];
    let (data, _) = read(&text.concat());
    let (newer, _) = read(&file_3(RECORDS));
    let satellite = Satellite::new(System::Glonass, 5);
    let time = data.ephemerides.iter().next().unwrap().reference_time() + 100.0;
    assert_eq!(data.ephemerides.state(satellite, time), newer.ephemerides.state(satellite, time));
}

#[test]
fn rinex_4_frames() {
    let lnav = RECORDS.lines().take(8).collect::<Vec<_>>().join("\n");
    let text = [
        &header("     4.00           NAVIGATION DATA     M", "RINEX VERSION / TYPE"),
        &header("    18    18  1929     7", "LEAP SECONDS"),
        &header("", "END OF HEADER"),
        "> STO C21 CNVX\n",
        "    2023 03 12 00 20 00 BDGA\n",
        "     2.286000000000e+03-2.502929419279e-08 2.664535259100e-14 6.776263578034e-21\n",
        "> EPH G15 LNAV\n",
        &lnav,
        "\n> EPH G15 CNAV\n",
        &lnav,
        "\n> ION G12 LNAV\n",
        "    2023 03 12 00 08 54 3.259629011154e-08 7.450580596924e-09-1.788139343262e-07\n",
        "     0.000000000000e+00 1.351680000000e+05 0.000000000000e+00-2.621440000000e+05\n",
        "     1.310720000000e+05\n",
        "> ION E02 IFNV\n",
        "    2023 03 12 00 11 25 1.607500000000e+02 3.710937500000e-01 9.063720703125e-03\n",
        "     0.000000000000e+00\n",
        "> EOP J02 CNVX\n",
        "    2023 03 14 16 51 12-4.024982452393e-02 3.957748413086e-05 0.000000000000e+00\n",
        "                        3.562908172607e-01 2.602100372314e-03 0.000000000000e+00\n",
    ];
    let (data, summary) = read(&text.concat());
    assert_eq!(summary.damage.total(), 0, "{:?}", summary.damage);
    assert_eq!(satellites(&data), ["G15"]);
    let past: Vec<&str> = summary.read_past.keys().map(String::as_str).collect();
    assert_eq!(past, ["G CNAV", "J EOP CNVX"]);
    let gps = data.ionosphere.gps.unwrap();
    assert_eq!((gps.alpha[3], gps.beta[0], gps.beta[3]), (0.0, 135_168.0, 131_072.0));
    assert_eq!(data.ionosphere.galileo, Some([160.75, 0.371_093_75, 9.063_720_703_125e-3]));
    let offset = data.time_offsets[0];
    assert_eq!((offset.minuend, offset.subtrahend), (System::BeiDou, System::Galileo));
    assert_eq!(offset.bias_s, -2.502_929_419_279e-8);
    assert_eq!(data.leap_seconds, Some(18));
}

/// One record is broken in many ways; the others are read.
#[test]
fn damage_loses_one_record() {
    let others = ["E12", "E12", "C05", "C10", "R05", "J02"];
    for (found, broken) in [
        ("-2.219416201115e-04", "-2.2194x6201115e-04"),
        ("G15 2020 06 25", "G15 2020 06 ab"),
        ("G15 2020 06 25", "G15 2020 13 25"),
        ("G15 2020 06 25", "X15 2020 06 25"),
        ("5.153706258774e+03", "0.000000000000e+00"),
        ("1.236872794107e-02", "1.000000000000e+00"),
        ("1.236872794107e-02", "               NaN"),
        ("3.600000000000e+05", "3.600000000000e+09"),
        ("2.000000000000e+00 0.000000000000e+00", "2.000000000000e+00-5.000000000000e+00"),
        ("     9.279236419157e-01", "E99\n    9.279236419157e-01"),
    ] {
        assert!(RECORDS.contains(found), "{found}");
        let (data, summary) = read(&file_3(&RECORDS.replacen(found, broken, 1)));
        assert_eq!(satellites(&data), others, "{broken}: {:?}", summary.damage);
        assert!(summary.damage.total() > 0, "{broken}");
        assert_eq!(summary.damage.listed()[0].line, 3, "{broken}: {:?}", summary.damage);
    }
}

/// Fields that mean nothing may hold anything; one that can be done without is noted and no more.
#[test]
fn spare_fields_are_not_looked_at() {
    let (right, _) = read(&file_3(RECORDS));
    for (found, filled, noted) in [
        // Spare fields behind the fit interval, as one merged file of IGS has them, and with words.
        ("3.528180000000e+05 4.000000000000e+00\n", "0.499063314480-269 0.499063314480-269", 0),
        ("3.528180000000e+05 4.000000000000e+00\n", "              spare              xxxxx", 0),
        // The flag of the L2 P data; the time of transmission of E12; the age of R05.
        ("2.111000000000e+03 0.000000000000e+00\n", "", 0),
        ("     3.570350000000e+05", "", 1),
        ("-1.862645149231e-09 0.000000000000e+00\n", "", 0),
    ] {
        assert!(RECORDS.contains(found), "{found}");
        let broken = match (filled, noted) {
            ("", 1) => "     3.57035000x000e+05".to_owned(),
            ("", _) => found.replace("0.000000000000e+00\n", "0.00000000rubbish0\n"),
            _ => format!("{}{filled}\n", found.trim_end()),
        };
        let (data, summary) = read(&file_3(&RECORDS.replacen(found, &broken, 1)));
        assert_eq!(satellites(&data), satellites(&right), "{broken}: {:?}", summary.damage);
        assert_eq!(summary.damage.total(), noted, "{broken}: {:?}", summary.damage);
    }
}

/// A date that the calendar does not have stands in the damage as it stands in the file.
#[test]
fn wrong_dates_are_told_as_they_stand() {
    for (satellite, found, broken) in [
        ("G15", "2020 06 25 04 00 00", "2020 13 25 04 00 00"),
        ("R05", "2020 06 25 04 45 00", "2020 06 31 04 45 00"),
    ] {
        let (_, summary) = read(&file_3(&RECORDS.replacen(found, broken, 1)));
        let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage) };
        let what = format!("{satellite}: \"{broken}\" is not a date since 1980");
        assert_eq!(damage.what, what);
    }
}

/// A line that is cut, in a number or between two, and a number of the orbit that is blank: zero is
/// not meant, and neither is what the digits before the cut happen to say.
#[test]
fn numbers_that_are_missing_are_not_zero() {
    for (satellite, found, broken, line, columns) in [
        ("G15", "-1.729840202902e+00-2.346932888031e-07", "", 6, "43 to 61"),
        ("G15", "97e-12 0.000000000000e+00\n     8.8", "97e-12\n     8.8", 3, "62 to 80"),
        ("G15", "-2.346932888031e-07", "-2.346932888031e-0", 6, "62 to 80"),
        ("G15", "1.816562500000e+02", "                  ", 7, "24 to 42"),
        ("C10", "0.000000000000e+00 6.200000000000e-09 2.600000000000e-09", "", 41, "24 to 42"),
        ("R05", " 1.862645149231e-09 1.000000000000e+00", " 1.862645149231e-09", 53, "62 to 80"),
    ] {
        assert!(RECORDS.contains(found), "{found}");
        let (data, summary) = read(&file_3(&RECORDS.replacen(found, broken, 1)));
        assert!(!satellites(&data).contains(&satellite.to_owned()), "{found}");
        assert_eq!(data.ephemerides.len(), 6, "{found}: {:?}", summary.damage);
        let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage) };
        let what = format!(
            "{satellite}: no whole number in columns {columns} of line {line}; the record is left out"
        );
        assert_eq!(damage.what, what);
    }
}

/// What a writer does not know it may leave blank: spare fields, the issue, an accuracy, the group
/// delay of QZSS, the time of a GLONASS frame.
#[test]
fn unknown_numbers_may_be_blank() {
    let (right, _) = read(&file_3(RECORDS));
    let blank = " ".repeat(19);
    for found in [
        " 8.800000000000e+01",
        " 2.111000000000e+03",
        " 9.313225746155e-10",
        " 3.618000000000e+05",
        " 2.800000000000e+00",
    ] {
        assert!(RECORDS.contains(found), "{found}");
        let (data, summary) = read(&file_3(&RECORDS.replacen(found, &blank, 1)));
        assert_eq!(satellites(&data), satellites(&right), "{found}: {:?}", summary.damage);
        assert_eq!(summary.damage.total(), 0, "{found}: {:?}", summary.damage);
    }
}

/// The header of an interrupted download, and lines in front of it.
#[test]
fn a_header_without_an_end_or_behind_empty_lines() {
    let (right, _) = read(&file_3(RECORDS));
    let end = header("", "END OF HEADER");
    let (data, summary) = read(&file_3(RECORDS).replacen(&end, "", 1));
    assert_eq!(data.ephemerides, right.ephemerides);
    assert_eq!((summary.damage.total(), summary.damage.listed()[0].line), (1, 2));
    let (data, summary) = read(&["\n  \n", &file_3(RECORDS)].concat());
    assert_eq!(data.ephemerides, right.ephemerides);
    assert_eq!(summary.damage.total(), 0);
    let message = try_read(b"\n\n").unwrap_err().to_string();
    assert!(message.contains("empty"), "{message}");
    let unknown = header("     9.9            NAVIGATION DATA", "RINEX VERSION / TYPE");
    let message = try_read(["\n", &unknown].concat().as_bytes()).unwrap_err().to_string();
    assert!(message.contains("line 2") && message.contains("9.9"), "{message}");
}

/// RINEX 2.12 writes the letter of a system in front of the number, with one column more; a file of
/// one system may leave it out.
#[test]
fn rinex_2_12_of_qzss_and_galileo() {
    let (right, _) = read(&file_3(RECORDS));
    let record = |name: &str| -> Vec<&str> {
        RECORDS.lines().skip_while(|line| !line.starts_with(name)).take(8).collect()
    };
    let file = |first: &str, date: &str, with: &str, name: &str, cut: usize| {
        let lines = record(name);
        let behind: String = lines[1..].iter().map(|line| format!("{}\n", &line[cut..])).collect();
        let start = header(first, "RINEX VERSION / TYPE") + &header("", "END OF HEADER");
        format!("{start}{}\n{behind}", lines[0].replacen(date, with, 1))
    };
    let qzss = ("J02 2020 06 25 18 00 00", "J 2 20  6 25 18  0  0.0");
    let galileo = ("E12 2020 06 25 02 50 00", "12 20  6 25  2 50  0.0");
    for (first, (date, with), name, cut) in [
        ("     2.12           N", qzss, "J02", 0),
        ("     2.12           N: GNSS NAV DATA    E: GAL NAV DATA", galileo, "E12", 1),
    ] {
        let (data, summary) = read(&file(first, date, with, name, cut));
        assert_eq!(summary.damage.total(), 0, "{:?}", summary.damage);
        let satellite: Satellite = name.parse().unwrap();
        let found = data.ephemerides.iter().next().unwrap();
        let wanted = right.ephemerides.iter().find(|e| e.satellite() == satellite).unwrap();
        assert_eq!(found, wanted);
    }
}

#[test]
fn a_cut_file_keeps_the_records_before() {
    let file = file_3(RECORDS);
    let cut = &file[..file.find("R05").unwrap() + 120];
    let (data, summary) = read(cut);
    assert_eq!(satellites(&data), ["G15", "E12", "E12", "C05", "C10", "J02"]);
    assert_eq!(summary.damage.total(), 1, "{:?}", summary.damage);
}

#[test]
fn a_week_number_that_rolled_over_does_not_matter() {
    let rolled = RECORDS.replace("2.111000000000e+03", "6.300000000000e+01");
    let (data, _) = read(&file_3(&rolled));
    let (right, _) = read(&file_3(RECORDS));
    assert_eq!(data.ephemerides, right.ephemerides);
}

#[test]
fn other_files_are_named() {
    let observation = header("     3.05           OBSERVATION DATA    M", "RINEX VERSION / TYPE");
    for (bytes, expected) in [
        (&b""[..], "empty"),
        (observation.as_bytes(), "observation"),
        (b"\x00\x01\x02\xff", "expected a navigation file"),
    ] {
        let message = try_read(bytes).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let version = header("     9.05           NAVIGATION DATA     M", "RINEX VERSION / TYPE");
    assert!(try_read(version.as_bytes()).unwrap_err().to_string().contains("9.05"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// No damage makes the reader panic, and every record that is read can be evaluated.
    #[test]
    fn any_damage_is_survived(
        place in any::<proptest::sample::Index>(),
        length in 0..60usize,
        noise in proptest::collection::vec(any::<u8>(), 0..60),
    ) {
        let mut bytes = file_3(RECORDS).into_bytes();
        let start = place.index(bytes.len());
        let end = (start + length).min(bytes.len());
        bytes.splice(start..end, noise);
        if let Ok((data, _)) = try_read(&bytes) {
            for record in data.ephemerides.iter() {
                let state = record.state(record.reference_time() + 600.0).unwrap();
                prop_assert!(state.position_m.is_finite() && state.velocity_mps.is_finite());
            }
        }
    }
}

/// Files joined one behind the other: the second header is read as one, also in another version.
#[test]
fn joined_files_are_read_with_their_own_headers() {
    let first = file_3(RECORDS);
    let lines = first.lines().count() as u64;
    let leap = header("    18", "LEAP SECONDS");
    let second = file_3(RECORDS).replacen("3.05", "4.00", 1);
    let second =
        second.replacen("END OF HEADER", &format!("COMMENT\n{leap}{:60}END OF HEADER", ""), 1);
    let (data, summary) = read(&[first.as_str(), &second].concat());
    assert_eq!(satellites(&data), satellites(&read(&first).0));
    assert_eq!(data.leap_seconds, Some(18));
    let damage: Vec<_> =
        summary.damage.listed().iter().map(|d| (d.line, d.what.as_ref())).collect();
    assert_eq!(damage, [(lines + 1, "a second header: files were joined here")]);
}

/// A line that is there twice, and a record that lost its first line: neither is read as numbers of
/// the record before.
#[test]
fn lines_too_many_are_no_numbers_of_a_record() {
    let (all, _) = read(&file_3(RECORDS));
    let mut lines: Vec<&str> = RECORDS.lines().collect();
    lines.insert(4, lines[3]);
    let (data, summary) = read(&file_3(&lines.join("\n")));
    assert_eq!(satellites(&data), satellites(&all)[1..]);
    let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage) };
    let what = "G15: 9 lines, expected 7 or 8; the record is left out";
    assert_eq!((damage.line, damage.what.as_ref()), (3, what));

    let mut lines: Vec<&str> = RECORDS.lines().collect();
    let qzss = lines.iter().position(|line| line.starts_with('J')).unwrap();
    lines.remove(qzss);
    let (data, summary) = read(&file_3(&lines.join("\n")));
    let others: Vec<_> =
        all.ephemerides.iter().filter(|e| e.satellite().system != System::Qzss).collect();
    assert_eq!(data.ephemerides.iter().collect::<Vec<_>>(), others);
    let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage) };
    let what = "C10: 15 lines, expected 7 or 8; the rest has no satellite and is not read";
    assert_eq!(damage.what, what);
}
