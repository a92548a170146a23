//! From measurements to a path: points one by one, or all joined by a model of motion.

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::time::GpsTime;
use kurs::trajectory::least_squares::{NotSolved, refine};
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::outliers::{Screened, exclude_outliers};
use kurs::trajectory::problem::{Correlation, Problem};
use kurs::trajectory::smoother::{
    Model, Parameter, TimedMeasurement, Trajectory, TrajectoryPoint, smooth,
};
use kurs::trajectory::station::Station;
use nalgebra::Matrix3;

use super::config::{Config, ModelKind};
use super::input::Observation;

/// Rounds in which the effect of the air is found for the place where the object is.
const ROUNDS_IN_AIR: usize = 3;
/// Intervals whose measurements are taken together for a rough start of the smoother, s.
const START_WINDOWS_S: [f64; 4] = [1.0, 5.0, 20.0, 60.0];

/// How good a point is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Status {
    /// A point that its measurements agree on.
    Ok,
    /// Another point fits nearly as well, and there is nothing to choose by.
    Ambiguous,
    /// The residuals are larger than the standard deviations allow.
    Inconsistent,
    /// No point.
    Lost,
}

impl Status {
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Ambiguous => "ambiguous",
            Self::Inconsistent => "inconsistent",
            Self::Lost => "lost",
        }
    }
}

/// One point of the path.
#[derive(Debug, Clone)]
pub(super) struct PathPoint {
    pub(super) time: GpsTime,
    pub(super) status: Status,
    pub(super) reason: String,
    pub(super) position_m: Option<Vector<Ecef>>,
    pub(super) velocity_mps: Option<Vector<Ecef>>,
    pub(super) covariance_m2: Option<Matrix3<f64>>,
    pub(super) measurements: usize,
    pub(super) excluded: usize,
    pub(super) likelihood: Option<f64>,
}

/// What is left of one measurement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    pub(super) observation: Observation,
    pub(super) residual: f64,
    pub(super) excluded: bool,
}

/// A path with its residuals and, if asked for, the errors of the stations.
#[derive(Debug, Default)]
pub(super) struct PathFound {
    pub(super) points: Vec<PathPoint>,
    pub(super) residuals: Vec<Residual>,
    pub(super) parameters: Vec<(Parameter, [f64; 2])>,
    /// Residuals of the whole path in what the standard deviations allow, where that is too much.
    pub(super) misfit: Option<f64>,
}

/// Finds the path by the model of the configuration.
pub(super) fn find(
    config: &Config,
    stations: &[Station],
    observations: &[Observation],
) -> anyhow::Result<PathFound> {
    match config.track.model {
        ModelKind::Points => points(config, stations, observations, config.track.same_time_s),
        ModelKind::Smooth => smoothed(config, stations, observations),
    }
}

/// Every instant alone.
fn points(
    config: &Config,
    stations: &[Station],
    observations: &[Observation],
    same_time_s: f64,
) -> anyhow::Result<PathFound> {
    let first_prior = config.track.prior_m()?;
    let mut previous: Option<Vector<Ecef>> = None;
    let mut found = PathFound::default();
    for group in groups(observations, same_time_s) {
        let prior = previous.or(first_prior);
        let (point, residuals) = point_of(config, stations, group, prior);
        if matches!(point.status, Status::Ok) {
            previous = point.position_m;
        }
        found.points.push(point);
        found.residuals.extend(residuals);
    }
    Ok(found)
}

/// Runs of observations no more than `same_time_s` after the first of the run.
fn groups(observations: &[Observation], same_time_s: f64) -> impl Iterator<Item = &[Observation]> {
    let mut rest = observations;
    core::iter::from_fn(move || {
        let first = rest.first()?;
        let length = rest.partition_point(|o| o.time - first.time <= same_time_s);
        let (group, later) = rest.split_at(length);
        rest = later;
        Some(group)
    })
}

