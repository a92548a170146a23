//! Where the satellites stand in an antenna's sky, and how noisy their signals are there.

use nalgebra::{Matrix4, Vector4};

use crate::ephemeris::SatelliteState;
use crate::frames::{EARTH_RATE_RADPS, Ecef, Geodetic, Ned, Rotation, Vector, WGS84_A_M};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, System};

/// Rays that pass the Earth lower than this are bent and delayed too much to be used, m.
const ATMOSPHERE_M: f64 = 50e3;

/// A satellite as seen from an antenna at the instant of reception.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Satellite at transmission, in the Earth-fixed axes of the instant of reception, m.
    pub satellite_m: Vector<Ecef>,
    /// Its velocity in the same axes, m/s.
    pub velocity_mps: Vector<Ecef>,
    /// Unit vector from the antenna to the satellite.
    pub line_of_sight: Vector<Ecef>,
    /// Geometric distance, m.
    pub range_m: f64,
}

/// A direction in the local level axes of an antenna: a unit vector, as most of what depends on the direction
/// depends on its sines and cosines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SkyDirection(Vector<Ned>);

/// The horizon of an antenna: its geodetic coordinates and local level axes, computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Horizon {
    /// Where the antenna is.
    pub geodetic: Geodetic,
    ned_from_ecef: Rotation<Ned, Ecef>,
}

/// Dilution of precision: geometry factors, unweighted, no unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dop {
    /// Geometry (position and clock).
    pub gdop: f64,
    /// Position.
    pub pdop: f64,
    /// Horizontal.
    pub hdop: f64,
    /// Vertical.
    pub vdop: f64,
    /// Time.
    pub tdop: f64,
}

impl View {
    /// View of a satellite in `state` from an antenna at `antenna_m`.
    ///
    /// The state is in the Earth-fixed axes of the instant of transmission; while the signal
    /// travels for `τ = ρ / c` these axes turn by `Ω τ` about z.
    #[must_use]
    pub fn new(state: &SatelliteState, antenna_m: Vector<Ecef>) -> Self {
        let mut satellite_m = state.position_m;
        let mut turn_rad = 0.0;
        // ρ changes by < 1 µm after the second pass
        for _ in 0..2 {
            turn_rad = EARTH_RATE_RADPS * (satellite_m - antenna_m).norm() / SPEED_OF_LIGHT_MPS;
            satellite_m = turned(state.position_m, turn_rad);
        }
        let difference = satellite_m - antenna_m;
        let range_m = difference.norm();
        Self {
            satellite_m,
            velocity_mps: turned(state.velocity_mps, turn_rad),
            line_of_sight: difference * (1.0 / range_m),
            range_m,
        }
    }
}

/// Components after the axes have turned by a small angle about z.
fn turned(vector: Vector<Ecef>, angle_rad: f64) -> Vector<Ecef> {
    // Below 1e-5 rad the next terms of both series are lost in the last digit.
    let (sin, cos) = (angle_rad, 1.0 - 0.5 * angle_rad * angle_rad);
    let v = vector.xyz();
    Vector::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
}

impl SkyDirection {
    /// The direction of an azimuth, clockwise from north, and an elevation above the horizon.
    #[must_use]
    pub fn from_angles(azimuth_rad: f64, elevation_rad: f64) -> Self {
        let (sin_azimuth, cos_azimuth) = azimuth_rad.sin_cos();
        let (sin_elevation, cos_elevation) = elevation_rad.sin_cos();
        Self(Vector::new(cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, -sin_elevation))
    }

    /// Unit vector, north, east, down.
    #[must_use]
    pub const fn unit(&self) -> Vector<Ned> {
        self.0
    }

    /// Clockwise from north, (−π, π].
    #[must_use]
    pub fn azimuth_rad(&self) -> f64 {
        let ned = self.0.xyz();
        ned.y.atan2(ned.x)
    }

    /// Above the horizon.
    #[must_use]
    pub fn elevation_rad(&self) -> f64 {
        let ned = self.0.xyz();
        (-ned.z).atan2(ned.x.hypot(ned.y))
    }

    /// Sine of the elevation.
    #[must_use]
    pub fn sin_elevation(&self) -> f64 {
        -self.0.xyz().z
    }
}

impl Horizon {
    /// The horizon at an ECEF position (m).
    #[must_use]
    pub fn at(antenna_m: Vector<Ecef>) -> Self {
        let geodetic = Geodetic::from_ecef(antenna_m);
        Self { geodetic, ned_from_ecef: geodetic.ned_from_ecef() }
    }

    /// Rotation from ECEF to the local level axes.
    #[must_use]
    pub fn ned_from_ecef(&self) -> Rotation<Ned, Ecef> {
        self.ned_from_ecef
    }

    /// Where a line of sight (unit vector) stands in the sky.
    #[must_use]
    pub fn direction(&self, line_of_sight: Vector<Ecef>) -> SkyDirection {
        SkyDirection(self.ned_from_ecef * line_of_sight)
    }

