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
mod conditional;
mod information;
mod informed;
mod phases;
pub mod recursive;
mod residuals;

pub use code::CodeFloat;
pub use conditional::Conditional;
pub use phases::PhaseGroup;

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};

use self::conditional::ConditionalNormal;
use self::phases::{Phases, group_phases, satellites_with_phase};
use crate::difference::Link;

/// Factor on the standard deviation of code that is to be ignored: decimetres become hundreds of
/// metres.
const CODE_LEFT_OUT: f64 = 1e3;

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

/// Normal equations of the baselines given the ambiguities, where they hold more than this epoch:
/// `Λ_xx x = right − cross a`.
#[derive(Debug, Clone)]
struct Memory {
    right: DVector<f64>,
    cross: DMatrix<f64>,
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
