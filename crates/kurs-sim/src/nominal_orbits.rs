//! Built-in constellations, written as the broadcast ephemerides that receivers would decode.
//!
//! The orbits are undisturbed ellipses of the nominal constellations with harmonic corrections of
//! realistic size, so that every term of the user algorithm is exercised. Records of one satellite
//! describe one and the same orbit, whatever their reference time.

use core::f64::consts::{PI, TAU};

use kurs::ephemeris::{
    BadEphemeris, Ephemeris, GlonassElements, GlonassEphemeris, KeplerElements, KeplerEphemeris,
    Message, NavigationData,
};
use kurs::frames::Vector;
use kurs::signal::{Satellite, System};
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};
use nalgebra::{Rotation3, Vector3};

use crate::noise::Noise;
use crate::walker::GM_M3PS2;

/// Earth rotation of the ICDs of GPS, Galileo and QZSS, and of BeiDou, rad/s.
const EARTH_RATE_GPS: f64 = 7.292_115_146_7e-5;
const EARTH_RATE_BEIDOU: f64 = 7.292_115e-5;
/// Gravitational constant of GPS and QZSS, m³/s².
const GM_GPS: f64 = 3.986_005e14;
/// Semi-major axis of orbits that take a sidereal day.
const GEOSYNCHRONOUS_AXIS_M: f64 = 42_164_170.0;
/// BeiDou GEO orbits are described in a frame tilted by five degrees.
const GEO_TILT_RAD: f64 = 5.0 * PI / 180.0;
/// Frequency channels of GLONASS slots 1 to 24, as in use since 2010.
const GLONASS_CHANNELS: [i8; 24] =
    [1, -4, 5, 6, 1, -4, 5, 6, -2, -7, 0, -1, -2, -7, 0, -1, 4, -3, 3, 2, 4, -3, 3, 2];
const BEIDOU_MEO_NUMBERS: [u8; 24] = [
    19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 32, 33, 34, 35, 36, 37, 41, 42, 43, 44, 45, 46,
];
const HOUR_S: f64 = 3600.0;

/// An orbit of a constellation at the start of the week of the scenario.
#[derive(Debug, Clone, Copy)]
struct Orbit {
    satellite: Satellite,
    message: Message,
    axis_m: f64,
    eccentricity: f64,
    inclination_rad: f64,
    perigee_rad: f64,
    /// Longitude of the node against the Earth, and mean anomaly.
    node_rad: f64,
    mean_anomaly_rad: f64,
    /// Constant longitude of a geostationary satellite.
    geostationary_rad: Option<f64>,
}

/// What the clock of a satellite does.
#[derive(Debug, Clone, Copy)]
struct SatelliteClock {
    bias_s: f64,
    drift: f64,
    group_delays_s: [f64; 2],
}

/// Ephemerides of the nominal constellations of these systems for a time.
///
/// # Errors
///
/// [`BadEphemeris`] never for the constellations as they stand; the check is that of every record.
pub fn navigation(
    systems: &[System],
    start: GpsTime,
    duration_s: f64,
    noise: &mut Noise,
) -> Result<NavigationData, BadEphemeris> {
    let mut data =
        NavigationData { leap_seconds: Some(start.leap_seconds()), ..Default::default() };
    for orbit in systems.iter().flat_map(|system| constellation(*system)) {
        let clock = SatelliteClock {
            bias_s: noise.normal(1e-4),
            drift: noise.normal(2e-12),
            group_delays_s: [noise.normal(4e-9), noise.normal(4e-9)],
        };
        if orbit.satellite.system == System::Glonass {
            insert_glonass(&mut data, &orbit, &clock, start, duration_s)?;
        } else {
            insert_kepler(&mut data, &orbit, &clock, start, duration_s)?;
        }
    }
    Ok(data)
}

