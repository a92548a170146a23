//! A receiver with its antenna: which signals it tracks and what it reports of each.

use kurs::ephemeris::Ephemeris;
use kurs::frames::{Body, Ecef, Geodetic, Vector, WGS84_A_M, WGS84_F};
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Band, SPEED_OF_LIGHT_MPS, Satellite, Signal};
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};

use crate::canopy::{Leaves, Shade};
use crate::disturbance::Disturbances;
use crate::noise::{GaussMarkov, Noise};
use crate::propagation::{Path, ionosphere_m, troposphere_m, wind_up_cycles};
use crate::received_field::ReceivedField;
use crate::rotating_arm::Clock;
use crate::satellite_track::SatelliteTrack;
use crate::scenario::{Canopy, Law, Multipath, Scenario};
use crate::wall::{self, Wall, WallEffect};

/// First frequency of GPS, to which the ionospheric delay refers.
const L1_HZ: f64 = 1_575.42e6;
/// Initial whole cycles are drawn between plus and minus this.
const INTEGER_RANGE: f64 = 100_000.0;
/// Fall of C/N0 from the zenith to the horizon, and its scatter.
const CN0_FALL_DB: f64 = 15.0;
const CN0_SD_DB: f64 = 0.3;
/// Noise grows with falling elevation up to this factor.
const MAX_GROWTH: f64 = 3.5;
/// C/N0 for which the noise of law `cn0` is given.
const REFERENCE_CN0_DBHZ: f64 = 45.0;
/// A satellite moves through a lobe of an antenna's pattern, some 20 degrees wide, in this time.
const GAIN_CORRELATION_S: f64 = 2400.0;
/// Slips at random are of one to this many cycles.
const MAX_RANDOM_SLIP: f64 = 10.0;

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct Receiver {
    pub(crate) name: String,
    pub(crate) lever_arm_m: Vector<Body>,
    pub(crate) tag_offset_s: f64,
    pub(crate) clock: usize,
    turned_rad: f64,
    mask_deg: Vec<[f64; 3]>,
    /// The leaves above it.
    canopies: Vec<Canopy>,
    signals: Vec<TrackedSignal>,
    noise: Noise,
    /// For every satellite, in the order of the tracks.
    links: Vec<Link>,
}

/// A signal that the receiver can track.
#[derive(Debug, Clone, Copy)]
struct TrackedSignal {
    signal: Signal,
    /// Fraction of a cycle in all phases of this signal, the same for every satellite.
    phase_bias_cycles: f64,
}

/// The receiver's tracking of one satellite.
#[derive(Debug, Clone)]
struct Link {
    wind_up_cycles: f64,
    gain: GaussMarkov,
    /// For every canopy above the antenna.
    leaves: Vec<Leaves>,
    /// What the reflections of all its signals have in common.
    common_reflection: Reflection,
    channels: Vec<Channel>,
}

/// Tracking of one signal of one satellite.
#[derive(Debug, Clone, Copy)]
struct Channel {
    /// Which of the receiver's signals.
    signal: usize,
    frequency_hz: f64,
    state: Tracking,
    /// Whole cycles N.
    integer: i64,
    /// How late the phase was at the last epoch by what stands in the way, cycles.
    late_cycles: f64,
    reflection: Reflection,
}

/// Reflections as coloured noise, of variance one.
#[derive(Debug, Clone, Copy, Default)]
struct Reflection {
    code: GaussMarkov,
    phase: GaussMarkov,
}

/// What stands in the way of a satellite's signals at an epoch.
#[derive(Debug, Default)]
struct Obstruction {
    walls: Vec<WallEffect>,
    shade: Vec<Shade>,
    /// Gain of the antenna against that of others.
    gain_db: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tracking {
    Never,
    Lost,
    On,
}

/// The receiver's surroundings at one epoch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reception<'a> {
    /// Time tag, from the start of the scenario and as an instant.
    pub(crate) tag_s: f64,
    pub(crate) tag: GpsTime,
    /// True time of reception, from the start.
    pub(crate) time_s: f64,
    pub(crate) clock: Clock,
    pub(crate) position_m: Vector<Ecef>,
    pub(crate) velocity_mps: Vector<Ecef>,
    pub(crate) ecef_from_body: Matrix3<f64>,
    /// North, east, down of the place to which walls refer.
    pub(crate) local_m: Vector3<f64>,
    pub(crate) walls: &'a [Wall],
    pub(crate) scenario: &'a Scenario,
    pub(crate) disturbances: &'a Disturbances,
}

