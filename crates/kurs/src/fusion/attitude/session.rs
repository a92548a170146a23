//! The attitudes of the antennas and an inertial sensor from first to last: both in the order of
//! their times, the filter started at an attitude of the antennas, carried on by the sensor, started
//! again where it cannot go on, and smoothed backwards at the end.
//!
//! In: the rows of [`crate::engine::Engine::push`], with or without a solution, and samples. Out: a
//! row for every one that came in, with the attitude of the filter in it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use super::filter::{
    AttitudeFilter, Corrected, InertialSample, InertialSettings, MeasuredAttitude,
    MeasuredVelocity, Nominal,
};
use super::pause::{Cadence, NOTHING, Pause};
use super::smoother::{Recorder, Smoothed};
use crate::attitude::angles::angles_from_rotation_vector;
use crate::differential::Differential;
use crate::engine::PredictedAttitude;
use crate::frames::{Attitude, Body, Geodetic, Ned, Rotation, Vector};
use crate::fusion::health::{Event, FilterError, LOCKED_OUT_EPOCHS, Tally};
use crate::fusion::time_order::{TimeOrder, TooLate};
use crate::observation::ArrayEpoch;
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::solution::{AttitudeEstimate, EpochSolution, Outcome, PredictionRole, Reason, Status};
use crate::time::GpsTime;

/// So many fixes that the antennas found by themselves must have agreed with the prediction, the last one
/// among them, before it may decide on integers: a filter that began at a wrong fix must not make more.
const CONFIRMING_FIXES: usize = 5;
/// Variance of an angle that was not measured, rad²: further off than any angle can be.
const UNMEASURED: f64 = 100.0;

/// What a session needs to know beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeSessionSettings {
    /// Quality of the sensor.
    pub inertial: InertialSettings,
    /// Whether attitudes from real-valued ambiguities are used too.
    pub use_float: bool,
    /// 1 σ of the rows' velocities on each axis; `None` leaves them out.
    pub velocity_sd_mps: Option<f64>,
    /// From the sensor to the point whose velocity the rows have.
    pub lever_arm_m: Vector<Body>,
    /// Time over which the errors of the antennas' attitudes are alike (multipath); their variance is
    /// raised so that averaging over it gains nothing. 0: independent.
    pub correlation_s: f64,
    /// 1 σ of an angle that the first row does not have.
    pub first_angle_sd_rad: f64,
    /// Where the body is as long as no row says it.
    pub place: Option<Geodetic>,
    /// Input may come so much later than other input of its time.
    pub order_window_s: f64,
    /// Whether the states are kept for [`AttitudeSession::into_smoothed`].
    pub smooth: bool,
}

/// One sample: mean rate and specific force from the sample before to this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuSample {
    /// Against inertial space, rad/s; `None` if it was at the end of its range.
    pub rate_radps: Option<Vector<Body>>,
    /// m/s²; `None` without accelerometers, or at the end of their range.
    pub specific_force_mps2: Option<Vector<Body>>,
    /// Whether anything was at the end of its range.
    pub saturated: bool,
}

/// What the filter did since the row before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CoastingHealth {
    /// Components of the antennas' attitude.
    pub attitude: Tally,
    /// Of their velocity.
    pub velocity: Tally,
    /// Samples at the end of their range.
    pub saturated: usize,
    /// Samples that were no numbers, and attitudes whose covariance says nothing.
    pub unusable: usize,
    /// Samples with the time of the one before, which are left out.
    pub repeated: usize,
    /// Time without samples that was bridged.
    pub without_samples_s: f64,
    /// Time since an attitude of the antennas was last used.
    pub coasting_s: f64,
}

/// A row that came in, with what the filter makes of it.
#[derive(Debug, Clone, PartialEq)]
pub struct FusedRow {
    /// `fixed` if a fixed attitude was used in it, otherwise `float`, [`Reason::Predicted`] where none was; as
    /// it came in while no filter runs.
    pub solution: EpochSolution,
    /// Health of the filter since the row before.
    pub health: CoastingHealth,
    /// Since the row before, each with its time, seconds of the first row's week.
    pub events: Vec<(f64, Event)>,
}

#[derive(Debug, Clone, PartialEq)]
enum Input {
    Sample(ImuSample),
    Row(Box<EpochSolution>),
}