    /// The lowest elevation at which signals are used: the mask, but for a body in space the edge
    /// of the Earth with its atmosphere, which stands below its horizon.
    #[must_use]
    pub fn lowest_elevation_rad(&self, mask_rad: f64) -> f64 {
        let radius_m = WGS84_A_M + self.geodetic.height_m;
        let edge_m = WGS84_A_M + ATMOSPHERE_M;
        if radius_m <= edge_m { mask_rad } else { -(edge_m / radius_m).acos() }
    }
}

impl Dop {
    /// From the lines of sight of the satellites used, `H = [−u 1]`, `(HᵀH)⁻¹` in local level axes;
    /// `None` for a singular geometry.
    pub fn new(
        lines_of_sight: impl Iterator<Item = Vector<Ecef>>,
        horizon: &Horizon,
    ) -> Option<Self> {
        let mut normal = Matrix4::<f64>::zeros();
        for line_of_sight in lines_of_sight {
            let ned = (horizon.ned_from_ecef * line_of_sight).xyz();
            let row = Vector4::new(-ned.x, -ned.y, -ned.z, 1.0);
            normal += row * row.transpose();
        }
        let q = normal.cholesky()?.inverse();
        let (horizontal, vertical, time) = (q[(0, 0)] + q[(1, 1)], q[(2, 2)], q[(3, 3)]);
        Some(Self {
            gdop: (horizontal + vertical + time).sqrt(),
            pdop: (horizontal + vertical).sqrt(),
            hdop: horizontal.sqrt(),
            vdop: vertical.sqrt(),
            tdop: time.sqrt(),
        })
    }
}

/// Variances of one undifferenced observation, as a function of elevation `E` and C/N0:
///
/// `σ_P² = σ_P0² / sin² E · 10^(d/10)`,   `σ_Φ² = σ_Φ0² ½ (1 + 1/sin² E) · 10^(d/20)`,
/// `d = max(0, C₀ − 10 (1 − sin E) − C/N0)`
///
/// with one zenith value for code and one for phase. Code multipath grows towards the horizon faster
/// than phase multipath, and code suffers more from weak signals. Every antenna receives less from
/// low satellites, by 10 dB at the horizon, so only what is missing beyond that tells of an obstacle;
/// where a receiver gives no C/N0 only the elevation counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Code at the zenith, m.
    pub code_zenith_m: f64,
    /// Carrier phase at the zenith, m.
    pub phase_zenith_m: f64,
    /// C/N0 of a satellite at the zenith above which noise does not shrink any more, dB-Hz.
    pub full_cn0_dbhz: f64,
    /// GLONASS: standard deviation of a receiver's phase bias for each step of the frequency
    /// channel, against the other receivers, m. Receivers of one kind have none, mixed ones some
    /// centimetres (Wanninger 2012).
    pub channel_sd_m: f64,
}

/// Loss of antenna gain from zenith to horizon, dB: 9 to 10 on L1 and E1 of geodetic antennas.
pub(crate) const LOSS_AT_HORIZON_DB: f64 = 10.0;
/// Standard deviation with which code determines the cycles common to all phases of a receiver.
const COMMON_CYCLES_BY_CODE: f64 = 3.0;
/// Sine of 5°: below, the 1/sin law has no measured support; it also must not reach zero.
pub(crate) const MIN_SIN_ELEVATION: f64 = 0.087;
/// Steps of the GLONASS channel in the carrier frequency of channel 0, on both bands (1602 MHz over
/// 0.5625 MHz).
const GLONASS_STEPS: f64 = 2848.0;

/// Variances of code (m²) and phase (m²) of one observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variances {
    /// Code, m².
    pub code_m2: f64,
    /// Carrier phase, m².
    pub phase_m2: f64,
}

impl NoiseModel {
    /// Standard deviation of the cycles common to all phases of a receiver, for a wavelength.
    ///
    /// A bias `β` for each step of the channel is the same as `n = 2848 β / λ` cycles in every phase:
    /// the wavelengths of two channels differ by `λ / 2848` for each step between them.
    #[must_use]
    pub fn common_cycles(&self, wavelength_m: f64) -> f64 {
        COMMON_CYCLES_BY_CODE.hypot(GLONASS_STEPS * self.channel_sd_m / wavelength_m)
    }

