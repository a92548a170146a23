//! What happens to a signal on its way: light time, delays, polarisation.

use core::f64::consts::TAU;

use kurs::ephemeris::Klobuchar;
use kurs::frames::EARTH_RATE_RADPS;
use kurs::signal::SPEED_OF_LIGHT_MPS;
use nalgebra::{Matrix3, Vector3};

use crate::satellite_track::{SatelliteTrack, Sender};

/// Scale height of the troposphere.
const SCALE_HEIGHT_M: f64 = 8_000.0;
/// Height of the thin shell that stands for the ionosphere, and mean radius of the Earth.
const SHELL_HEIGHT_M: f64 = 350e3;
const EARTH_RADIUS_M: f64 = 6_371e3;
/// Light times converge by a factor of 1e5 a step.
const MAX_STEPS: usize = 8;
const CONVERGED_S: f64 = 1e-14;

/// A signal's way from satellite to antenna.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Path {
    /// Distance between the sender at transmission and the antenna at reception.
    pub(crate) range_m: f64,
    /// Its rate of change for the receiver.
    pub(crate) range_rate_mps: f64,
    /// Unit vector from the antenna to the satellite, ECEF of the instant of reception.
    pub(crate) line_of_sight: Vector3<f64>,
    /// The sender, its vectors in ECEF of the instant of reception.
    pub(crate) sender: Sender,
}

impl Path {
    /// The way to an antenna at true time `time_s` (s from the start).
    pub(crate) fn trace(
        track: &SatelliteTrack,
        antenna_m: &Vector3<f64>,
        antenna_velocity_mps: &Vector3<f64>,
        time_s: f64,
    ) -> Option<Self> {
        let mut travel_s = 0.075;
        let mut steps = 0;
        let (sender, range) = loop {
            let mut sender = track.at(time_s - travel_s)?;
            // While the signal travels the Earth turns: x(reception) = Rz(ω τ) x(transmission).
            let turn = earth_turn(EARTH_RATE_RADPS * travel_s);
            sender.position_m = turn * sender.position_m;
            sender.velocity_mps = turn * sender.velocity_mps;
            let range = sender.position_m - antenna_m;
            let next_s = range.norm() / SPEED_OF_LIGHT_MPS;
            let change_s = next_s - travel_s;
            travel_s = next_s;
            steps += 1;
            if change_s.abs() < CONVERGED_S || steps == MAX_STEPS {
                break (sender, range);
            }
        };
        let range_m = range.norm();
        let line_of_sight = range / range_m;
        // ρ̇ (1 + e·(v + ω × r) / c) = e·(v − v_antenna): the transmission time moves too.
        let inertial = inertial_velocity_mps(&sender);
        let closing = line_of_sight.dot(&(sender.velocity_mps - antenna_velocity_mps));
        let range_rate_mps = closing / (1.0 + line_of_sight.dot(&inertial) / SPEED_OF_LIGHT_MPS);
        Some(Self { range_m, range_rate_mps, line_of_sight, sender })
    }
}

/// v + ω × r
fn inertial_velocity_mps(sender: &Sender) -> Vector3<f64> {
    let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
    sender.velocity_mps + earth.cross(&sender.position_m)
}

/// Turns vectors given in axes that have turned by an angle less into the axes of now.
fn earth_turn(angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
}

/// Delay in the troposphere: mapping of Black and Eisner (1984) of an exponential atmosphere.
pub(crate) fn troposphere_m(zenith_m: f64, height_m: f64, sin_elevation: f64) -> f64 {
    let mapping = 1.001 / (0.002_001 + sin_elevation * sin_elevation).sqrt();
    zenith_m * (-height_m / SCALE_HEIGHT_M).exp() * mapping
}

/// Delay at 1575.42 MHz in a thin shell: 1/cos z', sin z' = R cos(el) / (R + H).
pub(crate) fn ionosphere_m(zenith_m: f64, sin_elevation: f64) -> f64 {
    let cos_squared = 1.0 - sin_elevation * sin_elevation;
    let ratio = EARTH_RADIUS_M / (EARTH_RADIUS_M + SHELL_HEIGHT_M);
    zenith_m / (1.0 - ratio * ratio * cos_squared).sqrt()
}

