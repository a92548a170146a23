//! The method, step by step, and what it remembers from epoch to epoch.

use std::borrow::Cow;

use nalgebra::DVector;

use crate::antenna_calibration::MountedAntenna;
use crate::attitude::VerticalMemory;
use crate::baseline::Baselines;
use crate::cycle_slip::Continuity;
use crate::difference::{self, Link};
use crate::ephemeris::NavigationData;
use crate::float_solution::recursive::RecursiveFloat;
use crate::float_solution::{Fit, FloatSolution, NoFloat};
use crate::frames::{Attitude, Body, Ned, Rotation};
use crate::glonass_ifb::GlonassIfb;
use crate::link_noise::LinkNoise;
use crate::observation::ArrayEpoch;
use crate::sky::Horizon;
use crate::solution::{AttitudeEstimate, EpochSolution, LeftOut, Outcome, PredictionRole, Reason};
use crate::time::GpsTime;

use super::PredictedAttitude;
use super::acceptance::{Checks, Known, Scale};
use super::array_misfit::ArrayMisfit;
use super::direction::{Direction, Mirror};
use super::fix::{Epoch, Fix};
use super::locate::{CommonFrame, Located, locate};
use super::noise_levels::{NoiseLevels, Residuals};
use super::orientation::{self, KnownBody, Orientation};
use super::phase_changes::PhaseChanges;
use super::predicted_attitude::PredictedBaselines;
use super::search::{Problem, Searches};
use super::session_fit::{Geometry, SessionFit};
use super::settings::{Ambiguities, Constraint, Settings, SettingsError};
use super::subset::{Doubted, Subsets, Trials};
use super::witness::{Claim, Witness};

/// What integers leave is clearly more, root mean square, with phases that spoil it than without: noise makes a third more of
/// the ten ambiguities of a weak model, 1-sigma less than a quarter.
const CLEARLY_WORSE: f64 = 2.0;

/// The estimator of one array, without its navigation data.
#[derive(Debug, Clone)]
pub(crate) struct Estimator {
    pub(super) settings: Settings,
    /// Phase centres of the antennas; empty if none is known.
    pub(super) mounts: Vec<Option<MountedAntenna>>,
    /// Buffers of the antennas.
    located: Vec<Located>,
    pub(super) links: Vec<Link>,
    /// The epochs of a backward run as the phases' memory sees them.
    mirror: Mirror,
    /// Arcs of continuous phase.
    pub(super) continuity: Continuity,
    /// What is known of their ambiguities; not in use where each epoch stands alone.
    pub(super) recursive: Option<RecursiveFloat>,
    pub(super) link_noise: LinkNoise,
    pub(super) levels: NoiseLevels,
    pub(super) phase_changes: PhaseChanges,
    pub(super) glonass_ifb: GlonassIfb,
    searches: Searches,
    subsets: Subsets,
    array_misfit: ArrayMisfit,
    session_fit: SessionFit,
    witness: Witness,
    /// Of the last epoch that was fixed.
    pub(super) ned_from_body: Option<Rotation<Ned, Body>>,
    /// Of the last epoch that was fixed with three angles.
    vertical: VerticalMemory,
}

/// An epoch with the integers that were found, or why there are none.
#[derive(Debug)]
pub(super) struct Fixed {
    pub(super) epoch: Epoch,
    pub(super) fix: Fix,
    pub(super) left_out: Option<LeftOut>,
    pub(super) baselines: Baselines,
    /// By which the epoch's own residuals have made their covariance larger than the session's noise does.
    factor: f64,
    /// Corrections to the approximate baselines that `baselines` holds, m.
    pub(super) correction_m: DVector<f64>,
    predicted: Option<PredictedBaselines>,
    is_decided: bool,
}

/// The body of that epoch.
#[derive(Debug)]
pub(super) struct Oriented {
    pub(super) fixed: Fixed,
    pub(super) orientation: Orientation,
}

/// What becomes of it.
#[derive(Debug)]
pub(super) struct Judged {
    pub(super) oriented: Oriented,
    pub(super) checks: Checks,
    pub(super) outcome: Outcome,
    pub(super) prediction: Option<PredictionRole>,
}

