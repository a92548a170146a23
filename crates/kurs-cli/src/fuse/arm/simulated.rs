//! The simulated arm of `kurs fuse`: its plan from the configuration, its truth, and the files that
//! a user with such an arm would have.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context;
use kurs::frames::{Geodetic, Vector, wrap_heading};
use kurs::fusion::arm::Triad;
use kurs::fusion::arm::filter::ArmFilterSettings;
use kurs::observation::AntennaEpoch;
use kurs::signal::Signal;
use kurs::time::GpsTime;
use kurs_formats::rinex::{ObservationFileHeader, ObservationWriter, write_navigation};
use kurs_sim::arm_recording::{AccelerometerErrors, ArmRecording, ArmRecordingPlan};
use kurs_sim::rotating_arm::{ArmScenario, Course, TurnShape};
use nalgebra::{Matrix3, Vector3};

use super::config::{Config, CourseWord, NavConfig, SimulateConfig};
use crate::failure::UsageError;
use crate::output::OutputFile;

/// Names of the files.
const OBSERVATIONS: &str = "arm.rnx";
const NAVIGATION: &str = "nav.rnx";
const ACCELEROMETERS: &str = "accelerometer.csv";
const CONFIGURATION: &str = "fuse.toml";
/// Name of the file with the truth.
pub(super) const TRUTH: &str = "truth.csv";

/// The recording that the configuration describes.
pub(super) fn recording(
    config: &Config,
    simulate: &SimulateConfig,
    settings: &ArmFilterSettings,
) -> Result<ArmRecording, UsageError> {
    let problem =
        |error: kurs_sim::simulation::ScenarioError| UsageError(format!("simulate.{error}"));
    let mut plan = plan(config, simulate, settings);
    // The arm's angle is counted from the start of the week, the recording's time from its start.
    let first_s = ArmRecording::new(plan.clone()).map_err(problem)?.start().tow_s();
    plan.arm.phase_rad = settings.arm.angle_rad(first_s);
    ArmRecording::new(plan).map_err(problem)
}

fn plan(
    config: &Config,
    simulate: &SimulateConfig,
    settings: &ArmFilterSettings,
) -> ArmRecordingPlan {
    let (speed_mps, arm) = (simulate.speed_mps, &settings.arm);
    let course = match simulate.course {
        CourseWord::Standing => Course::Standing,
        CourseWord::Uniform => Course::Uniform { speed_mps },
        CourseWord::Along => Course::AlongHeading { speed_mps },
    };
    let [m0, m1, m2] = simulate.matrix;
    let signal = if config.receiver.system == 'C' { "2I" } else { "1C" };
    ArmRecordingPlan {
        arm: ArmScenario {
            heading_rad: simulate.heading_deg.to_radians(),
            // The scenario counts pitch and roll as the paper does.
            pitch_rad: -simulate.pitch_deg.to_radians(),
            roll_rad: -simulate.roll_deg.to_radians(),
            radius_m: arm.radius_m,
            rate_hz: arm.rate_hz,
            centre_m: arm.centre_m,
            body_from_arm: arm.body_from_arm,
            triad_turns: arm.triad == Triad::TurnsWithArm,
            ..ArmScenario::reference(course, TurnShape::Smooth)
        },
        start: simulate.start.clone(),
        duration_s: simulate.duration_s,
        gnss_interval_s: simulate.gnss_interval_s,
        sample_interval_s: simulate.sample_interval_s,
        signals: vec![format!("{}{signal}", config.receiver.system)],
        pseudorange_sd_m: config.receiver.pseudorange_sd_m,
        range_rate_sd_mps: config.receiver.range_rate_sd_mps,
        accelerometers: AccelerometerErrors {
            mount_from_body: config.body_from_mount().transpose(),
            matrix: Matrix3::from_fn(|i, j| [m0, m1, m2][i][j]),
            bias_mps2: Vector3::from(simulate.bias_mps2),
            sd_mps2: config.accelerometer.sd_mps2,
        },
        seed: simulate.seed,
    }
}

