//! What a solution leaves of each signal: residuals of the double differences, given back to the
//! links between antennas and satellites that they are made of.
//!
//! Double differences `D y` say nothing of clocks, so the error of one link is known only through
//! them; its most probable value, given the residuals `r = D y − A x` of its group, is
//!
//! `ê = Σ Dᵀ Q⁻¹ r`,   `Σ = diag(σ²)`,   `Q = D Σ Dᵀ`
//!
//! For phases `Q` also holds the cycles common to a receiver, which GLONASS channels scale differently.

use core::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::difference::{Link, add_common_cycles, combinations, covariance, equations, own_links};
use crate::solution::{IntegerSum, SignalResidual};

/// One kind of observation of a link.
struct Kind {
    value_m: fn(&Link) -> Option<f64>,
    variance_m2: fn(&Link) -> f64,
    has_cycles: bool,
}

const CODE: Kind =
    Kind { value_m: |l| l.code_m, variance_m2: |l| l.variances.code_m2, has_cycles: false };
const PHASE: Kind =
    Kind { value_m: |l| l.phase_m, variance_m2: |l| l.variances.phase_m2, has_cycles: true };

/// The solution whose residuals are wanted.
#[derive(Debug, Clone, Copy)]
pub struct Solved<'a> {
    /// Antennas that the baselines lead to, in the order of their blocks.
    pub rovers: &'a [usize],
    /// Corrections to the approximate baselines, ECEF, m (3k).
    pub correction_m: &'a DVector<f64>,
    /// Integers in the order of the float solution's ambiguities, cycles; `None`: no phase
    /// residuals.
    pub integers: Option<&'a [f64]>,
}

/// Residuals of every link that takes part in a double difference, in the order of the links.
#[must_use]
pub fn signal_residuals(
    links: &[Link],
    groups: &[Range<usize>],
    solved: &Solved<'_>,
) -> Vec<SignalResidual> {
    let mut residuals = Vec::with_capacity(links.len());
    let mut integers = solved.integers.unwrap_or_default().iter();
    for range in groups {
        let of_group = &links[range.clone()];
        let code = of_links(of_group, solved, &CODE, |_| 0.0);
        let phase = solved.integers.and_then(|_| {
            let cycles =
                |own: usize| of_group[own].wavelength_m * integers.next().copied().unwrap_or(0.0);
            of_links(of_group, solved, &PHASE, cycles)
        });
        residuals.extend(of_group.iter().enumerate().map(|(i, link)| SignalResidual {
            antenna: link.antenna,
            satellite: link.satellite,
            signal: link.signal,
            azimuth_rad: link.direction.azimuth_rad(),
            elevation_rad: link.direction.elevation_rad(),
            code_m: code.as_ref().and_then(|of_link| of_link[i]),
            phase_m: phase.as_ref().and_then(|of_link| of_link[i]),
            missing_db: link.missing_db,
        }));
    }
    residuals
}

/// The integers, each with the links whose whole cycles it adds up.
#[must_use]
pub fn integer_sums(links: &[Link], groups: &[Range<usize>], integers: &[f64]) -> Vec<IntegerSum> {
    let mut sums = Vec::with_capacity(integers.len());
    for range in groups {
        let of_group = &links[range.clone()];
        for row in combinations(of_group, |link| link.phase_m.is_some()) {
            let term = |(edge, sign): &(usize, f64)| {
                let link = &of_group[*edge];
                (link.antenna, link.satellite, link.signal, whole(*sign))
            };
            let taken_out = |(edge, sign): &(usize, f64)| sign * of_group[*edge].whole_cycles;
            sums.push(IntegerSum {
                links: row.iter().map(term).collect(),
                cycles: whole(row.iter().map(taken_out).sum()),
            });
        }
    }
    for (sum, integer) in sums.iter_mut().zip(integers) {
        sum.cycles += whole(*integer);
    }
    sums
}

#[allow(clippy::cast_possible_truncation)] // integers already
fn whole(value: f64) -> i64 {
    value.round() as i64
}

