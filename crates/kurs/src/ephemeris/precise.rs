//! Precise orbits and clocks: positions at nodes of time, interpolated.
//!
//! Positions are those of the **centre of mass** of the satellite, as in SP3 files of the IGS: the
//! antenna is up to 2.7 m nearer to the Earth (GPS IIR 1.3 m, Galileo 0.8 m, GLONASS 2.4 m). Most of
//! it is the same for all directions from the Earth and goes with the satellite's clock in a
//! difference between receivers.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};

use super::SatelliteState;
use crate::frames::{EARTH_RATE_RADPS, Ecef, Vector};
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite};
use crate::time::GpsTime;

/// Nodes of one interpolation. A polynomial of degree 10 errs by less than 1 mm at 15 minutes, and
/// by up to 13 mm for the two Galileo satellites whose orbits have an eccentricity of 0.17; over a
/// missing node it would be 25 cm for these.
const NODES: usize = 11;
/// A window of [`NODES`] without a gap spans one interval less than it has nodes.
const MAX_SPAN_INTERVALS: f64 = NODES as f64 - 0.5;
/// Gravitational constant of the Earth, m³/s², for the small rate of the relativistic effect.
const GM: f64 = 3.986_004_418e14;

/// What a precise orbit file says about one satellite at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreciseNode {
    /// The instant.
    pub time: GpsTime,
    /// Centre of mass.
    pub position_m: Vector<Ecef>,
    /// Satellite clock minus system time without the periodic relativistic effect.
    pub clock_s: Option<f64>,
    /// The clock jumped between the node before and this one.
    pub clock_event: bool,
    /// 1-sigma of the position as stated.
    pub sigma_m: f64,
}

/// Precise orbits of all satellites; nodes may come in any order and from several files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PreciseOrbits {
    satellites: BTreeMap<Satellite, Vec<PreciseNode>>,
}

impl PreciseOrbits {
    /// Adds a node; one of the same satellite and time is replaced, unless that one has a clock and this
    /// one has none (the midnight that ends one file and begins the next). A node that is not a number or
    /// not in space (below 6000 km or above 100 000 km from the Earth's centre) is left out.
    pub fn insert(&mut self, satellite: Satellite, node: PreciseNode) {
        let in_space = (6e6..1e8).contains(&node.position_m.norm());
        let clock_is_sane = node.clock_s.is_none_or(|clock_s| clock_s.abs() < 1.0);
        let sigma_is_sane = (0.0..1e5).contains(&node.sigma_m);
        if !(in_space && clock_is_sane && sigma_is_sane) {
            return;
        }
        let nodes = self.satellites.entry(satellite).or_default();
        match nodes.binary_search_by_key(&node.time, |known| known.time) {
            Ok(at) if nodes[at].clock_s.is_some() && node.clock_s.is_none() => {}
            Ok(at) => nodes[at] = node,
            Err(at) => nodes.insert(at, node),
        }
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.satellites.is_empty()
    }

    /// The satellites in their order, each with its nodes in the order of time.
    pub fn iter(&self) -> impl Iterator<Item = (Satellite, &[PreciseNode])> {
        self.satellites.iter().map(|(satellite, nodes)| (*satellite, nodes.as_slice()))
    }

    /// Position of the centre of mass at `time`, whether there is a clock or not; `None` outside
    /// the nodes and near a gap.
    #[must_use]
    pub fn position_m(&self, satellite: Satellite, time: GpsTime) -> Option<Vector<Ecef>> {
        let nodes = self.satellites.get(&satellite)?;
        let (position, _) = interpolate(window(nodes, end_of_interval(nodes, time)?)?, time);
        Some(Vector::from_xyz(position))
    }

