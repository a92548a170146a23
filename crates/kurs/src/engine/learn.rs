//! What the session learns from an epoch: its noise, how well the integers fit with what is known of the geometry,
//! and what the next epochs begin from.

use std::borrow::Cow;

use crate::difference::Link;
use crate::float_solution::{Fit, FloatSolution};
use crate::frames::Attitude;
use crate::sky::Variances;
use crate::solution::{AttitudeEstimate, EpochSolution, Outcome};
use crate::time::GpsTime;

use super::estimator::Estimator;
use super::fix::{Epoch, Fix};
use super::residuals::Residuals;
use super::session_fit::Geometry;
use super::settings::Constraint;
use super::stages::Judged;

/// Integers fit clearly worse with some phases than without them if the root mean square of what they leave is this
/// many times as large: noise alone makes at most a third more of the ten ambiguities of a weak model.
const CLEARLY_WORSE: f64 = 2.0;

impl Estimator {
    /// The level of the phases from their changes, before fixes teach it.
    pub(super) fn learn_changes(
        &mut self,
        links: &[Link],
        a_priori: &[Variances],
        float: &FloatSolution,
    ) {
        let (continuity, time) = (&self.continuity, self.levels.time());
        let arc = |link: &Link| {
            let arc = continuity.arc(link.antenna, link.satellite, link.signal)?;
            Some(arc.number)
        };
        if let Some(changes) = self.phase_changes.take(links, a_priori, float, arc, time) {
            self.levels.learn_changes(changes);
        }
    }

    /// The session learns how well the best integers fit, with what is known of the geometry: without the phases of
    /// mixed receivers where those are in doubt, as what they leave is not the geometry's fault. Integers that fit best
    /// to what earlier epochs know of them fit the epoch itself only if they are right, so only sure ones count; of the
    /// other epochs the best ones of the epoch by itself.
    pub(super) fn learn_fit(&mut self, epoch: &Epoch, fix: &Fix, without_mixed: Option<Fit>) {
        let Ok(found) = &fix.found else { return };
        let without_mixed = without_mixed.filter(|_| !fix.is_accepted());
        let with_lengths = || {
            let (baselines, _) = fix.baselines(epoch);
            self.lengths(&baselines).into_iter().fold(fix.misfit, Fit::plus)
        };
        let (misfit, geometry) = if let Some(misfit) = without_mixed {
            (misfit, Geometry::Fits(misfit))
        } else if epoch.float.is_recursive() && !fix.is_sure() {
            let Some(misfit) = self.misfit_alone(epoch) else { return };
            (misfit, Geometry::OnlyAgainst(misfit))
        } else if epoch.float.is_recursive() {
            let misfit = with_lengths();
            (misfit, Geometry::Fits(misfit))
        } else if self.settings.constraint != Constraint::None && found.is_without_geometry {
            (found.misfit, Geometry::Fits(with_lengths()))
        } else {
            (found.misfit, Geometry::Fits(found.misfit))
        };
        self.session_fit.hear_of_noise(self.levels.least_phase_factor());
        self.session_fit.take(misfit, geometry, self.levels.weight_of_squares(), epoch.time);
    }

    /// What the best integers of an epoch by itself cost, with what is known of the geometry.
    fn misfit_alone(&mut self, epoch: &Epoch) -> Option<Fit> {
        let Epoch { float, links, groups, .. } = epoch;
        let float = FloatSolution::solve(links, groups, float.reference, &float.rovers).ok()?;
        let problem = epoch.problem(&float, &self.settings, self.known());
        self.searches.find_constrained(&problem).ok().map(|found| found.misfit)
    }

    /// The phase levels learn from integers that nobody chose because they fit: those of a strong model, and
    /// those that earlier epochs have proven.
    pub(super) fn learn_phases(&mut self, epoch: &Epoch, fix: &Fix) {
        let Epoch { float, links, .. } = epoch;
        let proven = || {
            let cycles = |link: &Link| self.witness.proven(link, &self.continuity);
            let integers = float.integers_of(links, cycles)?;
            let conditional = float.conditional(&integers).filter(|_| !integers.is_empty())?;
            let residuals = float.phase_residuals(links, &integers, &conditional.correction_m);
            Some((Cow::Owned(residuals), conditional.phase_fit))
        };
        let strong = || {
            let is_strong = fix.conditional.is_some() && fix.is_strong() && fix.is_sure();
            is_strong.then(|| (Cow::Borrowed(fix.phase_residuals(epoch)), fix.phase_fit()))
        };
        let Some((residuals, fit)) = strong().or_else(proven) else { return };
        let residuals = Residuals {
            links,
            residuals: &residuals,
            redundancies: &float.phase_redundancies(),
            degrees_of_freedom: fit.degrees_of_freedom,
            baseline_unknowns: float.correction_m.len(),
        };
        self.levels.learn_phase(&residuals);
    }

    /// Mixed receivers: whether the phases that they may have apart from each other spoil the integers, without which
    /// these fit.
    pub(super) fn learn_mixed(&mut self, fix: &Fix, misfit_without: Option<Fit>) {
        if self.recursive.is_some() {
            let fits_without = misfit_without.is_some_and(|without| {
                fix.misfit.unit_weight() > CLEARLY_WORSE * without.unit_weight().max(1.0)
            });
            self.glonass_ifb.hear(!fix.is_accepted() && fits_without);
        }
    }

    /// What later epochs need of this one.
    pub(super) fn remember(&mut self, row: &EpochSolution, judged: Judged) {
        let searched = judged.oriented.searched;
        if let Outcome::Fixed { attitude } = &row.outcome {
            self.glonass_ifb.learn(&searched.baselines.rovers, &searched.correction_m);
            self.remember_axes(searched.epoch.time, attitude);
        }
        self.links = searched.epoch.links;
    }

    /// Keeps the body's axes of a fixed epoch; angles that antennas on one line leave open count as
    /// zero.
    fn remember_axes(&mut self, time: GpsTime, attitude: &AttitudeEstimate) {
        self.vertical.remember(time, attitude);
        let Some(heading_rad) = attitude.heading_rad else { return };
        let (pitch_rad, roll_rad) =
            (attitude.pitch_rad.unwrap_or(0.0), attitude.roll_rad.unwrap_or(0.0));
        self.ned_from_body = Some(Attitude { heading_rad, pitch_rad, roll_rad }.ned_from_body());
    }
}
