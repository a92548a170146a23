//! The observation files of a simulation, in every format that the scenario asks for.

use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs::signal::{Satellite, Signal};
use kurs_formats::rinex::{CompactWriter, ObservationFileHeader, ObservationWriter};
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
use kurs_formats::ubx::UbxWriter;
use kurs_sim::scenario::ObservationFormat;

use crate::output::OutputFile;

/// The file of an antenna.
pub(super) fn file_name(antenna: &str, format: ObservationFormat) -> String {
    let ending = match format {
        ObservationFormat::Rinex => "rnx",
        ObservationFormat::RinexGzip => "rnx.gz",
        ObservationFormat::Crinex => "crx",
        ObservationFormat::CrinexGzip => "crx.gz",
        ObservationFormat::Ubx => "ubx",
        ObservationFormat::Rtcm3 => "rtcm3",
        ObservationFormat::Sbf => "sbf",
    };
    format!("{antenna}.{ending}")
}

/// Signals that a format has no number for.
pub(super) fn signals_left_out(format: ObservationFormat, signals: &[Signal]) -> Vec<Signal> {
    let has_number: fn(Signal) -> bool = match format {
        ObservationFormat::Ubx => kurs_formats::ubx::has_number,
        ObservationFormat::Rtcm3 => kurs_formats::rtcm::has_number,
        ObservationFormat::Sbf => kurs_formats::sbf::has_number,
        ObservationFormat::Rinex
        | ObservationFormat::RinexGzip
        | ObservationFormat::Crinex
        | ObservationFormat::CrinexGzip => |_| true,
    };
    signals.iter().copied().filter(|signal| !has_number(*signal)).collect()
}

/// Number of the station in an RTCM 3 log: every antenna has a log of its own.
const STATION: u16 = 1;

/// All files of one antenna.
pub(super) struct ObservationFiles {
    antenna: String,
    writers: Vec<Writer>,
}

enum Writer {
    Rinex(Box<ObservationWriter<Text>>),
    Ubx(UbxWriter<OutputFile>),
    Rtcm3(Rtcm3Writer<OutputFile>),
    Sbf(Box<SbfWriter<OutputFile>>),
}

impl ObservationFiles {
    /// Begins the files; logs have the ephemerides of `navigation` in them.
    pub(super) fn create(
        directory: &Path,
        antenna: &str,
        formats: &[ObservationFormat],
        header: &ObservationFileHeader,
        navigation: &NavigationData,
    ) -> anyhow::Result<Self> {
        let open = |format: &ObservationFormat| {
            let file = OutputFile::create(directory, &file_name(antenna, *format))?;
            let packed = |file| GzEncoder::new(file, Compression::default());
            let text = match format {
                ObservationFormat::Rinex => Text::Plain(file),
                ObservationFormat::RinexGzip => Text::Packed(Box::new(packed(file))),
                ObservationFormat::Crinex => {
                    Text::Compact(Box::new(CompactWriter::new(file, header.first)?))
                }
                ObservationFormat::CrinexGzip => {
                    Text::CompactPacked(Box::new(CompactWriter::new(packed(file), header.first)?))
                }
                ObservationFormat::Ubx => return Ok(Writer::Ubx(UbxWriter::new(file, navigation))),
                ObservationFormat::Rtcm3 => {
                    let place = header.position_m;
                    let writer = Rtcm3Writer::new(file, STATION, place, navigation);
                    return Ok(Writer::Rtcm3(writer));
                }
                ObservationFormat::Sbf => {
                    return Ok(Writer::Sbf(Box::new(SbfWriter::new(file, navigation))));
                }
            };
            Ok(Writer::Rinex(Box::new(ObservationWriter::new(text, header)?)))
        };
        let writers = formats.iter().map(open).collect::<anyhow::Result<_>>()?;
        Ok(Self { antenna: antenna.to_owned(), writers })
    }

    pub(super) fn write(&mut self, epoch: &AntennaEpoch) -> io::Result<()> {
        self.writers.iter_mut().try_for_each(|writer| match writer {
            Writer::Rinex(rinex) => rinex.write(epoch),
            Writer::Ubx(ubx) => ubx.write(epoch),
            Writer::Rtcm3(rtcm) => rtcm.write(epoch),
            Writer::Sbf(sbf) => sbf.write(&[epoch]),
        })
    }

    /// Which satellites' ephemerides a log has no room for, in words; one for each log.
    pub(super) fn left_out(&self) -> impl Iterator<Item = String> {
        self.writers.iter().filter_map(|writer| {
            let (format, satellites) = match writer {
                Writer::Rinex(_) => return None,
                Writer::Ubx(ubx) => (ObservationFormat::Ubx, ubx.left_out()),
                Writer::Rtcm3(rtcm) => (ObservationFormat::Rtcm3, rtcm.left_out()),
                Writer::Sbf(sbf) => (ObservationFormat::Sbf, sbf.left_out()),
            };
            let names: Vec<String> = satellites.iter().map(Satellite::to_string).collect();
            let file = file_name(&self.antenna, format);
            (!names.is_empty()).then(|| format!("{file}: no ephemerides of {}", names.join(" ")))
        })
    }

    pub(super) fn finish(self) -> anyhow::Result<()> {
        self.writers.into_iter().try_for_each(|writer| match writer {
            Writer::Rinex(rinex) => rinex.finish()?.finish(),
            Writer::Ubx(ubx) => ubx.finish().finish(),
            Writer::Rtcm3(rtcm) => rtcm.finish().finish(),
            Writer::Sbf(sbf) => sbf.finish().finish(),
        })
    }
}

/// Where the text of a RINEX file goes.
enum Text {
    Plain(OutputFile),
    Packed(Box<GzEncoder<OutputFile>>),
    Compact(Box<CompactWriter<OutputFile>>),
    CompactPacked(Box<CompactWriter<GzEncoder<OutputFile>>>),
}

impl Text {
    fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Plain(file) => file,
            Self::Packed(packed) => packed.finish()?,
            Self::Compact(compact) => compact.finish()?,
            Self::CompactPacked(compact) => compact.finish()?.finish()?,
        }
        .finish()
    }

    fn writer(&mut self) -> &mut dyn Write {
        match self {
            Self::Plain(file) => file,
            Self::Packed(packed) => packed.as_mut(),
            Self::Compact(compact) => compact.as_mut(),
            Self::CompactPacked(compact) => compact.as_mut(),
        }
    }
}

impl Write for Text {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer().flush()
    }
}
