//! The filter for antenna and accelerometers at the end of a rotating arm.
//!
//! Gravity gives the tilt, Coriolis acceleration on the arm the angular rates, and the antenna's
//! own speed in the range rates the heading, even in uniform motion. At every instant: predict to
//! it, linearise all of its measurements with the model of [`super::model`], refuse those
//! outside the gate, absorb the rest.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::RotatingArm;
use super::attitude_form::{AttitudeForm, Carried, Decoded, triple};
use super::gradient::{Motion, Prediction};
use super::layout::{ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, Layout, POSITION, RATE, VELOCITY};
use super::model::ArmEnd;
use super::nhe::Angles;
use super::phase_slots::PhaseSlots;
use super::process_noise::{ProcessNoise, Tuning};
use super::ranging::{Measured, Ranging};
use crate::frames::{EARTH_RATE_RADPS, wrap_angle};
use crate::fusion::earth::local_level::LocalLevel;
use crate::fusion::health::{FilterError, LONGEST_GAP_S, Tally};
use crate::fusion::kalman::{Batch, Estimate, Gate};

/// An unknown constant that may drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// Standard deviation at the start.
    pub initial_sd: f64,
    /// Spectral density of the white noise that drives it, unit²/s.
    pub density: f64,
}

/// What the filter estimates and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmFilterSettings {
    /// The arm.
    pub arm: RotatingArm,
    /// How the attitude is carried.
    pub form: AttitudeForm,
    /// Angular accelerations as states (20 instead of 17): no lag in a turn, more noise.
    pub angular_acceleration: bool,
    /// Process noise.
    pub process_noise: ProcessNoise,
    /// Whether the process noise follows the corrections, equation (15); harmful, off by default.
    pub adaptive: bool,
    /// Whether the variance of linearisation is added to the measurements'; needed with phase.
    pub second_order: bool,
    /// Which innovations are refused.
    pub gate: Gate,
    /// Noise of one accelerometer sample.
    pub accelerometer_sd_mps2: f64,
    /// Accelerometer biases as states, m/s².
    pub bias: Option<Drift>,
    /// A correction of the arm's angle as a state, rad. Indistinguishable from a turn about the
    /// arm's axis unless the angle is also measured.
    pub arm_angle: Option<Drift>,
    /// How many carrier-phase ambiguities fit; 0: phase is not used.
    pub ambiguity_slots: usize,
}

/// Where a filter begins, with the standard deviations of independent errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Time since the arm's time zero.
    pub time_s: f64,
    /// Centre of rotation, ECEF.
    pub position_m: Vector3<f64>,
    /// Per axis.
    pub position_sd_m: f64,
    /// Receiver clock.
    pub clock_m: f64,
    /// Of the receiver clock.
    pub clock_sd_m: f64,
    /// Of the centre, ECEF.
    pub velocity_mps: Vector3<f64>,
    /// Per axis.
    pub velocity_sd_mps: f64,
    /// Rate of the receiver clock.
    pub clock_rate_mps: f64,
    /// Of that rate.
    pub clock_rate_sd_mps: f64,
    /// Of the centre, ECEF.
    pub acceleration_mps2: Vector3<f64>,
    /// Per axis.
    pub acceleration_sd_mps2: f64,
    /// Roll, pitch, heading.
    pub angles: Angles,
    /// Of roll and pitch.
    pub tilt_sd_rad: f64,
    /// Of heading.
    pub heading_sd_rad: f64,
    /// ṙ, ṗ, ḣ.
    pub angle_rates_radps: Vector3<f64>,
    /// Per angle.
    pub rate_sd_radps: f64,
    /// Per angle; only with angular accelerations as states.
    pub angular_acceleration_sd_radps2: f64,
}

/// Everything measured at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmEpoch<'a> {
    /// Time since the arm's time zero.
    pub time_s: f64,
    /// The three accelerometers, m/s².
    pub specific_force_mps2: Option<Vector3<f64>>,
    /// The satellites, any number.
    pub satellites: &'a [Ranging],
    /// The arm's angle from an encoder, rad.
    pub arm_angle_rad: Option<Measured>,
}

