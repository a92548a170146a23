//! Cost of an epoch, stage by stage and whole: `cargo bench -p kurs --bench epoch`. The argument is the number of
//! antennas; all see the same GPS and Galileo satellites on one band.
#![allow(clippy::unwrap_used)] // a benchmark

#[path = "../examples/data/recording.rs"]
mod recording;
#[path = "../examples/data/world.rs"]
mod world;

use divan::{Bencher, black_box};
use kurs::ambiguity::search::IntegerLeastSquares;
use kurs::difference::{self, Antenna, Link};
use kurs::ephemeris::Transmissions;
use kurs::float_solution::{CodeFloat, FloatSolution};
use kurs::observation::ArrayEpoch;
use kurs::point::{self, PointSettings, PointSolution, Tracked};
use kurs::{AntennaArray, Attitude, Constraint, Engine, NavigationData, Settings};
use world::{Motion, World};

const ANTENNAS: [usize; 2] = [2, 4];
/// Epochs that a benchmark of the whole goes through in turn.
const EPOCHS: u32 = 100;

fn main() {
    divan::main();
}

/// A body on which so many antennas stand a metre apart.
fn body(antennas: usize) -> Motion {
    const PLACES_M: [[f64; 3]; 4] =
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.2]];
    let attitude = Attitude { heading_rad: 1.0, pitch_rad: 0.05, roll_rad: -0.03 };
    Motion::at_rest(attitude, &PLACES_M[..antennas])
}

fn settings(body: &Motion) -> Settings {
    Settings {
        antennas: body.antennas_m.len(),
        array: Some(AntennaArray::new(body.antennas_m.clone()).unwrap()),
        constraint: Constraint::None,
        ..Settings::default()
    }
}

/// An epoch with what each stage makes of it for the next one.
struct Stages {
    navigation: NavigationData,
    observed: ArrayEpoch,
    settings: Settings,
    tracked: Vec<Vec<Tracked>>,
    points: Vec<PointSolution>,
    rovers: Vec<usize>,
}

impl Stages {
    fn new(antennas: usize) -> Self {
        let (mut world, body) = (World::new().unwrap(), body(antennas));
        let mut stages = Self {
            observed: world.epoch(&body, 0.0),
            navigation: world.navigation,
            settings: settings(&body),
            tracked: Vec::new(),
            points: Vec::new(),
            rovers: (1..antennas).collect(),
        };
        stages.tracked = stages.track();
        stages.points = (0..antennas).map(|antenna| stages.position(antenna, None)).collect();
        stages
    }

    fn track(&self) -> Vec<Vec<Tracked>> {
        let mut sent = Transmissions::of(&self.navigation.ephemerides);
        let mut of_antenna = |observed: &kurs::AntennaEpoch| {
            let mut tracked = Vec::new();
            point::track_sent(observed, &mut sent, |_| true, &mut tracked);
            tracked
        };
        self.observed.antennas.iter().flatten().map(&mut of_antenna).collect()
    }

    fn position(&self, antenna: usize, near: Option<&PointSolution>) -> PointSolution {
        let Settings { elevation_mask_rad, noise, .. } = self.settings;
        let settings = PointSettings { elevation_mask_rad, noise };
        let (tracked, time) = (&self.tracked[antenna], self.observed.time);
        match near {
            Some(near) => {
                point::solve_near(tracked, &self.navigation, time, &settings, near.position_m)
            }
            None => point::solve(tracked, &self.navigation, time, &settings),
        }
        .unwrap()
    }

    fn links(&self) -> Vec<Link> {
        let mut links = Vec::new();
        for (index, point) in self.points.iter().enumerate() {
            let antenna = Antenna {
                index,
                epoch: self.observed.antennas[index].as_ref().unwrap(),
                tracked: &self.tracked[index],
                position_m: point.position_m,
                mount: None,
                body_from_ecef: None,
            };
            let Settings { elevation_mask_rad, noise, .. } = &self.settings;
            let (navigation, mask_rad) = (&self.navigation, *elevation_mask_rad);
            difference::links(&antenna, navigation, noise, mask_rad, |_| true, &mut links);
        }
        links
    }
}

#[divan::bench(args = ANTENNAS)]
fn satellite_states(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    bencher.bench_local(|| stages.track());
}

#[divan::bench(args = ANTENNAS)]
fn positions(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    bencher.bench_local(|| {
        for (antenna, near) in stages.points.iter().enumerate() {
            black_box(stages.position(antenna, Some(near)));
        }
    });
}

#[divan::bench(args = ANTENNAS)]
fn velocities(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    bencher.bench_local(|| {
        for (tracked, point) in stages.tracked.iter().zip(&stages.points) {
            black_box(point::velocity(tracked, point, stages.settings.elevation_mask_rad));
        }
    });
}

#[divan::bench(args = ANTENNAS)]
fn differences(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    bencher.bench_local(|| {
        let mut links = stages.links();
        let groups = difference::group(&mut links);
        (links, groups)
    });
}

#[divan::bench(args = ANTENNAS)]
fn code(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    let mut links = stages.links();
    let groups = difference::group(&mut links);
    bencher.bench_local(|| CodeFloat::solve(&links, &groups, 0, &stages.rovers).unwrap());
}

#[divan::bench(args = ANTENNAS)]
fn float(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    let mut links = stages.links();
    let groups = difference::group(&mut links);
    bencher.bench_local(|| FloatSolution::solve(&links, &groups, 0, &stages.rovers).unwrap());
}

#[divan::bench(args = ANTENNAS)]
fn search(bencher: Bencher, antennas: usize) {
    let stages = Stages::new(antennas);
    let mut links = stages.links();
    let groups = difference::group(&mut links);
    let float = FloatSolution::solve(&links, &groups, 0, &stages.rovers).unwrap();
    let mut search = IntegerLeastSquares::default();
    bencher.bench_local(|| {
        search.solve(float.ambiguities_cycles.as_slice(), float.ambiguity_covariance(), 4).unwrap()
    });
}

#[divan::bench(args = ANTENNAS)]
fn whole_epoch(bencher: Bencher, antennas: usize) {
    let (mut world, body) = (World::new().unwrap(), body(antennas));
    let epochs: Vec<_> = (0..EPOCHS).map(|k| world.epoch(&body, f64::from(k))).collect();
    let new_engine = || Engine::new(settings(&body), world.navigation.clone()).unwrap();
    // Time must not go back: after the last epoch a new engine begins.
    let (mut engine, mut next) = (new_engine(), 0);
    bencher.bench_local(|| {
        if next == epochs.len() {
            (engine, next) = (new_engine(), 0);
        }
        next += 1;
        engine.push(&epochs[next - 1])
    });
}
