//! The velocity of one antenna: exact Doppler shifts in, the exact velocity out.

use kurs::point::{self, Exclusion, PointSettings, PointSolution, Tracked, Velocity};
use kurs::sky::{Horizon, NoiseModel, View};
use kurs::{ArrayEpoch, Ned, Vector};
use nalgebra::{Matrix4, Vector4};

use super::degrees;
use super::world::{Motion, World};

const MASK_RAD: f64 = 0.2;

/// An antenna that moves, its satellites, and its place as if it were known exactly: what a wrong place does to
/// the velocity is not the question here.
struct Antenna {
    body: Motion,
    tracked: Vec<Tracked>,
    point: PointSolution,
}

impl Antenna {
    fn new(velocity_mps: [f64; 3]) -> Self {
        let mut world = World::new().unwrap();
        (world.code_sd_m, world.doppler_sd_mps) = (0.0, 0.0);
        let mut body = Motion::at_rest(degrees(0.0, 0.0, 0.0), &[[0.0; 3]]);
        body.velocity_mps = Vector::new(velocity_mps[0], velocity_mps[1], velocity_mps[2]);
        let epoch: ArrayEpoch = world.epoch(&body, 3.0);
        let observed = epoch.antennas[0].as_ref().unwrap();
        let mut tracked = Vec::new();
        assert_eq!(point::track(observed, &world.navigation, |_| true, &mut tracked), 0);
        let noise = NoiseModel {
            code_zenith_m: 0.3,
            phase_zenith_m: 0.002,
            full_cn0_dbhz: 45.0,
            channel_sd_m: 0.0,
        };
        let settings = PointSettings { elevation_mask_rad: MASK_RAD, noise };
        let mut point =
            point::solve(&tracked, &world.navigation, observed.time, &settings).unwrap();
        point.position_m = body.antenna_m(0, observed.time);
        point.horizon = Horizon::at(point.position_m);
        Self { body, tracked, point }
    }

    fn velocity(&self) -> Velocity {
        point::velocity(&self.tracked, &self.point, MASK_RAD).unwrap()
    }

    /// How far it is off, north, east, down.
    fn off_mps(&self) -> f64 {
        let ned_from_ecef = self.body.place.ned_from_ecef();
        let found: Vector<Ned> = ned_from_ecef * self.velocity().velocity_mps;
        (found - self.body.velocity_mps).norm()
    }

    /// Direction to a satellite and its elevation.
    fn sight(&self, satellite: &Tracked) -> (nalgebra::Vector3<f64>, f64) {
        let line_of_sight = View::new(&satellite.state, self.point.position_m).line_of_sight;
        (line_of_sight.xyz(), self.point.horizon.direction(line_of_sight).elevation_rad())
    }

    /// The satellites with the lowest one first.
    fn lowest_first(mut self) -> Self {
        let mut tracked = core::mem::take(&mut self.tracked);
        tracked.sort_by(|a, b| self.sight(a).1.total_cmp(&self.sight(b).1));
        Self { tracked, ..self }
    }
}

/// The differences of rounded times leave some hundredths of a millimetre a second; the antenna's own part in
/// the change of the travel time, up to a millimetre a second for an aircraft, is not taken into account.
#[test]
fn exact_shifts_give_the_exact_velocity() {
    for velocity_mps in [[0.0; 3], [30.0, 0.0, 0.0], [-4.0, 25.0, 2.0], [0.0, -250.0, -8.0]] {
        let off_mps = Antenna::new(velocity_mps).off_mps();
        let speed_mps = velocity_mps.iter().map(|v| v * v).sum::<f64>().sqrt();
        assert!(off_mps < 2e-4 + 3e-6 * speed_mps, "{velocity_mps:?}: {off_mps}");
    }
}

#[test]
fn the_drift_of_the_clock_is_none_of_the_velocity() {
    let mut antenna = Antenna::new([3.0, -2.0, 0.5]);
    let before_mps = antenna.velocity().clock_drift_mps;
    assert!(before_mps.abs() < 1e-3, "{before_mps}");
    antenna.tracked.iter_mut().for_each(|t| t.range_rate_mps = t.range_rate_mps.map(|r| r + 17.0));
    assert!((antenna.velocity().clock_drift_mps - 17.0 - before_mps).abs() < 1e-9);
    assert!(antenna.off_mps() < 3e-4);
}

/// `(Σ a aᵀ sin² E / (2 cm/s)²)⁻¹` with `a = (−u, 1)`.
#[test]
fn low_satellites_weigh_less() {
    let antenna = Antenna::new([0.0; 3]);
    let mut normal = Matrix4::zeros();
    for satellite in &antenna.tracked {
        let (u, elevation_rad) = antenna.sight(satellite);
        let row = Vector4::new(-u.x, -u.y, -u.z, 1.0) * (elevation_rad.sin() / 0.02);
        normal += row * row.transpose();
    }
    let expected = normal.try_inverse().unwrap();
    let found = antenna.velocity().covariance_m2ps2;
    assert!((found - expected.fixed_view::<3, 3>(0, 0)).amax() < 1e-12 + 1e-9 * found.amax());
}

