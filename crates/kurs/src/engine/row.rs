//! The row of an epoch: what each antenna says by itself, then what the array says.

use crate::ephemeris::NavigationData;
use crate::frames::{Body, Geodetic, Vector, skew};
use crate::observation::ArrayEpoch;
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::signal_residuals::{Solved, integer_sums, signal_residuals};
use crate::solution::{
    EpochSolution, IntegerReport, PointEstimate, PositionEstimate, PositionOrigin, Reason,
    SignalReport,
};

use super::body_velocity::body_velocity;
use super::estimator::Estimator;
use super::locate::Located;
use super::search::Found;
use super::settings::Settings;
use super::stages::{Judged, Searched};

impl Estimator {
    /// The row as far as single antennas give it: it is lost until the array gives more.
    pub(super) fn row(
        &self,
        navigation: &NavigationData,
        observed: &ArrayEpoch,
        located: &[Located],
    ) -> EpochSolution {
        let mut row = EpochSolution::lost(observed.time, Reason::FewAntennas);
        row.antennas = located.len();
        let positioned = located.iter().find_map(|l| Some((l, l.point.as_ref().ok()?)));
        let Some((located, point)) = positioned else { return row };
        // The instant of that antenna: its tag less its clock bias.
        let time = located.tag + -point.clock_m / SPEED_OF_LIGHT_MPS;
        row.time_utc = Some(navigation.utc(time));
        row.located_by = point.satellites;
        let ned_from_ecef = point.horizon.ned_from_ecef();
        row.position = Some(PositionEstimate {
            antenna: Some(located.antenna),
            geodetic: point.horizon.geodetic,
            position_m: point.position_m,
            covariance_m2: ned_from_ecef.turn_covariance(&point.covariance_m2),
            velocity_mps: located.velocity.map(|v| ned_from_ecef * v.velocity_mps),
            clock_m: Some(point.clock_m),
            hdop: Some(point.dop.hdop),
            origin: PositionOrigin::Alone,
        });
        row
    }

    /// Adds what was found of the array.
    pub(super) fn fill(&self, row: &mut EpochSolution, judged: &Judged, located: &[Located]) {
        let searched = &judged.oriented.searched;
        let (epoch, fix) = (&searched.epoch, &searched.fix);
        let found = fix.found.as_ref().ok();
        row.outcome = judged.outcome;
        row.satellites = epoch.float.satellites;
        row.residual_rms_m = fix.conditional.as_ref().map(|c| c.residual_rms_m);
        row.baselines = searched.baselines.local(&epoch.frame.horizon, row.status());
        row.integers = Some(IntegerReport {
            ambiguities: epoch.float.ambiguities_cycles.len(),
            success_rate: fix.success_rate,
            ratio: found.map(|found| found.ratio),
            checks: judged.checks.0.clone(),
            left_out: searched.left_out,
            prediction: judged.prediction,
        });
        row.signals = self.settings.residuals.then(|| signal_report(searched));
        let north_rad2 = row.position.as_ref().map_or(0.0, |position| {
            north_variance_rad2(&position.geodetic, position.covariance_m2[(1, 1)])
        });
        place_body(row, &self.settings);
        self.move_body(row, located);
        // Only now: what is on the body has its place whatever is called north there.
        if let Some(attitude) = row.outcome.attitude_mut() {
            attitude.covariance_rad2[(0, 0)] += north_rad2;
            *attitude = attitude.certain_to(self.settings.max_angle_sd_rad);
        }
    }

    /// Takes the velocity of the antenna to the body origin, once the attitude is known.
    fn move_body(&self, row: &mut EpochSolution, located: &[Located]) {
        let ned_from_body = row.outcome.attitude().and_then(|a| a.ned_from_body);
        let (Some(array), Some(ned_from_body)) = (&self.settings.array, ned_from_body) else {
            return;
        };
        let Some(position) = &mut row.position else { return };
        let ecef_from_ned = position.geodetic.ecef_from_ned();
        let velocity_mps = body_velocity(located, array, &(ecef_from_ned * ned_from_body));
        position.velocity_mps = velocity_mps.map(|v| ecef_from_ned.inverse() * v);
    }
}