/// A row on its way through the session.
#[derive(Debug, Clone)]
struct Made {
    solution: EpochSolution,
    /// Rate of the body at it, for the velocity of another point.
    rate_radps: Vector3<f64>,
    /// Whether the recorder of the running filter holds a state for it.
    recorded: bool,
    /// What the survey of the antennas leaves in the attitude, rad².
    installation_rad2: Matrix3<f64>,
}

/// The filter with its inputs.
#[derive(Debug, Clone)]
pub struct AttitudeSession {
    settings: AttitudeSessionSettings,
    filter: Option<AttitudeFilter>,
    order: TimeOrder<Input>,
    /// Rows that wait for the sample that covers them.
    pending: VecDeque<(f64, EpochSolution)>,
    ready: VecDeque<FusedRow>,
    /// Time zero: the start of the week of the first row.
    week: Option<GpsTime>,
    clock_m: f64,
    place: Option<Geodetic>,
    cadence: Cadence,
    last_sample: Option<(f64, ImuSample)>,
    last_used_s: f64,
    locked_out_epochs: usize,
    /// Of the last row that had an attitude. It is the same in all of them: the filter averages noise
    /// alone, and what it finds is uncertain by this much more.
    installation_rad2: Matrix3<f64>,
    /// Whether the filter began at a fix.
    began_at_fix: bool,
    /// Fixes without help that agreed with the prediction, since one did not.
    confirming_fixes: usize,
    health: CoastingHealth,
    events: Vec<(f64, Event)>,
    recorder: Recorder,
    made: Vec<Made>,
    smoothed: Vec<EpochSolution>,
}

impl AttitudeSession {
    /// Before its first input.
    #[must_use]
    pub fn new(settings: AttitudeSessionSettings) -> Self {
        Self {
            order: TimeOrder::new(settings.order_window_s),
            place: settings.place,
            settings,
            filter: None,
            pending: VecDeque::new(),
            ready: VecDeque::new(),
            week: None,
            clock_m: 0.0,
            cadence: Cadence::default(),
            last_sample: None,
            installation_rad2: Matrix3::zeros(),
            last_used_s: f64::NEG_INFINITY,
            locked_out_epochs: 0,
            began_at_fix: false,
            confirming_fixes: 0,
            health: CoastingHealth::default(),
            events: Vec::new(),
            recorder: Recorder::default(),
            made: Vec::new(),
            smoothed: Vec::new(),
        }
    }

    /// Takes a sample; `time_s` is in seconds of the week of the first row.
    ///
    /// # Errors
    ///
    /// [`TooLate`]: it came later than the window allows, or its time is not a number.
    pub fn push_sample(&mut self, time_s: f64, sample: ImuSample) -> Result<(), TooLate> {
        self.order.push(time_s, Input::Sample(sample))
    }

    /// Takes a row of the antennas. Its tag is by the receiver's clock, which is taken out.
    ///
    /// # Errors
    ///
    /// [`TooLate`]: it came later than the window allows.
    pub fn push_row(&mut self, row: EpochSolution) -> Result<(), TooLate> {
        match row.prediction() {
            Some(PredictionRole::Agreed) => self.confirming_fixes += 1,
            Some(PredictionRole::Refused) => self.confirming_fixes = 0,
            Some(PredictionRole::Decided) | None => {}
        }
        self.clock_m = row.position.and_then(|p| p.clock_m).unwrap_or(self.clock_m);
        let time_s = self.seconds(row.time) - self.clock_m / SPEED_OF_LIGHT_MPS;
        self.order.push(time_s, Input::Row(Box::new(row)))
    }

    /// Solves an epoch with the attitude that the filter predicts for it. Samples up to its time must have
    /// been taken; `next` is the one after it. The row is to be taken with [`Self::push_row`].
    pub fn solve(
        &mut self,
        epoch: &ArrayEpoch,
        engine: &mut Differential,
        next: Option<(f64, ImuSample)>,
    ) -> EpochSolution {
        let predicted = self.predict(epoch.time, next);
        engine.push(epoch, predicted.as_ref())
    }

