//! From single-difference phases to the attitude problem: the clocks are eliminated.
//!
//! Phases of all bands with known ambiguities, in metres, of `n` satellites that all antennas see
//! (Rapoport, equations 5 to 9). With `H` the rows `−uₛᵀ` of all bands, `V` the diagonal weight and
//! `h̄`, `φ̄ᵣ` the weighted means of the rows,
//!
//! ```text
//! N = Σ v (h − h̄)(h − h̄)ᵀ,   bᵣ = Σ v (h − h̄)(φᵣ − φ̄ᵣ)
//! ```
//!
//! which is `Hᵀ W̄ H` and `Hᵀ W̄ Φ` of the paper: one clock for each baseline and all bands.

use nalgebra::{Matrix3, Vector3};

use super::AttitudeError;
use super::small::Factored;
use super::weighted::AttitudeProblem;

/// Relative difference between a covariance and its transpose that passes as rounding.
const SYMMETRY: f64 = 1e-9;

/// How the errors of different baselines belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaselineWeight {
    /// `C = I`: as published, each baseline with an error of its own.
    Independent,
    /// `C = 2 (I − 11ᵀ/m)`: all single differences share the noise of antenna 0, as they do when
    /// equal antennas are differenced. The result does not depend on which antenna is the first.
    SharedAntenna,
}

impl BaselineWeight {
    /// `C` of `baselines` baselines.
    fn between(self, baselines: usize) -> impl Fn(usize, usize) -> f64 {
        move |i, j| {
            let same = f64::from(u8::from(i == j));
            match self {
                Self::Independent => same,
                Self::SharedAntenna => 2.0 * (same - 1.0 / (baselines as f64 + 1.0)),
            }
        }
    }
}

impl AttitudeProblem {
    /// The problem of baselines `body` (m, body axes) that were measured as `measured` (m, outside frame),
    /// each with the same `covariance_m2` (outside frame).
    ///
    /// # Errors
    ///
    /// Counts that do not belong together, numbers that are not finite, and a covariance that is not
    /// symmetric or not positive definite.
    pub fn of_baselines(
        body: &[Vector3<f64>],
        measured: &[Vector3<f64>],
        covariance_m2: &Matrix3<f64>,
        weight: BaselineWeight,
    ) -> Result<Self, AttitudeError> {
        let what = "covariance of a baseline";
        let (expected, found) = (body.len(), measured.len());
        if found != expected {
            return Err(AttitudeError::Shape { what: "measured baselines", expected, found });
        }
        let difference = (covariance_m2 - covariance_m2.transpose()).amax();
        if difference > SYMMETRY * covariance_m2.amax() {
            return Err(AttitudeError::NotSymmetric { what, difference });
        }
        let Some(factor) = covariance_m2.cholesky() else {
            return Err(AttitudeError::Indefinite { what });
        };
        let normal = factor.inverse();
        if measured.iter().flatten().chain(&normal).any(|number| !number.is_finite()) {
            return Err(AttitudeError::NotFinite { what: "baseline" });
        }
        let moments: Vec<_> = measured.iter().map(|baseline| normal * baseline).collect();
        Ok(Self::separable(normal, &moments, body, weight.between(found)))
    }
}

/// Phases of `k` baselines after elimination of the clocks.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseNormal {
    /// `N`, outside frame: information of one baseline, per m².
    pub normal: Matrix3<f64>,
    /// `b`: one vector for each baseline, per m.
    pub moments: Vec<Vector3<f64>>,
    mean_row: Vector3<f64>,
    mean_phases_m: Vec<f64>,
}

/// Single-difference phases of one epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingleDifferences<'a> {
    /// Unit vectors receiver → satellite, one for each satellite.
    pub lines_of_sight: &'a [Vector3<f64>],
    /// Standard deviation of each single difference: all satellites of the first band, then all of
    /// the second, and so on.
    pub sigma_m: &'a [f64],
    /// `(Δφ − ΔN) λ`, for each baseline as many as `sigma_m`, baseline after baseline.
    pub phases_m: &'a [f64],
}

