//! The array file of `kurs plan`: antennas, and what is planned for.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use kurs::array::AntennaArray;
use kurs::frames::{Attitude, Geodetic};
use kurs::selection::{Baselines, Criterion, Graph};
use kurs::signal::Band;
use kurs::sky::NoiseModel;
use serde::Deserialize;

use super::session::Session;
use crate::config_file::{self, check_range};
use crate::failure::UsageError;
use crate::pipe;
use crate::solve::config::Config;

/// Keys of `[plan]` that something else may say.
const KEYS: [&str; 11] = [
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "heading_deg",
    "pitch_deg",
    "roll_deg",
    "elevation_mask_deg",
    "code_sd_m",
    "phase_sd_m",
    "length_sd_m",
    "bands",
];

/// Keys of `[solve]` alone that the plan rests on.
const KEYS_OF_SOLVE: [&str; 3] = ["roll_sd_deg", "max_angle_sd_deg", "max_wrong_fix_rate"];

/// Lengths weigh by their standard deviations; places that `kurs solve` takes for exact are as good
/// as this.
const MIN_LENGTH_SD_M: f64 = 1e-6;

/// The file: an array of its own, or the configuration of `kurs solve`.
#[derive(Debug, Deserialize)]
pub(super) struct ArrayFile {
    #[serde(default)]
    pub(super) plan: Settings,
    #[serde(default)]
    pub(super) mask: Vec<BodyMask>,
    #[serde(default)]
    baseline: Vec<BaselineEntry>,
    /// All other tables, as `kurs solve` reads them.
    #[serde(skip)]
    pub(super) config: Config,
    /// Where the value of each key comes from.
    #[serde(skip)]
    pub(super) origins: BTreeMap<&'static str, Origin>,
}

/// Where a value comes from, the strongest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// `[plan]`
    Plan,
    /// `[solve]`
    Solve,
    /// The observations of the configuration.
    Observations,
    /// Stated nowhere.
    Assumed,
}

impl Origin {
    /// In words.
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::Plan => "[plan]",
            Self::Solve => "[solve]",
            Self::Observations => "the observations",
            Self::Assumed => "assumed",
        }
    }
}

/// A baseline that is better or worse than the others.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct BaselineEntry {
    between: [String; 2],
    weight: f64,
}

/// Part of the sky that the body hides, seen from above the level body.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BodyMask {
    /// From this azimuth, clockwise from the nose, …
    pub(super) from_deg: f64,
    /// … to this one.
    pub(super) to_deg: f64,
    /// Hidden below this elevation.
    pub(super) elevation_deg: f64,
}

impl BodyMask {
    fn check(&self) -> Result<(), UsageError> {
        check_range("mask.from_deg", self.from_deg, -360.0..=360.0)?;
        check_range("mask.to_deg", self.to_deg, -360.0..=360.0)?;
        check_range("mask.elevation_deg", self.elevation_deg, 0.0..=90.0)
    }
}

/// `[plan]`; every key has a default.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Settings {
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    pub(super) height_m: f64,
    pub(super) heading_deg: f64,
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    pub(super) elevation_mask_deg: f64,
    /// Standard deviations of one antenna at the zenith.
    pub(super) code_sd_m: f64,
    pub(super) phase_sd_m: f64,
    /// 1-sigma of each coordinate of the antenna places, `array_sd_m` of `[solve]`.
    pub(super) length_sd_m: f64,
    bands: Vec<String>,
    criterion: CriterionName,
    graph: GraphName,
    pub(super) step_s: f64,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum CriterionName {
    BaselineCondition,
    InformationCondition,
    SmallestInformation,
    TraceOfCovariance,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum GraphName {
    SpanningTree,
    General,
    AllPairs,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            latitude_deg: 50.0,
            longitude_deg: 10.0,
            height_m: 0.0,
            heading_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            elevation_mask_deg: 10.0,
            code_sd_m: 0.3,
            phase_sd_m: 0.003,
            length_sd_m: 0.002,
            bands: vec!["G1".to_owned(), "E1".to_owned()],
            criterion: CriterionName::TraceOfCovariance,
            graph: GraphName::SpanningTree,
            step_s: 300.0,
        }
    }
}

impl Settings {
    pub(super) fn criterion(&self) -> Criterion {
        match self.criterion {
            CriterionName::BaselineCondition => Criterion::BaselineCondition,
            CriterionName::InformationCondition => Criterion::InformationCondition,
            CriterionName::SmallestInformation => Criterion::SmallestInformation,
            CriterionName::TraceOfCovariance => Criterion::TraceOfCovariance,
        }
    }

    pub(super) fn graph(&self) -> Graph {
        match self.graph {
            GraphName::SpanningTree => Graph::SpanningTree,
            GraphName::General => Graph::General,
            GraphName::AllPairs => Graph::AllPairs,
        }
    }

    /// As `kurs solve` weights observations of which no C/N0 is known.
    pub(super) fn noise(&self) -> NoiseModel {
        NoiseModel {
            code_zenith_m: self.code_sd_m,
            phase_zenith_m: self.phase_sd_m,
            full_cn0_dbhz: 45.0,
            channel_sd_m: 0.0,
        }
    }