/// How uncertain the direction of north is, rad²: a place that is off by `δ` eastward is off by
/// `δ / ((N + h) cos φ)` in longitude, and as the meridians meet at the poles their direction by `sin φ` of that:
/// `σ_north = tan φ σ_east / (N + h)`. A metre makes 0.00001° at 45°, and 6° at 10 m from a pole.
fn north_variance_rad2(place: &Geodetic, east_m2: f64) -> f64 {
    let [_, across_m] = place.curvature_radii_m();
    (place.latitude_rad.tan() / (across_m + place.height_m)).powi(2) * east_m2
}

/// What the solution leaves of each signal, and the integers.
fn signal_report(searched: &Searched) -> SignalReport {
    let Searched { epoch, fix, .. } = searched;
    let found = fix.found.as_ref().ok();
    let sure = found.filter(|_| fix.is_sure());
    let solved = Solved {
        rovers: &searched.baselines.rovers,
        correction_m: &searched.correction_m,
        integers: sure.map(|found| found.integers.as_slice()),
    };
    let sums = |found: &Found| integer_sums(&epoch.links, &epoch.groups, &found.integers);
    SignalReport {
        residuals: signal_residuals(&epoch.links, &epoch.groups, &solved),
        integers: found.map(sums).unwrap_or_default(),
        rivals: found.map(|found| found.rivals),
    }
}

/// Moves the position from its antenna to the body origin, and gives the wanted points, once the
/// attitude is known: `G = A + Q (g − l)` (equation 27 of `docs/papers/004-three-antennas.md`). With
/// `Q exp[φ×]` in the place of `Q` the covariance grows by `J P Jᵀ`, `J = −Q [(g − l)×]`, `P` that of `φ`.
pub(crate) fn place_body(row: &mut EpochSolution, settings: &Settings) {
    let (Some(array), Some(position)) = (&settings.array, &mut row.position) else { return };
    let Some(attitude) = row.outcome.attitude() else { return };
    let (Some(ned_from_body), Some(antenna)) = (attitude.ned_from_body, position.antenna) else {
        return;
    };
    let ecef_from_body = position.geodetic.ecef_from_ned() * ned_from_body;
    let (antenna, antenna_m) = (array.positions_m()[antenna], position.position_m);
    let at = |point| antenna_m + ecef_from_body * (point - antenna);
    let (of_antenna_m2, turn_rad2) = (position.covariance_m2, attitude.turn_covariance_rad2());
    let covariance_at = |point: Vector<Body>| {
        let by_turn = ned_from_body.matrix() * skew(&(point - antenna).xyz());
        of_antenna_m2 + by_turn * turn_rad2 * by_turn.transpose()
    };
    let origin = Vector::new(0.0, 0.0, 0.0);
    let points = settings.points_m.iter().enumerate().map(|(index, point)| PointEstimate {
        index,
        geodetic: Geodetic::from_ecef(at(*point)),
        covariance_m2: covariance_at(*point),
    });
    row.points = points.collect();
    position.antenna = None;
    position.position_m = at(origin);
    position.covariance_m2 = covariance_at(origin);
    position.geodetic = Geodetic::from_ecef(position.position_m);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// North of a place a metre further east, seen in the local level axes of the place itself.
    #[test]
    fn north_is_as_uncertain_as_the_meridians_meet() {
        let places = [(-89.99, 500.0), (-60.0, 500e3), (0.0, 0.0), (45.0, 10e3), (89.999, 0.0)];
        for (latitude_deg, height_m) in places {
            let place = Geodetic::from_degrees(latitude_deg, 30.0, height_m);
            let east = place.ecef_from_ned() * Vector::new(0.0, 1.0, 0.0);
            let moved = Geodetic::from_ecef(place.to_ecef() + east);
            let north = place.ecef_from_ned().inverse()
                * (moved.ecef_from_ned() * Vector::new(1.0, 0.0, 0.0));
            let turned_rad = north.xyz().y.atan2(north.xyz().x).abs();
            let sd_rad = north_variance_rad2(&place, 1.0).sqrt();
            assert!((sd_rad - turned_rad).abs() < 1e-3 * turned_rad + 1e-12, "{latitude_deg}");
        }
    }
}
