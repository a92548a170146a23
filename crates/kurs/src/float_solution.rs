//! One-epoch float solution of all baselines together.
//!
//! Unknowns are the corrections `x` (3k) to the approximate baselines of k rover antennas and the
//! double-difference ambiguities `a` (n):
//!
//! `y_P = A_P x + e_P`,   `y_Φ = A_Φ x + Λ a + e_Φ`
//!
//! Every phase has an ambiguity of its own within one epoch, so the code alone determines `x̂` and
//! the phases `â`; the integers then bring the phases into `x`. [`recursive`] adds what earlier
//! epochs know of the ambiguities.

mod code;
mod information;
mod informed;
pub mod recursive;

pub use code::CodeFloat;

use std::sync::OnceLock;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use smallvec::smallvec;

use crate::difference::{
    Combination, Link, OfLinks, add_common_cycles, covariance, equations, own_links,
};
use crate::signal::SatelliteSet;

/// Factor on the standard deviation of code that is to be ignored: decimetres become hundreds of
/// metres.
const CODE_LEFT_OUT: f64 = 1e3;

/// Phases of one group before whitening, as the integers need them.
#[derive(Debug, Clone)]
struct Phases {
    factor: Cholesky<f64, Dyn>,
    design: DMatrix<f64>,
    /// `L⁻¹ A_Φ`
    whitened_design: DMatrix<f64>,
    misclosure_m: DVector<f64>,
    covariance_m2: DMatrix<f64>,
    wavelengths_m: DVector<f64>,
    combinations: Vec<Combination>,
    /// The link (of the group) whose ambiguity each combination stands for.
    own: Vec<usize>,
    first_link: usize,
}

/// Float solution; `3k × 3k` and so on as in the module's head. Baseline blocks stand in the order
/// of `rovers`.
#[derive(Debug, Clone)]
pub struct FloatSolution {
    /// Antenna that the baselines start from.
    pub reference: usize,
    /// Antennas that they lead to, each a block of three unknowns.
    pub rovers: Vec<usize>,
    /// Corrections to the approximate baselines from code alone, ECEF, m (3k).
    pub correction_m: DVector<f64>,
    /// Their covariance `Q_x̂`, m² (3k × 3k).
    pub covariance_m2: DMatrix<f64>,
    /// Float ambiguities `â`, cycles (n).
    pub ambiguities_cycles: DVector<f64>,
    /// Cross covariance `Q_x̂â`, m·cycles (3k × n).
    pub cross_covariance: DMatrix<f64>,
    /// Baseline (index of its block) that each ambiguity belongs to; the last one for an ambiguity
    /// of several baselines (n).
    pub baseline_of: Vec<usize>,
    /// Weighted sum of squared code residuals and its degrees of freedom.
    pub code_fit: Fit,
    /// Number of satellites with a double-differenced phase.
    pub satellites: usize,
    /// `Λ⁻¹ A_Φ` (n × 3k).
    scaled_design: DMatrix<f64>,
    /// `Q_â`, once somebody has asked for it.
    ambiguity_covariance: OnceLock<DMatrix<f64>>,
    conditional: ConditionalNormal,
    code_right: DVector<f64>,
    code: CodeFloat,
    phases: Vec<Phases>,
    memory: Option<Memory>,
    without_code: bool,
    /// Components of the baselines that were told from outside.
    informed: usize,
}

/// Normal matrix of the baselines once the integers are known, `N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ`.
#[derive(Debug, Clone)]
struct ConditionalNormal {
    matrix: DMatrix<f64>,
    /// Its inverse; `None` if it is singular.
    covariance_m2: Option<DMatrix<f64>>,
}

impl ConditionalNormal {
    fn new(matrix: DMatrix<f64>) -> Self {
        Self { covariance_m2: well_conditioned_inverse(&matrix), matrix }
    }
}

