//! The chain from one epoch's observations to attitude: [`Engine::push`] reads as the method.

mod channel_bias;
mod code_free;
mod fix;
mod locate;
mod misfit;
mod noise_scale;
mod orientation;
mod partial;
mod predicted_attitude;
mod search;
mod settings;
mod station;

pub use predicted_attitude::PredictedAttitude;
pub use settings::{Ambiguities, Constraint, Settings, SettingsError};

use core::ops::Range;

use crate::antenna_calibration::MountedAntenna;
use crate::baseline::Baselines;
use crate::cycle_slip::Continuity;
use crate::difference::{self, Link};
use crate::ephemeris::NavigationData;
use crate::float_solution::recursive::RecursiveFloat;
use crate::float_solution::{FloatSolution, NoFloat};
use crate::frames::{Attitude, Body, Ecef, Geodetic, Ned, Rotation, Vector};
use crate::observation::ArrayEpoch;
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::signal_residuals::{Solved, integer_sums, signal_residuals};
use crate::solution::{
    AttitudeEstimate, EpochSolution, PositionEstimate, PredictionRole, Reason, Status,
};
use crate::time::GpsTime;
use channel_bias::ChannelBiases;
use fix::{Fixer, Outcome, Verdict};
use locate::{CommonFrame, Located, locate, shared_satellites};
use misfit::MeanMisfit;
use partial::Part;
use predicted_attitude::PredictedBaselines;
use station::Station;

/// The estimator: one epoch of all antennas in, one row out.
#[derive(Debug)]
pub struct Engine {
    settings: Settings,
    navigation: NavigationData,
    located: Vec<Located>,
    links: Vec<Link>,
    /// Arcs of continuous phase and what is known of their ambiguities; not in use where each epoch
    /// stands alone.
    carried: Option<(Continuity, RecursiveFloat)>,
    fixer: Fixer,
    channel_biases: ChannelBiases,
    mean_misfit: MeanMisfit,
    /// Phase centres of the antennas; empty if none is known.
    mounts: Vec<Option<MountedAntenna>>,
    /// Of the last epoch that was fixed.
    ned_from_body: Option<Rotation<Ned, Body>>,
    station: Option<Box<Station>>,
}

