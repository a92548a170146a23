//! Times of messages, which tell the time of the week or day only: the rest comes from the message
//! before, or from a date that someone must give.

use kurs::signal::System;
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};

use crate::logs::whole_milliseconds;

/// Moscow time, which GLONASS keeps, less UTC.
const MOSCOW_S: f64 = 3.0 * 3600.0;
const DAY_S: f64 = 86_400.0;
/// Day of the week that stands for an unknown one.
const DAY_UNKNOWN: u64 = 7;

/// The instant next to `near` with the 30 bits of an epoch time (DF004, DF034, DF248, DF427).
pub(crate) fn resolve(system: System, bits: u64, near: GpsTime) -> Option<GpsTime> {
    let own = own_time(system, near);
    let own_s = match system {
        System::Glonass => {
            let (day, of_day_s) = (bits >> 27, (bits & 0x7ff_ffff) as f64 * 1e-3);
            if day == DAY_UNKNOWN {
                let ahead_s = of_day_s - own.tow_s() % DAY_S;
                own.tow_s() + ahead_s - DAY_S * (ahead_s / DAY_S).round()
            } else {
                day as f64 * DAY_S + of_day_s
            }
        }
        _ => bits as f64 * 1e-3,
    };
    let time = near + (own.nearest_with_tow(own_s)? - own);
    // Whatever the sums of real numbers make of it.
    Some(whole_milliseconds(time))
}

/// The 30 bits of the epoch time that is a whole millisecond.
pub(crate) fn bits(system: System, time: GpsTime) -> u64 {
    let of_week_ms = u64::try_from(own_time(system, time).as_nanoseconds() / 1_000_000)
        .unwrap_or(0)
        % 604_800_000;
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

    #[test]
    fn times_round_trip_from_three_days_away() {
        for system in [System::Gps, System::Galileo, System::BeiDou, System::Glonass] {
            for tow_s in [0.0, 13.999, 86_399.25, 300_000.5, 604_799.999] {
                let time = GpsTime::from_week_tow(2300, tow_s).unwrap();
                for away_s in [-259_200.0, -1.0, 0.0, 259_200.0] {
                    let read = resolve(system, bits(system, time), time + away_s).unwrap();
                    assert_eq!(read, time, "{system}");
                }
            }
        }
    }

    #[test]
    fn an_unknown_day_is_the_nearest_one() {
        let time = GpsTime::from_week_tow(2300, 300_000.5).unwrap();
        let unknown = bits(System::Glonass, time) & 0x7ff_ffff | DAY_UNKNOWN << 27;
        let read = resolve(System::Glonass, unknown, time + 40_000.0).unwrap();
        assert_eq!(read, time);
    }
}
