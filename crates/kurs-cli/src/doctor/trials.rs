//! The sample solved in several ways.

use std::collections::{BTreeMap, BTreeSet};

use kurs::antenna_calibration::MountedAntenna;
use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::ephemeris::NavigationData;
use kurs::frames::Vector;
use kurs::observation::ArrayEpoch;
use kurs::signal::{Band, System};
use kurs::solution::{EpochSolution, LeftOut, Reason, Status};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use serde::Serialize;

use super::sample::Sample;

/// Arrays thinner than this are flat: their mirror image is themselves, turned.
const MIN_THICKNESS_M: f64 = 0.03;

/// A way to solve the sample, and the rows of its judged epochs.
pub(super) struct Trial {
    pub(super) name: String,
    pub(super) rows: Vec<EpochSolution>,
}

/// Everything that was tried.
pub(super) struct Trials {
    pub(super) configured: Trial,
    /// Nothing known of the geometry.
    pub(super) free: Trial,
    /// With the known array in the search, where the configuration does without.
    pub(super) with_array: Option<Trial>,
    /// Without one system each.
    pub(super) without_system: Vec<(System, Trial)>,
    /// Without one antenna each, if three or more are there.
    pub(super) without_antenna: Vec<(usize, Trial)>,
    /// With the mirror image of the known array, where that is another array.
    pub(super) mirrored: Option<Trial>,
}

/// A trial in `doctor.json`.
#[derive(Serialize)]
pub(super) struct TrialRow {
    name: String,
    fixed: usize,
    float: usize,
    inconsistent: usize,
    lost: usize,
    reasons: BTreeMap<&'static str, usize>,
}

impl Trials {
    /// Solves the sample as configured and in the other ways.
    pub(super) fn run(
        settings: &Settings,
        navigation: &NavigationData,
        mounts: &[Option<MountedAntenna>],
        sample: &Sample,
        names: &[String],
    ) -> Self {
        let solve = |name: String, settings: &Settings, epochs: &[ArrayEpoch]| {
            let engine = Engine::new(settings.clone(), navigation.clone());
            let rows = engine.map_or_else(
                |_| Vec::new(),
                |engine| {
                    let mut engine = engine.with_phase_centers(mounts.to_vec());
                    sample.rows_judged(epochs.iter().map(|epoch| engine.push(epoch))).collect()
                },
            );
            Trial { name, rows }
        };
        let settings = Settings { residuals: true, ..settings.clone() };
        let free = Settings { array: None, constraint: Constraint::None, ..settings.clone() };

        let bands = bands(sample, &settings);
        let systems: Vec<System> =
            System::ALL.into_iter().filter(|s| bands.iter().any(|b| b.system == *s)).collect();
        let several = if systems.len() > 1 { systems } else { Vec::new() };
        let without_system = several.into_par_iter().map(|system| {
            let others = bands.iter().copied().filter(|band| band.system != system).collect();
            let settings = Settings { bands: Some(others), ..settings.clone() };
            let name = format!("without {system}");
            (system, solve(name, &settings, &sample.epochs))
        });
        let removable = if names.len() > 2 { names.len() } else { 0 };
        let without_antenna = (0..removable).into_par_iter().map(|antenna| {
            let mut epochs = sample.epochs.clone();
            for epoch in &mut epochs {
                epoch.antennas[antenna] = None;
            }
            (antenna, solve(format!("without {}", names[antenna]), &free, &epochs))
        });
        let mirrored = settings.array.as_ref().and_then(mirror_image).map(|image| {
            let settings = Settings { array: Some(image), ..settings.clone() };
            solve("mirror image".into(), &settings, &sample.epochs)
        });
        let with_array = (settings.array.is_some() && settings.constraint == Constraint::None)
            .then(|| {
                let settings = Settings { constraint: Constraint::Array, ..settings.clone() };
                solve("geometry known".into(), &settings, &sample.epochs)
            });
        Self {
            mirrored,
            with_array,
            without_system: without_system.collect(),
            without_antenna: without_antenna.collect(),
            configured: solve("as configured".into(), &settings, &sample.epochs),
            free: solve("geometry unknown".into(), &free, &sample.epochs),
        }
    }

    fn all(&self) -> impl Iterator<Item = &Trial> {
        [&self.configured, &self.free]
            .into_iter()
            .chain(&self.with_array)
            .chain(self.without_system.iter().map(|(_, trial)| trial))
            .chain(self.without_antenna.iter().map(|(_, trial)| trial))
            .chain(&self.mirrored)
    }

    /// For `doctor.json`.
    pub(super) fn rows(&self) -> Vec<TrialRow> {
        let row = |trial: &Trial| TrialRow {
            name: trial.name.clone(),
            fixed: trial.count(Status::Fixed),
            float: trial.count(Status::Float),
            inconsistent: trial.count(Status::Inconsistent),
            lost: trial.count(Status::Lost),
            reasons: trial.reasons(),
        };
        self.all().map(row).collect()
    }