    /// Variances of an observation of `band` from an elevation with this sine and C/N0.
    #[must_use]
    pub fn variances(&self, band: Band, sin_elevation: f64, cn0_dbhz: Option<f64>) -> Variances {
        let full_dbhz = self.full_cn0_dbhz - LOSS_AT_HORIZON_DB * (1.0 - sin_elevation);
        let missing_db = cn0_dbhz.map_or(0.0, |cn0| (full_dbhz - cn0).clamp(0.0, 25.0));
        let weak = if missing_db > 0.0 { 10f64.powf(missing_db / 20.0) } else { 1.0 };
        let sin_elevation = sin_elevation.max(MIN_SIN_ELEVATION);
        let low = 1.0 / (sin_elevation * sin_elevation);
        let code = code_factor(band) * self.code_zenith_m;
        Variances {
            code_m2: code * code * low * weak * weak,
            phase_m2: self.phase_zenith_m * self.phase_zenith_m * 0.5 * (1.0 + low) * weak,
        }
    }
}

/// Code noise of a band against GPS L1 C/A: GLONASS FDMA code has half the chip rate.
fn code_factor(band: Band) -> f64 {
    match band.system {
        System::Glonass => 2.0,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::SatelliteState;

    fn overhead() -> SatelliteState {
        SatelliteState {
            position_m: Vector::new(26_560e3, 0.0, 0.0),
            velocity_mps: Vector::new(0.0, 3_000.0, 0.0),
            clock_s: 0.0,
            clock_drift: 0.0,
            sigma_m: 2.0,
        }
    }

    /// On the equator a signal from the zenith travels for 67 ms; the antenna moves 31 m east in
    /// that time, so in the axes of reception the satellite stands 130 m west of the zenith.
    #[test]
    fn earth_turns_while_the_signal_travels() {
        let antenna_m = Vector::new(6_378_137.0, 0.0, 0.0);
        let view = View::new(&overhead(), antenna_m);
        let travel_s = (26_560e3 - 6_378_137.0) / SPEED_OF_LIGHT_MPS;
        let expected_m = -EARTH_RATE_RADPS * travel_s * 26_560e3;
        assert!((view.satellite_m.xyz().y - expected_m).abs() < 1e-3);
        assert!((expected_m + 130.4).abs() < 0.1);
    }

    #[test]
    fn directions_in_the_sky() {
        let horizon = Horizon::at(Geodetic::from_degrees(50.0, 10.0, 0.0).to_ecef());
        let ecef_from_ned = horizon.geodetic.ecef_from_ned();
        let up = horizon.direction(ecef_from_ned * Vector::new(0.0, 0.0, -1.0));
        assert!((up.elevation_rad().to_degrees() - 90.0).abs() < 1e-6);
        let east = horizon.direction(ecef_from_ned * Vector::new(0.0, 1.0, 0.0));
        assert!((east.azimuth_rad().to_degrees() - 90.0).abs() < 1e-12);
        assert!(east.elevation_rad().abs() < 1e-12);
    }

    /// Four satellites: one at the zenith, three on the horizon 120° apart. By hand:
    /// HᵀH = diag(1.5, 1.5) for the horizontal, [[1, 1], [1, 4]] for up and clock.
    #[test]
    fn dop_of_a_known_sky() {
        let horizon = Horizon::at(Geodetic::from_degrees(0.0, 0.0, 0.0).to_ecef());
        let ecef_from_ned = horizon.geodetic.ecef_from_ned();
        let third = std::f64::consts::TAU / 3.0;
        let mut sky = vec![ecef_from_ned * Vector::new(0.0, 0.0, -1.0)];
        sky.extend((0..3).map(|i| {
            let azimuth = third * f64::from(i);
            ecef_from_ned * Vector::new(azimuth.cos(), azimuth.sin(), 0.0)
        }));
        let dop = Dop::new(sky.into_iter(), &horizon).unwrap();
        assert!((dop.hdop - (4.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((dop.vdop - (4.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((dop.tdop - (1.0f64 / 3.0).sqrt()).abs() < 1e-12);
        let two = [Vector::new(1.0, 0.0, 0.0); 2];
        assert_eq!(Dop::new(two.into_iter(), &horizon), None);
    }

    #[test]
    fn noise_grows_towards_the_horizon_and_with_weak_signals() {
        let model = NoiseModel {
            code_zenith_m: 0.3,
            phase_zenith_m: 0.002,
            full_cn0_dbhz: 45.0,
            channel_sd_m: 0.0,
        };
        let l1 = Band::new(System::Gps, 1);
        let variances = |el: f64, cn0| model.variances(l1, el.to_radians().sin(), cn0);
        let at = |el: f64, cn0| variances(el, cn0).code_m2.sqrt();
        assert!((at(90.0, None) - 0.3).abs() < 1e-12);
        assert!((at(30.0, Some(50.0)) - 0.6).abs() < 1e-12);
        assert!((at(90.0, Some(35.0)) - 0.3 * 10f64.sqrt()).abs() < 1e-12);
        let phase = |el: f64, cn0| variances(el, cn0).phase_m2.sqrt();
        assert!((phase(30.0, None) - 0.002 * 2.5f64.sqrt()).abs() < 1e-12);
        assert!((phase(90.0, Some(25.0)) - 0.002 * 10f64.sqrt()).abs() < 1e-12);
    }
}