/// Filter health at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Health {
    /// Pseudoranges, range rates and phases.
    pub gnss: Tally,
    /// Accelerometers.
    pub accelerometer: Tally,
    /// Values that were infinite or not a number.
    pub unusable: usize,
    /// Accelerometer samples at the end of their range: left out before they come to the filter.
    pub saturated: usize,
}

/// Extended Kalman filter of the rotating arm.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmFilter {
    settings: ArmFilterSettings,
    layout: Layout,
    time_s: f64,
    state: DVector<f64>,
    carried: Carried,
    estimate: Estimate,
    step_noise: DMatrix<f64>,
    step_noise_of_s: f64,
    /// Diagonal that equation (15) adds to Q.
    adapted: DVector<f64>,
    slots: PhaseSlots,
    batch: Batch,
}

impl ArmFilterSettings {
    /// The recommended filter for an arm: 17 states in angles, manoeuvring, 5 σ gate.
    #[must_use]
    pub const fn new(arm: RotatingArm) -> Self {
        Self {
            arm,
            form: AttitudeForm::Euler,
            angular_acceleration: false,
            process_noise: ProcessNoise::Continuous(Tuning::Manoeuvring.densities(false)),
            adaptive: false,
            second_order: true,
            gate: Gate::Innovation { sigmas: 5.0 },
            accelerometer_sd_mps2: 0.01,
            bias: None,
            arm_angle: None,
            ambiguity_slots: 0,
        }
    }
}

impl ArmFilter {
    /// A filter at its start.
    #[must_use]
    pub fn new(settings: ArmFilterSettings, start: &Start) -> Self {
        let layout = Layout::new(
            settings.angular_acceleration,
            settings.bias.is_some(),
            settings.arm_angle.is_some(),
            settings.ambiguity_slots,
        );
        let n = layout.states();
        let mut state = DVector::zeros(n);
        let x = state.as_mut_slice();
        x[POSITION].copy_from_slice(start.position_m.as_slice());
        x[CLOCK] = start.clock_m;
        x[VELOCITY].copy_from_slice(start.velocity_mps.as_slice());
        x[CLOCK_RATE] = start.clock_rate_mps;
        x[ACCELERATION].copy_from_slice(start.acceleration_mps2.as_slice());
        x[RATE].copy_from_slice(start.angle_rates_radps.as_slice());
        let carried = Carried::new(settings.form, &start.angles, x);
        let mut filter = Self {
            estimate: Estimate::new(&initial_deviations(&settings, &layout, start)),
            slots: PhaseSlots::new(settings.ambiguity_slots),
            settings,
            layout,
            time_s: start.time_s,
            state,
            carried,
            step_noise: DMatrix::zeros(n, n),
            step_noise_of_s: f64::NAN,
            adapted: DVector::zeros(n),
            batch: Batch::default(),
        };
        if filter.settings.form == AttitudeForm::Quaternion {
            filter.turn_start_into_body_axes(&start.angles);
        }
        filter
    }

    /// Predicts to the epoch and absorbs its measurements.
    ///
    /// # Errors
    ///
    /// [`FilterError`]; the filter is unchanged then, except for [`FilterError::Diverged`].
    pub fn push(&mut self, epoch: &ArmEpoch) -> Result<Health, FilterError> {
        self.predict_to(epoch.time_s)?;
        let mut health = Health::default();
        let force = self.usable_force(epoch, &mut health);
        self.linearise(epoch, force, &mut health);
        self.estimate.update(&mut self.batch, self.settings.gate);
        self.correct();
        let gnss_count = self.batch.len() - if force.is_some() { 3 } else { 0 };
        let (gnss, accelerometer) = self.batch.outcomes().split_at(gnss_count);
        health.gnss = Tally::of(gnss);
        health.accelerometer = Tally::of(accelerometer);
        let finite = self.state.iter().all(|value| value.is_finite());
        if finite { Ok(health) } else { Err(FilterError::Diverged) }
    }