/// The orbits of a system; none for systems without built-in ones.
fn constellation(system: System) -> Vec<Orbit> {
    match system {
        System::Gps => walker(system, 26_559_800.0, 55.0, [6, 4, 1], 12.0, &GPS_NUMBERS),
        System::Galileo => walker(system, 29_600_318.0, 56.0, [3, 8, 1], 40.0, &GALILEO_NUMBERS),
        System::Glonass => walker(system, 25_508_200.0, 64.8, [3, 8, 1], 95.0, &GLONASS_SLOTS),
        System::BeiDou => {
            let mut all = walker(system, 27_906_100.0, 55.0, [3, 8, 1], 20.0, &BEIDOU_MEO_NUMBERS);
            all.extend(
                [(59, 140.0), (60, 80.0), (61, 110.5)].map(|(n, deg)| geostationary(n, deg)),
            );
            all.extend([38, 39, 40].map(|number| {
                let satellite = Satellite::new(system, number);
                geosynchronous(satellite, 118.0, f64::from(number - 38) / 3.0, (0.003, 0.0), 55.0)
            }));
            all
        }
        System::Qzss => (1..=4)
            .map(|number| {
                let satellite = Satellite::new(system, number);
                let place = f64::from(number - 1) / 4.0;
                geosynchronous(satellite, 136.0, place, (0.075, 270.0), 41.0)
            })
            .collect(),
        System::NavIc | System::Sbas => Vec::new(),
    }
}

const GPS_NUMBERS: [u8; 24] = numbers(1);
const GALILEO_NUMBERS: [u8; 24] = numbers(1);
const GLONASS_SLOTS: [u8; 24] = numbers(1);

const fn numbers(first: u8) -> [u8; 24] {
    let mut all = [0; 24];
    let mut k = 0;
    while k < 24 {
        all[k as usize] = first + k;
        k += 1;
    }
    all
}

const fn message(satellite: Satellite) -> Message {
    match satellite.system {
        System::Galileo => Message::GalileoInav,
        System::BeiDou if satellite.is_beidou_geo() => Message::BeiDouD2,
        System::BeiDou => Message::BeiDouD1,
        System::Glonass => Message::GlonassFdma,
        _ => Message::Lnav,
    }
}

/// A Walker constellation of `[planes, satellites in each, phasing]`.
fn walker(
    system: System,
    axis_m: f64,
    inclination_deg: f64,
    [planes, per_plane, phasing]: [u8; 3],
    first_node_deg: f64,
    numbers: &[u8; 24],
) -> Vec<Orbit> {
    let share = |part: u8, whole: u8| TAU * f64::from(part) / f64::from(whole);
    let place = |(k, number): (u8, &u8)| {
        let (plane, slot) = (k / per_plane, k % per_plane);
        let satellite = Satellite::new(system, *number);
        Orbit {
            satellite,
            message: message(satellite),
            axis_m,
            // Between 0.001 and 0.012, different for neighbours: relativity must not cancel.
            eccentricity: 0.001 + 0.001 * f64::from(u16::from(*number) * 7 % 12),
            inclination_rad: inclination_deg.to_radians(),
            perigee_rad: TAU * f64::from(u16::from(*number) * 5 % 24) / 24.0,
            node_rad: first_node_deg.to_radians() + share(plane, planes),
            mean_anomaly_rad: share(slot, per_plane) + share(plane * phasing, planes * per_plane),
            geostationary_rad: None,
        }
    };
    (0..).zip(numbers).map(place).collect()
}

/// An inclined orbit of one sidereal day whose ground track crosses the equator northwards at a
/// longitude; `place` is the share of the day by which it is ahead.
fn geosynchronous(
    satellite: Satellite,
    longitude_deg: f64,
    place: f64,
    (eccentricity, perigee_deg): (f64, f64),
    inclination_deg: f64,
) -> Orbit {
    let (mean_anomaly_rad, perigee_rad) = (TAU * place, f64::to_radians(perigee_deg));
    Orbit {
        satellite,
        message: message(satellite),
        axis_m: GEOSYNCHRONOUS_AXIS_M,
        eccentricity,
        inclination_rad: inclination_deg.to_radians(),
        perigee_rad,
        // Node and argument of latitude turn against each other: their sum is the longitude.
        node_rad: longitude_deg.to_radians() - mean_anomaly_rad - perigee_rad,
        mean_anomaly_rad,
        geostationary_rad: None,
    }
}

