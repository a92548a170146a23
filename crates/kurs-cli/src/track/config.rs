//! The configuration of `kurs track`, documented in `docs/reference/track.md`.

use std::path::{Path, PathBuf};

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::measurement::Quantity;
use kurs::trajectory::refraction::Atmosphere;
use kurs::trajectory::smoother::{Parameter, ParameterKind};
use kurs::trajectory::station::Station;
use serde::Deserialize;

use crate::config_file;
use crate::failure::UsageError;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    pub(super) station: Vec<StationConfig>,
    #[serde(default)]
    pub(super) track: TrackConfig,
    pub(super) refraction: Option<RefractionConfig>,
    pub(super) simulate: Option<SimulateConfig>,
}

/// A place: geodetic or Earth-fixed.
#[derive(Debug, Deserialize, Default, Clone)]
#[serde(deny_unknown_fields)]
pub(super) struct Place {
    latitude_deg: Option<f64>,
    longitude_deg: Option<f64>,
    height_m: Option<f64>,
    position_ecef_m: Option<[f64; 3]>,
}

/// A station, the accuracy of what it measures, and which of its errors are to be estimated.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StationConfig {
    pub(super) name: String,
    latitude_deg: Option<f64>,
    longitude_deg: Option<f64>,
    height_m: Option<f64>,
    position_ecef_m: Option<[f64; 3]>,
    azimuth_sd_deg: Option<f64>,
    elevation_sd_deg: Option<f64>,
    range_sd_m: Option<f64>,
    range_difference_sd_m: Option<f64>,
    cosine_sd: Option<f64>,
    clock_offset_sd_s: Option<f64>,
    azimuth_bias_sd_deg: Option<f64>,
    elevation_bias_sd_deg: Option<f64>,
    range_bias_sd_m: Option<f64>,
}

/// How the measurements become a trajectory.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TrackConfig {
    pub(super) files: Vec<PathBuf>,
    pub(super) model: ModelKind,
    /// Square root of the spectral density of the jerk, m/s² per √s.
    pub(super) jerk_mps2_per_sqrt_s: f64,
    pub(super) outlier_probability: f64,
    pub(super) same_time_s: f64,
    pub(super) two_way_range: TwoWayRange,
    pub(super) range_difference_correlation: f64,
    pub(super) prior: Option<Place>,
    pub(super) heights_m: Option<[f64; 2]>,
    /// Instant of `time_s = 0` in CSV files, UTC.
    pub(super) start_utc: String,
}

/// Each point alone, or all joined by a model of motion.
#[derive(Debug, Deserialize, Clone, Copy, PartialEq, Eq, Default)]
#[serde(rename_all = "lowercase")]
pub(super) enum ModelKind {
    #[default]
    Points,
    Smooth,
}

/// What a two-way range of a TDM holds.
#[derive(Debug, Deserialize, Clone, Copy, PartialEq, Eq, Default)]
#[serde(rename_all = "snake_case")]
pub(super) enum TwoWayRange {
    #[default]
    Half,
    RoundTrip,
}

/// The air over the stations.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RefractionConfig {
    surface_refractivity: f64,
    scale_height_m: f64,
}

/// What `--simulate` makes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SimulateConfig {
    #[serde(default = "default_interval_s")]
    pub(super) interval_s: f64,
    #[serde(default)]
    pub(super) seed: u64,
    pub(super) waypoint: Vec<WaypointConfig>,
    /// What is measured at every point: `"STATION QUANTITY"` or
    /// `"STATION range_difference REFERENCE"`.
    pub(super) measure: Vec<String>,
    /// Sets compared by `--monte-carlo`.
    #[serde(default)]
    pub(super) set: Vec<SetConfig>,
}

/// A point of the simulated path; between points latitude, longitude and height are linear in time.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WaypointConfig {
    pub(super) time_s: f64,
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    pub(super) height_m: f64,
}

/// A named set of measurements.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SetConfig {
    pub(super) name: String,
    pub(super) measure: Vec<String>,
}

const fn default_interval_s() -> f64 {
    1.0
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self {
            files: Vec::new(),
            model: ModelKind::Points,
            jerk_mps2_per_sqrt_s: 2.0,
            outlier_probability: 1e-3,
            same_time_s: 1e-3,
            two_way_range: TwoWayRange::Half,
            range_difference_correlation: 0.0,
            prior: None,
            heights_m: None,
            start_utc: "2026-01-01T00:00:00".to_owned(),
        }
    }
}

impl Default for RefractionConfig {
    fn default() -> Self {
        let Atmosphere { surface_refractivity, scale_height_m } = Atmosphere::default();
        Self { surface_refractivity, scale_height_m }
    }
}

impl RefractionConfig {
    pub(super) const fn atmosphere(&self) -> Atmosphere {
        Atmosphere {
            surface_refractivity: self.surface_refractivity,
            scale_height_m: self.scale_height_m,
        }
    }
}