    /// The attitude at an epoch with this tag, from the rows and samples that have left the window and
    /// the samples that still wait; `None` while no filter runs that began at a fix.
    #[must_use]
    pub fn predict(
        &mut self,
        tag: GpsTime,
        next: Option<(f64, ImuSample)>,
    ) -> Option<PredictedAttitude> {
        let time_s = self.seconds(tag) - self.clock_m / SPEED_OF_LIGHT_MPS;
        let may_predict = |filter: &&AttitudeFilter| self.began_at_fix && filter.time_s() <= time_s;
        let mut filter = self.filter.as_ref().filter(may_predict)?.clone();
        let mut last = self.last_sample;
        let waiting = self.order.waiting().filter_map(|(at_s, input)| match input {
            Input::Sample(sample) => Some((at_s, *sample)),
            Input::Row(_) => None,
        });
        for (at_s, sample) in waiting.chain(next) {
            if filter.time_s() >= time_s {
                break;
            }
            let pause = self.cadence.pause(last, (at_s, sample));
            carry(&mut filter, at_s.min(time_s), &pause, &sample).ok()?;
            last = Some((at_s, sample));
        }
        let held = self.held(last, time_s);
        carry(&mut filter, time_s, &Pause::NONE, &held).ok()?;
        Some(PredictedAttitude {
            ned_from_body: filter.ned_from_body(),
            covariance_rad2: filter.attitude_covariance(),
            may_decide: self.confirming_fixes >= CONFIRMING_FIXES,
        })
    }

    /// Seconds since the start of the week of the first row that was asked for or taken.
    pub fn seconds(&mut self, time: GpsTime) -> f64 {
        time - *self.week.get_or_insert(time + -time.tow_s())
    }

    /// The next row whose time the samples have passed; `None`: more input is needed.
    pub fn next_row(&mut self) -> Option<FusedRow> {
        while self.ready.is_empty() {
            let (time_s, input) = self.order.pop()?;
            self.absorb(time_s, input);
        }
        self.ready.pop_front()
    }

    /// As [`AttitudeSession::next_row`] at the end of the data, without waiting.
    pub fn last_row(&mut self) -> Option<FusedRow> {
        while self.ready.is_empty() {
            match self.order.drain() {
                Some((time_s, input)) => self.absorb(time_s, input),
                None => self.finish_pending()?,
            }
        }
        self.ready.pop_front()
    }

    /// The filter, while it runs.
    #[must_use]
    pub const fn filter(&self) -> Option<&AttitudeFilter> {
        self.filter.as_ref()
    }

    /// Every row of the session with what the later rows say of it; empty unless the settings ask
    /// for it.
    #[must_use]
    pub fn into_smoothed(mut self) -> Vec<EpochSolution> {
        self.smooth();
        self.smoothed
    }

    fn absorb(&mut self, time_s: f64, input: Input) {
        match input {
            Input::Sample(sample) => self.absorb_sample(time_s, &sample),
            Input::Row(row) if self.filter.is_none() && self.pending.is_empty() => {
                self.start_or_pass(time_s, *row);
            }
            Input::Row(row) => self.pending.push_back((time_s, *row)),
        }
    }

    /// Turns the filter to every row before the sample and corrects it there, then to the sample.
    fn absorb_sample(&mut self, time_s: f64, sample: &ImuSample) {
        if self.last_sample.is_some_and(|(last_s, _)| time_s <= last_s) {
            self.health.repeated += 1;
            return;
        }
        self.note(sample);
        let now = (time_s, *sample);
        let pause = self.cadence.pause(self.last_sample, now);
        if let Some(last) = self.last_sample.replace(now) {
            self.cadence.follow(last, now);
        }
        while self.pending.front().is_some_and(|(row_s, _)| *row_s <= time_s) {
            let Some((row_s, row)) = self.pending.pop_front() else { break };
            self.advance(row_s, &pause, sample);
            self.correct(row_s, row, sample);
        }
        self.advance(time_s, &pause, sample);
    }

    /// Rows after the last sample: for little more than the usual step its rate is taken to hold.
    fn finish_pending(&mut self) -> Option<()> {
        let (row_s, row) = self.pending.pop_front()?;
        let held = self.held(self.last_sample, row_s);
        let pause = if held == NOTHING { Pause::unknown(row_s) } else { Pause::NONE };
        self.advance(row_s, &pause, &held);
        self.correct(row_s, row, &held);
        Some(())
    }

