//! Baselines from code alone, with the terms of receivers and satellites eliminated in place of differenced away.
//!
//! The code of one link of a group is `y = gᵀ x + c + d + e` with the term `c` of its receiver and `d` of its
//! satellite. Least squares over all of them give the same `x̂` as double differences with their full covariance,
//! without ever forming it. With the rows `h = (gᵀ in the block of the antenna, 1 for its receiver, y)`, bordered by
//! the observation, each satellite adds
//!
//! `M ← M + Σ w h hᵀ − s sᵀ / Σ w`,   `s = Σ w h`,   `w = 1/σ²`,
//!
//! in which `d` is gone. The elimination of each receiver `r`, `M ← M − m_r m_rᵀ / m_rr`, leaves of `M` the normal
//! matrix, the right side and the sum of squares of the baselines, `[N b; bᵀ s]`.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use smallvec::{SmallVec, smallvec};

use super::residuals::normalise;
use super::{Fit, NoFloat, well_conditioned_inverse};
use crate::difference::{Combination, Link, OfLinks, combinations};

/// What remains of a receiver's diagonal after the others of its part of the graph are eliminated: nothing but
/// rounding errors, as one term of each part is free.
const NOTHING: f64 = 1e-12;

/// One of each unknown: up to seven baselines stay on the stack.
type Row = SmallVec<[f64; 32]>;

/// The baselines that the code of an epoch gives.
#[derive(Debug, Clone)]
pub struct CodeFloat {
    pub(super) reference: usize,
    pub(super) rovers: Vec<usize>,
    pub(super) loops: Vec<Loops>,
    /// Corrections to the approximate baselines, ECEF, m (3k).
    pub(super) correction_m: DVector<f64>,
    /// Their covariance `N⁻¹`, m² (3k × 3k).
    pub(super) covariance_m2: DMatrix<f64>,
    /// `N`
    pub(super) normal: DMatrix<f64>,
    /// `b`
    pub(super) right: DVector<f64>,
    /// Weighted sum of the squared residuals and its degrees of freedom.
    pub(super) fit: Fit,
    /// Normal equations of each group in which each receiver's row is as it was when its turn came.
    eliminated: Vec<DMatrix<f64>>,
}

/// The loops of one group's graph, which double differences are.
#[derive(Debug, Clone)]
pub(super) struct Loops {
    /// Its links.
    pub(super) group: Range<usize>,
    pub(super) phases: Vec<Combination>,
    codes: usize,
    /// The links with code that are part of a loop, sorted.
    with_code: Vec<usize>,
}

impl Loops {
    fn of(links: &[Link], group: &Range<usize>) -> Self {
        let of_group = &links[group.clone()];
        let codes = combinations(of_group, |link| link.code_m.is_some());
        let alike = of_group.iter().all(|link| link.code_m.is_some() == link.phase_m.is_some());
        let mut is_used: OfLinks<bool> = smallvec![false; of_group.len()];
        codes.iter().flatten().for_each(|(edge, _)| is_used[*edge] = true);
        let with_code = group.clone().filter(|link| is_used[link - group.start]).collect();
        Self {
            group: group.clone(),
            with_code,
            codes: codes.len(),
            phases: match alike {
                true => codes,
                false => combinations(of_group, |link| link.phase_m.is_some()),
            },
        }
    }
}

/// Where the unknowns of an antenna stand in the normal equations.
#[derive(Debug, Clone, Copy)]
struct Columns<'a>(&'a [usize]);

impl Columns<'_> {
    /// Of the receivers, after the baselines: rovers, reference.
    fn receivers(self) -> Range<usize> {
        3 * self.0.len()..4 * self.0.len() + 1
    }

    /// Of the observation, the last.
    fn observation(self) -> usize {
        4 * self.0.len() + 1
    }

    /// The rover's block; the number of rovers for the reference.
    fn block(self, antenna: usize) -> usize {
        self.0.iter().position(|rover| *rover == antenna).unwrap_or(self.0.len())
    }

    /// What may not be zero of `h`, and where, in ascending order; the baseline's part of the reference is.
    fn row(self, link: &Link, code_m: f64) -> [(usize, f64); 5] {
        let block = self.block(link.antenna);
        let (first, is_rover) = if block < self.0.len() { (3 * block, 1.0) } else { (0, 0.0) };
        let along = |axis: usize| (first + axis, is_rover * link.gradient[axis]);
        let receiver = (self.receivers().start + block, 1.0);
        [along(0), along(1), along(2), receiver, (self.observation(), code_m)]
    }
}