fn geostationary(number: u8, longitude_deg: f64) -> Orbit {
    let satellite = Satellite::new(System::BeiDou, number);
    Orbit {
        geostationary_rad: Some(longitude_deg.to_radians()),
        ..geosynchronous(satellite, longitude_deg, 0.0, (0.0, 0.0), 5.0)
    }
}

/// Records every hour (BeiDou) or two, enough to stay inside the age of each.
fn insert_kepler(
    data: &mut NavigationData,
    orbit: &Orbit,
    clock: &SatelliteClock,
    start: GpsTime,
    duration_s: f64,
) -> Result<(), BadEphemeris> {
    let (own_s, step_s) = match orbit.satellite.system {
        System::BeiDou => (GPST_MINUS_BDT_S, HOUR_S),
        _ => (0.0, 2.0 * HOUR_S),
    };
    let week_start = start + -start.tow_s();
    let grid = |time_s: f64| own_s + step_s * ((time_s - own_s) / step_s).round();
    let (mut reference_s, last_s) = (grid(start.tow_s()), grid(start.tow_s() + duration_s));
    while reference_s <= last_s {
        let elements = kepler_elements(orbit, clock, week_start, reference_s);
        data.ephemerides.insert(Ephemeris::Kepler(KeplerEphemeris::new(elements)?));
        reference_s += step_s;
    }
    Ok(())
}

/// The record with its reference time `reference_s` after the start of the week.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // an issue is below 240
fn kepler_elements(
    orbit: &Orbit,
    clock: &SatelliteClock,
    week_start: GpsTime,
    reference_s: f64,
) -> KeplerElements {
    let system = orbit.satellite.system;
    let is_beidou = system == System::BeiDou;
    let earth_rate = if is_beidou { EARTH_RATE_BEIDOU } else { EARTH_RATE_GPS };
    let gm = match system {
        System::Galileo | System::BeiDou => GM_M3PS2,
        _ => GM_GPS,
    };
    let reference_time = week_start + reference_s;
    let own_week_s = if is_beidou {
        (reference_time + -GPST_MINUS_BDT_S).tow_s()
    } else {
        reference_time.tow_s()
    };
    let free_motion = (gm / orbit.axis_m.powi(3)).sqrt();
    let synchronous = orbit.axis_m == GEOSYNCHRONOUS_AXIS_M;
    let mean_motion = if synchronous { earth_rate } else { free_motion };
    // Ω at the reference time against the Earth is Ω₀ − ωₑ tₒₑ (GEO: the frame stands still).
    let (node_rad, perigee_rad, mean_anomaly_rad) = match orbit.geostationary_rad {
        // In the frame tilted by 5° about its x axis the node of the equator is at 180°.
        Some(longitude_rad) => (PI + earth_rate * own_week_s, 0.0, longitude_rad - PI),
        None => (
            orbit.node_rad + earth_rate * (own_week_s - reference_s),
            orbit.perigee_rad,
            orbit.mean_anomaly_rad + mean_motion * reference_s,
        ),
    };
    let disturbed = orbit.geostationary_rad.is_none();
    let harmonic = |size: f64| if disturbed { [size, -0.7 * size] } else { [0.0; 2] };
    KeplerElements {
        satellite: orbit.satellite,
        message: orbit.message,
        reference_time,
        clock_reference_time: reference_time,
        transmission_time: reference_time + -HOUR_S / 2.0,
        issue: (reference_s / HOUR_S).rem_euclid(issues(system)) as u16,
        clock_bias_s: clock.bias_s + clock.drift * reference_s,
        clock_drift: clock.drift,
        clock_drift_rate: 0.0,
        sqrt_axis: orbit.axis_m.sqrt(),
        eccentricity: orbit.eccentricity,
        mean_anomaly_rad: wrapped(mean_anomaly_rad),
        mean_motion_correction_radps: mean_motion - free_motion,
        perigee_rad: wrapped(perigee_rad),
        node_rad: wrapped(node_rad),
        node_rate_radps: 0.0,
        inclination_rad: if disturbed { orbit.inclination_rad } else { GEO_TILT_RAD },
        inclination_rate_radps: 0.0,
        latitude_harmonics_rad: harmonic(3e-6),
        radius_harmonics_m: harmonic(80.0),
        inclination_harmonics_rad: harmonic(4e-8),
        group_delays_s: match system {
            System::Gps | System::Qzss => [clock.group_delays_s[0], 0.0],
            _ => clock.group_delays_s,
        },
        health: 0,
        accuracy_m: 2.0,
        fit_interval_s: (orbit.message == Message::Lnav).then_some(4.0 * HOUR_S),
    }
}

