//! The method, step by step, and what it remembers from epoch to epoch.

use crate::antenna_calibration::MountedAntenna;
use crate::attitude::VerticalMemory;
use crate::baseline::Baselines;
use crate::cycle_slip::Continuity;
use crate::difference::{self, Link};
use crate::ephemeris::NavigationData;
use crate::float_solution::recursive::RecursiveFloat;
use crate::float_solution::{Fit, NoFloat};
use crate::frames::{Body, Ned, Rotation};
use crate::glonass_ifb::GlonassIfb;
use crate::link_noise::LinkNoise;
use crate::observation::ArrayEpoch;
use crate::sky::Horizon;
use crate::solution::{EpochSolution, Outcome, Reason};
use crate::time::GpsTime;

use super::PredictedAttitude;
use super::acceptance::{Checks, Known, Scale};
use super::array_misfit::ArrayMisfit;
use super::direction::{Direction, Mirror};
use super::fix::{Epoch, Fix};
use super::locate::{CommonFrame, Located, locate};
use super::noise_levels::NoiseLevels;
use super::orientation::{self, KnownBody};
use super::phase_changes::PhaseChanges;
use super::search::{Problem, Searches};
use super::session_fit::SessionFit;
use super::settings::{Ambiguities, Settings, SettingsError};
use super::stages::{Judged, Oriented, Searched};
use super::subset::{Doubted, Subsets, Trials};
use super::witness::{Claim, Witness};

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
    pub(super) searches: Searches,
    subsets: Subsets,
    array_misfit: ArrayMisfit,
    pub(super) session_fit: SessionFit,
    pub(super) witness: Witness,
    /// Of the last epoch that was fixed.
    pub(super) ned_from_body: Option<Rotation<Ned, Body>>,
    /// Of the last epoch that was fixed with three angles.
    pub(super) vertical: VerticalMemory,
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
            .map(|searched| self.orient(searched))
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
        let searched = self.fix(epoch, None);
        let Judged { oriented, outcome, .. } = self.accept(self.orient(searched));
        let found = oriented.searched.fix.found.ok();
        let is_fixed = matches!(outcome, Outcome::Fixed { .. });
        Ok(found.filter(|_| is_fixed).map(|found| found.integers))
    }

    /// Attitude, baselines and position of an epoch that is not to be believed: nothing is learnt from it but where
    /// phases were interrupted.
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
    pub(super) fn known(&self) -> Known {
        Known {
            code: self.levels.code_degrees_of_freedom(),
            phase: self.levels.phase_degrees_of_freedom(),
        }
    }

    /// The integers: of the whole epoch, without a suspect where these are not accepted, and by the
    /// prediction where the epoch alone is not sure.
    fn fix(&mut self, mut epoch: Epoch, predicted: Option<&PredictedAttitude>) -> Searched {
        self.searches.begin_epoch();
        let (known, doubt) = (self.known(), self.session_fit.doubt());
        let mut fix = self.fix_whole(&epoch, known, doubt);
        self.learn_phases(&epoch, &fix);

        let Trials { best, misfit_without_mixed } =
            self.without_suspects(&epoch, &fix, known, doubt);
        self.learn_mixed(&fix, misfit_without_mixed);
        let left_out = best.as_ref().map(|subset| subset.left_out);
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
        Searched { epoch, fix, left_out, baselines, factor, correction_m, predicted, is_decided }
    }

    /// The integers of all phases, with the geometry in doubt as far as the session doubts it.
    fn fix_whole(&mut self, epoch: &Epoch, known: Known, doubt: f64) -> Fix {
        let problem = Problem { doubt, ..epoch.problem(&epoch.float, &self.settings, known) };
        self.searches.fix(&problem)
    }

    /// The integers of parts of the epoch, where those of the whole are not accepted.
    fn without_suspects(&mut self, epoch: &Epoch, fix: &Fix, known: Known, doubt: f64) -> Trials {
        let (settings, glonass_ifb) = (&self.settings, &self.glonass_ifb);
        let are_carried = self.recursive.is_some();
        // Some receivers have the phases of BeiDou's geostationary satellites a part of a cycle off
        // those of the others: their messages are modulated in another way.
        let is_mixed = |link: &Link| {
            let is_geostationary = link.satellite.is_beidou_geo();
            link.phase_m.is_some()
                && (is_geostationary || glonass_ifb.is_unknown(link, are_carried))
        };
        let doubted = Doubted { epoch, fix, settings, known, doubt, is_mixed: &is_mixed };
        self.subsets.find(&mut self.searches, &doubted)
    }

    fn orient(&self, searched: Searched) -> Oriented {
        let known = KnownBody {
            array: self.settings.array.as_ref(),
            array_sd_m: self.settings.array_sd_m,
            memory: &self.vertical,
            time: searched.epoch.time,
            max_angle_sd_rad: self.settings.max_angle_sd_rad,
        };
        let horizon = &searched.epoch.frame.horizon;
        Oriented {
            orientation: orientation::orient(&searched.baselines, horizon, &known),
            searched,
        }
    }

    /// Completes the list of checks; the first one that fails gives status and reason.
    fn accept(&mut self, oriented: Oriented) -> Judged {
        let Oriented { searched, orientation } = &oriented;
        let Searched { epoch, fix, .. } = searched;
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
            self.array_misfit.take(&misfit.scaled(1.0 / searched.factor), epoch.time);
        }
        let (shape, level) =
            (self.array_misfit.judge(scale, self.levels.slow_share()), self.array_misfit.level());
        let mut checks = Checks::of_session(fit, shape, level, &self.settings);
        checks.of_positions(epoch.frame.contradiction, &self.settings);
        checks.0.extend_from_slice(&fix.checks.0);
        if fix.is_sure() {
            let lengths = self.lengths(&searched.baselines);
            checks.of_orientation(&lengths, orientation, scale, &self.settings);
        }
        let prediction = searched.predicted.as_ref().filter(|_| fix.is_sure() && checks.hold());
        let prediction = prediction.map(|p| p.role(&searched.baselines, searched.is_decided));
        if let Some(role) = prediction {
            checks.of_prediction(role);
        }
        if fix.is_sure() && checks.hold() {
            let testimony = self.hear(searched);
            checks.of_witness(testimony, fix.is_strong() || prediction.is_some());
        }
        let outcome = checks.outcome(orientation.attitude, epoch.began_anew);
        Judged { oriented, checks, outcome, prediction }
    }

    /// What the accepted epochs before say of these integers.
    fn hear(&mut self, searched: &Searched) -> super::witness::Testimony {
        let Searched { epoch, fix, .. } = searched;
        let integers = fix.found.as_ref().map(|found| found.integers.as_slice());
        let cycles = epoch.float.whole_cycles(&epoch.links, integers.unwrap_or_default());
        let arc = |link: &Link| self.continuity.number(link.antenna, link.satellite, link.signal);
        let arcs: Vec<u32> = epoch.links.iter().map(arc).collect();
        let claim =
            Claim { links: &epoch.links, groups: &epoch.groups, cycles: &cycles, arcs: &arcs };
        self.witness.hear(&claim, self.levels.weight())
    }

    /// How far each baseline is from the length that the known array gives it, squared and normalised.
    pub(super) fn lengths(&self, baselines: &Baselines) -> Vec<Fit> {
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

    /// Whether double differences without phases are all that is wanted.
    pub(super) fn is_code_only(&self) -> bool {
        self.settings.ambiguities == Ambiguities::CodeOnly
    }
}
