//! Iterated weighted least squares for position, clock and inter-system biases.
//!
//! Model (equations 1 to 14 of `docs/papers/004-three-antennas.md`, corrected), for satellite `s` of system `k`:
//!
//! `P = |xₛ − x| + c (δt + Bₖ) − c δtₛ + I + T`,    `B` of the first system present = 0
//!
//! with the weights `1/σ²` of the noise model, the broadcast orbit and what remains of the
//! atmosphere. Every row has one clock, that of its system: subtracting the weighted mean of each
//! system from its rows leaves three unknowns.

use nalgebra::{Matrix3, Vector3};

use super::track::{Code, Tracked};
use crate::atmosphere::{Troposphere, ionosphere_m};
use crate::ephemeris::{IonosphereParameters, NavigationData};
use crate::frames::{Ecef, Vector};
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite, System};
use crate::sky::{Dop, Horizon, NoiseModel, View};
use crate::time::GpsTime;

const SYSTEMS: usize = System::ALL.len();

/// From the Earth's centre five steps are enough; faulty observations may need a few more.
const MAX_ITERATIONS: usize = 15;
/// A fraction of the noise of any code.
const SETTLED_M: f64 = 0.1;
/// Steps with weights that fall with the residuals: each takes away a good part of what a fault has left.
const ROBUST_ITERATIONS: usize = 60;
/// After a step `d` below this nothing but the linear part of ranges and troposphere changes: ranges `ρ` bend by `d²/2ρ`,
/// 2.5 µm after ten metres, as far as code leads away from the last epoch's position.
const CONVERGED_M: f64 = 10.0;
/// After a step below this the position is good to some tens of metres, the atmosphere ignored:
/// enough for elevations, weights and delays.
const ROUGH_M: f64 = 1e3;
/// Standard deviation of such ranges: troposphere and ionosphere at the horizon.
const ROUGH_SD_M: f64 = 100.0;
/// A residual this large is a wrong bit of a range or an ephemeris, not propagation.
const GROSS_M: f64 = SUSPECT * ROUGH_SD_M;
/// Code this far off is a reflection, an imitation, or the signal of a satellite whose orbit is wrong.
const USELESS_M: f64 = 50.0;
/// Above this root mean square the starting point itself may be at fault: begin again from the
/// Earth's centre.
const GROSS_RMS: f64 = 30.0;
/// Farther from the Earth's centre than any receiver below the satellites' orbits.
const MAX_RADIUS_M: f64 = 2.0e7;
/// No model knows the ionosphere better than this, m.
const MIN_IONOSPHERE_SD_M: f64 = 0.1;
/// A residual of this many standard deviations does not fit the others: if the noise is Gaussian and
/// as large as its weights say, 6·10⁻⁷ of the good satellites are excluded. Noise of code is not
/// Gaussian, but a satellite so far off does not help the position either.
const SUSPECT: f64 = 5.0;
/// All residuals together do not fit their weights from this multiple of the expected size on.
const INCONSISTENT_RMS: f64 = 3.0;
/// Degrees of freedom that the assumed noise of code counts for beside an epoch's residuals: between receivers and skies its
/// variance differs by a factor of 1.6 (1 sigma), as a χ² of eight degrees does.
const NOISE_PRIOR: f64 = 8.0;
/// A residual whose variance is a smaller share of its observation's checks nothing.
const MIN_CHECKED: f64 = 1e-6;
/// How many of the satellites that explain the misfit best, and of the pairs, are left out on trial.
const TRIALS: usize = 3;
/// Probability that a faulty satellite agrees with the others by chance, faults being spread over
/// twenty times what is allowed to noise.
const CHANCE: f64 = 0.05;
/// Largest expected number of chance agreements among all ways to exclude as many satellites.
const MAX_BY_CHANCE: f64 = 0.01;

/// What the position depends on besides the observations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointSettings {
    /// Satellites below are ignored.
    pub elevation_mask_rad: f64,
    /// Code noise.
    pub noise: NoiseModel,
}

