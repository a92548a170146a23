//! `summary.json`: what a run did, in numbers.

use std::collections::BTreeMap;
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};

use kurs::solution::{AttitudeEstimate, BaselineEstimate, EpochSolution, Reason, Status};
use kurs::time::GpsTime;
use serde::Serialize;

use crate::quality::Quality;

const ANGLES: [&str; 3] = ["heading_deg", "pitch_deg", "roll_deg"];
const COMPONENTS: [&str; 4] = ["east_m", "north_m", "up_m", "length_m"];

/// Counts and statistics, gathered row by row.
#[derive(Debug)]
pub(crate) struct Summary {
    antennas: Vec<String>,
    epochs: u64,
    by_status: BTreeMap<Status, u64>,
    by_reason: BTreeMap<Reason, u64>,
    capable: u64,
    first: Option<GpsTime>,
    first_fix: Option<GpsTime>,
    is_interrupted: bool,
    quality: Quality,
    /// Of [`ANGLES`].
    angles: [Moments; 3],
    /// Of [`COMPONENTS`], by the antennas at the ends.
    baselines: BTreeMap<(usize, usize), [Moments; 4]>,
}

/// One thing that could not be used.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Damage {
    pub(crate) file: String,
    pub(crate) line: u64,
    pub(crate) what: String,
}

impl Damage {
    /// What a reader reports of `file`.
    pub(crate) fn new(file: String, damage: &kurs_formats::damage::Damage) -> Self {
        Self { file, line: damage.line, what: damage.what.to_string() }
    }
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.what)
    }
}

/// Mean and standard deviation by Welford's recursion; angles around a full turn are unwrapped
/// against the first value.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
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
    fix_rate: Option<f64>,
    time_to_first_fix_s: Option<f64>,
    mean: BTreeMap<String, f64>,
    std: BTreeMap<String, f64>,
    reasons: BTreeMap<&'static str, u64>,
    damage: &'a [Damage],
    wall_s: f64,
    epochs_per_s: f64,
    interrupted: bool,
}

impl Summary {
    /// Of a run with these antennas, nothing counted yet.
    pub(crate) fn new(antennas: Vec<String>) -> Self {
        Self {
            antennas,
            epochs: 0,
            by_status: BTreeMap::new(),
            by_reason: BTreeMap::new(),
            capable: 0,
            first: None,
            first_fix: None,
            is_interrupted: false,
            quality: Quality::default(),
            angles: Default::default(),
            baselines: BTreeMap::new(),
        }
    }

    /// The run ended before its input.
    pub(crate) fn interrupt(&mut self) {
        self.is_interrupted = true;
    }

    /// Takes one row into account; `capable`: it had enough input to be fixed.
    pub(crate) fn add(&mut self, row: &EpochSolution, capable: bool) {
        self.epochs += 1;
        self.quality.add(row);
        *self.by_status.entry(row.status).or_default() += 1;
        if let Some(reason) = row.reason {
            *self.by_reason.entry(reason).or_default() += 1;
        }
        self.first.get_or_insert(row.time);
        self.capable += u64::from(capable);
        if row.status != Status::Fixed {
            return;
        }
        self.first_fix.get_or_insert(row.time);
        if let Some(attitude) = &row.attitude {
            self.add_angles(attitude);
        }
        row.baselines.iter().for_each(|baseline| self.add_baseline(baseline));
    }

    fn add_angles(&mut self, attitude: &AttitudeEstimate) {
        let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
        for (moments, angle) in self.angles.iter_mut().zip(angles) {
            if let Some(angle) = angle {
                moments.add_angle_deg(angle.to_degrees());
            }
        }
    }

    fn add_baseline(&mut self, baseline: &BaselineEstimate) {
        let moments = self.baselines.entry((baseline.base, baseline.rover)).or_default();
        let vector = baseline.baseline_m.xyz();
        let components = [vector.x, vector.y, vector.z, vector.norm()];
        moments.iter_mut().zip(components).for_each(|(moments, value)| moments.add(value));
    }

