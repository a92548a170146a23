//! Gauss-Newton for the position, each system's clock eliminated, and what its residuals say.

use nalgebra::{Matrix3, Vector3};

use super::ranges::{Modelled, Surroundings};
use super::{Exclusion, NoPosition, PointSettings, PointSolution};
use crate::ephemeris::IonosphereParameters;
use crate::frames::Vector;
use crate::point::Tracked;
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite, System};
use crate::sky::{Dop, Horizon, View};
use crate::time::GpsTime;

const SYSTEMS: usize = System::ALL.len();

/// From the Earth's centre five steps are enough; faulty observations may need a few more.
const MAX_ITERATIONS: usize = 15;
/// After a step `d` below this nothing but the linear part of ranges and troposphere changes: ranges `ρ` bend by
/// `d²/2ρ`, 2.5 µm after ten metres, as far as code leads away from the last epoch's position.
pub(super) const CONVERGED_M: f64 = 10.0;
/// After a step below this the position is good to some tens of metres, the atmosphere ignored:
/// enough for elevations, weights and delays.
const ROUGH_M: f64 = 1e3;
/// Farther from the Earth's centre than any receiver below the satellites' orbits.
const MAX_RADIUS_M: f64 = 2.0e7;
/// A residual of this many standard deviations does not fit the others: if the noise is Gaussian and
/// as large as its weights say, 6·10⁻⁷ of the good satellites are excluded. Noise of code is not
/// Gaussian, but a satellite so far off does not help the position either.
pub(super) const SUSPECT: f64 = 5.0;
/// All residuals together do not fit their weights from this multiple of the expected size on.
const INCONSISTENT_RMS: f64 = 3.0;
/// Degrees of freedom that the assumed noise of code counts for beside an epoch's residuals: between receivers and
/// skies its variance differs by a factor of 1.6 (1 sigma), as a χ² of eight degrees does.
const NOISE_PRIOR: f64 = 8.0;
/// A residual whose variance is a smaller share of its observation's checks nothing.
const MIN_CHECKED: f64 = 1e-6;

/// One satellite's part in the least squares at the current position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    line_of_sight: Vector3<f64>,
    /// Derivative of the computed range with its sign changed: the line of sight, and the change of
    /// the tropospheric delay with height.
    approach: Vector3<f64>,
    system: usize,
    pub(super) misclosure_m: f64,
    pub(super) weight: f64,
}

/// The state of the iteration.
#[derive(Clone)]
pub(super) struct PositionFit<'a> {
    pub(super) tracked: &'a [Tracked],
    pub(super) ionosphere: &'a IonosphereParameters,
    pub(super) time: GpsTime,
    pub(super) settings: &'a PointSettings,
    pub(super) excluded: Vec<Satellite>,
    pub(super) position_m: Vector3<f64>,
    /// Clock of each system present, m.
    clocks_m: [f64; SYSTEMS],
    /// Whether the position is near enough for directions to mean something.
    pub(super) near: bool,
    pub(super) rows: Vec<(Row, Satellite)>,
    /// Weighted mean of each system's rows.
    means: [Mean; SYSTEMS],
    /// Inverse of the normal matrix of the position.
    cofactor: Matrix3<f64>,
}

/// Weighted mean of the rows of one system: what its clock takes up.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mean {
    weight: f64,
    line_of_sight: Vector3<f64>,
    misclosure_m: f64,
}

impl<'a> PositionFit<'a> {
    pub(super) fn new(
        tracked: &'a [Tracked],
        ionosphere: &'a IonosphereParameters,
        time: GpsTime,
        settings: &'a PointSettings,
    ) -> Self {
        Self {
            tracked,
            ionosphere,
            time,
            settings,
            excluded: Vec::new(),
            position_m: Vector3::zeros(),
            clocks_m: [0.0; SYSTEMS],
            near: false,
            rows: Vec::with_capacity(tracked.len()),
            means: [Mean::default(); SYSTEMS],
            cofactor: Matrix3::zeros(),
        }
    }

    /// The same observations but those of `excluded`, nothing known of the place.
    pub(super) fn at_the_centre(&self, excluded: Vec<Satellite>) -> Self {
        Self { excluded, ..Self::new(self.tracked, self.ionosphere, self.time, self.settings) }
    }

    /// Gauss-Newton from where it stands until the step is small, by ranges with their atmosphere if that is near.
    pub(super) fn converge(&mut self) -> Result<(), NoPosition> {
        let small_m = if self.near { CONVERGED_M } else { ROUGH_M };
        for _ in 0..MAX_ITERATIONS {
            self.form_rows();
            let step_m = self.step()?;
            if step_m < small_m {
                self.step()?;
                let plausible = self.position_m.norm() < MAX_RADIUS_M;
                return if plausible { Ok(()) } else { Err(NoPosition::Diverged) };
            }
        }
        Err(NoPosition::Diverged)
    }

