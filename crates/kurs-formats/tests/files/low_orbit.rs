//! A receiver in low orbit, 500 km high and 7.6 km/s fast: position, velocity and UTC from ranges
//! made with precise orbits of a real day. The ranges come from inertial coordinates, by light
//! time, and share no equation with the solution.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use kurs::ephemeris::{NavigationData, UtcParameters};
use kurs::frames::EARTH_RATE_RADPS;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::point::{self, PointSettings};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal, System};
use kurs::sky::NoiseModel;
use kurs::time::GpsTime;
use kurs_formats::navigation;
use kurs_formats::source::Source;
use nalgebra::{Rotation3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const PRECISE: &str = "orbits/GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz";
const RADIUS_M: f64 = 6_378_137.0 + 500e3;
/// Rays pass the Earth at least this high.
const LOWEST_RAY_M: f64 = 6_378_137.0 + 60e3;
const CODE_SD_M: f64 = 0.3;
const UTC_BIAS_S: f64 = 3.4e-7;

fn precise() -> Option<NavigationData> {
    let path = crate::outside::recording(PRECISE)?;
    let mut data = NavigationData::default();
    navigation::read(&mut Source::open(path).unwrap(), &mut data).unwrap();
    Some(data)
}

/// Earth-fixed axes of an instant into those that the Earth had at `epoch`, which do not turn.
fn inertial(earth_fixed: Vector3<f64>, time: GpsTime, epoch: GpsTime) -> Vector3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), EARTH_RATE_RADPS * (time - epoch)) * earth_fixed
}

fn earth_fixed(inertial: Vector3<f64>, time: GpsTime, epoch: GpsTime) -> Vector3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), -EARTH_RATE_RADPS * (time - epoch)) * inertial
}

/// The receiver: a circle, 97.4° against the equator.
fn orbit(since_s: f64) -> Vector3<f64> {
    let rate_radps = (3.986_004_418e14 / RADIUS_M.powi(3)).sqrt();
    let (sin, cos) = (0.7 + rate_radps * since_s).sin_cos();
    let (si, ci) = 97.4f64.to_radians().sin_cos();
    RADIUS_M * Vector3::new(cos, ci * sin, si * sin)
}

/// Pseudorange at the true instant `time`; `None` if the Earth is in between.
fn pseudorange_m(
    data: &NavigationData,
    satellite: Satellite,
    time: GpsTime,
    epoch: GpsTime,
    clock_s: f64,
) -> Option<f64> {
    let receiver = orbit(time - epoch);
    // |xₛ(t − τ) − x(t)| = c τ
    let mut travel_s = 0.07;
    let mut sent = Vector3::zeros();
    for _ in 0..5 {
        let at = time + -travel_s;
        let position_m = data.ephemerides.precise().position_m(satellite, at)?;
        sent = inertial(position_m.xyz(), at, epoch);
        travel_s = (sent - receiver).norm() / SPEED_OF_LIGHT_MPS;
    }
    let ray = sent - receiver;
    let nearest = (-receiver.dot(&ray) / ray.norm_squared()).clamp(0.0, 1.0);
    if (receiver + nearest * ray).norm() < LOWEST_RAY_M {
        return None;
    }
    let clock_of_satellite_s = data.ephemerides.state(satellite, time + -travel_s).ok()?.clock_s;
    Some(ray.norm() + SPEED_OF_LIGHT_MPS * (clock_s - clock_of_satellite_s))
}