    /// The last sample for a time after it, or one that says nothing.
    fn held(&self, last: Option<(f64, ImuSample)>, time_s: f64) -> ImuSample {
        let held = last.filter(|(last_s, _)| time_s <= self.cadence.held_until_s(*last_s));
        held.map_or(NOTHING, |(_, sample)| sample)
    }

    /// Integrates to a time: with what is known of the pause until its end, then with the sample.
    fn advance(&mut self, time_s: f64, pause: &Pause, sample: &ImuSample) {
        let Some(filter) = &mut self.filter else { return };
        self.health.without_samples_s += (pause.until_s.min(time_s) - filter.time_s()).max(0.0);
        if let Err(error) = carry(filter, time_s, pause, sample) {
            self.stop(time_s, Event::Stopped(error));
        }
    }

    /// Absorbs what the antennas measured and makes the row.
    fn correct(&mut self, time_s: f64, row: EpochSolution, sample: &ImuSample) {
        if let Some(position) = &row.position {
            self.place = Some(position.geodetic);
        }
        if let Some(known) = self.angles(&row) {
            self.installation_rad2 = known.estimate.installation_rad2;
        }
        // The errors of code attitudes are no small turns: the first fix begins anew.
        if self.angles(&row).is_some() && row.is_fixed() && !self.began_at_fix {
            self.filter = None;
            self.smooth();
        }
        let Some(mut filter) = self.filter.take() else { return self.start_or_pass(time_s, row) };
        if let Some(place) = &self.place {
            filter.move_to(place);
        }
        let rate_radps = at(time_s, sample).rate_radps.xyz() - filter.nominal().gyro_bias_radps;
        let attitude = self.measured_attitude(time_s, &row, &filter);
        let velocity = self.measured_velocity(&row, &filter.ned_from_body(), &rate_radps);
        let update = |f: &mut AttitudeFilter| f.correct(attitude.as_ref(), velocity.as_ref());
        let corrected = match self.settings.smooth {
            true => self.recorder.around(&mut filter, update),
            false => update(&mut filter),
        };
        let used = corrected.attitude.used > 0;
        self.count(time_s, attitude.is_some(), &corrected);
        if row.prediction() == Some(PredictionRole::Refused) {
            self.locked_out_epochs += 1;
        } else if used && row.is_fixed() {
            self.locked_out_epochs = 0;
        }
        let outcome = match row.outcome {
            Outcome::Fixed { .. } if used => row.outcome,
            // A fix that the filter refuses does not fit what it predicts.
            Outcome::Fixed { attitude } => {
                Outcome::Float { attitude: Some(attitude), reason: Some(Reason::Residuals) }
            }
            other => {
                // What the prediction refused keeps its reason.
                let refused = row.prediction() == Some(PredictionRole::Refused);
                let reason = if used || refused { other.reason() } else { Some(Reason::Predicted) };
                Outcome::Float { attitude: other.attitude().copied(), reason }
            }
        };
        let made = Made {
            solution: EpochSolution { outcome, ..row },
            rate_radps,
            recorded: self.settings.smooth,
            installation_rad2: self.installation_rad2,
        };
        let (nominal, covariance) = (*filter.nominal(), filter.attitude_covariance());
        self.filter = Some(filter);
        let solution = self.with_attitude(&made, &nominal, &covariance);
        self.emit(made, solution);
        if self.locked_out_epochs >= LOCKED_OUT_EPOCHS {
            self.stop(time_s, Event::LockedOut);
        }
    }

    fn count(&mut self, time_s: f64, has_attitude: bool, corrected: &Corrected) {
        let Corrected { attitude, velocity } = corrected;
        self.health.attitude = *attitude;
        self.health.velocity = *velocity;
        if attitude.used > 0 {
            self.last_used_s = time_s;
        } else if attitude.rejected > 0 {
            self.locked_out_epochs += 1;
        } else {
            self.health.unusable += usize::from(has_attitude);
        }
        self.health.coasting_s = time_s - self.last_used_s;
    }

