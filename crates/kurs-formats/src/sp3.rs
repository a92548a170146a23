//! SP3, precise orbits and clocks.
//!
//! Source: S. Hilla, "The Extended Standard Product 3 Orbit Format (SP3-d)", 2016. Positions are in
//! kilometres, clocks in microseconds.

use std::collections::BTreeMap;

use kurs::ephemeris::{EphemerisStore, PreciseNode};
use kurs::frames::Vector;
use kurs::signal::{Satellite, System};
use kurs::time::{Calendar, GPST_MINUS_BDT_S, GpsTime};

use crate::read_summary::ReadSummary;
use crate::rinex::fields::{columns, decimal, integer, small_integer, text};
use crate::source::{ReadError, Source};

/// Where neither the record nor the header tells the accuracy.
const UNKNOWN_SIGMA_M: f64 = 0.5;
/// Clocks from here on (µs) are absent.
const NO_CLOCK_US: f64 = 999_999.0;
/// TAI − GPST.
const TAI_MINUS_GPST_S: f64 = 19.0;

/// Reads a whole file.
pub(crate) fn read(
    source: &mut Source,
    store: &mut EphemerisStore,
    summary: &mut ReadSummary,
) -> Result<(), ReadError> {
    let mut header = Header::default();
    let (mut epoch, mut has_ended) = (None, false);
    while source.advance()? {
        let (line, number) = (source.line(), source.line_number());
        match line {
            [b'*', ..] => {
                let later = header.time(columns(line, 3..31)).filter(|time| {
                    epoch.is_none_or(|known| *time > known) // a file is in the order of time
                });
                if later.is_none() {
                    let found = text(line, 3..31);
                    summary.damage.note(number, format!("{found:?} is not a later date and time"));
                }
                epoch = later.or(epoch);
                header.epoch_is_good = later.is_some();
            }
            [b'P', ..] if header.epoch_is_good => match node(line, epoch, &header) {
                Ok(Some((satellite, node))) => {
                    store.insert_precise(satellite, node);
                    *summary.records.entry(satellite.system).or_default() += 1;
                }
                Ok(None) => {}
                Err(what) => summary.damage.note(number, what),
            },
            [b'E', b'O', b'F', ..] => has_ended = true,
            [b'#', b'a'..=b'd', ..] if has_ended || epoch.is_some() => {
                summary.damage.note(number, "a second header: files were joined here");
                (header, epoch, has_ended) = (Header::default(), None, false);
            }
            _ => header.take(line),
        }
    }
    if !has_ended {
        summary.damage.note(source.line_number(), "the file ends before EOF");
    }
    Ok(())
}

/// What the header says about the records.
#[derive(Debug, Default)]
struct Header {
    satellites: Vec<Option<Satellite>>,
    sigma_m: BTreeMap<Satellite, f64>,
    accuracies: usize,
    scale: Scale,
    scale_is_known: bool,
    /// Base of the exponents that state the accuracy of a position, mm.
    base_mm: f64,
    epoch_is_good: bool,
}

/// Time scale of the epochs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Scale {
    #[default]
    Gps,
    BeiDou,
    Utc,
    Tai,
}

impl Header {
    fn take(&mut self, line: &[u8]) {
        match line {
            [b'+', b'+', ..] => self.take_accuracies(line),
            [b'+', ..] => {
                let names = (0..17).map(|i| columns(line, 9 + 3 * i..12 + 3 * i));
                self.satellites.extend(names.map(satellite));
            }
            [b'%', b'c', ..] if !self.scale_is_known => {
                self.scale_is_known = true;
                self.scale = match columns(line, 9..12) {
                    b"BDT" => Scale::BeiDou,
                    b"UTC" | b"GLO" => Scale::Utc,
                    b"TAI" => Scale::Tai,
                    _ => Scale::Gps,
                };
            }
            [b'%', b'f', ..] if self.base_mm == 0.0 => {
                self.base_mm = decimal(columns(line, 3..13)).unwrap_or(0.0);
            }
            _ => {}
        }
    }