/// Issues of data differ from record to record, and fit the messages: eight bits of GPS (IODE), five
/// of BeiDou (AODE, which is the age in hours up to 24).
const fn issues(system: System) -> f64 {
    match system {
        System::BeiDou => 24.0,
        _ => 240.0,
    }
}

fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

/// Records every half hour, at 15 and 45 minutes of UTC; each continues the orbit of the one before.
fn insert_glonass(
    data: &mut NavigationData,
    orbit: &Orbit,
    clock: &SatelliteClock,
    start: GpsTime,
    duration_s: f64,
) -> Result<(), BadEphemeris> {
    const STEP_S: f64 = HOUR_S / 2.0;
    let week_start = start + -start.tow_s();
    // A leap second moves the quarters of UTC against GPST.
    let on_gpst_s = |utc_s: f64| utc_s + f64::from((week_start + utc_s).leap_seconds());
    let start_utc_s = start.tow_s() - f64::from(start.leap_seconds());
    let mut reference_utc_s =
        ((start_utc_s - STEP_S / 2.0) / STEP_S).round() * STEP_S + STEP_S / 2.0;
    let mut reference_s = on_gpst_s(reference_utc_s);
    let (mut position_m, mut velocity_mps) = circular(orbit, reference_s);
    loop {
        let elements = GlonassElements {
            satellite: orbit.satellite,
            reference_time: week_start + reference_s,
            transmission_time: week_start + (reference_s - STEP_S / 2.0),
            clock_bias_s: clock.bias_s + clock.drift * reference_s,
            clock_drift: clock.drift,
            position_m,
            velocity_mps,
            acceleration_mps2: Vector::new(0.0, 0.0, 0.0),
            channel: GLONASS_CHANNELS[usize::from(orbit.satellite.number - 1) % 24],
            l2_delay_s: Some(clock.group_delays_s[0]),
            health: 0,
            accuracy_m: 5.0,
        };
        let record = GlonassEphemeris::new(elements)?;
        data.ephemerides.insert(Ephemeris::Glonass(record));
        if reference_s + STEP_S / 2.0 > start.tow_s() + duration_s {
            return Ok(());
        }
        reference_utc_s += STEP_S;
        reference_s = on_gpst_s(reference_utc_s);
        let Some(next) = record.state(week_start + reference_s) else { return Ok(()) };
        (position_m, velocity_mps) = (next.position_m, next.velocity_mps);
    }
}