impl Place {
    /// The position; one of the two ways of giving it must be complete.
    pub(super) fn position_m(&self, what: &str) -> Result<Vector<Ecef>, UsageError> {
        match (self.latitude_deg, self.longitude_deg, self.height_m, self.position_ecef_m) {
            (Some(latitude), Some(longitude), Some(height), None) => {
                Ok(Geodetic::from_degrees(latitude, longitude, height).to_ecef())
            }
            (None, None, None, Some([x, y, z])) => Ok(Vector::new(x, y, z)),
            _ => Err(UsageError(format!(
                "{what}: give either latitude_deg, longitude_deg and height_m, or position_ecef_m"
            ))),
        }
    }
}

impl StationConfig {
    pub(super) fn station(&self) -> Result<Station, UsageError> {
        let place = Place {
            latitude_deg: self.latitude_deg,
            longitude_deg: self.longitude_deg,
            height_m: self.height_m,
            position_ecef_m: self.position_ecef_m,
        };
        place.position_m(&format!("station `{}`", self.name)).map(Station::at_ecef)
    }

    /// Standard deviation of a quantity, in rad, m or 1.
    pub(super) fn sigma(&self, quantity: Quantity) -> Result<f64, UsageError> {
        let (value, key) = match quantity {
            Quantity::Azimuth => (self.azimuth_sd_deg.map(f64::to_radians), "azimuth_sd_deg"),
            Quantity::Elevation => (self.elevation_sd_deg.map(f64::to_radians), "elevation_sd_deg"),
            Quantity::Range => (self.range_sd_m, "range_sd_m"),
            Quantity::RangeDifference { .. } => {
                (self.range_difference_sd_m, "range_difference_sd_m")
            }
            Quantity::CosineNorth | Quantity::CosineEast => (self.cosine_sd, "cosine_sd"),
        };
        value.ok_or_else(|| {
            UsageError(format!("station `{}` measures this but has no `{key}`", self.name))
        })
    }

    /// The errors of this station that the smoother estimates.
    pub(super) fn parameters(&self, station: usize) -> Vec<Parameter> {
        [
            (ParameterKind::ClockOffset, self.clock_offset_sd_s),
            (ParameterKind::AzimuthBias, self.azimuth_bias_sd_deg.map(f64::to_radians)),
            (ParameterKind::ElevationBias, self.elevation_bias_sd_deg.map(f64::to_radians)),
            (ParameterKind::RangeBias, self.range_bias_sd_m),
        ]
        .into_iter()
        .filter_map(|(kind, sigma)| sigma.map(|sigma| Parameter { station, kind, sigma }))
        .collect()
    }
}

impl Config {
    /// Reads and checks what TOML cannot.
    pub(super) fn read(path: &Path, set: &[String]) -> Result<Self, UsageError> {
        let config: Self = config_file::read_with(path, set, "track")?;
        let wrong = |what: String| Err(UsageError(format!("{}: {what}", path.display())));
        for (index, station) in config.station.iter().enumerate() {
            if config.station[..index].iter().any(|other| other.name == station.name) {
                return wrong(format!("two stations are called `{}`", station.name));
            }
        }
        let positive = [
            ("track.jerk_mps2_per_sqrt_s", config.track.jerk_mps2_per_sqrt_s),
            ("simulate.interval_s", config.simulate.as_ref().map_or(1.0, |s| s.interval_s)),
        ];
        for (key, value) in positive {
            if !value.is_finite() || value <= 0.0 {
                return wrong(format!("`{key}` is {value}, expected a number above zero"));
            }
        }
        Ok(config)
    }

    pub(super) fn stations(&self) -> Result<Vec<Station>, UsageError> {
        self.station.iter().map(StationConfig::station).collect()
    }

    /// Index of a station by name.
    pub(super) fn index_of(&self, name: &str) -> Option<usize> {
        self.station.iter().position(|station| station.name == name)
    }

    /// `"S1 azimuth"` or `"B2 range_difference B1"`.
    pub(super) fn quantity_of(&self, text: &str) -> Result<(usize, Quantity), UsageError> {
        let wrong = || {
            UsageError(format!(
                "`{text}`: expected `STATION azimuth|elevation|range|cosine_north|cosine_east` or \
                 `STATION range_difference REFERENCE` with stations of this file"
            ))
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        let station = |name: &str| self.index_of(name).ok_or_else(wrong);
        match words.as_slice() {
            [name, "azimuth"] => Ok((station(name)?, Quantity::Azimuth)),
            [name, "elevation"] => Ok((station(name)?, Quantity::Elevation)),
            [name, "range"] => Ok((station(name)?, Quantity::Range)),
            [name, "cosine_north"] => Ok((station(name)?, Quantity::CosineNorth)),
            [name, "cosine_east"] => Ok((station(name)?, Quantity::CosineEast)),
            [name, "range_difference", other] => {
                Ok((station(name)?, Quantity::RangeDifference { reference: station(other)? }))
            }
            _ => Err(wrong()),
        }
    }
}
