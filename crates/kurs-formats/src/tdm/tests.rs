//! The examples of the tests are written here, after the figures of annex E of 503.0-B-2.

use super::*;
use kurs::time::Calendar;
use proptest::prelude::*;

const RADAR: &str = "CCSDS_TDM_VERS = 2.0
COMMENT a radar
CREATION_DATE = 2020-06-15T12:00:00
ORIGINATOR = TEST

META_START
COMMENT in the metadata
TIME_SYSTEM = UTC
PARTICIPANT_1 = RADAR-A
PARTICIPANT_2 = BALLOON
MODE = SEQUENTIAL
PATH = 1,2,1
RANGE_UNITS = km
ANGLE_TYPE = AZEL
CORRECTION_RANGE = -1.5
CORRECTIONS_APPLIED = NO
META_STOP
DATA_START
RANGE = 2020-167T12:00:00.5Z 101.5
ANGLE_1 = 2020-06-15T12:00:00.5 90.0
ANGLE_2   =   2020-06-15T12:00:00.5    30.0
DOPPLER_INSTANTANEOUS = 2020-06-15T12:00:00.5 -0.25
RECEIVE_FREQ_2 = 2020-06-15T12:00:00.5 32021034790.7265
DATA_STOP
META_START
TIME_SYSTEM = GPS
PARTICIPANT_1 = BALLOON
PARTICIPANT_2 = NORTH
PARTICIPANT_3 = SOUTH
MODE = SINGLE_DIFF
PATH_1 = 1,2
PATH_2 = 1,3
RANGE_UNITS = s
META_STOP
DATA_START
RANGE = 2020-06-15T12:00:18.5 1e-6
DATA_STOP
";

fn noon() -> GpsTime {
    let date = Calendar { year: 2020, month: 6, day: 15, hour: 12, minute: 0, second: 0.5 };
    GpsTime::from_utc(date).unwrap()
}

fn values(data: &TrackingData) -> Vec<(&str, Observable, f64)> {
    data.records.iter().map(|r| (&*r.station, r.observable, r.value)).collect()
}

#[test]
fn units_time_systems_corrections_and_paths_are_honoured() {
    let data = read(RADAR).unwrap();
    let expected = [
        ("RADAR-A", Observable::TwoWayRange, 100_000.0),
        ("RADAR-A", Observable::Azimuth, 90.0_f64.to_radians()),
        ("RADAR-A", Observable::Elevation, 30.0_f64.to_radians()),
        ("SOUTH", Observable::RangeDifference, 299.792_458),
    ];
    assert_eq!(data.records.len(), 4);
    for ((station, observable, value), expected) in values(&data).into_iter().zip(expected) {
        assert_eq!((station, observable), (expected.0, expected.1));
        assert!((value - expected.2).abs() < 1e-9, "{value}");
    }
    assert_eq!(data.records[3].reference.as_deref(), Some("NORTH"));
    assert!(data.records.iter().all(|record| record.time == noon() && record.object == "BALLOON"));
    assert_eq!(data.records[0].line, 19);
    assert_eq!(data.read_past["DOPPLER_INSTANTANEOUS"], 1);
    assert_eq!(data.read_past["RECEIVE_FREQ_2"], 1);
}