    /// Starts the filter at a row that has an attitude; passes any other row on as it is.
    fn start_or_pass(&mut self, time_s: f64, row: EpochSolution) {
        if let Some(position) = &row.position {
            self.place = Some(position.geodetic);
        }
        let started = self.place.and_then(|place| self.first_filter(time_s, &row, &place));
        let Some(mut filter) = started else {
            let solution = row.clone();
            return self.emit(self.made_of(row, false), solution);
        };
        if self.settings.smooth {
            self.recorder.around(&mut filter, |_| ());
        }
        let made = self.made_of(row, self.settings.smooth);
        let (nominal, covariance) = (*filter.nominal(), filter.attitude_covariance());
        self.filter = Some(filter);
        self.last_used_s = time_s;
        self.began_at_fix = made.solution.is_fixed();
        (self.locked_out_epochs, self.confirming_fixes) = (0, 0);
        self.events.push((time_s, Event::Started));
        let solution = self.with_attitude(&made, &nominal, &covariance);
        self.emit(made, solution);
    }

    /// A row before which the filter did not run.
    fn made_of(&self, solution: EpochSolution, recorded: bool) -> Made {
        let installation_rad2 = self.installation_rad2;
        Made { solution, rate_radps: Vector3::zeros(), recorded, installation_rad2 }
    }

    fn first_filter(
        &self,
        time_s: f64,
        row: &EpochSolution,
        place: &Geodetic,
    ) -> Option<AttitudeFilter> {
        let sd = self.settings.first_angle_sd_rad;
        let known = self.angles(row)?;
        let (pitch, roll) =
            self.last_sample.and_then(|(_, sample)| sample.specific_force_mps2).map_or(
                (0.0, 0.0),
                // A resting body feels −g: forward with the nose up, to the left with the right side down.
                |f| {
                    let [x, y, z]: [f64; 3] = f.xyz().into();
                    (x.atan2(y.hypot(z)), (-y).atan2(-z))
                },
            );
        let attitude = known.complete(pitch, roll, sd * sd, self.inflation(time_s))?;
        let rate_radps = self.last_sample.and_then(|(_, sample)| sample.rate_radps);
        let rate_radps = rate_radps.map_or_else(Vector3::zeros, |rate| rate.xyz());
        let velocity = self
            .measured_velocity(row, &attitude.ned_from_body, &rate_radps)
            .unwrap_or(UNKNOWN_VELOCITY);
        let inertial = self.settings.inertial;
        Some(AttitudeFilter::new(inertial, time_s, place, &attitude, &velocity))
    }