/// The whole cycles of a channel were drawn or changed.
#[derive(Debug, Clone, PartialEq)]
pub struct AmbiguityChange {
    /// Time tag of the first observation with it.
    pub time: GpsTime,
    /// Name of the antenna.
    pub antenna: String,
    /// The satellite.
    pub satellite: Satellite,
    /// The signal.
    pub signal: Signal,
    /// Whole cycles from now on.
    pub cycles: i64,
    /// The change, where the phase was tracked before without a gap.
    pub slip: Option<i64>,
    /// Whether the receiver says so.
    pub flagged: bool,
}

/// What a receiver needs to be made.
pub(crate) struct ReceiverPlan<'a> {
    pub(crate) name: &'a str,
    pub(crate) position_m: Vector<Body>,
    pub(crate) tag_offset_s: f64,
    pub(crate) turned_deg: f64,
    pub(crate) mask_deg: &'a [[f64; 3]],
    pub(crate) canopies: Vec<Canopy>,
    pub(crate) signals: Vec<Signal>,
    pub(crate) clock: usize,
    pub(crate) phase_bias: bool,
}

impl Receiver {
    pub(crate) fn new(plan: ReceiverPlan<'_>, tracks: &[SatelliteTrack], mut noise: Noise) -> Self {
        let mut signals = Vec::with_capacity(plan.signals.len());
        for signal in plan.signals {
            let phase_bias_cycles = if plan.phase_bias { noise.uniform() } else { 0.0 };
            signals.push(TrackedSignal { signal, phase_bias_cycles });
        }
        let canopies = plan.canopies.len();
        let links = tracks.iter().map(|track| Link::new(track, &signals, canopies)).collect();
        Self {
            name: plan.name.to_owned(),
            lever_arm_m: plan.position_m,
            tag_offset_s: plan.tag_offset_s,
            clock: plan.clock,
            turned_rad: plan.turned_deg.to_radians(),
            mask_deg: plan.mask_deg.to_vec(),
            canopies: plan.canopies,
            signals,
            noise,
            links,
        }
    }

    /// Leaves out the satellites that are not kept.
    pub(crate) fn keep(&mut self, kept: &[bool]) {
        let mut keep = kept.iter();
        self.links.retain(|_| *keep.next().unwrap_or(&false));
    }

    /// Everything the receiver reports at an epoch, into `epoch`.
    pub(crate) fn observe(
        &mut self,
        reception: &Reception<'_>,
        tracks: &[SatelliteTrack],
        ephemerides: &[Option<Ephemeris>],
        epoch: &mut AntennaEpoch,
        changes: &mut Vec<AmbiguityChange>,
    ) {
        epoch.time = reception.tag;
        epoch.observations.clear();
        let here = Geodetic::from_ecef(reception.position_m);
        let ned_from_ecef = here.ned_from_ecef().matrix();
        let (antenna, velocity) = (reception.position_m.xyz(), reception.velocity_mps.xyz());
        for (index, track) in tracks.iter().enumerate() {
            let path = Path::trace(track, &antenna, &velocity, reception.time_s);
            let (Some(path), Some(ephemeris)) = (path, &ephemerides[index]) else {
                self.links[index].lose();
                continue;
            };
            let level = ned_from_ecef * path.line_of_sight;
            let body = reception.ecef_from_body.transpose() * path.line_of_sight;
            let sky = &reception.scenario.sky;
            let seen = -level.z > sky.elevation_mask_deg.to_radians().sin()
                && !meets_earth(&antenna, &path.line_of_sight)
                && !is_masked(&level, &sky.horizon_deg)
                && !is_masked(&body, &self.mask_deg);
            if !seen {
                self.links[index].lose();
                continue;
            }
            let obstruction = self.obstruction(index, &level, reception);
            let (height_m, sin_elevation) = (here.height_m, -level.z);
            let view = View { path, ephemeris, height_m, sin_elevation, obstruction };
            self.observe_satellite(index, track, &view, reception, epoch, changes);
        }
    }