    /// How the body stands.
    pub(super) fn attitude(&self) -> Attitude {
        Attitude {
            heading_rad: self.heading_deg.to_radians(),
            pitch_rad: self.pitch_deg.to_radians(),
            roll_rad: self.roll_deg.to_radians(),
        }
    }

    pub(super) fn place(&self) -> Geodetic {
        Geodetic::from_degrees(self.latitude_deg, self.longitude_deg, self.height_m)
    }

    pub(super) fn bands(&self) -> Result<Vec<Band>, UsageError> {
        let band = |text: &String| {
            text.parse().map_err(|error| UsageError(format!("plan.bands: {error}")))
        };
        self.bands.iter().map(band).collect()
    }

    /// Refuses numbers that no sky or antenna has.
    fn check(&self) -> Result<(), UsageError> {
        let ranges = [
            ("latitude_deg", self.latitude_deg, -90.0, 90.0),
            ("longitude_deg", self.longitude_deg, -360.0, 360.0),
            ("height_m", self.height_m, -1e4, 1e6),
            ("heading_deg", self.heading_deg, -360.0, 360.0),
            ("pitch_deg", self.pitch_deg, -89.0, 89.0),
            ("roll_deg", self.roll_deg, -180.0, 180.0),
            ("elevation_mask_deg", self.elevation_mask_deg, 0.0, 89.0),
            ("code_sd_m", self.code_sd_m, 1e-3, 1e3),
            ("phase_sd_m", self.phase_sd_m, 1e-6, 1.0),
            ("length_sd_m", self.length_sd_m, MIN_LENGTH_SD_M, 1.0),
            ("step_s", self.step_s, 1.0, 86_400.0),
        ];
        for (key, found, least, most) in ranges {
            check_range(&format!("plan.{key}"), found, least..=most)?;
        }
        if self.bands.is_empty() {
            return Err(UsageError("plan.bands is empty".to_owned()));
        }
        Ok(())
    }
}

