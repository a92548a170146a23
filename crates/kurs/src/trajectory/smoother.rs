//! Whole trajectories: measurements of different stations at different times, joined by a model of
//! motion, with station clocks, delays and pointing as further unknowns.
//!
//! The motion is a third integral of white noise (white jerk) on each axis. The most likely
//! trajectory is found by Gauss–Newton over all of it: each step is a Kalman filter forward and a
//! Rauch–Tung–Striebel pass back, with the measurements linearised about the trajectory of the step
//! before. Constants of the stations are states without noise.
//!
//! After a pause in which the motion is forgotten a new stretch begins: it has the constants of the
//! stations in common with the one before, and nothing else.

mod screening;

use core::ops::Range;

use nalgebra::{DMatrix, DVector, SMatrix, Vector3};

use super::measurement::{Measurement, Quantity};
use super::problem::{BadProblem, Problem};
use super::station::Station;
use crate::frames::{Ecef, Vector};

const POSITION: Range<usize> = 0..3;
const VELOCITY: Range<usize> = 3..6;
const ACCELERATION: Range<usize> = 6..9;
const MOTION: usize = 9;

const MAX_ITERATIONS: usize = 30;
/// The iteration ends when no position moves by more than this share of its standard deviation.
const CONVERGED: f64 = 1e-3;
/// Before any measurement: standard deviations about the start, wide enough not to matter.
const FIRST_SIGMAS: [f64; 3] = [1e5, 5e3, 5e2];
/// Standard deviations of measurements are stated to no better than a quarter.
const STATED_TO: f64 = 1.25;

/// A measurement with its time tag, seconds after an origin of the caller's choice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedMeasurement {
    /// Time tag of the station's clock.
    pub time_s: f64,
    /// What was measured.
    pub measurement: Measurement,
}

/// A constant of a station that is estimated with the trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Index of the station.
    pub station: usize,
    /// What is constant.
    pub kind: ParameterKind,
    /// Standard deviation expected beforehand, about zero, in the unit of the kind.
    pub sigma: f64,
}

/// What a station may have wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterKind {
    /// Time tag minus true time, s.
    ClockOffset,
    /// Measured minus true azimuth, rad.
    AzimuthBias,
    /// Measured minus true elevation, rad.
    ElevationBias,
    /// Measured minus true range, m: delays, or the clock of a one-way range.
    RangeBias,
}

/// The model of motion and of the measurements, and the unknowns of the stations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Model {
    /// Spectral density of the white jerk, m²/s⁵: the square of the change of acceleration (m/s²)
    /// to be expected in one second.
    pub jerk_density: f64,
    /// Measurements no later than this after the first of them make one point.
    pub same_time_s: f64,
    /// Measurements of a point are left out while residuals as large as theirs are less likely than
    /// this; 0 keeps all.
    pub outlier_probability: f64,
    /// Unknown constants of stations.
    pub parameters: Vec<Parameter>,
}

/// One point of the trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint {
    /// Seconds after the origin.
    pub time_s: f64,
    /// Position, m.
    pub position_m: Vector<Ecef>,
    /// Velocity, m/s.
    pub velocity_mps: Vector<Ecef>,
    /// Acceleration, m/s².
    pub acceleration_mps2: Vector<Ecef>,
    /// Covariance of position, velocity and acceleration in that order.
    pub covariance: SMatrix<f64, 9, 9>,
    /// How many measurements of this time were used.
    pub used: usize,
    /// How many were left out.
    pub left_out: usize,
    /// Probability of residuals at least as large as those used here, if the standard deviations are
    /// right; `None` if no other measurement checks them.
    pub likelihood: Option<f64>,
}

impl TrajectoryPoint {
    /// Whether the measurements say more of the position than was known before any of them.
    #[must_use]
    pub fn is_determined(&self) -> bool {
        let variance = self.covariance.fixed_view::<3, 3>(0, 0).diagonal().max();
        variance.sqrt() < 0.5 * FIRST_SIGMAS[0]
    }
}

