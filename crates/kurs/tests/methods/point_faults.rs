//! Faulty satellites: any one or two with errors of 50 to 1000 m are excluded and the position
//! recovers; clean data lose none.

use kurs::atmosphere::Troposphere;
use kurs::ephemeris::{NavigationData, SatelliteState};
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::point::{Code, PointSettings, PointSolution, Tracked, solve, solve_near};
use kurs::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite, System};
use kurs::sky::{Horizon, NoiseModel, View};
use kurs::time::GpsTime;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

const NOISE: NoiseModel = NoiseModel {
    code_zenith_m: 0.3,
    phase_zenith_m: 0.002,
    full_cn0_dbhz: 45.0,
    channel_sd_m: 0.0,
};

/// A random sky of two systems over a random place in low orbit, where no atmosphere is, with the
/// noise that the weights expect: 0.3 m / sin E for the code, 0.5 m for the orbit, 0.1 m for what the
/// ionosphere's model leaves.
struct Sky {
    random: Xoshiro256PlusPlus,
    antenna_m: Vector<Ecef>,
    tracked: Vec<Tracked>,
}

impl Sky {
    fn new(seed: u64, per_system: u8) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (latitude, longitude) =
            (random.random_range(-80.0..80.0), random.random_range(-180.0..180.0));
        let antenna_m = Geodetic::from_degrees(latitude, longitude, 500e3).to_ecef();
        let mut sky = Self { random, antenna_m, tracked: Vec::new() };
        for system in [System::Gps, System::Galileo] {
            for number in 1..=per_system {
                let satellite = sky.satellite(Satellite::new(system, number));
                sky.tracked.push(satellite);
            }
        }
        sky
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    fn satellite(&mut self, satellite: Satellite) -> Tracked {
        let horizon = Horizon::at(self.antenna_m);
        // One above each other from 10° up, so that every sky can be solved.
        let elevation = 10.0 + 12.0 * f64::from((satellite.number - 1) % 7);
        let elevation_rad = (elevation + self.random.random_range(0.0..5.0f64)).to_radians();
        let azimuth_rad = 2.4 * f64::from(satellite.number) + self.random.random_range(0.0..1.0);
        let (sin, cos) = azimuth_rad.sin_cos();
        let flat = elevation_rad.cos();
        let direction = horizon.geodetic.ecef_from_ned()
            * Vector::new(flat * cos, flat * sin, -elevation_rad.sin());
        let state = SatelliteState {
            position_m: self.antenna_m + direction * 21_000e3,
            velocity_mps: Vector::new(0.0, 0.0, 0.0),
            clock_s: 1e-4,
            clock_drift: 0.0,
            sigma_m: 0.5,
        };
        let view = View::new(&state, self.antenna_m);
        let sin_elevation = horizon.direction(view.line_of_sight).sin_elevation();
        let band = Band::new(satellite.system, 1);
        let code_m2 = NOISE.variances(band, sin_elevation, Some(50.0)).code_m2;
        let delay_m = Troposphere::above(&horizon.geodetic).delay_m(sin_elevation);
        let sigma_m = (code_m2 + 0.01 + 0.25).sqrt();
        let receiver_m = 3e4 + if satellite.system == System::Gps { 0.0 } else { 12.0 };
        let noise_m = sigma_m * self.normal();
        Tracked {
            satellite,
            state,
            code: Code {
                pseudorange_m: view.range_m + delay_m + receiver_m - SPEED_OF_LIGHT_MPS * 1e-4
                    + noise_m,
                band,
                frequency_hz: band.frequency_hz(None).unwrap(),
                cn0_dbhz: Some(50.0),
            },
            second: None,
            delay_sd_m: 0.0,
            range_rate_mps: None,
        }
    }

    fn solve(&self) -> PointSolution {
        let settings = PointSettings { elevation_mask_rad: 0.0, noise: NOISE };
        let time = GpsTime::from_week_tow(2320, 0.0).unwrap();
        solve(&self.tracked, &NavigationData::default(), time, &settings).unwrap()
    }

    /// From a place two kilometres away.
    fn solve_near(&self) -> PointSolution {
        let settings = PointSettings { elevation_mask_rad: 0.0, noise: NOISE };
        let time = GpsTime::from_week_tow(2320, 0.0).unwrap();
        let near_m = self.antenna_m + Vector::new(2000.0, 0.0, 0.0);
        solve_near(&self.tracked, &NavigationData::default(), time, &settings, near_m).unwrap()
    }

    fn error_m(&self, solution: &PointSolution) -> f64 {
        (solution.position_m - self.antenna_m).norm()
    }
}

