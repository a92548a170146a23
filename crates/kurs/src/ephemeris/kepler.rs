//! Broadcast orbits as disturbed Kepler ellipses: GPS and QZSS LNAV, Galileo I/NAV and F/NAV,
//! BeiDou D1 and D2.
//!
//! Sources: IS-GPS-200N table 20-IV and 20.3.3.3.3.1; Galileo OS SIS ICD 2.1, section 5.1;
//! BDS-SIS-ICD-B1I-3.0, table 5-11; IS-QZSS-PNT-005. The velocities are the derivatives of those
//! equations.

use nalgebra::{Rotation3, Vector3};

use super::SatelliteState;
use crate::frames::Vector;
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite, System};
use crate::time::GpsTime;

/// Gravitational constant of GPS and QZSS (IS-GPS-200N), m³/s².
const GM_GPS: f64 = 3.986_005e14;
/// Gravitational constant of Galileo and BeiDou (their ICDs), m³/s².
const GM_GALILEO_BEIDOU: f64 = 3.986_004_418e14;
/// Earth rotation rate of GPS, QZSS and Galileo, rad/s.
const EARTH_RATE_GPS: f64 = 7.292_115_146_7e-5;
/// Earth rotation rate of BeiDou (CGCS 2000), rad/s.
const EARTH_RATE_BEIDOU: f64 = 7.292_115e-5;
/// Newton steps for Kepler's equation: 6 suffice for e < 0.1, 20 for any e < 1.
const MAX_KEPLER_STEPS: usize = 20;
/// Inclination of the frame in which the orbits of BeiDou GEO satellites are given.
const BEIDOU_GEO_TILT_RAD: f64 = -5.0 * core::f64::consts::PI / 180.0;
/// 1-sigma where the message says that no accuracy is predicted.
const NO_ACCURACY_M: f64 = 500.0;

/// The message a broadcast ephemeris comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Message {
    /// GPS and QZSS legacy message; the clock is that of L1 P(Y) and L2 P(Y) (QZSS: L1 C/A and L2C)
    /// without ionosphere.
    Lnav,
    /// Galileo I/NAV; the clock is that of E1 and E5b without ionosphere.
    GalileoInav,
    /// Galileo F/NAV; the clock is that of E1 and E5a without ionosphere.
    GalileoFnav,
    /// BeiDou D1, from MEO and IGSO satellites; the clock is that of B3I.
    BeiDouD1,
    /// BeiDou D2, from GEO satellites; the clock is that of B3I.
    BeiDouD2,
    /// GLONASS; the clock is that of L1.
    GlonassFdma,
}

/// The contents of one broadcast record in SI units and radians, times on the GPS scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeplerElements {
    /// The satellite.
    pub satellite: Satellite,
    /// Where the record comes from.
    pub message: Message,
    /// Reference time of the orbit, tₒₑ.
    pub reference_time: GpsTime,
    /// Reference time of the clock, tₒ꜀.
    pub clock_reference_time: GpsTime,
    /// When the message was sent, as far as known (else the reference time).
    pub transmission_time: GpsTime,
    /// Issue of data (IODE, IODnav, AODE).
    pub issue: u16,
    /// Clock bias a_f0, s.
    pub clock_bias_s: f64,
    /// Clock drift a_f1, s/s.
    pub clock_drift: f64,
    /// Clock drift rate a_f2, 1/s.
    pub clock_drift_rate: f64,
    /// Square root of the semi-major axis, √m.
    pub sqrt_axis: f64,
    /// Eccentricity.
    pub eccentricity: f64,
    /// Mean anomaly at the reference time, M₀.
    pub mean_anomaly_rad: f64,
    /// Correction of the mean motion, Δn.
    pub mean_motion_correction_radps: f64,
    /// Argument of perigee, ω.
    pub perigee_rad: f64,
    /// Longitude of the ascending node at the start of the week, Ω₀.
    pub node_rad: f64,
    /// Rate of the ascending node, Ω̇.
    pub node_rate_radps: f64,
    /// Inclination at the reference time, i₀.
    pub inclination_rad: f64,
    /// Rate of the inclination.
    pub inclination_rate_radps: f64,
    /// Harmonics of the argument of latitude, C_uc and C_us.
    pub latitude_harmonics_rad: [f64; 2],
    /// Harmonics of the radius, C_rc and C_rs.
    pub radius_harmonics_m: [f64; 2],
    /// Harmonics of the inclination, C_ic and C_is.
    pub inclination_harmonics_rad: [f64; 2],
    /// TGD (GPS, QZSS); BGD E5a/E1 and BGD E5b/E1 (Galileo); TGD1 and TGD2 (BeiDou).
    pub group_delays_s: [f64; 2],
    /// Health word as RINEX prints it: zero is healthy.
    pub health: u16,
    /// Predicted range accuracy (URA, SISA); zero or negative if none is predicted.
    pub accuracy_m: f64,
    /// How long the curve fit is good, centred at the reference time; `None` if the message does
    /// not say.
    pub fit_interval_s: Option<f64>,
}

