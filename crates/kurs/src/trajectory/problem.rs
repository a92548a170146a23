//! The measurements of one instant with the stations that made them, checked once.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::measurement::Measurement;
use super::station::Station;
use crate::frames::{Ecef, Vector};

/// Measurements of one position, whose indices and numbers have been checked.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    stations: &'a [Station],
    measurements: &'a [Measurement],
    /// `None`: independent. Otherwise L of the covariance L Lᵀ (m × m).
    factor: Option<DMatrix<f64>>,
}

/// Correlation of the errors of two measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// Indices of the two measurements.
    pub between: [usize; 2],
    /// Correlation coefficient, above −1 and below 1.
    pub coefficient: f64,
}

/// What is wrong with a set of measurements.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BadProblem {
    /// A station index without a station.
    #[error("measurement {measurement}: there is no station {station}")]
    UnknownStation {
        /// Index of the measurement.
        measurement: usize,
        /// The index that has no station.
        station: usize,
    },
    /// A range difference of a station to itself.
    #[error("measurement {measurement}: a range difference needs two stations")]
    SameStation {
        /// Index of the measurement.
        measurement: usize,
    },
    /// A value that is not finite.
    #[error("measurement {measurement}: value {value} is not finite")]
    BadValue {
        /// Index of the measurement.
        measurement: usize,
        /// What was found.
        value: f64,
    },
    /// A standard deviation that is not above zero.
    #[error("measurement {measurement}: standard deviation {sigma} is not a positive number")]
    BadSigma {
        /// Index of the measurement.
        measurement: usize,
        /// What was found.
        sigma: f64,
    },
    /// Correlations that no random errors can have, or that name no pair of measurements.
    #[error("the correlations do not form a covariance matrix")]
    BadCorrelation,
}

/// The normal equations of (1) at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Normal {
    /// ZᵀWZ, 1/m².
    pub(super) matrix: Matrix3<f64>,
    /// ZᵀW(Y − Y_calc), 1/m.
    pub(super) right: Vector3<f64>,
    /// Sum of squared weighted residuals.
    pub(super) cost: f64,
}

impl Normal {
    /// The step (ZᵀWZ + λ diag ZᵀWZ)⁻¹ ZᵀWv, m; `None` if the geometry does not determine it.
    pub(super) fn step(&self, damping: f64) -> Option<Vector3<f64>> {
        let scale = self.scale()?;
        let damped = self.scaled(&scale) + Matrix3::identity() * damping;
        let solved = damped.cholesky()?.solve(&self.right.component_mul(&scale));
        Some(solved.component_mul(&scale))
    }

    /// (2): K = (ZᵀWZ)⁻¹, m²; `None` if the geometry does not determine the position.
    pub(super) fn covariance(&self) -> Option<Matrix3<f64>> {
        /// A pivot below this is rounding error.
        const MIN_PIVOT: f64 = 1e-14;
        let scale = self.scale()?;
        let factor = self.scaled(&scale).cholesky()?;
        let pivot = factor.l_dirty().diagonal().min();
        (pivot * pivot > MIN_PIVOT)
            .then(|| factor.inverse().component_mul(&(scale * scale.transpose())))
    }

    /// Inverse square roots of the diagonal: they make the matrix free of units.
    fn scale(&self) -> Option<Vector3<f64>> {
        let scale = self.matrix.diagonal().map(|d| 1.0 / d.sqrt());
        scale.iter().all(|s| s.is_finite()).then_some(scale)
    }

    fn scaled(&self, scale: &Vector3<f64>) -> Matrix3<f64> {
        self.matrix.component_mul(&(scale * scale.transpose()))
    }
}

impl<'a> Problem<'a> {
    /// Measurements with independent errors.
    ///
    /// # Errors
    ///
    /// [`BadProblem`] naming the measurement.
    pub fn new(
        stations: &'a [Station],
        measurements: &'a [Measurement],
    ) -> Result<Self, BadProblem> {
        for (index, measurement) in measurements.iter().enumerate() {
            check(index, measurement, stations.len())?;
        }
        Ok(Self { stations, measurements, factor: None })
    }

    /// Measurements some of whose errors are correlated.
    ///
    /// # Errors
    ///
    /// [`BadProblem`], also if the correlations are impossible.
    pub fn correlated(
        stations: &'a [Station],
        measurements: &'a [Measurement],
        correlations: &[Correlation],
    ) -> Result<Self, BadProblem> {
        let problem = Self::new(stations, measurements)?;
        let count = measurements.len();
        let mut covariance =
            DMatrix::from_fn(
                count,
                count,
                |i, j| if i == j { variance(&measurements[i]) } else { 0.0 },
            );
        for Correlation { between: [i, j], coefficient } in correlations.iter().copied() {
            if i == j || i.max(j) >= count {
                return Err(BadProblem::BadCorrelation);
            }
            let shared = coefficient * measurements[i].sigma * measurements[j].sigma;
            covariance[(i, j)] = shared;
            covariance[(j, i)] = shared;
        }
        let factor = covariance.cholesky().ok_or(BadProblem::BadCorrelation)?.unpack();
        Ok(Self { factor: Some(factor), ..problem })
    }