    /// Moves state and covariance on to a time.
    ///
    /// # Errors
    ///
    /// [`FilterError::TimeGoesBack`] or [`FilterError::Gap`]; nothing is changed then.
    pub fn predict_to(&mut self, time_s: f64) -> Result<(), FilterError> {
        let step_s = time_s - self.time_s;
        if step_s == 0.0 {
            return Ok(());
        }
        if step_s > LONGEST_GAP_S {
            return Err(FilterError::Gap { gap_s: step_s });
        }
        // Also refuses a time that is not a number.
        if step_s.is_nan() || step_s < 0.0 {
            return Err(FilterError::TimeGoesBack { from_s: self.time_s, to_s: time_s });
        }
        let x = self.state.as_mut_slice();
        self.estimate.propagate(self.carried.transition(x, &self.layout, step_s));
        self.carried.advance(x, &self.layout, step_s);
        self.add_process_noise(step_s);
        self.time_s = time_s;
        Ok(())
    }

    /// Time of the state, since the arm's time zero.
    #[must_use]
    pub const fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Where the blocks of the state are.
    #[must_use]
    pub const fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The state, in the order of [`super::layout`].
    #[must_use]
    pub fn state(&self) -> &[f64] {
        self.state.as_slice()
    }

    /// P, of the state's errors.
    #[must_use]
    pub const fn covariance(&self) -> &DMatrix<f64> {
        &self.estimate.covariance
    }

    /// Roll, pitch and heading of the paper; [`Angles::attitude`] gives those of Kurs.
    #[must_use]
    pub fn angles(&self) -> Angles {
        self.carried.angles(self.state.as_slice())
    }

    /// Covariance of the rotation vector of the attitude error in body axes (forward, up, right),
    /// rad².
    #[must_use]
    pub fn attitude_covariance(&self) -> Matrix3<f64> {
        let block = self.estimate.covariance.fixed_view::<3, 3>(ATTITUDE.start, ATTITUDE.start);
        match self.settings.form {
            AttitudeForm::Quaternion => block.into_owned(),
            AttitudeForm::Euler => {
                let e = self.angles().rate_matrix();
                e * block * e.transpose()
            }
        }
    }