    /// Misclosures `P_measured − P_computed` and weights at the current position.
    pub(super) fn form_rows(&mut self) {
        self.rows.clear();
        let antenna_m = Vector::from_xyz(self.position_m);
        let surroundings = self.near.then(|| Surroundings::at(antenna_m, self.settings));
        for satellite in self.tracked.iter().filter(|t| !self.excluded.contains(&t.satellite)) {
            let view = View::new(&satellite.state, antenna_m);
            let system = satellite.satellite.system as usize;
            let modelled = match &surroundings {
                Some(here) => here.model(satellite, &view, self),
                None => Some(Modelled::rough(satellite)),
            };
            let Some(modelled) = modelled else { continue };
            let Modelled { pseudorange_m, delay_m, delay_gradient, variance_m2 } = modelled;
            let line_of_sight = view.line_of_sight.xyz();
            let row = Row {
                line_of_sight,
                approach: line_of_sight - delay_gradient,
                system,
                misclosure_m: pseudorange_m - self.computed_m(satellite, &view, delay_m),
                weight: 1.0 / variance_m2,
            };
            self.rows.push((row, satellite.satellite));
        }
    }

    /// One step `(Gᵀ W G)⁻¹ Gᵀ W (P_measured − P_computed)`, after which the misclosures are residuals; returns its
    /// length in space.
    pub(super) fn step(&mut self) -> Result<f64, NoPosition> {
        self.take_means();
        let need = 3 + self.systems_present();
        if self.rows.len() < need.max(4) {
            return Err(NoPosition::FewSatellites { have: self.rows.len(), need: need.max(4) });
        }
        // Rows less the mean of their system: −(u − ū) dx = l − l̄
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (row, _) in &self.rows {
            let g = self.centred(row);
            let weighted = row.weight * g;
            normal += weighted * g.transpose();
            right += (row.misclosure_m - self.means[row.system].misclosure_m) * weighted;
        }
        self.cofactor = normal.cholesky().ok_or(NoPosition::Singular)?.inverse();
        let step = self.cofactor * right;
        self.position_m += step;
        // c δt = l̄ + ū dx
        for (clock_m, mean) in self.clocks_m.iter_mut().zip(&self.means) {
            *clock_m += mean.misclosure_m + mean.line_of_sight.dot(&step);
        }
        // v = l − l̄ + (a − ū) dx
        for (row, _) in &mut self.rows {
            let mean = &self.means[row.system];
            row.misclosure_m -= mean.misclosure_m + (mean.line_of_sight - row.approach).dot(&step);
        }
        let length_m = step.norm();
        if length_m.is_finite() { Ok(length_m) } else { Err(NoPosition::Diverged) }
    }

    fn take_means(&mut self) {
        self.means = [Mean::default(); SYSTEMS];
        for (row, _) in &self.rows {
            let mean = &mut self.means[row.system];
            mean.weight += row.weight;
            mean.line_of_sight += row.weight * row.line_of_sight;
            mean.misclosure_m += row.weight * row.misclosure_m;
        }
        for mean in self.means.iter_mut().filter(|mean| mean.weight > 0.0) {
            mean.line_of_sight /= mean.weight;
            mean.misclosure_m /= mean.weight;
        }
    }

    /// Design row of the position with the clock eliminated.
    fn centred(&self, row: &Row) -> Vector3<f64> {
        self.means[row.system].line_of_sight - row.line_of_sight
    }

    fn systems_present(&self) -> usize {
        self.means.iter().filter(|mean| mean.weight > 0.0).count()
    }

    pub(super) fn redundancy(&self) -> usize {
        self.rows.len().saturating_sub(3 + self.systems_present())
    }

    pub(super) fn unit_weight_rms(&self) -> f64 {
        let sum: f64 = self.rows.iter().map(|(r, _)| r.weight * r.misclosure_m.powi(2)).sum();
        match self.redundancy() {
            0 => 0.0,
            redundancy => (sum / redundancy as f64).sqrt(),
        }
    }

    /// Whether no residual points to a faulty satellite, or there is no redundancy to tell.
    pub(super) fn is_consistent(&self) -> bool {
        let fits = |(row, _): &(Row, Satellite)| self.normalised(row) < SUSPECT;
        self.redundancy() == 0
            || (self.unit_weight_rms() < INCONSISTENT_RMS && self.rows.iter().all(fits))
    }

    /// Factor that makes the variances agree with unexplained residuals. Code that is noisier than
    /// assumed counts beside what was assumed, `(ν₀ + vᵀPv)/(ν₀ + ν)`; where satellites contradict each
    /// other, half against half, nobody knows whom to believe, and the residuals alone count.
    fn misfit_factor(&self) -> f64 {
        let redundancy = self.redundancy() as f64;
        let square = self.unit_weight_rms().powi(2);
        let factor = match self.is_consistent() {
            true => (NOISE_PRIOR + square * redundancy) / (NOISE_PRIOR + redundancy),
            false => square,
        };
        factor.max(1.0)
    }