impl Estimator {
    /// An estimator with these settings.
    pub(crate) fn new(settings: Settings) -> Result<Self, SettingsError> {
        settings.check()?;
        let recursive = match settings.ambiguities {
            Ambiguities::Instantaneous | Ambiguities::CodeOnly => None,
            Ambiguities::Continuous(motion) => Some(RecursiveFloat::new(motion)),
        };
        Ok(Self {
            recursive,
            vertical: VerticalMemory::new(settings.roll_sd_rad),
            settings,
            mounts: Vec::new(),
            located: Vec::new(),
            links: Vec::new(),
            mirror: Mirror::default(),
            continuity: Continuity::default(),
            link_noise: LinkNoise::default(),
            levels: NoiseLevels::default(),
            phase_changes: PhaseChanges::default(),
            glonass_ifb: GlonassIfb::default(),
            searches: Searches::default(),
            subsets: Subsets::default(),
            array_misfit: ArrayMisfit::default(),
            session_fit: SessionFit::default(),
            witness: Witness::default(),
            ned_from_body: None,
        })
    }

    pub(super) fn set_phase_centers(&mut self, mounts: Vec<Option<MountedAntenna>>) {
        self.mounts = mounts;
    }

    pub(crate) fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Attitude, baselines and position of one epoch.
    pub(crate) fn push(
        &mut self,
        navigation: &NavigationData,
        observed: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
    ) -> EpochSolution {
        let observed = observed.plausible();
        let observed = observed.as_ref();
        self.levels.begin(self.settings.direction.running_time(observed.time));
        self.follow_phases(navigation, observed);
        let mut located = core::mem::take(&mut self.located);
        locate(observed, navigation, &self.settings, &mut located);
        let mut row = self.row(navigation, observed, &located);
        let judged = self
            .difference(navigation, observed, &mut located, &mut row)
            .map(|epoch| self.carry(epoch))
            .map(|epoch| self.fix(epoch, predicted))
            .map(|fixed| self.orient(fixed))
            .map(|oriented| self.accept(oriented));
        match judged {
            Ok(judged) => {
                self.fill(&mut row, &judged, &located);
                self.remember(&row, judged);
            }
            Err(reason) => row.outcome = Outcome::Lost { reason },
        }
        self.located = located;
        row
    }

    /// The integers of an epoch if it is fixed, of which nothing is there but its links: observations of antennas
    /// that are all about where `horizon` is, less what is computed for that place.
    pub(crate) fn push_links(
        &mut self,
        time: GpsTime,
        horizon: Horizon,
        mut links: Vec<Link>,
    ) -> Result<Option<Vec<f64>>, NoFloat> {
        let time = self.settings.direction.running_time(time);
        self.levels.begin(time);
        let frame = CommonFrame::at_one_place(horizon, self.settings.antennas);
        let groups = difference::group(&mut links);
        let (float, code_fit) = self.float(&mut links, &groups, &frame)?;
        let epoch = Epoch { time, frame, links, groups, float, code_fit, began_anew: false };
        let fixed = self.fix(epoch, None);
        let Judged { oriented, outcome, .. } = self.accept(self.orient(fixed));
        let found = oriented.fixed.fix.found.ok();
        let is_fixed = matches!(outcome, Outcome::Fixed { .. });
        Ok(found.filter(|_| is_fixed).map(|found| found.integers))
    }

    /// Attitude, baselines and position of an epoch that is not to be believed: nothing is learnt from it but where phases
    /// were interrupted.
    pub(crate) fn push_untrusted(
        &mut self,
        navigation: &NavigationData,
        observed: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
    ) -> EpochSolution {
        let before = self.clone();
        let row = self.push(navigation, observed, predicted);
        let Self { continuity, mirror, .. } = core::mem::replace(self, before);
        (self.continuity, self.mirror) = (continuity, mirror);
        row
    }

    /// Looks for cycle slips of every antenna, also in epochs that give no solution.
    fn follow_phases(&mut self, navigation: &NavigationData, observed: &ArrayEpoch) {
        let seen = match self.settings.direction {
            Direction::Forward => observed,
            Direction::Backward => self.mirror.image(observed),
        };
        for (antenna, epoch) in seen.antennas.iter().enumerate() {
            let Some(epoch) = epoch else { continue };
            let wanted = |system| self.settings.wants_system(system);
            self.continuity.update(antenna, epoch, wanted, |satellite, band| {
                band.wavelength_m(navigation.ephemerides.glonass_channel(satellite))
            });
        }
    }

