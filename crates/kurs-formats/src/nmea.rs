//! NMEA 0183 sentences of solved epochs; the talker is `GN`, several systems together.
//!
//! An epoch begins with its position, so that readers that collect sentences by their time have it
//! when the heading comes. Times are the nominal ones of the epochs, rounded to hundredths of a
//! second. Only fixed rows have a heading; what is not known is an empty field, in the way of each
//! sentence.

mod proprietary;

use std::fmt::Write as _;

use kurs::solution::{AttitudeEstimate, EpochSolution, PositionEstimate, PositionOrigin};
use kurs::time::{Calendar, GpsTime};
use kurs::turn_rate::{AngleRates, TurnRate, course_rad};
use nalgebra::SymmetricEigen;

use crate::geoid::geoid_height_m;

const NS_PER_HUNDREDTH: i64 = 10_000_000;
const KNOTS_PER_MPS: f64 = 3600.0 / 1852.0;
const KMH_PER_MPS: f64 = 3.6;
/// Characters of a sentence between `$` and `*`: NMEA 0183 has 82 from `$` to the line end, of
/// which these two, the checksum and the line end are six.
const MAX_BODY: usize = 76;
/// Decimals of minutes: 0.2 mm.
const MINUTE_DECIMALS: usize = 7;
/// Decimals of height and minutes in GGA; those of the first that fits are used. Readers need no
/// tenths of millimetres of a height, and lose more where the place is cut.
const GGA_DECIMALS: [(usize, usize); 5] =
    [(4, MINUTE_DECIMALS), (3, MINUTE_DECIMALS), (2, MINUTE_DECIMALS), (2, 6), (1, 5)];
/// Those that fit at any height.
const FEWEST_DECIMALS: (usize, usize) = (0, 4);
/// Greatest dilution of precision that is said.
const MAX_DILUTION: f64 = 99.99;

/// Which sentences an epoch has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// For plotters and autopilots: GGA, RMC, VTG, ZDA, GST, HDT, ROT, XDR.
    Marine,
    /// For gpsd: GGA, RMC, VTG, ZDA and, with a heading, PTNTHTM, which alone brings heading, pitch
    /// and roll into one of its reports. (gpsd 3.22 mixes HDT with the GST before it into an
    /// attitude that is not even JSON.)
    Gpsd,
    /// The sentences for plotters, PASHR, the only one with the standard deviations of the angles,
    /// and PTNL,AVR. (On a port of gpsd PASHR stops the positions.)
    Survey,
    /// For AgOpenGPS: PAOGI; without a roll GGA, VTG and, with a heading, HDT.
    AgOpen,
    /// For ArduPilot: GGA, RMC and, with a heading, KSXT. No sentence says that there is no
    /// heading: an empty one was once taken for north.
    ArduPilot,
}

/// Turns rows into sentences, in the order of time.
#[derive(Debug, Clone)]
pub struct Encoder {
    profile: Profile,
    turn_rate: TurnRate,
}

/// What the sentences of an epoch have in common.
struct Epoch<'a> {
    row: &'a EpochSolution,
    utc: Calendar,
    /// Only in fixed rows.
    attitude: Option<AttitudeEstimate>,
    rates: AngleRates,
}

impl Encoder {
    /// For sentences of this profile.
    #[must_use]
    pub fn new(profile: Profile) -> Self {
        Self { profile, turn_rate: TurnRate::default() }
    }

    /// Appends the sentences of an epoch, each with its checksum and line end.
    pub fn encode(&mut self, row: &EpochSolution, text: &mut String) {
        encode(self.profile, row, self.turn_rate.push(row), text);
    }
}

/// Appends the sentences of an epoch whose angles change with these rates, for those who do not see
/// every row; otherwise as [`Encoder::encode`].
pub fn encode(profile: Profile, row: &EpochSolution, rates: AngleRates, text: &mut String) {
    Epoch::new(row, rates).sentences(profile).iter().for_each(|body| push(text, body));
}

/// The position of an epoch alone, as casters want it.
#[must_use]
pub fn gga(row: &EpochSolution) -> String {
    let mut text = String::new();
    push(&mut text, &Epoch::new(row, [None; 3]).gga());
    text
}

impl<'a> Epoch<'a> {
    fn new(row: &'a EpochSolution, rates: AngleRates) -> Self {
        let utc = nominal(row.time).utc();
        let attitude = row.attitude().filter(|_| row.is_fixed()).copied();
        Self { row, utc, attitude, rates }
    }