/// Why a record cannot be evaluated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{satellite}: {field} = {value} is not between {low} and {high}")]
pub struct BadEphemeris {
    /// The satellite of the record.
    pub satellite: Satellite,
    /// What is out of its range.
    pub field: &'static str,
    /// What was found.
    pub value: f64,
    /// The smallest value admitted.
    pub low: f64,
    /// The largest value admitted.
    pub high: f64,
}

/// Broadcast elements that were checked, so that they can be evaluated at any time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeplerEphemeris {
    elements: KeplerElements,
}

impl KeplerEphemeris {
    /// Checks the elements.
    ///
    /// The ranges are wider than what the messages can carry; what is outside of them is damage.
    ///
    /// # Errors
    ///
    /// [`BadEphemeris`] for the first element that is not a number or outside its range.
    pub fn new(elements: KeplerElements) -> Result<Self, BadEphemeris> {
        let e = &elements;
        let turn = 10.0;
        let ranges = [
            ("square root of the axis", e.sqrt_axis, 2_500.0, 8_192.0),
            ("eccentricity", e.eccentricity, 0.0, 0.999),
            symmetric("mean anomaly", e.mean_anomaly_rad, turn),
            symmetric("mean motion correction", e.mean_motion_correction_radps, 1e-6),
            symmetric("argument of perigee", e.perigee_rad, turn),
            symmetric("longitude of the node", e.node_rad, turn),
            symmetric("rate of the node", e.node_rate_radps, 1e-5),
            symmetric("inclination", e.inclination_rad, turn),
            symmetric("rate of the inclination", e.inclination_rate_radps, 1e-6),
            symmetric("Cuc", e.latitude_harmonics_rad[0], 0.1),
            symmetric("Cus", e.latitude_harmonics_rad[1], 0.1),
            symmetric("Crc", e.radius_harmonics_m[0], 1e5),
            symmetric("Crs", e.radius_harmonics_m[1], 1e5),
            symmetric("Cic", e.inclination_harmonics_rad[0], 0.1),
            symmetric("Cis", e.inclination_harmonics_rad[1], 0.1),
            symmetric("clock bias", e.clock_bias_s, 1.0),
            symmetric("clock drift", e.clock_drift, 1e-7),
            symmetric("clock drift rate", e.clock_drift_rate, 1e-12),
            symmetric("group delay", e.group_delays_s[0], 1e-5),
            symmetric("second group delay", e.group_delays_s[1], 1e-5),
            ("accuracy", e.accuracy_m, -1.0, 1e5),
            ("fit interval", e.fit_interval_s.unwrap_or(0.0), 0.0, 1e6),
            symmetric(
                "clock reference time minus orbit reference time",
                e.clock_reference_time - e.reference_time,
                7.0 * 86_400.0,
            ),
        ];
        check_ranges(e.satellite, ranges)?;
        Ok(Self { elements })
    }

    /// What was broadcast.
    #[must_use]
    pub const fn elements(&self) -> &KeplerElements {
        &self.elements
    }

