//! Whole trajectories: consistency with the model of motion, and the constants of stations.

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::smoother::{
    Model, NotSmoothed, Parameter, ParameterKind, TimedMeasurement, Trajectory, smooth,
};
use kurs::trajectory::station::Station;
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

use Quantity::{Azimuth, Elevation, Range};

const JERK_DENSITY: f64 = 4.0;
const INTERVAL_S: f64 = 0.5;

fn stations() -> [Station; 3] {
    [(65.5, 41.4, 150.0), (64.5, 40.5, 100.0), (64.2, 38.9, 2500.0)].map(
        |(latitude, longitude, height)| {
            Station::at(&Geodetic::from_degrees(latitude, longitude, height))
        },
    )
}

struct Normal(Xoshiro256PlusPlus);

impl Normal {
    fn seeded(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.draw())
    }
}

/// Position, velocity, acceleration.
type State = [Vector3<f64>; 3];

/// A trajectory drawn from the model: jerk constant over hundredths of the interval.
fn drawn_trajectory(points: usize, normal: &mut Normal) -> Vec<State> {
    let mut state = [
        Geodetic::from_degrees(64.8, 39.0, 20e3).to_ecef().xyz(),
        Vector3::new(200.0, -150.0, 40.0),
        Vector3::new(0.5, 1.0, -0.3),
    ];
    let mut states = vec![state];
    let pieces = 100;
    let step = INTERVAL_S / f64::from(pieces);
    for _ in 1..points {
        for _ in 0..pieces {
            let jerk = normal.vector() * (JERK_DENSITY / step).sqrt();
            let [r, v, a] = state;
            state = [
                r + v * step + a * (step * step / 2.0) + jerk * (step.powi(3) / 6.0),
                v + a * step + jerk * (step * step / 2.0),
                a + jerk * step,
            ];
        }
        states.push(state);
    }
    states
}

/// Each point is seen by one station in turn, which measures azimuth, elevation and, at station 2,
/// range: no point is determined alone.
fn measure(
    states: &[State],
    normal: &mut Normal,
    wrong: impl Fn(usize, Quantity) -> f64,
    late_s: impl Fn(usize) -> f64,
) -> Vec<TimedMeasurement> {
    let stations = stations();
    let mut measurements = Vec::new();
    for (k, [r, v, a]) in states.iter().enumerate() {
        let station = k % 3;
        let late = late_s(station);
        let object = Vector::from_xyz(r - v * late + a * (late * late / 2.0));
        let kinds: &[(Quantity, f64)] = match station {
            2 => &[(Range, 5.0)],
            _ => &[(Azimuth, 5e-5), (Elevation, 5e-5)],
        };
        for &(quantity, sigma) in kinds {
            let exact = quantity.predict(&stations[station], &stations[station], object);
            let value = exact + sigma * normal.draw() + wrong(station, quantity);
            let measurement = Measurement { station, quantity, value, sigma };
            measurements.push(TimedMeasurement { time_s: k as f64 * INTERVAL_S, measurement });
        }
    }
    measurements
}

/// Straight line 3 km beside the truth.
fn rough_start(states: &[State]) -> Vec<(f64, Vector<Ecef>)> {
    let beside = Vector3::new(2e3, -2e3, 1e3);
    let last = states.len() - 1;
    [0, last].map(|k| (k as f64 * INTERVAL_S, Vector::from_xyz(states[k][0] + beside))).to_vec()
}

fn errors(trajectory: &Trajectory, states: &[State], k: usize) -> nalgebra::SVector<f64, 9> {
    let point = &trajectory.points[k];
    let parts = [point.position_m, point.velocity_mps, point.acceleration_mps2];
    nalgebra::SVector::from_fn(|row, _| parts[row / 3].xyz()[row % 3] - states[k][row / 3][row % 3])
}

