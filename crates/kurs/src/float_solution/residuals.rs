//! What code and phases leave of their links, in units of their standard deviations.

use nalgebra::DVector;
use smallvec::smallvec;

use super::FloatSolution;
use super::phases::Phases;
use crate::difference::{Combination, Link, OfLinks};

impl FloatSolution {
    /// Normalised residuals of the links' code ([`CodeFloat::residuals`](super::CodeFloat::residuals)).
    #[must_use]
    pub fn code_residuals(&self, links: &[Link]) -> Vec<(usize, f64)> {
        self.code.residuals(links)
    }

    /// Redundancy of the code of each group ([`CodeFloat::redundancies`](super::CodeFloat::redundancies)).
    #[must_use]
    pub fn code_redundancies(&self) -> Vec<(usize, f64)> {
        self.code.redundancies()
    }

    /// What the residuals of each group's phases show of their squares once the integers are known, with the index of
    /// the group's first link: `n − tr(Q_x|a A_Φᵀ Q_Φ⁻¹ A_Φ)`.
    #[must_use]
    pub fn phase_redundancies(&self) -> Vec<(usize, f64)> {
        let Some(covariance_m2) = &self.conditional.covariance_m2 else { return Vec::new() };
        let of_group = |phases: &Phases| {
            let whitened = &phases.whitened_design;
            let taken = (whitened * covariance_m2).dot(whitened);
            (phases.first_link, (whitened.nrows() as f64 - taken).max(0.0))
        };
        self.phases.iter().map(of_group).collect()
    }

    /// Normalised residuals of the links' phases with these integers and baselines, as
    /// [`CodeFloat::residuals`](super::CodeFloat::residuals).
    pub fn phase_residuals(
        &self,
        links: &[Link],
        integers: &[f64],
        correction_m: &DVector<f64>,
    ) -> Vec<(usize, f64)> {
        let mut residuals: Vec<(usize, f64)> = Vec::new();
        let mut first = 0;
        for phases in &self.phases {
            let count = phases.misclosure_m.len();
            let mut weighted =
                DVector::from_fn(count, |i, _| phases.range_m(i, integers[first + i]));
            weighted.gemv(-1.0, &phases.design, correction_m, 1.0);
            first += count;
            phases.factor.solve_mut(&mut weighted);
            spread(&phases.combinations, phases.first_link, &weighted, &mut residuals);
        }
        let degrees_of_freedom = first.saturating_sub(correction_m.len());
        normalise(&mut residuals, degrees_of_freedom, |link| links[link].variances.phase_m2);
        residuals
    }
}

/// Appends `Dᵀ w` for the links that the combinations `D` contain, sorted.
fn spread(
    combinations: &[Combination],
    first_link: usize,
    weights: &DVector<f64>,
    links: &mut Vec<(usize, f64)>,
) {
    let last = combinations.iter().flatten().map(|(edge, _)| *edge).max();
    let mut sums: OfLinks<Option<f64>> = smallvec![None; last.map_or(0, |last| last + 1)];
    for (row, weight) in combinations.iter().zip(weights.iter()) {
        for (edge, sign) in row {
            *sums[*edge].get_or_insert(0.0) += sign * weight;
        }
    }
    let found =
        sums.iter().enumerate().filter_map(|(edge, sum)| Some((first_link + edge, (*sum)?)));
    links.extend(found);
}

/// From `ê/σ²` of each link to `ê/σ` over the root of the share of the variances that the residuals show.
pub(super) fn normalise(
    links: &mut Vec<(usize, f64)>,
    degrees_of_freedom: usize,
    variance_m2: impl Fn(usize) -> f64,
) {
    if degrees_of_freedom == 0 {
        links.clear();
    }
    let shown = degrees_of_freedom as f64 / links.len().max(1) as f64;
    for (link, value) in links {
        *value *= (variance_m2(*link) / shown).sqrt();
    }
}
