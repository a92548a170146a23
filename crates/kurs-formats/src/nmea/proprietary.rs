//! Sentences of makers, for what the standard has no field: tilts, deviations, velocities.

use kurs::solution::{PositionOrigin, Status};
use kurs::time::Calendar;
use kurs::turn_rate::course_rad;

use super::{
    Epoch, KMH_PER_MPS, KNOTS_PER_MPS, MINUTE_DECIMALS, angle, clock, number, place, quality,
    speed_mps,
};
use crate::dilution::Dilution;
use crate::geoid::geoid_height_m;

impl Epoch<'_> {
    /// Heading, pitch and roll, each with N for normal, as far as they are known.
    pub(super) fn ptnthtm(&self) -> Option<String> {
        let heading = angle(Some(self.degrees(0)?), 3, 360.0);
        let tilt = |k: usize| {
            self.degrees(k).map_or_else(|| ",".to_owned(), |v| format!("{:.3},N", v + 0.0))
        };
        Some(format!("PTNTHTM,{heading},N,{},{},,", tilt(1), tilt(2)))
    }

    /// Heading, roll, pitch and their standard deviations.
    pub(super) fn pashr(&self) -> String {
        let sd = |k: usize| {
            let attitude = self.attitude.filter(|a| a.angles_rad()[k].is_some());
            number(attitude.map(|a| a.covariance_rad2[(k, k)].sqrt().to_degrees()), 3)
        };
        // 0 no position, 1 of the receiver alone, 2 by carrier phase
        let quality = match self.row.position.map(|position| position.origin) {
            None => 0,
            Some(PositionOrigin::StationPhase) => 2,
            Some(PositionOrigin::Alone | PositionOrigin::StationCode) => 1,
        };
        format!(
            "PASHR,{},{},T,{},{},,{},{},{},{quality},0",
            clock(&self.utc),
            angle(self.degrees(0), 3, 360.0),
            self.signed(2),
            self.signed(1),
            sd(2),
            sd(1),
            sd(0),
        )
    }

    /// Yaw, tilt and roll, each with its name, and the length of the first fixed baseline.
    pub(super) fn ptnl_avr(&self) -> String {
        const FIXED: u8 = 3;
        let named = |k: usize, name: &str, value: String| {
            if self.degrees(k).is_some() { format!("{value},{name}") } else { ",".to_owned() }
        };
        let fixed = self.row.baselines.iter().find(|b| b.status == Status::Fixed);
        let range_m = fixed.filter(|_| self.attitude.is_some()).map(|b| b.baseline_m.norm());
        let yaw = angle(self.degrees(0), 4, 360.0);
        let pdop = self.row.position.as_ref().and_then(Dilution::of).map(|d| d.position);
        format!(
            "PTNL,AVR,{},{},{},{},{},{},{},{}",
            clock(&self.utc),
            named(0, "Yaw", format!("+{yaw}")),
            named(1, "Tilt", self.signed(1)),
            named(2, "Roll", self.signed(2)),
            number(range_m, 3),
            if self.attitude.is_some() { FIXED } else { 0 },
            number(pdop, 1),
            self.row.satellites,
        )
    }

    /// Position, heading, tilts and velocity in one (Unicore); `None` without position or heading.
    pub(super) fn ksxt(&self) -> Option<String> {
        const FIXED: u8 = 3;
        let (heading, position) = (self.degrees(0)?, self.row.position.as_ref()?);
        let quality = match position.origin {
            PositionOrigin::Alone => 1,
            PositionOrigin::StationCode => 2,
            PositionOrigin::StationPhase => FIXED,
        };
        let Calendar { year, month, day, .. } = self.utc;
        let geodetic = &position.geodetic;
        let velocity_kmh = |component: Option<f64>| number(component.map(|v| v * KMH_PER_MPS), 3);
        let ned_mps: Option<[f64; 3]> = position.velocity_mps.map(|v| v.xyz().into());
        Some(format!(
            "KSXT,{year:04}{month:02}{day:02}{},{:.9},{:.9},{:.4},{},{},{},{},{},{quality},{FIXED},{},{},,,,{},{},{},,",
            clock(&self.utc),
            geodetic.longitude_rad.to_degrees(),
            geodetic.latitude_rad.to_degrees(),
            geodetic.height_m - geoid_height_m(geodetic),
            angle(Some(heading), 3, 360.0),
            number(self.degrees(1), 3),
            angle(course_rad(position).map(f64::to_degrees), 2, 360.0),
            number(speed_mps(position).map(|v| v * KMH_PER_MPS), 3),
            number(self.degrees(2), 3),
            self.row.satellites_in_use(),
            self.row.satellites_in_use(),
            velocity_kmh(ned_mps.map(|[_, east, _]| east)),
            velocity_kmh(ned_mps.map(|[north, ..]| north)),
            velocity_kmh(ned_mps.map(|[.., down]| -down)),
        ))
    }

    /// Position, speed, heading, roll, pitch and rate of turn in one, as AgOpenGPS reads them; it
    /// takes an empty field for zero, so `None` without a position, heading or roll.
    pub(super) fn paogi(&self) -> Option<String> {
        let (heading, roll) = (self.degrees(0)?, self.degrees(2)?);
        let position = self.row.position.as_ref()?;
        let knots = speed_mps(position).map(|speed| speed * KNOTS_PER_MPS);
        let turn_degps = self.rates[0].map(|rate| rate.radps.to_degrees() + 0.0);
        Some(format!(
            "PAOGI,{},{},{},{},{},{:.3},,{},{},{:.3},{},{}",
            clock(&self.utc),
            place(position, MINUTE_DECIMALS),
            quality(position.origin),
            self.row.satellites_in_use().min(99),
            number(position.hdop, 2),
            position.geodetic.height_m - geoid_height_m(&position.geodetic),
            number(knots, 3),
            angle(Some(heading), 3, 360.0),
            roll + 0.0,
            number(self.degrees(1).map(|pitch| pitch + 0.0), 3),
            number(turn_degps, 3),
        ))
    }

    /// An angle with its sign.
    fn signed(&self, k: usize) -> String {
        self.degrees(k).map_or_else(String::new, |degrees| format!("{:+.3}", degrees + 0.0))
    }
}