    /// What a profile has, in this order.
    fn sentences(&self, profile: Profile) -> Vec<String> {
        let place = [Some(self.gga()), Some(self.rmc()), Some(self.vtg()), Some(self.zda())];
        let turn = [self.gst(), Some(self.hdt()), Some(self.rot()), self.xdr()];
        let all: &[&[Option<String>]] = match profile {
            Profile::Marine => &[&place, &turn],
            Profile::Gpsd => &[&place, &[self.ptnthtm()]],
            Profile::Survey => &[&place, &turn, &[Some(self.pashr()), Some(self.ptnl_avr())]],
            Profile::AgOpen => match self.paogi() {
                Some(paogi) => return vec![paogi],
                None => {
                    &[&[self.degrees(0).map(|_| self.hdt()), Some(self.vtg()), Some(self.gga())]]
                }
            },
            Profile::ArduPilot => &[&[Some(self.gga()), Some(self.rmc()), self.ksxt()]],
        };
        all.concat().into_iter().flatten().collect()
    }

    /// Position, quality and height above the sea.
    fn gga(&self) -> String {
        let clock = clock(&self.utc);
        let Some(position) = &self.row.position else {
            return format!("GNGGA,{clock},,,,,0,00,,,M,,M,,");
        };
        // Both are rounded so that their sum is the height above the ellipsoid.
        let separation_m = (geoid_height_m(&position.geodetic) * 100.0).round() / 100.0;
        let with = |(of_height, of_minutes): (usize, usize)| {
            format!(
                "GNGGA,{clock},{},{},{:02},{},{:.of_height$},M,{separation_m:.2},M,,",
                place(position, of_minutes),
                quality(position.origin),
                self.row.satellites_in_use().min(99),
                number(position.hdop.map(|hdop| hdop.min(MAX_DILUTION)), 2),
                position.geodetic.height_m - separation_m,
            )
        };
        let mut bodies = GGA_DECIMALS.into_iter().map(with);
        bodies.find(|body| body.len() <= MAX_BODY).unwrap_or_else(|| with(FEWEST_DECIMALS))
    }

    /// Position, speed, course and date.
    fn rmc(&self) -> String {
        let (clock, Calendar { year, month, day, .. }) = (clock(&self.utc), self.utc);
        let date = format!("{day:02}{month:02}{:02}", year.rem_euclid(100));
        let Some(position) = &self.row.position else {
            return format!("GNRMC,{clock},V,,,,,,,{date},,,N");
        };
        let speed = number(speed_mps(position).map(|speed| speed * KNOTS_PER_MPS), 3);
        let (place, mode) = (place(position, MINUTE_DECIMALS), mode(Some(position)));
        format!("GNRMC,{clock},A,{place},{speed},{},{date},,,{mode}", course(position))
    }

    /// Course and speed over ground.
    fn vtg(&self) -> String {
        let moving = self.row.position.as_ref().and_then(|p| Some((p, speed_mps(p)?)));
        let Some((position, speed_mps)) = moving else { return "GNVTG,,T,,M,,N,,K,N".to_owned() };
        let (knots, kmh) = (speed_mps * KNOTS_PER_MPS, speed_mps * KMH_PER_MPS);
        let mode = mode(Some(position));
        format!("GNVTG,{},T,,M,{knots:.3},N,{kmh:.3},K,{mode}", course(position))
    }

    /// Date and time.
    fn zda(&self) -> String {
        let Calendar { year, month, day, .. } = self.utc;
        format!("GNZDA,{},{day:02},{month:02},{year:04},00,00", clock(&self.utc))
    }

    /// Standard deviations of the position, and the ellipse of the horizontal ones.
    fn gst(&self) -> Option<String> {
        let covariance = self.row.position?.covariance_m2;
        let SymmetricEigen { eigenvalues, eigenvectors } =
            covariance.fixed_view::<2, 2>(0, 0).into_owned().symmetric_eigen();
        let major = eigenvalues.imax();
        let axis = eigenvectors.column(major);
        let orientation_deg = axis[1].atan2(axis[0]).to_degrees().rem_euclid(180.0);
        let sd = |variance: f64| number(Some(variance.max(0.0).sqrt()), 4);
        Some(format!(
            "GNGST,{},,{},{},{},{},{},{}",
            clock(&self.utc),
            sd(eigenvalues[major]),
            sd(eigenvalues[1 - major]),
            angle(Some(orientation_deg), 1, 180.0),
            sd(covariance[(0, 0)]),
            sd(covariance[(1, 1)]),
            sd(covariance[(2, 2)]),
        ))
    }

