//! `kurs calibrate`: accelerometers and gyros from logs of a resting sensor.

mod report;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use kurs::calibration::allan::{self, AllanPoint};
use kurs::calibration::gyro_bias::{self, GyroBias};
use kurs::calibration::sensor_model::{Pose, SensorModel};
use kurs::calibration::six_position::Levelling;
use kurs::calibration::static_intervals::{self, RestSettings};
use kurs::calibration::{multi_pose, six_position};
use kurs::fusion::earth::gravity::normal_gravity_mps2;
use nalgebra::Vector3;
use serde::Serialize;

use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFile, OutputFolder};
use crate::pipe::InputFile;
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
        /// How well the box was levelled, 1 sigma; shows in the result's uncertainty. What the data show
        /// is taken where it is worse.
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
    /// Local gravity, m/s²; by default normal gravity at --latitude-deg and --height-m.
    #[arg(long)]
    gravity: Option<f64>,
    /// 1 sigma of the local gravity, m/s²; shows in the uncertainty of the scale. By default 0 with
    /// --gravity, 0.0005 with --latitude-deg, 0.018 with neither.
    #[arg(long)]
    gravity_sd: Option<f64>,
    /// Geodetic latitude for normal gravity.
    #[arg(long)]
    latitude_deg: Option<f64>,
    /// Height above the ellipsoid for normal gravity.
    #[arg(long, default_value_t = 0.0)]
    height_m: f64,
    /// Folder for calibration.toml, the tables and report.html.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/calibrate")]
    out: PathBuf,
    /// Writes report.html; this command always does.
    #[arg(long)]
    report: bool,
    /// Prints the calibration as JSON in place of the closing lines.
    #[arg(long)]
    json: bool,
    /// No closing lines.
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &["calibration.toml", "residuals.csv", "allan.csv", "report.html"];

const AXES: [&str; 3] = ["x", "y", "z"];

/// The local gravity and how sure it is.
#[derive(Debug, Clone, Copy)]
struct Gravity {
    mps2: f64,
    sd_mps2: f64,
}

/// Gravity from the highest mountains of the tropics to the poles, rounded outwards.
const GRAVITY_ON_EARTH_MPS2: core::ops::RangeInclusive<f64> = 9.75..=9.85;
/// Standard deviation of gravity from normal gravity: 50 mGal.
const GRAVITY_ANOMALY_SD_MPS2: f64 = 5e-4;
/// Standard deviation of gravity anywhere on the Earth from that at 45°.
const GRAVITY_ANYWHERE_SD_MPS2: f64 = 0.018;

/// Residuals of a pose up to this are noise, or what is not linear in a good sensor …
const MAX_MISFIT_MPS2: f64 = 0.02;
/// … or this many standard deviations of its mean.
const MAX_MISFIT_SIGMAS: f64 = 5.0;
/// Rate that no gyro reads at rest: cheap ones may read 20°/s, 0.35 rad/s (MPU-6000 specification
/// 3.4, 6.1).
const MAX_BIAS_RADPS: f64 = 1.0;

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
    gravity_sd_mps2: f64,
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
            let gravity = input.gravity()?;
            let levelling_rad = levelling_deg.to_radians();
            if !(0.0..=0.5).contains(&levelling_rad) {
                let text = format!("--levelling-deg: {levelling_deg} found, 0 to 28 expected");
                return Err(UsageError(text).into());
            }
            let folder = input.begin()?;
            let poses = poses(&input.files)?;
            let model = six_position::calibrate(&poses, gravity.mps2, levelling_rad)?;
            let levelling = six_position::levelling(&poses, gravity.mps2, levelling_rad)?;
            report_accelerometer(input, folder, &gravity, &poses, &model, levelling)
        }
        Method::MultiPose { input } => {
            let gravity = input.gravity()?;
            let folder = input.begin()?;
            let poses = poses(&input.files)?;
            let model = multi_pose::calibrate(&poses, gravity.mps2)?;
            report_accelerometer(input, folder, &gravity, &poses, &model, None)
        }
        Method::GyroBias { input } => calibrate_gyro(input),
    }
}

impl Input {
    /// Removes what an older run left: nothing of it stays if this one is refused.
    fn begin(&self) -> anyhow::Result<OutputFolder> {
        OutputFolder::begin(&self.out, OUTPUTS, &self.files)
    }

    /// Writes the calibration, gives all files their places and says how it went.
    fn finish(
        &self,
        folder: OutputFolder,
        calibration: &CalibrationFile,
        told: &str,
    ) -> anyhow::Result<ExitCode> {
        write_toml(folder.path(), calibration)?;
        folder.publish()?;
        if self.json {
            output::print_json(calibration)?;
        } else if !self.quiet {
            output::print(format_args!("{told}written to {}\n", self.out.display()))?;
        }
        Ok(ExitCode::SUCCESS)
    }

