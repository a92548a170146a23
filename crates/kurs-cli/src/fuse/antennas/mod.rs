//! `kurs fuse` with `[antennas]`: attitudes that `kurs solve` found, or finds here with the filter's
//! prediction, carried on by an inertial sensor.

mod config;
mod rows;
mod solved_rows;
mod source;

use std::fmt;
use std::path::Path;
use std::time::Instant;

use anyhow::bail;
use kurs::fusion::attitude::session::AttitudeSession;

use super::Args;
use super::imu::Sensor;
use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::interrupt::Watch;
use crate::output::OutputFolder;
use crate::truth::Truth;
use config::Config;
use rows::{Inputs, Rows};
use source::Source;

/// Runs the command.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read_with(&args.config, &args.set, "filter")?;
    if args.write_inputs.is_some() {
        let text =
            "--write-inputs is for [simulate]; a car with antennas and sensor: kurs simulate";
        return Err(UsageError(text.to_owned()).into());
    }
    let folder = args.config.parent().unwrap_or(Path::new(""));
    config.check()?;
    let inputs =
        [args.config.clone(), folder.join(config.antennas.file()?), folder.join(&config.imu.file)];
    let outputs = OutputFolder::begin(&args.out, super::OUTPUTS, &inputs)?;
    let mut sensor = Sensor::open(folder, &config.imu)?;
    let settings = config.session(sensor.has_gyro_bias());
    let smooth = settings.smooth;
    let mut source =
        Source::open(folder, &config.antennas, config.output.interval_s, args.window, args.quiet)?;
    let truth = args.truth.as_ref().map(|path| Truth::read(path, &[])).transpose()?;
    let mut rows =
        Rows::create(outputs.path(), truth, smooth, source.antenna_names(), args.report)?;

    let started = Instant::now();
    let watch = Watch::begin();
    let mut session = AttitudeSession::new(settings);
    let too_late = fuse(&mut session, &mut source, &mut sensor, &mut rows, &watch)?;
    if smooth {
        rows.write_smoothed(session)?;
    }
    let (of_antennas, mut damage) = source.finish();
    damage.extend_from_slice(sensor.damage());
    let from = Inputs {
        files: &inputs,
        is_interrupted: watch.was_interrupted(),
        configuration: format!("{config:?}{of_antennas}"),
        damage: &damage,
        too_late,
        wall_s: started.elapsed().as_secs_f64(),
    };
    let finished = rows.finish(outputs.path(), &from)?;
    outputs.publish()?;
    args.conclude(&finished.text, &damage)?;
    if finished.has_solution {
        return Ok(watch.status(ExitCode::SUCCESS));
    }
    bail!("no row has an attitude to start from: fixed or float with a standard deviation")
}

/// Feeds rows and samples to the session, whichever is behind; how many came too late.
fn fuse(
    session: &mut AttitudeSession,
    source: &mut Source,
    sensor: &mut Sensor,
    rows: &mut Rows,
    watch: &Watch,
) -> anyhow::Result<usize> {
    let mut too_late = 0;
    let mut antennas = Span::default();
    let mut samples = Span::default();
    while let Some(time) = source.next_time()? {
        if watch.asks_to_end() {
            break;
        }
        let time_s = session.seconds(time);
        antennas.take(time_s);
        while let Some((at_s, sample)) = sensor.next_before(time_s) {
            samples.take(at_s);
            too_late += usize::from(session.push_sample(at_s, sample).is_err());
            while let Some(fused) = session.next_row() {
                rows.write(&fused)?;
            }
        }
        too_late += usize::from(source.feed(session, sensor.peek()).is_err());
    }
    // A little further: the sample that covers the last row; of an interrupted run not all that follow.
    let end_s = if watch.was_interrupted() { antennas.last_s } else { f64::INFINITY };
    while let Some((at_s, sample)) = sensor.next_before(end_s) {
        samples.take(at_s);
        too_late += usize::from(session.push_sample(at_s, sample).is_err());
        while let Some(fused) = session.next_row() {
            rows.write(&fused)?;
        }
    }
    while let Some(fused) = session.last_row() {
        rows.write(&fused)?;
    }
    if samples.last_s < antennas.first_s || antennas.last_s < samples.first_s {
        bail!(
            "the sensor's log ({samples}) and the antennas ({antennas}) have no time in common: `time_s` is the \
             GPS second of the week, [imu] time_offset_s is added to it"
        );
    }
    Ok(too_late)
}

/// First and last of some times, s.
struct Span {
    first_s: f64,
    last_s: f64,
}

impl Default for Span {
    fn default() -> Self {
        Self { first_s: f64::INFINITY, last_s: f64::NEG_INFINITY }
    }
}

impl Span {
    fn take(&mut self, time_s: f64) {
        (self.first_s, self.last_s) = (self.first_s.min(time_s), self.last_s.max(time_s));
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} to {:.1} s", self.first_s, self.last_s)
    }
}