    /// For the terminal.
    pub(super) fn text(&self) -> String {
        let width = self.all().map(|trial| trial.name.len()).max().unwrap_or(0);
        let line = |trial: &Trial| {
            let reasons: Vec<String> =
                trial.reasons().iter().map(|(word, count)| format!("{word} {count}")).collect();
            let share = 100.0 * trial.share(Status::Fixed);
            format!("{:width$}  {share:5.1} % fixed  {}\n", trial.name, reasons.join(", "))
        };
        self.all().map(line).collect()
    }
}

impl Trial {
    pub(super) fn count(&self, status: Status) -> usize {
        self.rows.iter().filter(|row| row.status() == status).count()
    }

    /// Share of the epochs.
    pub(super) fn share(&self, status: Status) -> f64 {
        self.count(status) as f64 / self.rows.len().max(1) as f64
    }

    pub(super) fn reasons(&self) -> BTreeMap<&'static str, usize> {
        let mut reasons = BTreeMap::new();
        for reason in self.rows.iter().filter_map(EpochSolution::reason) {
            *reasons.entry(reason.word()).or_default() += 1;
        }
        reasons
    }

    /// Share of the epochs whose integers do without this.
    pub(super) fn share_without(&self, left_out: LeftOut) -> f64 {
        self.share_where(|row| left_out_of(row) == Some(left_out))
    }

    /// Share of the epochs whose integers do without some satellite at this antenna.
    pub(super) fn share_without_link(&self, of: usize) -> f64 {
        let is_link = |left_out| matches!(left_out, LeftOut::Link { antenna, .. } if antenna == of);
        self.share_where(|row| left_out_of(row).is_some_and(is_link))
    }

    /// Share of the epochs in which an antenna was not sampled together with the others.
    pub(super) fn share_apart(&self) -> f64 {
        let apart = Reason::TimeMismatch;
        self.share_where(|row| {
            row.reason() == Some(apart) || row.idle_antennas.iter().any(|(_, why)| *why == apart)
        })
    }

    fn share_where(&self, holds: impl Fn(&EpochSolution) -> bool) -> f64 {
        let rows = self.rows.iter().filter(|row| holds(row));
        rows.count() as f64 / self.rows.len().max(1) as f64
    }

    /// The antenna and the reason for which it most often had no part, and the number of epochs.
    pub(super) fn most_idle(&self) -> Option<((usize, Reason), usize)> {
        let mut counts = BTreeMap::new();
        for idle in self.rows.iter().flat_map(|row| &row.idle_antennas) {
            *counts.entry(*idle).or_default() += 1;
        }
        counts.into_iter().max_by_key(|(_, count)| *count)
    }

    /// Share of the epochs that have this reason.
    pub(super) fn share_of_reason(&self, word: &str) -> f64 {
        *self.reasons().get(word).unwrap_or(&0) as f64 / self.rows.len().max(1) as f64
    }

    /// Median of the phase residuals of the fixed epochs, m; infinite without any.
    pub(super) fn residual_m(&self) -> f64 {
        let fixed = self.rows.iter().filter(|row| row.is_fixed());
        let mut residuals: Vec<f64> = fixed.filter_map(|row| row.residual_rms_m).collect();
        residuals.sort_by(f64::total_cmp);
        residuals.get(residuals.len() / 2).copied().unwrap_or(f64::INFINITY)
    }
}

/// The array with right and left exchanged; `None` where that is the same array turned: antennas in
/// one plane.
fn mirror_image(array: &AntennaArray) -> Option<AntennaArray> {
    let places: Vec<Vector3<f64>> = array.positions_m().iter().map(Vector::xyz).collect();
    let centre = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
    let spread: Matrix3<f64> = places.iter().map(|p| (p - centre) * (p - centre).transpose()).sum();
    let thickness_m = spread.symmetric_eigenvalues().min().max(0.0).sqrt();
    let image = places.iter().map(|p| Vector::new(p.x, -p.y, p.z)).collect();
    AntennaArray::new(image).ok().filter(|_| thickness_m > MIN_THICKNESS_M)
}

/// Bands that two antennas have and that are wanted.
pub(super) fn bands(sample: &Sample, settings: &Settings) -> BTreeSet<Band> {
    let observations = sample.epochs.iter().flat_map(|e| e.antennas.iter().flatten());
    let bands = observations.flat_map(|a| a.observations.iter().map(|o| o.signal.band));
    bands.filter(|band| settings.wants(*band)).collect()
}

/// What the integers of a row do without.
fn left_out_of(row: &EpochSolution) -> Option<LeftOut> {
    row.integers.as_ref()?.left_out
}