/// Normal equations of the baselines given the ambiguities, where they hold more than this epoch:
/// `Λ_xx x = right − cross a`.
#[derive(Debug, Clone)]
struct Memory {
    right: DVector<f64>,
    cross: DMatrix<f64>,
}

/// The phases of one group, before integers: `y_Φ = A_Φ x + Λ a + e`.
#[derive(Debug, Clone, Copy)]
pub struct PhaseGroup<'a> {
    /// `y_Φ` against the approximate baselines, m.
    pub misclosure_m: &'a DVector<f64>,
    /// Diagonal of `Λ`, m.
    pub wavelengths_m: &'a DVector<f64>,
    /// `A_Φ`.
    pub design: &'a DMatrix<f64>,
    /// Their covariance, m².
    pub covariance_m2: &'a DMatrix<f64>,
}

/// How well observations fit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Fit {
    /// Weighted sum of squared residuals.
    pub sum: f64,
    /// Degrees of freedom.
    pub degrees_of_freedom: usize,
}

impl Fit {
    /// Both together.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            degrees_of_freedom: self.degrees_of_freedom + other.degrees_of_freedom,
        }
    }

    /// Root of the sum over the degrees of freedom: 1 where the weights are right; 0 without
    /// redundancy.
    #[must_use]
    pub fn unit_weight(&self) -> f64 {
        if self.degrees_of_freedom == 0 {
            0.0
        } else {
            (self.sum / self.degrees_of_freedom as f64).sqrt()
        }
    }
}

/// Baselines with integer ambiguities put in.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditional {
    /// Corrections to the approximate baselines, ECEF, m (3k).
    pub correction_m: DVector<f64>,
    /// Their covariance given the integers, m² (3k × 3k).
    pub covariance_m2: DMatrix<f64>,
    /// Weighted residuals of the phases.
    pub phase_fit: Fit,
    /// Root mean square of the double-difference phase residuals, m.
    pub residual_rms_m: f64,
}

/// Why there is no float solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoFloat {
    /// No satellite is seen by two antennas.
    #[error("no satellite is seen by two antennas on one band")]
    NoCommonSatellites,
    /// The code observations do not determine the baselines.
    #[error("{rows} double-differenced code observations do not determine {unknowns} coordinates")]
    Undetermined {
        /// Code double differences.
        rows: usize,
        /// Coordinates.
        unknowns: usize,
    },
}

impl FloatSolution {
    /// Solves the epoch whose links stand in `groups` (ranges of `links`), for the baselines from
    /// `reference` to `rovers`.
    ///
    /// # Errors
    ///
    /// [`NoFloat`] when the code observations do not determine every baseline.
    pub fn solve(
        links: &[Link],
        groups: &[std::ops::Range<usize>],
        reference: usize,
        rovers: &[usize],
    ) -> Result<Self, NoFloat> {
        Ok(Self::with_phases(CodeFloat::solve(links, groups, reference, rovers)?, links))
    }

    /// Adds the phases of the links to what their code gives.
    #[must_use]
    pub fn with_phases(mut code: CodeFloat, links: &[Link]) -> Self {
        let rovers = code.rovers.clone();
        let unknowns = 3 * rovers.len();
        let block = |antenna: usize| rovers.iter().position(|rover| *rover == antenna);
        let of_group = |loops: &mut code::Loops| {
            let rows = core::mem::take(&mut loops.phases);
            let group = loops.group.clone();
            group_phases(&links[group.clone()], rows, group.start, unknowns, block)
        };
        let phases: Vec<Phases> = code.loops.iter_mut().filter_map(of_group).collect();
        let mut conditional_normal = code.normal.clone();
        for group in &phases {
            let whitened = &group.whitened_design;
            conditional_normal.gemm_tr(1.0, whitened, whitened, 1.0);
        }
        let satellites = satellites_with_phase(links, &phases);
        let mut float = Self {
            reference: code.reference,
            rovers,
            correction_m: code.correction_m.clone(),
            covariance_m2: code.covariance_m2.clone(),
            ambiguities_cycles: DVector::zeros(0),
            cross_covariance: DMatrix::zeros(unknowns, 0),
            baseline_of: Vec::new(),
            code_fit: code.fit,
            satellites,
            scaled_design: DMatrix::zeros(0, unknowns),
            ambiguity_covariance: OnceLock::new(),
            conditional: ConditionalNormal::new(conditional_normal),
            code_right: code.right.clone(),
            code,
            phases,
            memory: None,
            without_code: false,
            informed: 0,
        };
        float.solve_ambiguities();
        float
    }

