//! The antennas of a body: where they are in body axes.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::frames::{Body, Vector};

/// Antennas closer together than this are one antenna: no direction can come from them.
pub const MIN_SEPARATION_M: f64 = 0.01;
/// Antennas farther apart than this are on no body, and their integers have no bounds to search in.
pub const MAX_SEPARATION_M: f64 = 100e3;
/// An array whose second principal extent is below this share of the first is a line.
const COLLINEAR_RATIO: f64 = 1e-3;
/// An array whose third principal extent is below this share of the first is a plane.
const PLANAR_RATIO: f64 = 1e-3;

/// Antenna positions in body axes; antenna 0 is the first of the configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct AntennaArray {
    positions_m: Vec<Vector<Body>>,
}

/// What the positions span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// All on one line (two antennas always are): heading and pitch only.
    Collinear,
    /// In one plane: full attitude, if the satellites are not in a plane too.
    Planar,
    /// Not in one plane: full attitude.
    Spatial,
}

/// The positions do not make an array.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ArrayError {
    /// Fewer than two antennas.
    #[error("{found} antenna, at least two are needed for an attitude")]
    TooFew {
        /// Number of antennas given.
        found: usize,
    },
    /// Two antennas at one place.
    #[error(
        "antennas {first} and {second} are {distance_m:.4} m apart, at least {MIN_SEPARATION_M} m is needed"
    )]
    Coincident {
        /// Index of the first antenna.
        first: usize,
        /// Index of the second antenna.
        second: usize,
        /// Their distance.
        distance_m: f64,
    },
    /// Two antennas too far apart.
    #[error(
        "antennas {first} and {second} are {distance_m:.0} m apart, at most {MAX_SEPARATION_M} m make sense"
    )]
    FarApart {
        /// Index of the first antenna.
        first: usize,
        /// Index of the second antenna.
        second: usize,
        /// Their distance.
        distance_m: f64,
    },
    /// A coordinate is infinite or not a number.
    #[error("the position of antenna {antenna} is not a finite number")]
    NotFinite {
        /// Index of the antenna.
        antenna: usize,
    },
}

impl AntennaArray {
    /// An array of antennas at these phase centres (m, body axes).
    ///
    /// # Errors
    ///
    /// [`ArrayError`] for fewer than two antennas, two at one place, or numbers that are not finite.
    pub fn new(positions_m: Vec<Vector<Body>>) -> Result<Self, ArrayError> {
        if positions_m.len() < 2 {
            return Err(ArrayError::TooFew { found: positions_m.len() });
        }
        if let Some(antenna) = positions_m.iter().position(|p| !p.is_finite()) {
            return Err(ArrayError::NotFinite { antenna });
        }
        for first in 0..positions_m.len() {
            for second in first + 1..positions_m.len() {
                let distance_m = (positions_m[second] - positions_m[first]).norm();
                if distance_m < MIN_SEPARATION_M {
                    return Err(ArrayError::Coincident { first, second, distance_m });
                }
            }
        }
        Ok(Self { positions_m })
    }

    /// Whether the antennas can be on one body.
    ///
    /// # Errors
    ///
    /// [`ArrayError::FarApart`] for two that are more than [`MAX_SEPARATION_M`] apart.
    pub fn check_extent(&self) -> Result<(), ArrayError> {
        for (first, a) in self.positions_m.iter().enumerate() {
            for (second, b) in self.positions_m.iter().enumerate().skip(first + 1) {
                let distance_m = (*b - *a).norm();
                if distance_m > MAX_SEPARATION_M {
                    return Err(ArrayError::FarApart { first, second, distance_m });
                }
            }
        }
        Ok(())
    }

