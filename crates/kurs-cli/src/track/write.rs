//! The files that `kurs track` writes: tables, the path for maps, measurements that were simulated.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::time::{Calendar, GpsTime};
use kurs::trajectory::measurement::Quantity;
use kurs::trajectory::smoother::ParameterKind;
use kurs_formats::tdm::{self, Form, Observable, TrackingRecord};
use nalgebra::Matrix3;

use super::config::Config;
use super::input::Observation;
use super::path::{PathFound, PathPoint};
use super::simulate::TruePoint;
use crate::map_files::{Heights, Way};
use crate::output::OutputFile;
use crate::table::{Table, TableFormat};

const TRAJECTORY: &[&str] = &[
    "time_gpst",
    "time_utc",
    "status",
    "reason",
    "measurements",
    "excluded",
    "likelihood",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "x_m",
    "y_m",
    "z_m",
    "vx_mps",
    "vy_mps",
    "vz_mps",
    "sd_north_m",
    "sd_east_m",
    "sd_up_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_xz_m2",
    "cov_yy_m2",
    "cov_yz_m2",
    "cov_zz_m2",
];

/// Standard deviations to north, east and up.
pub(super) fn local_sigmas(position_m: Vector<Ecef>, covariance: &Matrix3<f64>) -> [f64; 3] {
    let ned_from_ecef = Geodetic::from_ecef(position_m).ned_from_ecef();
    let local = ned_from_ecef.turn_covariance(covariance);
    [0, 1, 2].map(|axis| local[(axis, axis)].sqrt())
}

/// `trajectory.csv`.
pub(super) fn trajectory(points: &[PathPoint], out: &Path) -> anyhow::Result<()> {
    let mut table = Table::create(out, "trajectory", TableFormat::Csv, TRAJECTORY)?;
    for point in points {
        table.text(&point.time.calendar().iso(6));
        table.text(&point.time.utc().iso(6));
        table.text(point.status.word());
        table.text(&point.reason);
        table.integer(i64::try_from(point.measurements).unwrap_or(i64::MAX));
        table.integer(i64::try_from(point.excluded).unwrap_or(i64::MAX));
        table.real(point.likelihood, 6);
        let place = point.position_m.map(Geodetic::from_ecef);
        table.real(place.map(|g| g.latitude_rad.to_degrees()), 9);
        table.real(place.map(|g| g.longitude_rad.to_degrees()), 9);
        table.real(place.map(|g| g.height_m), 4);
        for axis in 0..3 {
            table.real(point.position_m.map(|r| r.xyz()[axis]), 4);
        }
        for axis in 0..3 {
            table.real(point.velocity_mps.map(|v| v.xyz()[axis]), 4);
        }
        let both = point.position_m.zip(point.covariance_m2);
        let sigmas = both.map(|(position, covariance)| local_sigmas(position, &covariance));
        for axis in 0..3 {
            table.real(sigmas.map(|s| s[axis]), 4);
        }
        for (i, j) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
            table.real(point.covariance_m2.map(|k| k[(i, j)]), 6);
        }
        table.end_row()?;
    }
    table.finish()
}

const RESIDUALS: &[&str] =
    &["time_utc", "station", "quantity", "reference", "residual", "unit", "in_sigmas", "excluded"];

/// `residuals.csv`: degrees and metres.
pub(super) fn residuals(config: &Config, found: &PathFound, out: &Path) -> anyhow::Result<()> {
    let mut table = Table::create(out, "residuals", TableFormat::Csv, RESIDUALS)?;
    for residual in &found.residuals {
        let measurement = residual.observation.measurement;
        let (name, unit, per_unit) = words(measurement.quantity);
        table.text(&residual.observation.time.utc().iso(6));
        table.text(&config.station[measurement.station].name);
        table.text(name);
        table.text(reference(config, measurement.quantity).unwrap_or_default());
        table.real(Some(residual.residual * per_unit), 8);
        table.text(unit);
        table.real(Some(residual.residual / measurement.sigma), 4);
        table.text(if residual.excluded { "yes" } else { "no" });
        table.end_row()?;
    }
    table.finish()
}

/// Name, unit and factor of a quantity at the border.
pub(super) fn words(quantity: Quantity) -> (&'static str, &'static str, f64) {
    let degrees_per_rad = 1.0_f64.to_degrees();
    match quantity {
        Quantity::Azimuth => ("azimuth", "deg", degrees_per_rad),
        Quantity::Elevation => ("elevation", "deg", degrees_per_rad),
        Quantity::Range => ("range", "m", 1.0),
        Quantity::RangeDifference { .. } => ("range_difference", "m", 1.0),
        Quantity::CosineNorth => ("cosine_north", "", 1.0),
        Quantity::CosineEast => ("cosine_east", "", 1.0),
    }
}

fn reference(config: &Config, quantity: Quantity) -> Option<&str> {
    match quantity {
        Quantity::RangeDifference { reference } => Some(&config.station[reference].name),
        _ => None,
    }
}

const PARAMETERS: &[&str] = &["station", "parameter", "value", "sd", "unit"];

