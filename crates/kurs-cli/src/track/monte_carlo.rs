//! `--monte-carlo`: standard deviations three ways along the simulated path, for each set of
//! measurements, as in figure 4 of the paper; and the deviations of one draw by three methods, as
//! in its table.

use std::fmt::Write as _;
use std::path::Path;

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::accuracy::{
    Scatter, draw_errors, error_free, linearised_covariance, stochastic_model,
};
use kurs::trajectory::closed_form::Preference;
use kurs::trajectory::least_squares::{Estimate, refine};
use kurs::trajectory::measurement::Measurement;
use kurs::trajectory::minimal_set::MinimalSet;
use kurs::trajectory::problem::Problem;
use kurs::trajectory::random_search::{SearchSettings, random_search};
use kurs::trajectory::station::Station;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::config::{Config, SetConfig};
use super::simulate::{TruePoint, blank, normals};
use crate::failure::UsageError;
use crate::table::{Table, TableFormat};

/// Draws of one random stream: the result does not depend on the number of threads.
const DRAWS_PER_STREAM: usize = 4096;

/// Standard deviations of one set at one point, along the axes of the common frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparison {
    pub(super) time_s: f64,
    pub(super) height_m: f64,
    pub(super) information_m: Vector3<f64>,
    pub(super) linearised_m: Option<Vector3<f64>>,
    pub(super) scatter: Scatter,
    pub(super) disagrees: bool,
}

/// All points of one set.
#[derive(Debug)]
pub(super) struct SetComparison {
    pub(super) name: String,
    pub(super) points: Vec<Comparison>,
}

/// Compares every set at every point.
pub(super) fn run(
    config: &Config,
    sets: &[SetConfig],
    stations: &[Station],
    truth: &[TruePoint],
    draws: usize,
    seed: u64,
) -> anyhow::Result<Vec<SetComparison>> {
    let compare = |(number, set): (usize, &SetConfig)| {
        let blank = blank(config, &set.measure)?;
        let mut points = Vec::new();
        for (k, point) in truth.iter().enumerate() {
            let stream = (number * truth.len() + k) as u64;
            points.extend(compare_at(stations, &blank, point, draws, (seed, stream)));
        }
        if points.is_empty() {
            let what = format!("simulate.set `{}`: no closed form or no solution", set.name);
            return Err(UsageError(what).into());
        }
        Ok(SetComparison { name: set.name.clone(), points })
    };
    sets.iter().enumerate().map(compare).collect()
}

fn compare_at(
    stations: &[Station],
    blank: &[Measurement],
    point: &TruePoint,
    draws: usize,
    (seed, stream): (u64, u64),
) -> Option<Comparison> {
    let calculated = error_free(&Problem::new(stations, blank).ok()?, point.position_m);
    let problem = Problem::new(stations, &calculated).ok()?;
    let set = MinimalSet::find(&problem).next()?;
    let estimate = refine(&problem, point.position_m).ok()?;
    let streams = draws.div_ceil(DRAWS_PER_STREAM);
    let parts: Vec<Scatter> = (0..streams)
        .into_par_iter()
        .map(|part| {
            let count = DRAWS_PER_STREAM.min(draws - part * DRAWS_PER_STREAM);
            let mut normal = normals(seed, stream * 1_000_003 + part as u64 + 1);
            stochastic_model(&set, &problem, point.position_m, count, &mut normal)
        })
        .collect();
    let scatter = parts.into_iter().fold(Scatter::default(), Scatter::merge);
    let linearised = linearised_covariance(&set, &problem, point.position_m);
    Some(Comparison {
        time_s: point.time_s,
        height_m: Geodetic::from_ecef(point.position_m).height_m,
        information_m: estimate.covariance_m2.diagonal().map(f64::sqrt),
        linearised_m: linearised.map(|k| k.diagonal().map(f64::sqrt)),
        scatter,
        disagrees: scatter.disagrees_with(&estimate.covariance_m2),
    })
}

const COLUMNS: &[&str] = &[
    "set",
    "time_s",
    "height_m",
    "draws",
    "refused",
    "lsq_sd_x_m",
    "lsq_sd_y_m",
    "lsq_sd_z_m",
    "linear_sd_x_m",
    "linear_sd_y_m",
    "linear_sd_z_m",
    "model_sd_x_m",
    "model_sd_y_m",
    "model_sd_z_m",
    "model_low_factor",
    "model_high_factor",
    "bias_m",
    "disagrees",
];

/// Writes `monte_carlo.csv` and tells the points at the ends and in the middle of each set.
pub(super) fn report(
    comparisons: &[SetComparison],
    out: &Path,
    told: &mut String,
) -> anyhow::Result<()> {
    let mut table = Table::create(out, "monte_carlo", TableFormat::Csv, COLUMNS)?;
    writeln!(
        told,
        "standard deviations in ECEF x, y, z, m: least squares (2) | linearised (4) | modelled (5)-(6)"
    )?;
    for SetComparison { name, points } in comparisons {
        for point in points {
            table.text(name);
            table.real(Some(point.time_s), 3);
            table.real(Some(point.height_m), 3);
            table.integer(i64::try_from(point.scatter.count).unwrap_or(i64::MAX));
            table.integer(i64::try_from(point.scatter.refused).unwrap_or(i64::MAX));
            for axis in 0..3 {
                table.real(Some(point.information_m[axis]), 4);
            }
            for axis in 0..3 {
                table.real(point.linearised_m.map(|s| s[axis]), 4);
            }
            for axis in 0..3 {
                table.real(Some(point.scatter.sigmas_m()[axis]), 4);
            }
            let [low, high] = point.scatter.interval(1.96);
            table.real(Some(low), 5);
            table.real(Some(high), 5);
            table.real(Some(point.scatter.bias_m().norm()), 4);
            table.text(if point.disagrees { "yes" } else { "no" });
            table.end_row()?;
        }
        for index in [0, points.len() / 2, points.len() - 1] {
            writeln!(told, "{}", point_text(name, &points[index]))?;
        }
        writeln!(told, "{}", worst_text(name, points))?;
    }
    table.finish()
}

