//! Unix time of a time tag, by the built-in table of leap seconds.

use kurs::time::GpsTime;

/// 1980-01-06 in Unix time, s.
const GPS_EPOCH_S: i64 = 315_964_800;
const NS_PER_S: i64 = 1_000_000_000;

/// Nanoseconds since 1970.
pub(crate) fn nanoseconds(time: GpsTime) -> i64 {
    time.as_nanoseconds() + (GPS_EPOCH_S - i64::from(time.leap_seconds())) * NS_PER_S
}
