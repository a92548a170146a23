//! What the changes of the phases from epoch to epoch say of their noise, before any integer is known.
//!
//! A phase less what the baselines `x̂` of the code make of it is `y = λ a + gᵀ (x − x̂) + e`. In an
//! unbroken arc the ambiguity cancels between two epochs,
//!
//! `y_t − y_{t−1} = gᵀ (δ_t − δ_{t−1}) + e_t − e_{t−1}`,   `δ = x − x̂`,
//!
//! as the line of sight `g` hardly turns in between. Least squares for the change of `δ` leave twice
//! the variance of the noise, whatever the integers and the geometry are. Slow multipath cancels as
//! well: so this is the least noise that the phases have.

use crate::difference::{self, Link};
use crate::float_solution::{CodeFloat, FloatSolution};
use crate::signal::{Satellite, Signal};
use crate::sky::Variances;
use crate::time::GpsTime;

use super::noise_levels::{MAX_SQUARE, Squares};

/// Longest time between two epochs, s: the line of sight to a satellite turns by 1.9·10⁻⁴ rad/s at
/// most, which with half a metre of `δ` is 0.5 mm.
const MAX_ELAPSED_S: f64 = 5.0;
/// Successive changes share an epoch: the noise that one has too much the next one has too little.
const WEIGHT: f64 = 0.5;

/// The phases of the last epoch.
#[derive(Debug, Clone, Default)]
pub(super) struct PhaseChanges {
    last: Vec<Phase>,
    now: Vec<Phase>,
    time: Option<GpsTime>,
    /// As if they were codes.
    changes: Vec<Link>,
}

/// `y` of one link.
#[derive(Debug, Clone, Copy)]
struct Phase {
    key: (Signal, Satellite, usize),
    /// Of continuous phase.
    arc: u32,
    phase_m: f64,
    variance_m2: f64,
}

impl PhaseChanges {
    /// Compares the phases of an epoch, whose links had these variances `a_priori`, with those of the
    /// epoch before: squares in units of these variances. `None` if the changes of the baselines take up
    /// all of them.
    pub(super) fn take(
        &mut self,
        links: &[Link],
        a_priori: &[Variances],
        float: &FloatSolution,
        arc: impl Fn(&Link) -> Option<u32>,
        time: GpsTime,
    ) -> Option<Squares> {
        let elapsed_s = self.time.map_or(f64::INFINITY, |last| time - last);
        self.now.clear();
        self.changes.clear();
        for (link, variances) in links.iter().zip(a_priori) {
            let Some(phase_m) = link.phase_m else { continue };
            let phase_m = phase_m + link.whole_cycles * link.wavelength_m - float.along_m(link);
            let key = (link.signal, link.satellite, link.antenna);
            let Some(arc) = arc(link) else { continue };
            let phase = Phase { key, arc, phase_m, variance_m2: variances.phase_m2 };
            let change = before(&self.last, &phase).map(|before| {
                let mut variances = link.variances;
                variances.code_m2 = phase.variance_m2 + before.variance_m2;
                let change_m = phase.phase_m - before.phase_m;
                Link { code_m: Some(change_m), phase_m: None, variances, ..*link }
            });
            self.changes.extend(change);
            self.now.push(phase);
        }
        self.now.sort_unstable_by_key(|phase| phase.key);
        core::mem::swap(&mut self.last, &mut self.now);
        self.time = Some(time);
        if !(elapsed_s > 0.0 && elapsed_s <= MAX_ELAPSED_S) {
            return None;
        }
        let groups = difference::group(&mut self.changes);
        let solved =
            CodeFloat::solve(&self.changes, &groups, float.reference, &float.rovers).ok()?;
        let residuals = solved.residuals(&self.changes);
        let mean = residuals.iter().map(|(_, z)| z.powi(2).min(MAX_SQUARE)).sum::<f64>()
            / residuals.len().max(1) as f64;
        let degrees_of_freedom = WEIGHT * solved.fit().degrees_of_freedom as f64;
        Some(Squares { sum: mean * degrees_of_freedom, degrees_of_freedom })
    }
}

/// The same arc in the last epoch.
fn before<'a>(last: &'a [Phase], phase: &Phase) -> Option<&'a Phase> {
    let found = last.binary_search_by_key(&phase.key, |last| last.key).ok()?;
    Some(&last[found]).filter(|last| last.arc == phase.arc)
}