impl CodeFloat {
    /// Solves the epoch whose links stand in `groups` (ranges of `links`), for the baselines from
    /// `reference` to `rovers`.
    ///
    /// # Errors
    ///
    /// [`NoFloat`] when the code observations do not determine every baseline.
    pub fn solve(
        links: &[Link],
        groups: &[Range<usize>],
        reference: usize,
        rovers: &[usize],
    ) -> Result<Self, NoFloat> {
        let unknowns = 3 * rovers.len();
        let mut code = Self {
            reference,
            rovers: rovers.to_vec(),
            loops: groups.iter().map(|group| Loops::of(links, group)).collect(),
            correction_m: DVector::zeros(unknowns),
            covariance_m2: DMatrix::zeros(unknowns, unknowns),
            normal: DMatrix::zeros(unknowns, unknowns),
            right: DVector::zeros(unknowns),
            fit: Fit::default(),
            eliminated: Vec::new(),
        };
        code.solve_again(links)?;
        Ok(code)
    }

    /// Solves anew after variances of the code have changed.
    ///
    /// # Errors
    ///
    /// As [`solve`](Self::solve).
    pub fn solve_again(&mut self, links: &[Link]) -> Result<(), NoFloat> {
        let unknowns = 3 * self.rovers.len();
        let rows: usize = self.loops.iter().map(|loops| loops.codes).sum();
        if rows == 0 && self.loops.iter().all(|loops| loops.phases.is_empty()) {
            return Err(NoFloat::NoCommonSatellites);
        }
        let undetermined = NoFloat::Undetermined { rows, unknowns };
        if rows < unknowns {
            return Err(undetermined);
        }

        let columns = Columns(&self.rovers);
        let eliminated = |loops: &Loops| eliminated(links, loops, columns);
        self.eliminated = self.loops.iter().map(eliminated).collect();
        let y = columns.observation();
        self.normal.fill(0.0);
        self.right.fill(0.0);
        let mut squares = 0.0;
        for matrix in &self.eliminated {
            self.normal += matrix.view((0, 0), (unknowns, unknowns));
            self.right.iter_mut().enumerate().for_each(|(i, right)| *right += matrix[(y, i)]);
            squares += matrix[(y, y)];
        }
        self.normal.fill_upper_triangle_with_lower_triangle();

        // x̂ = N⁻¹ b,  Q_x̂ = N⁻¹
        self.covariance_m2 = well_conditioned_inverse(&self.normal).ok_or(undetermined)?;
        self.correction_m = &self.covariance_m2 * &self.right;
        let sum = (squares - self.correction_m.dot(&self.right)).max(0.0);
        self.fit = Fit { sum, degrees_of_freedom: rows - unknowns };
        Ok(())
    }

    /// How the code fits.
    #[must_use]
    pub fn fit(&self) -> Fit {
        self.fit
    }

    /// Normalised residuals `ê/σ` of the links' code, over the root of the share of a link's variance that residuals
    /// show (their degrees of freedom over the number of links): a mean square of 1 is what to expect. Empty
    /// without redundancy.
    #[must_use]
    pub fn residuals(&self, links: &[Link]) -> Vec<(usize, f64)> {
        let mut residuals: Vec<(usize, f64)> = Vec::with_capacity(links.len());
        for (loops, matrix) in self.loops.iter().zip(&self.eliminated) {
            self.append_residuals(links, loops, matrix, &mut residuals);
        }
        let variance_m2 = |link: usize| links[link].variances.code_m2;
        normalise(&mut residuals, self.fit.degrees_of_freedom, variance_m2);
        residuals
    }

    /// What the residuals of each group's code show of their squares, with the index of the group's first link:
    /// `n − tr(Q_x̂ N_g)`, `N_g` the group's part of `N`.
    #[must_use]
    pub fn redundancies(&self) -> Vec<(usize, f64)> {
        let unknowns = self.correction_m.len();
        let of_group = |(loops, matrix): (&Loops, &DMatrix<f64>)| {
            // Of N_g the lower triangle is there.
            let below = |i: usize, j: usize| self.covariance_m2[(i, j)] * matrix[(i, j)];
            let of_row = |i: usize| below(i, i) + 2.0 * (0..i).map(|j| below(i, j)).sum::<f64>();
            let taken: f64 = (0..unknowns).map(of_row).sum();
            (loops.group.start, (loops.codes as f64 - taken).max(0.0))
        };
        self.loops.iter().zip(&self.eliminated).map(of_group).collect()
    }

