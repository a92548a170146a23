//! Compact RINEX 3 (CRINEX 3.0), written line by line: what goes in is the text of a RINEX 3
//! observation file, what comes out its compact form.
//!
//! Numbers become third differences in time, texts the characters that changed. Source: Y.
//! Hatanaka, A Compression Format and Tools for GNSS Observation Data, Bulletin of the Geographical
//! Survey Institute 55 (2008) 21-30.

use std::collections::BTreeMap;
use std::io::{self, Write};

use kurs::time::GpsTime;

/// Order of the differences.
const ORDER: usize = 3;
/// Columns of an observation: number, loss-of-lock digit, strength digit.
const NUMBER: usize = 14;
const FIELD: usize = 16;
/// Columns of an epoch line in front of the names of the satellites.
const EPOCH_COLUMNS: usize = 41;
/// Decimals of an observation, and of the receiver clock offset behind the epoch line.
const DECIMALS: usize = 3;
const CLOCK_DECIMALS: usize = 12;
const MONTHS: [&str; 12] =
    ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"];

/// Writes the compact form of the lines that are written to it.
#[derive(Debug)]
pub struct CompactWriter<W: Write> {
    output: W,
    /// A line that has not ended yet.
    line: Vec<u8>,
    in_header: bool,
    /// Observations of a satellite, by the letter of its system.
    columns: BTreeMap<u8, usize>,
    /// The epoch that is being collected, and how many of its satellites are still to come.
    epoch: Vec<u8>,
    satellites: Vec<Vec<u8>>,
    missing: usize,
    /// Text of the epoch before, and the satellites it had.
    before: Vec<u8>,
    clock: Option<Arc>,
    tracked: BTreeMap<[u8; 3], Tracked>,
}

/// What the next line of a satellite is the difference to.
#[derive(Debug, Clone, Default)]
struct Tracked {
    arcs: Vec<Option<Arc>>,
    digits: Vec<u8>,
}

/// The last differences of a number: order 0 is the number itself.
#[derive(Debug, Clone, Copy)]
struct Arc {
    differences: [i64; ORDER + 1],
    level: usize,
}

impl<W: Write> CompactWriter<W> {
    /// Writes the two lines in front of the header; `time` is the date of the file.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn new(mut output: W, time: GpsTime) -> io::Result<Self> {
        let c = time.calendar();
        let month = MONTHS[usize::from(c.month.clamp(1, 12)) - 1];
        let date = format!(
            "{:02}-{month}-{:02} {:02}:{:02}",
            c.day,
            c.year.rem_euclid(100),
            c.hour,
            c.minute
        );
        let format = format!("{:<20}{:<40}", "3.0", "COMPACT RINEX FORMAT");
        writeln!(output, "{format}CRINEX VERS   / TYPE")?;
        writeln!(output, "{:<40}{date:<20}CRINEX PROG / DATE", "kurs")?;
        Ok(Self {
            output,
            line: Vec::new(),
            in_header: true,
            columns: BTreeMap::new(),
            epoch: Vec::new(),
            satellites: Vec::new(),
            missing: 0,
            before: Vec::new(),
            clock: None,
            tracked: BTreeMap::new(),
        })
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    ///
    /// What the output refuses; `InvalidData` for an epoch that lacks satellites.
    pub fn finish(mut self) -> io::Result<W> {
        if self.missing > 0 || !self.line.is_empty() {
            return Err(invalid("the last epoch is not complete"));
        }
        self.output.flush()?;
        Ok(self.output)
    }

    fn take_line(&mut self) -> io::Result<()> {
        let line = core::mem::take(&mut self.line);
        if self.in_header {
            self.take_header(&line)?;
        } else if self.missing > 0 {
            self.satellites.push(line);
            self.missing -= 1;
        } else {
            self.take_epoch(line)?;
        }
        if !self.in_header && self.missing == 0 && !self.epoch.is_empty() {
            self.write_epoch()?;
        }
        Ok(())
    }

    fn take_header(&mut self, line: &[u8]) -> io::Result<()> {
        self.output.write_all(line)?;
        self.output.write_all(b"\n")?;
        let label = line.get(60..).unwrap_or_default().trim_ascii_end();
        if label == b"SYS / # / OBS TYPES" && line[0] != b' ' {
            let count = number(&line[3..6]).and_then(|count| usize::try_from(count).ok());
            self.columns.insert(line[0], count.ok_or_else(|| invalid("no count of types"))?);
        }
        self.in_header = label != b"END OF HEADER";
        Ok(())
    }

