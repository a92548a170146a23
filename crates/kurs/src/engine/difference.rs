//! Links of all antennas, their noise, double differences and the float solution.

use crate::difference::{self, Link};
use crate::ephemeris::NavigationData;
use crate::float_solution::{CodeFloat, Fit, FloatSolution, NoFloat};
use crate::link_noise;
use crate::observation::ArrayEpoch;
use crate::solution::{EpochSolution, Reason};

use super::estimator::Estimator;
use super::fix::Epoch;
use super::locate::{CommonFrame, Located, select, shared_satellites};
use super::residuals::Residuals;

/// Outliers of the code hide each other; after two rounds hardly any is left.
const MAX_REWEIGHTINGS: usize = 2;

impl Estimator {
    /// Double differences and the float solution of all antennas that can take part; those that cannot are
    /// named in the row.
    pub(super) fn difference(
        &mut self,
        navigation: &NavigationData,
        observed: &ArrayEpoch,
        located: &mut Vec<Located>,
        row: &mut EpochSolution,
    ) -> Result<Epoch, Reason> {
        // Where the first antenna is silent, no other takes its place.
        let is_there = located.first().is_some_and(|one| one.antenna == 0);
        let pinned_m = self.settings.first_antenna_m.filter(|_| is_there);
        loop {
            let frame = select(located, pinned_m, &mut row.idle_antennas)?;
            let mut links = core::mem::take(&mut self.links);
            self.form_links(navigation, observed, located, &frame, &mut links);
            let groups = difference::group(&mut links);
            row.shared_satellites = row.shared_satellites.max(shared_satellites(&links));
            match self.float(&mut links, &groups, &frame) {
                Ok((float, code_fit)) => {
                    let time = self.settings.direction.running_time(observed.time);
                    let began_anew = false;
                    return Ok(Epoch { time, frame, links, groups, float, code_fit, began_anew });
                }
                Err(_) => {
                    let weakest = weakest(located, &links, pinned_m.is_some());
                    self.links = links;
                    let reason = Reason::FewSatellites;
                    let Some(weakest) = weakest.filter(|_| located.len() > 2) else {
                        return Err(reason);
                    };
                    row.idle_antennas.push((located.remove(weakest).antenna, reason));
                }
            }
        }
    }

    /// Observed less computed for every antenna, at its own reception time.
    fn form_links(
        &mut self,
        navigation: &NavigationData,
        observed: &ArrayEpoch,
        located: &[Located],
        frame: &CommonFrame,
        links: &mut Vec<Link>,
    ) {
        links.clear();
        let body_from_ecef =
            self.ned_from_body.map(|n| n.inverse() * frame.horizon.ned_from_ecef());
        for (located, position_m) in located.iter().zip(&frame.positions_m) {
            let Some(epoch) = &observed.antennas[located.antenna] else { continue };
            let antenna = difference::Antenna {
                index: located.antenna,
                epoch,
                tracked: &located.tracked,
                position_m: *position_m,
                mount: self.mounts.get(located.antenna).and_then(Option::as_ref),
                body_from_ecef,
            };
            let (settings, noise) = (&self.settings, &self.settings.noise);
            let mask_rad = settings.elevation_mask_rad;
            let wanted = |band| settings.wants(band);
            difference::links(&antenna, navigation, noise, mask_rad, wanted, links);
        }
        if self.is_code_only() {
            links.iter_mut().for_each(|link| link.phase_m = None);
        }
        let channel = |satellite| navigation.ephemerides.glonass_channel(satellite);
        let (are_carried, noise) = (self.recursive.is_some(), &self.settings.noise);
        self.glonass_ifb.apply(links, frame.reference, are_carried, noise, channel);
        // Phases of one arc are counted from the same whole cycle in all its epochs.
        if let Some(memory) = &self.recursive {
            let continuity = &self.continuity;
            memory
                .align(links, |link| continuity.number(link.antenna, link.satellite, link.signal));
        }
    }

    /// The float solution with the noise of the session, which learns from its code residuals, and how the code
    /// fits before outliers lose weight. Until the session is known, the epoch's own residuals enter its
    /// weights.
    pub(super) fn float(
        &mut self,
        links: &mut [Link],
        groups: &[core::ops::Range<usize>],
        frame: &CommonFrame,
    ) -> Result<(FloatSolution, Fit), NoFloat> {
        let a_priori: Vec<_> = links.iter().map(|link| link.variances).collect();
        let is_young = self.levels.is_young();
        self.weigh(links, groups);
        let (float, code_fit) = robust_float(links, groups, frame)?;
        let residuals = Residuals {
            links,
            residuals: &float.code_residuals(links),
            redundancies: &float.code_redundancies(),
            degrees_of_freedom: float.code_fit.degrees_of_freedom,
            baseline_unknowns: float.correction_m.len(),
        };
        self.levels.learn_code(&residuals);
        if self.levels.want_changes() {
            self.learn_changes(links, &a_priori, &float);
        }
        if !is_young {
            return Ok((float, code_fit));
        }
        links.iter_mut().zip(a_priori).for_each(|(link, variances)| link.variances = variances);
        self.weigh(links, groups);
        let (float, _) = robust_float(links, groups, frame)?;
        Ok((float, code_fit))
    }

    /// Variances of the links: levels of the session, edges, common errors of the bands.
    fn weigh(&mut self, links: &mut [Link], groups: &[core::ops::Range<usize>]) {
        self.levels.apply(links);
        self.link_noise.apply(links, groups, self.levels.common());
    }
}

/// The float solution in which outliers of the code have little weight, and how the code fits before.
fn robust_float(
    links: &mut [Link],
    groups: &[core::ops::Range<usize>],
    frame: &CommonFrame,
) -> Result<(FloatSolution, Fit), NoFloat> {
    let rovers: Vec<usize> = frame.rovers().collect();
    let mut code = CodeFloat::solve(links, groups, frame.reference, &rovers)?;
    let code_fit = code.fit();
    for _ in 0..MAX_REWEIGHTINGS {
        if !link_noise::weigh_code_outliers(links, &code.residuals(links)) {
            break;
        }
        code.solve_again(links)?;
    }
    Ok((FloatSolution::with_phases(code, links), code_fit))
}

/// The antenna with the fewest links; never a pinned reference.
fn weakest(located: &[Located], links: &[Link], is_pinned: bool) -> Option<usize> {
    let links_of = |l: &Located| links.iter().filter(|link| link.antenna == l.antenna).count();
    (usize::from(is_pinned)..located.len()).min_by_key(|i| links_of(&located[*i]))
}