/// 500 skies with one and 500 with two faults, 14 satellites each.
#[test]
fn one_and_two_faults_are_excluded_and_the_position_recovers() {
    let mut worst_m: f64 = 0.0;
    for seed in 0..1000 {
        let mut sky = Sky::new(seed, 7);
        let mut faulty = vec![sky.random.random_range(0..sky.tracked.len())];
        if seed % 2 == 1 {
            let step = sky.random.random_range(1..sky.tracked.len());
            faulty.push((faulty[0] + step) % sky.tracked.len());
        }
        for &index in &faulty {
            let size_m = sky.random.random_range(50.0..1000.0);
            let sign = if sky.random.random_range(0..2) == 0 { -1.0 } else { 1.0 };
            sky.tracked[index].code.pseudorange_m += sign * size_m;
        }
        let solution = sky.solve();
        let mut excluded: Vec<_> = solution.exclusions.iter().map(|e| e.satellite).collect();
        let mut expected: Vec<_> = faulty.iter().map(|i| sky.tracked[*i].satellite).collect();
        excluded.sort_unstable();
        expected.sort_unstable();
        assert_eq!(excluded, expected, "sky {seed}: {:?}", solution.exclusions);
        for exclusion in &solution.exclusions {
            assert!(exclusion.residual_m.abs() > 30.0, "sky {seed}: {exclusion:?}");
        }
        worst_m = worst_m.max(sky.error_m(&solution));
    }
    println!("1000 skies with faults of 50 to 1000 m: worst position {worst_m:.2} m");
    assert!(worst_m < 15.0, "{worst_m}");
}

/// 300 skies of 14 satellites with one to three ranges or orbits wrong by kilometres to the size of an orbit, from
/// nowhere and from near the antenna.
#[test]
fn gross_faults_are_excluded_before_the_position_counts() {
    for seed in 0..300_u32 {
        let mut sky = Sky::new(2_000_000 + u64::from(seed), 7);
        let count = 1 + seed as usize % 3;
        let mut expected = Vec::new();
        for fault in 0..count {
            let index = (seed as usize + 5 * fault) % sky.tracked.len();
            let size_m = 10_f64.powf(sky.random.random_range(4.0..7.0));
            let wrong = &mut sky.tracked[index];
            match fault % 2 {
                0 => wrong.code.pseudorange_m += size_m,
                _ => wrong.state.position_m += Vector::new(size_m, size_m, -size_m),
            }
            expected.push(wrong.satellite);
        }
        expected.sort_unstable();
        for solution in [sky.solve(), sky.solve_near()] {
            let mut excluded: Vec<_> = solution.exclusions.iter().map(|e| e.satellite).collect();
            excluded.sort_unstable();
            assert_eq!(excluded, expected, "sky {seed}: {:?}", solution.exclusions);
            let gross = solution.exclusions.iter().filter(|e| e.residual_m.abs() > 500.0).count();
            assert!(gross > 0 && sky.error_m(&solution) < 20.0, "sky {seed}: {solution:?}");
        }
    }
}

/// Skies of 20 satellites with three to eight ranges 50 to 400 m off, as imitated signals are, from nowhere and from
/// near the antenna: the others tell, or the covariance does.
#[test]
fn the_most_are_believed_if_they_prove_themselves() {
    let (mut found, mut solved) = ([0; 9], [0; 9]);
    for seed in 0..600_u32 {
        let mut sky = Sky::new(3_000_000 + u64::from(seed), 10);
        let count = 3 + seed as usize % 6;
        let first = sky.random.random_range(0..sky.tracked.len());
        let mut expected = Vec::new();
        for fault in 0..count {
            let index = (first + 7 * fault) % sky.tracked.len();
            let size_m = sky.random.random_range(50.0..400.0);
            sky.tracked[index].code.pseudorange_m += size_m;
            expected.push(sky.tracked[index].satellite);
        }
        expected.sort_unstable();
        for solution in [sky.solve(), sky.solve_near()] {
            let mut excluded: Vec<_> = solution.exclusions.iter().map(|e| e.satellite).collect();
            excluded.sort_unstable();
            solved[count] += 1;
            found[count] += u32::from(excluded == expected);
            let promised_m = solution.covariance_m2.trace().sqrt();
            assert!(
                sky.error_m(&solution) < 5.0 * promised_m,
                "sky {seed}, {count} faults: {} m off, {promised_m} m promised",
                sky.error_m(&solution),
            );
        }
    }
    println!("of {solved:?} skies with so many faults all were found in {found:?}");
    assert!((3..=5).all(|count| 10 * found[count] > 9 * solved[count]), "{found:?} of {solved:?}");
}

/// 5000 clean skies: 6e-7 of 70 000 satellites is 0.04, the 99.9 % bound is 1.
#[test]
fn clean_data_lose_no_satellite() {
    let mut exclusions = 0;
    let (mut squares, mut skies) = (0.0, 0.0);
    for seed in 0..5_000 {
        let sky = Sky::new(1_000_000 + seed, 7);
        let solution = sky.solve();
        exclusions += solution.exclusions.len();
        squares += solution.unit_weight_rms.powi(2);
        skies += 1.0;
    }
    let unit = squares / skies;
    println!("{exclusions} exclusions in {skies} clean skies, unit weight {unit:.3}");
    assert!(exclusions <= 1, "{exclusions}");
    // χ²/ν of 5000 skies with 9 degrees of freedom: 1 ± 3.29 · √(2/45 000), and 0.5 % that the weights are off
    assert!((unit - 1.0).abs() < 0.022 + 0.005, "{unit}");
}

/// Where a fault cannot be told from the others the honest larger residuals stay.
#[test]
fn a_fault_without_redundancy_is_kept_and_shows() {
    let mut sky = Sky::new(7, 3);
    sky.tracked.truncate(6);
    sky.tracked[2].code.pseudorange_m += 500.0;
    let solution = sky.solve();
    assert_eq!(solution.exclusions, []);
    assert!(solution.unit_weight_rms > 10.0, "{}", solution.unit_weight_rms);
}
