//! Integer least squares of strong models, part after part.
//!
//! Of any part `p` of the ambiguities, `|â − z|² ≥ |âₚ − zₚ|²`, each in the metric of its own covariance: a vector that
//! is near as a whole is near in every part. So the vectors within a distance are among the combinations of those
//! within it of each part, of which strong parts, as the baselines of an array under an open sky, leave one or two; and
//! to factor the covariances of three parts takes a ninth of the whole.

use nalgebra::DMatrix;

use super::search::{Candidate, DEFAULT_HORIZON, IntegerLeastSquares};

/// Parts that are right less often than this, all of them, leave too many vectors.
const STRONG: f64 = 1.0 - 1e-6;
/// What the other parts add to the squared distance of one may be so many standard deviations more than expected.
const SIGMAS: f64 = 3.0;
/// So many combinations at most are tried.
const MAX_COMBINATIONS: usize = 16;

/// The search with its memory: keep one and call it every epoch.
#[derive(Debug, Clone)]
pub struct PartwiseLeastSquares {
    /// [`IntegerLeastSquares::horizon`]
    pub horizon: f64,
    /// The search of each part, with its budgets; its horizon follows from that of the whole.
    pub search: IntegerLeastSquares,
    nodes: usize,
    proven_to: f64,
    success_rate: f64,
}

impl Default for PartwiseLeastSquares {
    fn default() -> Self {
        let mut search = IntegerLeastSquares::default();
        search.reduced_within = DEFAULT_HORIZON;
        Self { horizon: DEFAULT_HORIZON, search, nodes: 0, proven_to: f64::NAN, success_rate: 0.0 }
    }
}

/// The vectors of a part that come into question.
#[derive(Debug)]
struct Part<'a> {
    /// Its ambiguities among all.
    rows: &'a [usize],
    nearest: Vec<Candidate>,
}

impl PartwiseLeastSquares {
    /// The `count` integer vectors nearest to `float` (n, cycles) as [`IntegerLeastSquares::solve`] finds them. Each
    /// ambiguity is in one of `parts`, whose indices rise; `covariance_among` gives the covariance of such ambiguities
    /// (cycles²), `squared_distance` that of a whole vector, `None` where it cannot tell. `None` where the parts are
    /// too weak by themselves, and where what they leave is not proven to hold the nearest ones.
    pub fn solve(
        &mut self,
        float: &[f64],
        parts: &[Vec<usize>],
        covariance_among: impl Fn(&[usize]) -> DMatrix<f64>,
        squared_distance: impl Fn(&[i64]) -> Option<f64>,
        count: usize,
    ) -> Option<Vec<Candidate>> {
        (self.nodes, self.success_rate, self.proven_to) = (0, 1.0, f64::INFINITY);
        let mut searched: Vec<Part> = Vec::with_capacity(parts.len());
        for rows in parts {
            // χ² of the other ambiguities
            let others = float.len().saturating_sub(rows.len()) as f64;
            self.search.horizon = self.horizon + others + SIGMAS * (2.0 * others).sqrt();
            let of_part: Vec<f64> = rows.iter().map(|row| float[*row]).collect();
            let nearest = self.search.solve(&of_part, &covariance_among(rows), count);
            self.nodes += self.search.nodes();
            self.success_rate *= self.search.success_rate();
            searched.push(Part { rows, nearest: nearest.ok().filter(|_| !self.are_weak())? });
            self.proven_to = self.proven_to.min(self.search.proven_to());
        }

        let whole = |integers: Vec<i64>| {
            let squared_distance = squared_distance(&integers)?;
            Some(Candidate { integers, squared_distance })
        };
        let first = whole(combination(&searched, 0, float.len()))?;
        let near = first.squared_distance + self.horizon;
        searched.iter_mut().for_each(|p| p.nearest.retain(|one| one.squared_distance <= near));
        let combinations: usize = searched.iter().map(|part| part.nearest.len()).product();
        if combinations > MAX_COMBINATIONS {
            return None;
        }
        let others =
            (1..combinations).map(|which| whole(combination(&searched, which, float.len())));
        let mut found = others.collect::<Option<Vec<Candidate>>>()?;
        found.push(first);
        found.sort_by(|a, b| a.squared_distance.total_cmp(&b.squared_distance));
        found.truncate(count);
        let mut radius = found.first()?.squared_distance + self.horizon;
        if found.len() == count {
            radius = radius.min(found[count - 1].squared_distance);
        }
        found.retain(|one| one.squared_distance <= radius);
        let is_proven = radius <= self.proven_to;
        self.proven_to = radius;
        is_proven.then_some(found)
    }

