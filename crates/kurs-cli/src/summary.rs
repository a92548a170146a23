//! `summary.json`: what a run did, in numbers.

use std::collections::BTreeMap;
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};

use kurs::solution::{AttitudeEstimate, BaselineEstimate, EpochSolution, Outcome, Reason, Status};
use kurs::time::GpsTime;
use serde::Serialize;

use crate::pipe;
use crate::quality::Quality;
use crate::session_span::SessionSpan;
use crate::unobserved_bands::UnobservedBands;

const ANGLES: [&str; 3] = ["heading_deg", "pitch_deg", "roll_deg"];
const COMPONENTS: [&str; 4] = ["east_m", "north_m", "up_m", "length_m"];
/// Headings that spread further have no mean: the body turned.
const MAX_HEADING_SPREAD_DEG: f64 = 30.0;

/// Counts and statistics, gathered row by row.
#[derive(Debug)]
pub(crate) struct Summary {
    antennas: Vec<String>,
    epochs: u64,
    by_status: BTreeMap<Status, u64>,
    by_reason: BTreeMap<Reason, u64>,
    span: SessionSpan,
    /// Rows that had enough input to be fixed, and what they had, in words.
    capable: u64,
    capable_means: &'static str,
    /// Rows in which an antenna that observed had no part.
    with_idle: u64,
    first_fix: Option<GpsTime>,
    is_interrupted: bool,
    /// Wanted bands that no antenna observes: their names, and in words.
    unobserved_bands: (Vec<String>, Option<String>),
    quality: Quality,
    /// Moments of [`ANGLES`].
    angles: [Moments; 3],
    /// Sum of the variances that the survey of the antennas causes in each angle, rad².
    installation_rad2: [f64; 3],
    turned: MeanDirection,
    /// Moments of [`COMPONENTS`], by the antennas at the ends.
    baselines: BTreeMap<(usize, usize), [Moments; 4]>,
}

/// One thing that could not be used.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Damage {
    pub(crate) file: String,
    pub(crate) line: u64,
    pub(crate) what: String,
    /// How many it stands for.
    #[serde(skip)]
    pub(crate) places: usize,
}

impl Damage {
    /// What a reader reports of `file`.
    pub(crate) fn new(file: String, damage: &kurs_formats::damage::Damage) -> Self {
        Self::at(pipe::told(&file), damage.line, damage.what.to_string())
    }

    /// One place.
    pub(crate) fn at(file: String, line: u64, what: String) -> Self {
        Self { file, line, what, places: 1 }
    }

    /// Goes into a list; where `most` are listed already, its last entry counts the others.
    pub(crate) fn add_to(self, list: &mut Vec<Self>, most: usize) {
        if let Some(others) = list.get_mut(most) {
            others.places += 1;
            others.what = format!("and {} more", others.places);
        } else if list.len() == most {
            list.push(Self { what: "and 1 more".to_owned(), ..self });
        } else {
            list.push(self);
        }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.what)
    }
}

/// How much was damaged and where first, as a line of its own; nothing if nothing was.
pub(crate) fn damaged(damage: &[Damage]) -> String {
    damage.first().map_or_else(String::new, |first| {
        let places: usize = damage.iter().map(|damage| damage.places).sum();
        format!("\n{places} damaged places, first: {first}")
    })
}

/// Mean and standard deviation by Welford's recursion; angles around a full turn are unwrapped
/// against the mean so far.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

/// Sum of unit vectors towards the headings.
#[derive(Debug, Clone, Copy, Default)]
struct MeanDirection {
    north: f64,
    east: f64,
}

/// Name, mean (`None` where it would mean nothing) and standard deviation.
struct Moment {
    name: String,
    mean: Option<f64>,
    std: f64,
}

/// What stands in a summary for the text of a configuration and its inputs.
pub(crate) fn configuration_hash(configuration: &str) -> String {
    let mut hasher = DefaultHasher::new();
    configuration.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// The file as written.
#[derive(Debug, Serialize)]
pub(crate) struct SummaryFile<'a> {
    version: &'static str,
    configuration_hash: String,
    epochs: u64,
    fixed: u64,
    float: u64,
    lost: u64,
    inconsistent: u64,
    not_capable: u64,
    fixed_of_session: Option<f64>,
    fixed_of_capable: Option<f64>,
    time_to_first_fix_s: Option<f64>,
    mean: BTreeMap<String, Option<f64>>,
    std: BTreeMap<String, f64>,
    reasons: BTreeMap<&'static str, u64>,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    unobserved_bands: &'a [String],
    damage: &'a [Damage],
    wall_s: f64,
    epochs_per_s: f64,
    interrupted: bool,
    installation_sd_deg: InstallationSd,
}