    /// The angles of a row that may be used.
    fn angles<'a>(&self, row: &'a EpochSolution) -> Option<Known<'a>> {
        let wanted = match row.status() {
            Status::Fixed => true,
            Status::Float => self.settings.use_float,
            _ => false,
        };
        let estimate = row.attitude().filter(|_| wanted)?;
        Some(Known { estimate, heading_rad: estimate.heading_rad? })
    }

    fn measured_attitude(
        &self,
        time_s: f64,
        row: &EpochSolution,
        filter: &AttitudeFilter,
    ) -> Option<MeasuredAttitude> {
        let now = Attitude::from_ned_from_body(&filter.ned_from_body());
        let known = self.angles(row)?;
        known.complete(now.pitch_rad, now.roll_rad, UNMEASURED, self.inflation(time_s))
    }

    /// v = v_row − C (ω×l)
    fn measured_velocity(
        &self,
        row: &EpochSolution,
        ned_from_body: &Rotation<Ned, Body>,
        rate_radps: &Vector3<f64>,
    ) -> Option<MeasuredVelocity> {
        let sd = self.settings.velocity_sd_mps?;
        let velocity_mps = row.position?.velocity_mps?;
        let turning = self.turning(ned_from_body, rate_radps);
        let covariance = Matrix3::from_diagonal_element(sd * sd);
        Some(MeasuredVelocity { velocity_mps: velocity_mps - turning, covariance })
    }

    /// C (ω×l): velocity of the rows' point against the sensor.
    fn turning(&self, ned_from_body: &Rotation<Ned, Body>, rate: &Vector3<f64>) -> Vector<Ned> {
        let lever_m = self.settings.lever_arm_m.xyz();
        let rate = if rate.iter().all(|r| r.is_finite()) { *rate } else { Vector3::zeros() };
        *ned_from_body * Vector::from_xyz(rate.cross(&lever_m))
    }

    /// By how much the variance is raised for errors that are alike over 2τ.
    fn inflation(&self, time_s: f64) -> f64 {
        let since_s = time_s - self.last_used_s;
        (2.0 * self.settings.correlation_s / since_s).max(1.0)
    }

    /// Counts a sample that says less than it should.
    fn note(&mut self, sample: &ImuSample) {
        let finite = |v: Option<Vector<Body>>| v.is_none_or(|v| v.is_finite());
        let usable = finite(sample.rate_radps) && finite(sample.specific_force_mps2);
        self.health.saturated += usize::from(sample.saturated);
        self.health.unusable += usize::from(!usable);
    }

    /// The row with an attitude and, where accelerometers carry it on, a velocity.
    fn with_attitude(
        &self,
        made: &Made,
        nominal: &Nominal,
        covariance: &Matrix3<f64>,
    ) -> EpochSolution {
        let matrix = nominal.attitude.to_rotation_matrix().into_inner();
        let ned_from_body = Rotation::from_matrix(matrix);
        let mut solution = made.solution.clone();
        let noise = AttitudeEstimate::full(ned_from_body, covariance);
        let attitude = AttitudeEstimate {
            covariance_rad2: noise.covariance_rad2 + made.installation_rad2,
            installation_rad2: made.installation_rad2,
            ..noise
        };
        solution.outcome = match solution.outcome {
            Outcome::Fixed { .. } => Outcome::Fixed { attitude },
            other => Outcome::Float { attitude: Some(attitude), reason: other.reason() },
        };
        if let (Some(position), Some(_)) = (&mut solution.position, self.settings.velocity_sd_mps) {
            let turning = self.turning(&ned_from_body, &made.rate_radps);
            position.velocity_mps = Some(Vector::from_xyz(nominal.velocity_mps) + turning);
        }
        solution
    }

    fn emit(&mut self, made: Made, solution: EpochSolution) {
        let health = core::mem::take(&mut self.health);
        let events = core::mem::take(&mut self.events);
        self.ready.push_back(FusedRow { solution, health, events });
        if self.settings.smooth {
            self.made.push(made);
        }
    }

    fn stop(&mut self, time_s: f64, event: Event) {
        self.filter = None;
        self.events.push((time_s, event));
        self.smooth();
    }

    /// The backward pass of the filter that ran until now.
    fn smooth(&mut self) {
        let states = core::mem::take(&mut self.recorder).smooth();
        let mut states = states.iter();
        for made in core::mem::take(&mut self.made) {
            let state = if made.recorded { states.next() } else { None };
            let smoothed = state.map_or_else(
                || made.solution.clone(),
                |Smoothed { nominal, covariance, .. }| {
                    let of_attitude = covariance.fixed_view::<3, 3>(0, 0).into_owned();
                    self.with_attitude(&made, nominal, &of_attitude)
                },
            );
            self.smoothed.push(smoothed);
        }
    }
}

/// The angles that a row has; the heading is always one of them.
struct Known<'a> {
    estimate: &'a AttitudeEstimate,
    heading_rad: f64,
}

impl Known<'_> {
    /// Pitch and roll as far as this row measured them: what antennas on one line do not see, the less
    /// certain of the two, only repeats what earlier rows said.
    fn measured_tilt(&self) -> [Option<f64>; 2] {
        let AttitudeEstimate { pitch_rad, roll_rad, covariance_rad2, .. } = self.estimate;
        let variances = (covariance_rad2[(1, 1)], covariance_rad2[(2, 2)]);
        match self.estimate.line_elevation_rad.zip(*pitch_rad).zip(*roll_rad) {
            Some(_) if variances.0 > variances.1 => [None, *roll_rad],
            Some(_) => [*pitch_rad, None],
            None => [*pitch_rad, *roll_rad],
        }
    }

    /// A whole attitude: angles that were not measured are the given ones with this variance.
    fn complete(
        &self,
        pitch_rad: f64,
        roll_rad: f64,
        unmeasured: f64,
        inflation: f64,
    ) -> Option<MeasuredAttitude> {
        let [pitch, roll] = self.measured_tilt();
        let angles = Attitude {
            heading_rad: self.heading_rad,
            pitch_rad: pitch.unwrap_or(pitch_rad),
            roll_rad: roll.unwrap_or(roll_rad),
        };
        let mut of_angles = self.estimate.noise_rad2() * inflation;
        for (k, angle) in [(1, pitch), (2, roll)] {
            if angle.is_none() {
                of_angles.row_mut(k).fill(0.0);
                of_angles.column_mut(k).fill(0.0);
                of_angles[(k, k)] = unmeasured;
            }
        }
        // φ = J⁻¹ δ(heading, pitch, roll)
        let by_angles = angles_from_rotation_vector(&angles).try_inverse()?;
        let whole = self.estimate.ned_from_body.filter(|_| pitch.is_some() && roll.is_some());
        let ned_from_body = whole.unwrap_or_else(|| angles.ned_from_body());
        let covariance = by_angles * of_angles * by_angles.transpose();
        Some(MeasuredAttitude { ned_from_body, covariance })
    }
}