    /// The float solution of the epoch with what earlier epochs know of its ambiguities.
    fn carry(&mut self, mut epoch: Epoch) -> Epoch {
        let Some(memory) = &mut self.recursive else { return epoch };
        let continuity = &self.continuity;
        let arc = |link: &Link| continuity.number(link.antenna, link.satellite, link.signal);
        let approximate_m = epoch.frame.approximate();
        epoch.float = memory.update(epoch.float, &epoch.links, &approximate_m, epoch.time, arc);
        epoch.began_anew = memory.began_anew();
        epoch
    }

    /// Degrees of freedom with which the noise levels are known.
    fn known(&self) -> Known {
        Known {
            code: self.levels.code_degrees_of_freedom(),
            phase: self.levels.phase_degrees_of_freedom(),
        }
    }

    /// The integers: of the whole epoch, without a suspect where these are not accepted, and by the
    /// prediction where the epoch alone is not sure.
    fn fix(&mut self, mut epoch: Epoch, predicted: Option<&PredictedAttitude>) -> Fixed {
        self.searches.begin_epoch();
        let (known, doubt) = (self.known(), self.session_fit.doubt());
        let problem = Problem { doubt, ..epoch.problem(&epoch.float, &self.settings, known) };
        let mut fix = self.searches.fix(&problem);
        self.learn_phases(&epoch, &fix);

        let (settings, glonass_ifb) = (&self.settings, &self.glonass_ifb);
        let are_carried = self.recursive.is_some();
        // Some receivers have the phases of BeiDou's geostationary satellites a part of a cycle off
        // those of the others: their messages are modulated in another way.
        let is_mixed = |link: &Link| {
            let is_geostationary = link.satellite.is_beidou_geo();
            link.phase_m.is_some()
                && (is_geostationary || glonass_ifb.is_unknown(link, are_carried))
        };
        let doubted =
            Doubted { epoch: &epoch, fix: &fix, settings, known, doubt, is_mixed: &is_mixed };
        let Trials { best, misfit_without_mixed } = self.subsets.find(&mut self.searches, &doubted);
        let left_out = best.as_ref().map(|subset| subset.left_out);
        if are_carried {
            let fits_without = misfit_without_mixed.is_some_and(|without| {
                fix.misfit.unit_weight() > CLEARLY_WORSE * without.unit_weight().max(1.0)
            });
            self.glonass_ifb.hear(!fix.is_accepted() && fits_without);
        }
        if let Some(subset) = best {
            (epoch.links, epoch.groups) = (subset.links, subset.groups);
            (epoch.float, fix) = (subset.float, subset.fix);
        }
        self.learn_fit(&epoch, &fix, misfit_without_mixed);
        let settings = &self.settings;

        let predicted =
            predicted.and_then(|p| p.baselines(&epoch.float, &epoch.frame.horizon, settings));
        let decided = predicted
            .as_ref()
            .filter(|p| p.may_decide && (!fix.is_sure() || fix.waits_for_proof()))
            .and_then(|p| self.searches.fix_with_prediction(p, &epoch, settings, known));
        let is_decided = decided.is_some();
        let fix = decided.unwrap_or(fix);
        let (mut baselines, correction_m) = fix.baselines(&epoch);
        let factor = fix.epoch_factor(&epoch);
        baselines.covariance_m2 *= factor;
        Fixed { epoch, fix, left_out, baselines, factor, correction_m, predicted, is_decided }
    }

