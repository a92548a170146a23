//! A recording of the arm from its first sample to its last: both kinds of measurements put in the
//! order of their times, the filter started at a point position, and started again where it cannot
//! go on.

use nalgebra::{Matrix3, Vector3};

use super::filter::{ArmEpoch, ArmFilter, ArmFilterSettings, Health, Start};
use super::nhe::{Angles, frd_from_bfs};
use super::ranging::{Measured, Ranging};
use super::reception::{self, ReceptionSettings};
use crate::ephemeris::NavigationData;
use crate::frames::{Geodetic, Ned, Vector, wrap_heading};
use crate::fusion::earth::local_level::LocalLevel;
use crate::fusion::health::{Event, FilterError, LOCKED_OUT_EPOCHS};
use crate::fusion::time_order::{TimeOrder, TooLate};
use crate::observation::AntennaEpoch;
use crate::point::{self, NoPosition, PointSettings, PointSolution, Tracked};
use crate::signal::{SPEED_OF_LIGHT_MPS, System};
use crate::sky::NoiseModel;
use crate::solution::{
    AttitudeEstimate, EpochSolution, Outcome, PositionEstimate, PositionOrigin, Reason,
};
use crate::time::GpsTime;

/// A clock that differs from its prediction by more than this has jumped, m.
const CLOCK_JUMP_M: f64 = 10_000.0;
/// What is left of a jump in the estimate, m.
const CLOCK_SD_M: f64 = 30.0;

/// What a session needs to know beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionSettings {
    /// The filter.
    pub filter: ArmFilterSettings,
    /// Satellites and their noise.
    pub reception: ReceptionSettings,
    /// The one system whose satellites are used: the filter has one clock.
    pub system: System,
    /// First attitude.
    pub angles: Angles,
    /// 1 σ of its roll and pitch.
    pub tilt_sd_rad: f64,
    /// 1 σ of its heading.
    pub heading_sd_rad: f64,
    /// 1 σ of each first angular rate.
    pub rate_sd_radps: f64,
    /// Measurements may come so much later than others of their time.
    pub order_window_s: f64,
}

/// One sample of the accelerometers, with the arm's angle where an encoder measures it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSample {
    /// Forward, up, right, m/s²; `None` if it was at the end of its range.
    pub specific_force_mps2: Option<Vector3<f64>>,
    /// The arm's angle, rad.
    pub arm_angle_rad: Option<Measured>,
}

/// What comes of one GNSS epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionRow {
    /// Attitude and position; `float` while the filter runs, otherwise `lost`.
    pub solution: EpochSolution,
    /// Health of the filter since the row before.
    pub health: Health,
    /// Since the row before, each with its time, seconds of the first epoch's week.
    pub events: Vec<(f64, Event)>,
}

#[derive(Debug, Clone, PartialEq)]
enum Input {
    Sample(ArmSample),
    Gnss(AntennaEpoch),
}

/// The filter with its inputs.
#[derive(Debug, Clone)]
pub struct ArmSession {
    settings: SessionSettings,
    navigation: NavigationData,
    filter: Option<ArmFilter>,
    order: TimeOrder<Input>,
    /// Time zero: the start of the week of the first GNSS epoch.
    week: Option<GpsTime>,
    /// Last known receiver clock, m.
    clock_m: f64,
    locked_out_epochs: usize,
    health: Health,
    events: Vec<(f64, Event)>,
    tracked: Vec<Tracked>,
    ranges: Vec<Ranging>,
}

impl ArmSession {
    /// Before its first measurement.
    #[must_use]
    pub fn new(settings: SessionSettings, navigation: NavigationData) -> Self {
        Self {
            order: TimeOrder::new(settings.order_window_s),
            settings,
            navigation,
            filter: None,
            week: None,
            clock_m: 0.0,
            locked_out_epochs: 0,
            health: Health::default(),
            events: Vec::new(),
            tracked: Vec::new(),
            ranges: Vec::new(),
        }
    }