    /// Position, velocity and clock at `time`.
    ///
    /// BeiDou GEO satellites are evaluated in their own frame, tilted by −5° and turned with the
    /// Earth since the reference time.
    #[must_use]
    pub fn state(&self, time: GpsTime) -> SatelliteState {
        let orbit = self.orbit(time - self.elements.reference_time);
        let (position, velocity) = if self.elements.satellite.is_beidou_geo() {
            self.earth_fixed_of_beidou_geo(&orbit)
        } else {
            self.earth_fixed(&orbit)
        };
        let (clock_s, clock_drift) = self.clock(&orbit, time);
        SatelliteState {
            position_m: Vector::from_xyz(position),
            velocity_mps: Vector::from_xyz(velocity),
            clock_s,
            clock_drift,
            sigma_m: self.sigma_m(),
        }
    }

    fn sigma_m(&self) -> f64 {
        let accuracy_m = self.elements.accuracy_m;
        if accuracy_m > 0.0 { accuracy_m } else { NO_ACCURACY_M }
    }

    fn gravitational_constant(&self) -> f64 {
        match self.elements.satellite.system {
            System::Galileo | System::BeiDou => GM_GALILEO_BEIDOU,
            _ => GM_GPS,
        }
    }

    fn earth_rate(&self) -> f64 {
        match self.elements.satellite.system {
            System::BeiDou => EARTH_RATE_BEIDOU,
            _ => EARTH_RATE_GPS,
        }
    }

    /// The place in the orbital plane and the plane's inclination, `since_s` after the reference.
    fn orbit(&self, since_s: f64) -> Orbit {
        let e = &self.elements;
        let eccentricity = e.eccentricity;
        let axis_m = e.sqrt_axis * e.sqrt_axis;
        // n = √(GM / A³) + Δn
        let mean_motion = (self.gravitational_constant() / axis_m.powi(3)).sqrt()
            + e.mean_motion_correction_radps;
        // M = M₀ + n tₖ
        let mean_anomaly = e.mean_anomaly_rad + mean_motion * since_s;
        let anomaly = eccentric_anomaly(mean_anomaly, eccentricity);
        let (sin_anomaly, cos_anomaly) = anomaly.sin_cos();
        // Ė = n / (1 − e cos E)
        let shrink = 1.0 - eccentricity * cos_anomaly;
        let anomaly_rate = mean_motion / shrink;
        // ν = atan2(√(1 − e²) sin E, cos E − e),   ν̇ = √(1 − e²) Ė / (1 − e cos E)
        let root = (1.0 - eccentricity * eccentricity).sqrt();
        let true_anomaly = (root * sin_anomaly).atan2(cos_anomaly - eccentricity);
        let true_anomaly_rate = root * anomaly_rate / shrink;

        // Harmonics of Φ = ν + ω:   δ = C_c cos 2Φ + C_s sin 2Φ
        let latitude = true_anomaly + e.perigee_rad;
        let (sin2, cos2) = (2.0 * latitude).sin_cos();
        let harmonic = |[cosine, sine]: [f64; 2]| cosine * cos2 + sine * sin2;
        let harmonic_rate =
            |[cosine, sine]: [f64; 2]| 2.0 * true_anomaly_rate * (sine * cos2 - cosine * sin2);
        Orbit {
            since_s,
            sin_anomaly,
            cos_anomaly,
            anomaly_rate,
            // u = Φ + δu,   r = A (1 − e cos E) + δr,   i = i₀ + δi + i̇ tₖ
            latitude_rad: latitude + harmonic(e.latitude_harmonics_rad),
            latitude_rate: true_anomaly_rate + harmonic_rate(e.latitude_harmonics_rad),
            radius_m: axis_m * shrink + harmonic(e.radius_harmonics_m),
            radius_rate: axis_m * eccentricity * sin_anomaly * anomaly_rate
                + harmonic_rate(e.radius_harmonics_m),
            inclination_rad: e.inclination_rad
                + harmonic(e.inclination_harmonics_rad)
                + e.inclination_rate_radps * since_s,
            inclination_rate: e.inclination_rate_radps + harmonic_rate(e.inclination_harmonics_rad),
        }
    }