    /// The local gravity; what is odd about it is told on the way.
    fn gravity(&self) -> Result<Gravity, UsageError> {
        let range = |key: &str, value: f64, least: f64, most: f64| {
            let text = format!("{key}: {value} found, {least} to {most} expected");
            (least..=most).contains(&value).then_some(()).ok_or(UsageError(text))
        };
        let latitude_deg = self.latitude_deg.unwrap_or(45.0);
        range("--latitude-deg", latitude_deg, -90.0, 90.0)?;
        range("--height-m", self.height_m, -12_000.0, 20_000.0)?;
        range("--gravity", self.gravity.unwrap_or(9.8), 0.1, 100.0)?;
        let normal_mps2 = normal_gravity_mps2(latitude_deg.to_radians(), self.height_m);
        let usual_sd = match (self.gravity, self.latitude_deg) {
            (Some(_), _) => 0.0,
            (None, Some(_)) => GRAVITY_ANOMALY_SD_MPS2,
            (None, None) => GRAVITY_ANYWHERE_SD_MPS2,
        };
        let gravity = Gravity {
            mps2: self.gravity.unwrap_or(normal_mps2),
            sd_mps2: self.gravity_sd.unwrap_or(usual_sd),
        };
        range("--gravity-sd", gravity.sd_mps2, 0.0, 1.0)?;
        match (self.gravity, self.latitude_deg) {
            (Some(stated), _) if !GRAVITY_ON_EARTH_MPS2.contains(&stated) => eprintln!(
                "a local gravity of {stated} m/s² is found nowhere on the Earth ({} to {}): is \
                 --gravity right?",
                GRAVITY_ON_EARTH_MPS2.start(),
                GRAVITY_ON_EARTH_MPS2.end()
            ),
            (Some(stated), Some(_)) if (stated - normal_mps2).abs() > 0.005 => eprintln!(
                "wrong local gravity? --gravity {stated} m/s², but {normal_mps2:.4} m/s² is normal at \
                 that latitude and height"
            ),
            (None, None) => eprintln!(
                "the local gravity is not stated: {normal_mps2:.3} ± {usual_sd} m/s² is taken, which \
                 leaves the scale uncertain; state --gravity, or --latitude-deg and --height-m"
            ),
            _ => {}
        }
        Ok(gravity)
    }
}

/// The rests in all files.
fn poses(files: &[PathBuf]) -> anyhow::Result<Vec<Pose>> {
    let mut poses = Vec::new();
    let mut logs: Vec<(&PathBuf, SensorLog)> = Vec::new();
    for file in files {
        let log = read(file)?;
        // Counted twice, its poses would make the result look better than it is.
        if let Some((other, _)) = logs.iter().find(|(_, other)| other.has_samples_of(&log)) {
            bail!("{} and {} hold the same samples", other.display(), file.display());
        }
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
        if rests.is_empty() {
            bail!("{}: {}", file.display(), without_rest(&log));
        }
        let samples = &log.accelerometer;
        for rest in rests {
            if let Some(axis) = static_intervals::stuck_axis(&samples[rest.clone()]) {
                eprintln!(
                    "{}: axis {} reads exactly {:.4} m/s² all through pose {}: saturated, or its \
                     resolution is too coarse",
                    file.display(),
                    AXES[axis],
                    samples[rest.start][axis],
                    poses.len() + 1
                );
            }
            poses.push(static_intervals::pose(&samples[rest]));
        }
        logs.push((file, log));
    }
    Ok(poses)
}

fn read(file: &Path) -> anyhow::Result<SensorLog> {
    let log = SensorLog::read(InputFile::open(file)?.path(), Backwards::LeftOut)?;
    log.damage.iter().for_each(|damage| eprintln!("{damage}"));
    if let Some((gaps, longest_s)) = log.gaps() {
        eprintln!(
            "{}: samples are missing in {gaps} places, {longest_s:.2} s in the longest",
            file.display()
        );
    }
    Ok(log)
}

/// Why no rest was found, in words.
fn without_rest(log: &SensorLog) -> String {
    let length_s = log.length_s();
    let why =
        if length_s < 2.0 { "is `time_s` in seconds?" } else { "the sensor moves all the time" };
    format!("no rest of two seconds found in a log of {length_s:.3} s: {why}")
}