/// `stations.csv`: the errors of stations that were estimated, and a line for each.
pub(super) fn parameters(
    config: &Config,
    found: &PathFound,
    out: &Path,
    told: &mut String,
) -> anyhow::Result<()> {
    let mut table = Table::create(out, "stations", TableFormat::Csv, PARAMETERS)?;
    for (parameter, [value, sigma]) in &found.parameters {
        let (name, unit, per_unit) = match parameter.kind {
            ParameterKind::ClockOffset => ("clock_offset", "s", 1.0),
            ParameterKind::AzimuthBias => ("azimuth_bias", "deg", 1.0_f64.to_degrees()),
            ParameterKind::ElevationBias => ("elevation_bias", "deg", 1.0_f64.to_degrees()),
            ParameterKind::RangeBias => ("range_bias", "m", 1.0),
        };
        let station = &config.station[parameter.station].name;
        let (value, sigma) = (value * per_unit, sigma * per_unit);
        writeln!(told, "{station} {name}: {value:.6} ± {sigma:.6} {unit}")?;
        table.text(station);
        table.text(name);
        table.real(Some(value), 8);
        table.real(Some(sigma), 8);
        table.text(unit);
        table.end_row()?;
    }
    table.finish()
}

/// `path.kml` and `path.geojson`.
pub(super) fn maps(points: &[PathPoint], out: &Path) -> anyhow::Result<()> {
    let mut way = Way::default();
    points
        .iter()
        .filter_map(|point| point.position_m)
        .for_each(|position| way.push(Geodetic::from_ecef(position)));
    way.write(out, "path", Heights::Absolute)
}

const MEASUREMENTS: &[&str] = &[
    "time_utc",
    "station",
    "reference",
    "azimuth_deg",
    "elevation_deg",
    "range_m",
    "range_difference_m",
    "cosine_north",
    "cosine_east",
];
const TRUTH: &[&str] =
    &["time_utc", "latitude_deg", "longitude_deg", "height_m", "x_m", "y_m", "z_m"];

/// `measurements.csv`, `truth.csv`, and the angles, ranges and differences as `measurements.tdm`
/// and `measurements.xml`.
pub(super) fn simulated(
    config: &Config,
    observations: &[Observation],
    truth: &[TruePoint],
    out: &Path,
) -> anyhow::Result<()> {
    let mut table = Table::create(out, "measurements", TableFormat::Csv, MEASUREMENTS)?;
    for Observation { time, measurement } in observations {
        let (name, _, per_unit) = words(measurement.quantity);
        table.text(&time.utc().iso(6));
        table.text(&config.station[measurement.station].name);
        table.text(reference(config, measurement.quantity).unwrap_or_default());
        for column in &MEASUREMENTS[3..] {
            let bare = column.trim_end_matches("_deg").trim_end_matches("_m");
            table.real((bare == name).then_some(measurement.value * per_unit), 10);
        }
        table.end_row()?;
    }
    table.finish()?;

    let mut table = Table::create(out, "truth", TableFormat::Csv, TRUTH)?;
    for point in truth {
        let place = Geodetic::from_ecef(point.position_m);
        table.text(&point.time.utc().iso(6));
        table.real(Some(place.latitude_rad.to_degrees()), 10);
        table.real(Some(place.longitude_rad.to_degrees()), 10);
        table.real(Some(place.height_m), 5);
        for axis in 0..3 {
            table.real(Some(point.position_m.xyz()[axis]), 5);
        }
        table.end_row()?;
    }
    table.finish()?;

    let records: Vec<TrackingRecord> =
        observations.iter().filter_map(|o| tracking_record(config, o)).collect();
    for (form, name) in [(Form::Kvn, "measurements.tdm"), (Form::Xml, "measurements.xml")] {
        let mut file = OutputFile::create(out, name)?;
        file.write_all(tdm::write(&records, "KURS", now(), form).as_bytes())?;
        file.finish()?;
    }
    Ok(())
}

/// Direction cosines have no keyword in the standard.
fn tracking_record(config: &Config, observation: &Observation) -> Option<TrackingRecord> {
    let measurement = observation.measurement;
    let observable = match measurement.quantity {
        Quantity::Azimuth => Observable::Azimuth,
        Quantity::Elevation => Observable::Elevation,
        Quantity::Range => Observable::TwoWayRange,
        Quantity::RangeDifference { .. } => Observable::RangeDifference,
        Quantity::CosineNorth | Quantity::CosineEast => return None,
    };
    Some(TrackingRecord {
        time: observation.time,
        station: config.station[measurement.station].name.clone(),
        reference: reference(config, measurement.quantity).map(str::to_owned),
        object: "OBJECT".to_owned(),
        observable,
        value: measurement.value,
        line: 0,
    })
}

/// The clock of the machine.
fn now() -> GpsTime {
    let since_1970_s =
        SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
    let new_year = Calendar { year: 2026, month: 1, day: 1, hour: 0, minute: 0, second: 0.0 };
    // 1 767 225 600 s of Unix time are 2026-01-01T00:00:00 UTC.
    GpsTime::from_utc(new_year).unwrap_or_default() + (since_1970_s - 1_767_225_600.0)
}