    /// The motion of the body at this time.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.decode().1.motion
    }

    /// Where the antenna is now, ECEF, m.
    #[must_use]
    pub fn antenna_m(&self) -> Vector3<f64> {
        let angle_rad = self.settings.arm.angle_rad(self.time_s) + self.arm_correction();
        ArmEnd::new(&self.motion(), &self.settings.arm.at_angle(angle_rad)).position_m()
    }

    /// Sets the receiver clock and forgets what was known of it: the receiver has set it.
    pub fn forget_clock(&mut self, clock_m: f64, standard_deviation_m: f64) {
        self.state[CLOCK] = clock_m;
        self.estimate.forget(CLOCK, standard_deviation_m);
    }

    /// Diagonal of the process noise that the next step of the same length adds.
    #[must_use]
    pub fn process_noise_diagonal(&self) -> DVector<f64> {
        self.step_noise.diagonal() + &self.adapted
    }

    /// The measurements of the last epoch: satellites in their order (pseudoranges, range rates,
    /// phases), arm angle, accelerometers.
    #[must_use]
    pub const fn batch(&self) -> &Batch {
        &self.batch
    }

    fn decode(&self) -> (LocalLevel, Decoded) {
        let x = self.state.as_slice();
        let here = LocalLevel::at(&triple(x, POSITION.start));
        (here, self.carried.decode(x, &self.layout, &here))
    }

    fn add_process_noise(&mut self, step_s: f64) {
        // Sampling is mostly regular: Q of the last step serves again.
        if (step_s - self.step_noise_of_s).abs() > 1e-9 || self.step_noise_of_s.is_nan() {
            self.step_noise.fill(0.0);
            self.settings.process_noise.add_to(&mut self.step_noise, &self.layout, step_s);
            for (drift, block) in [
                (self.settings.bias, &self.layout.bias),
                (self.settings.arm_angle, &self.layout.arm_angle),
            ] {
                for index in block.clone() {
                    self.step_noise[(index, index)] += drift.map_or(0.0, |d| d.density * step_s);
                }
            }
            self.step_noise_of_s = step_s;
        }
        self.estimate.covariance += &self.step_noise;
        for (index, extra) in self.adapted.iter().enumerate() {
            self.estimate.covariance[(index, index)] += extra;
        }
    }

    /// The accelerometer sample, unless it says nothing.
    fn usable_force(&self, epoch: &ArmEpoch, health: &mut Health) -> Option<Vector3<f64>> {
        let force = epoch.specific_force_mps2?;
        if !force.iter().all(|axis| axis.is_finite()) {
            health.unusable += 1;
            return None;
        }
        Some(force)
    }

    /// Fills the batch with the innovations and gradients of everything measured.
    fn linearise(&mut self, epoch: &ArmEpoch, force: Option<Vector3<f64>>, health: &mut Health) {
        let (here, decoded) = self.decode();
        let arm_correction = self.arm_correction();
        let arm_angle = self.settings.arm.angle_rad(self.time_s) + arm_correction;
        let end = ArmEnd::new(&decoded.motion, &self.settings.arm.at_angle(arm_angle));
        let extra = self.second_order_variances();
        self.batch.begin(self.layout.states());
        let (batch, layout) = (&mut self.batch, &self.layout);
        let mut add = |measured: Measured, prediction: Prediction, extra: f64| {
            let row = batch.push(measured.value - prediction.value, measured.variance() + extra);
            decoded.write_row(&prediction.gradient, layout, row);
        };
        let mut usable = |measured: &Option<Measured>| {
            health.unusable += usize::from(measured.is_some_and(|m| !m.is_usable()));
            measured.filter(Measured::is_usable)
        };
        for satellite in epoch.satellites {
            if let Some(measured) = usable(&satellite.pseudorange_m) {
                add(measured, end.pseudorange(&satellite.motion), 0.0);
            }
        }
        for satellite in epoch.satellites {
            if let Some(measured) = usable(&satellite.range_rate_mps) {
                add(measured, end.range_rate(&satellite.motion), extra.range_rate);
            }
        }
        if !layout.ambiguities.is_empty() {
            for satellite in epoch.satellites {
                let Some(measured) = usable(&satellite.phase_m) else { continue };
                let prediction = end.pseudorange(&satellite.motion);
                let slot = self.slots.slot_of(satellite.satellite, self.time_s);
                let index = layout.ambiguities.start + slot.index;
                if slot.is_new || satellite.slipped {
                    // The first phase only sets the constant.
                    self.state[index] = measured.value - prediction.value;
                    self.estimate.forget(index, UNKNOWN_AMBIGUITY_SD_M);
                    continue;
                }
                let ambiguity = self.state[index];
                let variance = measured.variance() + extra.phase;
                let row = batch.push(measured.value - prediction.value - ambiguity, variance);
                decoded.write_row(&prediction.gradient, layout, row);
                row[index] = 1.0;
            }
        }
        if let (Some(measured), false) = (usable(&epoch.arm_angle_rad), layout.arm_angle.is_empty())
        {
            let innovation = wrap_angle(measured.value - arm_angle);
            batch.push(innovation, measured.variance())[layout.arm_angle.start] = 1.0;
        }
        if let Some(force) = force {
            let variance = self.settings.accelerometer_sd_mps2.powi(2) + extra.accelerometer;
            let predictions = end.specific_force(&here, EARTH_RATE_RADPS);
            for (axis, prediction) in predictions.iter().enumerate() {
                let bias_index = (!layout.bias.is_empty()).then_some(layout.bias.start + axis);
                let bias = bias_index.map_or(0.0, |index| self.state[index]);
                let row = batch.push(force[axis] - prediction.value - bias, variance);
                decoded.write_row(&prediction.gradient, layout, row);
                if let Some(index) = bias_index {
                    row[index] = 1.0;
                }
            }
        }
    }

    fn arm_correction(&self) -> f64 {
        self.layout.arm_angle.clone().map(|index| self.state[index]).sum()
    }

    /// Variance that the curvature of the models in the attitude adds:
    /// ½ (scale · tr P_att)², scale 9.81 m/s², 2πfR and R.
    fn second_order_variances(&self) -> SecondOrder {
        if !self.settings.second_order {
            return SecondOrder::default();
        }
        let trace: f64 = ATTITUDE.map(|i| self.estimate.covariance[(i, i)]).sum();
        let variance = |scale: f64| (scale * trace).powi(2) / 2.0;
        SecondOrder {
            accelerometer: variance(9.81),
            range_rate: variance(self.settings.arm.speed_mps()),
            phase: variance(self.settings.arm.radius_m),
        }
    }

    fn correct(&mut self) {
        let correction = self.estimate.correction.as_slice();
        let moved = self.carried.correct(self.state.as_mut_slice(), correction);
        if self.settings.adaptive {
            // Q ← Q_min + 0.1 Q + 0.7 diag(δx δxᵀ), the part above Q_min
            for (index, adapted) in self.adapted.iter_mut().enumerate() {
                let base = self.step_noise[(index, index)];
                *adapted = 0.1 * (base + *adapted) + 0.7 * correction[index].powi(2);
            }
        }
        if let Some(phi) = moved {
            // The error is now counted from the corrected attitude: φ ← (I − [φ̂×]/2) φ
            let reset = Matrix3::identity() - phi.cross_matrix() / 2.0;
            self.estimate.propagate(|column| {
                let turned = reset * triple(column, ATTITUDE.start);
                column[ATTITUDE].copy_from_slice(turned.as_slice());
            });
        }
    }

    /// The start is given in angles; the quaternion form counts errors and rates in body axes.
    fn turn_start_into_body_axes(&mut self, angles: &Angles) {
        let e = angles.rate_matrix();
        let blocks = [ATTITUDE.start, RATE.start, self.layout.angular_acceleration.start];
        let used = if self.layout.angular_acceleration.is_empty() { 2 } else { 3 };
        let rates = e * triple(self.state.as_slice(), RATE.start);
        self.state.as_mut_slice()[RATE].copy_from_slice(rates.as_slice());
        self.estimate.propagate(|column| {
            for start in &blocks[..used] {
                let turned = e * triple(column, *start);
                column[*start..start + 3].copy_from_slice(turned.as_slice());
            }
        });
    }
}