/// A trajectory and all that was found with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// One point for every distinct time, in order.
    pub points: Vec<TrajectoryPoint>,
    /// Value and standard deviation of each parameter of the model.
    pub parameters: Vec<[f64; 2]>,
    /// Measured minus calculated, in the order of the measurements given, in their units.
    pub residuals: Vec<f64>,
    /// Whether a measurement was left out, in the order of the measurements given.
    pub left_out: Vec<bool>,
    /// Sum of the squared normalised innovations of the last filter pass: χ² with
    /// `degrees_of_freedom`.
    pub innovation_cost: f64,
    /// Measurements used, less the nine unknowns of the start of each stretch.
    pub degrees_of_freedom: usize,
    /// Gauss–Newton steps.
    pub iterations: usize,
}

impl Trajectory {
    /// The innovations in their standard deviations, root mean square: 1 if these are right.
    #[must_use]
    pub fn misfit(&self) -> f64 {
        (self.innovation_cost / self.degrees_of_freedom.max(1) as f64).sqrt()
    }

    /// Whether the whole agrees with standard deviations that are stated to a quarter.
    #[must_use]
    pub fn agrees(&self) -> bool {
        // χ² / n has the variance 2 / n; three standard deviations are allowed.
        let chance = 1.0 + 3.0 * (2.0 / self.degrees_of_freedom.max(1) as f64).sqrt();
        self.misfit().powi(2) <= STATED_TO * STATED_TO * chance
    }
}

/// Why there is no trajectory.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NotSmoothed {
    /// No measurement, or no position to start from.
    #[error("no measurements or no start")]
    Empty,
    /// A time that is not finite.
    #[error("measurement {measurement}: time {time_s} is not a finite number")]
    BadTime {
        /// Index of the measurement.
        measurement: usize,
        /// What was found.
        time_s: f64,
    },
    /// A parameter of an unknown station or without a positive standard deviation, or a jerk
    /// density that is not positive.
    #[error("a parameter of the model is unusable")]
    BadModel,
    /// A measurement is unusable.
    #[error(transparent)]
    BadMeasurement(#[from] BadProblem),
    /// A covariance lost its positive definiteness, or a number became infinite.
    #[error("the trajectory is not determined by the measurements")]
    Singular,
    /// The iteration did not settle.
    #[error("no convergence in {MAX_ITERATIONS} iterations")]
    NotConverged,
}

/// The most likely trajectory.
///
/// `start` holds rough positions by time (in order), for example points found one by one; between
/// them it is interpolated. Correlations of measurements are not used here.
///
/// # Errors
///
/// [`NotSmoothed`].
pub fn smooth(
    stations: &[Station],
    measurements: &[TimedMeasurement],
    start: &[(f64, Vector<Ecef>)],
    model: &Model,
) -> Result<Trajectory, NotSmoothed> {
    check(stations, measurements, start, model)?;
    let nodes = nodes(measurements, model.same_time_s);
    let left_out = vec![false; measurements.len()];
    let mut smoother = Smoother { stations, measurements, model, nodes, left_out };
    let start = smoother.first_states(start);
    let fit = match model.outlier_probability > 0.0 {
        true => smoother.fit_without_outliers(start)?,
        false => smoother.fit(start)?,
    };
    Ok(smoother.trajectory(&fit))
}

/// Measurements of one time.
struct Node {
    time_s: f64,
    members: Vec<usize>,
}

struct Smoother<'a> {
    stations: &'a [Station],
    measurements: &'a [TimedMeasurement],
    model: &'a Model,
    nodes: Vec<Node>,
    /// By measurement.
    left_out: Vec<bool>,
}

/// State (motion, then parameters) with covariance.
#[derive(Clone)]
struct StateEstimate {
    state: DVector<f64>,
    covariance: DMatrix<f64>,
}

/// The estimates of a Gauss–Newton iteration that has settled.
struct Fit {
    smoothed: Vec<StateEstimate>,
    innovation_cost: f64,
    iterations: usize,
}

impl Fit {
    fn states(&self) -> Vec<DVector<f64>> {
        self.smoothed.iter().map(|estimate| estimate.state.clone()).collect()
    }
}

/// One node of the forward pass: before and after its measurements.
struct FilterStep {
    predicted: StateEstimate,
    updated: StateEstimate,
    innovation_cost: f64,
}