/// Position and velocity, against the Earth, on the circular orbit.
fn circular(
    orbit: &Orbit,
    time_s: f64,
) -> (Vector<kurs::frames::Ecef>, Vector<kurs::frames::Ecef>) {
    let rate = (GM_M3PS2 / orbit.axis_m.powi(3)).sqrt();
    let u = orbit.mean_anomaly_rad + rate * time_s;
    let node = orbit.node_rad - EARTH_RATE_BEIDOU * time_s;
    let plane = Rotation3::from_axis_angle(&Vector3::z_axis(), node)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), orbit.inclination_rad);
    let position = plane * Vector3::new(u.cos(), u.sin(), 0.0) * orbit.axis_m;
    let inertial = plane * Vector3::new(-u.sin(), u.cos(), 0.0) * (orbit.axis_m * rate);
    let earth = Vector3::new(0.0, 0.0, EARTH_RATE_BEIDOU);
    (Vector::from_xyz(position), Vector::from_xyz(inertial - earth.cross(&position)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Geodetic;

    const ALL: [System; 5] =
        [System::Gps, System::Glonass, System::Galileo, System::BeiDou, System::Qzss];

    fn data(start: GpsTime, duration_s: f64) -> NavigationData {
        navigation(&ALL, start, duration_s, &mut Noise::seeded(3)).unwrap()
    }

    /// Two records of one satellite describe one orbit and one clock, also across the week's end.
    #[test]
    fn records_of_a_satellite_agree() {
        for tow_s in [40_000.0, 604_000.0] {
            let start = GpsTime::from_week_tow(2305, tow_s).unwrap();
            let data = data(start, 4.0 * HOUR_S);
            let records: Vec<_> = data.ephemerides.iter().collect();
            let mut compared = 0;
            for pair in records.windows(2).filter(|p| p[0].satellite() == p[1].satellite()) {
                let apart_s = pair[1].reference_time() - pair[0].reference_time();
                let middle = pair[0].reference_time() + apart_s / 2.0;
                let (before, after) =
                    (pair[0].state(middle).unwrap(), pair[1].state(middle).unwrap());
                let apart_m = (before.position_m - after.position_m).norm();
                assert!(apart_m < 2e-3, "{}: {apart_m} m", pair[0].satellite());
                assert!((before.clock_s - after.clock_s).abs() < 1e-14);
                compared += 1;
            }
            assert!(compared > 200, "{compared}");
        }
    }

    #[test]
    fn geostationary_satellites_stay_where_they_are() {
        let start = GpsTime::from_week_tow(2305, 40_000.0).unwrap();
        let data = data(start, 6.0 * HOUR_S);
        for (number, longitude_deg) in [(59, 140.0), (60, 80.0), (61, 110.5)] {
            let satellite = Satellite::new(System::BeiDou, number);
            for hour in 0..=6 {
                let state = data.ephemerides.state(satellite, start + f64::from(hour) * HOUR_S);
                let state = state.unwrap();
                let place = Geodetic::from_ecef(state.position_m);
                let off_deg = place.longitude_rad.to_degrees() - longitude_deg;
                assert!(off_deg.abs() < 0.01, "{satellite}: {off_deg} degrees");
                assert!(place.latitude_rad.to_degrees().abs() < 0.01, "{satellite}");
                assert!(state.velocity_mps.norm() < 1.0, "{satellite}: {:?}", state.velocity_mps);
            }
        }
    }

    /// Inclined geosynchronous satellites stay within their figure of eight.
    #[test]
    fn geosynchronous_satellites_stay_over_their_longitude() {
        let start = GpsTime::from_week_tow(2305, 40_000.0).unwrap();
        let data = data(start, 24.0 * HOUR_S);
        for (name, longitude_deg) in
            [("C38", 118.0), ("C40", 118.0), ("J01", 136.0), ("J04", 136.0)]
        {
            for hour in 0..=24 {
                let time = start + f64::from(hour) * HOUR_S;
                let state = data.ephemerides.state(name.parse().unwrap(), time).unwrap();
                let longitude = Geodetic::from_ecef(state.position_m).longitude_rad.to_degrees();
                assert!((longitude - longitude_deg).abs() < 30.0, "{name} {hour}: {longitude}");
            }
        }
    }
}