    /// What stands in the way of a satellite in this direction (north, east, down).
    fn obstruction(
        &mut self,
        index: usize,
        level: &Vector3<f64>,
        reception: &Reception<'_>,
    ) -> Obstruction {
        let Self { canopies, noise, links, .. } = self;
        let link = &mut links[index];
        let Reception { scenario, tag_s, .. } = *reception;
        let mut obstruction = Obstruction::default();
        let gain_sd_db = scenario.noise.gain_sd_db;
        if gain_sd_db > 0.0 {
            obstruction.gain_db = gain_sd_db * link.gain.advance(tag_s, GAIN_CORRELATION_S, noise);
        }
        let effects = reception.walls.iter().map(|wall| wall.effect(&reception.local_m, level));
        obstruction.walls.extend(effects.flatten());
        for (canopy, leaves) in canopies.iter().zip(&mut link.leaves) {
            if is_masked(level, &canopy.sky_deg) {
                obstruction.shade.push(leaves.shade(canopy, tag_s, scenario.interval_s, noise));
            }
        }
        obstruction
    }

    /// The signals of one satellite in view.
    fn observe_satellite(
        &mut self,
        index: usize,
        track: &SatelliteTrack,
        view: &View<'_>,
        reception: &Reception<'_>,
        epoch: &mut AntennaEpoch,
        changes: &mut Vec<AmbiguityChange>,
    ) {
        let Self { name, signals, noise, links, turned_rad, .. } = self;
        let link = &mut links[index];
        if reception.scenario.atmosphere.wind_up {
            let (sin, cos) = turned_rad.sin_cos();
            // Right-handed about the upward axis: forward, then left.
            let x = reception.ecef_from_body * Vector3::new(cos, sin, 0.0);
            let y = reception.ecef_from_body * Vector3::new(sin, -cos, 0.0);
            link.wind_up_cycles = wind_up_cycles(&view.path, &x, &y, link.wind_up_cycles);
        }
        let common = link.common_reflection(&reception.scenario.multipath, reception.tag_s, noise);
        for channel in &mut link.channels {
            let tracked = signals[channel.signal];
            let band = tracked.signal.band;
            let arrival = Arrival::new(view, reception, band, channel.wavelength_m());
            if reception.disturbances.hidden(reception.tag_s, name, track.satellite, band)
                || arrival.cn0_dbhz < reception.scenario.noise.tracking_dbhz
            {
                channel.lose();
                continue;
            }
            let turned = channel.turn(&arrival.field);
            let change = channel.follow(reception, name, track.satellite, band, turned, noise);
            if let Some((slip, flagged)) = change {
                changes.push(AmbiguityChange {
                    time: reception.tag,
                    antenna: name.clone(),
                    satellite: track.satellite,
                    signal: tracked.signal,
                    cycles: channel.integer,
                    slip,
                    flagged,
                });
            }
            let flagged = matches!(change, Some((_, true)));
            let phase_offset_cycles = tracked.phase_bias_cycles + link.wind_up_cycles;
            let lock = Lock(if flagged { Lock::SLIP } else { 0 });
            let reflected_m = channel.reflect(view, reception, common, noise);
            let received = Received { arrival, reflected_m, phase_offset_cycles };
            let measured = channel.measure(view, reception, name, tracked.signal, &received, noise);
            epoch.observations.push(Observation { lock, ..measured });
        }
    }
}

/// A satellite as an antenna sees it.
struct View<'a> {
    path: Path,
    ephemeris: &'a Ephemeris,
    height_m: f64,
    sin_elevation: f64,
    obstruction: Obstruction,
}

impl Obstruction {
    /// What is left of a signal, and what is added to it.
    fn field(&self, wavelength_m: f64) -> ReceivedField {
        let mut field = wall::field(&self.walls, wavelength_m);
        for shade in &self.shade {
            field.pass(shade.straight(wavelength_m), shade.scattered);
        }
        field
    }

    /// How late the code is under leaves, in its standard deviations.
    fn code_tail(&self) -> f64 {
        self.shade.iter().map(|shade| shade.code_tail).sum()
    }
}

/// One signal as it comes out of an antenna.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    field: ReceivedField,
    cn0_dbhz: f64,
    /// How much weaker it is than it would be without anything in its way.
    drop_db: f64,
}

/// What is added to a signal in the antenna and its receiver.
#[derive(Debug, Clone, Copy)]
struct Received {
    arrival: Arrival,
    /// Reflections as coloured noise, of code and phase.
    reflected_m: [f64; 2],
    phase_offset_cycles: f64,
}

