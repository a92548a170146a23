//! RINEX 3.05 observation files, written epoch by epoch.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use kurs::frames::{Ecef, Vector};
use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;

/// Observation types on one line of the header.
const TYPES_A_LINE: usize = 13;
/// GLONASS slots on one line of the header.
const SLOTS_A_LINE: usize = 8;

/// What the header says.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationFileHeader {
    /// Name of the marker.
    pub marker: String,
    /// Approximate position of the antenna.
    pub position_m: Vector<Ecef>,
    /// Time between epochs.
    pub interval_s: f64,
    /// Time tag of the first epoch; also the date of the file.
    pub first: GpsTime,
    /// Signals that the file can hold.
    pub signals: Vec<Signal>,
    /// Frequency channel of each GLONASS slot.
    pub glonass_channels: BTreeMap<u8, i8>,
}

/// Writes the epochs of one antenna.
#[derive(Debug)]
pub struct ObservationWriter<W: Write> {
    output: W,
    signals: BTreeMap<System, Vec<Signal>>,
}

impl<W: Write> ObservationWriter<W> {
    /// Writes the header.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn new(mut output: W, header: &ObservationFileHeader) -> io::Result<Self> {
        let mut signals: BTreeMap<System, Vec<Signal>> = BTreeMap::new();
        for signal in header.signals.iter().collect::<BTreeSet<_>>() {
            signals.entry(signal.band.system).or_default().push(*signal);
        }
        write_header(&mut output, header, &signals)?;
        Ok(Self { output, signals })
    }

    /// Writes an epoch. The observations of one satellite must stand together; those of signals
    /// that the header does not name are left out.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn write(&mut self, epoch: &AntennaEpoch) -> io::Result<()> {
        let of_satellites =
            || epoch.observations.chunk_by(|one, other| one.satellite == other.satellite);
        let known = |observations: &&[Observation]| {
            self.signals.contains_key(&observations[0].satellite.system)
        };
        let flag = u8::from(epoch.power_failure);
        let count = of_satellites().filter(known).count();
        let c = epoch.time.calendar();
        writeln!(
            self.output,
            "> {:04} {:02} {:02} {:02} {:02}{:11.7}  {flag}{count:3}",
            c.year, c.month, c.day, c.hour, c.minute, c.second
        )?;
        for observations in of_satellites() {
            let satellite = observations[0].satellite;
            if let Some(signals) = self.signals.get(&satellite.system) {
                write_satellite(&mut self.output, satellite, signals, observations)?;
            }
        }
        Ok(())
    }

    /// Ends the file and gives the output back.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn finish(mut self) -> io::Result<W> {
        self.output.flush()?;
        Ok(self.output)
    }
}

/// One line: pseudorange, phase, Doppler and C/N0 of every signal.
fn write_satellite(
    output: &mut impl Write,
    satellite: Satellite,
    signals: &[Signal],
    observations: &[Observation],
) -> io::Result<()> {
    const BLANK: &str = "                ";
    const WIDTH: usize = 14;
    let mut line = satellite.to_string();
    for signal in signals {
        let Some(seen) = observations.iter().find(|o| o.signal == *signal) else {
            line.extend([BLANK; 4]);
            continue;
        };
        let lock = if seen.lock.0 == 0 { ' ' } else { char::from(b'0' + seen.lock.0.min(7)) };
        let strength = strength_digit(seen.cn0_dbhz);
        for (value, lock, strength) in [
            (seen.pseudorange_m, ' ', strength),
            (seen.phase_cycles, lock, strength),
            (seen.doppler_hz, ' ', ' '),
            (seen.cn0_dbhz, ' ', ' '),
        ] {
            // F14.3: what has no room in the columns is left blank, or it would move all others.
            let text = value.filter(|value| value.is_finite()).map(|value| format!("{value:14.3}"));
            match text.filter(|text| text.len() == WIDTH) {
                Some(text) => line.push_str(&format!("{text}{lock}{strength}")),
                None => line.push_str(BLANK),
            }
        }
    }
    writeln!(output, "{}", line.trim_end())
}

/// RINEX 3.05, table 14: min(max(C/N0 / 6, 1), 9).
fn strength_digit(cn0_dbhz: Option<f64>) -> char {
    cn0_dbhz.map_or(' ', |cn0| {
        let limits = (1..=9).rev().find(|digit| cn0 >= 6.0 * f64::from(*digit)).unwrap_or(1);
        char::from(b'0' + limits)
    })
}

fn write_header(
    output: &mut impl Write,
    header: &ObservationFileHeader,
    signals: &BTreeMap<System, Vec<Signal>>,
) -> io::Result<()> {
    let mut line = |text: &str, label: &str| writeln!(output, "{text:<60}{label}");
    line("     3.05           OBSERVATION DATA    M", "RINEX VERSION / TYPE")?;
    let c = header.first.calendar();
    let date = format!(
        "{:04}{:02}{:02} {:02}{:02}{:02.0} GPS",
        c.year,
        c.month,
        c.day,
        c.hour,
        c.minute,
        c.second.floor()
    );
    line(&format!("{:<20}{:<20}{date}", "kurs", ""), "PGM / RUN BY / DATE")?;
    line(&header.marker, "MARKER NAME")?;
    line("", "OBSERVER / AGENCY")?;
    line("", "REC # / TYPE / VERS")?;
    line("", "ANT # / TYPE")?;
    let [x, y, z] = header.position_m.xyz().into();
    line(&format!("{x:14.4}{y:14.4}{z:14.4}"), "APPROX POSITION XYZ")?;
    line(&format!("{0:14.4}{0:14.4}{0:14.4}", 0.0), "ANTENNA: DELTA H/E/N")?;
    for (system, signals) in signals {
        write_types(&mut line, *system, signals)?;
    }
    line(&format!("{:10.3}", header.interval_s), "INTERVAL")?;
    let date = format!(
        "{:6}{:6}{:6}{:6}{:6}{:13.7}     GPS",
        c.year, c.month, c.day, c.hour, c.minute, c.second
    );
    line(&date, "TIME OF FIRST OBS")?;
    for (system, signals) in signals {
        for Signal { band, attribute } in signals {
            let (digit, code) = (band.digit, char::from(*attribute));
            line(&format!("{} L{digit}{code}  0.00000", system.letter()), "SYS / PHASE SHIFT")?;
        }
    }
    if signals.contains_key(&System::Glonass) {
        write_slots(&mut line, &header.glonass_channels)?;
        line("", "GLONASS COD/PHS/BIS")?;
    }
    line(&format!("{:6}", header.first.leap_seconds()), "LEAP SECONDS")?;
    line("", "END OF HEADER")
}