    /// [`IntegerLeastSquares::proven_to`]
    #[must_use]
    pub fn proven_to(&self) -> f64 {
        self.proven_to
    }

    /// Nodes that the last call of [`solve`](Self::solve) has visited in all parts.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Whether the parts of the last call of [`solve`](Self::solve) leave too many vectors by themselves.
    #[must_use]
    pub fn are_weak(&self) -> bool {
        self.success_rate < STRONG
    }

    /// How often the parts of the last call of [`solve`](Self::solve) are all right, as if they knew nothing of each
    /// other: bootstrapped, as far as they were searched.
    #[must_use]
    pub fn success_rate(&self) -> f64 {
        self.success_rate
    }
}

/// The combination `which` of the vectors of the parts; 0 is that of the nearest ones.
fn combination(parts: &[Part], mut which: usize, ambiguities: usize) -> Vec<i64> {
    let mut integers = vec![0; ambiguities];
    for Part { rows, nearest } in parts {
        let count = nearest.len().max(1);
        if let Some(one) = nearest.get(which % count) {
            for (row, integer) in rows.iter().zip(&one.integers) {
                integers[*row] = *integer;
            }
        }
        which /= count;
    }
    integers
}

#[cfg(test)]
mod tests {
    use nalgebra::{DVector, Vector3};

    use super::super::problems::{L1_M, L2_M, Noise, Sky, float_near_integers, seeded};
    use super::*;

    /// Two baselines of one epoch of random skies, from strong to weak: what the parts prove is what the search of the
    /// whole finds.
    #[test]
    fn parts_find_what_the_whole_finds() {
        let mut random = seeded(11);
        let (mut whole, mut apart) =
            (IntegerLeastSquares::default(), PartwiseLeastSquares::default());
        // So far that there are rivals.
        (whole.horizon, apart.horizon) = (400.0, 400.0);
        let (mut proven, mut several) = (0, 0);
        for case in 0..1200 {
            let noise = Noise { code_m: [0.1, 0.2, 0.4][case % 3], phase_m: 0.003 };
            let bands = [L1_M, L2_M];
            let baselines_m = [Vector3::x(), Vector3::y()];
            let sky = Sky::random(&mut random, 6 + case % 7);
            let q = sky.epoch(&mut random, &bands, noise, &baselines_m).float.ambiguity_covariance;
            let float = float_near_integers(&mut random, &q);
            let half = q.nrows() / 2;
            let parts = [(0..half).collect(), (half..q.nrows()).collect()];
            let factor = q.clone().cholesky().unwrap();
            let distance = |integers: &[i64]| {
                let off = float.iter().zip(integers).map(|(a, z)| a - *z as f64);
                let off = DVector::from_iterator(float.len(), off);
                Some(off.dot(&factor.solve(&off)))
            };
            let among = |rows: &[usize]| q.select_rows(rows).select_columns(rows);
            let Some(found) = apart.solve(&float, &parts, among, distance, 4) else { continue };
            let expected = whole.solve(&float, &q, 4).unwrap();
            assert_eq!(found.len(), expected.len(), "case {case}");
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(found.integers, expected.integers, "case {case}");
                let off = found.squared_distance - expected.squared_distance;
                assert!(off.abs() < 1e-6 * expected.squared_distance, "case {case}: {off:e}");
            }
            assert!((apart.proven_to() - whole.proven_to()).abs() < 1e-6 * whole.proven_to());
            proven += 1;
            several += usize::from(found.len() > 1);
        }
        assert!(proven > 100 && several > 30, "{proven} proven, {several} with a rival");
    }

    #[test]
    fn weak_parts_are_left_to_the_whole() {
        let q = DMatrix::from_diagonal_element(2, 2, 0.1);
        let mut apart = PartwiseLeastSquares::default();
        let among = |rows: &[usize]| q.select_rows(rows).select_columns(rows);
        let found = apart.solve(&[0.1, 0.2], &[vec![0], vec![1]], among, |_| Some(0.5), 2);
        assert_eq!(found, None);
        assert!(apart.success_rate() < 0.9);
    }
}
