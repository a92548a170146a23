//! `imu.csv`: what gyros and accelerometers read, and `fuse.toml`, which joins it with the
//! attitudes of `kurs solve`.

use std::io::Write as _;
use std::path::Path;

use kurs::array::{AntennaArray, Shape};
use kurs::frames::Vector;
use kurs_sim::scenario::Imu;
use kurs_sim::simulation::Simulation;

use crate::output::OutputFile;

/// Writes both for every body that has a sensor; `of_body` gives each its names.
pub(super) fn write(
    directory: &Path,
    simulation: &Simulation,
    of_body: impl Fn(&str, usize) -> String,
) -> anyhow::Result<()> {
    for (index, body) in simulation.scenario().body.iter().enumerate() {
        let (Some(imu), Some(readings)) = (&body.imu, simulation.imu(index)) else { continue };
        let name = format!("{}.csv", of_body("imu", index));
        let mut file = OutputFile::create(directory, &name)?;
        writeln!(file, "time_s,gx_degps,gy_degps,gz_degps,ax_mps2,ay_mps2,az_mps2")?;
        for reading in readings {
            let time_s = simulation.start().tow_s() + reading.time_s;
            let [gx, gy, gz]: [f64; 3] = reading.rate_radps.map(f64::to_degrees).into();
            let [ax, ay, az]: [f64; 3] = reading.specific_force_mps2.into();
            writeln!(file, "{time_s:.4},{gx:.7},{gy:.7},{gz:.7},{ax:.6},{ay:.6},{az:.6}")?;
        }
        file.finish()?;
        if body.antenna.len() >= 2 {
            let places = body.antenna.iter().map(|a| Vector::from_xyz(a.position_m.into()));
            let shape = AntennaArray::new(places.collect()).map(|array| array.shape());
            // Antennas in a line leave the way from the first one to the origin undetermined.
            let velocity_point_m = match shape {
                Ok(Shape::Planar | Shape::Spatial) => [0.0; 3],
                Ok(Shape::Collinear) | Err(_) => body.antenna[0].position_m,
            };
            write_configuration(directory, imu, velocity_point_m, |word| of_body(word, index))?;
        }
    }
    Ok(())
}

/// The attitudes are expected in `solved`, where the closing line of `kurs simulate` has them put.
fn write_configuration(
    directory: &Path,
    imu: &Imu,
    velocity_point_m: [f64; 3],
    of_body: impl Fn(&str) -> String,
) -> anyhow::Result<()> {
    let mut file = OutputFile::create(directory, &format!("{}.toml", of_body("fuse")))?;
    writeln!(file, "[antennas]\nattitude = \"{}/attitude.csv\"", of_body("solved"))?;
    writeln!(
        file,
        "# Or instead, solved with the prediction: solve = \"{}.toml\"",
        of_body("kurs")
    )?;
    writeln!(file, "velocity_point_m = {velocity_point_m:?}\n")?;
    writeln!(file, "[imu]\nfile = \"{}.csv\"", of_body("imu"))?;
    writeln!(file, "position_m = {:?}", imu.position_m)?;
    writeln!(file, "mounting_deg = {:?}", imu.mounting_deg)?;
    // A filter that takes the sensor for perfect would never correct it.
    let gyro_noise = imu.gyro_noise_deg_per_sqrt_h.max(1e-3);
    let accelerometer_noise = imu.accelerometer_noise_mps2_per_sqrt_hz.max(1e-5);
    // As a data sheet would state them.
    let largest = |bias: [f64; 3]| bias.iter().fold(0.0, |most: f64, b| most.max(b.abs()));
    let gyro_bias = largest(imu.gyro_bias_degph).max(10.0);
    let accelerometer_bias = largest(imu.accelerometer_bias_mps2).max(0.05);
    writeln!(file, "gyro_noise_deg_per_sqrt_h = {gyro_noise:?}")?;
    writeln!(file, "gyro_bias_sd_degph = {gyro_bias:?}")?;
    writeln!(file, "gyro_range_degps = {:?}", imu.gyro_range_degps)?;
    writeln!(file, "accelerometer_noise_mps2_per_sqrt_hz = {accelerometer_noise:?}")?;
    writeln!(file, "accelerometer_bias_sd_mps2 = {accelerometer_bias:?}")?;
    writeln!(file, "accelerometer_range_mps2 = {:?}", imu.accelerometer_range_mps2)?;
    file.finish()
}