    /// Position, velocity and clock at `time`.
    ///
    /// `None` outside the nodes, near a gap, where there is no clock, and across
    /// a clock event.
    #[must_use]
    pub fn state(&self, satellite: Satellite, time: GpsTime) -> Option<SatelliteState> {
        let nodes = self.satellites.get(&satellite)?;
        let after = end_of_interval(nodes, time)?;
        let (from, to) = (&nodes[after - 1], &nodes[after]);
        let (clock_s, clock_drift) = clock(from, to, time)?;
        let (position, inertial_velocity) = interpolate(window(nodes, after)?, time);
        let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
        // Δt_rel = −2 r·v / c²,   d(r·v)/dt = v² − GM/r
        let squared_c = SPEED_OF_LIGHT_MPS * SPEED_OF_LIGHT_MPS;
        let relativistic_s = -2.0 * position.dot(&inertial_velocity) / squared_c;
        let relativistic_drift =
            -2.0 * (inertial_velocity.norm_squared() - GM / position.norm()) / squared_c;
        Some(SatelliteState {
            position_m: Vector::from_xyz(position),
            velocity_mps: Vector::from_xyz(inertial_velocity - earth.cross(&position)),
            clock_s: clock_s + relativistic_s,
            clock_drift: clock_drift + relativistic_drift,
            sigma_m: from.sigma_m.max(to.sigma_m),
        })
    }
}

/// Index of the node at which the interval with `time` ends; the last node belongs to the last
/// interval.
fn end_of_interval(nodes: &[PreciseNode], time: GpsTime) -> Option<usize> {
    let after = nodes.partition_point(|node| node.time <= time);
    let after = if nodes.last()?.time == time { nodes.len() - 1 } else { after };
    (1..nodes.len()).contains(&after).then_some(after)
}

/// The nodes around the interval that ends at `after`, moved inwards at the ends.
fn window(nodes: &[PreciseNode], after: usize) -> Option<&[PreciseNode]> {
    let first = after.saturating_sub(NODES / 2).min(nodes.len().checked_sub(NODES)?);
    let window = &nodes[first..first + NODES];
    let span_s = window[NODES - 1].time - window[0].time;
    let steps = window.windows(2).map(|pair| pair[1].time - pair[0].time);
    let interval_s = steps.fold(f64::INFINITY, f64::min);
    (span_s <= MAX_SPAN_INTERVALS * interval_s).then_some(window)
}

/// Position and its rate in the axes that coincide with the Earth-fixed ones at `time` and do not
/// turn.
///
/// Neville's scheme at x = 0 for nodes xⱼ = tⱼ − t:
/// P(i, k) = (xᵢ₊ₖ P(i, k−1) − xᵢ P(i+1, k−1)) / (xᵢ₊ₖ − xᵢ), and its derivative.
fn interpolate(window: &[PreciseNode], time: GpsTime) -> (Vector3<f64>, Vector3<f64>) {
    let mut x = [0.0; NODES];
    let mut value = [Vector3::zeros(); NODES];
    let mut rate = [Vector3::zeros(); NODES];
    for (i, node) in window.iter().enumerate() {
        x[i] = node.time - time;
        // The Earth-fixed axes of tⱼ are turned by ωₑ (tⱼ − t) against those of t.
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), EARTH_RATE_RADPS * x[i]);
        value[i] = turn * node.position_m.xyz();
    }
    for k in 1..NODES {
        for i in 0..NODES - k {
            let width = x[i + k] - x[i];
            rate[i] = (rate[i] * x[i + k] - value[i] - rate[i + 1] * x[i] + value[i + 1]) / width;
            value[i] = (value[i] * x[i + k] - value[i + 1] * x[i]) / width;
        }
    }
    (value[0], rate[0])
}

/// Clock and drift by the straight line between two nodes.
fn clock(before: &PreciseNode, after: &PreciseNode, time: GpsTime) -> Option<(f64, f64)> {
    let start_s = before.clock_s?;
    if time == before.time && after.clock_event {
        return Some((start_s, 0.0));
    }
    let end_s = after.clock_s.filter(|_| !after.clock_event)?;
    let drift = (end_s - start_s) / (after.time - before.time);
    Some((start_s + drift * (time - before.time), drift))
}

#[cfg(test)]
mod tests {
    use super::super::kepler::KeplerEphemeris;
    use super::super::sample::{beidou_geo, galileo, gps};
    use super::*;

    const INTERVAL_S: f64 = 900.0;