/// `Σ Dᵀ Q⁻¹ r` of one group and one kind of observation; `None` without a double
/// difference.
fn of_links(
    links: &[Link],
    solved: &Solved<'_>,
    kind: &Kind,
    known_m: impl FnMut(usize) -> f64,
) -> Option<Vec<Option<f64>>> {
    let Kind { value_m, variance_m2, has_cycles } = kind;
    let rows = combinations(links, |link| value_m(link).is_some());
    let mut covariance_m2 = covariance(&rows, |edge| variance_m2(&links[edge]));
    if *has_cycles {
        add_common_cycles(&mut covariance_m2, &rows, links);
    }
    let factor = covariance_m2.cholesky()?;
    let block = |antenna| solved.rovers.iter().position(|rover| *rover == antenna);
    let unknowns = solved.correction_m.len();
    let (design, misclosure_m): (DMatrix<f64>, DVector<f64>) =
        equations(links, &rows, unknowns, block, value_m);
    let known_m = DVector::from_iterator(rows.len(), own_links(&rows).into_iter().map(known_m));
    let weighted = factor.solve(&(misclosure_m - design * solved.correction_m - known_m));
    let mut of_link = vec![None; links.len()];
    for (row, weight) in rows.iter().zip(weighted.iter()) {
        for (edge, sign) in row {
            *of_link[*edge].get_or_insert(0.0) += variance_m2(&links[*edge]) * sign * weight;
        }
    }
    Some(of_link)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{Satellite, Signal, System};
    use crate::sky::{SkyDirection, Variances};
    use nalgebra::Vector3;

    /// Two antennas and five satellites without geometry: link values are clock terms, and
    /// satellite 3 at antenna 1 is off by 4 m in code and by 8 mm on 7 cycles in phase.
    #[test]
    fn the_faulty_link_stands_out() {
        let wavelength_m = 0.2;
        let links: Vec<Link> = (1..=5_u8)
            .flat_map(|number| [0, 1].map(|antenna| (antenna, number)))
            .map(|(antenna, number)| {
                let faulty = if (antenna, number) == (1, 3) { 1.0 } else { 0.0 };
                let clocks_m = 100.0 * antenna as f64 - 9.0 * f64::from(number);
                Link {
                    antenna,
                    satellite: Satellite::new(System::Gps, number),
                    signal: Signal::new(System::Gps, 1, b'C'),
                    code_m: Some(clocks_m + 4.0 * faulty),
                    phase_m: Some(clocks_m + (7.0 * wavelength_m + 0.008) * faulty),
                    whole_cycles: 0.0,
                    common_sd_cycles: 0.0,
                    wavelength_m,
                    variances: Variances { code_m2: 0.09, phase_m2: 9e-6 },
                    cn0_dbhz: None,
                    missing_db: 0.0,
                    bands: 1,
                    gradient: Vector3::zeros(),
                    direction: SkyDirection::from_angles(0.0, 0.1 * f64::from(number)),
                }
            })
            .collect();
        // Reference satellite 5; ambiguities of satellites 1 to 4.
        let whole = 0..links.len();
        let found = signal_residuals(
            &links,
            std::slice::from_ref(&whole),
            &Solved {
                rovers: &[1],
                correction_m: &DVector::zeros(3),
                integers: Some(&[0.0, 0.0, 7.0, 0.0]),
            },
        );
        assert_eq!(found.len(), 10);
        // Half of the error goes to the other antenna, and a fifth to the receivers' clocks.
        for residual in &found {
            let sign = if residual.antenna == 1 { 1.0 } else { -1.0 };
            let share = if residual.satellite.number == 3 { 0.4 } else { -0.1 };
            assert!((residual.code_m.unwrap() - sign * share * 4.0).abs() < 1e-12, "{residual:?}");
            assert!((residual.phase_m.unwrap() - sign * share * 0.008).abs() < 1e-12);
        }
    }
}