    /// Number of antennas, at least two.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions_m.len()
    }

    /// Never true: an array has at least two antennas.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions_m.is_empty()
    }

    /// Phase centres, m.
    #[must_use]
    pub fn positions_m(&self) -> &[Vector<Body>] {
        &self.positions_m
    }

    /// Baseline from antenna 0 to antenna `rover`, m.
    #[must_use]
    pub fn baseline_m(&self, rover: usize) -> Vector<Body> {
        self.positions_m[rover] - self.positions_m[0]
    }

    /// Baselines from antenna 0 to all others, m.
    pub fn baselines_m(&self) -> impl Iterator<Item = Vector<Body>> + '_ {
        (1..self.len()).map(|rover| self.baseline_m(rover))
    }

    /// The antennas that take part in an epoch, the reference first; `None` if they make no array.
    #[must_use]
    pub fn part(&self, reference: usize, rovers: &[usize]) -> Option<Self> {
        let antennas = core::iter::once(&reference).chain(rovers);
        Self::new(antennas.map(|antenna| self.positions_m[*antenna]).collect()).ok()
    }

    /// What the positions span, from the singular values of the centred positions.
    #[must_use]
    pub fn shape(&self) -> Shape {
        let centroid = self.positions_m.iter().fold(Vector3::zeros(), |sum, p| sum + p.xyz())
            / self.len() as f64;
        let scatter = self.positions_m.iter().fold(Matrix3::zeros(), |sum, p| {
            let from_centroid = p.xyz() - centroid;
            sum + from_centroid * from_centroid.transpose()
        });
        let mut extents = scatter.symmetric_eigenvalues().map(|e| e.max(0.0).sqrt());
        extents.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
        if extents[1] < COLLINEAR_RATIO * extents[0] {
            Shape::Collinear
        } else if extents[2] < PLANAR_RATIO * extents[0] {
            Shape::Planar
        } else {
            Shape::Spatial
        }
    }
}

/// Covariance `s² (I + 11ᵀ) ⊗ I` of `baselines` baselines from antenna 0 (3k × 3k, m²), of antennas
/// surveyed with the standard deviation `s` in each coordinate: antenna 0 is part of every baseline.
pub(crate) fn survey_covariance(baselines: usize, array_sd_m: f64) -> DMatrix<f64> {
    let variance_m2 = array_sd_m * array_sd_m;
    DMatrix::from_fn(3 * baselines, 3 * baselines, |i, j| {
        let shared = if i % 3 == j % 3 { variance_m2 } else { 0.0 };
        shared + if i == j { variance_m2 } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(positions: &[[f64; 3]]) -> Result<AntennaArray, ArrayError> {
        AntennaArray::new(positions.iter().map(|[x, y, z]| Vector::new(*x, *y, *z)).collect())
    }

    #[test]
    fn shapes() {
        let line = array(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.5, 0.0, 0.0]]).unwrap();
        assert_eq!(line.shape(), Shape::Collinear);
        let roof = array(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]).unwrap();
        assert_eq!(roof.shape(), Shape::Planar);
        let mast = array(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, -1.0]]).unwrap();
        assert_eq!(mast.shape(), Shape::Spatial);
        assert_eq!(array(&[[0.0; 3], [1.0, 0.0, 0.0]]).unwrap().shape(), Shape::Collinear);
    }

    #[test]
    fn impossible_arrays_are_refused() {
        assert_eq!(array(&[[0.0; 3]]), Err(ArrayError::TooFew { found: 1 }));
        let same = array(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.001]]);
        assert!(matches!(same, Err(ArrayError::Coincident { first: 1, second: 2, .. })));
        for far_m in [1.1e5, 1e300, f64::MAX] {
            let far = array(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, far_m, 0.0]]).unwrap();
            let refused = far.check_extent();
            assert!(matches!(refused, Err(ArrayError::FarApart { first: 0, second: 2, .. })));
        }
        let nan = array(&[[0.0; 3], [f64::NAN, 0.0, 0.0]]);
        assert_eq!(nan, Err(ArrayError::NotFinite { antenna: 1 }));
    }
}