impl ArrayFile {
    /// Reads the file; keys of `[solve]` hold where `[plan]` does not say otherwise.
    pub(super) fn read(path: &Path, set: &[String]) -> Result<Self, UsageError> {
        // Keys that nobody knows are refused by the configuration of `kurs solve`, which knows all tables.
        let config: Config = config_file::read_with(path, set, "plan")?;
        let mut file: Self = config_file::read_with(path, set, "plan")?;
        let table: toml::Table = config_file::read_with(path, set, "plan")?;
        let is_given =
            |of: &str, key: &str| table.get(of).is_some_and(|inner| inner.get(key).is_some());
        let Self { plan, origins, .. } = &mut file;
        for key in KEYS {
            origins.insert(key, if is_given("plan", key) { Origin::Plan } else { Origin::Assumed });
        }
        for key in KEYS_OF_SOLVE {
            let is_given = is_given("solve", key);
            origins.insert(key, if is_given { Origin::Solve } else { Origin::Assumed });
        }
        let mut inherits = |key: &'static str, of_solve: &str| {
            let inherits = is_given("solve", of_solve) && !is_given("plan", key);
            if inherits {
                origins.insert(key, Origin::Solve);
            }
            inherits
        };
        let solve = &config.solve;
        for (key, of_solve, value, inherited) in [
            (
                "elevation_mask_deg",
                "elevation_mask_deg",
                &mut plan.elevation_mask_deg,
                solve.elevation_mask_deg,
            ),
            (
                "length_sd_m",
                "array_sd_m",
                &mut plan.length_sd_m,
                solve.array_sd_m.max(MIN_LENGTH_SD_M),
            ),
            ("code_sd_m", "code_sd_m", &mut plan.code_sd_m, solve.code_sd_m),
            ("phase_sd_m", "phase_sd_m", &mut plan.phase_sd_m, solve.phase_sd_m),
        ] {
            if inherits(key, of_solve) {
                *value = inherited;
            }
        }
        if inherits("bands", "bands") {
            plan.bands = solve.bands.clone().unwrap_or_default();
        }
        file.config = config;
        let folder = pipe::folder_of(path);
        file.config.nav.files.iter_mut().for_each(|nav| *nav = folder.join(&*nav));
        let obs = file.config.antenna.iter_mut().flat_map(|antenna| &mut antenna.obs);
        obs.for_each(|obs| *obs = folder.join(&*obs));
        Ok(file)
    }

    /// Refuses what no sky, antenna or body has.
    pub(super) fn check(&self) -> Result<(), UsageError> {
        self.plan.check()?;
        self.mask.iter().try_for_each(BodyMask::check)?;
        let names = self.names();
        for (index, name) in names.iter().enumerate() {
            if names[..index].contains(name) {
                return Err(UsageError(format!("two antennas are named `{name}`")));
            }
        }
        Ok(())
    }

    /// Observation files that the file names.
    pub(super) fn observations(&self) -> impl Iterator<Item = &PathBuf> {
        self.config.antenna.iter().flat_map(|antenna| &antenna.obs)
    }

    /// Takes from the observations what the file does not state.
    pub(super) fn fill(&mut self, session: &Session) {
        let Self { plan, origins, .. } = self;
        let mut fill = |key: &'static str, is_told: bool| {
            let fills = is_told && origins.get(key) == Some(&Origin::Assumed);
            if fills {
                origins.insert(key, Origin::Observations);
            }
            fills
        };
        let place = session.place;
        for (key, value, found) in [
            ("latitude_deg", &mut plan.latitude_deg, place.map(|p| p.latitude_rad.to_degrees())),
            ("longitude_deg", &mut plan.longitude_deg, place.map(|p| p.longitude_rad.to_degrees())),
            ("height_m", &mut plan.height_m, place.map(|p| p.height_m)),
            ("heading_deg", &mut plan.heading_deg, session.angles_deg[0]),
            ("pitch_deg", &mut plan.pitch_deg, session.angles_deg[1]),
            ("roll_deg", &mut plan.roll_deg, session.angles_deg[2]),
            ("code_sd_m", &mut plan.code_sd_m, session.code_sd_m),
            ("phase_sd_m", &mut plan.phase_sd_m, session.phase_sd_m),
        ] {
            if fill(key, found.is_some()) {
                *value = found.unwrap_or(*value);
            }
        }
        if fill("bands", !session.bands.is_empty()) {
            plan.bands = session.bands.iter().map(Band::to_string).collect();
        }
    }

    /// Key, value and origin of everything that the plan rests on.
    pub(super) fn basis(&self) -> Vec<[String; 3]> {
        let Settings { latitude_deg, longitude_deg, height_m, bands, .. } = &self.plan;
        let values = [
            ("latitude_deg", format!("{latitude_deg:.4}")),
            ("longitude_deg", format!("{longitude_deg:.4}")),
            ("height_m", format!("{height_m:.0}")),
            ("heading_deg", format!("{:.1}", self.plan.heading_deg)),
            ("pitch_deg", format!("{:.1}", self.plan.pitch_deg)),
            ("roll_deg", format!("{:.1}", self.plan.roll_deg)),
            ("bands", bands.join(" ")),
            ("elevation_mask_deg", self.plan.elevation_mask_deg.to_string()),
            ("code_sd_m", format!("{:.3}", self.plan.code_sd_m)),
            ("phase_sd_m", format!("{:.4}", self.plan.phase_sd_m)),
            ("length_sd_m", self.plan.length_sd_m.to_string()),
            ("roll_sd_deg", self.config.solve.roll_sd_deg.to_string()),
            ("max_angle_sd_deg", self.config.solve.max_angle_sd_deg.to_string()),
            ("max_wrong_fix_rate", self.config.solve.max_wrong_fix_rate.to_string()),
        ];
        let origin = |key: &str| self.origins.get(key).copied().unwrap_or(Origin::Assumed);
        let row =
            |(key, value): (&str, String)| [key.to_owned(), value, origin(key).text().to_owned()];
        values.into_iter().map(row).collect()
    }

    /// Navigation files that the file names.
    pub(super) fn navigation(&self) -> &[PathBuf] {
        &self.config.nav.files
    }

    pub(super) fn names(&self) -> Vec<&str> {
        self.config.antenna.iter().map(|antenna| antenna.name.as_str()).collect()
    }

    /// What an engine of `kurs solve` is told of the array and the sky that are planned.
    pub(super) fn engine(&self) -> Result<kurs::engine::Settings, UsageError> {
        if let Some(without) = self.config.antenna.iter().find(|a| a.position_m.is_none()) {
            return Err(UsageError(format!(
                "antenna `{}` has no `position_m`: an array is planned by the places of its \
                 antennas; `kurs survey` finds those of a working one",
                without.name
            )));
        }
        let settings = kurs::engine::Settings {
            bands: Some(self.plan.bands()?),
            elevation_mask_rad: self.plan.elevation_mask_deg.to_radians(),
            array_sd_m: self.plan.length_sd_m,
            ..self.config.settings()?
        };
        settings.check().map_err(|error| UsageError(format!("plan.{error}")))?;
        Ok(settings)
    }

    /// All baselines with their weights.
    pub(super) fn baselines(&self, array: &AntennaArray) -> Result<Baselines, UsageError> {
        let usage = |message: String| UsageError(format!("[[baseline]]: {message}"));
        let names = self.names();
        let mut weights = vec![1.0; array.len() * (array.len() - 1) / 2];
        let free = Baselines::of(array).map_err(|error| UsageError(error.to_string()))?;
        for entry in &self.baseline {
            let index = |name: &String| {
                names
                    .iter()
                    .position(|known| known == name)
                    .ok_or_else(|| usage(format!("no antenna has the name `{name}`")))
            };
            let (a, b) = (index(&entry.between[0])?, index(&entry.between[1])?);
            let pair = (a.min(b), a.max(b));
            match free.pairs().iter().position(|other| *other == pair) {
                Some(k) => weights[k] = entry.weight,
                None => return Err(usage(format!("`{}` is named twice", names[a]))),
            }
        }
        Baselines::weighted(array, &weights).map_err(|error| usage(error.to_string()))
    }
}
