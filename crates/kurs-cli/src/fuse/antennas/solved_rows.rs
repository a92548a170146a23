//! Reads the rows that `kurs solve` and `kurs orient` wrote: `attitude.csv`.

use std::path::Path;

use anyhow::{Context, bail};
use kurs::frames::{Geodetic, Rotation, Vector};
use kurs::solution::{
    AttitudeEstimate, EpochSolution, IntegerReport, Outcome, PositionEstimate, PositionOrigin,
    Reason, Status,
};
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};

use crate::summary::{Damage, damaged};
use crate::text_file::TextFile;

/// Longest list of damage that is kept.
const LISTED_DAMAGE: usize = 20;
/// The summary has means: of a single row not more than this share is the installation's.
const MAX_INSTALLATION: f64 = 0.99;
/// Angles and their standard deviations.
const ANGLES: [(&str, &str); 3] =
    [("heading_deg", "heading_sd_deg"), ("pitch_deg", "pitch_sd_deg"), ("roll_deg", "roll_sd_deg")];

/// The rows in the order of the file, and what could not be used.
pub(super) fn read(path: &Path) -> anyhow::Result<(Vec<EpochSolution>, Vec<Damage>)> {
    let name = path.display();
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(TextFile::open(path)?);
    let header = reader.headers().with_context(|| format!("{name}:1"))?.clone();
    let has = |wanted: &str| header.iter().any(|column| column == wanted);
    let sds = ANGLES.iter().filter(|(angle, _)| has(angle)).map(|(_, sd)| *sd);
    for needed in ["gps_week", "tow_s", "status", "heading_deg"].into_iter().chain(sds) {
        if !has(needed) {
            bail!("{name}:1: no column `{needed}`: attitude.csv of kurs solve is expected");
        }
    }
    let (mut rows, mut damage) = (Vec::new(), Vec::new());
    for record in reader.records() {
        let (line, row) = match record {
            Ok(record) => {
                let line = record.position().map_or(0, csv::Position::line);
                (line, Fields { header: &header, record: &record }.row())
            }
            Err(error) => {
                let line = error.position().map_or(0, csv::Position::line);
                (line, Err(error.to_string()))
            }
        };
        match row {
            Ok(row) => rows.push(row),
            Err(what) => {
                Damage::at(name.to_string(), line, what).add_to(&mut damage, LISTED_DAMAGE)
            }
        }
    }
    if rows.is_empty() {
        bail!("{name}: no usable row{}", damaged(&damage));
    }
    if let Some(sd_rad) = installation_sd_rad(&path.with_file_name("summary.json"))? {
        rows.iter_mut().filter_map(|row| row.outcome.attitude_mut()).for_each(|attitude| {
            attitude.installation_rad2 = installation_part(&attitude.covariance_rad2, sd_rad);
        });
    }
    Ok((rows, damage))
}

/// `installation_sd_deg` of the summary beside the rows, heading, pitch, roll; `None` without it.
fn installation_sd_rad(summary: &Path) -> anyhow::Result<Option<[f64; 3]>> {
    if !summary.is_file() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(summary)
        .with_context(|| format!("{}: cannot be read", summary.display()))?;
    let file: serde_json::Value =
        serde_json::from_str(&text).with_context(|| format!("{}: no JSON", summary.display()))?;
    let of = &file["installation_sd_deg"];
    let sd_rad = |angle: &str| of[angle].as_f64().unwrap_or(0.0).to_radians();
    Ok(of.is_object().then(|| ["heading", "pitch", "roll"].map(sd_rad)))
}

/// The part of a covariance that these standard deviations of the installation make: `C − D C D`
/// with what they leave of each standard deviation in `D`.
fn installation_part(covariance_rad2: &Matrix3<f64>, sd_rad: [f64; 3]) -> Matrix3<f64> {
    let left = Vector3::from_fn(|k, _| {
        let share = sd_rad[k].powi(2) / covariance_rad2[(k, k)];
        if share > 0.0 { (1.0 - share.min(MAX_INSTALLATION)).sqrt() } else { 1.0 }
    });
    let left = Matrix3::from_diagonal(&left);
    covariance_rad2 - left * covariance_rad2 * left
}

