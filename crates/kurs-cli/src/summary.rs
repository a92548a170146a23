//! `summary.json`: what a run did, in numbers.

use std::collections::BTreeMap;
use std::fmt;
use std::hash::{DefaultHasher, Hash, Hasher};

use kurs::solution::{EpochSolution, Status};
use kurs::time::GpsTime;
use serde::Serialize;

/// Counts and statistics, gathered row by row.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    epochs: u64,
    by_status: BTreeMap<&'static str, u64>,
    reasons: BTreeMap<&'static str, u64>,
    capable: u64,
    first: Option<GpsTime>,
    first_fix: Option<GpsTime>,
    moments: BTreeMap<String, Moments>,
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
    mean: BTreeMap<&'a str, f64>,
    std: BTreeMap<&'a str, f64>,
    reasons: &'a BTreeMap<&'static str, u64>,
    damage: &'a [Damage],
    wall_s: f64,
    epochs_per_s: f64,
}

impl Summary {
    /// Takes one row into account; `capable`: it had enough input to be fixed.
    pub(crate) fn add(&mut self, row: &EpochSolution, capable: bool, antennas: &[String]) {
        self.epochs += 1;
        *self.by_status.entry(row.status.word()).or_default() += 1;
        if let Some(reason) = row.reason {
            *self.reasons.entry(reason.word()).or_default() += 1;
        }
        self.first.get_or_insert(row.time);
        self.capable += u64::from(capable);
        if row.status != Status::Fixed {
            return;
        }
        self.first_fix.get_or_insert(row.time);
        if let Some(attitude) = &row.attitude {
            let angles = [
                ("heading_deg", attitude.heading_rad),
                ("pitch_deg", attitude.pitch_rad),
                ("roll_deg", attitude.roll_rad),
            ];
            for (name, angle) in angles {
                if let Some(angle) = angle {
                    self.moment(name).add_angle_deg(angle.to_degrees());
                }
            }
        }
        for baseline in &row.baselines {
            let pair = format!("{}-{}", antennas[baseline.base], antennas[baseline.rover]);
            let vector = baseline.baseline_m.xyz();
            let components = [
                ("east_m", vector.x),
                ("north_m", vector.y),
                ("up_m", vector.z),
                ("length_m", vector.norm()),
            ];
            for (name, value) in components {
                self.moment(&format!("{pair} {name}")).add(value);
            }
        }
    }

    fn moment(&mut self, name: &str) -> &mut Moments {
        if !self.moments.contains_key(name) {
            self.moments.insert(name.to_owned(), Moments::default());
        }
        self.moments.get_mut(name).expect("inserted above")
    }

    /// Number of rows with a status.
    pub(crate) fn count(&self, status: Status) -> u64 {
        self.by_status.get(status.word()).copied().unwrap_or(0)
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
        self.reasons.iter().max_by_key(|(_, count)| **count).map(|(word, _)| *word)
    }

    /// Fixed rows over rows in which two antennas share at least four satellites.
    pub(crate) fn fix_rate(&self) -> Option<f64> {
        (self.capable > 0).then(|| self.fixed() as f64 / self.capable as f64)
    }

    /// Everything for the file.
    pub(crate) fn file<'a>(
        &'a self,
        configuration: &str,
        damage: &'a [Damage],
        wall_s: f64,
    ) -> SummaryFile<'a> {
        let mut hasher = DefaultHasher::new();
        configuration.hash(&mut hasher);
        let moments = || self.moments.iter();
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
            mean: moments().map(|(name, m)| (name.as_str(), m.mean(name))).collect(),
            std: moments().map(|(name, m)| (name.as_str(), m.std())).collect(),
            reasons: &self.reasons,
            damage,
            wall_s,
            epochs_per_s: self.epochs as f64 / wall_s.max(1e-9),
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
        for (name, m) in &self.moments {
            rows.push([name.clone(), format!("mean {:.4}, std {:.4}", m.mean(name), m.std())]);
        }
        rows
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
        if !self.reasons.is_empty() {
            let mut reasons: Vec<_> = self.reasons.iter().collect();
            reasons.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
            let words: Vec<_> =
                reasons.iter().map(|(word, count)| format!("{word} {count}")).collect();
            lines.push(format!("not fixed because: {}", words.join(", ")));
        }
        for (name, m) in &self.moments {
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