    /// Appends `ê/σ²` of the links of one group.
    fn append_residuals(
        &self,
        links: &[Link],
        loops: &Loops,
        matrix: &DMatrix<f64>,
        residuals: &mut Vec<(usize, f64)>,
    ) {
        let columns = Columns(&self.rovers);
        let (receivers, y) = (columns.receivers(), columns.observation());
        // c_r = (m_ry − Σ m_rj z_j) / m_rr over the baselines and the receivers whose turn came later
        let mut z: Row = SmallVec::from_slice(self.correction_m.as_slice());
        z.resize(y, 0.0);
        for r in receivers.clone().rev().filter(|r| matrix[(*r, *r)] > 0.0) {
            let of_baselines = (0..receivers.start).map(|j| matrix[(r, j)] * z[j]);
            let of_later = (r + 1..receivers.end).map(|j| matrix[(j, r)] * z[j]);
            let known: f64 = of_baselines.chain(of_later).sum();
            z[r] = (matrix[(y, r)] - known) / matrix[(r, r)];
        }
        let origins_m = origins(links, loops, columns);
        for of_satellite in loops.of_satellites(links) {
            let first = residuals.len();
            let (mut sum, mut weights) = (0.0, 0.0);
            for link in of_satellite {
                let one = &links[*link];
                let block = columns.block(one.antenna);
                let along = match block < self.rovers.len() {
                    true => one.gradient.dot(&self.correction_m.fixed_rows::<3>(3 * block)),
                    false => 0.0,
                };
                let left_m = one.code_m.unwrap_or(0.0)
                    - origins_m[block]
                    - along
                    - z[receivers.start + block];
                let weight = 1.0 / one.variances.code_m2;
                (sum, weights) = (sum + weight * left_m, weights + weight);
                residuals.push((*link, left_m));
            }
            // d = Σ w (y − gᵀ x − c) / Σ w
            for (link, residual) in &mut residuals[first..] {
                *residual = (*residual - sum / weights) / links[*link].variances.code_m2;
            }
        }
    }
}

impl Loops {
    /// Its links with code, satellite after satellite.
    fn of_satellites<'a>(&'a self, links: &'a [Link]) -> impl Iterator<Item = &'a [usize]> {
        self.with_code.chunk_by(|a, b| links[*a].satellite == links[*b].satellite)
    }
}

/// One code of each antenna, m: without them the clocks of receivers would drown what they have in common.
fn origins(links: &[Link], loops: &Loops, columns: Columns) -> Row {
    let mut origins_m: Row = smallvec![0.0; columns.receivers().len()];
    for link in loops.with_code.iter().rev().map(|link| &links[*link]) {
        origins_m[columns.block(link.antenna)] = link.code_m.unwrap_or(0.0);
    }
    origins_m
}

/// `M` of one group (lower triangle) with its satellites and receivers eliminated.
fn eliminated(links: &[Link], loops: &Loops, columns: Columns) -> DMatrix<f64> {
    let size = columns.observation() + 1;
    let mut matrix = DMatrix::zeros(size, size);
    let origins_m = origins(links, loops, columns);
    let mut sum: Row = smallvec![0.0; size];
    for of_satellite in loops.of_satellites(links) {
        // One of its codes is taken from all of them: d may be hundreds of kilometres.
        let code_m =
            |link: &Link| link.code_m.unwrap_or(0.0) - origins_m[columns.block(link.antenna)];
        let origin_m = of_satellite.first().map_or(0.0, |first| code_m(&links[*first]));
        let mut weights = 0.0;
        sum.fill(0.0);
        for link in of_satellite.iter().map(|link| &links[*link]) {
            let weight = 1.0 / link.variances.code_m2;
            let h = columns.row(link, code_m(link) - origin_m);
            for (at, (j, of_j)) in h.iter().enumerate() {
                let scaled = weight * of_j;
                sum[*j] += scaled;
                let column = &mut matrix.as_mut_slice()[j * size..][..size];
                h[at..].iter().for_each(|(i, of_i)| column[*i] += scaled * of_i);
            }
            weights += weight;
        }
        add_square(&mut matrix, -1.0 / weights, &sum);
    }
    let whole: Row = (0..size).map(|i| matrix[(i, i)]).collect();
    for r in columns.receivers() {
        let pivot = matrix[(r, r)];
        if pivot.is_nan() || pivot <= NOTHING * whole[r] {
            matrix[(r, r)] = 0.0;
            continue;
        }
        for (j, m) in sum.iter_mut().enumerate() {
            *m = if j < r { matrix[(r, j)] } else { matrix[(j, r)] };
        }
        sum[columns.receivers().start..=r].fill(0.0);
        add_square(&mut matrix, -1.0 / pivot, &sum);
    }
    matrix
}

/// `M ← M + w h hᵀ`, lower triangle.
fn add_square(matrix: &mut DMatrix<f64>, weight: f64, h: &[f64]) {
    for (j, column) in matrix.as_mut_slice().chunks_exact_mut(h.len()).enumerate() {
        let scaled = weight * h[j];
        for (entry, h) in column[j..].iter_mut().zip(&h[j..]) {
            *entry += scaled * h;
        }
    }
}