/// Parameters that a satellite broadcasts for such a shell: night and day alike, which a period longer
/// than any that is really sent (one year) makes of Klobuchar's cosine. His model has no less than
/// 5 ns at the zenith.
pub(crate) fn broadcast_ionosphere(zenith_m: f64) -> Klobuchar {
    const NIGHT_S: f64 = 5e-9;
    const YEAR_S: f64 = 3.2e7;
    let day_s = (zenith_m / SPEED_OF_LIGHT_MPS - NIGHT_S).max(0.0);
    Klobuchar { alpha: [day_s, 0.0, 0.0, 0.0], beta: [YEAR_S, 0.0, 0.0, 0.0] }
}

/// Phase, in cycles, that right-handed circular polarisation adds as antennas turn, continued from
/// `previous_cycles`.
///
/// J. T. Wu et al. (1993), with the satellite's axes towards the Earth and across its motion;
/// `antenna_x` and `antenna_y` are the antenna's dipoles, right-handed about its upward axis.
pub(crate) fn wind_up_cycles(
    path: &Path,
    antenna_x: &Vector3<f64>,
    antenna_y: &Vector3<f64>,
    previous_cycles: f64,
) -> f64 {
    let towards = -path.line_of_sight;
    let down = -path.sender.position_m.normalize();
    // Against the stars: against the Earth a geostationary satellite does not move.
    let across = down.cross(&inertial_velocity_mps(&path.sender)).normalize();
    let along = across.cross(&down);
    // D = x − k (k·x) ± k × y
    let effective = |x: &Vector3<f64>, y: &Vector3<f64>, sign: f64| {
        x - towards * towards.dot(x) + towards.cross(y) * sign
    };
    let sender = effective(&along, &across, -1.0);
    let receiver = effective(antenna_x, antenna_y, 1.0);
    let angle = towards.dot(&sender.cross(&receiver)).atan2(sender.dot(&receiver));
    let cycles = angle / TAU;
    cycles + (previous_cycles - cycles).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(line_of_sight: Vector3<f64>) -> Path {
        let sender = Sender {
            position_m: Vector3::new(1e7, 2e7, 1.5e7),
            velocity_mps: Vector3::new(-2000.0, 1500.0, 1000.0),
            clock_s: 0.0,
            clock_drift: 0.0,
        };
        Path { range_m: 2e7, range_rate_mps: 0.0, line_of_sight, sender }
    }

    /// An antenna that turns once about the line of sight gains one cycle, and keeps it.
    #[test]
    fn a_full_turn_is_a_cycle() {
        let path = path(Vector3::new(0.0, 0.0, 1.0));
        let mut cycles = 0.0;
        let mut first = None;
        for k in 0..=720 {
            let (sin, cos) = (TAU * f64::from(k) / 720.0).sin_cos();
            let (x, y) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
            cycles = wind_up_cycles(&path, &x, &y, cycles);
            first.get_or_insert(cycles);
        }
        let gained = cycles - first.unwrap();
        assert!((gained.abs() - 1.0).abs() < 1e-9, "{gained}");
    }

    /// Klobuchar's model with the broadcast parameters says what the shell does, within the
    /// difference of their mappings.
    #[test]
    fn broadcast_parameters_belong_to_the_shell() {
        use kurs::atmosphere::klobuchar_m;
        let antenna = kurs::frames::Geodetic::from_degrees(55.0, 37.0, 200.0);
        let Klobuchar { alpha, beta } = broadcast_ionosphere(4.5);
        for hour in 0..24 {
            let time = kurs::time::GpsTime::from_week_tow(2305, 3600.0 * f64::from(hour)).unwrap();
            for elevation_deg in [10.0, 20.0, 45.0, 90.0] {
                let elevation_rad = f64::to_radians(elevation_deg);
                let direction = kurs::sky::SkyDirection::from_angles(1.0, elevation_rad);
                let modelled_m = klobuchar_m(&alpha, &beta, &antenna, &direction, time);
                let true_m = ionosphere_m(4.5, elevation_rad.sin());
                assert!((modelled_m / true_m - 1.0).abs() < 0.06, "{hour} h {elevation_deg}°");
            }
        }
    }

    #[test]
    fn delays_at_the_zenith_are_those_given() {
        assert!((troposphere_m(2.4, 0.0, 1.0) - 2.4).abs() < 1e-5);
        assert!((ionosphere_m(3.0, 1.0) - 3.0).abs() < 1e-12);
        // The shell mapping at 5 degrees is 3.0 (IS-GPS-200's F is 3.04).
        let low = ionosphere_m(1.0, 5f64.to_radians().sin());
        assert!((low - 3.04).abs() < 0.15, "{low}");
    }
}