/// Truth drawn from the model: NEES of all nine states and of the position, and the innovations,
/// within 99.9 % bands over 60 independent trajectories.
#[test]
fn consistent_with_its_own_model() {
    let runs = 60;
    let (mut nees, mut position_nees, mut innovations, mut degrees) = (0.0, 0.0, 0.0, 0);
    let mut normal = Normal::seeded(31);
    for _ in 0..runs {
        let states = drawn_trajectory(60, &mut normal);
        let measurements = measure(&states, &mut normal, |_, _| 0.0, |_| 0.0);
        let model = Model { jerk_density: JERK_DENSITY, ..Model::default() };
        let found = smooth(&stations(), &measurements, &rough_start(&states), &model).unwrap();
        let (error, covariance) = (errors(&found, &states, 30), found.points[30].covariance);
        nees += error.dot(&(covariance.try_inverse().unwrap() * error));
        let position = error.fixed_rows::<3>(0).into_owned();
        let block = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        position_nees += position.dot(&(block.try_inverse().unwrap() * position));
        innovations += found.innovation_cost;
        degrees += measurements.len() - 9;
    }
    let runs = f64::from(runs);
    let band = |degrees: f64| 3.29 * (2.0 * degrees).sqrt();
    println!("NEES {:.2} of 9, {:.2} of 3", nees / runs, position_nees / runs);
    assert!((nees - 9.0 * runs).abs() < band(9.0 * runs), "{}", nees / runs);
    assert!((position_nees - 3.0 * runs).abs() < band(3.0 * runs), "{}", position_nees / runs);
    let degrees = degrees as f64;
    println!("innovations {innovations:.0}, expected {degrees:.0} ± {:.0}", band(degrees));
    assert!((innovations - degrees).abs() < band(degrees));
}

/// Clock, pointing and range errors of stations are found within their standard deviations, and
/// the trajectory is the better for it.
#[test]
fn constants_of_stations_are_found() {
    let mut normal = Normal::seeded(32);
    let states = drawn_trajectory(300, &mut normal);
    let wrong = |station: usize, quantity: Quantity| match (station, quantity) {
        (0, Azimuth) => 8e-4,
        (1, Elevation) => -5e-4,
        (2, Range) => 60.0,
        _ => 0.0,
    };
    let measurements = measure(&states, &mut normal, wrong, |station| [0.0, 0.25, 0.0][station]);
    let parameter = |station, kind, sigma| Parameter { station, kind, sigma };
    let parameters = vec![
        parameter(0, ParameterKind::AzimuthBias, 1e-3),
        parameter(1, ParameterKind::ElevationBias, 1e-3),
        parameter(2, ParameterKind::RangeBias, 100.0),
        parameter(1, ParameterKind::ClockOffset, 0.5),
    ];
    let expected = [8e-4, -5e-4, 60.0, 0.25];
    let with = Model { jerk_density: JERK_DENSITY, parameters, ..Model::default() };
    let without = Model { jerk_density: JERK_DENSITY, ..Model::default() };
    let start = rough_start(&states);
    let found = smooth(&stations(), &measurements, &start, &with).unwrap();
    for ([value, sigma], expected) in found.parameters.iter().zip(expected) {
        println!("{value:.6} ± {sigma:.6}, true {expected}");
        assert!((value - expected).abs() < 4.0 * sigma, "{value} ± {sigma}: {expected}");
        assert!(*sigma < 0.5 * expected.abs(), "{value} ± {sigma} says little");
    }
    let rms = |trajectory: &Trajectory| {
        let squares = (0..states.len())
            .map(|k| errors(trajectory, &states, k).fixed_rows::<3>(0).norm_squared());
        (squares.sum::<f64>() / states.len() as f64).sqrt()
    };
    let plain = smooth(&stations(), &measurements, &start, &without).unwrap();
    println!("RMS {:.1} m with, {:.1} m without", rms(&found), rms(&plain));
    assert!(rms(&found) < 0.5 * rms(&plain));
}

/// Every instant is seen by all stations, with noise that is `noise` times the stated one; the range
/// of station 2 has `wrong_m` added from instant `from` on.
fn measure_all(
    states: &[State],
    normal: &mut Normal,
    noise: f64,
    (from, wrong_m): (usize, f64),
) -> Vec<TimedMeasurement> {
    let stations = stations();
    let mut measurements = Vec::new();
    for (k, [r, ..]) in states.iter().enumerate() {
        for station in 0..3 {
            let kinds: &[(Quantity, f64)] = match station {
                2 => &[(Range, 5.0)],
                _ => &[(Azimuth, 2e-4), (Elevation, 2e-4)],
            };
            for &(quantity, sigma) in kinds {
                let at = &stations[station];
                let exact = quantity.predict(at, at, Vector::from_xyz(*r));
                let wrong = if station == 2 && k >= from { wrong_m } else { 0.0 };
                let value = exact + noise * sigma * normal.draw() + wrong;
                let measurement = Measurement { station, quantity, value, sigma };
                measurements.push(TimedMeasurement { time_s: k as f64 * INTERVAL_S, measurement });
            }
        }
    }
    measurements
}

