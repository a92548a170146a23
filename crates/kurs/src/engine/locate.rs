//! Each antenna by itself: satellites, position, clock, velocity; then one frame for all of them.

use nalgebra::DVector;
use smallvec::SmallVec;

use crate::difference::Link;
use crate::ephemeris::{NavigationData, Transmissions};
use crate::frames::{Ecef, Vector};
use crate::observation::ArrayEpoch;
use crate::point::{self, NoPosition, PointSettings, PointSolution, Tracked, Velocity};
use crate::signal::{SPEED_OF_LIGHT_MPS, SatelliteSet};
use crate::sky::Horizon;
use crate::solution::Reason;
use crate::time::GpsTime;

use super::settings::Settings;

/// Receivers that sample farther apart than this are not used together: over 10 ms a body that
/// turns with 100 °/s moves an antenna 1 m away by 17 mm, which no velocity corrects.
const MAX_TIME_DIFFERENCE_S: f64 = 0.010;

/// Longest extrapolation with the velocity, s.
const MAX_EXTRAPOLATION_S: f64 = 2.0;

/// One antenna of the epoch, by itself.
#[derive(Debug, Clone)]
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
    /// By how much the satellites contradict each other at least at each antenna: root mean square of the code's
    /// residuals over what is expected of them.
    pub(super) contradiction: f64,
}

