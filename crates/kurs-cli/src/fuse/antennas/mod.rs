//! `kurs fuse` with `[antennas]`: attitudes that `kurs solve` found, or finds here with the
//! filter's prediction, carried on by an inertial sensor.

pub(crate) mod config;
mod rows;
mod solved_rows;
mod source;

use std::fmt;
use std::time::Instant;

use anyhow::{anyhow, bail};
use kurs::fusion::attitude::feed::AttitudeFeed;

use super::imu::Sensor;
use super::{Args, Inputs};
use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::interrupt::Watch;
use crate::output::OutputFolder;
use crate::pipe;
use crate::truth::Truth;
use config::Config;
use rows::Rows;
use source::Source;

/// A sample is the mean over as much as this before its time, s.
const COVERED_S: f64 = 1.0;

/// Runs the command.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read_with(&args.config, &args.set, "filter")?;
    if args.write_inputs.is_some() {
        let text =
            "--write-inputs is for [simulate]; a car with antennas and sensor: kurs simulate";
        return Err(UsageError(text.to_owned()).into());
    }
    let folder = &pipe::folder_of(&args.config);
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
    let mut feed = AttitudeFeed::new(settings, source.interval_s());
    fuse(&mut feed, &mut source, &mut sensor, &mut rows, &watch)?;
    let too_late = feed.too_late();
    if smooth {
        rows.write_smoothed(feed.into_session())?;
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
    let why = "no row has an attitude to start from: fixed or float with a standard deviation";
    Err(watch.unless_interrupted(anyhow!(why)))
}

/// Gives rows and samples to the session, whichever is behind.
fn fuse(
    feed: &mut AttitudeFeed,
    source: &mut Source,
    sensor: &mut Sensor,
    rows: &mut Rows,
    watch: &Watch,
) -> anyhow::Result<()> {
    let mut antennas = Span::default();
    let mut samples = Span::default();
    while let Some(time) = source.next_time()? {
        if watch.asks_to_end() {
            break;
        }
        feed.learn_interval(source.interval_s());
        antennas.take(feed.seconds(time));
        // The prediction wants the sample after the epoch too.
        while !feed.has_sample_after(time)
            && let Some((tow_s, sample)) = sensor.next()
        {
            samples.take(tow_s);
            feed.push_sample(tow_s, sample);
            if let Some(sampled) = time.nearest_with_tow(tow_s) {
                feed.pass(sampled.min(time));
            }
            while let Some(fused) = feed.next_row() {
                rows.write(&fused)?;
            }
        }
        // What comes too late is counted.
        let _ = source.feed(feed);
    }
    // With the sample that covers the last row.
    feed.take_rest();
    while let Some(fused) = feed.last_row() {
        rows.write(&fused)?;
    }
    if !watch.was_interrupted() {
        sensor.for_each(|(tow_s, _)| samples.take(tow_s));
    }
    let is_apart = |a: &Span, b: &Span| a.last_s + COVERED_S < b.first_s;
    if is_apart(&samples, &antennas) || is_apart(&antennas, &samples) {
        bail!(
            "the sensor's log ({samples}) and the antennas ({antennas}) have no time in common: `time_s` is the \
             GPS second of the week, [imu] time_offset_s is added to it"
        );
    }
    Ok(())
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