/// A satellite that was left out because its residual did not fit the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exclusion {
    /// The satellite.
    pub satellite: Satellite,
    /// Its residual against the others, m.
    pub residual_m: f64,
}

impl Exclusion {
    /// Whether nothing of the satellite is of use, not its phase either: what is tracked is a reflection or an imitation, or
    /// its orbit is wrong, or the time at which it was looked up.
    #[must_use]
    pub fn is_useless(&self) -> bool {
        self.residual_m.abs() > USELESS_M
    }
}

/// Position, clock and what they rest on.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSolution {
    /// Antenna, ECEF, m.
    pub position_m: Vector<Ecef>,
    /// Covariance of the position, ECEF, m²; grown with the residuals where they contradict each other.
    pub covariance_m2: Matrix3<f64>,
    /// Receiver clock against GPST by the first system present: tag − true time, times c, m.
    pub clock_m: f64,
    /// Further systems' clocks against that, m, in the order of [`System::ALL`].
    pub inter_system_m: [Option<f64>; SYSTEMS],
    /// Geometry of the satellites used.
    pub dop: Dop,
    /// Local level axes at the antenna.
    pub horizon: Horizon,
    /// Number of satellites used.
    pub satellites: usize,
    /// Satellites excluded as faulty.
    pub exclusions: Vec<Exclusion>,
    /// Root mean square of the code residuals over their standard deviations.
    pub unit_weight_rms: f64,
}

/// Why there is no position.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoPosition {
    /// Fewer satellites than unknowns.
    #[error("{have} satellites above the mask, {need} are needed")]
    FewSatellites {
        /// Usable satellites.
        have: usize,
        /// Unknowns: three coordinates and one clock for each system.
        need: usize,
    },
    /// The satellites stand so that they do not determine a position.
    #[error("the geometry of the satellites is singular")]
    Singular,
    /// The iteration does not settle, or settles far from the Earth.
    #[error("the iteration does not converge to a place near the Earth")]
    Diverged,
}

/// One satellite's part in the least squares at the current position.
#[derive(Debug, Clone, Copy)]
struct Row {
    line_of_sight: Vector3<f64>,
    /// Derivative of the computed range with its sign changed: the line of sight, and the change of
    /// the tropospheric delay with height.
    approach: Vector3<f64>,
    system: usize,
    misclosure_m: f64,
    weight: f64,
}

/// Solves for the antenna's position from the Earth's centre, and excludes faulty satellites.
///
/// # Errors
///
/// [`NoPosition`] when the satellites are too few, badly placed or contradictory.
pub fn solve(
    tracked: &[Tracked],
    navigation: &NavigationData,
    time: GpsTime,
    settings: &PointSettings,
) -> Result<PointSolution, NoPosition> {
    let mut fit = PositionFit::new(tracked, &navigation.ionosphere, time, settings);
    let converged = fit.converge();
    let mut fit = match converged {
        Ok(()) if fit.is_consistent() => fit,
        _ => without_gross_faults(&fit).unwrap_or(fit),
    };
    fit.near = true;
    solved(fit)
}

/// As [`solve`], from a place where the antenna is likely to be; where that leads nowhere or to gross contradictions, from the
/// Earth's centre.
///
/// # Errors
///
/// As [`solve`].
pub fn solve_near(
    tracked: &[Tracked],
    navigation: &NavigationData,
    time: GpsTime,
    settings: &PointSettings,
    near_m: Vector<Ecef>,
) -> Result<PointSolution, NoPosition> {
    let mut fit = PositionFit::new(tracked, &navigation.ionosphere, time, settings);
    (fit.position_m, fit.near) = (near_m.xyz(), true);
    match solved(fit) {
        Ok(solution) if solution.unit_weight_rms < GROSS_RMS => Ok(solution),
        contradictory => solve(tracked, navigation, time, settings).or(contradictory),
    }
}