impl Smoother<'_> {
    fn size(&self) -> usize {
        MOTION + self.model.parameters.len()
    }

    /// Positions and velocities from the start, all else zero.
    fn first_states(&self, start: &[(f64, Vector<Ecef>)]) -> Vec<DVector<f64>> {
        let state = |node: &Node| {
            let (position, velocity) = interpolate(start, node.time_s);
            let mut state = DVector::zeros(self.size());
            state.rows_range_mut(POSITION).copy_from(&position.xyz());
            state.rows_range_mut(VELOCITY).copy_from(&velocity);
            state
        };
        self.nodes.iter().map(state).collect()
    }

    /// Gauss–Newton over the whole from these states, without what is left out.
    fn fit(&self, mut states: Vec<DVector<f64>>) -> Result<Fit, NotSmoothed> {
        for iterations in 1..=MAX_ITERATIONS {
            let filtered = self.filter(&states)?;
            let smoothed = self.smooth_back(&filtered)?;
            let moved = largest_move(&states, &smoothed);
            if moved < CONVERGED {
                let innovation_cost = filtered.iter().map(|step| step.innovation_cost).sum();
                return Ok(Fit { smoothed, innovation_cost, iterations });
            }
            states = smoothed.into_iter().map(|estimate| estimate.state).collect();
        }
        Err(NotSmoothed::NotConverged)
    }

    /// Kalman filter, the measurements linearised about `reference`.
    fn filter(&self, reference: &[DVector<f64>]) -> Result<Vec<FilterStep>, NotSmoothed> {
        let mut steps: Vec<FilterStep> = Vec::with_capacity(self.nodes.len());
        for k in 0..self.nodes.len() {
            let last = steps.last().map(|step| &step.updated);
            let predicted = self.before_node(k, last, &reference[k]);
            let (updated, innovation_cost) =
                self.after_node(k, &predicted, &reference[k], &self.left_out);
            if !updated.state.iter().all(|value| value.is_finite()) {
                return Err(NotSmoothed::Singular);
            }
            steps.push(FilterStep { predicted, updated, innovation_cost });
        }
        Ok(steps)
    }

    /// What is known before the measurements of a node, from all that were before.
    fn before_node(
        &self,
        k: usize,
        last: Option<&StateEstimate>,
        reference: &DVector<f64>,
    ) -> StateEstimate {
        let Some(last) = last else { return self.before_all(reference) };
        if !self.begins_stretch(k) {
            return self.predict(last, self.nodes[k].time_s - self.nodes[k - 1].time_s);
        }
        let mut fresh = self.before_all(reference);
        let constants = MOTION..self.size();
        fresh
            .state
            .rows_range_mut(constants.clone())
            .copy_from(&last.state.rows_range(constants.clone()));
        fresh
            .covariance
            .view_range_mut(constants.clone(), constants.clone())
            .copy_from(&last.covariance.view_range(constants.clone(), constants));
        fresh
    }

    /// That with the measurements of the node, and their normalised innovations squared.
    fn after_node(
        &self,
        k: usize,
        predicted: &StateEstimate,
        reference: &DVector<f64>,
        left_out: &[bool],
    ) -> (StateEstimate, f64) {
        let mut updated = predicted.clone();
        let used = self.nodes[k].members.iter().filter(|index| !left_out[**index]);
        let cost = used.map(|index| self.update(&mut updated, k, *index, reference)).sum();
        (updated, cost)
    }

    /// Whether white jerk has made the position at this node as uncertain as before any measurement:
    /// q T⁵/20 ≥ σ².
    fn begins_stretch(&self, k: usize) -> bool {
        k == 0 || {
            let interval_s = self.nodes[k].time_s - self.nodes[k - 1].time_s;
            white_jerk(interval_s, self.model.jerk_density)[0][0] >= FIRST_SIGMAS[0].powi(2)
        }
    }

    fn before_all(&self, reference: &DVector<f64>) -> StateEstimate {
        let [position, velocity, acceleration] = FIRST_SIGMAS.map(|sigma| sigma * sigma);
        let mut variances = DVector::zeros(self.size());
        variances.rows_range_mut(POSITION).fill(position);
        variances.rows_range_mut(VELOCITY).fill(velocity);
        variances.rows_range_mut(ACCELERATION).fill(acceleration);
        let mut state = reference.clone();
        for (k, parameter) in self.model.parameters.iter().enumerate() {
            variances[MOTION + k] = parameter.sigma * parameter.sigma;
            state[MOTION + k] = 0.0;
        }
        StateEstimate { state, covariance: DMatrix::from_diagonal(&variances) }
    }

    /// x⁻ = Φ x, P⁻ = Φ P Φᵀ + Q
    fn predict(&self, before: &StateEstimate, interval_s: f64) -> StateEstimate {
        let transition = self.transition(interval_s);
        let mut covariance = &transition * &before.covariance * transition.transpose();
        let noise = white_jerk(interval_s, self.model.jerk_density);
        for i in 0..3 {
            for j in 0..3 {
                for axis in 0..3 {
                    covariance[(3 * i + axis, 3 * j + axis)] += noise[i][j];
                }
            }
        }
        StateEstimate { state: &transition * &before.state, covariance }
    }

    fn transition(&self, interval_s: f64) -> DMatrix<f64> {
        let mut transition = DMatrix::identity(self.size(), self.size());
        for axis in 0..3 {
            transition[(POSITION.start + axis, VELOCITY.start + axis)] = interval_s;
            transition[(VELOCITY.start + axis, ACCELERATION.start + axis)] = interval_s;
            transition[(POSITION.start + axis, ACCELERATION.start + axis)] =
                0.5 * interval_s * interval_s;
        }
        transition
    }

    /// One measurement; returns its normalised innovation squared.
    fn update(
        &self,
        estimate: &mut StateEstimate,
        node: usize,
        index: usize,
        reference: &DVector<f64>,
    ) -> f64 {
        let (residual, row) = self.linearise(node, index, reference);
        let sigma = self.measurements[index].measurement.sigma;
        // ν = y − h(x̄) − H (x − x̄),  S = H P Hᵀ + σ²
        let innovation = residual - row.dot(&(&estimate.state - reference));
        let gain_direction = &estimate.covariance * &row;
        let variance = row.dot(&gain_direction) + sigma * sigma;
        let gain = &gain_direction / variance;
        estimate.state += &gain * innovation;
        // Joseph's form: (I − K H) P (I − K H)ᵀ + K σ² Kᵀ
        let size = self.size();
        let reduction = DMatrix::identity(size, size) - &gain * row.transpose();
        estimate.covariance = &reduction * &estimate.covariance * reduction.transpose()
            + &gain * gain.transpose() * (sigma * sigma);
        innovation * innovation / variance
    }

    /// Measured minus calculated at the state of a node, and the derivative of the calculated number.
    fn linearise(&self, node: usize, index: usize, state: &DVector<f64>) -> (f64, DVector<f64>) {
        let Measurement { station, quantity, value, .. } = self.measurements[index].measurement;
        let reference = self.measurements[index].measurement.reference_or_station();
        let clock = self.parameter(state, station, ParameterKind::ClockOffset);
        let after_node_s = self.measurements[index].time_s - self.nodes[node].time_s;
        let late_s = clock.map_or(0.0, |(value, _)| value) - after_node_s;
        // The object where it was when the station's clock showed the tag: r(t − δ)
        let motion = Motion::of(state);
        let (calculated, gradient) = quantity.linearise(
            &self.stations[station],
            &self.stations[reference],
            Vector::from_xyz(motion.position_after(-late_s)),
        );

        let mut row = DVector::zeros(self.size());
        row.rows_range_mut(POSITION).copy_from(&gradient);
        row.rows_range_mut(VELOCITY).copy_from(&(gradient * -late_s));
        row.rows_range_mut(ACCELERATION).copy_from(&(gradient * (0.5 * late_s * late_s)));
        if let Some((_, column)) = clock {
            row[column] = -gradient.dot(&(motion.velocity - motion.acceleration * late_s));
        }
        let mut bias = 0.0;
        for (station, kind, sign) in biases(quantity, station) {
            if let Some((value, column)) = self.parameter(state, station, kind) {
                bias += sign * value;
                row[column] += sign;
            }
        }
        (quantity.residual(value, calculated + bias), row)
    }

    /// Value and column of a parameter, if it is estimated.
    fn parameter(
        &self,
        state: &DVector<f64>,
        station: usize,
        kind: ParameterKind,
    ) -> Option<(f64, usize)> {
        let mut parameters = self.model.parameters.iter();
        let position = parameters.position(|p| p.station == station && p.kind == kind)?;
        Some((state[MOTION + position], MOTION + position))
    }

    /// Rauch–Tung–Striebel: from the last node back.
    fn smooth_back(&self, steps: &[FilterStep]) -> Result<Vec<StateEstimate>, NotSmoothed> {
        let mut smoothed: Vec<StateEstimate> = Vec::with_capacity(steps.len());
        for k in (0..steps.len()).rev() {
            let now = &steps[k].updated;
            let Some(later) = smoothed.last() else {
                smoothed.push(now.clone());
                continue;
            };
            let predicted = &steps[k + 1].predicted;
            let mut transition = self.transition(self.nodes[k + 1].time_s - self.nodes[k].time_s);
            if self.begins_stretch(k + 1) {
                transition.view_range_mut(0..MOTION, 0..MOTION).fill(0.0);
            }
            // C = P Φᵀ (P⁻)⁻¹;  xˢ = x + C (xˢ₊ − x⁻);  Pˢ = P + C (Pˢ₊ − P⁻) Cᵀ
            let inverse = scaled_inverse(&predicted.covariance).ok_or(NotSmoothed::Singular)?;
            let gain = &now.covariance * transition.transpose() * inverse;
            let state = &now.state + &gain * (&later.state - &predicted.state);
            let difference = &later.covariance - &predicted.covariance;
            let covariance = &now.covariance + &gain * difference * gain.transpose();
            smoothed.push(StateEstimate { state, covariance });
        }
        smoothed.reverse();
        Ok(smoothed)
    }

    fn trajectory(&self, fit: &Fit) -> Trajectory {
        let Fit { smoothed, innovation_cost, iterations } = fit;
        let point = |(k, estimate): (usize, &StateEstimate)| {
            let part = |rows: Range<usize>| {
                Vector::from_xyz(Vector3::from_fn(|axis, _| estimate.state[rows.start + axis]))
            };
            let Node { time_s, members } = &self.nodes[k];
            let left_out = members.iter().filter(|index| self.left_out[**index]).count();
            TrajectoryPoint {
                time_s: *time_s,
                position_m: part(POSITION),
                velocity_mps: part(VELOCITY),
                acceleration_mps2: part(ACCELERATION),
                covariance: estimate.covariance.fixed_view::<MOTION, MOTION>(0, 0).into_owned(),
                used: members.len() - left_out,
                left_out,
                likelihood: self.likelihood(k, estimate),
            }
        };
        let mut residuals = vec![0.0; self.measurements.len()];
        for (k, estimate) in smoothed.iter().enumerate() {
            for &index in &self.nodes[k].members {
                residuals[index] = self.linearise(k, index, &estimate.state).0;
            }
        }
        let last = smoothed.last();
        let parameter = |column: usize| {
            last.map_or([0.0; 2], |e| [e.state[column], e.covariance[(column, column)].sqrt()])
        };
        let used = self.left_out.iter().filter(|left_out| !**left_out).count();
        let stretches = (0..self.nodes.len()).filter(|k| self.begins_stretch(*k)).count();
        Trajectory {
            points: smoothed.iter().enumerate().map(point).collect(),
            parameters: (MOTION..self.size()).map(parameter).collect(),
            residuals,
            left_out: self.left_out.clone(),
            innovation_cost: *innovation_cost,
            degrees_of_freedom: used.saturating_sub(MOTION * stretches),
            iterations: *iterations,
        }
    }
}