impl CommonFrame {
    /// Of so many antennas that are all about where the horizon is.
    pub(super) fn at_one_place(horizon: Horizon, antennas: usize) -> Self {
        let place_m = horizon.geodetic.to_ecef();
        Self {
            reference: 0,
            antennas: (0..antennas).collect(),
            positions_m: vec![place_m; antennas],
            approximate_m: vec![Vector::new(0.0, 0.0, 0.0); antennas - 1],
            horizon,
            contradiction: 0.0,
        }
    }

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

/// Tracks and positions every antenna that has an epoch; `located` holds those of the last epoch, near which the
/// positions are looked for, and buffers.
pub(super) fn locate(
    epoch: &ArrayEpoch,
    navigation: &NavigationData,
    settings: &Settings,
    located: &mut Vec<Located>,
) {
    let point_settings =
        PointSettings { elevation_mask_rad: settings.elevation_mask_rad, noise: settings.noise };
    let mut near_m =
        located.iter().find_map(|one| one.point.as_ref().ok()).map(|point| point.position_m);
    let expected: SmallVec<[_; 4]> =
        located.iter().map(|l| (l.antenna, l.expected_m(epoch.time))).collect();
    let mut buffers: Vec<Vec<Tracked>> = located.drain(..).map(|l| l.tracked).collect();
    let mut sent = Transmissions::of(&navigation.ephemerides);
    for (antenna, observed) in epoch.antennas.iter().take(settings.antennas).enumerate() {
        let Some(observed) = observed else { continue };
        let mut tracked = buffers.pop().unwrap_or_default();
        let wanted = |system| settings.wants_system(system);
        let without_ephemeris = point::track_sent(observed, &mut sent, wanted, &mut tracked);
        let (time, by) = (observed.time, &point_settings);
        let own_m = expected.iter().find(|(of, _)| *of == antenna).and_then(|(_, own_m)| *own_m);
        let mut point = match own_m.or(near_m) {
            Some(near_m) => point::solve_near(&tracked, navigation, time, by, near_m),
            None => point::solve(&tracked, navigation, time, by),
        };
        if let Ok(point) = &point {
            let is_wrong = |t: &Tracked| {
                point.exclusions.iter().any(|e| e.satellite == t.satellite && e.is_useless())
            };
            tracked.retain(|satellite| !is_wrong(satellite));
            near_m = Some(point.position_m);
        }
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

/// Leaves out the antennas that cannot take part – into `idle`, with the reason of each – and gives the
/// approximate positions of the others at the instant of the first one. A pinned reference, whose place is
/// known, stays whatever it measured.
///
/// An antenna without a position of its own has too few satellites for a baseline too.
pub(super) fn select(
    located: &mut Vec<Located>,
    pinned_m: Option<Vector<Ecef>>,
    idle: &mut Vec<(usize, Reason)>,
) -> Result<CommonFrame, Reason> {
    let is_pinned = pinned_m.is_some();
    if located.len() < 2 {
        return Err(idle.last().map_or(Reason::FewAntennas, |(_, reason)| *reason));
    }
    let mut leave_out = |located: &mut Vec<Located>,
                         reason: &dyn Fn(&Located) -> Option<Reason>| {
        let mut index = 0;
        located.retain(|one| {
            let reason = reason(one).filter(|_| !(is_pinned && index == 0));
            index += 1;
            idle.extend(reason.map(|reason| (one.antenna, reason)));
            reason.is_none()
        });
    };
    leave_out(located, &|one| match one.point {
        Ok(_) => None,
        Err(_) if one.tracked.len() < one.without_ephemeris => Some(Reason::NoEphemeris),
        Err(NoPosition::FewSatellites { .. } | NoPosition::Singular) => Some(Reason::FewSatellites),
        Err(NoPosition::Diverged) => Some(Reason::BadInput),
    });
    let together = most_together(located, is_pinned);
    leave_out(located, &|one| {
        let is_apart = together.is_some_and(|t| (one.instant() - t).abs() > MAX_TIME_DIFFERENCE_S);
        is_apart.then_some(Reason::TimeMismatch)
    });
    if located.len() < 2 {
        // The reason of most of those that are missing; of equals the first.
        let count = |reason: Reason| idle.iter().filter(|(_, other)| *other == reason).count();
        let worst = idle.iter().map(|(_, reason)| *reason).rev().max_by_key(|r| count(*r));
        return Err(worst.unwrap_or(Reason::FewAntennas));
    }
    common_frame(located, pinned_m).ok_or(Reason::FewSatellites)
}

/// The instant of the antenna that most others were sampled together with; of a pinned reference its own.
fn most_together(located: &[Located], is_pinned: bool) -> Option<GpsTime> {
    let beside = |one: &Located| {
        let is_together =
            |other: &&Located| (other.instant() - one.instant()).abs() <= MAX_TIME_DIFFERENCE_S;
        located.iter().filter(is_together).count()
    };
    let candidates = if is_pinned { &located[..located.len().min(1)] } else { located };
    candidates.iter().rev().max_by_key(|one| beside(one)).map(Located::instant)
}

/// Approximate positions of antennas that all have one, but for a reference at a known place.
fn common_frame(located: &[Located], pinned_m: Option<Vector<Ecef>>) -> Option<CommonFrame> {
    let reference = &located[0];
    let own_m = |one: &Located| one.point.as_ref().ok().map(|point| point.position_m);
    let reference_m = pinned_m.or_else(|| own_m(reference))?;
    let velocity_mps = located
        .iter()
        .find_map(|one| one.velocity)
        .map_or(Vector::new(0.0, 0.0, 0.0), |velocity| velocity.velocity_mps);
    let mut positions_m: Vec<Vector<Ecef>> = Vec::with_capacity(located.len());
    let mut approximate_m = Vec::with_capacity(located.len() - 1);
    for one in located {
        let is_reference = one.antenna == reference.antenna;
        let position_m = if is_reference { reference_m } else { own_m(one)? };
        positions_m.push(position_m);
        if !is_reference {
            let later_s = one.instant() - reference.instant();
            // The body moved on between the two receivers' instants: b = x₁(t₁) − x₀(t₀) − v (t₁ − t₀)
            approximate_m.push(position_m - reference_m - velocity_mps * later_s);
        }
    }
    Some(CommonFrame {
        reference: reference.antenna,
        antennas: located.iter().map(|l| l.antenna).collect(),
        horizon: Horizon::at(reference_m),
        contradiction: located.iter().map(Located::contradiction).fold(f64::INFINITY, f64::min),
        positions_m,
        approximate_m,
    })
}

impl Located {
    /// Where the antenna is likely to be at `time`, by this epoch.
    fn expected_m(&self, time: GpsTime) -> Option<Vector<Ecef>> {
        let position_m = self.point.as_ref().ok()?.position_m;
        let later_s = time - self.tag;
        let velocity = self.velocity.filter(|_| later_s.abs() < MAX_EXTRAPOLATION_S);
        Some(velocity.map_or(position_m, |v| position_m + v.velocity_mps * later_s))
    }

    /// Root mean square of the code's residuals over what is expected of them.
    fn contradiction(&self) -> f64 {
        self.point.as_ref().map_or(0.0, |point| point.unit_weight_rms)
    }

    /// True instant of the antenna's epoch: its tag less its clock bias.
    fn instant(&self) -> GpsTime {
        let clock_m = self.point.as_ref().map_or(0.0, |point| point.clock_m);
        self.tag + -clock_m / SPEED_OF_LIGHT_MPS
    }
}

/// Satellites that at least two antennas see (links with fewer than two antennas are gone).
pub(super) fn shared_satellites(links: &[Link]) -> usize {
    links.iter().map(|link| link.satellite).collect::<SatelliteSet>().len()
}
