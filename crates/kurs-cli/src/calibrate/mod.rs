//! `kurs calibrate`: accelerometers and gyros from logs of a resting sensor.

mod report;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use kurs::calibration::sensor_model::{Pose, SensorModel};
use kurs::calibration::static_intervals::{self, RestSettings};
use kurs::calibration::{allan, gyro_bias, multi_pose, six_position};
use kurs::fusion::gravity::normal_gravity_mps2;
use serde::Serialize;

use crate::output::OutputFile;
use crate::sensor_log::{Backwards, SensorLog};

/// Bias, scale and misalignment of accelerometers; bias and noise of gyros.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    method: Method,
}

#[derive(Debug, clap::Subcommand)]
enum Method {
    /// Each axis of a levelled box once up and once down: bias, scale, misalignment.
    SixPosition {
        #[command(flatten)]
        input: Input,
        /// How well the box was levelled, 1 sigma; shows in the result's uncertainty.
        #[arg(long, default_value_t = 0.0)]
        levelling_deg: f64,
    },
    /// Many resting poses, no levelling: every corrected reading has the length of gravity.
    MultiPose {
        #[command(flatten)]
        input: Input,
    },
    /// Mean rate of a long rest, and the Allan deviation of its noise.
    GyroBias {
        #[command(flatten)]
        input: Input,
    },
}

#[derive(Debug, clap::Args)]
struct Input {
    /// CSV logs: time_s and ax_mps2, ay_mps2, az_mps2 (or _g, _mg), gx_radps, … (or _degps).
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Local gravity, m/s²; by default from --latitude-deg and --height-m.
    #[arg(long)]
    gravity: Option<f64>,
    /// Geodetic latitude for normal gravity.
    #[arg(long, default_value_t = 45.0, allow_negative_numbers = true)]
    latitude_deg: f64,
    /// Height above the ellipsoid for normal gravity.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    height_m: f64,
    /// Folder for calibration.toml and the tables.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
}

/// `calibration.toml`, as `kurs fuse` reads it.
#[derive(Debug, Serialize)]
struct CalibrationFile {
    #[serde(skip_serializing_if = "Option::is_none")]
    accelerometer: Option<AccelerometerTable>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gyro: Option<GyroTable>,
}

#[derive(Debug, Serialize)]
struct AccelerometerTable {
    /// Rows of M in y = M a + b.
    matrix: [[f64; 3]; 3],
    bias_mps2: [f64; 3],
    matrix_sd: [[f64; 3]; 3],
    bias_sd_mps2: [f64; 3],
    gravity_mps2: f64,
}

#[derive(Debug, Serialize)]
struct GyroTable {
    bias_radps: [f64; 3],
    bias_sd_radps: [f64; 3],
    noise_radps_per_sqrt_hz: [f64; 3],
    bias_instability_radps: [f64; 3],
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.method {
        Method::SixPosition { input, levelling_deg } => {
            let poses = poses(&input.files)?;
            let levelling_rad = levelling_deg.to_radians();
            let model = six_position::calibrate(&poses, input.gravity_mps2(), levelling_rad)?;
            report_accelerometer(input, &poses, &model)
        }
        Method::MultiPose { input } => {
            let poses = poses(&input.files)?;
            let model = multi_pose::calibrate(&poses, input.gravity_mps2())?;
            report_accelerometer(input, &poses, &model)
        }
        Method::GyroBias { input } => calibrate_gyro(input),
    }
}

impl Input {
    fn gravity_mps2(&self) -> f64 {
        let normal = || normal_gravity_mps2(self.latitude_deg.to_radians(), self.height_m);
        self.gravity.unwrap_or_else(normal)
    }
}

/// The rests in all files.
fn poses(files: &[PathBuf]) -> anyhow::Result<Vec<Pose>> {
    let mut poses = Vec::new();
    for file in files {
        let log = read(file)?;
        if log.accelerometer.is_empty() {
            bail!("{}: no accelerometer columns (ax_mps2, ay_mps2, az_mps2)", file.display());
        }
        let settings = RestSettings::for_step(log.step_s());
        let rests = static_intervals::find(&log.accelerometer, &settings);
        let resting: usize = rests.iter().map(ExactSizeIterator::len).sum();
        eprintln!(
            "{}: {} rests of two seconds and more, {:.0} % of the log",
            file.display(),
            rests.len(),
            100.0 * resting as f64 / log.accelerometer.len() as f64
        );
        let samples = &log.accelerometer;
        poses.extend(rests.into_iter().map(|rest| static_intervals::pose(&samples[rest])));
    }
    Ok(poses)
}

fn read(file: &Path) -> anyhow::Result<SensorLog> {
    let log = SensorLog::read(file, Backwards::LeftOut)?;
    log.damage.iter().for_each(|damage| eprintln!("{damage}"));
    Ok(log)
}

