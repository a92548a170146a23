//! Two receivers two metres apart, as their NMEA logs tell it: lengths that do not fit, heights
//! without a separation, solutions that are no fixed ones, logs that give nothing.

use std::fs;
use std::path::Path;

use super::simulation::sentence;
use super::{kurs, rows};

/// Degrees of latitude to a metre.
const DEGREES_PER_M: f64 = 1.0 / 111_229.0;

/// What a log of ten seconds says.
#[derive(Clone)]
struct Log {
    /// North of the other receiver, m; in each epoch.
    north_m: fn(usize) -> f64,
    quality: &'static str,
    separation: fn(usize) -> &'static str,
    states_sd: bool,
}

const LOG: Log = Log { north_m: |_| 0.0, quality: "4", separation: |_| "48.0", states_sd: false };

impl Log {
    fn text(&self) -> String {
        let mut text = String::new();
        for second in 0..10 {
            let clock = format!("1200{second:02}.00");
            let minutes = 60.0 * DEGREES_PER_M * (self.north_m)(second);
            let (quality, separation) = (self.quality, (self.separation)(second));
            let gga = format!(
                "GNGGA,{clock},50{minutes:010.7},N,00800.0000000,E,{quality},12,0.6,52.0000,M,{separation},M,1.0,0001"
            );
            sentence(&mut text, &gga);
            if self.states_sd {
                sentence(&mut text, &format!("GNGST,{clock},0.02,,,,0.01,0.01,0.02"));
            }
            sentence(&mut text, &format!("GNRMC,{clock},A,5000.0,N,00800.0,E,0.0,0.0,160624,,,R"));
        }
        text
    }
}

/// Writes both logs beside a configuration of two metres.
fn write(folder: &Path, a: &str, b: &str) {
    let configuration = "[[antenna]]\nname = \"A\"\nposition_m = [0.0, 0.0, 0.0]\n\
                         [[antenna]]\nname = \"B\"\nposition_m = [2.0, 0.0, 0.0]\n";
    fs::write(folder.join("two.toml"), configuration).unwrap();
    fs::write(folder.join("A.nmea"), a).unwrap();
    fs::write(folder.join("B.nmea"), b).unwrap();
}

/// Runs the command; exit status, messages, and status, reason, heading, pitch of every row.
fn orient(a: &str, b: &str, options: &[&str]) -> (i32, String, Vec<[String; 4]>) {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), a, b);
    let arguments = [&["orient", "two.toml", "A.nmea", "B.nmea"], options].concat();
    let run = kurs(folder.path(), &arguments);
    let output = run.get_output();
    let code = output.status.code().unwrap();
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    let rows = if code == 1 { Vec::new() } else { rows(folder.path()) };
    let columns = [3, 4, 8, 9];
    (code, messages, rows.iter().map(|row| columns.map(|c| row[c].to_owned())).collect())
}

#[test]
fn a_right_length_is_fixed() {
    let b = Log { north_m: |_| 2.0, ..LOG };
    let (code, _, rows) = orient(&LOG.text(), &b.text(), &[]);
    assert_eq!((code, rows.len()), (0, 10));
    for [status, _, heading, pitch] in &rows {
        let angle = |text: &str| text.parse::<f64>().unwrap();
        let heading = (angle(heading) + 180.0).rem_euclid(360.0) - 180.0;
        assert!(status == "fixed" && heading.abs() < 0.01 && angle(pitch).abs() < 0.01, "{rows:?}");
    }
}

