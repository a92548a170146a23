//! `kurs fuse`: GNSS joined with inertial sensors – one antenna and accelerometers on a rotating
//! arm, or the attitudes of several antennas with a gyro and accelerometers – and the tilt that
//! such a sensor has by itself.

mod agreement;
pub(crate) mod antennas;
mod arm;
mod calibration;
mod events;
pub(crate) mod gravity_check;
pub(crate) mod imu;
mod tilt;

use std::path::PathBuf;

use kurs::frames::Attitude;

use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::output;
use crate::pipe::InputFile;
use crate::report::Words;
use crate::summary::{Damage, Summary, damaged};
use crate::window::Window;

/// GNSS joined with inertial sensors: a rotating arm, or antennas with a gyro.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML): with [arm], with [antennas] and [imu], or with [tilt] and [imu].
    config: PathBuf,
    /// Sets a key of the table `filter` (with [tilt]: `tilt`), or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    window: Window,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/fuse")]
    out: PathBuf,
    /// Compares with the truth.csv of a simulation.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Writes what the simulated arm would have recorded, with a configuration to fuse it, and
    /// stops.
    #[arg(long, value_name = "DIR")]
    write_inputs: Option<PathBuf>,
    /// Writes report.html: plots of the whole run on one page that needs no network; and the track
    /// for maps, track.geojson and track.kml.
    #[arg(long)]
    report: bool,
    /// Prints summary.json in place of the closing summary.
    #[arg(long)]
    json: bool,
    /// No closing summary.
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// The closing words of a run whose outputs stand in their folder.
    fn conclude(&self, text: &str, damage: &[Damage]) -> anyhow::Result<()> {
        if self.json {
            let summary = std::fs::read_to_string(self.out.join("summary.json"))?;
            return output::print(format_args!("{summary}\n"));
        }
        if self.quiet {
            return Ok(());
        }
        let (damaged, out) = (damaged(damage), self.out.display());
        output::print(format_args!("{text}{damaged}\nwritten to {out}\n"))
    }
}

/// What went in, for the summary.
struct Inputs<'a> {
    files: &'a [PathBuf],
    /// The run ended before them.
    is_interrupted: bool,
    configuration: String,
    damage: &'a [Damage],
    too_late: usize,
    wall_s: f64,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &[
    "attitude.csv",
    "smoothed.csv",
    "health.csv",
    "tilt.csv",
    "summary.json",
    "report.html",
    "track.geojson",
    "track.kml",
];

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.window.check()?;
    let input = InputFile::open(&args.config)?;
    let args = &Args { config: input.path().to_owned(), ..args.clone() };
    let tables: toml::Table = config_file::read(&args.config)?;
    match ["arm", "antennas", "tilt"].map(|table| tables.contains_key(table)) {
        [true, false, false] => arm::run(args),
        [false, true, false] => antennas::run(args),
        [false, false, true] => tilt::run(args),
        _ => {
            let text = "one of [arm], [antennas] with [imu], [tilt] with [imu] must stand";
            Err(UsageError(format!("{}: {text}", args.config.display())).into())
        }
    }
}

/// Heading, pitch, roll in degrees.
fn attitude(angles_deg: [f64; 3]) -> Attitude {
    let [heading_rad, pitch_rad, roll_rad] = angles_deg.map(f64::to_radians);
    Attitude { heading_rad, pitch_rad, roll_rad }
}

/// What stands beside the plots of a report; the first of the files is the configuration.
fn words<'a>(title: &'a str, summary: &Summary, files: &[PathBuf]) -> Words<'a> {
    let input = |file: &PathBuf| ["input".to_owned(), file.display().to_string()];
    let configuration = files.first().and_then(|file| config_file::text(file).ok());
    Words {
        title,
        inputs: files.iter().map(input).collect(),
        headline: summary.headline(),
        moments: summary.means(),
        configuration: configuration.unwrap_or_default(),
        ephemerides: None,
    }
}
