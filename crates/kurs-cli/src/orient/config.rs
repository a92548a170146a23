//! Configuration of `kurs orient`.

use kurs::array::AntennaArray;
use kurs::frames::Vector;
use serde::Deserialize;

use crate::config_file::check_range;
use crate::failure::UsageError;
use crate::solve::config::PointTable;

/// The configuration as written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    #[serde(default)]
    pub(super) antenna: Vec<AntennaTable>,
    #[serde(default)]
    pub(super) orient: OrientTable,
    #[serde(default)]
    pub(super) point: Vec<PointTable>,
}

/// One antenna.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AntennaTable {
    pub(super) name: String,
    pub(super) position_m: Option<[f64; 3]>,
}

/// The method's settings; every key has a default.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OrientTable {
    /// Times of one epoch differ by no more.
    pub(super) match_window_s: f64,
    /// Standard deviations where the positions state none; the known lengths may scale them.
    pub(super) sd_north_m: f64,
    pub(super) sd_east_m: f64,
    pub(super) sd_down_m: f64,
    /// How well `position_m` is known.
    pub(super) array_sd_m: f64,
    /// What the body cannot exceed in pitch or roll.
    pub(super) max_tilt_deg: f64,
    /// For antennas on one line: how far the angle that they cannot see may be from zero.
    pub(super) roll_sd_deg: f64,
    /// An angle less certain than this stays empty.
    pub(super) max_angle_sd_deg: f64,
}

impl Default for OrientTable {
    fn default() -> Self {
        Self {
            match_window_s: 0.02,
            sd_north_m: 0.01,
            sd_east_m: 0.01,
            sd_down_m: 0.02,
            array_sd_m: 0.0,
            max_tilt_deg: 90.0,
            roll_sd_deg: 5.0,
            max_angle_sd_deg: 5.0,
        }
    }
}

impl Config {
    /// Names of the antennas, in order.
    pub(super) fn names(&self) -> Vec<String> {
        self.antenna.iter().map(|antenna| antenna.name.clone()).collect()
    }

    /// The array, if it is given; `None` where no antenna has a position.
    pub(super) fn array(&self) -> Result<Option<AntennaArray>, UsageError> {
        let positions: Vec<Vector<_>> = self
            .antenna
            .iter()
            .filter_map(|antenna| antenna.position_m)
            .map(|[x, y, z]| Vector::new(x, y, z))
            .collect();
        if positions.is_empty() {
            return Ok(None);
        }
        if positions.len() < self.antenna.len() {
            let given = positions.len();
            return Err(UsageError(format!(
                "{given} of {} antennas have `position_m`: give it for all, or for none to have the \
                 array estimated from the data",
                self.antenna.len()
            )));
        }
        AntennaArray::new(positions).map(Some).map_err(|error| UsageError(error.to_string()))
    }

    /// The places of the antennas on the body, where they are given.
    pub(super) fn places(&self) -> Vec<Option<[f64; 3]>> {
        self.antenna.iter().map(|antenna| antenna.position_m).collect()
    }

    /// Refuses values that cannot be meant.
    pub(super) fn check(&self) -> Result<(), UsageError> {
        if self.antenna.len() < 2 {
            let found = self.antenna.len();
            return Err(UsageError(format!("{found} [[antenna]] tables, at least two are needed")));
        }
        for (index, antenna) in self.antenna.iter().enumerate() {
            if self.antenna[..index].iter().any(|other| other.name == antenna.name) {
                return Err(UsageError(format!("two antennas are named `{}`", antenna.name)));
            }
        }
        let OrientTable {
            match_window_s,
            sd_north_m,
            sd_east_m,
            sd_down_m,
            array_sd_m,
            max_tilt_deg,
            roll_sd_deg,
            max_angle_sd_deg,
        } = self.orient;
        for (key, value, range) in [
            ("match_window_s", match_window_s, 0.0..=3600.0),
            ("array_sd_m", array_sd_m, 0.0..=10.0),
            ("sd_north_m", sd_north_m, 1e-6..=1e3),
            ("sd_east_m", sd_east_m, 1e-6..=1e3),
            ("sd_down_m", sd_down_m, 1e-6..=1e3),
            ("max_tilt_deg", max_tilt_deg, 0.0..=180.0),
            ("roll_sd_deg", roll_sd_deg, 0.0..=180.0),
            ("max_angle_sd_deg", max_angle_sd_deg, 1e-3..=180.0),
        ] {
            check_range(&format!("orient.{key}"), value, range)?;
        }
        self.point.iter().try_for_each(PointTable::check)
    }
}