/// Standard deviations that the survey of the antennas causes: they do not average out.
#[derive(Debug, Serialize)]
struct InstallationSd {
    heading: Option<f64>,
    pitch: Option<f64>,
    roll: Option<f64>,
}

impl Summary {
    /// For a run with these antennas, nothing counted yet.
    pub(crate) fn new(antennas: Vec<String>) -> Self {
        Self {
            antennas,
            epochs: 0,
            by_status: BTreeMap::new(),
            by_reason: BTreeMap::new(),
            span: SessionSpan::default(),
            capable: 0,
            capable_means: "in which two antennas share four satellites",
            with_idle: 0,
            first_fix: None,
            is_interrupted: false,
            unobserved_bands: Default::default(),
            quality: Quality::default(),
            angles: Default::default(),
            installation_rad2: [0.0; 3],
            turned: MeanDirection::default(),
            baselines: BTreeMap::new(),
        }
    }

    /// Wanted bands that no antenna observes.
    pub(crate) fn miss_bands(&mut self, unobserved: &UnobservedBands) {
        self.unobserved_bands = (unobserved.names(), unobserved.sentence());
    }

    /// The run ended before its input.
    pub(crate) fn interrupt(&mut self) {
        self.is_interrupted = true;
    }

    /// A summary of rows that need something else to be fixed: "epochs …".
    pub(crate) fn with_capable(mut self, means: &'static str) -> Self {
        self.capable_means = means;
        self
    }

    /// Takes one row into account; `capable`: it had enough input to be fixed.
    pub(crate) fn add(&mut self, row: &EpochSolution, capable: bool) {
        self.epochs += 1;
        self.quality.add(row);
        *self.by_status.entry(row.status()).or_default() += 1;
        if let Some(reason) = row.reason() {
            *self.by_reason.entry(reason).or_default() += 1;
        }
        self.span.add(row.time);
        self.capable += u64::from(capable);
        self.with_idle += u64::from(!row.idle_antennas.is_empty());
        let Outcome::Fixed { attitude } = &row.outcome else { return };
        self.first_fix.get_or_insert(row.time);
        self.add_angles(attitude);
        row.baselines.iter().for_each(|baseline| self.add_baseline(baseline));
    }

    fn add_angles(&mut self, attitude: &AttitudeEstimate) {
        if let Some(heading_rad) = attitude.heading_rad {
            self.turned.add(heading_rad);
        }
        for (k, angle) in attitude.angles_rad().into_iter().enumerate() {
            if let Some(angle) = angle {
                self.angles[k].add_angle_deg(angle.to_degrees());
                self.installation_rad2[k] += attitude.installation_rad2[(k, k)];
            }
        }
    }

    /// Root mean square over the fixed rows that have the angle.
    fn installation_sd_deg(&self) -> InstallationSd {
        let sd_deg = |k: usize| {
            let count = self.angles[k].count;
            (count > 0.0).then(|| (self.installation_rad2[k] / count).sqrt().to_degrees())
        };
        InstallationSd { heading: sd_deg(0), pitch: sd_deg(1), roll: sd_deg(2) }
    }

    fn add_baseline(&mut self, baseline: &BaselineEstimate) {
        let moments = self.baselines.entry((baseline.base, baseline.rover)).or_default();
        let vector = baseline.baseline_m.xyz();
        let components = [vector.x, vector.y, vector.z, vector.norm()];
        moments.iter_mut().zip(components).for_each(|(moments, value)| moments.add(value));
    }

    /// Everything that has a value, by name.
    fn moments(&self) -> Vec<Moment> {
        let angles = ANGLES.iter().zip(self.angles).map(|(name, m)| ((*name).to_owned(), m));
        let baselines = self.baselines.iter().flat_map(|((base, rover), moments)| {
            let pair = format!("{}-{}", self.antennas[*base], self.antennas[*rover]);
            COMPONENTS.iter().zip(moments).map(move |(name, m)| (format!("{pair} {name}"), *m))
        });
        let known = angles.chain(baselines).filter(|(_, moments)| moments.count > 0.0);
        let mean = |name: &str, m: &Moments| match name {
            "heading_deg" => self.turned.mean_deg().filter(|_| m.std() <= MAX_HEADING_SPREAD_DEG),
            _ => Some(m.mean),
        };
        let mut all: Vec<Moment> =
            known.map(|(name, m)| Moment { mean: mean(&name, &m), std: m.std(), name }).collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        all
    }