#[test]
fn what_is_broken_is_named_with_its_line() {
    // An error, or the reason why one of the two segments is left out.
    let broken = |from: &str, to: &str| {
        read(&RADAR.replacen(from, to, 1)).map_or_else(
            |error| error,
            |data| {
                assert_eq!((data.records.len(), data.left_out.len()), (1, 1), "{from} → {to}");
                data.left_out[0].clone()
            },
        )
    };
    for (from, to, line, keyword) in [
        ("CCSDS_TDM_VERS = 2.0\n", "", 2, "CCSDS_TDM_VERS"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = MARS", 8, "TIME_SYSTEM"),
        ("TIME_SYSTEM = UTC\n", "", 18, "TIME_SYSTEM"),
        ("PATH = 1,2,1", "PATH = 1;2", 12, "PATH"),
        ("PATH = 1,2,1", "PATH = 1,4,1", 19, "PARTICIPANT_4"),
        ("PATH = 1,2,1", "PATH = 1,2,3", 19, "PATH"),
        ("RANGE_UNITS = km", "RANGE_UNITS = miles", 13, "RANGE_UNITS"),
        ("RANGE_UNITS = km", "RANGE_UNITS = RU", 19, "RANGE_UNITS"),
        ("RANGE_UNITS = km", "RANGE_MODULUS = 300.0", 19, "RANGE_MODULUS"),
        ("ANGLE_TYPE = AZEL", "ANGLE_TYPE = RADEC", 20, "ANGLE_TYPE"),
        ("CORRECTIONS_APPLIED = NO\n", "", 18, "CORRECTIONS_APPLIED"),
        ("META_STOP\n", "", 17, "DATA_START"),
        ("DATA_START", "DATA_BEGIN", 18, "DATA_BEGIN"),
        ("2020-167T12:00:00.5Z 101.5", "2020-167T12:00:00.5Z", 19, "RANGE"),
        ("2020-167T12:00:00.5Z", "2020-367T12:00:00.5Z", 19, "RANGE"),
        ("101.5", "many", 19, "RANGE"),
        ("101.5", "NaN", 19, "RANGE"),
        ("90.0", "400.0", 20, "ANGLE_1"),
        ("DOPPLER_INSTANTANEOUS", "DOPLER", 22, "DOPLER"),
        ("MODE = SEQUENTIAL", "MODE =", 11, "MODE"),
        ("MODE = SEQUENTIAL", "COLOUR = RED", 11, "COLOUR"),
    ] {
        let error = broken(from, to);
        assert_eq!((error.line, &*error.keyword), (line, keyword), "{from} → {to}: {error}");
    }
    let cut = RADAR.rsplit_once("DATA_STOP").unwrap().0;
    assert_eq!(read(cut).unwrap_err().keyword, "DATA_STOP");
    assert_eq!(read("").unwrap_err().keyword, "META_START");
}

/// One segment that cannot be used costs itself only; two of two are an error.
#[test]
fn a_segment_that_cannot_be_used_is_left_out() {
    let radec = RADAR.replacen("ANGLE_TYPE = AZEL", "ANGLE_TYPE = RADEC", 1);
    let data = read(&radec).unwrap();
    assert_eq!(data.records.len(), 1);
    assert_eq!(data.records[0].station, "SOUTH");
    assert_eq!((data.left_out[0].line, &*data.left_out[0].keyword), (20, "ANGLE_TYPE"));
    let both = radec.replacen("RANGE_UNITS = s", "RANGE_UNITS = RU", 1);
    assert_eq!(read(&both).unwrap_err().keyword, "ANGLE_TYPE");

    let text = write(&read(RADAR).unwrap().records, "TEST", noon(), Form::Xml);
    let whole = read(&text).unwrap();
    let data = read(&text.replacen("<ANGLE_1>90", "<ANGLE_1>north", 1)).unwrap();
    assert_eq!(data.left_out[0].keyword, "ANGLE_1");
    assert!((1..whole.records.len()).contains(&data.records.len()));
}

/// A modulus beyond every range: 150 000 km, and 0.5 s of light.
#[test]
fn a_modulus_beyond_every_range_is_none() {
    for (modulus, units, factor) in [("150000.0", "km", 1.0), ("0.5", "s", 299_792.458)] {
        let modulus = format!("RANGE_MODULUS = {modulus}\nRANGE_UNITS = {units}");
        let data = read(&RADAR.replacen("RANGE_UNITS = km", &modulus, 1)).unwrap();
        assert_eq!(data.left_out, []);
        assert!((data.records[0].value - 100_000.0 * factor).abs() < 1e-3 * factor);
    }
}

#[test]
fn broken_xml_is_named_with_its_line() {
    let data = read(RADAR).unwrap();
    let text = write(&data.records, "TEST", noon(), Form::Xml);
    let cut = &text[..text.len() - 30];
    assert_eq!(read(cut).unwrap_err().keyword, "xml");
    let wrong = text.replacen("<ANGLE_1>90", "<ANGLE_1>north", 1);
    let error = read(&wrong).unwrap().left_out[0].clone();
    let line = wrong[..wrong.find("north").unwrap()].lines().count();
    assert_eq!((error.line, &*error.keyword), (line, "ANGLE_1"), "{error}");
    let without_epoch = text.replacen("<EPOCH>2020-06-15T12:00:00.500000</EPOCH>", "", 1);
    assert_eq!(read(&without_epoch).unwrap().left_out[0].keyword, "EPOCH");
    assert_eq!(read("<tdm></tdm>").unwrap_err().keyword, "segment");
}

#[test]
fn both_forms_read_back_what_was_written() {
    let data = read(RADAR).unwrap();
    for form in [Form::Kvn, Form::Xml] {
        let text = write(&data.records, "A <test> & more", noon(), form);
        assert!(looks_like(&text));
        let back = read(&text).unwrap();
        assert_eq!(back.records.len(), 4);
        for record in &data.records {
            let same = back.records.iter().find(|other| {
                (&other.station, other.observable) == (&record.station, record.observable)
            });
            let same = same.unwrap();
            assert_eq!(
                (same.time, &same.reference, &same.object),
                (record.time, &record.reference, &record.object)
            );
            assert!((same.value - record.value).abs() < 1e-9);
        }
    }
    assert!(!looks_like("time_utc,station,azimuth_deg\n"));
}

proptest! {
    #[test]
    fn no_text_panics(text in "\\PC{0,200}", cut in 0usize..900, byte in any::<char>()) {
        let _ = read(&text);
        let mut damaged: String = RADAR.chars().take(cut).collect();
        damaged.push(byte);
        let _ = read(&damaged);
    }
}
