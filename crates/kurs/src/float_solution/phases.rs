//! The phases of a float solution: the double differences of each group, whitened by the factor of their covariance.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::FloatSolution;
use crate::difference::{Combination, Link, add_common_cycles, covariance, equations, own_links};
use crate::signal::SatelliteSet;

/// Phases of one group before whitening, as the integers need them.
#[derive(Debug, Clone)]
pub(super) struct Phases {
    pub(super) factor: Cholesky<f64, Dyn>,
    pub(super) design: DMatrix<f64>,
    /// `L⁻¹ A_Φ`
    pub(super) whitened_design: DMatrix<f64>,
    pub(super) misclosure_m: DVector<f64>,
    pub(super) covariance_m2: DMatrix<f64>,
    pub(super) wavelengths_m: DVector<f64>,
    pub(super) combinations: Vec<Combination>,
    /// The link (of the group) whose ambiguity each combination stands for.
    pub(super) own: Vec<usize>,
    pub(super) first_link: usize,
}

/// The phases of one group, before integers: `y_Φ = A_Φ x + Λ a + e`.
#[derive(Debug, Clone, Copy)]
pub struct PhaseGroup<'a> {
    /// `y_Φ` against the approximate baselines, m.
    pub misclosure_m: &'a DVector<f64>,
    /// Diagonal of `Λ`, m.
    pub wavelengths_m: &'a DVector<f64>,
    /// `A_Φ`.
    pub design: &'a DMatrix<f64>,
    /// Their covariance, m².
    pub covariance_m2: &'a DMatrix<f64>,
}

impl FloatSolution {
    /// The phases of all groups, in the order of the ambiguities.
    pub fn phase_groups(&self) -> impl Iterator<Item = PhaseGroup<'_>> {
        self.phases.iter().map(|phases| PhaseGroup {
            misclosure_m: &phases.misclosure_m,
            wavelengths_m: &phases.wavelengths_m,
            design: &phases.design,
            covariance_m2: &phases.covariance_m2,
        })
    }
}

impl Phases {
    /// `y_Φ − Λ z` of one double difference, m.
    pub(super) fn range_m(&self, row: usize, z: f64) -> f64 {
        self.misclosure_m[row] - self.wavelengths_m[row] * z
    }
}

/// Phase double differences of one group.
pub(super) fn group_phases(
    links: &[Link],
    rows: Vec<Combination>,
    first_link: usize,
    unknowns: usize,
    block: impl Fn(usize) -> Option<usize>,
) -> Option<Phases> {
    let mut covariance_m2 = covariance(&rows, |edge| links[edge].variances.phase_m2);
    add_common_cycles(&mut covariance_m2, &rows, links);
    let factor = covariance_m2.clone().cholesky().filter(|_| !rows.is_empty())?;
    let (design, misclosure_m) = equations(links, &rows, unknowns, block, |link| link.phase_m);
    let mut whitened_design = design.clone();
    factor.l_dirty().solve_lower_triangular_mut(&mut whitened_design);
    let own = own_links(&rows);
    let wavelengths_m = DVector::from_fn(rows.len(), |i, _| links[own[i]].wavelength_m);
    Some(Phases {
        factor,
        design,
        whitened_design,
        misclosure_m,
        covariance_m2,
        wavelengths_m,
        combinations: rows,
        own,
        first_link,
    })
}

/// How many satellites have a double-differenced phase.
pub(super) fn satellites_with_phase(links: &[Link], phases: &[Phases]) -> usize {
    let satellites = phases.iter().flat_map(|phases| {
        let edges = phases.combinations.iter().flatten();
        edges.map(|(edge, _)| links[phases.first_link + edge].satellite)
    });
    satellites.collect::<SatelliteSet>().len()
}
