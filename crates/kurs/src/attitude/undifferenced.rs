//! Phases of antennas that see different satellites: no difference is formed.
//!
//! Phase `φ` of satellite signal `s` at antenna `i`, ambiguity known up to differences, in metres:
//!
//! ```text
//! φ = −uₛᵀ Q pᵢ + c + dₛ + noise        (c: receiver clock, dₛ: satellite clock of this signal)
//! ```
//!
//! The satellite terms are eliminated by weighted means over the antennas that see the signal, the
//! clocks by a pseudo-inverse: of every group of antennas joined by common signals one clock is
//! free, which a rank-revealing elimination finds by itself. What one antenna alone sees drops out;
//! an antenna with few satellites still helps with those it has. For antennas that see the same
//! satellites with equal noise the result is that of [`super::reduction`] with the weight of a
//! shared antenna.

use nalgebra::{DMatrix, DVector, Matrix3, SVector, Vector3};

use super::AttitudeError;
use super::weighted::{AttitudeProblem, Matrix9, matrix_of, vec_of};

/// Share of the largest eigenvalue below which a combination of clocks is free.
const FREE_CLOCK: f64 = 1e-10;

/// One phase.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UndifferencedPhase {
    /// Index of the antenna in the list of positions.
    pub antenna: usize,
    /// Number of the receiver clock, 0, 1, …: one for each antenna, or one for each antenna and
    /// system where receivers delay systems differently.
    pub clock: usize,
    /// Number of the satellite signal (satellite and band), 0, 1, …
    pub signal: usize,
    /// Standard deviation of this phase, not of a difference.
    pub sigma_m: f64,
    /// Phase with its ambiguity removed.
    pub phase_m: f64,
}

/// The attitude problem of undifferenced phases.
///
/// `positions_m` are the antennas `pᵢ` in body axes, `lines_of_sight` the unit vectors `uₛ` receiver
/// → satellite, one for each signal.
///
/// # Errors
///
/// Indices beyond the lists, standard deviations that are not positive, numbers that are not finite.
pub fn problem(
    positions_m: &[Vector3<f64>],
    lines_of_sight: &[Vector3<f64>],
    phases: &[UndifferencedPhase],
) -> Result<AttitudeProblem, AttitudeError> {
    check(positions_m, lines_of_sight, phases)?;
    let means = signal_means(positions_m, lines_of_sight.len(), phases);
    let clocks = phases.iter().map(|phase| phase.clock + 1).max().unwrap_or(0);

    let mut information = Box::new(Matrix9::zeros());
    let mut linear = Matrix3::zeros();
    // Of the clocks: normal matrix, right-hand side, and product with the nine entries of Q.
    let mut clock_normal = DMatrix::zeros(clocks, clocks);
    let mut clock_right = DVector::zeros(clocks);
    let mut join = vec![SVector::<f64, 9>::zeros(); clocks];
    for phase in phases {
        let SignalMean { weight: total, position, phase_m } = &means[phase.signal];
        let weight = 1.0 / (phase.sigma_m * phase.sigma_m);
        let p = positions_m[phase.antenna] - position;
        let y = phase.phase_m - phase_m;
        // Row −(p − p̄)ᵀ ⊗ uᵀ
        let u = lines_of_sight[phase.signal];
        let row = vec_of(&(-u * p.transpose()));
        *information += weight * row * row.transpose();
        linear += matrix_of(&(weight * y * row));
        clock_normal[(phase.clock, phase.clock)] += weight;
        clock_right[phase.clock] += weight * y;
        join[phase.clock] += weight * row;
        for other in phases.iter().filter(|other| other.signal == phase.signal) {
            let product = weight / (other.sigma_m * other.sigma_m) / total;
            clock_normal[(phase.clock, other.clock)] -= product;
        }
    }

    // G − J C⁺ Jᵀ,  h − J C⁺ r
    for (eigenvalue, vector) in determined_clocks(clock_normal) {
        let joined: SVector<f64, 9> =
            join.iter().zip(vector.iter()).map(|(column, c)| column * *c).sum();
        *information -= joined * joined.transpose() / eigenvalue;
        linear -= matrix_of(&(joined * (vector.dot(&clock_right) / eigenvalue)));
    }
    Ok(AttitudeProblem::General { information, linear })
}

/// Weighted means over the antennas that see one signal.
#[derive(Debug, Clone, Copy, Default)]
struct SignalMean {
    weight: f64,
    position: Vector3<f64>,
    phase_m: f64,
}

fn signal_means(
    positions_m: &[Vector3<f64>],
    signals: usize,
    phases: &[UndifferencedPhase],
) -> Vec<SignalMean> {
    let mut means = vec![SignalMean::default(); signals];
    for phase in phases {
        let mean = &mut means[phase.signal];
        let weight = 1.0 / (phase.sigma_m * phase.sigma_m);
        mean.weight += weight;
        // m ← m + w/W (x − m): no large sums to cancel
        let share = weight / mean.weight;
        mean.position += share * (positions_m[phase.antenna] - mean.position);
        mean.phase_m += share * (phase.phase_m - mean.phase_m);
    }
    means
}

/// Eigenvalues and eigenvectors of the clock combinations that the phases determine.
fn determined_clocks(normal: DMatrix<f64>) -> Vec<(f64, DVector<f64>)> {
    let eigen = normal.symmetric_eigen();
    let floor = FREE_CLOCK * eigen.eigenvalues.iter().fold(0.0, |largest: f64, e| largest.max(*e));
    let pairs = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    pairs
        .filter(|(value, _)| **value > floor)
        .map(|(value, vector)| (*value, vector.into_owned()))
        .collect()
}

fn check(
    positions_m: &[Vector3<f64>],
    lines_of_sight: &[Vector3<f64>],
    phases: &[UndifferencedPhase],
) -> Result<(), AttitudeError> {
    if positions_m.len() < 2 {
        return Err(AttitudeError::TooFewVectors { found: positions_m.len() });
    }
    if phases.len() < 2 {
        return Err(AttitudeError::TooFewVectors { found: phases.len() });
    }
    if positions_m.iter().chain(lines_of_sight).any(|v| v.iter().any(|c| !c.is_finite())) {
        return Err(AttitudeError::NotFinite { what: "antenna position or line of sight" });
    }
    for phase in phases {
        // A clock of its own for every phase is the most that can be.
        for (what, found, expected) in [
            ("antennas", phase.antenna, positions_m.len()),
            ("signals", phase.signal, lines_of_sight.len()),
            ("clocks", phase.clock, phases.len()),
        ] {
            if found >= expected {
                return Err(AttitudeError::Shape { what, expected, found });
            }
        }
        if phase.sigma_m.is_nan() || phase.sigma_m <= 0.0 {
            let what = "phase standard deviation";
            return Err(AttitudeError::NotPositive { what, value: phase.sigma_m });
        }
        if !phase.phase_m.is_finite() {
            return Err(AttitudeError::NotFinite { what: "phase" });
        }
    }
    Ok(())
}