fn solved(mut fit: PositionFit<'_>) -> Result<PointSolution, NoPosition> {
    fit.converge()?;
    if fit.is_consistent() {
        return fit.solution();
    }
    if let Some(explained) = without_faults(&fit) {
        return explained.solution();
    }
    let Some(central) = least_absolute(&fit) else { return fit.solution() };
    let apart_m = central.position_m - fit.position_m;
    if let Some(explained) = consensus(&fit, central) {
        return explained.solution();
    }
    // Unexplained misfit stays in the residuals. If the fits of least squares and of least sizes differ,
    // their separation is added to the covariance.
    let mut solution = fit.solution()?;
    solution.covariance_m2 += apart_m * apart_m.transpose();
    Ok(solution)
}

/// The rough fit without the satellites that are wrong by kilometres (a bit of a range or of an
/// ephemeris), if the others agree. They pull the position so far that elevations mean nothing, or
/// keep the iteration from its end, so they go first: by the least sum of absolute residuals, which
/// few outliers of any size hardly move. Where one still does, it is left out from the start.
fn without_gross_faults<'a>(whole: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    robust(whole.at_the_centre()).or_else(|| {
        let without = |(_, satellite): &(Row, Satellite)| {
            robust(PositionFit { excluded: vec![*satellite], ..whole.at_the_centre() })
        };
        whole.rows.iter().find_map(without)
    })
}

/// The rough fit of those that agree with the fit of least absolute residuals.
fn robust(fit: PositionFit<'_>) -> Option<PositionFit<'_>> {
    let fit = least_absolute(&fit)?;
    let wrong = fit.rows.iter().filter(|(row, _)| row.misclosure_m.abs() > GROSS_M);
    let wrong = wrong.map(|(_, satellite)| *satellite);
    let excluded = fit.excluded.iter().copied().chain(wrong).collect();
    let mut without = PositionFit { excluded, ..fit.at_the_centre() };
    without.converge().ok()?;
    let is_proven = without.redundancy() > 0 && without.is_consistent();
    // The reweighting may have stopped early and excluded good satellites too.
    let wrong = without.exclusions().into_iter().filter(|e| e.residual_m.abs() > GROSS_M);
    without.excluded = wrong.map(|exclusion| exclusion.satellite).collect();
    is_proven.then_some(without)
}

/// The fit of least absolute residuals, `min Σ |vᵢ|/σᵢ`, by least squares reweighted with the residuals
/// of the step before, `wᵢ ← wᵢ / max(1, |vᵢ|/σᵢ)`.
fn least_absolute<'a>(fit: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    let mut fit = fit.clone();
    for _ in 0..ROBUST_ITERATIONS {
        let before: Vec<f64> = fit.rows.iter().map(|(row, _)| row.misclosure_m).collect();
        fit.form_rows();
        for ((row, _), residual_m) in fit.rows.iter_mut().zip(before) {
            row.weight /= (residual_m.abs() * row.weight.sqrt()).max(1.0);
        }
        let settled_m = if fit.near { SETTLED_M } else { CONVERGED_M };
        if fit.step().ok()? < settled_m {
            break;
        }
    }
    Some(fit)
}

/// The best fit without one satellite, or else without two, if it is consistent. One fault can move
/// the position so that the residual of another satellite is the largest, and two can hide each
/// other: so every pair is judged by what the two together explain.
fn without_faults<'a>(whole: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    let indices = 0..whole.rows.len();
    let one = indices.clone().map(|i| [i, i]);
    let pairs = indices.flat_map(|i| (0..i).map(move |j| [i, j]));
    best(whole, one).or_else(|| best(whole, pairs))
}

/// The fit of those that agree with the one of least absolute residuals, if they are the majority and
/// hardly agree by chance.
fn consensus<'a>(whole: &PositionFit<'a>, central: PositionFit<'a>) -> Option<PositionFit<'a>> {
    let mut fit = central;
    // The reweighting may have stopped early and excluded good satellites too: the second round
    // brings them back.
    for _ in 0..2 {
        fit.excluded.clone_from(&whole.excluded);
        fit.form_rows();
        let contradicts =
            |(row, _): &&(Row, Satellite)| row.misclosure_m.abs() * row.weight.sqrt() > SUSPECT;
        let wrong = fit.rows.iter().filter(contradicts).map(|(_, satellite)| *satellite);
        fit.excluded.extend(wrong);
        fit.converge().ok()?;
    }
    let (kept, aside) = (fit.rows.len(), fit.excluded.len() - whole.excluded.len());
    // C(n, k) pʳ
    let ways: f64 = (1..=aside).map(|k| (kept + k) as f64 / k as f64).product();
    let by_chance = ways * CHANCE.powi(i32::try_from(fit.redundancy()).ok()?);
    (kept > aside && by_chance < MAX_BY_CHANCE && fit.is_consistent()).then_some(fit)
}

