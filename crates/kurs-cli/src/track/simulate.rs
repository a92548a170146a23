//! Measurements of a path that is known: for planning, teaching and tests.

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::time::GpsTime;
use kurs::trajectory::accuracy::{draw_errors, error_free};
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::problem::Problem;
use kurs::trajectory::station::Station;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

use super::config::{Config, SimulateConfig};
use super::input::Observation;
use crate::failure::UsageError;

/// A point of the simulated path.
#[derive(Debug, Clone, Copy)]
pub(super) struct TruePoint {
    pub(super) time: GpsTime,
    pub(super) time_s: f64,
    pub(super) position_m: Vector<Ecef>,
}

/// Standard normal numbers from a seed and the number of a stream.
pub(super) fn normals(seed: u64, stream: u64) -> impl FnMut() -> f64 {
    // Two mixes of the generator's own seeding keep neighbouring streams apart.
    let mixed = seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut generator = Xoshiro256PlusPlus::seed_from_u64(mixed);
    move || StandardNormal.sample(&mut generator)
}

/// The path through the waypoints, at equal intervals.
pub(super) fn truth(
    config: &Config,
    simulate: &SimulateConfig,
) -> Result<Vec<TruePoint>, UsageError> {
    let waypoints = &simulate.waypoint;
    let (first_s, last_s) = (waypoints[0].time_s, waypoints[waypoints.len() - 1].time_s);
    let mut points = Vec::new();
    for step in 0_u32.. {
        let time_s = first_s + f64::from(step) * simulate.interval_s;
        if time_s > last_s + 1e-9 * simulate.interval_s {
            break;
        }
        let later = waypoints.partition_point(|w| w.time_s <= time_s).clamp(1, waypoints.len() - 1);
        let (from, to) = (&waypoints[later - 1], &waypoints[later]);
        let share = (time_s - from.time_s) / (to.time_s - from.time_s);
        let between = |a: f64, b: f64| a + (b - a) * share;
        // The short way round, across the date line too.
        let eastward_deg =
            180.0 - (180.0 - (to.longitude_deg - from.longitude_deg)).rem_euclid(360.0);
        let place = Geodetic::from_degrees(
            between(from.latitude_deg, to.latitude_deg),
            from.longitude_deg + eastward_deg * share,
            between(from.height_m, to.height_m),
        );
        points.push(TruePoint {
            time: config.track.instant(time_s)?,
            time_s,
            position_m: place.to_ecef(),
        });
    }
    Ok(points)
}

/// Measurements without values, with the standard deviations of the stations.
pub(super) fn blank(config: &Config, measure: &[String]) -> Result<Vec<Measurement>, UsageError> {
    let one = |text: &String| {
        let (station, quantity) = config.quantity_of(text)?;
        let sigma = config.station[station].sigma(quantity)?;
        Ok(Measurement { station, quantity, value: 0.0, sigma })
    };
    measure.iter().map(one).collect()
}

/// Noisy measurements of every point.
pub(super) fn observations(
    config: &Config,
    simulate: &SimulateConfig,
    stations: &[Station],
    truth: &[TruePoint],
    seed: u64,
) -> anyhow::Result<Vec<Observation>> {
    let blank = blank(config, &simulate.measure)?;
    let mut normal = normals(seed, 0);
    let mut observations = Vec::new();
    for point in truth {
        let problem = Problem::new(stations, &blank)?;
        let mut calculated = error_free(&problem, point.position_m);
        if let Some(air) = &config.refraction {
            for m in &mut calculated {
                let (station, reference) =
                    (&stations[m.station], &stations[m.reference_or_station()]);
                m.value +=
                    air.atmosphere().effect(m.quantity, station, reference, point.position_m);
            }
        }
        let mut drawn = calculated.clone();
        draw_errors(&problem, &calculated, &mut drawn, &mut normal);
        for m in &mut drawn {
            if m.quantity == Quantity::Azimuth {
                m.value = kurs::frames::wrap_heading(m.value);
            }
        }
        observations
            .extend(drawn.iter().map(|m| Observation { time: point.time, measurement: *m }));
    }
    Ok(observations)
}