    /// Position and velocity in the Earth-fixed axes.
    fn earth_fixed(&self, orbit: &Orbit) -> (Vector3<f64>, Vector3<f64>) {
        let e = &self.elements;
        // Ω = Ω₀ + (Ω̇ − ωₑ) tₖ − ωₑ tₒₑ
        let node_rate = e.node_rate_radps - self.earth_rate();
        let node = e.node_rad + node_rate * orbit.since_s
            - self.earth_rate() * self.seconds_of_week_of_reference();
        orbit.in_axes_of_node(node, node_rate)
    }

    /// Position and velocity of a BeiDou GEO satellite in the Earth-fixed axes.
    fn earth_fixed_of_beidou_geo(&self, orbit: &Orbit) -> (Vector3<f64>, Vector3<f64>) {
        let e = &self.elements;
        // Ω = Ω₀ + Ω̇ tₖ − ωₑ tₒₑ, then r = Rz(ωₑ tₖ) Rx(−5°) r'; the ICD's matrices turn axes,
        // so vectors turn by the opposite angles.
        let node = e.node_rad + e.node_rate_radps * orbit.since_s
            - self.earth_rate() * self.seconds_of_week_of_reference();
        let (position, velocity) = orbit.in_axes_of_node(node, e.node_rate_radps);
        let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), -BEIDOU_GEO_TILT_RAD);
        let turn =
            Rotation3::from_axis_angle(&Vector3::z_axis(), -self.earth_rate() * orbit.since_s);
        let fixed = turn * (tilt * position);
        // ṙ = Rz Rx ṙ' − ωₑ × r
        let earth = Vector3::new(0.0, 0.0, self.earth_rate());
        (fixed, turn * (tilt * velocity) - earth.cross(&fixed))
    }

    /// tₒₑ counted on the system's own scale, as Ω₀ is.
    fn seconds_of_week_of_reference(&self) -> f64 {
        let reference = self.elements.reference_time;
        match self.elements.satellite.system {
            System::BeiDou => (reference + -crate::time::GPST_MINUS_BDT_S).tow_s(),
            _ => reference.tow_s(),
        }
    }

    /// Clock offset and drift, with the relativistic effect.
    fn clock(&self, orbit: &Orbit, time: GpsTime) -> (f64, f64) {
        let e = &self.elements;
        // F = −2 √GM / c²,   Δt = a₀ + a₁ t + a₂ t² + F e √A sin E
        let relativistic = -2.0 * self.gravitational_constant().sqrt() / SPEED_OF_LIGHT_MPS.powi(2)
            * e.eccentricity
            * e.sqrt_axis;
        let since_s = time - e.clock_reference_time;
        let offset_s = e.clock_bias_s
            + since_s * (e.clock_drift + since_s * e.clock_drift_rate)
            + relativistic * orbit.sin_anomaly;
        let drift = e.clock_drift
            + 2.0 * since_s * e.clock_drift_rate
            + relativistic * orbit.cos_anomaly * orbit.anomaly_rate;
        (offset_s, drift)
    }
}