    /// `â = Λ⁻¹ (y_Φ − A_Φ x̂)`, `Q_x̂â = −Q_x̂ A_Φᵀ Λ⁻¹`.
    fn solve_ambiguities(&mut self) {
        let n: usize = self.phases.iter().map(|p| p.misclosure_m.len()).sum();
        let unknowns = self.correction_m.len();
        self.scaled_design = DMatrix::zeros(n, unknowns);
        self.baseline_of.clear();
        self.ambiguities_cycles = DVector::zeros(n);
        let mut first = 0;
        for Phases { misclosure_m, wavelengths_m, design, .. } in &self.phases {
            let count = misclosure_m.len();
            let mut cycles = self.ambiguities_cycles.rows_mut(first, count);
            cycles.copy_from(misclosure_m);
            cycles.gemv(-1.0, design, &self.correction_m, 1.0);
            cycles.component_div_assign(wavelengths_m);
            let mut scaled = self.scaled_design.rows_mut(first, count);
            scaled.copy_from(design);
            scaled.column_iter_mut().for_each(|mut c| c.component_div_assign(wavelengths_m));
            let last = |row: usize| (0..unknowns).rev().find(|i| design[(row, *i)] != 0.0);
            self.baseline_of.extend((0..count).map(|row| last(row).unwrap_or(0) / 3));
            first += count;
        }
        self.cross_covariance = -(&self.covariance_m2 * self.scaled_design.transpose());
        self.ambiguity_covariance = OnceLock::new();
    }

    /// Covariance `Q_â` of the float ambiguities, cycles² (n × n); computed when it is first asked for.
    pub fn ambiguity_covariance(&self) -> &DMatrix<f64> {
        self.ambiguity_covariance.get_or_init(|| {
            let all: Vec<usize> = (0..self.ambiguities_cycles.len()).collect();
            self.one_epoch_covariance(&all)
        })
    }

    /// Covariance of the ambiguities `rows`, which rise.
    #[must_use]
    pub fn covariance_among(&self, rows: &[usize]) -> DMatrix<f64> {
        match self.ambiguity_covariance.get() {
            Some(all) => DMatrix::from_fn(rows.len(), rows.len(), |i, j| all[(rows[i], rows[j])]),
            None => self.one_epoch_covariance(rows),
        }
    }

    /// `Λ⁻¹ (Q_Φ + A_Φ Q_x̂ A_Φᵀ) Λ⁻¹` of the ambiguities `rows`, which rise, where nothing but this epoch is known.
    fn one_epoch_covariance(&self, rows: &[usize]) -> DMatrix<f64> {
        let mut covariance = if rows.len() == self.ambiguities_cycles.len() {
            -(&self.scaled_design * &self.cross_covariance)
        } else {
            -(self.scaled_design.select_rows(rows) * self.cross_covariance.select_columns(rows))
        };
        let (mut first, mut from) = (0, 0);
        for Phases { wavelengths_m, covariance_m2, .. } in &self.phases {
            let end = first + wavelengths_m.len();
            let to = from + rows[from..].iter().take_while(|row| **row < end).count();
            for j in from..to {
                let of_j = rows[j] - first;
                let column_m2 = covariance_m2.column(of_j);
                for i in from..to {
                    let of_i = rows[i] - first;
                    covariance[(i, j)] +=
                        column_m2[of_i] / (wavelengths_m[of_i] * wavelengths_m[of_j]);
                }
            }
            (first, from) = (end, to);
        }
        covariance
    }