    /// Takes a sample of the accelerometers; `time_s` is in seconds of the week of the first epoch.
    ///
    /// # Errors
    ///
    /// [`TooLate`]: it came later than the window allows, or its time is not a number.
    pub fn push_sample(&mut self, time_s: f64, sample: ArmSample) -> Result<(), TooLate> {
        self.order.push(time_s, Input::Sample(sample))
    }

    /// Takes a GNSS epoch. Its tag is by the receiver's clock, which the session takes out.
    ///
    /// # Errors
    ///
    /// [`TooLate`]: it came later than the window allows.
    pub fn push_epoch(&mut self, epoch: AntennaEpoch) -> Result<(), TooLate> {
        let time_s = self.seconds(epoch.time) - self.clock_m / SPEED_OF_LIGHT_MPS;
        self.order.push(time_s, Input::Gnss(epoch))
    }

    /// Seconds since the start of the week of the first epoch that was asked for or taken.
    pub fn seconds(&mut self, time: GpsTime) -> f64 {
        time - *self.week.get_or_insert(time + -time.tow_s())
    }

    /// The row of the next GNSS epoch that has waited long enough, everything before it absorbed;
    /// `None`: more input is needed.
    pub fn next_row(&mut self) -> Option<SessionRow> {
        loop {
            let (time_s, input) = self.order.pop()?;
            if let Some(row) = self.absorb(time_s, input) {
                return Some(row);
            }
        }
    }

    /// As [`ArmSession::next_row`] at the end of the data, without waiting.
    pub fn last_row(&mut self) -> Option<SessionRow> {
        loop {
            let (time_s, input) = self.order.drain()?;
            if let Some(row) = self.absorb(time_s, input) {
                return Some(row);
            }
        }
    }

    /// The filter, while it runs.
    #[must_use]
    pub const fn filter(&self) -> Option<&ArmFilter> {
        self.filter.as_ref()
    }

    fn absorb(&mut self, time_s: f64, input: Input) -> Option<SessionRow> {
        match input {
            Input::Sample(sample) => {
                self.absorb_sample(time_s, &sample);
                None
            }
            Input::Gnss(epoch) => {
                let solution = self.absorb_epoch(time_s, &epoch);
                let health = core::mem::take(&mut self.health);
                Some(SessionRow { solution, health, events: core::mem::take(&mut self.events) })
            }
        }
    }

    fn absorb_sample(&mut self, time_s: f64, sample: &ArmSample) {
        self.health.saturated += usize::from(sample.specific_force_mps2.is_none());
        let Some(filter) = &mut self.filter else { return };
        let epoch = ArmEpoch {
            time_s,
            specific_force_mps2: sample.specific_force_mps2,
            satellites: &[],
            arm_angle_rad: sample.arm_angle_rad,
        };
        let outcome = filter.push(&epoch);
        self.keep_or_stop(time_s, outcome);
    }

    fn absorb_epoch(&mut self, time_s: f64, epoch: &AntennaEpoch) -> EpochSolution {
        let system = self.settings.system;
        let lost = |reason| EpochSolution::lost(epoch.time, reason);
        let without_ephemeris =
            point::track(epoch, &self.navigation, |s| s == system, &mut self.tracked);
        if self.filter.is_none() {
            match self.start(time_s, epoch) {
                Ok(()) => self.events.push((time_s, Event::Started)),
                Err(NoPosition::FewSatellites { have: 0, .. }) if without_ephemeris > 0 => {
                    return lost(Reason::NoEphemeris);
                }
                Err(NoPosition::FewSatellites { .. }) => return lost(Reason::FewSatellites),
                Err(NoPosition::Singular | NoPosition::Diverged) => return lost(Reason::BadInput),
            }
        }
        self.predict_and_range(time_s, epoch);
        let Some(filter) = &mut self.filter else { return lost(Reason::BadInput) };
        let satellites = &self.ranges;
        let fused = ArmEpoch { time_s, specific_force_mps2: None, satellites, arm_angle_rad: None };
        let outcome = filter.push(&fused);
        self.keep_or_stop(time_s, outcome);
        if let Ok(Health { gnss, .. }) = outcome {
            self.stop_if_locked_out(time_s, gnss.rejected > gnss.used);
        }
        let Some(filter) = &self.filter else { return lost(Reason::BadInput) };
        self.clock_m = filter.motion().clock_m;
        EpochSolution {
            antennas: 1,
            satellites: self.ranges.len(),
            shared_satellites: self.ranges.len(),
            ..solution(filter, epoch.time)
        }
    }

