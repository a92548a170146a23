//! Each antenna by itself: satellites, position, clock, velocity; then one frame for all of them.

use nalgebra::DVector;

use crate::difference::Link;
use crate::ephemeris::NavigationData;
use crate::frames::{Ecef, Vector};
use crate::observation::ArrayEpoch;
use crate::point::{self, NoPosition, PointSettings, PointSolution, Tracked, Velocity};
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::sky::Horizon;
use crate::solution::Reason;
use crate::time::GpsTime;

use super::settings::Settings;

/// Receivers that sample farther apart than this are not used together: over 10 ms a body that
/// turns with 100 °/s moves an antenna 1 m away by 17 mm, which no velocity corrects.
const MAX_TIME_DIFFERENCE_S: f64 = 0.010;

/// One antenna of the epoch, by itself.
#[derive(Debug)]
pub(super) struct Located {
    pub(super) antenna: usize,
    /// Time tag by its own clock.
    pub(super) tag: GpsTime,
    pub(super) tracked: Vec<Tracked>,
    pub(super) without_ephemeris: usize,
    pub(super) point: Result<PointSolution, NoPosition>,
    pub(super) velocity: Option<Velocity>,
}

/// Approximate antenna positions at one common instant.
#[derive(Debug)]
pub(super) struct CommonFrame {
    /// Antenna that all baselines start from.
    pub(super) reference: usize,
    antennas: Vec<usize>,
    /// Approximate position of each located antenna at its own reception time, m.
    pub(super) positions_m: Vec<Vector<Ecef>>,
    /// Approximate baseline to each rover at the instant of the reference, m.
    pub(super) approximate_m: Vec<Vector<Ecef>>,
    /// Local level axes at the reference antenna.
    pub(super) horizon: Horizon,
}

impl CommonFrame {
    /// Antennas that the baselines lead to.
    pub(super) fn rovers(&self) -> impl Iterator<Item = usize> {
        self.antennas.iter().copied().filter(|antenna| *antenna != self.reference)
    }

    /// Approximate baselines, one after the other.
    pub(super) fn approximate(&self) -> DVector<f64> {
        let components = self.approximate_m.iter().flat_map(|b| <[f64; 3]>::from(b.xyz()));
        DVector::from_iterator(3 * self.approximate_m.len(), components)
    }
}

/// Tracks and positions every antenna that has an epoch; reuses the buffers of `located`.
pub(super) fn locate(
    epoch: &ArrayEpoch,
    navigation: &NavigationData,
    settings: &Settings,
    located: &mut Vec<Located>,
) {
    let point_settings =
        PointSettings { elevation_mask_rad: settings.elevation_mask_rad, noise: settings.noise };
    let mut buffers: Vec<Vec<Tracked>> = located.drain(..).map(|l| l.tracked).collect();
    for (antenna, observed) in epoch.antennas.iter().take(settings.antennas).enumerate() {
        let Some(observed) = observed else { continue };
        let mut tracked = buffers.pop().unwrap_or_default();
        let without_ephemeris = point::track(
            observed,
            navigation,
            |system| settings.wants_system(system),
            &mut tracked,
        );
        let mut point = point::solve(&tracked, navigation, observed.time, &point_settings);
        if let (0, Some(known_m), Ok(point)) = (antenna, settings.first_antenna_m, &mut point) {
            point.position_m = known_m;
            point.horizon = Horizon::at(known_m);
        }
        let velocity = point
            .as_ref()
            .ok()
            .and_then(|p| point::velocity(&tracked, p, settings.elevation_mask_rad));
        located.push(Located {
            antenna,
            tag: observed.time,
            tracked,
            without_ephemeris,
            point,
            velocity,
        });
    }
}

/// Approximate positions for all antennas at the instant of the first one that has a position.
///
/// An antenna without a position of its own takes that of the first one that has: over metres the
/// linearisation is good to micrometres.
pub(super) fn common_frame(located: &[Located]) -> Result<CommonFrame, Reason> {
    if located.len() < 2 {
        return Err(Reason::FewAntennas);
    }
    let positioned = located.iter().find_map(|l| Some((l, l.point.as_ref().ok()?)));
    let Some((anchor, anchor_point)) = positioned else {
        let seen = |l: &Located| l.tracked.len() < l.without_ephemeris;
        let diverged = |l: &Located| matches!(l.point, Err(NoPosition::Diverged));
        return Err(if located.iter().any(seen) {
            Reason::NoEphemeris
        } else if located.iter().any(diverged) {
            Reason::BadInput
        } else {
            Reason::FewSatellites
        });
    };
    let reference = &located[0];
    let anchor_velocity = anchor.velocity.map_or(Vector::new(0.0, 0.0, 0.0), |v| v.velocity_mps);
    let time_of = |l: &Located| {
        let clock_m = l.point.as_ref().map_or(anchor_point.clock_m, |p| p.clock_m);
        l.tag + -clock_m / SPEED_OF_LIGHT_MPS
    };

    let reference_time = time_of(reference);
    let mut positions_m = Vec::with_capacity(located.len());
    let mut approximate_m = Vec::with_capacity(located.len() - 1);
    for one in located {
        let later_s = time_of(one) - reference_time;
        if later_s.abs() > MAX_TIME_DIFFERENCE_S {
            return Err(Reason::TimeMismatch);
        }
        let position_m = one.point.as_ref().map_or(anchor_point.position_m, |p| p.position_m);
        positions_m.push(position_m);
        if one.antenna != reference.antenna {
            // The body moved on between the two receivers' instants: b = x₁(t₁) − x₀(t₀) − v (t₁ − t₀)
            approximate_m.push(position_m - positions_m[0] - anchor_velocity * later_s);
        }
    }
    Ok(CommonFrame {
        reference: reference.antenna,
        antennas: located.iter().map(|l| l.antenna).collect(),
        horizon: Horizon::at(positions_m[0]),
        positions_m,
        approximate_m,
    })
}

/// The most satellites that any two antennas share (links are sorted by band and satellite, those
/// with fewer than two antennas are gone).
pub(super) fn shared_satellites(links: &[Link]) -> usize {
    let mut satellites: Vec<_> = links.iter().map(|l| l.satellite).collect();
    satellites.sort_unstable();
    satellites.dedup();
    satellites.len()
}