    /// The phases of all groups, in the order of the ambiguities.
    pub fn phase_groups(&self) -> impl Iterator<Item = PhaseGroup<'_>> {
        self.phases.iter().map(|phases| PhaseGroup {
            misclosure_m: &phases.misclosure_m,
            wavelengths_m: &phases.wavelengths_m,
            design: &phases.design,
            covariance_m2: &phases.covariance_m2,
        })
    }

    /// The solution with next to no weight on the code of the epoch: a thousand times its standard
    /// deviation. For a solution that holds one epoch only.
    #[must_use]
    pub fn without_code(&self) -> Self {
        let mut float = Self { without_code: true, ..self.clone() };
        let scale = CODE_LEFT_OUT * CODE_LEFT_OUT;
        if let Some(code_normal) = well_conditioned_inverse(&self.covariance_m2) {
            let less = code_normal * (1.0 - 1.0 / scale);
            float.conditional = ConditionalNormal::new(&self.conditional.matrix - less);
        }
        float.covariance_m2 *= scale;
        float.code_right /= scale;
        float.code_fit = Fit::default();
        float.solve_ambiguities();
        float
    }

    /// What the corrections add to the computed range of a link, `gᵀ x̂`, m.
    #[must_use]
    pub fn along_m(&self, link: &Link) -> f64 {
        let block = self.rovers.iter().position(|rover| *rover == link.antenna);
        block.map_or(0.0, |block| link.gradient.dot(&self.correction_m.fixed_rows::<3>(3 * block)))
    }

    /// Number of components of the baselines that are known from outside ([`informed`](Self::informed)).
    #[must_use]
    pub fn told_components(&self) -> usize {
        self.informed
    }

    /// Whether this is a solution that [`without_code`](Self::without_code) gave.
    #[must_use]
    pub fn is_without_code(&self) -> bool {
        self.without_code
    }

    /// Covariance of the baselines once the integers are known,
    /// `Q_x|a = (N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ)⁻¹`, m²; `None` if that is singular.
    #[must_use]
    pub fn conditional_covariance_m2(&self) -> Option<&DMatrix<f64>> {
        self.conditional.covariance_m2.as_ref()
    }

    /// Ambiguities (cycles) that follow from baselines known to millimetres: close to integers,
    /// `Λ⁻¹ (y_Φ − A_Φ x)`.
    #[must_use]
    pub fn cycles(&self, correction_m: &DVector<f64>) -> Vec<f64> {
        let of_group = |phases: &Phases| {
            let remaining_m = &phases.misclosure_m - &phases.design * correction_m;
            remaining_m.component_div(&phases.wavelengths_m)
        };
        self.phases.iter().flat_map(|p| of_group(p).as_slice().to_vec()).collect()
    }

    /// Normalised residuals of the links' code ([`CodeFloat::residuals`]).
    #[must_use]
    pub fn code_residuals(&self, links: &[Link]) -> Vec<(usize, f64)> {
        self.code.residuals(links)
    }

    /// Redundancy of the code of each group ([`CodeFloat::redundancies`]).
    #[must_use]
    pub fn code_redundancies(&self) -> Vec<(usize, f64)> {
        self.code.redundancies()
    }

    /// What the residuals of each group's phases show of their squares once the integers are known, with the index of the
    /// group's first link: `n − tr(Q_x|a A_Φᵀ Q_Φ⁻¹ A_Φ)`.
    #[must_use]
    pub fn phase_redundancies(&self) -> Vec<(usize, f64)> {
        let Some(covariance_m2) = &self.conditional.covariance_m2 else { return Vec::new() };
        let of_group = |phases: &Phases| {
            let whitened = &phases.whitened_design;
            let taken = (whitened * covariance_m2).dot(whitened);
            (phases.first_link, (whitened.nrows() as f64 - taken).max(0.0))
        };
        self.phases.iter().map(of_group).collect()
    }

    /// Normalised residuals of the links' phases with these integers and baselines, as
    /// [`CodeFloat::residuals`].
    pub fn phase_residuals(
        &self,
        links: &[Link],
        integers: &[f64],
        correction_m: &DVector<f64>,
    ) -> Vec<(usize, f64)> {
        let mut residuals: Vec<(usize, f64)> = Vec::new();
        let mut first = 0;
        for phases in &self.phases {
            let count = phases.misclosure_m.len();
            let mut weighted =
                DVector::from_fn(count, |i, _| phases.range_m(i, integers[first + i]));
            weighted.gemv(-1.0, &phases.design, correction_m, 1.0);
            first += count;
            phases.factor.solve_mut(&mut weighted);
            spread(&phases.combinations, phases.first_link, &weighted, &mut residuals);
        }
        let degrees_of_freedom = first.saturating_sub(correction_m.len());
        normalise(&mut residuals, degrees_of_freedom, |link| links[link].variances.phase_m2);
        residuals
    }

    /// Whole cycles of every link whose phase is used, as far as the epoch's integers tell them: those of
    /// receivers and satellites are left out, double differences are exact.
    pub fn whole_cycles(&self, links: &[Link], integers: &[f64]) -> Vec<Option<f64>> {
        let mut cycles = vec![None; links.len()];
        let mut row = 0;
        for phases in &self.phases {
            for (combination, own) in phases.combinations.iter().zip(&phases.own) {
                for (edge, sign) in combination {
                    let link = phases.first_link + edge;
                    let cycle = cycles[link].get_or_insert(links[link].whole_cycles);
                    if edge == own {
                        *cycle += sign * integers[row];
                    }
                }
                row += 1;
            }
        }
        cycles
    }

    /// The integers that whole cycles of the links make (n); `None` if those of a link are not known.
    pub fn integers_of(
        &self,
        links: &[Link],
        cycles: impl Fn(&Link) -> Option<f64>,
    ) -> Option<Vec<f64>> {
        let of_phases = self.phases.iter().flat_map(|phases| {
            phases.combinations.iter().map(|combination| {
                let term = |(edge, sign): &(usize, f64)| {
                    let link = &links[phases.first_link + edge];
                    Some(sign * (cycles(link)? - link.whole_cycles))
                };
                combination.iter().map(term).sum::<Option<f64>>()
            })
        });
        of_phases.collect()
    }

    /// Increase of the weighted squares of the epoch's code residuals if the corrections are these
    /// instead of those that code alone gives, `(x − x̂)ᵀ N (x − x̂)`.
    #[must_use]
    pub fn code_excess(&self, correction_m: &DVector<f64>) -> f64 {
        if self.without_code {
            return 0.0;
        }
        let off_m = |i: usize| correction_m[i] - self.code.correction_m[i];
        let of_columns = self.code.normal.column_iter().enumerate().map(|(j, column)| {
            let along: f64 = column.iter().enumerate().map(|(i, n)| n * off_m(i)).sum();
            along * off_m(j)
        });
        of_columns.sum()
    }

    /// Squares that integers leave of the phases, and of the code beyond what code alone leaves.
    #[must_use]
    pub fn squares_left(&self, conditional: &Conditional) -> f64 {
        conditional.phase_fit.sum + self.code_excess(&conditional.correction_m)
    }

    /// Whether it holds the code and phases of one epoch and nothing else.
    #[must_use]
    pub fn is_of_one_epoch(&self) -> bool {
        !self.is_recursive() && !self.without_code && self.informed == 0
    }

    /// Whether earlier epochs enter.
    #[must_use]
    pub fn is_recursive(&self) -> bool {
        self.memory.is_some()
    }

    /// Baselines given integer ambiguities (n, cycles), code and phases together, and how the phases fit; `None` if
    /// they are not determined.
    #[must_use]
    pub fn conditional(&self, integers: &[f64]) -> Option<Conditional> {
        let mut whitened = self.whitened_ranges(integers.iter().copied());
        let correction_m = self.conditional_correction(integers.iter().copied(), &whitened)?;
        let mut phase_sum = 0.0;
        let mut residual_squares = 0.0;
        let mut first = 0;
        for phases in &self.phases {
            let count = phases.misclosure_m.len();
            // L⁻¹ (y_Φ − Λ z − A_Φ x̌)
            let mut residual = whitened.rows_mut(first, count);
            residual.gemv(-1.0, &phases.whitened_design, &correction_m, 1.0);
            phase_sum += residual.norm_squared();
            for i in 0..count {
                let along_m = phases.design.row(i).tr_dot(&correction_m);
                let range_m = phases.range_m(i, integers[first + i]);
                residual_squares += (range_m - along_m).powi(2);
            }
            first += count;
        }
        let (n, unknowns) = (integers.len(), correction_m.len());
        Some(Conditional {
            correction_m,
            covariance_m2: self.conditional.covariance_m2.clone()?,
            phase_fit: Fit { sum: phase_sum, degrees_of_freedom: n.saturating_sub(unknowns) },
            residual_rms_m: (residual_squares / n.max(1) as f64).sqrt(),
        })
    }

    /// By how much the weighted squares of the epoch's code grow with these integers.
    #[must_use]
    pub fn code_excess_of(&self, integers: impl Iterator<Item = f64> + Clone) -> Option<f64> {
        let whitened = self.whitened_ranges(integers.clone());
        Some(self.code_excess(&self.conditional_correction(integers, &whitened)?))
    }

    /// `(â − z)ᵀ Q_â⁻¹ (â − z)` of these integers `z`: the squares that they leave of the phases, and of the code beyond what code
    /// alone leaves. `None` where the solution is not of one epoch alone, and where the baselines are not determined.
    #[must_use]
    pub fn squared_distance(&self, integers: &[f64]) -> Option<f64> {
        let conditional = self.is_of_one_epoch().then(|| self.conditional(integers))??;
        Some(self.squares_left(&conditional))
    }

    /// `L⁻¹ (y_Φ − Λ z)`, with the factor `L` of each group's `Q_Φ`, in the order of the ambiguities.
    fn whitened_ranges(&self, mut integers: impl Iterator<Item = f64>) -> DVector<f64> {
        let mut whitened = DVector::zeros(self.ambiguities_cycles.len());
        let mut first = 0;
        for phases in &self.phases {
            let mut of_group = whitened.rows_mut(first, phases.misclosure_m.len());
            for (i, (range_m, z)) in of_group.iter_mut().zip(integers.by_ref()).enumerate() {
                *range_m = phases.range_m(i, z);
            }
            phases.factor.l_dirty().solve_lower_triangular_mut(&mut of_group);
            first += phases.misclosure_m.len();
        }
        whitened
    }

    /// `x̌ = (N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ)⁻¹ (b + Σ A_Φᵀ Q_Φ⁻¹ (y_Φ − Λ z))`
    fn conditional_correction(
        &self,
        integers: impl Iterator<Item = f64>,
        whitened_ranges: &DVector<f64>,
    ) -> Option<DVector<f64>> {
        let covariance_m2 = self.conditional.covariance_m2.as_ref()?;
        if let Some(memory) = &self.memory {
            let mut right = memory.right.clone();
            for (of_ambiguity, z) in memory.cross.column_iter().zip(integers) {
                right.axpy(-z, &of_ambiguity, 1.0);
            }
            return Some(covariance_m2 * right);
        }
        let mut right = self.code_right.clone();
        let mut first = 0;
        for phases in &self.phases {
            let of_group = whitened_ranges.rows(first, phases.misclosure_m.len());
            right.gemv_tr(1.0, &phases.whitened_design, &of_group, 1.0);
            first += phases.misclosure_m.len();
        }
        Some(covariance_m2 * right)
    }
}