    /// Counts by the word of the reason.
    fn reasons(&self) -> BTreeMap<&'static str, u64> {
        self.by_reason.iter().map(|(reason, count)| (reason.word(), *count)).collect()
    }

    /// Number of rows with a status.
    pub(crate) fn count(&self, status: Status) -> u64 {
        self.by_status.get(&status).copied().unwrap_or(0)
    }

    /// Number of rows.
    pub(crate) fn epochs(&self) -> u64 {
        self.epochs
    }

    /// Number of fixed rows.
    pub(crate) fn fixed(&self) -> u64 {
        self.count(Status::Fixed)
    }

    /// Whether any row has a solution of any quality.
    pub(crate) fn has_solution(&self) -> bool {
        self.count(Status::Lost) + self.count(Status::NotCapable) < self.epochs
    }

    /// The most frequent reason.
    pub(crate) fn main_reason(&self) -> Option<&'static str> {
        self.reasons().into_iter().max_by_key(|(_, count)| *count).map(|(word, _)| word)
    }

    /// Fixed rows over the epochs of the session's span at its interval, gaps included.
    pub(crate) fn fixed_of_session(&self) -> Option<f64> {
        let epochs = self.span.epochs();
        (epochs > 0).then(|| self.fixed() as f64 / epochs as f64)
    }

    /// Share of the rows in which an antenna that observed had no part.
    pub(crate) fn share_with_idle(&self) -> f64 {
        self.with_idle as f64 / self.epochs.max(1) as f64
    }

    /// Fixed rows over the rows that had enough input to be fixed.
    pub(crate) fn fixed_of_capable(&self) -> Option<f64> {
        (self.capable > 0).then(|| self.fixed() as f64 / self.capable as f64)
    }

    /// Both shares of fixed rows, each with the number of epochs that it is a share of.
    fn shares(&self) -> [(&'static str, Option<f64>, u64); 2] {
        [
            ("fixed of the session", self.fixed_of_session(), self.span.epochs()),
            ("fixed of the usable epochs", self.fixed_of_capable(), self.capable),
        ]
    }

    /// Everything for the file.
    pub(crate) fn file<'a>(
        &'a self,
        configuration: &str,
        damage: &'a [Damage],
        wall_s: f64,
    ) -> SummaryFile<'a> {
        let moments = self.moments();
        SummaryFile {
            version: env!("CARGO_PKG_VERSION"),
            configuration_hash: configuration_hash(configuration),
            epochs: self.epochs,
            fixed: self.fixed(),
            float: self.count(Status::Float),
            lost: self.count(Status::Lost),
            inconsistent: self.count(Status::Inconsistent),
            not_capable: self.count(Status::NotCapable),
            fixed_of_session: self.fixed_of_session(),
            fixed_of_capable: self.fixed_of_capable(),
            time_to_first_fix_s: self
                .first_fix
                .zip(self.span.first())
                .map(|(fix, first)| (fix - first).max(0.0)),
            mean: moments.iter().map(|m| (m.name.clone(), m.mean)).collect(),
            std: moments.iter().map(|m| (m.name.clone(), m.std)).collect(),
            reasons: self.reasons(),
            unobserved_bands: &self.unobserved_bands.0,
            damage,
            wall_s,
            epochs_per_s: self.epochs as f64 / wall_s.max(1e-9),
            interrupted: self.is_interrupted,
            installation_sd_deg: self.installation_sd_deg(),
        }
    }

    /// Names and values for the top of the report.
    pub(crate) fn headline(&self) -> Vec<[String; 2]> {
        let mut rows = vec![["epochs".to_owned(), self.epochs.to_string()]];
        for status in Status::ALL {
            if self.count(status) > 0 {
                rows.push([status.word().to_owned(), self.count(status).to_string()]);
            }
        }
        if self.span.missing() > 0 {
            rows.push(["in gaps".to_owned(), self.span.missing().to_string()]);
        }
        for (name, share, of) in self.shares() {
            if let Some(share) = share {
                rows.push([name.to_owned(), format!("{:.2} % of {of}", 100.0 * share)]);
            }
        }
        rows
    }

    /// Name, mean and standard deviation of everything that has a value.
    pub(crate) fn means(&self) -> Vec<[String; 3]> {
        let row = |m: Moment| {
            let mean = m.mean_text();
            [m.name, mean, format!("{:.4}", m.std)]
        };
        self.moments().into_iter().map(row).collect()
    }

    /// The few lines a user wants to see at the end.
    pub(crate) fn text(&self) -> String {
        let mut lines = vec![format!(
            "{} epochs: {} fixed, {} float, {} lost, {} inconsistent, {} not capable",
            self.epochs,
            self.fixed(),
            self.count(Status::Float),
            self.count(Status::Lost),
            self.count(Status::Inconsistent),
            self.count(Status::NotCapable),
        )];
        let gaps = match self.span.missing() {
            0 => String::new(),
            missing => format!(", {missing} of them in gaps that no antenna has"),
        };
        let capable = format!(" {}", self.capable_means);
        for ((name, share, of), which) in self.shares().into_iter().zip([gaps, capable]) {
            if let Some(share) = share {
                lines.push(format!("{name}: {:.2} % of {of} epochs{which}", 100.0 * share));
            }
        }
        if !self.by_reason.is_empty() {
            let mut reasons: Vec<_> = self.reasons().into_iter().collect();
            reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
            let words: Vec<_> =
                reasons.iter().map(|(word, count)| format!("{word} {count}")).collect();
            lines.push(format!("not fixed because: {}", words.join(", ")));
        }
        let unobserved = self.unobserved_bands.1.iter();
        lines.extend(unobserved.map(|sentence| format!("{sentence}, which `bands` wants")));
        lines.extend(self.quality.lines(&self.span));
        // Where a body turns, its angles and baselines have no mean direction, but mean lengths.
        let is_turning = self.quality.is_turning(self.angles[0].std());
        for m in self.moments().iter().filter(|m| !is_turning || m.name.ends_with("length_m")) {
            lines.push(format!("{:<24} mean {:>11}  std {:>9.4}", m.name, m.mean_text(), m.std));
        }
        lines.join("\n")
    }
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let before = value - self.mean;
        self.mean += before / self.count;
        self.squares += before * (value - self.mean);
    }

    fn add_angle_deg(&mut self, angle_deg: f64) {
        let near = if self.count == 0.0 { angle_deg } else { self.mean };
        self.add(near + (angle_deg - near + 180.0).rem_euclid(360.0) - 180.0);
    }

    fn std(&self) -> f64 {
        if self.count < 2.0 { 0.0 } else { (self.squares / (self.count - 1.0)).sqrt() }
    }
}