fn report_accelerometer(
    input: &Input,
    folder: OutputFolder,
    gravity: &Gravity,
    poses: &[Pose],
    model: &SensorModel,
    levelling: Option<Levelling>,
) -> anyhow::Result<ExitCode> {
    let Gravity { mps2: gravity_mps2, sd_mps2: gravity_sd_mps2 } = *gravity;
    let model = &model.with_gravity_sd(gravity_mps2, gravity_sd_mps2);
    let residuals = multi_pose::residuals_mps2(poses, model, gravity_mps2);
    let numbers = model.matrix.iter().chain(&model.matrix_sd);
    if !numbers.chain(&model.bias_mps2).chain(&model.bias_sd_mps2).all(|value| value.is_finite()) {
        bail!("the poses do not determine the calibration: a value of it is no number");
    }
    let told = accelerometer_text(gravity, poses, model, &residuals, levelling.as_ref());
    write_residuals(folder.path(), poses, &residuals)?;
    report::accelerometer(folder.path(), poses, model, &residuals)?;
    let table = AccelerometerTable {
        matrix: rows(&model.matrix),
        bias_mps2: model.bias_mps2.into(),
        matrix_sd: rows(&model.matrix_sd),
        bias_sd_mps2: model.bias_sd_mps2.into(),
        gravity_mps2,
        gravity_sd_mps2,
    };
    let calibration = CalibrationFile { accelerometer: Some(table), gyro: None };
    input.finish(folder, &calibration, &told)
}

/// The values of each axis, and what makes them doubtful.
fn accelerometer_text(
    gravity: &Gravity,
    poses: &[Pose],
    model: &SensorModel,
    residuals: &[f64],
    levelling: Option<&Levelling>,
) -> String {
    let Gravity { mps2: gravity_mps2, sd_mps2: gravity_sd_mps2 } = *gravity;
    let mut told = format!(
        "{} resting poses, gravity {gravity_mps2:.5} ± {gravity_sd_mps2} m/s²\n",
        poses.len()
    );
    for (axis, name) in AXES.iter().enumerate() {
        let _ = writeln!(
            told,
            "{name}: scale {:.6} ± {:.6}, bias {:+.5} ± {:.5} m/s²",
            model.matrix[(axis, axis)],
            model.matrix_sd[(axis, axis)],
            model.bias_mps2[axis],
            model.bias_sd_mps2[axis]
        );
    }
    let sum: f64 = residuals.iter().map(|residual| residual * residual).sum();
    let rms_mps2 = (sum / residuals.len() as f64).sqrt();
    let _ = writeln!(told, "length residuals {rms_mps2:.5} m/s² rms");
    if let Some(Levelling { sd_rad, worst, poses }) = levelling {
        let numbers: Vec<String> = poses.iter().map(usize::to_string).collect();
        let _ = writeln!(
            told,
            "by the data the poses are levelled to {:.2}° (1 sigma), which the sigmas take in; {worst} (poses {}) \
             agree least with the others: tilted, moved, or an axis saturated?",
            sd_rad.to_degrees(),
            numbers.join(", ")
        );
    } else if let Some(pose) = worst_misfit(poses, residuals) {
        let _ = writeln!(
            told,
            "the poses do not fit one linear sensor; pose {} fits worst ({:+.3} m/s²): did it move, or is an \
             axis saturated? The stated sigmas do not hold",
            pose + 1,
            residuals[pose]
        );
    }
    if let Some(common) = model.suspected_gravity_error() {
        let _ = writeln!(
            told,
            "all three scale factors are off by {:+.2} %: is the local gravity right? {:.3} m/s² would \
             explain it",
            common * 100.0,
            gravity_mps2 * (1.0 + common)
        );
    }
    told
}

/// The pose with the largest residual, if that is far beyond the noise of the means.
fn worst_misfit(poses: &[Pose], residuals: &[f64]) -> Option<usize> {
    let noise_mps2 = |pose: &Pose| pose.sample_sd_mps2 / (pose.samples as f64).sqrt();
    let allowed_mps2 =
        |pose: usize| MAX_MISFIT_MPS2.max(MAX_MISFIT_SIGMAS * noise_mps2(&poses[pose]));
    let worst =
        (0..poses.len()).max_by(|a, b| residuals[*a].abs().total_cmp(&residuals[*b].abs()))?;
    (residuals[worst].abs() > allowed_mps2(worst)).then_some(worst)
}

fn calibrate_gyro(input: &Input) -> anyhow::Result<ExitCode> {
    let [file] = input.files.as_slice() else {
        bail!("gyro-bias takes one file with one long rest");
    };
    let folder = input.begin()?;
    let log = read(file)?;
    if log.gyro.is_empty() {
        bail!("{}: no gyro columns (gx_radps, gy_radps, gz_radps)", file.display());
    }
    let samples = longest_rest(file, &log)?;
    let bias = checked_bias(file, samples)?;
    let rest_s = samples.len() as f64 * log.step_s();
    let noise = GyroNoise::of(file, samples, log.step_s())?;
    let told = gyro_text(&bias, &noise, rest_s);
    write_allan(folder.path(), &noise.curves)?;
    report::gyro(folder.path(), &noise.curves)?;
    let gyro = GyroTable {
        bias_radps: bias.bias_radps.into(),
        bias_sd_radps: noise.mean_sd,
        noise_radps_per_sqrt_hz: noise.density,
        bias_instability_radps: noise.instability,
    };
    input.finish(folder, &CalibrationFile { accelerometer: None, gyro: Some(gyro) }, &told)
}