    fn take_epoch(&mut self, line: Vec<u8>) -> io::Result<()> {
        let count = line.get(32..35).and_then(number).and_then(|count| usize::try_from(count).ok());
        match (line.first(), line.get(31), count) {
            (Some(b'>'), Some(b'0' | b'1'), Some(count)) => self.missing = count,
            (Some(b'>'), Some(_), Some(_)) => return Err(invalid("an event is not written")),
            _ => return Err(invalid("an epoch line of RINEX 3 was expected")),
        }
        self.epoch = line;
        Ok(())
    }

    /// Epoch line with the satellites, clock line, and a line for each satellite.
    fn write_epoch(&mut self) -> io::Result<()> {
        let mut text = core::mem::take(&mut self.epoch);
        let clock = units(text.get(EPOCH_COLUMNS..).unwrap_or_default(), CLOCK_DECIMALS)?;
        text.resize(EPOCH_COLUMNS, b' ');
        for line in &self.satellites {
            text.extend_from_slice(line.get(..3).ok_or_else(|| invalid("no satellite"))?);
        }
        // The first one stands in full, as it is.
        let written = match self.before.is_empty() {
            true => text.clone(),
            false => changes(&self.before, &text),
        };
        self.before = text;
        self.output.write_all(written.trim_ascii_end())?;
        let mut clock_line = b"\n".to_vec();
        self.clock = Arc::follow(self.clock, clock, &mut clock_line)?;
        self.output.write_all(&clock_line)?;
        self.output.write_all(b"\n")?;
        // Arcs go on from the epoch before; who was not there begins anew.
        let mut before = core::mem::take(&mut self.tracked);
        for line in core::mem::take(&mut self.satellites) {
            let name = [line[0], line[1], line[2]];
            let count =
                *self.columns.get(&name[0]).ok_or_else(|| invalid("no types of a system"))?;
            let mut tracked = before.remove(&name).unwrap_or_default();
            let compact = tracked.compact(&line[3..], count)?;
            self.output.write_all(&compact)?;
            self.output.write_all(b"\n")?;
            self.tracked.insert(name, tracked);
        }
        Ok(())
    }
}

impl<W: Write> Write for CompactWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            match piece.split_last() {
                Some((b'\n', rest)) => {
                    self.line.extend_from_slice(rest);
                    self.take_line()?;
                }
                _ => self.line.extend_from_slice(piece),
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}

impl Tracked {
    /// The compact line of a satellite from its observations: differences, then changed digits.
    fn compact(&mut self, observations: &[u8], count: usize) -> io::Result<Vec<u8>> {
        let mut line = Vec::with_capacity(observations.len());
        let mut digits = Vec::with_capacity(2 * count);
        self.arcs.resize(count, None);
        for (index, arc) in self.arcs.iter_mut().enumerate() {
            let mut field = [b' '; FIELD];
            let given = observations.get(FIELD * index..).unwrap_or_default();
            let width = given.len().min(FIELD);
            field[..width].copy_from_slice(&given[..width]);
            *arc = Arc::follow(*arc, units(&field[..NUMBER], DECIMALS)?, &mut line)?;
            line.push(b' ');
            digits.extend_from_slice(&field[NUMBER..]);
        }
        line.extend(changes(&self.digits, &digits));
        self.digits = digits;
        line.truncate(line.trim_ascii_end().len());
        Ok(line)
    }
}

impl Arc {
    /// Writes the next number of an arc; the arc ends where there is none.
    fn follow(
        arc: Option<Self>,
        number: Option<i64>,
        line: &mut Vec<u8>,
    ) -> io::Result<Option<Self>> {
        let Some(number) = number else { return Ok(None) };
        let Some(Self { differences: before, level }) = arc else {
            write!(line, "{ORDER}&{number}")?;
            return Ok(Some(Self { differences: [number, 0, 0, 0], level: 0 }));
        };
        // Δᵏy(t) = Δᵏ⁻¹y(t) − Δᵏ⁻¹y(t−1); the order grows to its limit as the arc goes on.
        let level = (level + 1).min(ORDER);
        let mut differences = [number, 0, 0, 0];
        for order in 1..=level {
            differences[order] = differences[order - 1] - before[order - 1];
        }
        write!(line, "{}", differences[level])?;
        Ok(Some(Self { differences, level }))
    }
}

/// What turns `before` into `text`: a blank where a character stays, `&` where it becomes blank,
/// also beyond the end of `before`.
fn changes(before: &[u8], text: &[u8]) -> Vec<u8> {
    let change = |index: usize| match (before.get(index), text.get(index).unwrap_or(&b' ')) {
        (Some(old), new) if old == new => b' ',
        (_, b' ') => b'&',
        (_, new) => *new,
    };
    (0..before.len().max(text.len())).map(change).collect()
}