impl MeanDirection {
    fn add(&mut self, heading_rad: f64) {
        self.north += heading_rad.cos();
        self.east += heading_rad.sin();
    }

    /// `0 ≤ mean < 360`.
    fn mean_deg(&self) -> Option<f64> {
        let any = self.north != 0.0 || self.east != 0.0;
        any.then(|| self.east.atan2(self.north).to_degrees().rem_euclid(360.0))
    }
}

impl Moment {
    fn mean_text(&self) -> String {
        self.mean.map_or_else(|| "-".to_owned(), |mean| format!("{mean:.4}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fixed row of two antennas with this heading.
    fn fixed(time_s: f64, heading_deg: f64) -> EpochSolution {
        let attitude = AttitudeEstimate {
            heading_rad: Some(heading_deg.to_radians()),
            pitch_rad: None,
            roll_rad: None,
            covariance_rad2: nalgebra::Matrix3::zeros(),
            installation_rad2: nalgebra::Matrix3::zeros(),
            ned_from_body: None,
            line_elevation_rad: None,
        };
        let time = GpsTime::default() + time_s;
        let mut row = EpochSolution::lost(time, Reason::FewAntennas);
        row.outcome = Outcome::Fixed { attitude };
        row
    }

    fn of_headings(headings_deg: &[f64]) -> Summary {
        let mut summary = Summary::new(Vec::new());
        for (k, heading_deg) in headings_deg.iter().enumerate() {
            summary.add(&fixed(k as f64, *heading_deg), true);
        }
        summary
    }

    #[test]
    fn headings_around_north_have_their_mean_there() {
        let moments = of_headings(&[359.0, 1.0, 358.0, 2.0]).moments();
        let mean = moments[0].mean.unwrap();
        assert!(((mean + 180.0).rem_euclid(360.0) - 180.0).abs() < 1e-9, "{mean}");
        assert!((moments[0].std - (10.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_body_that_turned_has_no_mean_heading() {
        let text = of_headings(&[0.0, 90.0, 180.0, 270.0]).text();
        assert!(text.contains("heading_deg              mean           -"), "{text}");
        let mean = of_headings(&[10.0, 20.0, 30.0]).moments()[0].mean.unwrap();
        assert!((mean - 20.0).abs() < 1e-9);
    }

    /// 40 fixed rows, 201 lost ones, then a gap of 59 epochs: 1 in 7.5, not 100 %.
    #[test]
    fn each_share_says_what_it_is_a_share_of() {
        let mut summary = of_headings(&[10.0; 40]);
        for k in (40..240).chain([299]) {
            let time = GpsTime::default() + f64::from(k);
            summary.add(&EpochSolution::lost(time, Reason::FewSatellites), false);
        }
        assert_eq!(summary.fixed_of_session(), Some(40.0 / 300.0));
        assert_eq!(summary.fixed_of_capable(), Some(1.0));
        let text = summary.text();
        let expected = "fixed of the session: 13.33 % of 300 epochs, 59 of them in gaps that no antenna has\n\
                        fixed of the usable epochs: 100.00 % of 40 epochs in which two antennas share";
        assert!(text.contains(expected), "{text}");
        let file = serde_json::to_value(summary.file("", &[], 1.0)).unwrap();
        assert!(file.get("fix_rate").is_none());
        assert_eq!(file["fixed_of_session"], 40.0 / 300.0);
    }
}