    /// The stations.
    #[must_use]
    pub const fn stations(&self) -> &'a [Station] {
        self.stations
    }

    /// The measurements.
    #[must_use]
    pub const fn measurements(&self) -> &'a [Measurement] {
        self.measurements
    }

    /// Measurements beyond the three that a position needs.
    #[must_use]
    pub const fn degrees_of_freedom(&self) -> usize {
        self.measurements.len().saturating_sub(3)
    }

    /// Covariance of the measurements, m × m.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        match &self.factor {
            Some(factor) => factor * factor.transpose(),
            None => DMatrix::from_diagonal(
                &self.measurements.iter().map(variance).collect::<Vec<_>>().into(),
            ),
        }
    }

    /// L of the measurement covariance L Lᵀ, if errors are correlated.
    #[must_use]
    pub const fn correlation_factor(&self) -> Option<&DMatrix<f64>> {
        self.factor.as_ref()
    }

    /// The problem of these stations with other values; only the values may differ. Correlations are dropped:
    /// closed forms do not use them.
    pub(super) const fn with_values<'b>(&self, measurements: &'b [Measurement]) -> Problem<'b>
    where
        'a: 'b,
    {
        Problem { stations: self.stations, measurements, factor: None }
    }

    /// The measurements without one of them.
    pub(super) fn without<'b>(&self, excluded: usize, rest: &'b mut Vec<Measurement>) -> Problem<'b>
    where
        'a: 'b,
    {
        rest.clear();
        rest.extend(
            self.measurements.iter().enumerate().filter(|(i, _)| *i != excluded).map(|(_, m)| *m),
        );
        let covariance = self.factor.is_some().then(|| self.covariance());
        let factor = covariance
            .and_then(|c| c.remove_row(excluded).remove_column(excluded).cholesky())
            .map(nalgebra::Cholesky::unpack);
        Problem { stations: self.stations, measurements: rest, factor }
    }

    /// What measurement `index` should be at a position.
    #[must_use]
    pub fn predict(&self, index: usize, position_m: Vector<Ecef>) -> f64 {
        let (station, reference) = self.stations_of(&self.measurements[index]);
        self.measurements[index].quantity.predict(station, reference, position_m)
    }

    /// Measured minus predicted, of every measurement, in its own unit.
    #[must_use]
    pub fn residuals(&self, position_m: Vector<Ecef>) -> Vec<f64> {
        (0..self.measurements.len())
            .map(|index| {
                let measurement = &self.measurements[index];
                measurement.quantity.residual(measurement.value, self.predict(index, position_m))
            })
            .collect()
    }

    /// Residual and row of Z of one measurement.
    pub(super) fn row(&self, index: usize, position_m: Vector<Ecef>) -> (f64, Vector3<f64>) {
        let measurement = &self.measurements[index];
        let (station, reference) = self.stations_of(measurement);
        let (predicted, gradient) = measurement.quantity.linearise(station, reference, position_m);
        (measurement.quantity.residual(measurement.value, predicted), gradient)
    }

    /// The normal equations at a position.
    pub(super) fn normal(&self, position_m: Vector<Ecef>) -> Normal {
        match &self.factor {
            None => self.normal_of(self.measurements.iter().enumerate().map(|(i, m)| {
                let (residual, gradient) = self.row(i, position_m);
                (residual / m.sigma, gradient / m.sigma)
            })),
            Some(factor) => self.normal_of(self.whitened(factor, position_m).into_iter()),
        }
    }

    fn normal_of(&self, rows: impl Iterator<Item = (f64, Vector3<f64>)>) -> Normal {
        let mut normal = Normal { matrix: Matrix3::zeros(), right: Vector3::zeros(), cost: 0.0 };
        for (residual, gradient) in rows {
            normal.matrix += gradient * gradient.transpose();
            normal.right += gradient * residual;
            normal.cost += residual * residual;
        }
        normal
    }

    /// Rows of L⁻¹(v, Z): those of independent errors with unit variance.
    fn whitened(
        &self,
        factor: &DMatrix<f64>,
        position_m: Vector<Ecef>,
    ) -> Vec<(f64, Vector3<f64>)> {
        let mut rows: Vec<(f64, Vector3<f64>)> = Vec::with_capacity(self.measurements.len());
        for i in 0..self.measurements.len() {
            let (mut residual, mut gradient) = self.row(i, position_m);
            for (j, (earlier_residual, earlier_gradient)) in rows.iter().enumerate() {
                residual -= factor[(i, j)] * earlier_residual;
                gradient -= earlier_gradient * factor[(i, j)];
            }
            rows.push((residual / factor[(i, i)], gradient / factor[(i, i)]));
        }
        rows
    }

    fn stations_of(&self, measurement: &Measurement) -> (&'a Station, &'a Station) {
        (&self.stations[measurement.station], &self.stations[measurement.reference_or_station()])
    }
}

fn variance(measurement: &Measurement) -> f64 {
    measurement.sigma * measurement.sigma
}

fn check(index: usize, measurement: &Measurement, stations: usize) -> Result<(), BadProblem> {
    let Measurement { station, value, sigma, .. } = *measurement;
    let reference = measurement.reference_or_station();
    let unknown = [station, reference].into_iter().find(|station| *station >= stations);
    if let Some(station) = unknown {
        return Err(BadProblem::UnknownStation { measurement: index, station });
    }
    if measurement.is_difference() && reference == station {
        return Err(BadProblem::SameStation { measurement: index });
    }
    if !value.is_finite() {
        return Err(BadProblem::BadValue { measurement: index, value });
    }
    if !(sigma.is_finite() && sigma > 0.0) {
        return Err(BadProblem::BadSigma { measurement: index, sigma });
    }
    Ok(())
}