    /// True heading.
    fn hdt(&self) -> String {
        format!("GNHDT,{},T", angle(self.degrees(0), 3, 360.0))
    }

    /// Rate of turn, degrees a minute, to starboard positive.
    fn rot(&self) -> String {
        let rate = self.rates[0].filter(|_| self.attitude.is_some());
        match rate {
            Some(rate) => format!("GNROT,{:.2},A", rate.radps.to_degrees() * 60.0 + 0.0),
            None => "GNROT,,V".to_owned(),
        }
    }

    /// Pitch, bow up positive, and roll, to starboard positive, as far as they are known.
    fn xdr(&self) -> Option<String> {
        let named = [(1, "PTCH"), (2, "ROLL")];
        let fields = named
            .iter()
            .filter_map(|(k, name)| Some(format!(",A,{:.3},D,{name}", self.degrees(*k)? + 0.0)));
        let fields: String = fields.collect();
        (!fields.is_empty()).then(|| format!("GNXDR{fields}"))
    }

    /// Heading, pitch or roll of a fixed row.
    fn degrees(&self, k: usize) -> Option<f64> {
        self.attitude?.angles_rad()[k].map(f64::to_degrees)
    }
}

/// The time tag without what a receiver's clock steps it aside by.
fn nominal(time: GpsTime) -> GpsTime {
    let hundredths = (time.as_nanoseconds() + NS_PER_HUNDREDTH / 2).div_euclid(NS_PER_HUNDREDTH);
    GpsTime::from_nanoseconds(hundredths * NS_PER_HUNDREDTH)
}

/// `hhmmss.ss` of a nominal time.
fn clock(utc: &Calendar) -> String {
    format!("{:02}{:02}{:05.2}", utc.hour, utc.minute, utc.second)
}

/// Latitude and longitude with their letters.
fn place(position: &PositionEstimate, decimals: usize) -> String {
    let geodetic = &position.geodetic;
    format!(
        "{},{},{},{}",
        degrees_minutes(geodetic.latitude_rad, 2, decimals),
        if geodetic.latitude_rad < 0.0 { 'S' } else { 'N' },
        degrees_minutes(geodetic.longitude_rad, 3, decimals),
        if geodetic.longitude_rad < 0.0 { 'W' } else { 'E' },
    )
}

/// `ddmm.mmmmmmm` with `decimals` decimals of the minutes, the sign left out.
fn degrees_minutes(angle_rad: f64, width: usize, decimals: usize) -> String {
    let scale = 10f64.powf(decimals as f64);
    let minutes = (angle_rad.abs().to_degrees() * 60.0 * scale).round() / scale;
    let (degrees, length) = ((minutes / 60.0).floor(), decimals + 3);
    format!("{degrees:0width$}{:0length$.decimals$}", minutes - 60.0 * degrees)
}

/// Quality of GGA: alone, with a station by code (real-valued), by phase (integers).
fn quality(origin: PositionOrigin) -> u8 {
    match origin {
        PositionOrigin::Alone => 1,
        PositionOrigin::StationCode => 5,
        PositionOrigin::StationPhase => 4,
    }
}

/// The same in the letters of RMC and VTG.
fn mode(position: Option<&PositionEstimate>) -> char {
    match position.map(|position| position.origin) {
        None => 'N',
        Some(PositionOrigin::Alone) => 'A',
        Some(PositionOrigin::StationCode) => 'F',
        Some(PositionOrigin::StationPhase) => 'R',
    }
}

fn speed_mps(position: &PositionEstimate) -> Option<f64> {
    position.velocity_mps.map(|velocity| velocity.xyz().xy().norm())
}

fn course(position: &PositionEstimate) -> String {
    angle(course_rad(position).map(f64::to_degrees), 2, 360.0)
}

/// An angle from zero up to a full turn, which it does not reach by rounding.
fn angle(degrees: Option<f64>, decimals: i32, turn: f64) -> String {
    let scale = 10f64.powi(decimals);
    let rounded = degrees.map(|degrees| ((degrees * scale).round() / scale).rem_euclid(turn));
    number(rounded, usize::try_from(decimals).unwrap_or_default())
}