/// Satellites in a weighted sum: a change of one range rate by δ moves the velocity by `C a w δ`.
#[test]
fn a_small_error_moves_the_velocity_by_its_weight() {
    let mut antenna = Antenna::new([5.0, 5.0, 0.0]).lowest_first();
    let before = antenna.velocity();
    antenna.tracked[0].range_rate_mps = antenna.tracked[0].range_rate_mps.map(|r| r + 0.1);
    let moved = antenna.velocity().velocity_mps - before.velocity_mps;
    let mut normal = Matrix4::zeros();
    let mut right = Vector4::zeros();
    for (k, satellite) in antenna.tracked.iter().enumerate() {
        let (u, elevation_rad) = antenna.sight(satellite);
        let row = Vector4::new(-u.x, -u.y, -u.z, 1.0);
        let weight = (elevation_rad.sin() / 0.02).powi(2);
        normal += row * row.transpose() * weight;
        right += row * if k == 0 { 0.1 * weight } else { 0.0 };
    }
    let expected = normal.try_inverse().unwrap() * right;
    let expected = Vector::new(expected.x, expected.y, expected.z);
    assert!((moved - expected).norm() < 1e-9, "{moved:?} {expected:?}");
}

#[test]
fn what_is_excluded_below_or_off_does_not_count() {
    let spoil = |by_mps: f64| {
        let mut antenna = Antenna::new([8.0, 1.0, 0.0]).lowest_first();
        let rate = &mut antenna.tracked[0].range_rate_mps;
        *rate = rate.map(|rate| rate + by_mps);
        antenna
    };
    assert!(spoil(0.9).off_mps() > 0.01, "less than the bound: it counts");
    // More than 1 m/s from what the others say.
    assert!(spoil(40.0).off_mps() < 3e-4, "{}", spoil(40.0).off_mps());
    assert!(spoil(-40.0).off_mps() < 3e-4);

    let mut antenna = spoil(0.9);
    let satellite = antenna.tracked[0].satellite;
    antenna.point.exclusions.push(Exclusion { satellite, residual_m: 30.0 });
    assert!(antenna.off_mps() < 3e-4, "the position did without it");

    // Above the lowest satellite.
    let antenna = spoil(0.9);
    let mask_rad = antenna.sight(&antenna.tracked[0]).1 + 1e-6;
    let found = point::velocity(&antenna.tracked, &antenna.point, mask_rad).unwrap();
    let found = antenna.body.place.ned_from_ecef() * found.velocity_mps;
    assert!((found - antenna.body.velocity_mps).norm() < 3e-4);
}

/// An error that draws the first estimate away from all others.
#[test]
fn a_gross_error_of_any_satellite_is_found() {
    let count = Antenna::new([8.0, 1.0, 0.0]).tracked.len();
    for (first, by_mps) in (0..count).flat_map(|k| [(k, 200.0), (k, -3e4)]) {
        let mut antenna = Antenna::new([8.0, 1.0, 0.0]);
        let second = (first + count / 2) % count;
        for (k, by_mps) in [(first, by_mps), (second, 0.7 * by_mps)] {
            let rate = &mut antenna.tracked[k].range_rate_mps;
            *rate = rate.map(|rate| rate + by_mps);
            assert!(antenna.off_mps() < 1e-3, "{first}, {by_mps}: {}", antenna.off_mps());
        }
    }
    // Of five of which one is wrong nothing tells which.
    let mut antenna = Antenna::new([8.0, 1.0, 0.0]);
    antenna.tracked.truncate(5);
    antenna.tracked[2].range_rate_mps = Some(900.0);
    assert_eq!(point::velocity(&antenna.tracked, &antenna.point, MASK_RAD), None);
}

#[test]
fn four_satellites_are_needed() {
    let mut antenna = Antenna::new([8.0, 1.0, 0.0]);
    antenna.tracked.reverse();
    let mut spread = antenna.tracked.clone();
    spread.sort_by(|a, b| antenna.sight(a).0.x.total_cmp(&antenna.sight(b).0.x));
    let step = spread.len() / 4;
    antenna.tracked = spread.into_iter().step_by(step).take(4).collect();
    assert!(antenna.off_mps() < 3e-3, "{}", antenna.off_mps());
    antenna.tracked.pop();
    assert_eq!(point::velocity(&antenna.tracked, &antenna.point, MASK_RAD), None);
    antenna.tracked.iter_mut().for_each(|t| t.range_rate_mps = None);
    assert_eq!(point::velocity(&antenna.tracked, &antenna.point, MASK_RAD), None);
}
