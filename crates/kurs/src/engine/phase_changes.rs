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

/// The phases of the first epoch of a pair: changes that share an epoch would share its noise, and teach no more at
/// twice the cost.
#[derive(Debug, Clone, Default)]
pub(super) struct PhaseChanges {
    first: Vec<Phase>,
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
    /// Takes the phases of an epoch, whose links had these variances `a_priori`: of the second one of a pair the
    /// squares of the changes, in units of these variances. `None` if the changes of the baselines take up all of them.
    pub(super) fn take(
        &mut self,
        links: &[Link],
        a_priori: &[Variances],
        float: &FloatSolution,
        arc: impl Fn(&Link) -> Option<u32>,
        time: GpsTime,
    ) -> Option<Squares> {
        let phases = links.iter().zip(a_priori).filter_map(|(link, variances)| {
            let phase_m = link.phase_m? + link.whole_cycles * link.wavelength_m;
            let key = (link.signal, link.satellite, link.antenna);
            let phase_m = phase_m - float.along_m(link);
            Some((link, Phase { key, arc: arc(link)?, phase_m, variance_m2: variances.phase_m2 }))
        });
        let elapsed_s = self.time.map_or(f64::INFINITY, |first| time - first);
        if !(elapsed_s > 0.0 && elapsed_s <= MAX_ELAPSED_S) {
            self.first.clear();
            self.first.extend(phases.map(|(_, phase)| phase));
            self.first.sort_unstable_by_key(|phase| phase.key);
            self.time = Some(time);
            return None;
        }
        self.time = None;
        self.changes.clear();
        self.changes.extend(phases.filter_map(|(link, phase)| {
            let before = before(&self.first, &phase)?;
            let mut variances = link.variances;
            variances.code_m2 = phase.variance_m2 + before.variance_m2;
            let change_m = phase.phase_m - before.phase_m;
            Some(Link { code_m: Some(change_m), phase_m: None, variances, ..*link })
        }));
        let groups = difference::group(&mut self.changes);
        let solved =
            CodeFloat::solve(&self.changes, &groups, float.reference, &float.rovers).ok()?;
        let residuals = solved.residuals(&self.changes);
        let mean = residuals.iter().map(|(_, z)| z.powi(2).min(MAX_SQUARE)).sum::<f64>()
            / residuals.len().max(1) as f64;
        let degrees_of_freedom = solved.fit().degrees_of_freedom as f64;
        Some(Squares { sum: mean * degrees_of_freedom, degrees_of_freedom })
    }
}

/// The same arc in the first epoch.
fn before<'a>(first: &'a [Phase], phase: &Phase) -> Option<&'a Phase> {
    let found = first.binary_search_by_key(&phase.key, |first| first.key).ok()?;
    Some(&first[found]).filter(|first| first.arc == phase.arc)
}
