//! The Kalman kernels shared by the filters here: numbers only, nothing allocated per update.
//!
//! Measurements of one instant are linearised together, gated against the covariance before any of
//! them, and then absorbed one scalar after another; with independent noise that is the batch
//! update, equation (9)–(10), without a matrix inverse. P hᵀ is formed once for each measurement and
//! carried through the updates before it, so that P itself is written once for all of them.

use nalgebra::{DMatrix, DVector};

/// Covariance of the state error and the correction collected from the measurements of one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// P (n×n).
    pub covariance: DMatrix<f64>,
    /// δx: sum of the corrections since `Estimate::begin`.
    pub correction: DVector<f64>,
    /// For each measurement of a batch p = P hᵀ, after the ones before it.
    projections: Vec<f64>,
    /// For each accepted one what is taken from P: K pᵀ + r Kᵀ.
    downdates: Vec<f64>,
}

/// Linearised scalar measurements of one instant.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Batch {
    states: usize,
    gradients: Vec<f64>,
    innovations: Vec<f64>,
    variances: Vec<f64>,
    outcomes: Vec<UpdateOutcome>,
}

/// What became of one scalar measurement.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UpdateOutcome {
    /// Passed the gate and was used.
    pub accepted: bool,
    /// ν² / (h P hᵀ + N), with ν and P after the measurements before it; 0 if rejected.
    pub normalised_square: f64,
}

/// Which innovations are refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gate {
    /// None.
    Open,
    /// As published, equation (16): ν² < k² N. Ignores the uncertainty of the prediction and so
    /// locks the filter out in every transient.
    NoiseOnly {
        /// k.
        sigmas: f64,
    },
    /// ν² < k² (H P Hᵀ + N).
    Innovation {
        /// k.
        sigmas: f64,
    },
}

impl Batch {
    /// Empties the batch for gradients of `states` elements.
    pub fn begin(&mut self, states: usize) {
        self.states = states;
        self.gradients.clear();
        self.innovations.clear();
        self.variances.clear();
        self.outcomes.clear();
    }

    /// Adds a measurement; returns its gradient (one row of H) filled with zeros, to be written.
    pub fn push(&mut self, innovation: f64, variance: f64) -> &mut [f64] {
        self.innovations.push(innovation);
        self.variances.push(variance);
        let start = self.gradients.len();
        self.gradients.resize(start + self.states, 0.0);
        &mut self.gradients[start..]
    }

    /// Number of measurements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.innovations.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.innovations.is_empty()
    }

    /// Row `k` of H.
    #[must_use]
    pub fn gradient(&self, k: usize) -> &[f64] {
        &self.gradients[k * self.states..(k + 1) * self.states]
    }

    /// Measured minus predicted.
    #[must_use]
    pub fn innovations(&self) -> &[f64] {
        &self.innovations
    }

    /// What became of each, after [`Estimate::update`].
    #[must_use]
    pub fn outcomes(&self) -> &[UpdateOutcome] {
        &self.outcomes
    }
}

impl Estimate {
    /// With independent initial errors of the given standard deviations.
    #[must_use]
    pub fn new(standard_deviations: &[f64]) -> Self {
        let n = standard_deviations.len();
        let variances = DVector::from_iterator(n, standard_deviations.iter().map(|sd| sd * sd));
        Self {
            covariance: DMatrix::from_diagonal(&variances),
            correction: DVector::zeros(n),
            projections: Vec::new(),
            downdates: Vec::new(),
        }
    }

    /// P ← Φ P Φᵀ, where `transition` multiplies one column by Φ in place.
    ///
    /// Φ (Φ P)ᵀ is the same for a symmetric P, so that the sparse Φ is applied to contiguous
    /// columns only.
    pub fn propagate(&mut self, transition: impl Fn(&mut [f64])) {
        let n = self.correction.len();
        let covariance = self.covariance.as_mut_slice();
        covariance.chunks_exact_mut(n).for_each(&transition);
        match n {
            17 => transpose(17, covariance),
            20 => transpose(20, covariance),
            n => transpose(n, covariance),
        }
        covariance.chunks_exact_mut(n).for_each(transition);
    }

