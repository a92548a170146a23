//! Which satellites are at fault, where all of them together do not fit.

use super::fit::{CONVERGED_M, PositionFit, Row, SUSPECT};
use super::ranges::ROUGH_SD_M;
use crate::signal::Satellite;

/// A fraction of the noise of any code.
const SETTLED_M: f64 = 0.1;
/// Steps with weights that fall with the residuals: each takes away a good part of what a fault has left.
const ROBUST_ITERATIONS: usize = 60;
/// A residual this large is a wrong bit of a range or an ephemeris, not propagation.
const GROSS_M: f64 = SUSPECT * ROUGH_SD_M;
/// How many of the satellites that explain the misfit best, and of the pairs, are left out on trial.
const TRIALS: usize = 3;
/// Probability that a faulty satellite agrees with the others by chance, faults being spread over
/// twenty times what is allowed to noise.
const CHANCE: f64 = 0.05;
/// Largest expected number of chance agreements among all ways to exclude as many satellites.
const MAX_BY_CHANCE: f64 = 0.01;

/// The rough fit without the satellites that are wrong by kilometres (a bit of a range or of an
/// ephemeris), if the others agree. They pull the position so far that elevations mean nothing, or
/// keep the iteration from its end, so they go first: by the least sum of absolute residuals, which
/// few outliers of any size hardly move. Where one still does, it is left out from the start.
pub(super) fn without_gross_faults<'a>(whole: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    robust(whole.at_the_centre(Vec::new())).or_else(|| {
        let without =
            |(_, satellite): &(Row, Satellite)| robust(whole.at_the_centre(vec![*satellite]));
        whole.rows.iter().find_map(without)
    })
}

/// The rough fit of those that agree with the fit of least absolute residuals.
fn robust(fit: PositionFit<'_>) -> Option<PositionFit<'_>> {
    let fit = least_absolute(&fit)?;
    let wrong = fit.rows.iter().filter(|(row, _)| row.misclosure_m.abs() > GROSS_M);
    let wrong = wrong.map(|(_, satellite)| *satellite);
    let excluded = fit.excluded.iter().copied().chain(wrong).collect();
    let mut without = fit.at_the_centre(excluded);
    without.converge().ok()?;
    let is_proven = without.redundancy() > 0 && without.is_consistent();
    // The reweighting may have stopped early and excluded good satellites too.
    let wrong = without.exclusions().into_iter().filter(|e| e.residual_m.abs() > GROSS_M);
    without.excluded = wrong.map(|exclusion| exclusion.satellite).collect();
    is_proven.then_some(without)
}

/// The fit of least absolute residuals, `min Σ |vᵢ|/σᵢ`, by least squares reweighted with the residuals
/// of the step before, `wᵢ ← wᵢ / max(1, |vᵢ|/σᵢ)`.
pub(super) fn least_absolute<'a>(fit: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    let mut fit = fit.clone();
    for _ in 0..ROBUST_ITERATIONS {
        let before: Vec<f64> = fit.rows.iter().map(|(row, _)| row.misclosure_m).collect();
        fit.form_rows();
        for ((row, _), residual_m) in fit.rows.iter_mut().zip(before) {
            row.weight /= (residual_m.abs() * row.weight.sqrt()).max(1.0);
        }
        let settled_m = if fit.near { SETTLED_M } else { CONVERGED_M };
        if fit.step().ok()? < settled_m {
            break;
        }
    }
    Some(fit)
}

/// The best fit without one satellite, or else without two, if it is consistent. One fault can move
/// the position so that the residual of another satellite is the largest, and two can hide each
/// other: so every pair is judged by what the two together explain.
pub(super) fn without_faults<'a>(whole: &PositionFit<'a>) -> Option<PositionFit<'a>> {
    let indices = 0..whole.rows.len();
    let one = indices.clone().map(|i| [i, i]);
    let pairs = indices.flat_map(|i| (0..i).map(move |j| [i, j]));
    best(whole, one).or_else(|| best(whole, pairs))
}

/// The fit of those that agree with the one of least absolute residuals, if they are the majority and
/// hardly agree by chance.
pub(super) fn consensus<'a>(
    whole: &PositionFit<'a>,
    central: PositionFit<'a>,
) -> Option<PositionFit<'a>> {
    let mut fit = central;
    // The reweighting may have stopped early and excluded good satellites too: the second round
    // brings them back.
    for _ in 0..2 {
        fit.excluded.clone_from(&whole.excluded);
        fit.form_rows();
        let contradicts =
            |(row, _): &&(Row, Satellite)| row.misclosure_m.abs() * row.weight.sqrt() > SUSPECT;
        let wrong = fit.rows.iter().filter(contradicts).map(|(_, satellite)| *satellite);
        fit.excluded.extend(wrong);
        fit.converge().ok()?;
    }
    let (kept, aside) = (fit.rows.len(), fit.excluded.len() - whole.excluded.len());
    // C(n, k) pʳ
    let ways: f64 = (1..=aside).map(|k| (kept + k) as f64 / k as f64).product();
    let by_chance = ways * CHANCE.powi(i32::try_from(fit.redundancy()).ok()?);
    (kept > aside && by_chance < MAX_BY_CHANCE && fit.is_consistent()).then_some(fit)
}

/// The consistent fit with the smallest residuals, of those without the rows that explain most.
fn best<'a>(
    whole: &PositionFit<'a>,
    faults: impl Iterator<Item = [usize; 2]>,
) -> Option<PositionFit<'a>> {
    let mut ranked: Vec<_> = faults.map(|rows| (whole.explained(rows), rows)).collect();
    ranked.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let trials = ranked.iter().take(TRIALS).filter_map(|(_, rows)| whole.without(*rows));
    let misfit = |fit: &PositionFit<'_>| fit.unit_weight_rms();
    trials.filter(PositionFit::is_consistent).min_by(|a, b| misfit(a).total_cmp(&misfit(b)))
}