    /// Nodes of a day, every quarter of an hour, from a broadcast orbit without harmonics.
    fn nodes(elements: super::super::KeplerElements) -> (PreciseOrbits, KeplerEphemeris) {
        let ephemeris = KeplerEphemeris::new(elements).unwrap();
        let mut orbits = PreciseOrbits::default();
        for i in 0..24 {
            let time = elements.reference_time + f64::from(i) * INTERVAL_S;
            let state = ephemeris.state(time);
            let squared_c = SPEED_OF_LIGHT_MPS * SPEED_OF_LIGHT_MPS;
            let relativistic = -2.0 * state.position_m.dot(&state.velocity_mps) / squared_c;
            let node = PreciseNode {
                time,
                position_m: state.position_m,
                clock_s: Some(state.clock_s - relativistic),
                clock_event: false,
                sigma_m: 0.03,
            };
            orbits.insert(elements.satellite, node);
        }
        (orbits, ephemeris)
    }

    #[test]
    fn an_orbit_is_rebuilt_from_its_nodes() {
        for elements in [gps(), galileo(), beidou_geo()] {
            let (orbits, ephemeris) = nodes(elements);
            for i in 0..=230 {
                let time = elements.reference_time + f64::from(i) * 90.0;
                let state = orbits.state(elements.satellite, time).unwrap();
                let truth = ephemeris.state(time);
                let apart_m = (state.position_m - truth.position_m).norm();
                assert!(apart_m < 1e-3, "{} {i}: {apart_m} m", elements.satellite);
                let apart_mps = (state.velocity_mps - truth.velocity_mps).norm();
                assert!(apart_mps < 1e-5, "{} {i}: {apart_mps} m/s", elements.satellite);
                assert!((state.clock_s - truth.clock_s).abs() < 2e-11, "{i}");
                assert!((state.clock_drift - truth.clock_drift).abs() < 1e-13, "{i}");
            }
        }
    }

    #[test]
    fn outside_and_in_gaps_there_is_nothing() {
        let (orbits, _) = nodes(gps());
        let (satellite, start) = (gps().satellite, gps().reference_time);
        assert!(orbits.state(satellite, start + -1.0).is_none());
        assert!(orbits.state(satellite, start + 23.0 * INTERVAL_S).is_some());
        assert!(orbits.state(satellite, start + 23.0 * INTERVAL_S + 1.0).is_none());

        let mut gapped = orbits.clone();
        let time = start + 12.5 * INTERVAL_S;
        gapped.satellites.get_mut(&satellite).unwrap().remove(12);
        assert!(orbits.state(satellite, time).is_some());
        assert!(gapped.state(satellite, time).is_none());
    }

    /// Two files meet at node 12; the end of the first one has no clocks.
    #[test]
    fn a_clock_of_another_file_stays() {
        let (orbits, _) = nodes(gps());
        let satellite = gps().satellite;
        let all = orbits.satellites[&satellite].clone();
        let mut first = all[..=12].to_vec();
        first[12].clock_s = None;
        for order in [[&first[..], &all[12..]], [&all[12..], &first[..]]] {
            let mut together = PreciseOrbits::default();
            order.into_iter().flatten().for_each(|node| together.insert(satellite, *node));
            assert_eq!(together, orbits);
        }
    }

    #[test]
    fn a_clock_event_is_not_bridged() {
        let (mut orbits, _) = nodes(gps());
        let (satellite, start) = (gps().satellite, gps().reference_time);
        orbits.satellites.get_mut(&satellite).unwrap()[12].clock_event = true;
        assert!(orbits.state(satellite, start + 11.5 * INTERVAL_S).is_none());
        assert!(orbits.state(satellite, start + 12.5 * INTERVAL_S).is_some());
        assert!(orbits.state(satellite, start + 11.0 * INTERVAL_S).is_some());
    }

    #[test]
    fn damaged_nodes_are_left_out() {
        let mut orbits = PreciseOrbits::default();
        let node = PreciseNode {
            time: gps().reference_time,
            position_m: Vector::new(0.0, 0.0, 0.0),
            clock_s: None,
            clock_event: false,
            sigma_m: 0.1,
        };
        orbits.insert(gps().satellite, node);
        orbits.insert(
            gps().satellite,
            PreciseNode { position_m: Vector::new(f64::NAN, 2e7, 0.0), ..node },
        );
        assert!(orbits.is_empty());
    }
}