impl Arrival {
    fn new(view: &View<'_>, reception: &Reception<'_>, band: Band, wavelength_m: f64) -> Self {
        let field = view.obstruction.field(wavelength_m);
        let interference_db = reception.disturbances.cn0_drop_db(reception.tag_s, band);
        let drop_db = interference_db + field.loss_db() - view.obstruction.gain_db;
        let fall_db = CN0_FALL_DB * (1.0 - view.sin_elevation);
        let cn0_dbhz = reception.scenario.noise.cn0_zenith_dbhz - fall_db - drop_db;
        Self { field, cn0_dbhz, drop_db }
    }
}

impl Link {
    fn new(track: &SatelliteTrack, signals: &[TrackedSignal], canopies: usize) -> Self {
        let channels = signals.iter().enumerate().filter_map(|(signal, tracked)| {
            let band = tracked.signal.band;
            (band.system == track.satellite.system).then_some(())?;
            Some(Channel {
                signal,
                frequency_hz: band.frequency_hz(track.glonass_channel)?,
                state: Tracking::Never,
                integer: 0,
                late_cycles: 0.0,
                reflection: Reflection::default(),
            })
        });
        Self {
            wind_up_cycles: 0.0,
            gain: GaussMarkov::default(),
            leaves: vec![Leaves::default(); canopies],
            common_reflection: Reflection::default(),
            channels: channels.collect(),
        }
    }

    /// What all signals have of the reflections, of variance one; code, phase.
    fn common_reflection(
        &mut self,
        multipath: &Multipath,
        tag_s: f64,
        noise: &mut Noise,
    ) -> [f64; 2] {
        match multipath.common_share > 0.0 {
            true => self.common_reflection.advance(multipath, tag_s, noise),
            false => [0.0; 2],
        }
    }

    fn lose(&mut self) {
        self.channels.iter_mut().for_each(Channel::lose);
    }
}

impl Reflection {
    /// Code and phase at a later epoch.
    fn advance(&mut self, multipath: &Multipath, tag_s: f64, noise: &mut Noise) -> [f64; 2] {
        let Self { code, phase } = self;
        [code, phase].map(|part| part.advance(tag_s, multipath.correlation_s, noise))
    }
}

impl Channel {
    fn wavelength_m(&self) -> f64 {
        SPEED_OF_LIGHT_MPS / self.frequency_hz
    }

    /// Whole turns of the field against the straight signal since the last epoch: where it fades, its
    /// phase may go round, and the receiver counts a cycle more or less.
    fn turn(&mut self, field: &ReceivedField) -> i64 {
        let before_cycles = core::mem::replace(&mut self.late_cycles, field.late_cycles());
        whole(before_cycles - self.late_cycles)
    }

    fn lose(&mut self) {
        if self.state == Tracking::On {
            self.state = Tracking::Lost;
        }
    }

    /// Keeps the whole cycles, or draws new ones after a gap, or slips, as planned, by the turns of the
    /// field, or at random; the slip (none after a gap) and whether it is flagged.
    fn follow(
        &mut self,
        reception: &Reception<'_>,
        antenna: &str,
        satellite: Satellite,
        band: Band,
        turned: i64,
        noise: &mut Noise,
    ) -> Option<(Option<i64>, bool)> {
        let scenario = reception.scenario;
        if self.state != Tracking::On {
            let flagged = self.state == Tracking::Lost;
            self.state = Tracking::On;
            self.integer = whole((2.0 * noise.uniform() - 1.0) * INTEGER_RANGE);
            return Some((None, flagged));
        }
        let interval_s = scenario.interval_s;
        let planned =
            reception.disturbances.slip(reception.tag_s, interval_s, antenna, satellite, band);
        let per_epoch = scenario.slips.per_hour * interval_s / 3600.0;
        let slip = match planned {
            None if turned != 0 => Some((turned, noise.uniform() < scenario.slips.flagged_share)),
            None if per_epoch > 0.0 && noise.uniform() < per_epoch => {
                let size = whole(1.0 + noise.uniform() * (MAX_RANDOM_SLIP - 1.0));
                let sign = if noise.uniform() < 0.5 { -1 } else { 1 };
                Some((sign * size, noise.uniform() < scenario.slips.flagged_share))
            }
            planned => planned,
        };
        let (cycles, flagged) = slip?;
        self.integer += cycles;
        Some((Some(cycles), flagged))
    }