impl Phases {
    /// `y_Φ − Λ z` of one double difference, m.
    fn range_m(&self, row: usize, z: f64) -> f64 {
        self.misclosure_m[row] - self.wavelengths_m[row] * z
    }
}

/// Phase double differences of one group.
fn group_phases(
    links: &[Link],
    rows: Vec<Combination>,
    first_link: usize,
    unknowns: usize,
    block: impl Fn(usize) -> Option<usize>,
) -> Option<Phases> {
    let mut covariance_m2 = covariance(&rows, |edge| links[edge].variances.phase_m2);
    add_common_cycles(&mut covariance_m2, &rows, links);
    let factor = covariance_m2.clone().cholesky().filter(|_| !rows.is_empty())?;
    let (design, misclosure_m) = equations(links, &rows, unknowns, block, |link| link.phase_m);
    let mut whitened_design = design.clone();
    factor.l_dirty().solve_lower_triangular_mut(&mut whitened_design);
    let own = own_links(&rows);
    let wavelengths_m = DVector::from_fn(rows.len(), |i, _| links[own[i]].wavelength_m);
    Some(Phases {
        factor,
        design,
        whitened_design,
        misclosure_m,
        covariance_m2,
        wavelengths_m,
        combinations: rows,
        own,
        first_link,
    })
}

