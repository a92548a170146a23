//! Which measurements do not belong to the trajectory that the others agree on.
//!
//! A measurement is held against what the others say of it, never against its own fit, and in units
//! of both uncertainties: a wrong one draws the trajectory to itself and makes the residuals of good
//! ones large. First each node is held against the nodes before it, so that a station that goes wrong
//! meets a path that is still right; then against both sides until nothing changes.

use nalgebra::linalg::SymmetricEigen;
use nalgebra::{DMatrix, DVector, Dyn};

use super::{Fit, NotSmoothed, STATED_TO, Smoother, StateEstimate};
use crate::chi_square::chi_square_tail;
use crate::median::median;

/// Rounds of leaving out, taking back and smoothing.
const MAX_ROUNDS: usize = 10;
/// The share of a variance that is left in a residual where other measurements say next to nothing:
/// they know it a thousand times worse, and the residual is as small as rounding errors.
const UNCHECKED: f64 = 1e-6;
/// Median of the absolute value of a normal number of unit variance.
const NORMAL_MEDIAN: f64 = 0.6745;

/// What a node's measurements are off from what others make them, each in its standard deviations.
struct Disagreement {
    innovation: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// The residuals of a node, each in its standard deviations, and what the node's estimate adds.
struct Residuals {
    residual: DVector<f64>,
    /// H P Hᵀ
    of_state: DMatrix<f64>,
}

impl Smoother<'_> {
    /// Leaves out what does not belong to the rest, takes back what does, and smooths again, as long
    /// as that settles.
    pub(super) fn fit_without_outliers(
        &mut self,
        start: Vec<DVector<f64>>,
    ) -> Result<Fit, NotSmoothed> {
        // The start may be far off, the path through all may be drawn away by gross errors: what is
        // nearer to the measurements judges them.
        let by_start = self.judge_going_forward(&start);
        let (mut fit, (mut judged, mut scale)) = match self.fit(start.clone()) {
            Ok(all) => {
                let by_all = self.judge_going_forward(&all.states());
                (all, if by_start.1 < by_all.1 { by_start } else { by_all })
            }
            Err(NotSmoothed::NotConverged) => {
                self.left_out.clone_from(&by_start.0);
                (self.fit(start)?, by_start)
            }
            Err(error) => return Err(error),
        };
        for _ in 0..MAX_ROUNDS {
            if judged != self.left_out {
                let before = core::mem::replace(&mut self.left_out, judged);
                match self.fit(fit.states()) {
                    Ok(better) => fit = better,
                    Err(NotSmoothed::NotConverged) => {
                        self.left_out = before;
                        break;
                    }
                    Err(error) => return Err(error),
                }
            }
            (judged, scale) = self.judge_by_both_sides(&fit, scale);
            if judged == self.left_out {
                break;
            }
        }
        Ok(fit)
    }

    /// Each node against those before it; what is left out of one does not enter the next. Noise that
    /// is larger than stated makes a filter lose its path, and is taken into account by a second pass.
    fn judge_going_forward(&self, reference: &[DVector<f64>]) -> (Vec<bool>, f64) {
        let (left_out, scale) = self.judge_forward_by(reference, 1.0);
        if scale < STATED_TO {
            return (left_out, scale);
        }
        self.judge_forward_by(reference, scale)
    }

    fn judge_forward_by(&self, reference: &[DVector<f64>], scale: f64) -> (Vec<bool>, f64) {
        let mut left_out = vec![false; self.measurements.len()];
        let mut sizes = Vec::with_capacity(self.measurements.len());
        let mut last: Option<StateEstimate> = None;
        for k in 0..self.nodes.len() {
            let predicted = self.before_node(k, last.as_ref(), &reference[k]);
            // Nothing is known at the beginning of a stretch.
            if !self.begins_stretch(k) {
                let found = self.residuals(k, &predicted, &reference[k]).of_prediction();
                found.sizes(&mut sizes);
                self.leave_out(k, &found, scale, &mut left_out);
            }
            last = Some(self.after_node(k, &predicted, &reference[k], &left_out).0);
        }
        (left_out, noise_scale(sizes))
    }

    /// Each node against all others, by noise that is `scale` times the stated one.
    fn judge_by_both_sides(&self, fit: &Fit, scale: f64) -> (Vec<bool>, f64) {
        let mut left_out = vec![false; self.measurements.len()];
        let mut sizes = Vec::with_capacity(self.measurements.len());
        for (k, estimate) in fit.smoothed.iter().enumerate() {
            let found = self.without_own(k, estimate);
            found.sizes(&mut sizes);
            self.leave_out(k, &found, scale, &mut left_out);
        }
        (left_out, noise_scale(sizes))
    }