fn screening() -> Model {
    Model { jerk_density: JERK_DENSITY, outlier_probability: 1e-3, ..Model::default() }
}

/// Mean of the normalised squared errors of the positions; 3 expected.
fn position_nees(found: &Trajectory, states: &[State]) -> f64 {
    let one = |k: usize| {
        let error = errors(found, states, k).fixed_rows::<3>(0).into_owned();
        let block = found.points[k].covariance.fixed_view::<3, 3>(0, 0).into_owned();
        error.dot(&(block.try_inverse().unwrap() * error))
    };
    (0..found.points.len()).map(one).sum::<f64>() / found.points.len() as f64
}

/// A range that goes wrong for good is more precise than the healthy angles, and draws a path through
/// all to itself: the range has to go, from the first wrong one on, and nothing else.
#[test]
fn a_station_that_goes_wrong_is_left_out_and_the_healthy_ones_are_kept() {
    let mut normal = Normal::seeded(34);
    let states = drawn_trajectory(200, &mut normal);
    let measurements = measure_all(&states, &mut normal, 1.0, (100, 300.0));
    let found = smooth(&stations(), &measurements, &rough_start(&states), &screening()).unwrap();
    let (mut wrong, mut healthy) = (0, 0);
    for (m, left_out) in measurements.iter().zip(&found.left_out) {
        let is_wrong = m.measurement.quantity == Range && m.time_s >= 100.0 * INTERVAL_S;
        wrong += usize::from(is_wrong && *left_out);
        healthy += usize::from(!is_wrong && *left_out);
    }
    println!("{wrong} of 100 wrong ones and {healthy} of 900 healthy ones left out");
    assert!(wrong == 100 && healthy < 9);
    assert!(found.agrees() && (found.misfit() - 1.0).abs() < 0.1, "{}", found.misfit());
    let nees = position_nees(&found, &states);
    assert!(nees < 6.0, "{nees}");
}

/// A gross error at the very first instant, where nothing is known before it, and single ones later.
#[test]
fn single_gross_errors_are_left_out_alone() {
    let mut normal = Normal::seeded(35);
    let states = drawn_trajectory(100, &mut normal);
    let mut measurements = measure_all(&states, &mut normal, 1.0, (100, 0.0));
    let gross = [0, 204, 250, 251];
    for index in gross {
        measurements[index].measurement.value += 2000.0 * measurements[index].measurement.sigma;
    }
    let found = smooth(&stations(), &measurements, &rough_start(&states), &screening()).unwrap();
    let left_out: Vec<usize> = (0..500).filter(|index| found.left_out[*index]).collect();
    println!("left out {left_out:?}, misfit {:.2}", found.misfit());
    assert!(gross.iter().all(|index| left_out.contains(index)), "{left_out:?}");
    assert!(left_out.len() <= gross.len() + 3, "{left_out:?}");
    assert!(found.points[0].left_out == 1 && found.points[0].used == 4);
    assert!(position_nees(&found, &states) < 6.0);
}

/// Noise that is understated everywhere has no outliers: all is kept, and the whole does not agree.
#[test]
fn noise_above_the_stated_one_is_told_and_throws_nothing_out() {
    let mut normal = Normal::seeded(36);
    let states = drawn_trajectory(100, &mut normal);
    for noise in [3.0, 10.0] {
        let measurements = measure_all(&states, &mut normal, noise, (100, 0.0));
        let found = smooth(&stations(), &measurements, &rough_start(&states), &screening());
        let found = found.unwrap();
        let left_out = found.left_out.iter().filter(|left_out| **left_out).count();
        println!("noise {noise}: {left_out} of 500 left out, misfit {:.2}", found.misfit());
        assert!(left_out <= 5, "{left_out}");
        assert!(!found.agrees() && (found.misfit() / noise - 1.0).abs() < 0.2);
    }
}