impl SingleDifferences<'_> {
    /// Eliminates the clocks.
    ///
    /// # Errors
    ///
    /// Counts that do not belong together, standard deviations that are not positive, numbers that
    /// are not finite.
    pub fn reduce(&self) -> Result<PhaseNormal, AttitudeError> {
        let weights = self.weights()?;
        let rows = weights.len();
        let sum: f64 = weights.iter().sum();
        let lines = || weights.iter().zip(self.lines_of_sight.iter().cycle());

        // h̄ = Σ v h / Σ v,  N = Σ v (h − h̄)(h − h̄)ᵀ
        let mut mean_row = Vector3::zeros();
        for (v, line_of_sight) in lines() {
            mean_row -= *v * line_of_sight;
        }
        mean_row /= sum;
        let mut normal = Matrix3::<f64>::zeros();
        let weighted: Vec<Vector3<f64>> = lines()
            .map(|(v, line_of_sight)| {
                let h = -line_of_sight - mean_row;
                let weighted = *v * h;
                for column in 0..3 {
                    for row in column..3 {
                        normal[(row, column)] += weighted[row] * h[column];
                    }
                }
                weighted
            })
            .collect();
        normal.fill_upper_triangle_with_lower_triangle();
        if normal.iter().any(|c| !c.is_finite()) {
            return Err(AttitudeError::NotFinite { what: "normal matrix" });
        }

        // φ̄ᵣ = Σ v φᵣ / Σ v,  bᵣ = Σ v (h − h̄)(φᵣ − φ̄ᵣ)
        let (mut moments, mut mean_phases_m) = (Vec::new(), Vec::new());
        for phases in self.phases_m.chunks_exact(rows) {
            let mean = weights.iter().zip(phases).map(|(v, phase)| v * phase).sum::<f64>() / sum;
            let mut moment = Vector3::zeros();
            for (weighted, phase) in weighted.iter().zip(phases) {
                moment += weighted * (phase - mean);
            }
            if moment.iter().any(|c| !c.is_finite()) {
                return Err(AttitudeError::NotFinite { what: "phase" });
            }
            mean_phases_m.push(mean);
            moments.push(moment);
        }
        Ok(PhaseNormal { normal, moments, mean_row, mean_phases_m })
    }

    /// `v = σ⁻²` of every row, once the counts belong together.
    fn weights(&self) -> Result<Vec<f64>, AttitudeError> {
        let (satellites, rows) = (self.lines_of_sight.len(), self.sigma_m.len());
        if satellites < 2 {
            return Err(AttitudeError::TooFewVectors { found: satellites });
        }
        if rows == 0 || !rows.is_multiple_of(satellites) {
            let what = "standard deviations";
            return Err(AttitudeError::Shape { what, expected: satellites, found: rows });
        }
        if self.phases_m.is_empty() || !self.phases_m.len().is_multiple_of(rows) {
            let found = self.phases_m.len();
            return Err(AttitudeError::Shape { what: "phases", expected: rows, found });
        }
        let weight = |sigma: &f64| {
            if *sigma > 0.0 {
                Ok(1.0 / (sigma * sigma))
            } else {
                let what = "phase standard deviation";
                Err(AttitudeError::NotPositive { what, value: *sigma })
            }
        };
        self.sigma_m.iter().map(weight).collect()
    }
}

impl PhaseNormal {
    /// The attitude problem for the baselines `body` (m, body axes).
    ///
    /// # Errors
    ///
    /// As many body baselines as phases belong to; finite numbers.
    pub fn problem(
        &self,
        body: &[Vector3<f64>],
        weight: BaselineWeight,
    ) -> Result<AttitudeProblem, AttitudeError> {
        let (expected, found) = (self.moments.len(), body.len());
        if found != expected {
            return Err(AttitudeError::Shape { what: "body baselines", expected, found });
        }
        Ok(AttitudeProblem::separable(self.normal, &self.moments, body, weight.between(found)))
    }

    /// `L* = N⁻¹ b`: each baseline on its own, m. `None` where the satellites do not determine one.
    #[must_use]
    pub fn baselines_m(&self) -> Option<Vec<Vector3<f64>>> {
        let factored = Factored::new(&self.normal)?;
        if factored.pivots.min() <= 1e-12 * factored.pivots.max() {
            return None;
        }
        Some(self.moments.iter().map(|moment| factored.solve(moment)).collect())
    }

    /// Clock of each single difference at the attitude `Q`, m: `φ̄ᵣ − h̄ᵀ Q lᵣ`.
    #[must_use]
    pub fn clocks_m(&self, rotation: &Matrix3<f64>, body: &[Vector3<f64>]) -> Vec<f64> {
        let pairs = self.mean_phases_m.iter().zip(body);
        pairs.map(|(mean, l)| mean - self.mean_row.dot(&(rotation * l))).collect()
    }
}