fn write_types(
    line: &mut impl FnMut(&str, &str) -> io::Result<()>,
    system: System,
    signals: &[Signal],
) -> io::Result<()> {
    let names: Vec<String> = signals
        .iter()
        .flat_map(|signal| {
            ['C', 'L', 'D', 'S']
                .map(|kind| format!(" {kind}{}{}", signal.band.digit, char::from(signal.attribute)))
        })
        .collect();
    for (index, part) in names.chunks(TYPES_A_LINE).enumerate() {
        let start = match index {
            0 => format!("{}  {:3}", system.letter(), names.len()),
            _ => " ".repeat(6),
        };
        line(&format!("{start}{}", part.concat()), "SYS / # / OBS TYPES")?;
    }
    Ok(())
}

fn write_slots(
    line: &mut impl FnMut(&str, &str) -> io::Result<()>,
    channels: &BTreeMap<u8, i8>,
) -> io::Result<()> {
    let slots: Vec<String> =
        channels.iter().map(|(slot, channel)| format!("R{slot:02} {channel:2} ")).collect();
    for (index, part) in slots.chunks(SLOTS_A_LINE).enumerate() {
        let start = if index == 0 { format!("{:3} ", slots.len()) } else { " ".repeat(4) };
        line(&format!("{start}{}", part.concat()), "GLONASS SLOT / FRQ #")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observations::ObservationSource;
    use kurs::observation::Lock;

    fn observation(satellite: &str, signal: Signal, phase_cycles: f64) -> Observation {
        Observation {
            satellite: satellite.parse().unwrap(),
            signal,
            pseudorange_m: Some(22_907_163.076),
            phase_cycles: Some(phase_cycles),
            doppler_hz: Some(-1234.567),
            cn0_dbhz: Some(43.25),
            lock: Lock::default(),
        }
    }

    /// A number with more digits than the columns hold leaves them blank, and moves no other.
    #[test]
    fn what_has_no_room_is_left_blank() {
        let l1 = Signal::new(System::Gps, 1, b'C');
        let far = Observation { doppler_hz: Some(f64::NAN), ..observation("G05", l1, -1e9) };
        let mut text = Vec::new();
        write_satellite(&mut text, far.satellite, &[l1], &[far]).unwrap();
        let line = String::from_utf8(text).unwrap();
        assert_eq!(line, format!("G05  22907163.076 7{}        43.250\n", " ".repeat(32)));
    }

    /// What is written is read back, with several satellites, signals, gaps and slips.
    #[test]
    fn written_files_are_read_back() {
        let l1 = Signal::new(System::Gps, 1, b'C');
        let l2 = Signal::new(System::Gps, 2, b'W');
        let r1 = Signal::new(System::Glonass, 1, b'C');
        let slipped = Observation {
            lock: Lock(Lock::SLIP),
            doppler_hz: None,
            ..observation("G12", l2, -16_928_881.668)
        };
        let first = GpsTime::from_week_tow(2305, 43_199.9).unwrap();
        let epochs = [
            AntennaEpoch {
                time: first,
                observations: vec![
                    observation("G05", l1, 120_377_466.123),
                    observation("G12", l1, 1.5),
                    slipped,
                    observation("R07", r1, 98_765.432),
                ],
                ..AntennaEpoch::default()
            },
            AntennaEpoch {
                time: first + 0.1,
                observations: vec![observation("G05", l2, 5.0)],
                ..AntennaEpoch::default()
            },
        ];
        let header = ObservationFileHeader {
            marker: "A0".to_owned(),
            position_m: Vector::new(2_847_000.0, 2_196_000.0, 5_249_000.0),
            interval_s: 0.1,
            first,
            signals: vec![l1, l2, r1],
            glonass_channels: BTreeMap::from([(7, 5), (8, 6)]),
        };
        let mut writer = ObservationWriter::new(Vec::new(), &header).unwrap();
        epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
        let bytes = writer.finish().unwrap();
        let input = std::io::Cursor::new(bytes);
        let mut source = ObservationSource::new(input, "written").unwrap();
        let mut read = AntennaEpoch::default();
        for epoch in &epochs {
            assert!(source.next_epoch(&mut read).unwrap());
            assert_eq!(read.time, epoch.time);
            assert_eq!(read.observations, epoch.observations);
        }
        assert!(!source.next_epoch(&mut read).unwrap());
        assert_eq!(source.damage(), []);
        assert_eq!(source.glonass_channels(), &header.glonass_channels);
    }
}