/// The gyro samples of the longest rest, rad/s.
fn longest_rest<'a>(file: &Path, log: &'a SensorLog) -> anyhow::Result<&'a [Vector3<f64>]> {
    let rests = static_intervals::find(&log.gyro, &RestSettings::for_step(log.step_s()));
    let Some(rest) = rests.into_iter().max_by_key(ExactSizeIterator::len) else {
        bail!("{}: {}", file.display(), without_rest(log));
    };
    let samples = &log.gyro[rest];
    if let Some(axis) = static_intervals::stuck_axis(samples) {
        eprintln!(
            "{}: axis {} reads exactly {:.4} rad/s all through the rest: stuck, or its resolution is too \
             coarse",
            file.display(),
            AXES[axis],
            samples[0][axis]
        );
    }
    Ok(samples)
}

/// The bias at rest; one that no gyro has is refused.
fn checked_bias(file: &Path, samples: &[Vector3<f64>]) -> anyhow::Result<GyroBias> {
    let bias = gyro_bias::calibrate(samples)?;
    let most_radps = bias.bias_radps.amax();
    if most_radps > MAX_BIAS_RADPS {
        bail!(
            "{}: {most_radps:.3} rad/s at rest, sensors have less than {MAX_BIAS_RADPS} rad/s: raw counts or \
             another unit in gx_radps, gy_radps, gz_radps?",
            file.display()
        );
    }
    Ok(bias)
}

/// The noise of each axis by its Allan deviation.
struct GyroNoise {
    curves: Vec<Vec<AllanPoint>>,
    /// Noise density, rad/s/√Hz.
    density: [f64; 3],
    /// Bias instability, rad/s.
    instability: [f64; 3],
    /// Standard deviation of the mean over the rest, rad/s.
    mean_sd: [f64; 3],
}

impl GyroNoise {
    fn of(file: &Path, samples: &[Vector3<f64>], step_s: f64) -> anyhow::Result<Self> {
        let mut noise = Self {
            curves: Vec::new(),
            density: [0.0; 3],
            instability: [0.0; 3],
            mean_sd: [0.0; 3],
        };
        let length_s = samples.len() as f64 * step_s;
        for axis in 0..3 {
            let values: Vec<f64> = samples.iter().map(|sample| sample[axis]).collect();
            let curve = allan::deviation(&values, step_s);
            let Some(summary) = allan::summary(&curve, length_s) else {
                bail!(
                    "{}: the longest rest has {} samples, too few for the Allan deviation of the noise",
                    file.display(),
                    samples.len()
                );
            };
            noise.density[axis] = summary.noise_density;
            noise.instability[axis] = summary.bias_instability;
            noise.mean_sd[axis] = summary.mean_sd;
            noise.curves.push(curve);
        }
        if noise.density == [0.0; 3] {
            eprintln!(
                "{}: no axis changes all through the rest: its noise and the uncertainty of the bias are not 0 but \
                 hidden by a resolution that is too coarse, or the sensor is stuck",
                file.display()
            );
        }
        Ok(noise)
    }
}

fn gyro_text(bias: &GyroBias, noise: &GyroNoise, rest_s: f64) -> String {
    let mut told = format!("rest of {rest_s:.1} s\n");
    let per_hour = 1f64.to_degrees() * 3600.0;
    for (axis, name) in AXES.iter().enumerate() {
        let _ = writeln!(
            told,
            "{name}: bias {:+.3} ± {:.3} °/h, noise {:.4} °/√h, bias instability {:.3} °/h",
            bias.bias_radps[axis] * per_hour,
            noise.mean_sd[axis] * per_hour,
            noise.density[axis].to_degrees() * 60.0,
            noise.instability[axis] * per_hour
        );
    }
    told
}

fn write_allan(out: &Path, curves: &[Vec<AllanPoint>]) -> anyhow::Result<()> {
    let mut table = OutputFile::create(out, "allan.csv")?;
    writeln!(table, "tau_s,x_radps,y_radps,z_radps,relative_sd")?;
    for (k, point) in curves[0].iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|axis| curves[axis][k].deviation);
        writeln!(table, "{},{x:e},{y:e},{z:e},{:.4}", point.tau_s, point.relative_sd)?;
    }
    table.finish()
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