    /// Exponents of 2 mm, in the order of the satellites; zero is unknown.
    fn take_accuracies(&mut self, line: &[u8]) {
        for i in 0..17 {
            let satellite = self.satellites.get(self.accuracies).copied().flatten();
            let exponent = integer(columns(line, 9 + 3 * i..12 + 3 * i)).unwrap_or(0);
            if let Some(satellite) = satellite.filter(|_| exponent > 0) {
                self.sigma_m.insert(satellite, 1e-3 * 2f64.powi(exponent.min(20)));
            }
            self.accuracies += 1;
        }
    }

    fn time(&self, field: &[u8]) -> Option<GpsTime> {
        let mut words = str::from_utf8(field).ok()?.split_ascii_whitespace();
        let year = words.next()?.parse().ok()?;
        let mut small = || words.next()?.parse::<u8>().ok();
        let (month, day, hour, minute) = (small()?, small()?, small()?, small()?);
        let date = Calendar { year, month, day, hour, minute, second: words.next()?.parse().ok()? };
        match self.scale {
            Scale::Gps => GpsTime::from_calendar(date),
            Scale::BeiDou => Some(GpsTime::from_calendar(date)? + GPST_MINUS_BDT_S),
            Scale::Tai => Some(GpsTime::from_calendar(date)? + -TAI_MINUS_GPST_S),
            Scale::Utc => GpsTime::from_utc(date),
        }
    }

    /// The accuracy stated in the record, else that of the header.
    fn sigma_m(&self, line: &[u8], satellite: Satellite) -> f64 {
        let exponents = [61..63, 64..66, 67..69].map(|range| integer(columns(line, range)));
        let largest = exponents.into_iter().flatten().max().filter(|_| self.base_mm > 1.0);
        match largest {
            Some(exponent) => 1e-3 * self.base_mm.min(2.0).powi(exponent.clamp(0, 99)).min(1e6),
            None => self.sigma_m.get(&satellite).copied().unwrap_or(UNKNOWN_SIGMA_M),
        }
    }
}

/// A satellite of the list or of a record; old files leave the letter of GPS out.
fn satellite(name: &[u8]) -> Option<Satellite> {
    let system = match name.first()? {
        b' ' => System::Gps,
        letter => System::from_letter(*letter)?,
    };
    let number = small_integer(columns(name, 1..3))?;
    (1..=99).contains(&number).then_some(Satellite::new(system, number))
}