/// Code with noise and Doppler of every satellite in view; the tag is by the receiver's clock.
fn observe(
    data: &NavigationData,
    time: GpsTime,
    epoch: GpsTime,
    clock_s: f64,
    random: &mut Xoshiro256PlusPlus,
) -> AntennaEpoch {
    let mut observed = AntennaEpoch { time: time + clock_s, ..AntennaEpoch::default() };
    for (satellite, _) in data.ephemerides.precise().iter() {
        if !matches!(satellite.system, System::Gps | System::Galileo) {
            continue;
        }
        let range = |later_s: f64| pseudorange_m(data, satellite, time + later_s, epoch, clock_s);
        let (Some(now_m), Some(before_m), Some(behind_m)) = (range(0.0), range(-0.5), range(0.5))
        else {
            continue;
        };
        // A sum of twelve uniform numbers is as good as normal here.
        let normal = (0..12).map(|_| random.random_range(-0.5..0.5f64)).sum::<f64>();
        let signal = Signal::new(satellite.system, 1, b'C');
        let wavelength_m = signal.band.wavelength_m(None).unwrap();
        observed.observations.push(Observation {
            satellite,
            signal,
            pseudorange_m: Some(now_m + CODE_SD_M * normal),
            phase_cycles: None,
            doppler_hz: Some((before_m - behind_m) / wavelength_m),
            cn0_dbhz: Some(48.0),
            lock: Lock::default(),
        });
    }
    observed
}

#[test]
fn position_velocity_and_utc_in_low_orbit() {
    let Some(mut data) = precise() else { return };
    let epoch = data.ephemerides.precise().iter().next().unwrap().1[0].time;
    data.utc.push(UtcParameters {
        system: System::Gps,
        bias_s: UTC_BIAS_S,
        drift: 0.0,
        reference_time: epoch,
    });
    let noise = NoiseModel {
        code_zenith_m: 0.3,
        phase_zenith_m: 0.002,
        full_cn0_dbhz: 45.0,
        channel_sd_m: 0.0,
    };
    let settings = PointSettings { elevation_mask_rad: 10f64.to_radians(), noise };
    let mut random = Xoshiro256PlusPlus::seed_from_u64(500);
    let (mut squares, mut worst_mps, mut worst_utc_s, mut epochs) = (0.0, 0.0f64, 0.0f64, 0.0);
    let mut least = usize::MAX;
    for index in 0..240 {
        // Six minutes apart would be in step with nothing; the clock is up to a millisecond off.
        let since_s = 7_300.0 + 290.0 * f64::from(index);
        let time = epoch + since_s;
        let clock_s = 1e-3 * (f64::from(index) / 20.0).sin();
        let observed = observe(&data, time, epoch, clock_s, &mut random);
        let mut tracked = Vec::new();
        point::track(&observed, &data, |_| true, &mut tracked);
        let solution = point::solve(&tracked, &data, observed.time, &settings).unwrap();
        let velocity = point::velocity(&tracked, &solution, settings.elevation_mask_rad).unwrap();
        least = least.min(solution.satellites);
        assert_eq!(solution.exclusions, [], "epoch {index}");

        let truth_m = earth_fixed(orbit(since_s), time, epoch);
        squares += (solution.position_m.xyz() - truth_m).norm_squared();
        let at = |later_s: f64| earth_fixed(orbit(since_s + later_s), time + later_s, epoch);
        let truth_mps = at(0.5) - at(-0.5);
        worst_mps = worst_mps.max((velocity.velocity_mps.xyz() - truth_mps).norm());
        // Leap seconds of that day: 18.
        let true_utc = time + -18.0 + -UTC_BIAS_S;
        let utc = data.utc(observed.time + -solution.clock_m / SPEED_OF_LIGHT_MPS);
        let utc = GpsTime::from_calendar(utc).unwrap();
        worst_utc_s = worst_utc_s.max((utc - true_utc).abs());
        epochs += 1.0;
    }
    let rms_m = f64::sqrt(squares / epochs);
    println!(
        "{epochs} epochs, at least {least} satellites: position RMS {rms_m:.2} m, \
         velocity within {worst_mps:.3} m/s, UTC within {:.1} ns",
        1e9 * worst_utc_s
    );
    assert!(least >= 10, "{least}");
    assert!(rms_m <= 5.0, "{rms_m}");
    assert!(worst_mps <= 0.1, "{worst_mps}");
    assert!(worst_utc_s <= 1e-6, "{worst_utc_s}");
}