    /// Makes one state unknown again: independent of the others, with a standard deviation.
    pub fn forget(&mut self, state: usize, standard_deviation: f64) {
        self.covariance.row_mut(state).fill(0.0);
        self.covariance.column_mut(state).fill(0.0);
        self.covariance[(state, state)] = standard_deviation * standard_deviation;
    }

    /// Gates the batch against the covariance before it, then absorbs what passed, in its order.
    /// The correction of the state is left in [`Estimate::correction`].
    pub fn update(&mut self, batch: &mut Batch, gate: Gate) {
        self.correction.fill(0.0);
        self.project(batch);
        for k in 0..batch.len() {
            let accepted = self.passes(gate, batch, k);
            batch.outcomes.push(UpdateOutcome { accepted, normalised_square: 0.0 });
        }
        self.downdates.clear();
        for k in 0..batch.len() {
            if batch.outcomes[k].accepted {
                batch.outcomes[k].normalised_square = self.absorb(batch, k);
            }
        }
        self.take_from_covariance();
    }

    fn passes(&self, gate: Gate, batch: &Batch, k: usize) -> bool {
        let square = batch.innovations[k].powi(2);
        match gate {
            Gate::Open => square.is_finite(),
            Gate::NoiseOnly { sigmas } => square < sigmas * sigmas * batch.variances[k],
            Gate::Innovation { sigmas } => {
                let n = self.correction.len();
                let projection = &self.projections[k * n..][..n];
                let s = dot(batch.gradient(k), projection) + batch.variances[k];
                square < sigmas * sigmas * s
            }
        }
    }

    /// One scalar measurement in Joseph's form; returns its normalised squared innovation.
    fn absorb(&mut self, batch: &Batch, k: usize) -> f64 {
        let n = self.correction.len();
        let gradient = batch.gradient(k);
        let (before, later) = self.projections.split_at_mut((k + 1) * n);
        let p = &before[k * n..];
        // S = h P hᵀ + N,  K = P hᵀ / S,  r = p − K S
        let s = dot(gradient, p) + batch.variances[k];
        let start = self.downdates.len();
        self.downdates.resize(start + 3 * n, 0.0);
        let (gain, rest) = self.downdates[start..].split_at_mut(n);
        let (copy, remainder) = rest.split_at_mut(n);
        for i in 0..n {
            gain[i] = p[i] / s;
            copy[i] = p[i];
            remainder[i] = p[i] - gain[i] * s;
        }
        // What the measurements before this one already corrected is no longer in the innovation.
        let left = batch.innovations[k] - dot(gradient, self.correction.as_slice());
        for (sum, gain) in self.correction.iter_mut().zip(&*gain) {
            *sum += left * gain;
        }
        // (I − K h) P (I − K h)ᵀ + K N Kᵀ = P − K pᵀ − r Kᵀ, times the gradients still to come
        for (j, other) in later.chunks_exact_mut(n).enumerate() {
            let gradient = batch.gradient(k + 1 + j);
            let (by_p, by_gain) = (dot(gradient, copy), dot(gradient, gain));
            for i in 0..n {
                other[i] -= gain[i] * by_p + remainder[i] * by_gain;
            }
        }
        left * left / s
    }

    /// P ← P − Σ (K pᵀ + r Kᵀ), without the asymmetry that rounding leaves.
    fn take_from_covariance(&mut self) {
        let n = self.correction.len();
        let covariance = self.covariance.as_mut_slice();
        match n {
            17 => take(17, covariance, &self.downdates),
            20 => take(20, covariance, &self.downdates),
            n => take(n, covariance, &self.downdates),
        }
    }