    /// The measurement equation.
    ///
    /// ```text
    /// P = ρ + c (dt − dtₛ) + T + I + d + m + o + ε
    /// Φ = (ρ + c (dt − dtₛ) + T − I + m) / λ + o + N + w + β + ε      in cycles
    /// D = −(ρ̇ + c (ḋt − ḋtₛ)) / λ + ε
    /// ```
    fn measure(
        &self,
        view: &View<'_>,
        reception: &Reception<'_>,
        antenna: &str,
        signal: Signal,
        received: &Received,
        noise: &mut Noise,
    ) -> Observation {
        let scenario = reception.scenario;
        let path = &view.path;
        let wavelength_m = self.wavelength_m();
        let troposphere = troposphere_m(
            scenario.atmosphere.troposphere_zenith_m,
            view.height_m,
            view.sin_elevation,
        );
        let ionosphere = ionosphere_m(scenario.atmosphere.ionosphere_zenith_m, view.sin_elevation)
            * (L1_HZ / self.frequency_hz).powi(2);
        let (code_bias_m, phase_bias_cycles) =
            reception.disturbances.bias(antenna, signal, view.ephemeris);
        let satellite_clock_m = SPEED_OF_LIGHT_MPS * path.sender.clock_s;
        let clocks_m = reception.clock.bias_m - satellite_clock_m;
        let geometric_m = path.range_m + clocks_m + troposphere;

        let Received { arrival, reflected_m: [code_multipath_m, phase_multipath_m], .. } = received;
        let Arrival { field, cn0_dbhz, drop_db } = arrival;
        let growth = Growth::new(scenario.noise.law, view.sin_elevation, *cn0_dbhz, *drop_db);
        let code_sd_m = scenario.noise.code_sd_m * growth.code;
        let rate_mps = path.range_rate_mps + reception.clock.rate_mps
            - SPEED_OF_LIGHT_MPS * path.sender.clock_drift;
        let group_delay_m = view.ephemeris.group_delay_m(signal).unwrap_or(0.0);
        let pseudorange_m = geometric_m
            + ionosphere
            + group_delay_m
            + code_bias_m
            + code_multipath_m
            + field.late_m()
            + view.obstruction.code_tail() * code_sd_m
            + noise.normal(code_sd_m);
        let phase_cycles = (geometric_m - ionosphere + phase_multipath_m) / wavelength_m
            + field.late_cycles()
            + self.integer as f64
            + received.phase_offset_cycles
            + phase_bias_cycles
            + noise.normal(scenario.noise.phase_sd_cycles * growth.phase);
        Observation {
            satellite: view.ephemeris.satellite(),
            signal,
            pseudorange_m: Some(pseudorange_m),
            phase_cycles: Some(phase_cycles),
            doppler_hz: Some(
                -rate_mps / wavelength_m + noise.normal(scenario.noise.doppler_sd_hz * growth.code),
            ),
            cn0_dbhz: Some(cn0_dbhz + noise.normal(CN0_SD_DB)),
            lock: Lock::default(),
        }
    }

    /// Reflections as coloured noise, growing as cos(elevation), m: the part that all signals of the
    /// satellite have in common (`common`, of variance one) and the signal's own; code, phase.
    fn reflect(
        &mut self,
        view: &View<'_>,
        reception: &Reception<'_>,
        common: [f64; 2],
        noise: &mut Noise,
    ) -> [f64; 2] {
        let multipath = &reception.scenario.multipath;
        if multipath.code_sd_m == 0.0 && multipath.phase_sd_m == 0.0 {
            return [0.0; 2];
        }
        let [code, phase] = self.reflection.advance(multipath, reception.tag_s, noise);
        let [of_all, of_own] =
            [multipath.common_share, 1.0 - multipath.common_share].map(f64::sqrt);
        let cos_elevation = (1.0 - view.sin_elevation * view.sin_elevation).sqrt();
        [
            multipath.code_sd_m * cos_elevation * (of_all * common[0] + of_own * code),
            multipath.phase_sd_m * cos_elevation * (of_all * common[1] + of_own * phase),
        ]
    }
}

/// Factors of the standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Growth {
    /// Of pseudorange and Doppler.
    code: f64,
    phase: f64,
}