const UNKNOWN_VELOCITY: MeasuredVelocity = MeasuredVelocity {
    velocity_mps: Vector::new(0.0, 0.0, 0.0),
    covariance: Matrix3::new(1e4, 0.0, 0.0, 0.0, 1e4, 0.0, 0.0, 0.0, 1e4),
};

/// Integrates a filter to a time: with what is known of the pause until its end, then with the sample.
fn carry(
    filter: &mut AttitudeFilter,
    time_s: f64,
    pause: &Pause,
    sample: &ImuSample,
) -> Result<(), FilterError> {
    let until_s = pause.until_s.min(time_s);
    if filter.time_s() < until_s {
        filter.bridge(&at(until_s, &pause.sample), pause.noise)?;
    }
    if filter.time_s() < time_s {
        filter.integrate(&at(time_s, sample))?;
    }
    Ok(())
}

/// The sample for the filter: a rate that is not known is no number.
fn at(time_s: f64, sample: &ImuSample) -> InertialSample {
    let rate_radps = sample.rate_radps.unwrap_or(Vector::new(f64::NAN, 0.0, 0.0));
    InertialSample { time_s, rate_radps, specific_force_mps2: sample.specific_force_mps2 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::EARTH_RATE_RADPS;
    use crate::fusion::kalman::Gate;

    fn session(inertial: InertialSettings) -> AttitudeSession {
        AttitudeSession::new(AttitudeSessionSettings {
            inertial,
            use_float: true,
            velocity_sd_mps: None,
            lever_arm_m: Vector::new(0.0, 0.0, 0.0),
            correlation_s: 0.0,
            first_angle_sd_rad: 0.1,
            place: Some(Geodetic::from_degrees(0.0, 0.0, 0.0)),
            order_window_s: 0.0,
            smooth: true,
        })
    }

    fn inertial(gyro_noise: f64) -> InertialSettings {
        InertialSettings {
            gyro_noise,
            gyro_bias_sd_radps: 1e-6,
            gyro_bias_walk: 1e-9,
            accelerometer_noise: 1e-3,
            accelerometer_bias_sd_mps2: 0.02,
            accelerometer_bias_walk: 1e-5,
            mounting_sd_rad: 0.0,
            unknown_acceleration: 1.0,
            gate: Gate::Innovation { sigmas: 5.0 },
        }
    }

    /// Heading north, level, with this covariance.
    fn fixed(second: f64, covariance_rad2: &Matrix3<f64>) -> EpochSolution {
        let level = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }.ned_from_body();
        let attitude = AttitudeEstimate::full(level, covariance_rad2);
        EpochSolution { outcome: Outcome::Fixed { attitude }, ..without(second) }
    }

    fn without(second: f64) -> EpochSolution {
        let time = GpsTime::from_week_tow(2300, second).unwrap();
        EpochSolution::lost(time, Reason::FewAntennas)
    }

    /// A fix at 0 s, then samples at these times of a body that turns to and fro about the vertical by 0.1 rad
    /// ten times in a minute; the row at 2 s.
    fn coasted(times_s: impl IntoIterator<Item = f64>) -> FusedRow {
        let heading = |time_s: f64| 0.1 * time_s.sin();
        let mut session = session(inertial(1e-5));
        session.push_row(fixed(0.0, &(Matrix3::identity() * 1e-8))).unwrap();
        for time_s in times_s {
            let yaw = (heading(time_s) - heading(time_s - 0.01)) / 0.01;
            let (sin, cos) = heading(time_s - 0.005).sin_cos();
            let [north, east] = [EARTH_RATE_RADPS * cos, -EARTH_RATE_RADPS * sin];
            let rate_radps = Some(Vector::new(north, east, yaw));
            session.push_sample(time_s, ImuSample { rate_radps, ..NOTHING }).unwrap();
        }
        session.push_row(without(2.0)).unwrap();
        core::iter::from_fn(|| session.last_row()).last().unwrap()
    }

    fn heading_error_and_sd_rad(row: &FusedRow) -> [f64; 2] {
        let attitude = row.solution.attitude().unwrap();
        let heading_rad = attitude.heading_rad.unwrap();
        [heading_rad - 0.1 * 2f64.sin(), attitude.covariance_rad2[(0, 0)].sqrt()]
    }

    /// Loggers write the first line twice, or round times so that two samples have one.
    #[test]
    fn a_repeated_time_costs_its_sample_alone() {
        let each = || (1..=200).map(|k| f64::from(k) * 0.01);
        for times_s in [
            each().take(1).chain(each()).collect::<Vec<_>>(),
            each().flat_map(|time_s| [time_s; 2]).collect(),
        ] {
            let row = coasted(times_s.iter().copied());
            let [error, sd] = heading_error_and_sd_rad(&row);
            assert!(error.abs() < 1e-4 && sd < 2e-4, "{error} {sd}");
            assert_eq!(row.health.without_samples_s, 0.0);
            assert_eq!(row.health.repeated, times_s.len() - 200);
        }
    }

    /// A few lost samples leave an error that the standard deviation covers, and no more; half a second of
    /// them leaves the heading open.
    #[test]
    fn lost_samples_are_bridged_as_far_as_the_rate_says() {
        let lost = |from: u32, count: u32| {
            let times = (1..=200).filter(move |k| !(from..from + count).contains(k));
            coasted(times.map(|k| f64::from(k) * 0.01))
        };
        for (count, most) in [(2, 2e-4), (8, 1e-3), (19, 5e-3)] {
            let row = lost(80, count);
            let [error, sd] = heading_error_and_sd_rad(&row);
            assert!(error.abs() < 3.0 * sd && sd < most, "{count}: {error} {sd}");
            let lost_s = f64::from(count) * 0.01;
            assert!((row.health.without_samples_s - lost_s).abs() < 1e-9);
        }
        let [_, sd] = heading_error_and_sd_rad(&lost(80, 50));
        assert!(sd > 0.5, "{sd}");
    }

    /// A body at rest, north on the equator, with an attitude each second whose noise averages and
    /// whose installation does not: after a hundred of them the noise is far below one row's, and the
    /// installation all there.
    #[test]
    fn the_installation_does_not_average() {
        let (noise_rad2, installation_rad2) = (1e-6, 4e-6);
        let mut session = session(inertial(1e-6));
        let level = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }.ned_from_body();
        let total = Matrix3::identity() * (noise_rad2 + installation_rad2);
        let attitude = AttitudeEstimate::full(level, &total)
            .with_installation(&(Matrix3::identity() * installation_rad2));
        let mut last = None;
        for second in 0..100 {
            let time = GpsTime::from_week_tow(2300, f64::from(second)).unwrap();
            session
                .push_row(EpochSolution {
                    outcome: Outcome::Fixed { attitude },
                    ..EpochSolution::lost(time, Reason::Ratio)
                })
                .unwrap();
            let sample = ImuSample {
                rate_radps: Some(Vector::new(EARTH_RATE_RADPS, 0.0, 0.0)),
                specific_force_mps2: None,
                saturated: false,
            };
            session.push_sample(f64::from(second) + 0.5, sample).unwrap();
            last = session.next_row().or(last);
        }
        let smoothed = session.into_smoothed();
        let middle = *smoothed[50].attitude().unwrap();
        for found in [*last.unwrap().solution.attitude().unwrap(), middle] {
            let heading_rad2 = found.covariance_rad2[(0, 0)];
            let left_rad2 = heading_rad2 - installation_rad2;
            assert!((1e-9..noise_rad2 / 5.0).contains(&left_rad2), "{heading_rad2}");
            assert_eq!(found.installation_rad2[(0, 0)], installation_rad2);
        }
    }
}
