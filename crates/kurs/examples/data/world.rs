//! Observations of the antennas of a body under the satellites of the recording, by a measurement equation of
//! their own, so that a wrong sign in the library cannot cancel itself:
//!
//! `P = |R(Ω τ) s(t − τ) − x| + c (b − bₛ) + e_P`,   `λ Φ = the same + λ N + e_Φ`,   `−λ D = d/dt` of it
//!
//! (`t` true time of reception, `τ` travel time, `s`, `bₛ` the satellite and its clock, `x`, `b` those of the
//! antenna, `N` whole cycles that stay the same). There is no atmosphere.
#![allow(dead_code)] // every user needs a part

use std::error::Error;

use kurs::ephemeris::{KeplerElements, KeplerEphemeris};
use kurs::observation::{AntennaEpoch, ArrayEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::{Attitude, Body, Ecef, Geodetic, GpsTime, NavigationData, Ned, Vector};

use crate::recording;

const LIGHT_MPS: f64 = 299_792_458.0;
const EARTH_RATE_RADPS: f64 = 7.292_115_146_7e-5;
/// Half the step of the central difference for Doppler shifts, s.
const HALF_STEP_S: f64 = 0.05;

/// The sky of the recording and its noise.
pub(crate) struct World {
    satellites: Vec<(Satellite, KeplerEphemeris)>,
    pub(crate) navigation: NavigationData,
    pub(crate) signals: Vec<Signal>,
    /// Satellites below are not received.
    pub(crate) mask_rad: f64,
    pub(crate) code_sd_m: f64,
    pub(crate) phase_sd_m: f64,
    /// Of a range rate.
    pub(crate) doppler_sd_mps: f64,
    random: u64,
}

/// A body that keeps its attitude and velocity.
pub(crate) struct Motion {
    /// Where its origin is at `start`.
    pub(crate) place: Geodetic,
    pub(crate) start: GpsTime,
    pub(crate) velocity_mps: Vector<Ned>,
    pub(crate) attitude: Attitude,
    pub(crate) antennas_m: Vec<Vector<Body>>,
}

impl World {
    /// Single-band GPS and Galileo.
    pub(crate) fn new() -> Result<Self, Box<dyn Error>> {
        Self::of(&recording::orbits()?)
    }

    /// Under other orbits.
    pub(crate) fn of(orbits: &[KeplerElements]) -> Result<Self, Box<dyn Error>> {
        let orbits: Vec<KeplerElements> = orbits
            .iter()
            .map(|elements| KeplerElements { group_delays_s: [0.0; 2], ..*elements })
            .collect();
        let named =
            |elements: &KeplerElements| Ok((elements.satellite, KeplerEphemeris::new(*elements)?));
        Ok(Self {
            satellites: orbits.iter().map(named).collect::<Result<_, Box<dyn Error>>>()?,
            navigation: recording::navigation(&orbits)?,
            signals: vec!["G1C".parse()?, "E1C".parse()?],
            mask_rad: 12f64.to_radians(),
            code_sd_m: 0.2,
            phase_sd_m: 0.0015,
            doppler_sd_mps: 0.01,
            random: 1,
        })
    }

    /// Other errors of the observations.
    pub(crate) fn with_seed(mut self, seed: u64) -> Self {
        self.random = 2 * seed + 1;
        self
    }

    /// What all antennas of the body measure so many seconds after its start.
    pub(crate) fn epoch(&mut self, body: &Motion, after_s: f64) -> ArrayEpoch {
        let time = body.start + after_s;
        let antennas = (0..body.antennas_m.len()).map(|k| Some(self.antenna(body, k, time)));
        ArrayEpoch { time, antennas: antennas.collect(), station: None }
    }

    /// One antenna at `tag` by its own clock, which is up to a third of a millisecond fast.
    fn antenna(&mut self, body: &Motion, antenna: usize, tag: GpsTime) -> AntennaEpoch {
        let clock_s = 1e-4 * (antenna % 4) as f64;
        let received = tag + -clock_s;
        let mut observations = Vec::new();
        for (satellite, orbit) in self.satellites.clone() {
            let antenna_m = body.antenna_m(antenna, received);
            let horizon = kurs::sky::Horizon::at(antenna_m);
            let line_of_sight = path(&orbit, antenna_m, received).direction();
            let elevation_rad = horizon.direction(line_of_sight).elevation_rad();
            if elevation_rad < self.mask_rad {
                continue;
            }
            let range_m = |time: GpsTime| {
                let path = path(&orbit, body.antenna_m(antenna, time), time);
                let sent = time + -path.norm() / LIGHT_MPS;
                path.norm() + LIGHT_MPS * (clock_s - orbit.state(sent).clock_s)
            };
            let later_m = range_m(received + HALF_STEP_S);
            let rate_mps = (later_m - range_m(received + -HALF_STEP_S)) / (2.0 * HALF_STEP_S);
            let low = 1.0 / elevation_rad.sin();
            for signal in self.signals.clone() {
                let wavelength_m = signal.band.wavelength_m(None);
                let Some(wavelength_m) =
                    wavelength_m.filter(|_| signal.band.system == satellite.system)
                else {
                    continue;
                };
                let code_m = range_m(received) + self.code_sd_m * low * self.normal();
                let phase_m = range_m(received) + self.phase_sd_m * self.normal();
                let cycles = whole_cycles(antenna, satellite, signal);
                observations.push(Observation {
                    satellite,
                    signal,
                    pseudorange_m: Some(code_m),
                    phase_cycles: Some(phase_m / wavelength_m + cycles),
                    doppler_hz: Some(
                        (-rate_mps + self.doppler_sd_mps * self.normal()) / wavelength_m,
                    ),
                    cn0_dbhz: Some(48.0),
                    lock: Lock::default(),
                });
            }
        }
        AntennaEpoch { time: tag, observations, ..AntennaEpoch::default() }
    }

    /// Nearly normal: a sum of twelve uniform numbers.
    fn normal(&mut self) -> f64 {
        let uniform = |state: &mut u64| {
            // The generator MMIX of Knuth, The Art of Computer Programming 2, 3.3.4.
            *state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (*state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform(&mut self.random)).sum::<f64>() - 6.0
    }
}

impl Motion {
    /// A body at rest near the place of the recording.
    pub(crate) fn at_rest(attitude: Attitude, antennas_m: &[[f64; 3]]) -> Self {
        Self {
            place: Geodetic::from_degrees(35.1347, 136.9776, 104.0),
            start: GpsTime::from_week_tow(recording::WEEK, 116_400.0).unwrap_or_default(),
            velocity_mps: Vector::new(0.0, 0.0, 0.0),
            attitude,
            antennas_m: antennas_m.iter().map(|[x, y, z]| Vector::new(*x, *y, *z)).collect(),
        }
    }

    /// Where an antenna is.
    pub(crate) fn antenna_m(&self, antenna: usize, time: GpsTime) -> Vector<Ecef> {
        let ecef_from_ned = self.place.ecef_from_ned();
        let arm_m = self.attitude.ned_from_body() * self.antennas_m[antenna];
        self.place.to_ecef() + ecef_from_ned * (self.velocity_mps * (time - self.start) + arm_m)
    }
}

/// From the antenna to the satellite as it was when it sent, in the Earth-fixed axes of the reception.
fn path(orbit: &KeplerEphemeris, antenna_m: Vector<Ecef>, received: GpsTime) -> Vector<Ecef> {
    let mut travel_s = 0.075;
    let mut path_m = Vector::new(0.0, 0.0, 0.0);
    for _ in 0..4 {
        let sent = orbit.state(received + -travel_s).position_m.xyz();
        let (sin, cos) = (EARTH_RATE_RADPS * travel_s).sin_cos();
        let turned = Vector::new(cos * sent.x + sin * sent.y, cos * sent.y - sin * sent.x, sent.z);
        path_m = turned - antenna_m;
        travel_s = path_m.norm() / LIGHT_MPS;
    }
    path_m
}

/// Any number that is its own for every phase.
fn whole_cycles(antenna: usize, satellite: Satellite, signal: Signal) -> f64 {
    let system = if satellite.system == System::Gps { 100 } else { 300 };
    let number = system + usize::from(satellite.number) + usize::from(signal.band.digit);
    ((number * 7919 + 104_729 * (1 + antenna)) % 100_000) as f64
}