/// The first nine states as vectors.
struct Motion {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl Motion {
    fn of(state: &DVector<f64>) -> Self {
        let part = |rows: Range<usize>| Vector3::from_fn(|axis, _| state[rows.start + axis]);
        Self {
            position: part(POSITION),
            velocity: part(VELOCITY),
            acceleration: part(ACCELERATION),
        }
    }

    fn position_after(&self, seconds: f64) -> Vector3<f64> {
        self.position + self.velocity * seconds + self.acceleration * (0.5 * seconds * seconds)
    }
}

/// Which biases of which stations enter a quantity, and with which sign.
fn biases(quantity: Quantity, station: usize) -> impl Iterator<Item = (usize, ParameterKind, f64)> {
    let own = match quantity {
        Quantity::Azimuth => Some(ParameterKind::AzimuthBias),
        Quantity::Elevation => Some(ParameterKind::ElevationBias),
        Quantity::Range | Quantity::RangeDifference { .. } => Some(ParameterKind::RangeBias),
        Quantity::CosineNorth | Quantity::CosineEast => None,
    };
    let other = match quantity {
        Quantity::RangeDifference { reference } => {
            Some((reference, ParameterKind::RangeBias, -1.0))
        }
        _ => None,
    };
    own.map(|kind| (station, kind, 1.0)).into_iter().chain(other)
}

/// Covariance that white jerk of density q adds in an interval, per axis:
/// q [[T⁵/20, T⁴/8, T³/6], [T⁴/8, T³/3, T²/2], [T³/6, T²/2, T]].
fn white_jerk(interval_s: f64, density: f64) -> [[f64; 3]; 3] {
    let t = interval_s;
    let (t2, t3, t4, t5) = (t * t, t.powi(3), t.powi(4), t.powi(5));
    [[t5 / 20.0, t4 / 8.0, t3 / 6.0], [t4 / 8.0, t3 / 3.0, t2 / 2.0], [t3 / 6.0, t2 / 2.0, t]]
        .map(|row| row.map(|value| density * value))
}

/// Inverse of a covariance whose states have very different units.
fn scaled_inverse(covariance: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = covariance.diagonal().map(|variance| 1.0 / variance.sqrt());
    let both = &scale * scale.transpose();
    let correlation = covariance.component_mul(&both);
    Some(correlation.cholesky()?.inverse().component_mul(&both))
}

/// The largest change of a position, in its standard deviations.
fn largest_move(before: &[DVector<f64>], after: &[StateEstimate]) -> f64 {
    let moves = before.iter().zip(after).flat_map(|(old, new)| {
        (0..old.len())
            .map(move |row| (new.state[row] - old[row]).abs() / new.covariance[(row, row)].sqrt())
    });
    moves.fold(0.0, |largest: f64, one| if one.is_nan() { f64::INFINITY } else { largest.max(one) })
}

/// Measurements by time, in order: those within `same_time_s` of the first are one node.
fn nodes(measurements: &[TimedMeasurement], same_time_s: f64) -> Vec<Node> {
    let mut order: Vec<usize> = (0..measurements.len()).collect();
    order.sort_by(|a, b| measurements[*a].time_s.total_cmp(&measurements[*b].time_s));
    let mut nodes: Vec<Node> = Vec::new();
    for index in order {
        let time_s = measurements[index].time_s;
        match nodes.last_mut() {
            Some(node) if time_s - node.time_s <= same_time_s => node.members.push(index),
            _ => nodes.push(Node { time_s, members: vec![index] }),
        }
    }
    nodes
}

/// Position at a time on the straight lines through the start positions, and the slope there.
fn interpolate(start: &[(f64, Vector<Ecef>)], time_s: f64) -> (Vector<Ecef>, Vector3<f64>) {
    let after = start.partition_point(|(time, _)| *time <= time_s).clamp(1, start.len() - 1);
    let ((time_0, position_0), (time_1, position_1)) = (start[after - 1], start[after]);
    let slope = (position_1 - position_0) * (1.0 / (time_1 - time_0));
    (position_0 + slope * (time_s - time_0), slope.xyz())
}

fn check(
    stations: &[Station],
    measurements: &[TimedMeasurement],
    start: &[(f64, Vector<Ecef>)],
    model: &Model,
) -> Result<(), NotSmoothed> {
    let increasing = start.windows(2).all(|pair| pair[0].0 < pair[1].0);
    if measurements.is_empty() || start.len() < 2 || !increasing {
        return Err(NotSmoothed::Empty);
    }
    let bad_time = measurements.iter().position(|m| !m.time_s.is_finite());
    if let Some(measurement) = bad_time {
        return Err(NotSmoothed::BadTime { measurement, time_s: measurements[measurement].time_s });
    }
    let bare: Vec<Measurement> = measurements.iter().map(|timed| timed.measurement).collect();
    Problem::new(stations, &bare)?;
    let usable = |p: &Parameter| p.station < stations.len() && p.sigma.is_finite() && p.sigma > 0.0;
    let density = model.jerk_density;
    if density.is_finite() && density > 0.0 && model.parameters.iter().all(usable) {
        Ok(())
    } else {
        Err(NotSmoothed::BadModel)
    }
}