fn report_accelerometer(
    input: &Input,
    poses: &[Pose],
    model: &SensorModel,
) -> anyhow::Result<ExitCode> {
    let gravity_mps2 = input.gravity_mps2();
    let residuals = multi_pose::residuals_mps2(poses, model, gravity_mps2);
    println!("{} resting poses, gravity {gravity_mps2:.5} m/s²", poses.len());
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        println!(
            "{name}: scale {:.6} ± {:.6}, bias {:+.5} ± {:.5} m/s²",
            model.matrix[(axis, axis)],
            model.matrix_sd[(axis, axis)],
            model.bias_mps2[axis],
            model.bias_sd_mps2[axis]
        );
    }
    let sum: f64 = residuals.iter().map(|residual| residual * residual).sum();
    println!("length residuals {:.5} m/s² rms", (sum / residuals.len() as f64).sqrt());
    if let Some(common) = model.suspected_gravity_error() {
        println!(
            "all three scale factors are off by {:+.2} %: is the local gravity right?",
            common * 100.0
        );
    }
    write_residuals(&input.out, poses, &residuals)?;
    report::accelerometer(&input.out, poses, model, &residuals)?;
    let table = AccelerometerTable {
        matrix: rows(&model.matrix),
        bias_mps2: model.bias_mps2.into(),
        matrix_sd: rows(&model.matrix_sd),
        bias_sd_mps2: model.bias_sd_mps2.into(),
        gravity_mps2,
    };
    write_toml(&input.out, &CalibrationFile { accelerometer: Some(table), gyro: None })?;
    Ok(ExitCode::SUCCESS)
}

fn calibrate_gyro(input: &Input) -> anyhow::Result<ExitCode> {
    let [file] = input.files.as_slice() else {
        bail!("gyro-bias takes one file with one long rest");
    };
    let log = read(file)?;
    if log.gyro.is_empty() {
        bail!("{}: no gyro columns (gx_radps, gy_radps, gz_radps)", file.display());
    }
    let rests = static_intervals::find(&log.gyro, &RestSettings::for_step(log.step_s()));
    let Some(rest) = rests.into_iter().max_by_key(ExactSizeIterator::len) else {
        bail!("{}: no rest of two seconds found: the sensor moves all the time", file.display());
    };
    let samples = &log.gyro[rest];
    let bias = gyro_bias::calibrate(samples)?;
    let mut curves = Vec::new();
    let (mut noise, mut instability) = ([f64::NAN; 3], [f64::NAN; 3]);
    for axis in 0..3 {
        let values: Vec<f64> = samples.iter().map(|sample| sample[axis]).collect();
        let curve = allan::deviation(&values, log.step_s());
        if let Some(summary) = allan::summary(&curve) {
            noise[axis] = summary.noise_density;
            instability[axis] = summary.bias_instability;
        }
        curves.push(curve);
    }
    println!("rest of {:.1} s", samples.len() as f64 * log.step_s());
    let per_hour = 1f64.to_degrees() * 3600.0;
    for (axis, name) in ["x", "y", "z"].iter().enumerate() {
        println!(
            "{name}: bias {:+.3} ± {:.3} °/h, noise {:.4} °/√h, bias instability {:.3} °/h",
            bias.bias_radps[axis] * per_hour,
            bias.sd_radps[axis] * per_hour,
            noise[axis].to_degrees() * 60.0,
            instability[axis] * per_hour
        );
    }
    let mut table = OutputFile::create(&input.out, "allan.csv")?;
    writeln!(table, "tau_s,x_radps,y_radps,z_radps,relative_sd")?;
    for (k, point) in curves[0].iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|axis| curves[axis][k].deviation);
        writeln!(table, "{},{x:e},{y:e},{z:e},{:.4}", point.tau_s, point.relative_sd)?;
    }
    table.finish()?;
    report::gyro(&input.out, &curves)?;
    let gyro = GyroTable {
        bias_radps: bias.bias_radps.into(),
        bias_sd_radps: bias.sd_radps.into(),
        noise_radps_per_sqrt_hz: noise,
        bias_instability_radps: instability,
    };
    write_toml(&input.out, &CalibrationFile { accelerometer: None, gyro: Some(gyro) })?;
    Ok(ExitCode::SUCCESS)
}

fn rows(matrix: &nalgebra::Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
}

fn write_residuals(out: &Path, poses: &[Pose], residuals: &[f64]) -> anyhow::Result<()> {
    let mut text = String::from("pose,x_mps2,y_mps2,z_mps2,samples,sample_sd_mps2,residual_mps2\n");
    for (k, (pose, residual)) in poses.iter().zip(residuals).enumerate() {
        let [x, y, z]: [f64; 3] = pose.mean_mps2.into();
        let (samples, sd) = (pose.samples, pose.sample_sd_mps2);
        writeln!(text, "{},{x:.6},{y:.6},{z:.6},{samples},{sd:.6},{residual:.6}", k + 1)?;
    }
    let mut file = OutputFile::create(out, "residuals.csv")?;
    file.write_all(text.as_bytes())?;
    file.finish()
}

fn write_toml(out: &Path, calibration: &CalibrationFile) -> anyhow::Result<()> {
    let text = toml::to_string(calibration).context("calibration.toml")?;
    let mut file = OutputFile::create(out, "calibration.toml")?;
    file.write_all(text.as_bytes())?;
    file.finish()
}