fn point_of(
    config: &Config,
    stations: &[Station],
    group: &[Observation],
    prior: Option<Vector<Ecef>>,
) -> (PathPoint, Vec<Residual>) {
    let measured: Vec<Measurement> = group.iter().map(|o| o.measurement).collect();
    let solved = solve_group(config, stations, &measured, prior);
    let lost = PathPoint {
        time: group[0].time,
        status: Status::Lost,
        reason: String::new(),
        position_m: None,
        velocity_mps: None,
        covariance_m2: None,
        measurements: group.len(),
        excluded: 0,
        likelihood: None,
    };
    let (screened, corrected) = match solved {
        Ok(solved) => solved,
        Err(reason) => return (PathPoint { reason, ..lost }, Vec::new()),
    };
    let estimate = screened.estimate;
    let rival = estimate.rival_m.is_some() && prior.is_none();
    let status = if estimate.likelihood() < config.track.outlier_probability {
        Status::Inconsistent
    } else if rival {
        Status::Ambiguous
    } else {
        Status::Ok
    };
    let predicted = |m: &Measurement| {
        m.quantity.predict(
            &stations[m.station],
            &stations[m.reference_or_station()],
            estimate.position_m,
        )
    };
    let residuals =
        group.iter().zip(&corrected).enumerate().map(|(index, (observation, m))| Residual {
            observation: *observation,
            residual: m.quantity.residual(m.value, predicted(m)),
            excluded: screened.excluded.contains(&index),
        });
    let residuals = residuals.collect();
    let point = PathPoint {
        status,
        position_m: Some(estimate.position_m),
        covariance_m2: Some(estimate.covariance_m2),
        excluded: screened.excluded.len(),
        likelihood: (estimate.degrees_of_freedom > 0).then(|| estimate.likelihood()),
        ..lost
    };
    (point, residuals)
}

/// Solves one instant; with refraction, again with the measurements corrected for the position.
fn solve_group(
    config: &Config,
    stations: &[Station],
    measured: &[Measurement],
    prior: Option<Vector<Ecef>>,
) -> Result<(Screened, Vec<Measurement>), String> {
    let rounds = if config.refraction.is_some() { ROUNDS_IN_AIR } else { 1 };
    let mut corrected = measured.to_vec();
    let mut screened = solve_once(config, stations, &corrected, prior)?;
    for _ in 1..rounds {
        let position = screened.estimate.position_m;
        corrected = measured.iter().map(|m| without_air(config, stations, m, position)).collect();
        screened = solve_once(config, stations, &corrected, Some(position))?;
    }
    Ok((screened, corrected))
}

fn solve_once(
    config: &Config,
    stations: &[Station],
    measurements: &[Measurement],
    prior: Option<Vector<Ecef>>,
) -> Result<Screened, String> {
    let correlations = correlations(measurements, config.track.range_difference_correlation);
    let problem = if correlations.is_empty() {
        Problem::new(stations, measurements)
    } else {
        Problem::correlated(stations, measurements, &correlations)
    };
    let problem = problem.map_err(|error| error.to_string())?;
    let solved = exclude_outliers(&problem, prior, config.track.outlier_probability);
    let mut screened = solved.map_err(|error: NotSolved| error.to_string())?;
    if let (Some([low, high]), Some(rival)) = (config.track.heights_m, screened.estimate.rival_m) {
        let inside = |r| (low..=high).contains(&Geodetic::from_ecef(r).height_m);
        let position = screened.estimate.position_m;
        match (inside(position), inside(rival)) {
            (true, false) => screened.estimate.rival_m = None,
            (false, true) => {
                screened.estimate = refine(&problem, rival).map_err(|error| error.to_string())?;
            }
            _ => {}
        }
    }
    Ok(screened)
}

/// Range differences to one reference share its noise.
fn correlations(measurements: &[Measurement], coefficient: f64) -> Vec<Correlation> {
    let mut correlations = Vec::new();
    if coefficient == 0.0 {
        return correlations;
    }
    for (i, first) in measurements.iter().enumerate() {
        for (j, second) in measurements.iter().enumerate().skip(i + 1) {
            let shared = matches!(first.quantity, Quantity::RangeDifference { .. })
                && first.quantity == second.quantity;
            if shared {
                correlations.push(Correlation { between: [i, j], coefficient });
            }
        }
    }
    correlations
}

fn without_air(
    config: &Config,
    stations: &[Station],
    measurement: &Measurement,
    position: Vector<Ecef>,
) -> Measurement {
    let effect = config.refraction.as_ref().map_or(0.0, |air| {
        let (station, reference) = (measurement.station, measurement.reference_or_station());
        let (station, reference) = (&stations[station], &stations[reference]);
        air.atmosphere().effect(measurement.quantity, station, reference, position)
    });
    Measurement { value: measurement.value - effect, ..*measurement }
}