/// Writes the truth at every epoch, with the columns of `kurs simulate`.
pub(super) fn write_truth(directory: &Path, mut recording: ArmRecording) -> anyhow::Result<()> {
    let mut file = OutputFile::create(directory, TRUTH)?;
    let columns = "gps_week,tow_s,heading_deg,pitch_deg,roll_deg,latitude_deg,longitude_deg,height_m,\
                   vel_north_mps,vel_east_mps,vel_down_mps,ARM_clock_s";
    writeln!(file, "{columns}")?;
    let mut epoch = AntennaEpoch::default();
    while recording.next_epoch(&mut epoch) {
        let clock_s = recording.clock_s();
        let truth = recording.truth(epoch.time - recording.start() - clock_s);
        let here = Geodetic::from_ecef(Vector::from_xyz(truth.position_m));
        let velocity = (here.ned_from_ecef() * Vector::from_xyz(truth.velocity_mps)).xyz();
        let [roll, pitch, heading] = truth.angles_rad.into();
        writeln!(
            file,
            "{},{:.7},{:.6},{:.6},{:.6},{:.10},{:.10},{:.4},{:.5},{:.5},{:.5},{clock_s:.12}",
            epoch.time.week(),
            epoch.time.tow_s(),
            wrap_heading(heading).to_degrees(),
            -pitch.to_degrees(),
            -roll.to_degrees(),
            here.latitude_rad.to_degrees(),
            here.longitude_rad.to_degrees(),
            here.height_m,
            velocity.x,
            velocity.y,
            velocity.z
        )?;
    }
    file.finish()
}

/// Writes observations, ephemerides, accelerometer log, truth and the configuration that joins
/// them; returns the path of the last.
pub(super) fn write_inputs(
    directory: &Path,
    config: &Config,
    recording: &ArmRecording,
) -> anyhow::Result<PathBuf> {
    write_truth(directory, recording.clone())?;
    write_observations(directory, recording.clone(), config)?;
    let mut file = OutputFile::create(directory, NAVIGATION)?;
    write_navigation(&mut file, recording.navigation())?;
    file.finish()?;
    write_samples(directory, recording)?;

    let mut of_files = Config { simulate: None, ..config.clone() };
    of_files.receiver.obs = vec![OBSERVATIONS.into()];
    of_files.accelerometer.file = Some(ACCELEROMETERS.into());
    of_files.nav = Some(NavConfig { files: vec![NAVIGATION.into()] });
    let mut file = OutputFile::create(directory, CONFIGURATION)?;
    file.write_all(toml::to_string(&of_files).context(CONFIGURATION)?.as_bytes())?;
    file.finish()?;
    Ok(directory.join(CONFIGURATION))
}

fn write_observations(
    directory: &Path,
    mut recording: ArmRecording,
    config: &Config,
) -> anyhow::Result<()> {
    let first: GpsTime = recording.start();
    let header = ObservationFileHeader {
        marker: "ARM".to_owned(),
        position_m: Vector::from_xyz(recording.truth(0.0).antenna_m),
        interval_s: config.simulate.as_ref().map_or(1.0, |simulate| simulate.gnss_interval_s),
        first,
        signals: recording.signals().iter().filter_map(|s| s.parse::<Signal>().ok()).collect(),
        glonass_channels: std::collections::BTreeMap::new(),
    };
    let output = OutputFile::create(directory, OBSERVATIONS)?;
    let mut writer = ObservationWriter::new(output, &header)?;
    let mut epoch = AntennaEpoch::default();
    while recording.next_epoch(&mut epoch) {
        writer.write(&epoch)?;
    }
    writer.finish()?.finish()
}

fn write_samples(directory: &Path, recording: &ArmRecording) -> anyhow::Result<()> {
    let first_s = recording.start().tow_s();
    let mut file = OutputFile::create(directory, ACCELEROMETERS)?;
    writeln!(file, "time_s,ax_mps2,ay_mps2,az_mps2")?;
    for sample in recording.samples() {
        let [x, y, z]: [f64; 3] = sample.reading_mps2.into();
        writeln!(file, "{:.6},{x:.6},{y:.6},{z:.6}", first_s + sample.time_s)?;
    }
    file.finish()
}