/// A position record; `None` where it says that there is no position, or is of a satellite that
/// Kurs does not know.
fn node(
    line: &[u8],
    epoch: Option<GpsTime>,
    header: &Header,
) -> Result<Option<(Satellite, PreciseNode)>, String> {
    let (Some(satellite), Some(time)) = (satellite(columns(line, 1..4)), epoch) else {
        return Ok(None);
    };
    let number = |range: core::ops::Range<usize>| {
        decimal(columns(line, range.clone()))
            .ok_or_else(|| format!("{satellite}: {:?} is not a number", text(line, range)))
    };
    let position_m = Vector::new(number(4..18)?, number(18..32)?, number(32..46)?) * 1e3;
    if position_m.norm() == 0.0 {
        return Ok(None);
    }
    let clock_us = match columns(line, 46..60).trim_ascii() {
        b"" => None,
        _ => Some(number(46..60)?).filter(|clock_us| clock_us.abs() < NO_CLOCK_US),
    };
    let node = PreciseNode {
        time,
        position_m,
        clock_s: clock_us.map(|clock_us| clock_us * 1e-6),
        clock_event: columns(line, 74..75) == b"E",
        sigma_m: header.sigma_m(line, satellite),
    };
    Ok(Some((satellite, node)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation;
    use kurs::ephemeris::NavigationData;

    const HEADER: &str = "\
#dP2023  2 19  0  0  0.00000000       2 d+D   IGS20 FIT AIUB
+    2   G01C46  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         5  7  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
%f  1.2500000  1.025000000  0.00000000000  0.000000000000000
";

    fn read(text: &str) -> (NavigationData, ReadSummary) {
        let mut data = NavigationData::default();
        let bytes = std::io::Cursor::new(text.as_bytes().to_vec());
        let mut source = Source::new(bytes, "test.sp3").unwrap();
        let summary = navigation::read(&mut source, &mut data).unwrap();
        (data, summary)
    }

    #[test]
    fn records_and_what_they_leave_open() {
        let body = "\
*  2023  2 19  0  0  0.00000000
PG01  20308.731285  11790.619637  12427.122166    211.020877 10 12  9 100 E
PC46  -7318.725344 -26948.971448   -475.131359 999999.999999
PX01  -7318.725344 -26948.971448   -475.131359 999999.999999
*  2023  2 19  0  5  0.00000000
PG01      0.000000      0.000000      0.000000 999999.999999
PC46  -7318.725344 -26948.9x1448   -475.131359 999999.999999
VC46  -7318.725344 -26948.971448   -475.131359 999999.999999
*  2023  2 19  0  0  0.00000000
PG01  20308.731285  11790.619637  12427.122166    211.020877
EOF
";
        let (data, summary) = read(&[HEADER, body].concat());
        let (behind_empty_lines, _) = read(&["\n \n", HEADER, body].concat());
        assert_eq!(behind_empty_lines, data);
        let orbits: Vec<_> = data.ephemerides.precise().iter().collect();
        assert_eq!(orbits.len(), 2);
        let g01 = orbits[0].1[0];
        assert_eq!(g01.position_m, Vector::new(20_308_731.285, 11_790_619.637, 12_427_122.166));
        assert!((g01.clock_s.unwrap() - 211.020_877e-6).abs() < 1e-18);
        assert!(g01.clock_event);
        assert!((g01.sigma_m - 1.25f64.powi(12) * 1e-3).abs() < 1e-12);
        assert_eq!((g01.time.week(), g01.time.tow_s()), (2250, 0.0));
        let c46 = orbits[1].1[0];
        assert_eq!((c46.clock_s, c46.sigma_m), (None, 0.128));
        let damaged: Vec<u64> = summary.damage.listed().iter().map(|d| d.line).collect();
        assert_eq!(damaged, [12, 14], "{:?}", summary.damage);
    }

    #[test]
    fn time_scales() {
        let record = "*  2023  2 19  0  0  0.00000000\n\
            PG01  20308.731285  11790.619637  12427.122166    211.020877\nEOF\n";
        for (scale, tow_s) in [("GPS", 0.0), ("GAL", 0.0), ("BDT", 14.0), ("UTC", 18.0)] {
            let text = [&HEADER.replace("cc GPS", &format!("cc {scale}")), record].concat();
            let (data, _) = read(&text);
            let time = data.ephemerides.precise().iter().next().unwrap().1[0].time;
            assert_eq!(time.tow_s(), tow_s, "{scale}");
        }
    }

    /// The header of the second file is its own: another scale of time, other satellites, any day.
    #[test]
    fn joined_files_are_read_with_their_own_headers() {
        let record = "*  2023  2 19  0  0  0.00000000\n\
            PG01  20308.731285  11790.619637  12427.122166    211.020877\nEOF\n";
        let first = [HEADER, &record.replace("2 19", "2 20")].concat();
        let second = [&HEADER.replace("cc GPS", "cc BDT"), record].concat();
        let (data, summary) = read(&[first.as_str(), &second].concat());
        let (_, nodes) = data.ephemerides.precise().iter().next().unwrap();
        let times: Vec<f64> = nodes.iter().map(|node| node.time.tow_s()).collect();
        assert_eq!(times, [14.0, 86_400.0]);
        let [damage] = summary.damage.listed() else { panic!("{:?}", summary.damage) };
        assert_eq!(damage.line, first.lines().count() as u64 + 1);
        assert_eq!(damage.what, "a second header: files were joined here");
    }

    #[test]
    fn a_cut_file_keeps_what_came_before() {
        let record = "*  2023  2 19  0  0  0.00000000\n\
            PG01  20308.731285  11790.619637  12427.122166    211.020877\nPG02  203";
        let (data, summary) = read(&[HEADER, record].concat());
        assert_eq!(data.ephemerides.precise().iter().count(), 1);
        assert_eq!(summary.damage.total(), 2);
    }
}
