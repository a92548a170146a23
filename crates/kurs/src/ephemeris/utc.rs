//! UTC from system time: whole leap seconds, and what remains by the broadcast parameters.

use super::navigation_data::{NavigationData, UtcParameters};
use crate::signal::System;
use crate::time::{Calendar, GpsTime};

/// Parameters whose reference time is farther away have no drift that could be trusted.
const LONGEST_DRIFT_S: f64 = 31.0 * 86_400.0;
/// The systems keep their time within a microsecond of UTC, GLONASS within a millisecond.
const MAX_BIAS_S: f64 = 1e-3;
/// Whose parameters are taken first. BeiDou's, Galileo's and GLONASS's times are taken for GPS time
/// but for a broadcast offset; they differ by nanoseconds.
const PREFERENCE: [System; 5] =
    [System::Gps, System::Qzss, System::Galileo, System::BeiDou, System::Glonass];

impl NavigationData {
    /// Date and time of day in UTC: leap seconds by the built-in table (by the navigation data only
    /// where they know of a later one), the rest by [`NavigationData::utc_remainder_s`].
    #[must_use]
    pub fn utc(&self, time: GpsTime) -> Calendar {
        let time = time + -self.utc_remainder_s(time);
        let newest = GpsTime::from_nanoseconds(i64::MAX).leap_seconds();
        match self.leap_seconds.filter(|announced| *announced > newest) {
            Some(announced) if time.leap_seconds() == newest => {
                (time + -f64::from(announced)).calendar()
            }
            _ => time.utc(),
        }
    }

    /// GPST − UTC less the leap seconds, s: `A₀ + A₁ (t − t_ref)` of the first system that tells, and
    /// of its parameters those with the nearest reference time; zero if none does.
    #[must_use]
    pub fn utc_remainder_s(&self, time: GpsTime) -> f64 {
        let nearest = |system: System| {
            let of_system = self.utc.iter().filter(|p| p.system == system && p.is_sane());
            of_system.min_by(|a, b| a.distance_s(time).total_cmp(&b.distance_s(time)))
        };
        let found = PREFERENCE.into_iter().find_map(nearest);
        // GPST − UTC = (system − UTC) − (system − GPST)
        found.map_or(0.0, |p| p.at(time) - self.minus_gpst_s(p.system, time))
    }

    /// A system's time less GPS time, whole seconds left out, s.
    fn minus_gpst_s(&self, system: System, time: GpsTime) -> f64 {
        let signed = self.time_offsets.iter().filter_map(|offset| {
            let sign = match (offset.minuend, offset.subtrahend) {
                (minuend, System::Gps) if minuend == system => 1.0,
                (System::Gps, subtrahend) if subtrahend == system => -1.0,
                _ => return None,
            };
            let (value_s, apart_s) =
                linear(offset.bias_s, offset.drift, offset.reference_time, time);
            (value_s.abs() < MAX_BIAS_S).then_some((apart_s, sign * value_s))
        });
        signed.min_by(|(a, _), (b, _)| a.total_cmp(b)).map_or(0.0, |(_, value_s)| value_s)
    }
}

impl UtcParameters {
    fn is_sane(&self) -> bool {
        self.bias_s.abs() < MAX_BIAS_S && self.drift.abs() < 1e-9
    }

    fn distance_s(&self, time: GpsTime) -> f64 {
        (time - self.reference_time).abs()
    }

    fn at(&self, time: GpsTime) -> f64 {
        linear(self.bias_s, self.drift, self.reference_time, time).0
    }
}

/// `A₀ + A₁ (t − t_ref)`, and the distance of the reference time, s.
fn linear(bias_s: f64, drift: f64, reference_time: GpsTime, time: GpsTime) -> (f64, f64) {
    let since_s = time - reference_time;
    let drifted_s = if since_s.abs() < LONGEST_DRIFT_S { drift * since_s } else { 0.0 };
    (bias_s + drifted_s, since_s.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::SystemTimeOffset;

    fn time() -> GpsTime {
        GpsTime::from_week_tow(2320, 100_000.0).unwrap()
    }

    fn parameters(system: System, bias_s: f64, drift: f64, age_s: f64) -> UtcParameters {
        UtcParameters { system, bias_s, drift, reference_time: time() + -age_s }
    }

    #[test]
    fn by_hand() {
        let mut data = NavigationData::default();
        assert_eq!(data.utc_remainder_s(time()), 0.0);
        assert_eq!(data.utc(time()), time().utc());
        // 2·10⁻⁷ + 10⁻¹² · 50 000
        data.utc.push(parameters(System::Galileo, 9e-7, 0.0, 0.0));
        data.utc.push(parameters(System::Gps, 1e-7, 0.0, 500_000.0));
        data.utc.push(parameters(System::Gps, 2e-7, 1e-12, 50_000.0));
        assert!((data.utc_remainder_s(time()) - 2.5e-7).abs() < 1e-18);
        // 100 000 s of week 2320 less 18 s: 2024-06-24 03:46:22 UTC
        let utc = data.utc(time());
        assert_eq!((utc.day, utc.hour, utc.minute), (24, 3, 46));
        assert!((utc.second - (22.0 - 2.5e-7)).abs() < 1e-9, "{}", utc.second);
    }

    #[test]
    fn another_system_tells_with_its_offset_to_gps() {
        let mut data = NavigationData::default();
        data.utc.push(parameters(System::Galileo, 3e-8, 0.0, 0.0));
        let offset = |minuend, subtrahend, bias_s| SystemTimeOffset {
            minuend,
            subtrahend,
            bias_s,
            drift: 0.0,
            reference_time: time(),
        };
        // GPST − UTC = (GST − UTC) + (GPST − GST)
        data.time_offsets.push(offset(System::Gps, System::Galileo, 1e-8));
        assert!((data.utc_remainder_s(time()) - 4e-8).abs() < 1e-18);
    }

    #[test]
    fn nonsense_and_stale_drifts_do_no_harm() {
        let mut data = NavigationData::default();
        data.utc.push(parameters(System::Gps, 0.5, 0.0, 0.0));
        assert_eq!(data.utc_remainder_s(time()), 0.0);
        data.utc.push(parameters(System::Gps, 1e-8, 1e-10, 1e9));
        assert_eq!(data.utc_remainder_s(time()), 1e-8);
    }

    /// A leap second that the table does not know yet; old files do not change what it knows.
    #[test]
    fn an_announced_leap_second_counts() {
        let mut data = NavigationData { leap_seconds: Some(17), ..NavigationData::default() };
        assert_eq!(data.utc(time()), time().utc());
        data.leap_seconds = Some(19);
        assert_eq!(data.utc(time()).second, 21.0);
    }
}