/// Ten metres are not two, however the standard deviations are blown up; whether stated or not.
#[test]
fn a_wrong_length_is_inconsistent_in_every_epoch() {
    for states_sd in [false, true] {
        let a = Log { states_sd, ..LOG };
        let b = Log { north_m: |_| 10.0, states_sd, ..LOG };
        let (code, messages, rows) = orient(&a.text(), &b.text(), &[]);
        assert_eq!((code, rows.len()), (3, 10), "{messages}");
        assert!(
            rows.iter().all(|row| row[0] == "inconsistent" && row[1] == "geometry"),
            "{rows:?}"
        );
        assert!(messages.contains("A to B measured 10.00"), "{messages}");
        assert!(messages.contains("configured 2.000 m") && messages.contains("nothing was fixed"));
        let (code, ..) = orient(&a.text(), &b.text(), &["--require-fix", "0"]);
        assert_eq!(code, 0);
    }
}

/// Noise of a metre is noise: real lengths scatter about the known one. There is no heading in it.
#[test]
fn noise_beyond_the_length_gives_no_fix() {
    let b = Log { north_m: |k| 2.0 + [1.4, -1.1, 0.3, -0.9, 1.2][k % 5], quality: "1", ..LOG };
    let (code, messages, rows) = orient(&LOG.text(), &b.text(), &[]);
    assert_eq!(code, 3, "{messages}");
    // Where the noise shortens the line it may as well point up as down.
    let is_refused = |row: &[String; 4]| row[0] == "float" || row[1] == "two_minima";
    assert!(rows.iter().all(|row| is_refused(row) && row[2].is_empty()), "{rows:?}");
}

#[test]
fn a_float_solution_in_is_no_fix_out() {
    let fixed = Log { north_m: |_| 2.0, ..LOG };
    for (quality, reason) in [("5", "weak_model"), ("1", "no_phase")] {
        let (code, _, rows) = orient(&LOG.text(), &Log { quality, ..fixed.clone() }.text(), &[]);
        assert_eq!(code, 3);
        assert!(rows.iter().all(|row| row[0] == "float" && row[1] == reason), "{rows:?}");
    }
}