    /// Moves the filter to the epoch and evaluates the satellites at the antenna it predicts.
    fn predict_and_range(&mut self, time_s: f64, epoch: &AntennaEpoch) {
        let Some(filter) = &mut self.filter else { return };
        let outcome = filter.predict_to(time_s).map(|()| Health::default());
        let antenna_m = Vector::from_xyz(filter.antenna_m());
        let clock_m = filter.motion().clock_m;
        self.keep_or_stop(time_s, outcome);
        let (navigation, settings) = (&self.navigation, &self.settings.reception);
        let (tracked, ranges) = (&self.tracked, &mut self.ranges);
        reception::ranges(epoch, tracked, antenna_m, navigation, settings, ranges);
        let Some(filter) = &mut self.filter else { return };
        let jump_m = median_clock_m(&self.ranges, &antenna_m.xyz()).map(|clock| clock - clock_m);
        if let Some(jump_m) = jump_m.filter(|jump_m| jump_m.abs() > CLOCK_JUMP_M) {
            filter.forget_clock(clock_m + jump_m, CLOCK_SD_M);
            self.events.push((time_s, Event::ClockJump { jump_m }));
        }
    }

    fn keep_or_stop(&mut self, time_s: f64, outcome: Result<Health, FilterError>) {
        match outcome {
            Ok(health) => self.health.add(&health),
            Err(error) => {
                self.filter = None;
                self.events.push((time_s, Event::Stopped(error)));
            }
        }
    }

    fn stop_if_locked_out(&mut self, time_s: f64, mostly_rejected: bool) {
        self.locked_out_epochs = if mostly_rejected { self.locked_out_epochs + 1 } else { 0 };
        if self.locked_out_epochs >= LOCKED_OUT_EPOCHS {
            self.locked_out_epochs = 0;
            self.filter = None;
            self.events.push((time_s, Event::LockedOut));
        }
    }

    /// Starts the filter at the point position, with the configured attitude.
    fn start(&mut self, time_s: f64, epoch: &AntennaEpoch) -> Result<(), NoPosition> {
        let elevation_mask_rad = self.settings.reception.elevation_mask_rad;
        let noise = NoiseModel {
            code_zenith_m: self.settings.reception.pseudorange_sd_m,
            phase_zenith_m: self.settings.reception.phase_sd_m.unwrap_or(0.003),
            full_cn0_dbhz: 45.0,
            channel_sd_m: 0.0,
        };
        let settings = PointSettings { elevation_mask_rad, noise };
        let point = point::solve(&self.tracked, &self.navigation, epoch.time, &settings)?;
        // The clock that the tag was corrected by may have been unknown until now.
        let tag_s = time_s + self.clock_m / SPEED_OF_LIGHT_MPS;
        let at_s = tag_s - point.clock_m / SPEED_OF_LIGHT_MPS;
        let velocity = point::velocity(&self.tracked, &point, elevation_mask_rad);
        let start = self.start_at(at_s.min(time_s), &point, velocity.as_ref());
        self.filter = Some(ArmFilter::new(self.settings.filter.clone(), &start));
        Ok(())
    }

