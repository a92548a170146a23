//! The configuration of `kurs track`, documented in `docs/reference/track.md`.

use std::path::{Path, PathBuf};

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::time::GpsTime;
use kurs::trajectory::measurement::Quantity;
use kurs::trajectory::refraction::Atmosphere;
use kurs::trajectory::smoother::{Parameter, ParameterKind};
use kurs::trajectory::station::Station;
use kurs_formats::tdm::TimeSystem;
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

/// Heights of what may be measured, m, to beyond the Moon.
const OBJECT_HEIGHTS_M: [f64; 2] = [-1e4, 1e9];
/// Heights of what stands on the ground or flies in the air, m.
const STATION_HEIGHTS_M: [f64; 2] = [-1e4, 1e5];

/// Refuses NaN and infinities, and numbers outside of the range of the key.
fn check(what: &str, found: f64, [least, most]: [f64; 2]) -> Result<(), UsageError> {
    if (least..=most).contains(&found) {
        return Ok(());
    }
    Err(UsageError(format!("{what} is {found}, expected {least} to {most}")))
}

impl Place {
    /// The position; one of the two ways of giving it must be complete, and its height one of
    /// `heights_m`.
    fn position_m(&self, what: &str, heights_m: [f64; 2]) -> Result<Vector<Ecef>, UsageError> {
        match (self.latitude_deg, self.longitude_deg, self.height_m, self.position_ecef_m) {
            (Some(latitude), Some(longitude), Some(height), None) => {
                check(&format!("{what}: latitude_deg"), latitude, [-90.0, 90.0])?;
                check(&format!("{what}: longitude_deg"), longitude, [-360.0, 360.0])?;
                check(&format!("{what}: height_m"), height, heights_m)?;
                Ok(Geodetic::from_degrees(latitude, longitude, height).to_ecef())
            }
            (None, None, None, Some([x, y, z])) => {
                let position = Vector::new(x, y, z);
                let height_m = Geodetic::from_ecef(position).height_m;
                check(&format!("{what}: the height of position_ecef_m"), height_m, heights_m)?;
                Ok(position)
            }
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
        let what = format!("station `{}`", self.name);
        place.position_m(&what, STATION_HEIGHTS_M).map(Station::at_ecef)
    }

    fn check(&self) -> Result<(), UsageError> {
        const ANGLES_DEG: [f64; 2] = [1e-9, 180.0];
        const LENGTHS_M: [f64; 2] = [1e-9, 1e9];
        let deviations = [
            ("azimuth_sd_deg", self.azimuth_sd_deg, ANGLES_DEG),
            ("elevation_sd_deg", self.elevation_sd_deg, ANGLES_DEG),
            ("range_sd_m", self.range_sd_m, LENGTHS_M),
            ("range_difference_sd_m", self.range_difference_sd_m, LENGTHS_M),
            ("cosine_sd", self.cosine_sd, [1e-12, 1.0]),
            ("clock_offset_sd_s", self.clock_offset_sd_s, [1e-12, 1e6]),
            ("azimuth_bias_sd_deg", self.azimuth_bias_sd_deg, ANGLES_DEG),
            ("elevation_bias_sd_deg", self.elevation_bias_sd_deg, ANGLES_DEG),
            ("range_bias_sd_m", self.range_bias_sd_m, LENGTHS_M),
        ];
        for (key, found, range) in deviations {
            if let Some(found) = found {
                check(&format!("station `{}`: {key}", self.name), found, range)?;
            }
        }
        Ok(())
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

impl TrackConfig {
    fn check(&self) -> Result<(), UsageError> {
        // As long as the smoother takes together for its start.
        const LONGEST_SAME_TIME_S: f64 = 60.0;
        check("track.jerk_mps2_per_sqrt_s", self.jerk_mps2_per_sqrt_s, [1e-9, 1e6])?;
        check("track.outlier_probability", self.outlier_probability, [0.0, 1.0])?;
        check("track.same_time_s", self.same_time_s, [0.0, LONGEST_SAME_TIME_S])?;
        let correlation = self.range_difference_correlation;
        check("track.range_difference_correlation", correlation, [-0.99, 0.99])?;
        if let Some([low, high]) = self.heights_m {
            check("track.heights_m: the lower height", low, OBJECT_HEIGHTS_M)?;
            check("track.heights_m: the higher height", high, [low, OBJECT_HEIGHTS_M[1]])?;
        }
        self.instant(0.0).map(|_| ())?;
        self.prior_m().map(|_| ())
    }

    /// The instant of a `time_s`.
    pub(super) fn instant(&self, time_s: f64) -> Result<GpsTime, UsageError> {
        let start = TimeSystem::Utc.instant(&self.start_utc).ok_or_else(|| {
            let found = &self.start_utc;
            UsageError(format!(
                "track.start_utc is `{found}`, expected such as 2026-01-01T00:00:00"
            ))
        })?;
        let time = start + time_s;
        // Instants end with the year 2272.
        if (time - start - time_s).abs() < 1e-3 {
            return Ok(time);
        }
        Err(UsageError(format!(
            "time_s is {time_s}, expected seconds after track.start_utc, to the year 2272"
        )))
    }

    /// The place that chooses between two roots at the first point.
    pub(super) fn prior_m(&self) -> Result<Option<Vector<Ecef>>, UsageError> {
        let position = |place: &Place| place.position_m("track.prior", OBJECT_HEIGHTS_M);
        self.prior.as_ref().map(position).transpose()
    }
}

impl RefractionConfig {
    fn check(&self) -> Result<(), UsageError> {
        check("refraction.surface_refractivity", self.surface_refractivity, [0.0, 1e3])?;
        check("refraction.scale_height_m", self.scale_height_m, [1e3, 1e5])
    }
}

impl SimulateConfig {
    /// Greatest number of simulated points.
    const MOST_POINTS: f64 = 1e5;

    fn check(&self) -> Result<(), UsageError> {
        for WaypointConfig { time_s, latitude_deg, longitude_deg, height_m } in &self.waypoint {
            check("simulate.waypoint: time_s", *time_s, [-1e10, 1e10])?;
            check("simulate.waypoint: latitude_deg", *latitude_deg, [-90.0, 90.0])?;
            check("simulate.waypoint: longitude_deg", *longitude_deg, [-360.0, 360.0])?;
            check("simulate.waypoint: height_m", *height_m, OBJECT_HEIGHTS_M)?;
        }
        let increasing = self.waypoint.windows(2).all(|pair| pair[0].time_s < pair[1].time_s);
        let [first, .., last] = self.waypoint.as_slice() else {
            return Err(UsageError("simulate.waypoint: at least two points are needed".to_owned()));
        };
        if !increasing {
            let what = "simulate.waypoint: points with increasing time_s are needed";
            return Err(UsageError(what.to_owned()));
        }
        let shortest_s = (last.time_s - first.time_s) / Self::MOST_POINTS;
        check("simulate.interval_s", self.interval_s, [shortest_s, 1e9])
    }
}

impl Config {
    /// Reads and checks what TOML cannot.
    pub(super) fn read(path: &Path, set: &[String]) -> Result<Self, UsageError> {
        let config: Self = config_file::read_with(path, set, "track")?;
        config
            .check()
            .map_err(|UsageError(what)| UsageError(format!("{}: {what}", path.display())))?;
        Ok(config)
    }

    fn check(&self) -> Result<(), UsageError> {
        for (index, station) in self.station.iter().enumerate() {
            if self.station[..index].iter().any(|other| other.name == station.name) {
                return Err(UsageError(format!("two stations are called `{}`", station.name)));
            }
            station.check()?;
            station.station()?;
        }
        self.track.check()?;
        self.refraction.as_ref().map_or(Ok(()), RefractionConfig::check)?;
        self.simulate.as_ref().map_or(Ok(()), SimulateConfig::check)
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
