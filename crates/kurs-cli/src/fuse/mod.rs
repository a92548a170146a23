//! `kurs fuse`: GNSS joined with inertial sensors – one antenna and accelerometers on a rotating
//! arm, or the attitudes of several antennas with a gyro and accelerometers – and the tilt that such a
//! sensor has by itself.

mod agreement;
mod antennas;
mod arm;
mod calibration;
mod events;
mod gravity_check;
mod imu;
mod tilt;

use std::path::PathBuf;

use kurs::frames::Attitude;

use crate::config_file;
use crate::failure::{ExitCode, UsageError};

/// GNSS joined with inertial sensors: a rotating arm, or antennas with a gyro.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML): with [arm], with [antennas] and [imu], or with [tilt] and [imu].
    config: PathBuf,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// Compares with the truth.csv of a simulation.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Writes what the simulated arm would have recorded, with a configuration to fuse it, and stops.
    #[arg(long, value_name = "DIR")]
    write_inputs: Option<PathBuf>,
    /// No closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
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