/// The number of a field in units of its last decimal; `None` if the field is blank.
fn units(field: &[u8], decimals: usize) -> io::Result<Option<i64>> {
    let text = field.trim_ascii();
    if text.is_empty() {
        return Ok(None);
    }
    let whole: Vec<u8> = text.iter().copied().filter(|byte| *byte != b'.').collect();
    let found = text.rsplit(|byte| *byte == b'.').next().map(<[u8]>::len);
    match number(&whole) {
        Some(number) if found == Some(decimals) => Ok(Some(number)),
        _ => Err(invalid(&format!("a number with {decimals} decimals was expected"))),
    }
}

fn number(text: &[u8]) -> Option<i64> {
    core::str::from_utf8(text).ok()?.trim().parse().ok()
}

fn invalid(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("not RINEX 3 observations: {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observations::ObservationSource;
    use crate::rinex::{ObservationFileHeader, ObservationWriter};
    use kurs::frames::Vector;
    use kurs::observation::{AntennaEpoch, Lock, Observation};
    use kurs::signal::{Signal, System};

    /// Satellites come and go, values jump, lack and change sign, digits change: what is written is
    /// read back, and a third difference is what the paper says.
    #[test]
    fn compact_files_are_read_back() {
        let signals = [Signal::new(System::Gps, 1, b'C'), Signal::new(System::Galileo, 5, b'Q')];
        let first = GpsTime::from_week_tow(2305, 43_200.0).unwrap();
        let epochs: Vec<AntennaEpoch> = (0..40_u8)
            .map(|k| {
                let t = f64::from(k);
                let seen = |number: u8| !(k + number).is_multiple_of(7);
                let observation = |number: u8, signal: Signal| Observation {
                    satellite: kurs::signal::Satellite::new(signal.band.system, number),
                    signal,
                    pseudorange_m: (number != 3).then_some(22e6 + 5e3 * t * f64::from(number)),
                    phase_cycles: Some((0.25 * t * t * t - 4000.0 * t) + f64::from(number)),
                    doppler_hz: Some(-1234.5 + 100.0 * t),
                    cn0_dbhz: (!k.is_multiple_of(5)).then_some(30.0 + t * 0.25),
                    lock: Lock(if k.is_multiple_of(9) { Lock::SLIP } else { 0 }),
                };
                let all = (1..=6).flat_map(|n| signals.map(|signal| (n, signal)));
                let mut observations: Vec<Observation> = all
                    .filter(|(n, _)| seen(*n))
                    .map(|(n, signal)| observation(n, signal))
                    .collect();
                observations.sort_by_key(|o| o.satellite);
                AntennaEpoch { time: first + t, observations, ..AntennaEpoch::default() }
            })
            .collect();
        let header = ObservationFileHeader {
            marker: "A0".to_owned(),
            position_m: Vector::new(2_847_000.0, 2_196_000.0, 5_249_000.0),
            interval_s: 1.0,
            first,
            signals: signals.to_vec(),
            glonass_channels: BTreeMap::new(),
        };
        let compact = CompactWriter::new(Vec::new(), first).unwrap();
        let mut writer = ObservationWriter::new(compact, &header).unwrap();
        epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
        let bytes = writer.finish().unwrap().finish().unwrap();
        let text = String::from_utf8(bytes.clone()).unwrap();
        assert!(text.lines().any(|line| line.starts_with("3&22")), "{text}");
        assert!(text.contains("\n> 2024 03 10 12 00  0.0000000  0"), "{text}");
        let mut source = ObservationSource::new(std::io::Cursor::new(bytes), "compact").unwrap();
        let mut read = AntennaEpoch::default();
        for epoch in &epochs {
            assert!(source.next_epoch(&mut read).unwrap());
            assert_eq!((read.time, &read.observations), (epoch.time, &epoch.observations));
        }
        assert!(!source.next_epoch(&mut read).unwrap());
        assert_eq!(source.damage(), []);
    }

    #[test]
    fn what_is_not_rinex_3_is_refused() {
        let start = || CompactWriter::new(Vec::new(), GpsTime::default()).unwrap();
        let end = format!("{:60}END OF HEADER\n", "");
        let mut writer = start();
        writer.write_all(end.as_bytes()).unwrap();
        assert!(writer.write_all(b" 05  3 24 13 10 36.0000000  0  4G12\n").is_err());
        let mut writer = start();
        writer.write_all(end.as_bytes()).unwrap();
        assert!(writer.write_all(b"> 2024 03 10 12 00  0.0000000  4  1\n").is_err());
        let mut writer = start();
        writer.write_all(end.as_bytes()).unwrap();
        writer.write_all(b"> 2024 03 10 12 00  0.0000000  0  2\n").unwrap();
        assert!(writer.finish().is_err());
    }
}
