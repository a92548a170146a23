//! Times of messages, which tell the time of the week or day only: the rest comes from the message
//! before, or from a date that someone must give.

use kurs::signal::System;
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};

use super::ObservationHeader;
use crate::logs::whole_milliseconds;

/// Moscow time, which GLONASS keeps, less UTC.
const MOSCOW_S: f64 = 3.0 * 3600.0;
const DAY_S: f64 = 86_400.0;
const WEEK_MS: u64 = 604_800_000;
/// Bits of an epoch time (DF004, DF248, DF427; GLONASS: day and DF034).
const WIDTH: u32 = 30;
/// Day of the week that stands for an unknown one.
const DAY_UNKNOWN: u64 = 7;

/// Whether the day that a message states is believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Day {
    /// As it stands there.
    Stated,
    /// The time of the day counts only: on the day that is next to what is known.
    Nearest,
}

/// Whether the messages of this kind tell the time of the week: those of GLONASS have it as a day
/// (DF416) that many programs set wrong, and some programs give SBAS the time of the day.
pub(crate) const fn is_weekly(header: &ObservationHeader) -> bool {
    !matches!(header.system, System::Glonass | System::Sbas)
}

/// The instant next to `near` with the epoch time of a message.
pub(crate) fn resolve(header: &ObservationHeader, near: GpsTime, day: Day) -> Option<GpsTime> {
    let ObservationHeader { system, epoch_time, .. } = *header;
    let own = own_time(system, near);
    let of_day_s = |own_s: f64| {
        let ahead_s = own_s - own.tow_s() % DAY_S;
        own.tow_s() + ahead_s - DAY_S * (ahead_s / DAY_S).round()
    };
    let own_s = match (system, day) {
        (System::Glonass, _) => {
            let (stated, ms) = (epoch_time >> 27, epoch_time & 0x7ff_ffff);
            let seconds = ms as f64 * 1e-3;
            match day {
                Day::Stated if stated != DAY_UNKNOWN => stated as f64 * DAY_S + seconds,
                _ => of_day_s(seconds),
            }
        }
        (_, Day::Nearest) => of_day_s(week_s(epoch_time, own)),
        (_, Day::Stated) => week_s(epoch_time, own),
    };
    let mut time = near + (own.nearest_with_tow(own_s)? - own);
    if system == System::Glonass {
        time += f64::from(time.leap_seconds() - near.leap_seconds());
    }
    // Whatever the sums of real numbers make of it.
    Some(whole_milliseconds(time))
}

/// The second of the week of an epoch time. Programs that subtract the 14 s of BeiDou time without
/// a look at the week send times below zero, or more than a week.
fn week_s(bits: u64, near: GpsTime) -> f64 {
    let beyond_s = bits as f64 * 1e-3;
    if bits < WEEK_MS {
        return beyond_s;
    }
    let below_s = beyond_s - (1u64 << WIDTH) as f64 * 1e-3;
    let away_s =
        |own_s: f64| near.nearest_with_tow(own_s).map_or(f64::INFINITY, |t| (t - near).abs());
    if away_s(below_s) < away_s(beyond_s) { below_s } else { beyond_s }
}

/// The 30 bits of the epoch time that is a whole millisecond.
pub(crate) fn bits(system: System, time: GpsTime) -> u64 {
    let of_week_ms =
        u64::try_from(own_time(system, time).as_nanoseconds() / 1_000_000).unwrap_or(0) % WEEK_MS;
    match system {
        System::Glonass => ((of_week_ms / 86_400_000) << 27) | (of_week_ms % 86_400_000),
        _ => of_week_ms,
    }
}

/// The time of the system on the scale of days and weeks of GPS.
fn own_time(system: System, gpst: GpsTime) -> GpsTime {
    match system {
        System::Glonass => gpst + (MOSCOW_S - f64::from(gpst.leap_seconds())),
        System::BeiDou => gpst + -GPST_MINUS_BDT_S,
        _ => gpst,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(system: System, epoch_time: u64) -> ObservationHeader {
        ObservationHeader { system, epoch_time, station: 0, more_follows: false }
    }

    #[test]
    fn times_round_trip_from_three_days_away() {
        for system in [System::Gps, System::Galileo, System::BeiDou, System::Glonass] {
            for tow_s in [0.0, 13.999, 86_399.25, 300_000.5, 604_799.999] {
                let time = GpsTime::from_week_tow(2300, tow_s).unwrap();
                for away_s in [-259_200.0, -1.0, 0.0, 259_200.0] {
                    let header = header(system, bits(system, time));
                    let read = resolve(&header, time + away_s, Day::Stated).unwrap();
                    assert_eq!(read, time, "{system}");
                }
            }
        }
    }

    #[test]
    fn an_unknown_or_unbelieved_day_is_the_nearest_one() {
        let time = GpsTime::from_week_tow(2300, 300_000.5).unwrap();
        let of_day = bits(System::Glonass, time) & 0x7ff_ffff;
        for (day, how) in [(DAY_UNKNOWN, Day::Stated), (0, Day::Nearest), (6, Day::Nearest)] {
            let header = header(System::Glonass, of_day | day << 27);
            assert_eq!(resolve(&header, time + 40_000.0, how), Some(time));
        }
        let of_day = bits(System::Sbas, time) % 86_400_000;
        let read = resolve(&header(System::Sbas, of_day), time + 2.0, Day::Nearest);
        assert_eq!(read, Some(time));
    }

    /// From ten seconds before the leap second of 2016 to as many behind it.
    #[test]
    fn glonass_across_a_leap_second() {
        let leap = GpsTime::from_week_tow(1930, 18.0).unwrap();
        let header = header(System::Glonass, bits(System::Glonass, leap + 10.0));
        for day in [Day::Stated, Day::Nearest] {
            assert_eq!(resolve(&header, leap + -10.0, day), Some(leap + 10.0));
        }
    }

    /// Three seconds into the week of GPS, BeiDou's is 11 s before its end.
    #[test]
    fn times_of_beidou_below_zero_and_beyond_the_week() {
        let sunday = GpsTime::from_week_tow(2300, 3.0).unwrap();
        let below = (1 << WIDTH) - 11_000;
        assert_eq!(resolve(&header(System::BeiDou, below), sunday, Day::Stated), Some(sunday));
        let beyond = WEEK_MS + 4_000;
        let later = Some(sunday + 15.0);
        assert_eq!(resolve(&header(System::BeiDou, beyond), sunday, Day::Stated), later);
    }
}