/// Name, value, smallest and largest value admitted.
type Range = (&'static str, f64, f64, f64);

pub(super) fn symmetric(field: &'static str, value: f64, limit: f64) -> Range {
    (field, value, -limit, limit)
}

/// The first value outside its range, or not a number, is an error.
pub(super) fn check_ranges(
    satellite: Satellite,
    ranges: impl IntoIterator<Item = Range>,
) -> Result<(), BadEphemeris> {
    match ranges.into_iter().find(|(_, value, low, high)| !(low..=high).contains(&value)) {
        Some((field, value, low, high)) => Err(BadEphemeris { satellite, field, value, low, high }),
        None => Ok(()),
    }
}

/// Where the satellite is in its orbital plane; angles in rad, rates per second.
struct Orbit {
    since_s: f64,
    sin_anomaly: f64,
    cos_anomaly: f64,
    anomaly_rate: f64,
    latitude_rad: f64,
    latitude_rate: f64,
    radius_m: f64,
    radius_rate: f64,
    inclination_rad: f64,
    inclination_rate: f64,
}

impl Orbit {
    /// Position and velocity in the axes in which the ascending node is at `node`.
    fn in_axes_of_node(&self, node: f64, node_rate: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (sin_u, cos_u) = self.latitude_rad.sin_cos();
        let (sin_i, cos_i) = self.inclination_rad.sin_cos();
        let (sin_node, cos_node) = node.sin_cos();
        // x' = r cos u,   y' = r sin u
        let (x, y) = (self.radius_m * cos_u, self.radius_m * sin_u);
        let x_rate = self.radius_rate * cos_u - y * self.latitude_rate;
        let y_rate = self.radius_rate * sin_u + x * self.latitude_rate;
        // r = Rz(Ω) (x', y' cos i, y' sin i)
        let position = Vector3::new(
            x * cos_node - y * cos_i * sin_node,
            x * sin_node + y * cos_i * cos_node,
            y * sin_i,
        );
        // d(y' cos i)/dt and d(y' sin i)/dt
        let flat_rate = y_rate * cos_i - y * sin_i * self.inclination_rate;
        let up_rate = y_rate * sin_i + y * cos_i * self.inclination_rate;
        let velocity = Vector3::new(
            x_rate * cos_node - flat_rate * sin_node - position.y * node_rate,
            x_rate * sin_node + flat_rate * cos_node + position.x * node_rate,
            up_rate,
        );
        (position, velocity)
    }
}

/// Solves Kepler's equation M = E − e sin E for E by Newton's method, `0 ≤ e < 1`.
///
/// The start E₀ = M + 0.85 e sgn(sin M) converges for every eccentricity (Danby, "The solution of
/// Kepler's equation III", 1987).
fn eccentric_anomaly(mean_anomaly: f64, eccentricity: f64) -> f64 {
    let mean_anomaly = mean_anomaly.rem_euclid(core::f64::consts::TAU);
    let mut anomaly = mean_anomaly + 0.85 * eccentricity * mean_anomaly.sin().signum();
    for _ in 0..MAX_KEPLER_STEPS {
        // E ← E − (E − e sin E − M) / (1 − e cos E)
        let excess = anomaly - eccentricity * anomaly.sin() - mean_anomaly;
        let step = excess / (1.0 - eccentricity * anomaly.cos());
        anomaly -= step;
        if step.abs() < 1e-14 {
            break;
        }
    }
    anomaly
}

#[cfg(test)]
mod tests {
    use super::super::sample::{beidou_geo, galileo, gps};
    use super::*;
    use proptest::prelude::*;

    fn ephemeris(elements: KeplerElements) -> KeplerEphemeris {
        KeplerEphemeris::new(elements).unwrap()
    }

    /// Positions and clocks that RTKLIB 2.4.3 (`eph2pos`, pyrtklib 0.2.7) computes from the same
    /// records, 2500 s after their reference times.
    #[test]
    fn as_rtklib_computes_it() {
        let cases = [
            (
                gps(),
                [26_465_625.336_18, 3_897_152.179_04, -1_272_861.898_69],
                -2.219_560_832_050_842e-4,
            ),
            (
                galileo(),
                [-2_613_909.048_6, 25_784_173.488_57, 14_279_974.783_83],
                5.738_391_091_318_106e-3,
            ),
            (
                beidou_geo(),
                [21_875_118.939_91, 36_011_951.330_05, -1_036_556.172_38],
                -5.163_528_900_853_255e-4,
            ),
        ];
        for (elements, [x, y, z], clock_s) in cases {
            let state = ephemeris(elements).state(elements.reference_time + 2500.0);
            let apart_m = (state.position_m - Vector::new(x, y, z)).norm();
            assert!(apart_m < 2e-5, "{}: {apart_m} m", elements.satellite);
            assert!((state.clock_s - clock_s).abs() < 1e-14, "{}", elements.satellite);
        }
    }

    #[test]
    fn velocity_and_drift_are_rates() {
        let eccentric = KeplerElements { eccentricity: 0.2, ..gps() };
        for elements in [gps(), galileo(), beidou_geo(), eccentric] {
            let ephemeris = ephemeris(elements);
            for age_s in [-7200.0, -10.0, 0.0, 1234.5, 7200.0] {
                let time = elements.reference_time + age_s;
                let at = |offset_s: f64| ephemeris.state(time + offset_s);
                let (after, now, before) = (at(0.5), at(0.0), at(-0.5));
                let apart = (after.position_m - before.position_m - now.velocity_mps).norm();
                assert!(apart < 1e-5, "{} {age_s}: {apart} m/s", elements.satellite);
                let drift = after.clock_s - before.clock_s;
                assert!((drift - now.clock_drift).abs() < 1e-17, "{drift}");
            }
        }
    }

    #[test]
    fn a_geostationary_satellite_nearly_stands() {
        let state = ephemeris(beidou_geo()).state(beidou_geo().reference_time + 600.0);
        assert!((state.position_m.norm() - 42_164e3).abs() < 50e3);
        assert!(state.velocity_mps.norm() < 200.0, "{}", state.velocity_mps.norm());
    }

    /// One orbit described from a reference time in the next week.
    #[test]
    fn the_week_boundary_is_crossed() {
        let saturday = GpsTime::from_week_tow(2111, 604_784.0).unwrap();
        let at = |reference_time| KeplerElements {
            reference_time,
            clock_reference_time: reference_time,
            transmission_time: reference_time,
            ..gps()
        };
        let before = ephemeris(at(saturday)).state(saturday + 3600.0);
        // Ω is counted from the start of the week: a week later the Earth has turned ωₑ · 604800 s.
        let sunday = saturday + crate::time::WEEK_S;
        let after = ephemeris(at(sunday)).state(sunday + 3600.0);
        assert!((before.position_m - after.position_m).norm() < 1e-6);
        let across = ephemeris(at(saturday));
        let step =
            across.state(saturday + 17.0).position_m - across.state(saturday + 15.0).position_m;
        let speed = across.state(saturday + 16.0).velocity_mps;
        assert!((step - speed * 2.0).norm() < 1e-4);
    }

    #[test]
    fn hostile_elements_are_refused() {
        let refuse = |change: fn(&mut KeplerElements)| {
            let mut elements = gps();
            change(&mut elements);
            KeplerEphemeris::new(elements).unwrap_err().field
        };
        assert_eq!(refuse(|e| e.sqrt_axis = 0.0), "square root of the axis");
        assert_eq!(refuse(|e| e.sqrt_axis = f64::NAN), "square root of the axis");
        assert_eq!(refuse(|e| e.eccentricity = 1.0), "eccentricity");
        assert_eq!(refuse(|e| e.eccentricity = -0.1), "eccentricity");
        assert_eq!(refuse(|e| e.mean_anomaly_rad = f64::INFINITY), "mean anomaly");
        assert_eq!(refuse(|e| e.radius_harmonics_m[1] = 1e300), "Crs");
        assert_eq!(refuse(|e| e.clock_bias_s = f64::NAN), "clock bias");
        assert_eq!(refuse(|e| e.clock_drift = 6.9e-5), "clock drift");
        assert_eq!(refuse(|e| e.accuracy_m = f64::NAN), "accuracy");
    }

    #[test]
    fn no_predicted_accuracy_is_a_poor_one() {
        let elements = KeplerElements { accuracy_m: -1.0, ..galileo() };
        assert_eq!(ephemeris(elements).state(elements.reference_time).sigma_m, NO_ACCURACY_M);
    }

    proptest! {
        #[test]
        fn keplers_equation_is_solved(mean in -1e4..1e4f64, eccentricity in 0.0..0.999f64) {
            let anomaly = eccentric_anomaly(mean, eccentricity);
            let turns = (anomaly - eccentricity * anomaly.sin() - mean) / core::f64::consts::TAU;
            prop_assert!((turns - turns.round()).abs() < 1e-11, "{turns}");
        }

        #[test]
        fn any_time_gives_a_finite_state(nanoseconds in any::<i64>()) {
            let state = ephemeris(gps()).state(GpsTime::from_nanoseconds(nanoseconds));
            prop_assert!(state.position_m.is_finite() && state.velocity_mps.is_finite());
            prop_assert!(state.clock_s.is_finite());
        }
    }
}