impl Engine {
    /// An engine for these settings and navigation data.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn new(settings: Settings, navigation: NavigationData) -> Result<Self, SettingsError> {
        settings.check()?;
        let carried = match settings.ambiguities {
            Ambiguities::Instantaneous | Ambiguities::CodeOnly => None,
            Ambiguities::Continuous(motion) => {
                Some((Continuity::default(), RecursiveFloat::new(motion)))
            }
        };
        Ok(Self {
            carried,
            settings,
            navigation,
            located: Vec::new(),
            links: Vec::new(),
            fixer: Fixer::default(),
            channel_biases: ChannelBiases::default(),
            mean_misfit: MeanMisfit::default(),
            mounts: Vec::new(),
            ned_from_body: None,
            station: None,
        })
    }

    /// The same with a fixed station at a known place (ECEF, m), whose observations are
    /// [`ArrayEpoch::station`]: rows then have the coordinates relative to it.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn with_station(mut self, position_m: Vector<Ecef>) -> Result<Self, SettingsError> {
        let station = Station::new(position_m, &self.settings, &self.navigation)?;
        self.station = Some(Box::new(station));
        Ok(self)
    }

    /// The same with the phase centres of the antennas (`None` where they are not known). The places
    /// of the antennas, and the baselines, are then those of their reference points.
    ///
    /// The phase centres turn with the body, by the attitude of the last epoch that was fixed; until
    /// there is one, the horizontal offsets (some millimetres) are left out.
    #[must_use]
    pub fn with_phase_centers(mut self, mounts: Vec<Option<MountedAntenna>>) -> Self {
        self.mounts = mounts;
        self
    }

    /// Takes in navigation data that were received after all others: they count from the next epoch on.
    pub fn insert(&mut self, news: &NavigationData) {
        self.navigation.update(news);
        if let Some(station) = &mut self.station {
            station.insert(news);
        }
    }

    /// Attitude, baselines and position of one epoch.
    pub fn push(&mut self, epoch: &ArrayEpoch) -> EpochSolution {
        self.push_predicted(epoch, None)
    }

    /// The same of an epoch whose attitude is predicted: with a known array, the prediction decides
    /// between integers that the epoch alone is not sure of, and a fix that contradicts it is refused
    /// ([`EpochSolution::prediction`]). It does not enter the attitude.
    pub fn push_predicted(
        &mut self,
        epoch: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
    ) -> EpochSolution {
        self.follow_phases(epoch);
        locate(epoch, &self.navigation, &self.settings, &mut self.located);
        let mut row = EpochSolution::lost(epoch.time, Reason::FewAntennas);
        row.antennas = self.located.len();
        row.position = self.first_position();
        row.time_utc = self.true_time().map(|time| self.navigation.utc(time));
        if let (Some(station), Some(observed)) = (&mut self.station, &epoch.station) {
            station.improve(epoch, observed, &mut row);
        }
        if let Err(reason) = self.relative(epoch, predicted, &mut row) {
            row.reason = Some(reason);
        }
        row
    }

    /// Looks for cycle slips of every antenna, also in epochs that give no solution.
    fn follow_phases(&mut self, epoch: &ArrayEpoch) {
        let Some((continuity, _)) = &mut self.carried else { return };
        let ephemerides = &self.navigation.ephemerides;
        for (antenna, observed) in epoch.antennas.iter().enumerate() {
            let Some(observed) = observed else { continue };
            continuity.update(antenna, observed, |satellite, band| {
                band.wavelength_m(ephemerides.glonass_channel(satellite))
            });
        }
    }

    /// Phases of one arc are counted from the same whole cycle in all its epochs.
    fn align_phases(&mut self) {
        let Some((continuity, memory)) = &self.carried else { return };
        memory.align(&mut self.links, |link| {
            continuity.number(link.antenna, link.satellite, link.signal)
        });
    }

    /// The float solution of the epoch with what earlier epochs know of its ambiguities, and whether
    /// so many of them slipped that nothing is left of that.
    fn carry(
        &mut self,
        float: FloatSolution,
        frame: &CommonFrame,
        time: GpsTime,
    ) -> (FloatSolution, bool) {
        let Some((continuity, memory)) = &mut self.carried else { return (float, false) };
        let arc = |link: &Link| continuity.number(link.antenna, link.satellite, link.signal);
        let float = memory.update(float, &self.links, &frame.approximate(), time, arc);
        (float, memory.began_anew())
    }

    /// The instant of the first antenna that has a position: its tag less its clock bias.
    fn true_time(&self) -> Option<GpsTime> {
        let located = self.located.iter().find(|l| l.point.is_ok())?;
        let clock_m = located.point.as_ref().ok()?.clock_m;
        Some(located.tag + -clock_m / SPEED_OF_LIGHT_MPS)
    }

    /// Position and velocity of the first antenna that has them.
    fn first_position(&self) -> Option<PositionEstimate> {
        let located = self.located.iter().find(|l| l.point.is_ok())?;
        let point = located.point.as_ref().ok()?;
        let ned_from_ecef = point.horizon.ned_from_ecef();
        Some(PositionEstimate {
            geodetic: point.horizon.geodetic,
            position_m: point.position_m,
            covariance_m2: ned_from_ecef.turn_covariance(&point.covariance_m2),
            velocity_mps: located.velocity.map(|v| ned_from_ecef * v.velocity_mps),
            clock_m: Some(point.clock_m),
        })
    }

    /// Differences, float solution, integers, baselines, attitude.
    fn relative(
        &mut self,
        epoch: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
        row: &mut EpochSolution,
    ) -> Result<(), Reason> {
        self.fixer.begin(epoch.time);
        let (frame, mut groups, float) = self.float(epoch, row)?;
        let (mut float, anew) = self.carry(float, &frame, epoch.time);

        let rate = self.settings.max_wrong_fix_rate;
        let mut outcome = self.fixer.fix(&float, &self.links, &frame, &self.settings, rate);
        if anew {
            outcome.verdict = outcome.verdict.after_many_slips();
        }
        if let Some(part) = self.fix_without_a_suspect(&outcome, &float, &frame) {
            row.left_out = Some(part.left_out);
            (self.links, groups) = (part.links, part.groups);
            (float, outcome) = (part.float, part.outcome);
        }
        self.fixer.learn_from(&outcome);
        let predicted = predicted.and_then(|p| p.baselines(&float, &frame.horizon, &self.settings));
        let decided = self.decide(predicted.as_ref(), outcome.verdict, &float, &frame);
        let is_decided = decided.is_some();
        outcome = decided.unwrap_or(outcome);
        row.satellites = float.satellites;
        row.ambiguities = float.ambiguities_cycles.len();
        row.success_rate = outcome.success_rate;
        row.ratio = outcome.ratio;
        row.residual_rms_m = outcome.residual_rms_m;
        if self.settings.residuals {
            let solved = Solved {
                rovers: &outcome.baselines.rovers,
                correction_m: &outcome.correction_m,
                integers: outcome.integers.as_deref(),
            };
            row.residuals = signal_residuals(&self.links, &groups, &solved);
            let sums = |integers: &[f64]| integer_sums(&self.links, &groups, integers);
            if let Some((integers, rivals)) = &outcome.best {
                (row.integers, row.rivals) = (sums(integers), Some(*rivals));
            }
        }
        let orientation = orientation::orient(
            &outcome.baselines,
            &frame.horizon,
            self.settings.array.as_ref(),
            self.settings.array_sd_m,
        );
        if let (Some(misfit), true) = (&orientation.misfit, outcome.verdict.is_sure()) {
            self.mean_misfit.take(misfit, epoch.time);
        }
        (row.status, row.reason) = self.judge(outcome.verdict, &orientation.attitude);
        if let (Some(predicted), Status::Fixed) = (predicted, row.status) {
            row.prediction = Some(predicted.role(&outcome.baselines, is_decided));
            if row.prediction == Some(PredictionRole::Refused) {
                (row.status, row.reason) = (Status::Inconsistent, Some(Reason::Residuals));
            }
        }
        row.baselines = outcome.baselines.local(&frame.horizon, row.status);
        row.attitude = orientation.attitude.ok();
        if row.status == Status::Fixed {
            self.channel_biases.learn(&outcome.baselines.rovers, &outcome.correction_m);
        }
        self.remember_axes(row);
        self.place_body(&outcome.baselines, row);
        Ok(())
    }

    /// The float solution of all antennas, or of all but those that see too few satellites.
    fn float(
        &mut self,
        epoch: &ArrayEpoch,
        row: &mut EpochSolution,
    ) -> Result<(CommonFrame, Vec<Range<usize>>, FloatSolution), Reason> {
        loop {
            let frame = locate::common_frame(&self.located)?;
            self.form_links(epoch, &frame);
            self.take_out_channel_biases(frame.reference);
            self.align_phases();
            let groups = difference::group(&mut self.links);
            row.shared_satellites = row.shared_satellites.max(shared_satellites(&self.links));
            match self.fixer.float(&self.links, &groups, &frame) {
                Ok(float) => return Ok((frame, groups, float)),
                Err(NoFloat::Undetermined { .. } | NoFloat::NoCommonSatellites)
                    if self.located.len() <= 2 =>
                {
                    return Err(Reason::FewSatellites);
                }
                Err(_) => {
                    let links_of =
                        |l: &Located| self.links.iter().filter(|k| k.antenna == l.antenna).count();
                    let least = (0..self.located.len()).min_by_key(|i| links_of(&self.located[*i]));
                    self.located.remove(least.unwrap_or(0));
                }
            }
        }
    }

    /// Integers that the prediction makes sure, if the epoch is not sure of them.
    fn decide(
        &mut self,
        predicted: Option<&PredictedBaselines>,
        verdict: Verdict,
        float: &FloatSolution,
        frame: &CommonFrame,
    ) -> Option<Outcome> {
        let may_decide =
            |p: &&PredictedBaselines| p.may_decide && matches!(verdict, Verdict::Float(_));
        let predicted = predicted.filter(may_decide)?;
        self.fixer.fix_with_prediction(predicted, float, &self.links, frame, &self.settings)
    }

    /// Integers of the epoch without something that may spoil them, if they are not accepted or doubted.
    fn fix_without_a_suspect(
        &mut self,
        whole: &Outcome,
        float: &FloatSolution,
        frame: &CommonFrame,
    ) -> Option<Part> {
        let Self { fixer, channel_biases, links, settings, .. } = self;
        // Some receivers have the phases of BeiDou's geostationary satellites a part of a cycle off
        // those of the others: their messages are modulated in another way.
        let is_unlike = |link: &Link| {
            let is_geostationary = link.satellite.is_beidou_geo();
            link.phase_m.is_some() && (is_geostationary || channel_biases.is_unknown(link))
        };
        fixer.fix_without_a_suspect(whole, float, links, is_unlike, frame, settings)
    }

    /// GLONASS of unlike receivers, where each epoch stands alone: a bias that becomes known would be
    /// a cycle slip to what is carried on.
    fn take_out_channel_biases(&mut self, reference: usize) {
        if self.settings.ambiguities == Ambiguities::Instantaneous {
            let ephemerides = &self.navigation.ephemerides;
            let channel = |satellite| ephemerides.glonass_channel(satellite);
            let (links, noise) = (&mut self.links, &self.settings.noise);
            self.channel_biases.apply(links, reference, noise, channel);
        }
    }

    /// Keeps the body's axes of a fixed epoch; two antennas leave the roll open, it counts as zero.
    fn remember_axes(&mut self, row: &EpochSolution) {
        let Some(attitude) = row.attitude.filter(|_| row.status == Status::Fixed) else { return };
        let Some(heading_rad) = attitude.heading_rad else { return };
        let (pitch_rad, roll_rad) =
            (attitude.pitch_rad.unwrap_or(0.0), attitude.roll_rad.unwrap_or(0.0));
        self.ned_from_body = Some(Attitude { heading_rad, pitch_rad, roll_rad }.ned_from_body());
    }

    /// Observed less computed for every antenna, at its own reception time.
    fn form_links(&mut self, epoch: &ArrayEpoch, frame: &CommonFrame) {
        self.links.clear();
        let body_from_ecef =
            self.ned_from_body.map(|n| n.inverse() * frame.horizon.ned_from_ecef());
        for (located, position_m) in self.located.iter().zip(&frame.positions_m) {
            let Some(observed) = &epoch.antennas[located.antenna] else { continue };
            let antenna = difference::Antenna {
                index: located.antenna,
                epoch: observed,
                tracked: &located.tracked,
                position_m: *position_m,
                mount: self.mounts.get(located.antenna).and_then(Option::as_ref),
                body_from_ecef,
            };
            difference::links(
                &antenna,
                &self.navigation,
                &self.settings.noise,
                self.settings.elevation_mask_rad,
                |band| self.settings.wants(band),
                &mut self.links,
            );
        }
        if self.settings.ambiguities == Ambiguities::CodeOnly {
            self.links.iter_mut().for_each(|link| link.phase_m = None);
        }
    }

    /// Moves the position from the antenna to the body origin, and adds the wanted points, once
    /// the attitude is known: `G = A₀ + Q (g − l₀)` (seed 004, equation 27).
    fn place_body(&self, baselines: &Baselines, row: &mut EpochSolution) {
        let (Some(array), Some(position)) = (&self.settings.array, &mut row.position) else {
            return;
        };
        let Some(ned_from_body) = row.attitude.and_then(|a| a.ned_from_body) else { return };
        let ecef_from_body = position.geodetic.ecef_from_ned() * ned_from_body;
        let antenna = array.positions_m()[baselines.reference];
        let antenna_m = position.position_m;
        let at = |point| antenna_m + ecef_from_body * (point - antenna);
        for (index, point) in self.settings.points_m.iter().enumerate() {
            row.points.push(crate::solution::PointEstimate {
                index,
                geodetic: Geodetic::from_ecef(at(*point)),
                covariance_m2: position.covariance_m2,
            });
        }
        position.position_m = at(crate::frames::Vector::new(0.0, 0.0, 0.0));
        position.geodetic = Geodetic::from_ecef(position.position_m);
    }

    /// Status of the epoch from what the integers, the orientation and the epochs before say.
    fn judge(
        &self,
        verdict: Verdict,
        attitude: &Result<AttitudeEstimate, Reason>,
    ) -> (Status, Option<Reason>) {
        let tilted = |attitude: &AttitudeEstimate| {
            let mut angles_rad = [attitude.pitch_rad, attitude.roll_rad].into_iter().flatten();
            angles_rad.any(|angle_rad| angle_rad.abs() > self.settings.max_tilt_rad)
        };
        match (verdict, attitude) {
            (Verdict::Float(reason), _) => (Status::Float, Some(reason)),
            (Verdict::Refused(reason), _) => (Status::Inconsistent, Some(reason)),
            (Verdict::Fixed, Err(reason)) => (Status::Inconsistent, Some(*reason)),
            (Verdict::Fixed, Ok(attitude)) if tilted(attitude) => {
                (Status::Inconsistent, Some(Reason::Tilt))
            }
            (Verdict::Fixed, Ok(_)) if self.mean_misfit.is_improbable() => {
                (Status::Inconsistent, Some(Reason::Geometry))
            }
            (Verdict::Fixed, Ok(_)) => (Status::Fixed, None),
        }
    }
}