    /// A residual over its standard deviation; zero for a satellite that the position rests on alone.
    fn normalised(&self, row: &Row) -> f64 {
        let variance_m2 = self.residual_covariance_m2(row, row);
        let checked = row.weight * variance_m2 > MIN_CHECKED;
        if checked { row.misclosure_m.abs() / variance_m2.sqrt() } else { 0.0 }
    }

    /// Covariance of two residuals: `δᵢⱼ σ² − 1/Σw − gᵢ Q gⱼᵀ`, the second term within a system.
    fn residual_covariance_m2(&self, a: &Row, b: &Row) -> f64 {
        let own = if core::ptr::eq(a, b) { 1.0 / a.weight } else { 0.0 };
        let clock = if a.system == b.system { 1.0 / self.means[a.system].weight } else { 0.0 };
        own - clock - (self.centred(a).transpose() * self.cofactor * self.centred(b))[0]
    }

    /// By how much the sum of squares falls without one row (given twice) or two:
    /// `v_Fᵀ C_FF⁻¹ v_F` with the covariance `C` of the residuals; zero if it cannot be told.
    pub(super) fn explained(&self, [i, j]: [usize; 2]) -> f64 {
        let (a, b) = (&self.rows[i].0, &self.rows[j].0);
        let (v_a, v_b) = (a.misclosure_m, b.misclosure_m);
        let (c_aa, c_bb) = (self.residual_covariance_m2(a, a), self.residual_covariance_m2(b, b));
        if i == j {
            return self.normalised(a).powi(2);
        }
        let c_ab = self.residual_covariance_m2(a, b);
        let determinant = c_aa * c_bb - c_ab * c_ab;
        if determinant * a.weight * b.weight < MIN_CHECKED {
            return 0.0;
        }
        (v_a * v_a * c_bb - 2.0 * v_a * v_b * c_ab + v_b * v_b * c_aa) / determinant
    }

    /// The fit without one row (given twice) or two; `None` if the others could not show that one
    /// of them is faulty, or there is no position.
    pub(super) fn without(&self, rows: [usize; 2]) -> Option<Self> {
        let mut fit = self.clone();
        fit.excluded.extend(rows.map(|row| self.rows[row].1));
        fit.excluded.dedup();
        fit.converge().ok()?;
        (fit.redundancy() > 0).then_some(fit)
    }

    /// What the excluded satellites' code says against the others, m.
    pub(super) fn exclusions(&self) -> Vec<Exclusion> {
        if self.excluded.is_empty() {
            return Vec::new();
        }
        let antenna_m = Vector::from_xyz(self.position_m);
        let excluded = self.tracked.iter().filter(|t| self.excluded.contains(&t.satellite));
        let surroundings = Surroundings::at(antenna_m, self.settings);
        let residual = |satellite: &Tracked| {
            let view = View::new(&satellite.state, antenna_m);
            let modelled = surroundings.model(satellite, &view, self)?;
            Some(modelled.pseudorange_m - self.computed_m(satellite, &view, modelled.delay_m))
        };
        excluded
            .map(|t| Exclusion { satellite: t.satellite, residual_m: residual(t).unwrap_or(0.0) })
            .collect()
    }

    /// `|xₛ − x| + c δt − c δtₛ + T` with the clock of the satellite's system.
    fn computed_m(&self, satellite: &Tracked, view: &View, delay_m: f64) -> f64 {
        view.range_m + self.clocks_m[satellite.satellite.system as usize]
            - SPEED_OF_LIGHT_MPS * satellite.state.clock_s
            + delay_m
    }

    pub(super) fn solution(&self) -> Result<PointSolution, NoPosition> {
        let exclusions = self.exclusions();
        let position_m = Vector::from_xyz(self.position_m);
        let horizon = Horizon::at(position_m);
        let sky = self.rows.iter().map(|(row, _)| Vector::from_xyz(row.line_of_sight));
        let dop = Dop::new(sky, &horizon).ok_or(NoPosition::Singular)?;
        let present = |k: &usize| self.means[*k].weight > 0.0;
        let first = (0..SYSTEMS).find(present).ok_or(NoPosition::Singular)?;
        let clock_m = self.clocks_m[first];
        let inter_system_m =
            core::array::from_fn(|k| present(&k).then(|| self.clocks_m[k] - clock_m));
        Ok(PointSolution {
            position_m,
            covariance_m2: self.cofactor * self.misfit_factor(),
            clock_m,
            inter_system_m,
            dop,
            horizon,
            satellites: self.rows.len(),
            exclusions,
            unit_weight_rms: self.unit_weight_rms(),
        })
    }
}