impl Health {
    /// Adds the health of a later instant.
    pub fn add(&mut self, later: &Self) {
        self.gnss.add(&later.gnss);
        self.accelerometer.add(&later.accelerometer);
        self.unusable += later.unusable;
        self.saturated += later.saturated;
    }
}

/// What an ambiguity may be before it was seen: larger than any error of the predicted range.
const UNKNOWN_AMBIGUITY_SD_M: f64 = 1e3;

#[derive(Debug, Clone, Copy, Default)]
struct SecondOrder {
    accelerometer: f64,
    range_rate: f64,
    phase: f64,
}

/// Standard deviations of the state at its start, angles and their rates still as angles.
fn initial_deviations(settings: &ArmFilterSettings, layout: &Layout, start: &Start) -> Vec<f64> {
    let mut sd = vec![0.0; layout.states()];
    sd[POSITION].fill(start.position_sd_m);
    sd[CLOCK] = start.clock_sd_m;
    sd[VELOCITY].fill(start.velocity_sd_mps);
    sd[CLOCK_RATE] = start.clock_rate_sd_mps;
    sd[ACCELERATION].fill(start.acceleration_sd_mps2);
    sd[ATTITUDE].copy_from_slice(&[start.tilt_sd_rad, start.tilt_sd_rad, start.heading_sd_rad]);
    sd[RATE].fill(start.rate_sd_radps);
    sd[layout.angular_acceleration.clone()].fill(start.angular_acceleration_sd_radps2);
    sd[layout.bias.clone()].fill(settings.bias.map_or(0.0, |drift| drift.initial_sd));
    sd[layout.arm_angle.clone()].fill(settings.arm_angle.map_or(0.0, |drift| drift.initial_sd));
    sd[layout.ambiguities.clone()].fill(UNKNOWN_AMBIGUITY_SD_M);
    sd
}