    /// P hᵀ of every measurement, with the zeros of h skipped.
    fn project(&mut self, batch: &Batch) {
        let n = self.correction.len();
        self.projections.clear();
        self.projections.resize(batch.len() * n, 0.0);
        for (k, projection) in self.projections.chunks_exact_mut(n).enumerate() {
            let columns = self.covariance.as_slice().chunks_exact(n);
            for (column, weight) in columns.zip(batch.gradient(k)) {
                if *weight != 0.0 {
                    for (sum, value) in projection.iter_mut().zip(column) {
                        *sum += weight * value;
                    }
                }
            }
        }
    }
}

// The kernels below are called with the usual numbers of states as constants: loops of a known
// length take several values at a time.

/// Transposes an n×n matrix.
#[inline(always)]
fn transpose(n: usize, values: &mut [f64]) {
    for j in 1..n {
        for i in 0..j {
            values.swap(i * n + j, j * n + i);
        }
    }
}

/// P ← P − Σ (K pᵀ + r Kᵀ) for P of n×n, from the rows K, p, r of `downdates`.
#[inline(always)]
fn take(n: usize, covariance: &mut [f64], downdates: &[f64]) {
    for (j, column) in covariance.chunks_exact_mut(n).enumerate() {
        for downdate in downdates.chunks_exact(3 * n) {
            let (gain, p, remainder) =
                (&downdate[..n], &downdate[n..2 * n], &downdate[2 * n..3 * n]);
            for i in 0..n {
                column[i] -= gain[i] * p[j] + remainder[i] * gain[j];
            }
        }
    }
    for j in 1..n {
        for i in 0..j {
            let mean = (covariance[i * n + j] + covariance[j * n + i]) / 2.0;
            covariance[i * n + j] = mean;
            covariance[j * n + i] = mean;
        }
    }
}