/// Beyond a pause of hours the path begins anew; constants of stations go on.
#[test]
fn a_long_pause_begins_a_new_stretch() {
    let mut normal = Normal::seeded(37);
    let states = drawn_trajectory(200, &mut normal);
    let mut measurements = measure_all(&states, &mut normal, 1.0, (0, 60.0));
    let pause_s = 5400.0;
    let middle_s = 100.0 * INTERVAL_S;
    let after = |time_s: f64| if time_s < middle_s { time_s } else { time_s + pause_s };
    measurements.iter_mut().for_each(|m| m.time_s = after(m.time_s));
    let beside = Vector3::new(300.0, -200.0, 100.0);
    let start: Vec<_> = [0, 99, 100, 199]
        .map(|k| (after(k as f64 * INTERVAL_S), Vector::from_xyz(states[k][0] + beside)))
        .to_vec();
    let bias = Parameter { station: 2, kind: ParameterKind::RangeBias, sigma: 100.0 };
    let model = Model { parameters: vec![bias], ..screening() };
    let found = smooth(&stations(), &measurements, &start, &model).unwrap();
    assert_eq!(
        found.degrees_of_freedom,
        1000 - 2 * 9 - found.points.iter().map(|p| p.left_out).sum::<usize>()
    );
    let [value, sigma] = found.parameters[0];
    assert!((value - 60.0).abs() < 4.0 * sigma && sigma < 30.0, "{value} ± {sigma}");
    assert!(found.points.iter().all(|point| point.is_determined()));
    assert!(position_nees(&found, &states) < 6.0 && found.agrees());
}

/// Time tags that differ by less than `same_time_s` make one point, each compared with the path at its
/// own time.
#[test]
fn measurements_close_in_time_make_one_point() {
    let mut normal = Normal::seeded(38);
    let states = drawn_trajectory(50, &mut normal);
    let exact = measure_all(&states, &mut normal, 0.0, (50, 0.0));
    let mut late = exact.clone();
    for (k, m) in late.iter_mut().enumerate() {
        let (after_s, [r, v, a]) = ((k % 5) as f64 * 0.01, states[k / 5]);
        let at = &stations()[m.measurement.station];
        let object = r + v * after_s + a * (0.5 * after_s * after_s);
        let quantity = m.measurement.quantity;
        m.measurement.value = quantity.predict(at, at, Vector::from_xyz(object));
        m.time_s += after_s;
    }
    let model = Model { same_time_s: 0.1, ..screening() };
    let start = rough_start(&states);
    let one = smooth(&stations(), &exact, &start, &model).unwrap();
    let found = smooth(&stations(), &late, &start, &model).unwrap();
    assert_eq!(found.points.len(), states.len());
    for (a, b) in one.points.iter().zip(&found.points) {
        let apart_m = (a.position_m - b.position_m).norm();
        // 250 m/s make 10 m of 0.04 s.
        assert!(apart_m < 1.0, "{apart_m}");
    }
}

#[test]
fn bad_input_is_refused() {
    let mut normal = Normal::seeded(33);
    let states = drawn_trajectory(6, &mut normal);
    let good = measure(&states, &mut normal, |_, _| 0.0, |_| 0.0);
    let (stations, start) = (stations(), rough_start(&states));
    let model = |jerk_density| Model { jerk_density, ..Model::default() };
    assert_eq!(smooth(&stations, &[], &start, &model(1.0)), Err(NotSmoothed::Empty));
    assert_eq!(smooth(&stations, &good, &start[..1], &model(1.0)), Err(NotSmoothed::Empty));
    assert_eq!(smooth(&stations, &good, &start, &model(0.0)), Err(NotSmoothed::BadModel));
    let mut bad = good.clone();
    bad[1].time_s = f64::INFINITY;
    assert!(matches!(
        smooth(&stations, &bad, &start, &model(1.0)),
        Err(NotSmoothed::BadTime { measurement: 1, .. })
    ));
    bad = good;
    bad[2].measurement.sigma = -1.0;
    assert!(matches!(
        smooth(&stations, &bad, &start, &model(1.0)),
        Err(NotSmoothed::BadMeasurement(_))
    ));
}