/// Appends `Dᵀ w` for the links that the combinations `D` contain, sorted.
fn spread(
    combinations: &[Combination],
    first_link: usize,
    weights: &DVector<f64>,
    links: &mut Vec<(usize, f64)>,
) {
    let last = combinations.iter().flatten().map(|(edge, _)| *edge).max();
    let mut sums: OfLinks<Option<f64>> = smallvec![None; last.map_or(0, |last| last + 1)];
    for (row, weight) in combinations.iter().zip(weights.iter()) {
        for (edge, sign) in row {
            *sums[*edge].get_or_insert(0.0) += sign * weight;
        }
    }
    let found =
        sums.iter().enumerate().filter_map(|(edge, sum)| Some((first_link + edge, (*sum)?)));
    links.extend(found);
}

/// From `ê/σ²` of each link to `ê/σ` over the root of the share of the variances that the residuals show.
fn normalise(
    links: &mut Vec<(usize, f64)>,
    degrees_of_freedom: usize,
    variance_m2: impl Fn(usize) -> f64,
) {
    if degrees_of_freedom == 0 {
        links.clear();
    }
    let shown = degrees_of_freedom as f64 / links.len().max(1) as f64;
    for (link, value) in links {
        *value *= (variance_m2(*link) / shown).sqrt();
    }
}

fn satellites_with_phase(links: &[Link], phases: &[Phases]) -> usize {
    let satellites = phases.iter().flat_map(|phases| {
        let edges = phases.combinations.iter().flatten();
        edges.map(|(edge, _)| links[phases.first_link + edge].satellite)
    });
    satellites.collect::<SatelliteSet>().len()
}

/// Inverse of a normal matrix, unless its directions differ so much in strength that one of them is
/// not determined.
fn well_conditioned_inverse(normal: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    /// Of the squares of the pivots.
    const MIN_PIVOT_RATIO: f64 = 1e-10;
    let factor = normal.clone().cholesky()?;
    let diagonal = (0..normal.nrows()).map(|i| factor.l_dirty()[(i, i)]);
    let (least, most) =
        diagonal.fold((f64::INFINITY, 0.0), |(least, most), d| (d.min(least), d.max(most)));
    (least * least > MIN_PIVOT_RATIO * most * most).then(|| factor.inverse())
}