fn number(value: Option<f64>, decimals: usize) -> String {
    let finite = value.filter(|v| v.is_finite());
    finite.map_or_else(String::new, |v| format!("{v:.decimals$}"))
}

/// Appends `$body*checksum`: the exclusive or of all characters between `$` and `*`.
fn push(text: &mut String, body: &str) {
    let checksum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    let _ = write!(text, "${body}*{checksum:02X}\r\n");
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::{Attitude, Geodetic, Vector};
    use kurs::solution::{Outcome, Reason};
    use nalgebra::Matrix3;

    /// A fixed row of a ship off Vladivostok that goes north-east.
    fn row(time: GpsTime, heading_deg: f64) -> EpochSolution {
        let heading_rad = heading_deg.to_radians();
        let angles = Attitude { heading_rad, pitch_rad: -0.0349, roll_rad: 0.0175 };
        let geodetic = Geodetic::from_degrees(43.1, -131.9, 30.0);
        let covariance = Matrix3::identity() * 1e-6;
        let mut row = EpochSolution::lost(time, Reason::Ratio);
        row.outcome = Outcome::Fixed {
            attitude: AttitudeEstimate::full(angles.ned_from_body(), &covariance),
        };
        row.satellites = 14;
        row.position = Some(PositionEstimate {
            antenna: Some(0),
            geodetic,
            position_m: geodetic.to_ecef(),
            covariance_m2: Matrix3::new(4.0, 1.5, 0.0, 1.5, 4.0, 0.0, 0.0, 0.0, 9.0),
            velocity_mps: Some(Vector::new(3.0, 3.0, 0.1)),
            clock_m: None,
            hdop: Some(0.876),
            origin: PositionOrigin::Alone,
        });
        row
    }

    /// 2024-03-10 23:59:59.9972 UTC, 18 leap seconds behind GPST.
    fn before_midnight() -> GpsTime {
        let utc = Calendar { year: 2024, month: 3, day: 10, hour: 23, minute: 59, second: 59.9972 };
        GpsTime::from_utc(utc).unwrap()
    }

    fn sentences(encoder: &mut Encoder, row: &EpochSolution) -> Vec<String> {
        let mut text = String::new();
        encoder.encode(row, &mut text);
        text.split_terminator("\r\n").map(|line| line[..line.len() - 3].to_owned()).collect()
    }

    #[test]
    fn an_epoch_of_a_ship() {
        let mut encoder = Encoder::new(Profile::Marine);
        let first = sentences(&mut encoder, &row(before_midnight() + -1.0, 359.0));
        assert_eq!(first[6], "$GNROT,,V", "no earlier row");
        let second = sentences(&mut encoder, &row(before_midnight(), 0.99996));
        let place = "4306.0000000,N,13154.0000000,W";
        let separation = geoid_height_m(&Geodetic::from_degrees(43.1, -131.9, 0.0));
        let (sea, height) = (format!("{separation:.2}"), format!("{:.2}0", 30.0 - separation));
        assert_eq!(
            second,
            [
                format!("$GNGGA,000000.00,{place},1,14,0.88,{height},M,{sea},M,,"),
                format!("$GNRMC,000000.00,A,{place},8.247,45.00,110324,,,A"),
                "$GNVTG,45.00,T,,M,8.247,N,15.274,K,A".to_owned(),
                "$GNZDA,000000.00,11,03,2024,00,00".to_owned(),
                "$GNGST,000000.00,,2.3452,1.5811,45.0,2.0000,2.0000,3.0000".to_owned(),
                "$GNHDT,1.000,T".to_owned(),
                "$GNROT,120.00,A".to_owned(),
                "$GNXDR,A,-2.000,D,PTCH,A,1.003,D,ROLL".to_owned(),
            ]
        );
    }

    #[test]
    fn what_is_not_known_is_empty() {
        let lost = EpochSolution::lost(before_midnight(), Reason::FewSatellites);
        let found = sentences(&mut Encoder::new(Profile::Survey), &lost);
        let expected = [
            "$GNGGA,000000.00,,,,,0,00,,,M,,M,,",
            "$GNRMC,000000.00,V,,,,,,,110324,,,N",
            "$GNVTG,,T,,M,,N,,K,N",
            "$GNZDA,000000.00,11,03,2024,00,00",
            "$GNHDT,,T",
            "$GNROT,,V",
            "$PASHR,000000.00,,T,,,,,,,0,0",
            "$PTNL,AVR,000000.00,,,,,,,,0,,0",
        ];
        assert_eq!(found, expected);
        let found = sentences(&mut Encoder::new(Profile::Gpsd), &lost);
        assert_eq!(found, expected[..4]);
        // A float row has a position, and a heading that does not leave.
        let mut float = row(before_midnight(), 20.0);
        let attitude = float.attitude().copied();
        float.outcome = Outcome::Float { attitude, reason: Some(Reason::Ratio) };
        let found = sentences(&mut Encoder::new(Profile::Marine), &float);
        assert_eq!(found[5..], ["$GNHDT,,T", "$GNROT,,V"]);
        assert!(found[0].contains(",1,14,0.88,"));
    }

    #[test]
    fn the_station_is_in_the_quality_and_deviations_in_the_survey() {
        let mut with_station = row(before_midnight(), 359.9996);
        for (origin, quality, mode) in
            [(PositionOrigin::StationPhase, ",4,", 'R'), (PositionOrigin::StationCode, ",5,", 'F')]
        {
            with_station.position.as_mut().unwrap().origin = origin;
            let found = sentences(&mut Encoder::new(Profile::Survey), &with_station);
            assert!(found[0].contains(quality), "{}", found[0]);
            assert!(found[1].ends_with(mode) && found[2].ends_with(mode));
            assert_eq!(found[5], "$GNHDT,0.000,T", "rounded, and a full turn is none");
            let pashr = "$PASHR,000000.00,0.000,T,+1.003,-2.000,,0.057,0.057,0.057,";
            assert!(found[8].starts_with(pashr), "{}", found[8]);
        }
    }

    /// With two antennas one tilt is unknown.
    #[test]
    fn one_sentence_has_the_attitude_for_gpsd() {
        let mut row = row(before_midnight(), 359.9996);
        let found = sentences(&mut Encoder::new(Profile::Gpsd), &row);
        assert_eq!(found[4..], ["$PTNTHTM,0.000,N,-2.000,N,1.003,N,,"]);
        let attitude = AttitudeEstimate { roll_rad: None, ..*row.attitude().unwrap() };
        row.outcome = Outcome::Fixed { attitude };
        let found = sentences(&mut Encoder::new(Profile::Gpsd), &row);
        assert_eq!(found[4..], ["$PTNTHTM,0.000,N,-2.000,N,,,,"]);
    }

    /// On the Elbrus, below the Dead Sea's shore, in an aircraft and in orbit.
    #[test]
    fn gga_is_never_longer_than_nmea_0183_allows() {
        let mut row = row(before_midnight(), 20.0);
        let mut gga_at = |height_m: f64, hdop: f64| {
            let position = row.position.as_mut().unwrap();
            position.geodetic = Geodetic { height_m, ..position.geodetic };
            position.hdop = Some(hdop);
            gga(&row)
        };
        for (height_m, hdop) in [30.0, 642.5, 5642.1, -430.0, 12_345.678, 500_000.0, 2e7]
            .into_iter()
            .flat_map(|height_m| [(height_m, 0.876), (height_m, 1e6)])
        {
            let sentence = gga_at(height_m, hdop);
            assert!(sentence.len() <= 82, "{} characters: {sentence}", sentence.len());
            let fields: Vec<&str> = sentence.split(',').collect();
            let number = |k: usize| fields[k].parse::<f64>().unwrap();
            let tolerance_m = if height_m < 1e6 { 0.06 } else { 0.6 };
            assert!((number(9) + number(11) - height_m).abs() < tolerance_m, "{sentence}");
            assert!((number(2) - 4306.0).abs() < 1e-9, "{sentence}");
        }
    }

    /// NMEA 0183: the checksum of this sentence is 03.
    #[test]
    fn checksum_is_the_exclusive_or() {
        let mut text = String::new();
        push(&mut text, "GPHDT,274.07,T");
        assert_eq!(text, "$GPHDT,274.07,T*03\r\n");
    }

    #[test]
    fn minutes_carry_into_degrees() {
        assert_eq!(degrees_minutes(48f64.to_radians(), 2, 7), "4800.0000000");
        assert_eq!(degrees_minutes(-0.5f64.to_radians(), 3, 7), "00030.0000000");
        let almost = (12.0 - 1e-12f64).to_radians();
        assert_eq!(degrees_minutes(almost, 3, 7), "01200.0000000");
    }
}