    /// The session learns how well the best integers fit, with what is known of the geometry: without the phases of
    /// mixed receivers where those are in doubt, as what they leave is not the geometry's fault. Integers that fit best
    /// to what earlier epochs know of them fit the epoch itself only if they are right, so only sure ones count; of the
    /// other epochs the best ones of the epoch by itself.
    fn learn_fit(&mut self, epoch: &Epoch, fix: &Fix, without_mixed: Option<Fit>) {
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
        } else if self.settings.constraint != Constraint::None && found.is_without_geometry() {
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
    fn learn_phases(&mut self, epoch: &Epoch, fix: &Fix) {
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

    fn orient(&self, fixed: Fixed) -> Oriented {
        let known = KnownBody {
            array: self.settings.array.as_ref(),
            array_sd_m: self.settings.array_sd_m,
            memory: &self.vertical,
            time: fixed.epoch.time,
            max_angle_sd_rad: self.settings.max_angle_sd_rad,
        };
        let horizon = &fixed.epoch.frame.horizon;
        Oriented { orientation: orientation::orient(&fixed.baselines, horizon, &known), fixed }
    }

    /// Completes the list of checks; the first one that fails gives status and reason.
    fn accept(&mut self, oriented: Oriented) -> Judged {
        let Oriented { fixed, orientation } = &oriented;
        let Fixed { epoch, fix, .. } = fixed;
        if let Err(reason) = fix.found {
            let reason = Some(if epoch.began_anew { Reason::Slip } else { reason });
            let outcome = Outcome::Float { attitude: orientation.attitude.ok(), reason };
            return Judged { oriented, checks: Checks::default(), outcome, prediction: None };
        }
        let fit = self.session_fit.judge(self.levels.code_degrees_of_freedom());
        let known = self.levels.phase_degrees_of_freedom();
        let scale = Scale { degrees_of_freedom: known + fix.phase_fit().degrees_of_freedom as f64 };
        if let Some(misfit) = orientation.misfit.as_ref().filter(|_| fix.is_sure()) {
            // The mean over epochs has the noise of the session.
            self.array_misfit.take(&misfit.scaled(1.0 / fixed.factor), epoch.time);
        }
        let (shape, level) =
            (self.array_misfit.judge(scale, self.levels.slow_share()), self.array_misfit.level());
        let mut checks = Checks::of_session(fit, shape, level, &self.settings);
        checks.of_positions(epoch.frame.contradiction, &self.settings);
        checks.0.extend_from_slice(&fix.checks.0);
        if fix.is_sure() {
            let lengths = self.lengths(&fixed.baselines);
            checks.of_orientation(&lengths, orientation, scale, &self.settings);
        }
        let prediction = fixed.predicted.as_ref().filter(|_| fix.is_sure() && checks.hold());
        let prediction = prediction.map(|p| p.role(&fixed.baselines, fixed.is_decided));
        if let Some(role) = prediction {
            checks.of_prediction(role);
        }
        if fix.is_sure() && checks.hold() {
            let testimony = self.hear(fixed);
            checks.of_witness(testimony, fix.is_strong() || prediction.is_some());
        }
        let outcome = checks.outcome(orientation.attitude, epoch.began_anew);
        Judged { oriented, checks, outcome, prediction }
    }

    /// What the accepted epochs before say of these integers.
    fn hear(&mut self, fixed: &Fixed) -> super::witness::Testimony {
        let Fixed { epoch, fix, .. } = fixed;
        let integers = fix.found.as_ref().map(|found| found.integers.as_slice());
        let cycles = epoch.float.whole_cycles(&epoch.links, integers.unwrap_or_default());
        let arc = |link: &Link| self.continuity.number(link.antenna, link.satellite, link.signal);
        let arcs: Vec<u32> = epoch.links.iter().map(arc).collect();
        let claim =
            Claim { links: &epoch.links, groups: &epoch.groups, cycles: &cycles, arcs: &arcs };
        self.witness.hear(&claim, self.levels.weight())
    }

    /// How far each baseline is from the length that the known array gives it, squared and normalised.
    fn lengths(&self, baselines: &Baselines) -> Vec<Fit> {
        let Some(array) = &self.settings.array else { return Vec::new() };
        let positions_m = array.positions_m();
        let reference = positions_m[baselines.reference];
        let of_rover = |(block, rover): (usize, &usize)| {
            let known_m = (positions_m[*rover] - reference).norm();
            let (found_m, sd_m) = baselines.length_m(block);
            let variance_m2 = sd_m * sd_m + 2.0 * self.settings.array_sd_m.powi(2);
            Fit { sum: (found_m - known_m).powi(2) / variance_m2, degrees_of_freedom: 1 }
        };
        baselines.rovers.iter().enumerate().map(of_rover).collect()
    }

    /// What later epochs need of this one.
    fn remember(&mut self, row: &EpochSolution, judged: Judged) {
        let fixed = judged.oriented.fixed;
        if let Outcome::Fixed { attitude } = &row.outcome {
            self.glonass_ifb.learn(&fixed.baselines.rovers, &fixed.correction_m);
            self.remember_axes(fixed.epoch.time, attitude);
        }
        self.links = fixed.epoch.links;
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

    /// Whether double differences without phases are all that is wanted.
    pub(super) fn is_code_only(&self) -> bool {
        self.settings.ambiguities == Ambiguities::CodeOnly
    }
}