impl Growth {
    fn new(law: Law, sin_elevation: f64, cn0_dbhz: f64, drop_db: f64) -> Self {
        let weaker = |db: f64| 10f64.powf(db / 20.0);
        let low = 1.0 / sin_elevation.max(1e-3);
        let (code, phase) = match law {
            Law::Flat => (1.0, 1.0),
            Law::Elevation => (low.min(MAX_GROWTH), low.min(MAX_GROWTH)),
            Law::Mixed => (low, (0.5 * (1.0 + low * low)).sqrt()),
            Law::Cn0 => {
                let both = weaker(REFERENCE_CN0_DBHZ - cn0_dbhz);
                return Self { code: both, phase: both };
            }
        };
        Self { code: code * weaker(drop_db), phase: phase * weaker(drop_db) }
    }
}

/// Whether the straight way from an antenna meets the ellipsoid of the Earth.
fn meets_earth(antenna_m: &Vector3<f64>, line_of_sight: &Vector3<f64>) -> bool {
    // Stretched along its axis the ellipsoid is a sphere, and a line is still a line.
    let stretch = Vector3::new(1.0, 1.0, 1.0 / (1.0 - WGS84_F));
    let [from, along] = [antenna_m, line_of_sight].map(|v| v.component_mul(&stretch));
    from.dot(&along) < 0.0 && from.cross(&along).norm() < WGS84_A_M * along.norm()
}

/// Whether an obstacle is in the way; the direction has its x axis at azimuth 0 and z down.
fn is_masked(direction: &Vector3<f64>, obstacles_deg: &[[f64; 3]]) -> bool {
    if obstacles_deg.is_empty() {
        return false;
    }
    let azimuth_deg = direction.y.atan2(direction.x).to_degrees();
    let elevation_deg = (-direction.z).clamp(-1.0, 1.0).asin().to_degrees();
    obstacles_deg.iter().any(|[from_deg, to_deg, height_deg]| {
        let width_deg = to_deg - from_deg;
        let inside = width_deg >= 360.0
            || (azimuth_deg - from_deg).rem_euclid(360.0) <= width_deg.rem_euclid(360.0);
        inside && elevation_deg < *height_deg
    })
}

#[allow(clippy::cast_possible_truncation)] // a few cycles, or INTEGER_RANGE
fn whole(value: f64) -> i64 {
    value.round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn obstacles_stand_where_they_are_said_to() {
        // North-east at 20 degrees, z down.
        let elevation = 20f64.to_radians();
        let level = elevation.cos() / 2f64.sqrt();
        let direction = Vector3::new(level, level, -elevation.sin());
        assert!(is_masked(&direction, &[[40.0, 50.0, 30.0]]));
        assert!(!is_masked(&direction, &[[40.0, 50.0, 10.0]]));
        assert!(!is_masked(&direction, &[[50.0, 60.0, 30.0]]));
        assert!(is_masked(&direction, &[[300.0, 420.0, 30.0]]));
        assert!(is_masked(&direction, &[[0.0, 360.0, 30.0]]));
    }

    #[test]
    fn laws_of_noise() {
        let growth = |law, sin_elevation, cn0_dbhz, drop_db| {
            let Growth { code, phase } = Growth::new(law, sin_elevation, cn0_dbhz, drop_db);
            [code, phase]
        };
        let off = |found: [f64; 2], code: f64, phase: f64| {
            (found[0] - code).abs().max((found[1] - phase).abs())
        };
        assert!(off(growth(Law::Flat, 0.5, 40.0, 0.0), 1.0, 1.0) < 1e-15);
        assert!(off(growth(Law::Elevation, 0.5, 40.0, 0.0), 2.0, 2.0) < 1e-15);
        assert!(off(growth(Law::Elevation, 0.1, 40.0, 0.0), 3.5, 3.5) < 1e-15);
        assert!(off(growth(Law::Mixed, 0.5, 40.0, 0.0), 2.0, 2.5f64.sqrt()) < 1e-15);
        let weaker = 10f64.powf(0.3);
        assert!(off(growth(Law::Cn0, 0.5, 39.0, 0.0), weaker, weaker) < 1e-12);
        assert!(off(growth(Law::Flat, 0.5, 40.0, 6.0), weaker, weaker) < 1e-12);
    }
}