/// A separation that is left out is the receiver's own of before, or that of the other one.
#[test]
fn an_empty_separation_is_not_zero() {
    let separations: [fn(usize) -> &'static str; 2] =
        [|_| "", |k| if k.is_multiple_of(2) { "48.0" } else { "" }];
    for (separation, notes) in separations.into_iter().zip([1, 0]) {
        let b = Log { north_m: |_| 2.0, separation, ..LOG };
        let (code, messages, rows) = orient(&LOG.text(), &b.text(), &[]);
        assert_eq!(code, 0, "{messages}");
        assert!(rows.iter().all(|row| row[0] == "fixed"), "{rows:?}");
        let said =
            "B.nmea: no position states the separation of the geoid: 48 m of A.nmea is taken";
        assert_eq!(messages.matches(said).count(), notes, "{messages}");
    }
}

/// One wrong date among right ones, and void ones everywhere, cost no epoch its partner.
#[test]
fn wrong_dates_in_one_log_lose_no_epoch() {
    let b = Log { north_m: |_| 2.0, ..LOG }.text();
    let mut torn = String::new();
    for (number, line) in b.split_inclusive('\n').enumerate() {
        torn += line;
        if number % 5 == 0 {
            sentence(&mut torn, &format!("GPRMC,12000{}.00,V,,,,,,,050505,,,N", number / 2));
        }
    }
    let (code, _, rows) = orient(&LOG.text(), &torn, &[]);
    assert_eq!((code, rows.len()), (0, 10));
    assert!(rows.iter().all(|row| row[0] == "fixed"), "{rows:?}");
}

#[test]
fn logs_that_give_nothing_say_why() {
    let (a, b) = (LOG.text(), Log { north_m: |_| 2.0, ..LOG }.text());
    let bare = |log: &str| -> String {
        log.lines().map(|line| format!("{}\r\n", line.split_once('*').unwrap().0)).collect()
    };
    let (code, messages, _) = orient(&bare(&a), &bare(&b), &[]);
    assert_eq!(code, 1);
    assert!(
        messages.contains("A.nmea: no sentence has a right checksum (20 without any"),
        "{messages}"
    );
    let (code, _, rows) = orient(&bare(&a), &bare(&b), &["--accept-no-checksum"]);
    assert_eq!((code, rows.len()), (0, 10));

    let without_places = |log: &str| -> String {
        log.split_inclusive('\n').filter(|line| line.contains("RMC")).collect()
    };
    let (code, messages, _) = orient(&without_places(&a), &without_places(&b), &[]);
    assert_eq!(code, 1);
    assert!(messages.contains("B.nmea: no GGA and no GNS (10 RMC)"), "{messages}");

    let undated = |log: &str| -> String {
        log.split_inclusive('\n').filter(|line| !line.contains("RMC")).collect()
    };
    let (code, messages, _) = orient(&undated(&a), &undated(&b), &[]);
    assert_eq!(code, 1);
    assert!(
        messages.contains("A.nmea: 10 positions that cannot be used (10 GGA): no RMC"),
        "{messages}"
    );
    assert!(messages.contains("(give --date)"), "{messages}");

    // Sentences of one epoch on one line.
    let glued = |log: &str| log.replace("\r\n$GNRMC", "$GNRMC");
    let (code, _, rows) = orient(&glued(&a), &glued(&b), &[]);
    assert_eq!((code, rows.len()), (0, 10));
}

/// The message says why positions cannot be used: other names, wrong values, one antenna alone.
#[test]
fn positions_that_are_left_out_are_told() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &LOG.text(), "");
    let said = |file: &str, code: i32| {
        let run = kurs(folder.path(), &["orient", "two.toml", file]).code(code);
        String::from_utf8_lossy(&run.get_output().stderr).into_owned()
    };
    let table = |header: &str, rows: &str| {
        fs::write(folder.path().join("table.csv"), format!("{header}\n{rows}")).unwrap();
    };
    let header = "gps_week,tow_s,name,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_down_m";
    let row = |name: &str, sd: &str| format!("2300,5,{name},6378137.0,0.0,0.0,{sd},{sd},{sd}\n");

    table(header, &(row("A", "0.01") + &row("BB", "0.01")));
    let told = said("table.csv", 1);
    assert!(told.contains("table.csv: rows of `BB`, which is no antenna: 1"), "{told}");
    assert!(told.contains("only antenna A has positions"), "{told}");

    table(header, &(row("A", "-0.01") + &row("B", "-0.01")));
    let told = said("table.csv", 1);
    assert!(told.contains("2 damaged places, first: table.csv:2: standard deviations"), "{told}");

    let told = said("C=A.nmea", 2);
    assert!(told.contains("C=A.nmea: `C` is no antenna, expected one of A, B"), "{told}");

    let told = said("A=A.nmea", 1);
    assert!(told.contains("only antenna A has positions"), "{told}");
    let rows = fs::read_to_string(folder.path().join("kurs-out/orient/attitude.csv")).unwrap();
    assert_eq!(rows.matches(",not_capable,few_antennas,").count(), 10, "{rows}");
}

/// The words of Kurs in a table count, too.
#[test]
fn the_status_of_a_table_counts() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "", "");
    let mut table = "gps_week,tow_s,name,x_m,y_m,z_m,status\n".to_owned();
    for (second, status) in ["fixed", "float", "lost", "fixed"].iter().enumerate() {
        table += &format!("2300,{second},A,6378137.0,0.0,0.0,fixed\n");
        table += &format!("2300,{second},B,6378137.0,0.0,2.0,{status}\n");
    }
    fs::write(folder.path().join("table.csv"), table).unwrap();
    kurs(folder.path(), &["orient", "two.toml", "table.csv", "--quiet"]).success();
    let found: Vec<String> = rows(folder.path()).iter().map(|row| row[3].to_owned()).collect();
    assert_eq!(found, ["fixed", "float", "lost", "fixed"]);
    kurs(folder.path(), &["orient", "two.toml", "table.csv", "--require-fix", "60"]).code(3);
}
