//! `kurs fuse` with `[tilt]`: pitch and roll of a body from its inertial sensor alone, by a
//! complementary filter for each, and by exponential smoothing of what the accelerometers show.

use anyhow::bail;
use kurs::calibration::exponential_smoothing::ExponentialSmoothing;
use kurs::fusion::complementary::ComplementaryFilter;
use kurs::fusion::usual_step::UsualStep;
use nalgebra::Vector3;
use serde::Deserialize;

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

/// A step of more than this many usual ones is a pause: nobody knows how the body turned in it.
const PAUSE_STEPS: f64 = 5.0;
/// Share of a step in the usual one.
const STEP_SHARE: f64 = 0.01;

/// Pitch and roll, each with the same two filters.
struct Tilt {
    complementary: [ComplementaryFilter; 2],
    smoothing: [ExponentialSmoothing; 2],
    last_s: f64,
    usual_step: UsualStep,
    pauses: u64,
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
    let Rows { written: rows, left_out, pauses } =
        write_rows(&mut sensor, &config.tilt, smoothing, table)?;
    sensor.damage().iter().for_each(|damage| eprintln!("{damage}"));
    if left_out > 0 {
        eprintln!("{left_out} samples left out: their time goes back");
    }
    if pauses > 0 {
        eprintln!("{pauses} pauses of the log: behind each the accelerometers begin the tilt anew");
    }
    if rows == 0 {
        bail!("{}: no two samples that can be used", config.imu.file.display());
    }
    outputs.publish()?;
    if args.json {
        let counts = serde_json::json!({ "rows": rows, "left_out": left_out, "pauses": pauses });
        output::print_json(&counts)?;
    } else if !args.quiet {
        output::print(format_args!("{rows} rows written to {}\n", args.out.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Numbers of samples.
#[derive(Default)]
struct Rows {
    written: u64,
    /// Not later than the one before.
    left_out: u64,
    /// Times without samples.
    pauses: u64,
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
        let shown = sample.specific_force_mps2.map(|force| shown_by_gravity(&force.xyz()));
        let Some(now) = &mut tilt else {
            tilt = shown.map(|angles| Tilt::new(config, smoothing, angles, time_s));
            continue;
        };
        if time_s <= now.last_s {
            rows.left_out += 1;
            continue;
        }
        let rate = sample.rate_radps.map(|rate| rate.xyz());
        let [angles, smoothed] = now.update(time_s, rate, shown);
        let shown = shown.map_or([f64::NAN; 2], |angles| angles);
        table.real(Some(time_s), 4);
        for angle in [angles, shown, smoothed].as_flattened() {
            table.real(Some(angle.to_degrees()), 4);
        }
        table.end_row()?;
        rows.written += 1;
    }
    table.finish()?;
    rows.pauses = tilt.map_or(0, |tilt| tilt.pauses);
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
        angles_rad: [f64; 2],
        time_s: f64,
    ) -> Self {
        let filter = |angle_rad| ComplementaryFilter {
            integral_gain: config.integral_gain,
            ..ComplementaryFilter::new(config.gyro_share, angle_rad)
        };
        Self {
            complementary: angles_rad.map(filter),
            smoothing: [smoothing; 2],
            last_s: time_s,
            usual_step: UsualStep::new(PAUSE_STEPS, STEP_SHARE),
            pauses: 0,
        }
    }

    /// From what the accelerometers show now.
    fn begin_anew(&mut self, shown_rad: Option<[f64; 2]>) {
        for (k, angle_rad) in shown_rad.into_iter().flatten().enumerate() {
            self.complementary[k].angle_rad = angle_rad;
            self.smoothing[k].restart();
        }
    }

    /// Filtered and smoothed pitch and roll; what is not known of a sample is left out.
    fn update(
        &mut self,
        time_s: f64,
        rate_radps: Option<Vector3<f64>>,
        shown_rad: Option<[f64; 2]>,
    ) -> [[f64; 2]; 2] {
        let step_s = time_s - self.last_s;
        self.last_s = time_s;
        let is_pause = self.usual_step.is_pause(step_s);
        self.usual_step.follow(step_s);
        if is_pause {
            self.pauses += 1;
            self.begin_anew(shown_rad);
        }
        let rate_radps = rate_radps.filter(|_| !is_pause);
        let [pitch, roll] = [0, 1].map(|k| self.complementary[k].angle_rad);
        let ((sin_roll, cos_roll), tan_pitch) = (roll.sin_cos(), pitch.tan());
        // ṗ = ω_y cos r − ω_z sin r,  ṙ = ω_x + tan p (ω_y sin r + ω_z cos r)
        let rates = rate_radps.map_or([f64::NAN; 2], |w| {
            let across = w.y * sin_roll + w.z * cos_roll;
            [w.y * cos_roll - w.z * sin_roll, w.x + tan_pitch * across]
        });
        let shown = shown_rad.unwrap_or([f64::NAN; 2]);
        let filtered = [0, 1].map(|k| self.complementary[k].update(rates[k], shown[k], step_s));
        let smoothed = [0, 1].map(|k| self.smoothing[k].update_angle(shown[k]).unwrap_or(f64::NAN));
        [filtered, smoothed]
    }
}

/// Pitch and roll at which a resting sensor would feel this: −g in body axes.
fn shown_by_gravity(force_mps2: &Vector3<f64>) -> [f64; 2] {
    let [x, y, z]: [f64; 3] = (*force_mps2).into();
    [x.atan2(y.hypot(z)), (-y).atan2(-z)]
}