/// All measurements joined by white jerk; with refraction, again with the measurements corrected for
/// the path.
fn smoothed(
    config: &Config,
    stations: &[Station],
    observations: &[Observation],
) -> anyhow::Result<PathFound> {
    let start_time = observations[0].time;
    let seconds = |time: GpsTime| time - start_time;
    let start = rough_start(config, stations, observations)?;
    let mut path: Vec<(f64, Vector<Ecef>)> =
        start.iter().map(|(time, position)| (seconds(*time), *position)).collect();
    let jerk = config.track.jerk_mps2_per_sqrt_s;
    let model = Model {
        jerk_density: jerk * jerk,
        same_time_s: config.track.same_time_s,
        outlier_probability: config.track.outlier_probability,
        parameters: config.station.iter().enumerate().flat_map(|(k, s)| s.parameters(k)).collect(),
    };
    let smooth_about = |path: &[(f64, Vector<Ecef>)]| {
        let timed = |o: &Observation| {
            let time_s = seconds(o.time);
            let measurement = without_air(config, stations, &o.measurement, nearest(path, time_s));
            TimedMeasurement { time_s, measurement }
        };
        let timed: Vec<TimedMeasurement> = observations.iter().map(timed).collect();
        smooth(stations, &timed, path, &model)
    };
    let mut trajectory = smooth_about(&path)?;
    if config.refraction.is_some() {
        for _ in 1..ROUNDS_IN_AIR {
            path = trajectory.points.iter().map(|p| (p.time_s, p.position_m)).collect();
            trajectory = smooth_about(&path)?;
        }
    }
    let points =
        trajectory.points.iter().map(|p| smoothed_point(config, start_time, p, &trajectory));
    let points = points.collect();
    let residuals = observations.iter().zip(trajectory.residuals.iter().zip(&trajectory.left_out));
    let residuals = residuals.map(|(observation, (residual, excluded))| Residual {
        observation: *observation,
        residual: *residual,
        excluded: *excluded,
    });
    let residuals = residuals.collect();
    let misfit = (!trajectory.agrees()).then(|| trajectory.misfit());
    let parameters = model.parameters.into_iter().zip(trajectory.parameters).collect();
    Ok(PathFound { points, residuals, parameters, misfit })
}

/// A point of the smoothed path, judged by its own residuals and by those of the whole.
fn smoothed_point(
    config: &Config,
    start_time: GpsTime,
    point: &TrajectoryPoint,
    trajectory: &Trajectory,
) -> PathPoint {
    let TrajectoryPoint { used, left_out, likelihood, .. } = *point;
    let likely = likelihood.is_none_or(|likelihood| likelihood >= config.track.outlier_probability);
    let (status, reason) = if used == 0 {
        (Status::Lost, format!("all {left_out} measurements of this time are left out"))
    } else if !point.is_determined() {
        (Status::Lost, "the measurements of this stretch do not determine the position".to_owned())
    } else if !trajectory.agrees() {
        let misfit = trajectory.misfit();
        let reason = format!("residuals of the whole path are {misfit:.1} times what is stated");
        (Status::Inconsistent, reason)
    } else if likely {
        (Status::Ok, String::new())
    } else {
        (Status::Inconsistent, String::new())
    };
    let found = status != Status::Lost;
    PathPoint {
        time: start_time + point.time_s,
        status,
        reason,
        position_m: found.then_some(point.position_m),
        velocity_mps: found.then_some(point.velocity_mps),
        covariance_m2: found.then(|| point.covariance.fixed_view::<3, 3>(0, 0).into_owned()),
        measurements: used + left_out,
        excluded: left_out,
        likelihood,
    }
}

/// Points found one by one, over longer and longer intervals until there are two at least.
fn rough_start(
    config: &Config,
    stations: &[Station],
    observations: &[Observation],
) -> anyhow::Result<Vec<(GpsTime, Vector<Ecef>)>> {
    for window_s in core::iter::once(config.track.same_time_s).chain(START_WINDOWS_S) {
        let found = points(config, stations, observations, window_s)?;
        let usable = |p: &PathPoint| (p.status != Status::Lost).then_some((p.time, p.position_m?));
        let start: Vec<_> = found.points.iter().filter_map(usable).collect();
        if start.len() >= 2 {
            return Ok(start);
        }
    }
    anyhow::bail!(
        "no two points can be found to start from, not even with a minute of measurements each"
    )
}

fn nearest(path: &[(f64, Vector<Ecef>)], time_s: f64) -> Vector<Ecef> {
    let after = path.partition_point(|(time, _)| *time < time_s).min(path.len() - 1);
    path[after].1
}
