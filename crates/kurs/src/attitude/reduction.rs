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
use super::weighted::AttitudeProblem;

/// How the errors of different baselines belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BaselineWeight {
    /// `C = I`: as published, each baseline with an error of its own.
    Independent,
    /// `C = 2 (I − 11ᵀ/m)`: all single differences share the noise of antenna 0, as they do when
    /// equal antennas are differenced. The result does not depend on which antenna is the first.
    SharedAntenna,
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
        self.check()?;
        let (satellites, rows) = (self.lines_of_sight.len(), self.sigma_m.len());
        let baselines = self.phases_m.len() / rows;

        // h̄ = Σ v h / Σ v,  φ̄ᵣ = Σ v φᵣ / Σ v
        let (mut sum, mut mean_row) = (0.0, Vector3::zeros());
        let mut mean_phases_m = vec![0.0; baselines];
        for row in 0..rows {
            let v = 1.0 / (self.sigma_m[row] * self.sigma_m[row]);
            sum += v;
            mean_row -= v * self.lines_of_sight[row % satellites];
            for (r, mean) in mean_phases_m.iter_mut().enumerate() {
                *mean += v * self.phases_m[r * rows + row];
            }
        }
        mean_row /= sum;
        mean_phases_m.iter_mut().for_each(|mean| *mean /= sum);

        let mut normal = Matrix3::zeros();
        let mut moments = vec![Vector3::zeros(); baselines];
        for row in 0..rows {
            let v = 1.0 / (self.sigma_m[row] * self.sigma_m[row]);
            let h = -self.lines_of_sight[row % satellites] - mean_row;
            let weighted = v * h;
            normal += weighted * h.transpose();
            for (r, moment) in moments.iter_mut().enumerate() {
                *moment += weighted * (self.phases_m[r * rows + row] - mean_phases_m[r]);
            }
        }
        if normal.iter().any(|c| !c.is_finite()) {
            return Err(AttitudeError::NotFinite { what: "normal matrix" });
        }
        Ok(PhaseNormal { normal, moments, mean_row, mean_phases_m })
    }

    fn check(&self) -> Result<(), AttitudeError> {
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
        if self.lines_of_sight.iter().any(|u| u.iter().any(|c| !c.is_finite())) {
            return Err(AttitudeError::NotFinite { what: "line of sight" });
        }
        if self.phases_m.iter().any(|phase| !phase.is_finite()) {
            return Err(AttitudeError::NotFinite { what: "phase" });
        }
        match self.sigma_m.iter().copied().find(|sigma| sigma.is_nan() || *sigma <= 0.0) {
            Some(value) => {
                Err(AttitudeError::NotPositive { what: "phase standard deviation", value })
            }
            None => Ok(()),
        }
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
        let c = |i: usize, j: usize| match weight {
            BaselineWeight::Independent => f64::from(u8::from(i == j)),
            BaselineWeight::SharedAntenna => {
                2.0 * (f64::from(u8::from(i == j)) - 1.0 / (found as f64 + 1.0))
            }
        };
        Ok(AttitudeProblem::separable(self.normal, &self.moments, body, c))
    }

    /// `L* = N⁻¹ b`: each baseline on its own, m. `None` where the satellites do not determine one.
    #[must_use]
    pub fn baselines_m(&self) -> Option<Vec<Vector3<f64>>> {
        let cholesky = self.normal.cholesky()?;
        let pivots = cholesky.l_dirty().diagonal();
        if pivots.min() <= 1e-6 * pivots.max() {
            return None;
        }
        Some(self.moments.iter().map(|moment| cholesky.solve(moment)).collect())
    }

    /// Clock of each single difference at the attitude `Q`, m: `φ̄ᵣ − h̄ᵀ Q lᵣ`.
    #[must_use]
    pub fn clocks_m(&self, rotation: &Matrix3<f64>, body: &[Vector3<f64>]) -> Vec<f64> {
        let pairs = self.mean_phases_m.iter().zip(body);
        pairs.map(|(mean, l)| mean - self.mean_row.dot(&(rotation * l))).collect()
    }
}