/// The consistent fit with the smallest residuals, of those without the rows that explain most.
fn best<'a>(
    whole: &PositionFit<'a>,
    faults: impl Iterator<Item = [usize; 2]>,
) -> Option<PositionFit<'a>> {
    let mut ranked: Vec<_> = faults.map(|rows| (whole.explained(rows), rows)).collect();
    ranked.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let trials = ranked.iter().take(TRIALS).filter_map(|(_, rows)| whole.without(*rows));
    let misfit = |fit: &PositionFit<'_>| fit.unit_weight_rms();
    trials.filter(PositionFit::is_consistent).min_by(|a, b| misfit(a).total_cmp(&misfit(b)))
}

/// The state of the iteration.
#[derive(Clone)]
struct PositionFit<'a> {
    tracked: &'a [Tracked],
    ionosphere: &'a IonosphereParameters,
    time: GpsTime,
    settings: &'a PointSettings,
    excluded: Vec<Satellite>,
    position_m: Vector3<f64>,
    /// Clock of each system present, m.
    clocks_m: [f64; SYSTEMS],
    /// Whether the position is near enough for directions to mean something.
    near: bool,
    rows: Vec<(Row, Satellite)>,
    /// Weighted mean of each system's rows.
    means: [Mean; SYSTEMS],
    /// Inverse of the normal matrix of the position.
    cofactor: Matrix3<f64>,
}

/// Weighted mean of the rows of one system: what its clock takes up.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    weight: f64,
    line_of_sight: Vector3<f64>,
    misclosure_m: f64,
}