    /// Name and moments of everything that has a value, by name.
    fn moments(&self) -> BTreeMap<String, Moments> {
        let angles = ANGLES.iter().zip(self.angles).map(|(name, m)| ((*name).to_owned(), m));
        let baselines = self.baselines.iter().flat_map(|((base, rover), moments)| {
            let pair = format!("{}-{}", self.antennas[*base], self.antennas[*rover]);
            COMPONENTS.iter().zip(moments).map(move |(name, m)| (format!("{pair} {name}"), *m))
        });
        angles.chain(baselines).filter(|(_, moments)| moments.count > 0.0).collect()
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

    /// Fixed rows over rows in which two antennas share at least four satellites.
    pub(crate) fn fix_rate(&self) -> Option<f64> {
        (self.capable > 0).then(|| self.fixed() as f64 / self.capable as f64)
    }

    /// Everything for the file.
    pub(crate) fn file<'a>(
        &self,
        configuration: &str,
        damage: &'a [Damage],
        wall_s: f64,
    ) -> SummaryFile<'a> {
        let mut hasher = DefaultHasher::new();
        configuration.hash(&mut hasher);
        let moments = self.moments();
        SummaryFile {
            version: env!("CARGO_PKG_VERSION"),
            configuration_hash: format!("{:016x}", hasher.finish()),
            epochs: self.epochs,
            fixed: self.fixed(),
            float: self.count(Status::Float),
            lost: self.count(Status::Lost),
            inconsistent: self.count(Status::Inconsistent),
            not_capable: self.count(Status::NotCapable),
            fix_rate: self.fix_rate(),
            time_to_first_fix_s: self.first_fix.zip(self.first).map(|(fix, first)| fix - first),
            mean: moments.iter().map(|(name, m)| (name.clone(), m.mean(name))).collect(),
            std: moments.iter().map(|(name, m)| (name.clone(), m.std())).collect(),
            reasons: self.reasons(),
            damage,
            wall_s,
            epochs_per_s: self.epochs as f64 / wall_s.max(1e-9),
            interrupted: self.is_interrupted,
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
        if let Some(rate) = self.fix_rate() {
            rows.push(["fix rate".to_owned(), format!("{:.2} %", 100.0 * rate)]);
        }
        rows
    }

    /// Name, mean and standard deviation of everything that has a value.
    pub(crate) fn means(&self) -> Vec<[String; 3]> {
        let row = |(name, m): (String, Moments)| {
            let (mean, std) = (m.mean(&name), m.std());
            [name, format!("{mean:.4}"), format!("{std:.4}")]
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
        if let Some(rate) = self.fix_rate() {
            lines.push(format!("fix rate {:.2} %", 100.0 * rate));
        }
        if !self.by_reason.is_empty() {
            let mut reasons: Vec<_> = self.reasons().into_iter().collect();
            reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
            let words: Vec<_> =
                reasons.iter().map(|(word, count)| format!("{word} {count}")).collect();
            lines.push(format!("not fixed because: {}", words.join(", ")));
        }
        lines.extend(self.quality.lines());
        // Where a body turns, its angles and the directions of its baselines have no mean; lengths have.
        let is_turning = self.quality.is_turning(self.angles[0].std());
        for (name, m) in
            self.moments().iter().filter(|(n, _)| !is_turning || n.ends_with("length_m"))
        {
            lines.push(format!("{name:<24} mean {:>11.4}  std {:>9.4}", m.mean(name), m.std()));
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

    fn mean(&self, name: &str) -> f64 {
        if name == "heading_deg" { self.mean.rem_euclid(360.0) } else { self.mean }
    }

    fn std(&self) -> f64 {
        if self.count < 2.0 { 0.0 } else { (self.squares / (self.count - 1.0)).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_around_north_have_their_mean_there() {
        let mut moments = Moments::default();
        for heading in [359.0, 1.0, 358.0, 2.0] {
            moments.add_angle_deg(heading);
        }
        assert!(moments.mean("heading_deg") < 1e-9 || moments.mean("heading_deg") > 360.0 - 1e-9);
        assert!((moments.std() - (10.0f64 / 3.0).sqrt()).abs() < 1e-12);
    }
}
