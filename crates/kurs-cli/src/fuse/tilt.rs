//! `kurs fuse` with `[tilt]`: pitch and roll of a body from its inertial sensor alone, by a
//! complementary filter for each, and by exponential smoothing of what the accelerometers show.

use anyhow::bail;
use kurs::calibration::exponential_smoothing::ExponentialSmoothing;
use kurs::fusion::complementary::ComplementaryFilter;
use kurs::fusion::usual_step::{LONGEST_BRIDGED_S, UsualStep};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::Args;
use super::imu::{ImuConfig, Sensor};
use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFolder};
use crate::pipe;
use crate::table::{Table, TableFormat};

const COLUMNS: &[&str] = &[
    "time_s",
    "pitch_deg",
    "roll_deg",
    "accelerometer_pitch_deg",
    "accelerometer_roll_deg",
    "smoothed_pitch_deg",
    "smoothed_roll_deg",
];

/// `kurs fuse CONFIG.toml` with `[tilt]` and `[imu]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    tilt: TiltConfig,
    imu: ImuConfig,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct TiltConfig {
    /// a: the share of the gyro.
    gyro_share: f64,
    /// k_i, 1/s²; 0: no integral term.
    integral_gain: f64,
    /// α of the exponential smoothing.
    smoothing: f64,
}

impl Default for TiltConfig {
    fn default() -> Self {
        Self { gyro_share: 0.995, integral_gain: 0.0, smoothing: 0.1 }
    }
}

/// Pitch and roll, each with the same filter, and the force whose direction shows them.
struct Tilt {
    complementary: [ComplementaryFilter; 2],
    smoothing: [ExponentialSmoothing; 3],
    step: UsualStep,
    last_s: f64,
}