/// Adds the covariance that white noise of spectral density `density` at the end of a chain of
/// integrators gives in `step_s`; `chain` lists the states from the last integral to the first.
pub fn add_integrated_noise(
    covariance: &mut DMatrix<f64>,
    chain: &[usize],
    density: f64,
    step_s: f64,
) {
    // qₐᵦ = q ∫ τᵃ/a! τᵇ/b! dτ = q Δtᵃ⁺ᵇ⁺¹ / (a! b! (a + b + 1)),  a, b integrations after the first
    const FACTORIAL: [f64; 4] = [1.0, 1.0, 2.0, 6.0];
    for (i, row) in chain.iter().enumerate() {
        for (j, column) in chain.iter().enumerate() {
            let (a, b) = (chain.len() - 1 - i, chain.len() - 1 - j);
            let mut power = density * step_s;
            for _ in 0..a + b {
                power *= step_s;
            }
            let divisor = FACTORIAL[a] * FACTORIAL[b] * (a + b + 1) as f64;
            covariance[(*row, *column)] += power / divisor;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A correlated covariance of three states.
    fn estimate() -> Estimate {
        let mut estimate = Estimate::new(&[1.0, 2.0, 0.5]);
        let root = DMatrix::from_row_slice(3, 3, &[1.0, 0.3, -0.2, 0.0, 1.5, 0.4, 0.1, 0.0, 0.8]);
        estimate.covariance = &root * root.transpose();
        estimate
    }

    /// W = P Hᵀ (H P Hᵀ + N)⁻¹, P = (I − W H) P, from the textbook with a full inverse.
    #[test]
    fn sequential_scalars_are_the_batch() {
        let mut estimate = estimate();
        let h = DMatrix::from_row_slice(2, 3, &[1.0, 0.0, 0.5, 0.2, -1.0, 0.0]);
        let nu = DVector::from_vec(vec![0.7, -0.4]);
        let noise = DMatrix::from_diagonal(&DVector::from_vec(vec![0.3, 0.6]));
        let p = estimate.covariance.clone();
        let s = &h * &p * h.transpose() + noise;
        let inverse = s.try_inverse().unwrap();
        let w = &p * h.transpose() * &inverse;
        let expected = (DMatrix::identity(3, 3) - &w * &h) * &p;
        let nis = (nu.transpose() * &inverse * &nu)[0];

        let mut batch = Batch::default();
        batch.begin(3);
        batch.push(0.7, 0.3).copy_from_slice(&[1.0, 0.0, 0.5]);
        batch.push(-0.4, 0.6).copy_from_slice(&[0.2, -1.0, 0.0]);
        estimate.update(&mut batch, Gate::Open);
        assert!((&estimate.correction - w * nu).norm() < 1e-14);
        assert!((&estimate.covariance - expected).norm() < 1e-14);
        let sum: f64 = batch.outcomes().iter().map(|outcome| outcome.normalised_square).sum();
        assert!((sum - nis).abs() < 1e-14);
    }

    /// An innovation of 4 against N = 1 and H P Hᵀ = 15 is unlikely for the noise alone only.
    #[test]
    fn the_gates_differ_by_the_uncertainty_of_the_prediction() {
        for (gate, accepted) in [
            (Gate::Open, true),
            (Gate::NoiseOnly { sigmas: 3.0 }, false),
            (Gate::Innovation { sigmas: 3.0 }, true),
            (Gate::Innovation { sigmas: 0.9 }, false),
        ] {
            let mut estimate = Estimate::new(&[15f64.sqrt()]);
            let mut batch = Batch::default();
            batch.begin(1);
            batch.push(4.0, 1.0)[0] = 1.0;
            estimate.update(&mut batch, gate);
            assert_eq!(batch.outcomes()[0].accepted, accepted, "{gate:?}");
        }
    }

    #[test]
    fn not_a_number_never_passes() {
        for gate in [Gate::Open, Gate::NoiseOnly { sigmas: 3.0 }, Gate::Innovation { sigmas: 3.0 }]
        {
            let mut estimate = estimate();
            let before = estimate.covariance.clone();
            let mut batch = Batch::default();
            batch.begin(3);
            batch.push(f64::NAN, 1.0)[0] = 1.0;
            estimate.update(&mut batch, gate);
            assert_eq!(estimate.covariance, before);
        }
    }

    #[test]
    fn propagation_is_phi_p_phi_transposed() {
        let mut estimate = estimate();
        let phi = DMatrix::from_row_slice(3, 3, &[1.0, 0.1, 0.005, 0.0, 1.0, 0.1, 0.0, 0.0, 1.0]);
        let expected = &phi * &estimate.covariance * phi.transpose();
        estimate.propagate(|x| {
            x[0] += 0.1 * x[1] + 0.005 * x[2];
            x[1] += 0.1 * x[2];
        });
        assert!((&estimate.covariance - expected).norm() < 1e-14);
    }

    /// The published clock block, equation (24), and the noise of two half steps.
    #[test]
    fn integrated_noise() {
        let mut q = DMatrix::zeros(2, 2);
        add_integrated_noise(&mut q, &[0, 1], 0.01, 0.1);
        let expected = DMatrix::from_row_slice(2, 2, &[1e-5 / 3.0, 5e-5, 5e-5, 1e-3]);
        assert!((q - expected).norm() < 1e-18);

        let (mut once, mut twice) = (DMatrix::zeros(3, 3), DMatrix::zeros(3, 3));
        add_integrated_noise(&mut once, &[0, 1, 2], 2.0, 1.0);
        add_integrated_noise(&mut twice, &[0, 1, 2], 2.0, 0.5);
        let phi = DMatrix::from_row_slice(3, 3, &[1.0, 0.5, 0.125, 0.0, 1.0, 0.5, 0.0, 0.0, 1.0]);
        twice = &phi * &twice * phi.transpose();
        add_integrated_noise(&mut twice, &[0, 1, 2], 2.0, 0.5);
        assert!((once - twice).norm() < 1e-15);
    }
}