fn point_text(name: &str, point: &Comparison) -> String {
    let triple = |s: Vector3<f64>| format!("({:.1}, {:.1}, {:.1})", s.x, s.y, s.z);
    format!(
        "{name:>4} {:5.1} km  {} | {} | {}{}",
        point.height_m / 1e3,
        triple(point.information_m),
        point.linearised_m.map_or_else(|| "-".to_owned(), triple),
        (point.scatter.count > 0)
            .then(|| point.scatter.sigmas_m())
            .map_or_else(|| "-".to_owned(), triple),
        if point.disagrees { "  (2) does not describe this closed form" } else { "" }
    )
}

/// The worst ratio of modelled to expected standard deviation over all points and axes.
fn worst_text(name: &str, points: &[Comparison]) -> String {
    let worst = |expected: &dyn Fn(&Comparison) -> Option<Vector3<f64>>| {
        let ratios = points.iter().filter_map(|point| {
            let ratio = point.scatter.sigmas_m().component_div(&expected(point)?);
            Some(ratio.map(|r| (r - 1.0).abs()).max())
        });
        let worst = ratios.filter(|ratio| ratio.is_finite()).reduce(f64::max);
        worst.map_or_else(|| "-".to_owned(), |worst| format!("{:.1} %", 100.0 * worst))
    };
    let refused: usize = points.iter().map(|point| point.scatter.refused).sum();
    let [low, high] = points[0].scatter.interval(1.96);
    let interval = if high.is_finite() {
        format!("{:+.1} to {:+.1} %", 100.0 * (low - 1.0), 100.0 * (high - 1.0))
    } else {
        "unknown: too few draws".to_owned()
    };
    format!(
        "{name:>4} worst of {} points x 3 axes: modelled against (2) {}, against (4) {} \
         (95 % interval of one {interval}), refused {refused}",
        points.len(),
        worst(&|point| Some(point.information_m)),
        worst(&|point| point.linearised_m),
    )
}

const DEVIATION_COLUMNS: &[&str] =
    &["set", "method", "time_s", "height_m", "dx_m", "dy_m", "dz_m", "cost", "evaluations"];

/// One draw at both ends of the path: closed form, least squares and random search, as in the table
/// of the paper. Writes `deviations.csv`.
pub(super) fn deviations(
    config: &Config,
    sets: &[SetConfig],
    stations: &[Station],
    truth: &[TruePoint],
    seed: u64,
    out: &Path,
) -> anyhow::Result<()> {
    let mut table = Table::create(out, "deviations", TableFormat::Csv, DEVIATION_COLUMNS)?;
    for point in [&truth[0], &truth[truth.len() - 1]] {
        for set in sets {
            let blank = blank(config, &set.measure)?;
            let calculated = error_free(&Problem::new(stations, &blank)?, point.position_m);
            let mut drawn = calculated.clone();
            let problem = Problem::new(stations, &calculated)?;
            draw_errors(&problem, &calculated, &mut drawn, &mut normals(seed, 0));
            let noisy = Problem::new(stations, &drawn)?;
            let Some(closed_form) = closed_form(&noisy, point.position_m) else { continue };
            let Ok(least_squares) = refine(&noisy, closed_form) else { continue };
            let search = search_from_afar(&noisy, point.position_m, seed);
            let Estimate { position_m, cost, iterations, .. } = least_squares;
            for (method, found_m, cost, evaluations) in [
                ("closed form", closed_form, None, 1),
                ("least squares", position_m, Some(cost), iterations),
                ("random search", search.position_m, Some(search.cost), search.evaluations),
            ] {
                let deviation = (found_m - point.position_m).xyz();
                table.text(&set.name);
                table.text(method);
                table.real(Some(point.time_s), 3);
                table.real(Some(Geodetic::from_ecef(point.position_m).height_m), 3);
                for axis in 0..3 {
                    table.real(Some(deviation[axis]), 3);
                }
                table.real(cost, 6);
                table.integer(i64::try_from(evaluations).unwrap_or(i64::MAX));
                table.end_row()?;
            }
        }
    }
    table.finish()
}

fn closed_form(problem: &Problem, prior: Vector<Ecef>) -> Option<Vector<Ecef>> {
    let roots = MinimalSet::find(problem).next()?.roots(problem).ok()?;
    roots.choose(&Preference::Prior(prior)).ok().map(|choice| choice.position_m)
}

fn search_from_afar(
    problem: &Problem,
    truth_m: Vector<Ecef>,
    seed: u64,
) -> kurs::trajectory::random_search::Found {
    let settings = SearchSettings { first_step_m: 1e3, last_step_m: 1e-4, evaluations: 20_000 };
    let start_m = truth_m + Vector::new(3e3, -4e3, 2e3);
    random_search(problem, start_m, &settings, &mut normals(seed, 1))
}