/// Runs the command.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read_with(&args.config, &args.set, "tilt")?;
    if args.write_inputs.is_some() || args.truth.is_some() || args.report {
        let text = "--write-inputs, --truth and --report do not go with [tilt]";
        return Err(UsageError(text.to_owned()).into());
    }
    if !args.window.is_everything() {
        let text = "--from, --to and --every do not go with [tilt]: its log has no date";
        return Err(UsageError(text.to_owned()).into());
    }
    let smoothing = config.tilt.check()?;
    config.imu.check()?;
    let folder = &pipe::folder_of(&args.config);
    let mut sensor = Sensor::open(folder, &config.imu)?;
    if !sensor.has_accelerometer() {
        bail!(
            "{}: no accelerometer columns (ax_mps2, ay_mps2, az_mps2)",
            config.imu.file.display()
        );
    }
    let inputs = [args.config.clone(), folder.join(&config.imu.file)];
    let outputs = OutputFolder::begin(&args.out, super::OUTPUTS, &inputs)?;
    let table = Table::create(outputs.path(), "tilt", TableFormat::Csv, COLUMNS)?;
    let rows = write_rows(&mut sensor, &config.tilt, smoothing, table)?;
    sensor.damage().iter().for_each(|damage| eprintln!("{damage}"));
    rows.tell_what_is_odd();
    if rows.rows == 0 {
        bail!("{}: no two samples that can be used", config.imu.file.display());
    }
    outputs.publish()?;
    if args.json {
        output::print_json(&rows)?;
    } else if !args.quiet {
        output::print(format_args!("{} rows written to {}\n", rows.rows, args.out.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What became of the samples.
#[derive(Default, Serialize)]
struct Rows {
    /// Written.
    rows: u64,
    /// Samples not later than the one before.
    left_out: u64,
    /// Times without samples, and their sum.
    pauses: u64,
    paused_s: f64,
}

impl Rows {
    fn tell_what_is_odd(&self) {
        let Self { left_out, pauses, paused_s, .. } = self;
        if *left_out > 0 {
            eprintln!(
                "{left_out} samples left out: their time is not after that of the one before"
            );
        }
        if *pauses > 0 {
            eprintln!(
                "pauses of the samples: {pauses}, {paused_s:.1} s in all; after each the accelerometers \
                 start the filters anew"
            );
        }
    }
}

/// Filters the samples of a log and writes a row for each; the first one starts the filters.
fn write_rows(
    sensor: &mut Sensor,
    config: &TiltConfig,
    smoothing: ExponentialSmoothing,
    mut table: Table,
) -> anyhow::Result<Rows> {
    let mut tilt: Option<Tilt> = None;
    let mut rows = Rows::default();
    for (time_s, sample) in sensor {
        let force = sample.specific_force_mps2.map(|force| force.xyz());
        let Some(now) = &mut tilt else {
            tilt = force.map(|force| Tilt::new(config, smoothing, &force, time_s));
            continue;
        };
        if time_s <= now.last_s {
            rows.left_out += 1;
            continue;
        }
        if now.is_after_pause(time_s) {
            let Some(force) = force else { continue };
            rows.pauses += 1;
            rows.paused_s += time_s - now.last_s;
            now.restart(smoothing, &force, time_s);
        }
        let rate = sample.rate_radps.map(|rate| rate.xyz());
        let [angles, smoothed] = now.update(time_s, rate, force);
        let shown = force.map_or([f64::NAN; 2], |force| shown_by_gravity(&force));
        table.real(Some(time_s), 4);
        for angle in [angles, shown, smoothed].as_flattened() {
            table.real(Some(angle.to_degrees()), 4);
        }
        table.end_row()?;
        rows.rows += 1;
    }
    table.finish()?;
    Ok(rows)
}

impl TiltConfig {
    fn check(&self) -> Result<ExponentialSmoothing, UsageError> {
        let Self { gyro_share, integral_gain, smoothing } = *self;
        if !(0.0..1.0).contains(&gyro_share) {
            let text = format!("tilt.gyro_share: {gyro_share} found, 0 to below 1 expected");
            return Err(UsageError(text));
        }
        if !(0.0..=1e3).contains(&integral_gain) {
            let text = format!("tilt.integral_gain: {integral_gain} found, 0 to 1000 expected");
            return Err(UsageError(text));
        }
        ExponentialSmoothing::new(smoothing).ok_or_else(|| {
            UsageError(format!("tilt.smoothing: {smoothing} found, above 0 to 1 expected"))
        })
    }
}

impl Tilt {
    fn new(
        config: &TiltConfig,
        smoothing: ExponentialSmoothing,
        force_mps2: &Vector3<f64>,
        time_s: f64,
    ) -> Self {
        let filter = |angle_rad| ComplementaryFilter {
            integral_gain: config.integral_gain,
            ..ComplementaryFilter::new(config.gyro_share, angle_rad)
        };
        Self {
            complementary: shown_by_gravity(force_mps2).map(filter),
            smoothing: [smoothing; 3],
            step: UsualStep::default(),
            last_s: time_s,
        }
    }

    /// Whether the samples paused before this time for longer than a rate may be taken to hold.
    fn is_after_pause(&mut self, time_s: f64) -> bool {
        let step_s = time_s - self.last_s;
        let has_lost = self.step.has_lost(step_s);
        self.step.follow(step_s);
        has_lost && step_s > LONGEST_BRIDGED_S
    }

    /// From the accelerometers alone; the bias of the gyro stays.
    fn restart(&mut self, smoothing: ExponentialSmoothing, force_mps2: &Vector3<f64>, time_s: f64) {
        for (filter, angle_rad) in self.complementary.iter_mut().zip(shown_by_gravity(force_mps2)) {
            filter.angle_rad = angle_rad;
        }
        (self.smoothing, self.last_s) = ([smoothing; 3], time_s);
    }

    /// Filtered and smoothed pitch and roll; what is not known of a sample is left out.
    fn update(
        &mut self,
        time_s: f64,
        rate_radps: Option<Vector3<f64>>,
        force_mps2: Option<Vector3<f64>>,
    ) -> [[f64; 2]; 2] {
        let step_s = time_s - self.last_s;
        self.last_s = time_s;
        let [pitch, roll] = [0, 1].map(|k| self.complementary[k].angle_rad);
        let ((sin_roll, cos_roll), tan_pitch) = (roll.sin_cos(), pitch.tan());
        // ṗ = ω_y cos r − ω_z sin r,  ṙ = ω_x + tan p (ω_y sin r + ω_z cos r)
        let rates = rate_radps.map_or([f64::NAN; 2], |w| {
            let across = w.y * sin_roll + w.z * cos_roll;
            [w.y * cos_roll - w.z * sin_roll, w.x + tan_pitch * across]
        });
        let force = force_mps2.unwrap_or(Vector3::repeat(f64::NAN));
        let shown = shown_by_gravity(&force);
        let filtered = [0, 1].map(|k| self.complementary[k].update(rates[k], shown[k], step_s));
        // Of the force, not of the angles: the mean of 179° and −179° is not 0°.
        let smooth = |k: usize| self.smoothing[k].update(force[k]).unwrap_or(f64::NAN);
        let smoothed = Vector3::from([0, 1, 2].map(smooth));
        [filtered, shown_by_gravity(&smoothed)]
    }
}

/// Pitch and roll at which a resting sensor would feel this: −g in body axes.
fn shown_by_gravity(force_mps2: &Vector3<f64>) -> [f64; 2] {
    let [x, y, z]: [f64; 3] = (*force_mps2).into();
    [x.atan2(y.hypot(z)), (-y).atan2(-z)]
}