impl<'a> PositionFit<'a> {
    fn new(
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

    /// The same observations, nothing known of the place.
    fn at_the_centre(&self) -> Self {
        Self::new(self.tracked, self.ionosphere, self.time, self.settings)
    }

    /// Gauss-Newton from where it stands until the step is small, by ranges with their atmosphere if that is near.
    fn converge(&mut self) -> Result<(), NoPosition> {
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
    fn form_rows(&mut self) {
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
    fn step(&mut self) -> Result<f64, NoPosition> {
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

    fn redundancy(&self) -> usize {
        self.rows.len().saturating_sub(3 + self.systems_present())
    }

    fn unit_weight_rms(&self) -> f64 {
        let sum: f64 = self.rows.iter().map(|(r, _)| r.weight * r.misclosure_m.powi(2)).sum();
        match self.redundancy() {
            0 => 0.0,
            redundancy => (sum / redundancy as f64).sqrt(),
        }
    }

    /// Whether no residual points to a faulty satellite, or there is no redundancy to tell.
    fn is_consistent(&self) -> bool {
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
    fn explained(&self, [i, j]: [usize; 2]) -> f64 {
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
    fn without(&self, rows: [usize; 2]) -> Option<Self> {
        let mut fit = self.clone();
        fit.excluded.extend(rows.map(|row| self.rows[row].1));
        fit.excluded.dedup();
        fit.converge().ok()?;
        (fit.redundancy() > 0).then_some(fit)
    }

    /// What the excluded satellites' code says against the others, m.
    fn exclusions(&self) -> Vec<Exclusion> {
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

    fn solution(&self) -> Result<PointSolution, NoPosition> {
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

/// What surrounds the antenna at the current position.
struct Surroundings {
    horizon: Horizon,
    troposphere: Troposphere,
    up: Vector3<f64>,
    /// Sine of the lowest elevation that is used.
    lowest: f64,
}

/// The range that counts for one satellite, its atmospheric delay, and the variance of both.
struct Modelled {
    pseudorange_m: f64,
    delay_m: f64,
    /// Derivative of the delay by the antenna's position.
    delay_gradient: Vector3<f64>,
    variance_m2: f64,
}

impl Modelled {
    /// While the position is not near enough for directions: as good as any other.
    fn rough(satellite: &Tracked) -> Self {
        let pseudorange_m = satellite.code.pseudorange_m;
        let delay_gradient = Vector3::zeros();
        Self { pseudorange_m, delay_m: 0.0, delay_gradient, variance_m2: ROUGH_SD_M * ROUGH_SD_M }
    }
}

impl Surroundings {
    fn at(antenna_m: Vector<Ecef>, settings: &PointSettings) -> Self {
        let horizon = Horizon::at(antenna_m);
        let lowest = horizon.lowest_elevation_rad(settings.elevation_mask_rad).sin();
        let up = (horizon.ned_from_ecef().inverse() * Vector::new(0.0, 0.0, -1.0)).xyz();
        Self { horizon, troposphere: Troposphere::above(&horizon.geodetic), up, lowest }
    }

    /// Delays and variance; `None` below the mask.
    fn model(&self, satellite: &Tracked, view: &View, fit: &PositionFit<'_>) -> Option<Modelled> {
        let direction = self.horizon.direction(view.line_of_sight);
        let sin_elevation = direction.sin_elevation();
        if sin_elevation < self.lowest {
            return None;
        }
        let frequency_hz = satellite.code.frequency_hz;
        let modelled_m = ionosphere_m(
            fit.ionosphere,
            &self.horizon.geodetic,
            &direction,
            fit.time,
            frequency_hz,
        );
        let (range_m, range_m2) = self.range(satellite, sin_elevation, modelled_m, fit);
        let troposphere_m = self.troposphere.delay_m(sin_elevation);
        // A standard atmosphere leaves some centimetres at the zenith.
        let remaining_m2 = (0.05 * troposphere_m).powi(2) + satellite.state.sigma_m.powi(2);
        Some(Modelled {
            pseudorange_m: range_m,
            delay_m: troposphere_m,
            delay_gradient: self.up * self.troposphere.slope(sin_elevation),
            variance_m2: range_m2 + remaining_m2,
        })
    }

    /// Range without ionosphere from one or two code observations, and its variance:
    ///
    /// `P₁ = r + I + e₁`, `P₂ = r + γ I + e₂` with `γ = (f₁ / f₂)²`, and the model's `I` (m, on the
    /// first band) as an observation that is good to its own size (its errors are alike for all
    /// satellites, so it must not outweigh what the second band measures). Group delays that nobody
    /// tells are in `I` too.
    fn range(
        &self,
        satellite: &Tracked,
        sin_elevation: f64,
        modelled_m: f64,
        fit: &PositionFit<'_>,
    ) -> (f64, f64) {
        let weight = |code: &Code| {
            1.0 / fit.settings.noise.variances(code.band, sin_elevation, code.cn0_dbhz).code_m2
        };
        let first = &satellite.code;
        let w1 = weight(first);
        let model_m2 = modelled_m.max(MIN_IONOSPHERE_SD_M).powi(2);
        let w_model = 1.0 / (model_m2 + satellite.delay_sd_m.powi(2));
        let (p2, w2, gamma) = satellite.second.as_ref().map_or((0.0, 0.0, 1.0), |second| {
            let gamma = (first.frequency_hz / second.frequency_hz).powi(2);
            (second.pseudorange_m, weight(second), gamma)
        });
        // Normal equations of (r, I), solved for r
        let (n_ri, n_ii) = (w1 + gamma * w2, w1 + gamma * gamma * w2 + w_model);
        let determinant = (w1 + w2) * n_ii - n_ri * n_ri;
        let b_r = w1 * first.pseudorange_m + w2 * p2;
        let b_i = w1 * first.pseudorange_m + gamma * w2 * p2 + w_model * modelled_m;
        ((n_ii * b_r - n_ri * b_i) / determinant, n_ii / determinant)
    }
}