/// One record by the names of its columns.
struct Fields<'a> {
    header: &'a csv::StringRecord,
    record: &'a csv::StringRecord,
}

impl Fields<'_> {
    fn row(&self) -> Result<EpochSolution, String> {
        let week: i32 = self.text("gps_week").parse().map_err(|_| self.wrong("gps_week"))?;
        let tow_s = self.number("tow_s")?.ok_or_else(|| self.wrong("tow_s"))?;
        let time = GpsTime::from_week_tow(week, tow_s).ok_or_else(|| self.wrong("tow_s"))?;
        let count = |name: &str| self.text(name).parse().unwrap_or(0);
        let mut row = EpochSolution::lost(time, Reason::BadInput);
        row.outcome = self.outcome()?;
        row.antennas = count("antennas");
        row.satellites = count("satellites");
        row.residual_rms_m = self.number("residual_rms_m")?;
        row.position = self.position()?;
        let mut integers = IntegerReport::default();
        integers.ambiguities = count("ambiguities");
        integers.success_rate = self.number("success_rate")?;
        integers.ratio = self.number("ratio")?;
        row.integers = Some(integers);
        Ok(row)
    }

    fn outcome(&self) -> Result<Outcome, String> {
        let known = Status::ALL.iter().find(|status| status.word() == self.text("status"));
        let known_reason = || Reason::ALL.into_iter().find(|r| r.word() == self.text("reason"));
        let reason = || known_reason().ok_or_else(|| self.wrong("reason"));
        let attitude = self.attitude()?;
        let with_heading = Some(attitude).filter(|attitude| attitude.heading_rad.is_some());
        Ok(match known.ok_or_else(|| self.wrong("status"))? {
            Status::Fixed => Outcome::Fixed { attitude },
            Status::Float => Outcome::Float { attitude: with_heading, reason: known_reason() },
            Status::Inconsistent => {
                Outcome::Inconsistent { attitude: with_heading, reason: reason()? }
            }
            Status::Lost => Outcome::Lost { reason: reason()? },
            Status::NotCapable => Outcome::NotCapable,
        })
    }

    fn attitude(&self) -> Result<AttitudeEstimate, String> {
        let angle = |name: &str| Ok::<_, String>(self.number(name)?.map(f64::to_radians));
        let mut angles_rad = [None; 3];
        let mut covariance_deg2 = Matrix3::zeros();
        for (k, (name, sd_name)) in ANGLES.into_iter().enumerate() {
            angles_rad[k] = angle(name)?;
            let sd_deg = self.number(sd_name)?.unwrap_or(0.0);
            // An angle of which nothing is known but itself would count as exact.
            if angles_rad[k].is_some() && sd_deg <= 0.0 {
                return Err(self.not_as(sd_name, "a standard deviation above 0"));
            }
            covariance_deg2[(k, k)] = sd_deg.powi(2);
        }
        let [heading_rad, pitch_rad, roll_rad] = angles_rad;
        for (i, j, name) in [(0, 1, "cov_hp_deg2"), (0, 2, "cov_hr_deg2"), (1, 2, "cov_pr_deg2")] {
            let value = self.number(name)?.unwrap_or(0.0);
            covariance_deg2[(i, j)] = value;
            covariance_deg2[(j, i)] = value;
        }
        let mut quaternion = [0.0; 4];
        let mut is_whole = true;
        for (part, name) in quaternion.iter_mut().zip(["qw", "qx", "qy", "qz"]) {
            let value = self.number(name)?;
            is_whole &= value.is_some();
            *part = value.unwrap_or(0.0);
        }
        let norm = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
        if is_whole && (norm - 1.0).abs() > 1e-6 {
            return Err(format!("qw, qx, qy, qz: length {norm:.6}, expected 1"));
        }
        let radian = 1f64.to_radians();
        Ok(AttitudeEstimate {
            heading_rad,
            pitch_rad,
            roll_rad,
            covariance_rad2: covariance_deg2 * radian * radian,
            installation_rad2: Matrix3::zeros(),
            ned_from_body: is_whole.then(|| Rotation::from_quaternion(quaternion)),
            line_elevation_rad: angle("line_elevation_deg")?,
        })
    }

    fn position(&self) -> Result<Option<PositionEstimate>, String> {
        let coordinates = ["latitude_deg", "longitude_deg", "height_m"];
        let [latitude, longitude, height] = coordinates.map(|name| self.number(name));
        let (Some(latitude_deg), Some(longitude_deg), Some(height_m)) =
            (latitude?, longitude?, height?)
        else {
            return Ok(None);
        };
        if !(-90.0..=90.0).contains(&latitude_deg) {
            return Err(self.not_as("latitude_deg", "-90 to 90"));
        }
        if !(-360.0..=360.0).contains(&longitude_deg) {
            return Err(self.not_as("longitude_deg", "-360 to 360"));
        }
        let geodetic = Geodetic::from_degrees(latitude_deg, longitude_deg, height_m);
        let mut covariance_m2 = Matrix3::zeros();
        for (k, name) in ["sd_north_m", "sd_east_m", "sd_down_m"].iter().enumerate() {
            covariance_m2[(k, k)] = self.number(name)?.unwrap_or(f64::NAN).powi(2);
        }
        let velocity = ["vel_north_mps", "vel_east_mps", "vel_down_mps"];
        let [north, east, down] = velocity.map(|name| self.number(name));
        let velocity_mps = match (north?, east?, down?) {
            (Some(north), Some(east), Some(down)) => Some(Vector::new(north, east, down)),
            _ => None,
        };
        Ok(Some(PositionEstimate {
            antenna: None,
            geodetic,
            position_m: geodetic.to_ecef(),
            covariance_m2,
            velocity_mps,
            clock_m: self.number("clock_bias_m")?,
            hdop: None,
            origin: PositionOrigin::Alone,
        }))
    }

    /// A finite number; `None` for an empty field or a column that the file does not have.
    fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let text = self.text(name);
        if text.is_empty() {
            return Ok(None);
        }
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.map(Some).ok_or_else(|| self.wrong(name))
    }

    fn text(&self, name: &str) -> &str {
        let place = self.header.iter().position(|column| column == name);
        place.and_then(|place| self.record.get(place)).unwrap_or_default().trim()
    }

    fn not_as(&self, name: &str, expected: &str) -> String {
        format!("{name}: `{}` found, {expected} expected", self.text(name))
    }

    fn wrong(&self, name: &str) -> String {
        format!("{name}: `{}` found, which is not what kurs solve writes", self.text(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is left without the installation is a covariance, however large its part is.
    #[test]
    fn the_installation_is_a_part_of_the_covariance() {
        let covariance = Matrix3::new(4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0);
        let part = installation_part(&covariance, [1.0, 0.0, 9.0]);
        let noise = covariance - part;
        assert!((part[(0, 0)] - 1.0).abs() < 1e-12 && part[(1, 1)].abs() < 1e-12);
        assert!((noise[(2, 2)] - 0.02).abs() < 1e-12, "{noise}");
        assert!(noise.cholesky().is_some());
    }

    #[test]
    fn the_summary_beside_the_rows_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("summary.json");
        assert_eq!(installation_sd_rad(&path).unwrap(), None);
        std::fs::write(&path, r#"{"installation_sd_deg": {"heading": 0.5, "roll": null}}"#)
            .unwrap();
        let found = installation_sd_rad(&path).unwrap().unwrap();
        assert_eq!(found, [0.5f64.to_radians(), 0.0, 0.0]);
        std::fs::write(&path, "{}").unwrap();
        assert_eq!(installation_sd_rad(&path).unwrap(), None);
    }
}