    /// A node against the estimate less its own measurements.
    fn without_own(&self, k: usize, estimate: &StateEstimate) -> Disagreement {
        let residuals = self.residuals(k, estimate, &estimate.state);
        let used = self.used(k);
        if used.is_empty() {
            return residuals.of_prediction();
        }
        let Residuals { residual, of_state } = residuals;
        let own = of_state.select_columns(&used);
        let mut spread = SymmetricEigen::new(unit(used.len()) - own.select_rows(&used));
        spread.eigenvalues.apply(|share| *share = 1.0 / share.max(UNCHECKED));
        // A = H P Hᵀ, u: used.  ν = v + A_u (I − A_uu)⁻¹ v_u,  S = I + A + A_u (I − A_uu)⁻¹ A_uᵀ
        let gain = &own * spread.recompose();
        let innovation = &residual + &gain * residual.select_rows(&used);
        let covariance = unit(residual.len()) + of_state + gain * own.transpose();
        Disagreement { innovation, covariance }
    }

    /// Marks measurements of a node as left out: as long as what remains is too unlikely, the one
    /// whose absence lowers νᵀS⁻¹ν most.
    fn leave_out(&self, k: usize, found: &Disagreement, scale: f64, left_out: &mut [bool]) {
        let members = &self.nodes[k].members;
        let mut kept: Vec<usize> = (0..members.len()).collect();
        while !kept.is_empty() {
            let innovation = found.innovation.select_rows(&kept) / scale;
            let covariance = found.covariance.select_rows(&kept).select_columns(&kept);
            let Some(factor) = covariance.cholesky() else { break };
            let inverse = factor.inverse();
            let weighted = &inverse * &innovation;
            let likelihood = chi_square_tail(innovation.dot(&weighted), kept.len());
            if likelihood >= self.model.outlier_probability {
                break;
            }
            // Without measurement i: νᵀS⁻¹ν − (S⁻¹ν)ᵢ² / (S⁻¹)ᵢᵢ
            let lowers = weighted.map(|w| w * w).component_div(&inverse.diagonal());
            left_out[members[kept.remove(lowers.imax())]] = true;
        }
    }

    /// Probability of residuals as large as those of a node's used measurements. Their covariance is
    /// I − H P Hᵀ; directions that nothing else checks say nothing.
    pub(super) fn likelihood(&self, k: usize, estimate: &StateEstimate) -> Option<f64> {
        let used = self.used(k);
        if used.is_empty() {
            return None;
        }
        let Residuals { residual, of_state } = self.residuals(k, estimate, &estimate.state);
        let own = of_state.select_rows(&used).select_columns(&used);
        let spread = SymmetricEigen::new(unit(used.len()) - own);
        let along = spread.eigenvectors.tr_mul(&residual.select_rows(&used));
        let checked = || spread.eigenvalues.iter().zip(&along).filter(|(s, _)| **s > UNCHECKED);
        let cost: f64 = checked().map(|(share, along)| along * along / share).sum();
        let degrees = checked().count();
        (degrees > 0).then(|| chi_square_tail(cost, degrees))
    }

    /// v = y − h(x̄) − H (x − x̄) and H P Hᵀ of a node's measurements, divided by their sigmas.
    fn residuals(&self, k: usize, estimate: &StateEstimate, reference: &DVector<f64>) -> Residuals {
        let members = &self.nodes[k].members;
        let moved = &estimate.state - reference;
        let mut rows = DMatrix::zeros(members.len(), self.size());
        let mut residual = DVector::zeros(members.len());
        for (i, &index) in members.iter().enumerate() {
            let sigma = self.measurements[index].measurement.sigma;
            let (difference, row) = self.linearise(k, index, reference);
            residual[i] = (difference - row.dot(&moved)) / sigma;
            rows.set_row(i, &(row / sigma).transpose());
        }
        let of_state = &rows * &estimate.covariance * rows.transpose();
        Residuals { residual, of_state }
    }

    /// Places of the used measurements among those of the node.
    fn used(&self, k: usize) -> Vec<usize> {
        let members = self.nodes[k].members.iter().enumerate();
        members.filter(|(_, index)| !self.left_out[**index]).map(|(place, _)| place).collect()
    }
}

impl Residuals {
    /// Of an estimate that the measurements are not in: S = I + H P Hᵀ
    fn of_prediction(self) -> Disagreement {
        let covariance = unit(self.residual.len()) + self.of_state;
        Disagreement { innovation: self.residual, covariance }
    }
}

impl Disagreement {
    /// The size of each, in its standard deviations.
    fn sizes(&self, sizes: &mut Vec<f64>) {
        let variances = self.covariance.diagonal();
        sizes.extend(
            self.innovation
                .iter()
                .zip(&variances)
                .map(|(one, variance)| one.abs() / variance.sqrt()),
        );
    }
}

fn unit(size: usize) -> DMatrix<f64> {
    DMatrix::identity_generic(Dyn(size), Dyn(size))
}

/// How many times larger than stated the noise is, by the median, which outliers do not move: noise
/// that is understated everywhere makes no outliers. Noise that is less than stated counts as stated.
fn noise_scale(mut sizes: Vec<f64>) -> f64 {
    median(&mut sizes).map_or(1.0, |median| (median / NORMAL_MEDIAN).max(1.0))
}