    fn start_at(
        &self,
        time_s: f64,
        point: &PointSolution,
        velocity: Option<&point::Velocity>,
    ) -> Start {
        let SessionSettings { filter, angles, heading_sd_rad, .. } = &self.settings;
        let arm = filter.arm.at_angle(filter.arm.angle_rad(time_s));
        let nhe_from_ecef = LocalLevel::at(&point.position_m.xyz()).nhe_from_ecef;
        let ecef_from_body = nhe_from_ecef.transpose() * angles.nhe_from_body();
        let speed_mps = filter.arm.speed_mps();
        // What the turning antenna adds to the velocity is as uncertain as the heading.
        let velocity_sd_mps = 0.5 + speed_mps * heading_sd_rad.min(1.0);
        Start {
            time_s,
            position_m: point.position_m.xyz() - ecef_from_body * arm.position_m,
            position_sd_m: 10.0 + filter.arm.radius_m,
            clock_m: point.clock_m,
            clock_sd_m: CLOCK_SD_M,
            velocity_mps: velocity.map_or(Vector3::zeros(), |found| {
                found.velocity_mps.xyz() - ecef_from_body * arm.velocity_mps
            }),
            velocity_sd_mps: if velocity.is_some() { velocity_sd_mps } else { 100.0 },
            clock_rate_mps: velocity.map_or(0.0, |found| found.clock_drift_mps),
            clock_rate_sd_mps: if velocity.is_some() { velocity_sd_mps } else { 1000.0 },
            acceleration_mps2: Vector3::zeros(),
            acceleration_sd_mps2: 1.0,
            angles: *angles,
            tilt_sd_rad: self.settings.tilt_sd_rad,
            heading_sd_rad: *heading_sd_rad,
            angle_rates_radps: Vector3::zeros(),
            rate_sd_radps: self.settings.rate_sd_radps,
            angular_acceleration_sd_radps2: 0.5,
        }
    }
}

/// Median of measured minus geometric distance: the receiver's clock, whatever its size.
fn median_clock_m(ranges: &[Ranging], antenna_m: &Vector3<f64>) -> Option<f64> {
    let mut clocks: Vec<f64> = ranges
        .iter()
        .filter_map(|r| Some(r.pseudorange_m?.value - (r.motion.position_m - antenna_m).norm()))
        .collect();
    clocks.sort_by(f64::total_cmp);
    clocks.get(clocks.len() / 2).copied()
}

/// Attitude, position and velocity of the body as Kurs reports them.
fn solution(filter: &ArmFilter, time: GpsTime) -> EpochSolution {
    let motion = filter.motion();
    let geodetic = Geodetic::from_ecef(Vector::from_xyz(motion.position_m));
    let ned_from_ecef = geodetic.ned_from_ecef();
    let attitude = filter.angles().attitude();
    let position_covariance: Matrix3<f64> = filter.covariance().fixed_view::<3, 3>(0, 0).into();
    let velocity_mps: Vector<Ned> = ned_from_ecef * Vector::from_xyz(motion.velocity_mps);
    let attitude = AttitudeEstimate {
        heading_rad: Some(wrap_heading(attitude.heading_rad)),
        pitch_rad: Some(attitude.pitch_rad),
        roll_rad: Some(attitude.roll_rad),
        covariance_rad2: angle_covariance(filter),
        installation_rad2: Matrix3::zeros(),
        ned_from_body: Some(attitude.ned_from_body()),
        line_elevation_rad: None,
    };
    EpochSolution {
        outcome: Outcome::Float { attitude: Some(attitude), reason: None },
        position: Some(PositionEstimate {
            antenna: None,
            geodetic,
            position_m: Vector::from_xyz(motion.position_m),
            covariance_m2: ned_from_ecef.turn_covariance(&position_covariance),
            velocity_mps: Some(velocity_mps),
            clock_m: Some(motion.clock_m),
            hdop: None,
            origin: PositionOrigin::Alone,
        }),
        ..EpochSolution::lost(time, Reason::BadInput)
    }
}

/// Covariance of heading, pitch, roll, rad²; infinite where pitch is ±90°.
fn angle_covariance(filter: &ArmFilter) -> Matrix3<f64> {
    // δ(r, p, h) = E⁻¹ φ; heading as it is, the other two change sign
    let Some(inverse) = filter.angles().rate_matrix().try_inverse() else {
        return Matrix3::from_diagonal_element(f64::INFINITY);
    };
    let order = Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 0.0);
    let by_error = order * inverse;
    by_error * filter.attitude_covariance() * by_error.transpose()
}

/// Specific force in the paper's body axes from forward, right, down.
#[must_use]
pub fn from_forward_right_down(specific_force_mps2: &Vector3<f64>) -> Vector3<f64> {
    frd_from_bfs().tr_mul(specific_force_mps2)
}
