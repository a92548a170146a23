//! `kurs fuse` with `[antennas]`: attitudes that `kurs solve` found, carried on by an inertial
//! sensor.

mod config;
mod rows;
mod solved_rows;

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;
use kurs::frames::Vector;
use kurs::fusion::attitude_session::{AttitudeSession, ImuSample};
use kurs::solution::EpochSolution;
use nalgebra::{Matrix3, Vector3};

use super::calibration::Calibration;
use super::{Args, gravity_check};
use crate::config_file;
use crate::failure::UsageError;
use crate::sensor_log::{Backwards, SensorReader, SensorRow};
use crate::truth::Truth;
use config::Config;
use rows::{Inputs, Rows};

/// Runs the command.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read(&args.config)?;
    if args.write_inputs.is_some() {
        let text =
            "--write-inputs is for [simulate]; a car with antennas and sensor: kurs simulate";
        return Err(UsageError(text.to_owned()).into());
    }
    let folder = args.config.parent().unwrap_or(Path::new(""));
    let calibration =
        config.imu.calibration.as_ref().map(|file| Calibration::read(&folder.join(file)));
    let calibration = calibration.transpose()?.unwrap_or_default();
    let settings = config.session(calibration.gyro_bias_radps.is_some())?;
    let smooth = settings.smooth;
    let (solved, mut damage) = solved_rows::read(&folder.join(&config.antennas.attitude))?;
    if settings.place.is_none() && solved.iter().all(|row| row.position.is_none()) {
        let text = "antennas.latitude_deg: the attitude file has no positions, so it must be given";
        return Err(UsageError(text.to_owned()).into());
    }
    let solved = solved_rows::fill_pauses(solved, config.output.interval_s);
    let mut sensor = Sensor::open(folder, &config, calibration)?;
    let truth = args.truth.as_ref().map(|path| Truth::read(path, &[])).transpose()?;
    let mut rows = Rows::create(&args.out, truth, smooth)?;

    let started = Instant::now();
    let mut session = AttitudeSession::new(settings);
    let too_late = fuse(&mut session, solved, &mut sensor, &mut rows)?;
    if smooth {
        rows.write_smoothed(session)?;
    }
    damage.extend_from_slice(sensor.reader.damage());
    let inputs = Inputs {
        configuration: format!("{config:?}"),
        damage: &damage,
        too_late,
        wall_s: started.elapsed().as_secs_f64(),
    };
    let finished = rows.finish(&args.out, &inputs)?;
    if !args.quiet {
        println!("{}", finished.text);
        damage.iter().take(1).for_each(|d| println!("{} damaged places, first: {d}", damage.len()));
        println!("written to {}", args.out.display());
    }
    if finished.has_solution {
        return Ok(ExitCode::SUCCESS);
    }
    bail!("no row has an attitude to start from: fixed or float with a standard deviation")
}

/// Feeds rows and samples to the session, whichever is behind; how many came too late.
fn fuse(
    session: &mut AttitudeSession,
    solved: Vec<EpochSolution>,
    sensor: &mut Sensor,
    rows: &mut Rows,
) -> anyhow::Result<usize> {
    let mut too_late = 0;
    for row in solved {
        let time_s = session.seconds(row.time);
        while let Some((at_s, sample)) = sensor.next_before(time_s) {
            too_late += usize::from(session.push_sample(at_s, sample).is_err());
            while let Some(fused) = session.next_row() {
                rows.write(&fused)?;
            }
        }
        too_late += usize::from(session.push_row(row).is_err());
    }
    // A little further: the sample that covers the last row.
    while let Some((at_s, sample)) = sensor.next_before(f64::INFINITY) {
        too_late += usize::from(session.push_sample(at_s, sample).is_err());
        while let Some(fused) = session.next_row() {
            rows.write(&fused)?;
        }
    }
    while let Some(fused) = session.last_row() {
        rows.write(&fused)?;
    }
    Ok(too_late)
}

/// The log of the sensor, calibrated and turned into the axes of the body.
struct Sensor {
    reader: SensorReader,
    /// Read ahead of their time, first of all to look at the unit.
    ahead: std::collections::VecDeque<SensorRow>,
    calibration: Calibration,
    body_from_imu: Matrix3<f64>,
    time_offset_s: f64,
}

impl Sensor {
    fn open(folder: &Path, config: &Config, calibration: Calibration) -> anyhow::Result<Self> {
        let path = folder.join(&config.imu.file);
        let mut reader = SensorReader::open(&path, Backwards::Kept)?;
        if !reader.has_gyro() {
            bail!("{}: no gyro columns (gx_radps, gy_radps, gz_radps)", path.display());
        }
        let ahead: std::collections::VecDeque<SensorRow> =
            reader.by_ref().take(gravity_check::SAMPLES).collect();
        if ahead.is_empty() {
            bail!("{}: no usable row", path.display());
        }
        if reader.has_accelerometer() {
            let norms = ahead.iter().filter_map(|row| Some(row.accelerometer?.norm()));
            gravity_check::refuse_other_units(norms.collect(), gravity_check::AT_REST_MPS2)?;
        }
        let (body_from_imu, time_offset_s) = (config.body_from_imu(), config.imu.time_offset_s);
        Ok(Self { reader, ahead, calibration, body_from_imu, time_offset_s })
    }

    /// The next sample, unless it is later than this.
    fn next_before(&mut self, time_s: f64) -> Option<(f64, ImuSample)> {
        if self.ahead.is_empty() {
            self.ahead.extend(self.reader.next());
        }
        let at_s = self.ahead.front()?.time_s + self.time_offset_s;
        if at_s > time_s {
            return None;
        }
        let row = self.ahead.pop_front()?;
        let in_body = |v: Vector3<f64>| Vector::from_xyz(self.body_from_imu * v);
        let rate_radps = in_body(self.calibration.rate(&row.gyro?));
        let force = row.accelerometer.map(|reading| in_body(self.calibration.force(&reading)));
        Some((at_s, ImuSample { rate_radps, specific_force_mps2: force }))
    }
}
