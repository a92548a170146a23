//! Attitude of antennas on one line: two angles are measured, the third has to be known beforehand.
//!
//! The antennas lie along `e` on the body and are seen along `u` outside: `Q e = u`. That leaves the
//! turns about the line, `Q exp[ψ e]×`, of which the antennas see nothing. What is known of them is the
//! vertical `d`, which should be near `m` on the body ([`Vertical`]). With the covariance `C` of `m`,
//!
//! ```text
//! ½ (Qᵀd − m)ᵀ C⁻¹ (Qᵀd − m) → min over ψ
//! ```
//!
//! Along the line the deviation is measured, whatever `ψ`, and the prior has no say there: the pitch of
//! a line along the body is its elevation, unbiased. Across it `Qᵀd` goes round a circle of radius
//! `cₙ = ‖u × d‖`, `m` has the distance `c_b = ‖e × m‖`, and the squared deviation is
//! `cₙ² + c_b² − 2 cₙ c_b cos ψ`: the minimum has `m` in the plane of line and vertical (TRIAD of
//! `(e, m)` and `(u, d)`), and about it
//!
//! ```text
//! var ψ = aᵀ C a / (cₙ c_b),     a = e × m / c_b
//! ```
//!
//! which grows without limit as the line becomes vertical. The covariance of the angles is that of the
//! direction, and the second moments about the most probable attitude of what `ψ` does to them, by
//! Gauss and Hermite's rule of three nodes (exact to `ψ⁴`: a level line turned about itself changes the
//! heading in the second order).

use nalgebra::{Matrix3, Vector3};

use super::angles::{angle_covariance, angles_from_rotation_vector};
use super::triad::triad;
use super::vertical::Vertical;
use super::weighted::exponential;
use crate::frames::{Attitude, Body, Ned, Rotation, Vector, skew};
use crate::solution::AttitudeEstimate;

/// A line sees an angle of which less than this share of a turn about the line is part: a line within
/// 30° of the forward axis sees the pitch, one within 30° of straight across the roll.
const MAX_UNSEEN_SHARE: f64 = 0.5;
/// Nodes further out than this would come round again, rad.
const MAX_NODE_RAD: f64 = 2.0 * core::f64::consts::FRAC_PI_3;

/// Antennas on one line, and where they were seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredLine {
    /// The line on the body, `e`, a unit vector.
    pub axis: Vector<Body>,
    /// The line outside, `u`, a unit vector.
    pub direction: Vector<Ned>,
    /// Covariance of `u`, across it (rank two), rad².
    pub covariance_rad2: Matrix3<f64>,
}

impl MeasuredLine {
    /// The most probable rotation of the body; `None` for a line along the vertical, outside or on
    /// the body.
    #[must_use]
    pub fn ned_from_body(&self, vertical: &Vertical) -> Option<Rotation<Ned, Body>> {
        let (e, u) = (self.axis.xyz(), self.direction.xyz());
        let matrix = triad([&e, &vertical.down.xyz()], [&u, &Vector3::z()]).ok()?;
        Some(Rotation::from_matrix(matrix))
    }

    /// `√var ψ`, rad.
    fn unseen_sd_rad(&self, vertical: &Vertical) -> f64 {
        let c_body = self.axis.cross(&vertical.down).norm();
        let c_outside = self.direction.xyz().xy().norm();
        (vertical.variance_rad2(&self.axis) / (c_outside * c_body)).sqrt()
    }
}

impl AttitudeEstimate {
    /// What a line of antennas tells, with what is known of the vertical.
    ///
    /// Where the vertical is only supposed, angles that the line does not see are left out; an
    /// estimate of a line along the vertical has nothing but its elevation. Uncertain angles are in
    /// it: see [`AttitudeEstimate::certain_to`]. `installation_body_rad2` is the part of the
    /// covariance that the survey of the antennas causes, as for
    /// [`AttitudeEstimate::with_installation`].
    #[must_use]
    pub fn of_line(
        line: &MeasuredLine,
        vertical: &Vertical,
        installation_body_rad2: &Matrix3<f64>,
    ) -> Self {
        let elevation_rad = (-line.direction.xyz().z).clamp(-1.0, 1.0).asin();
        let Some(ned_from_body) = line.ned_from_body(vertical) else {
            return Self::of_elevation(elevation_rad);
        };
        let (e, q) = (line.axis.xyz(), ned_from_body.matrix());
        let angles = Attitude::from_ned_from_body(&ned_from_body);
        // θ = e × Qᵀ ∂u
        let by_direction = skew(&e) * q.transpose();
        let seen_rad2 = by_direction * line.covariance_rad2 * by_direction.transpose();
        let of_unseen_rad2 = moments_of_turn(&ned_from_body, &e, line.unseen_sd_rad(vertical));
        let estimate = Self {
            line_elevation_rad: Some(elevation_rad),
            covariance_rad2: angle_covariance(&angles, &seen_rad2) + of_unseen_rad2,
            ..Self::full(ned_from_body, &seen_rad2).with_installation(installation_body_rad2)
        };
        if vertical.is_measured {
            return estimate;
        }
        let [_, of_pitch, of_roll] = (angles_from_rotation_vector(&angles) * e).into();
        Self {
            pitch_rad: estimate.pitch_rad.filter(|_| f64::abs(of_pitch) < MAX_UNSEEN_SHARE),
            roll_rad: estimate.roll_rad.filter(|_| f64::abs(of_roll) < MAX_UNSEEN_SHARE),
            ned_from_body: None,
            ..estimate
        }
    }

    /// Of a line along the vertical.
    fn of_elevation(elevation_rad: f64) -> Self {
        Self {
            heading_rad: None,
            pitch_rad: None,
            roll_rad: None,
            covariance_rad2: Matrix3::zeros(),
            installation_rad2: Matrix3::zeros(),
            ned_from_body: None,
            line_elevation_rad: Some(elevation_rad),
        }
    }
}

/// Second moments of heading, pitch and roll, rad², when the body turns by `N(0, sd²)` about `axis`:
/// `⅙ Σ δ δᵀ` over the nodes `±√3 sd`.
fn moments_of_turn(
    ned_from_body: &Rotation<Ned, Body>,
    axis: &Vector3<f64>,
    sd_rad: f64,
) -> Matrix3<f64> {
    let angles_at = |turn_rad: f64| {
        let turned = ned_from_body.matrix() * exponential(&(axis * turn_rad));
        let Attitude { heading_rad, pitch_rad, roll_rad } =
            Attitude::from_ned_from_body(&Rotation::from_matrix(turned));
        Vector3::new(heading_rad, pitch_rad, roll_rad)
    };
    let here = angles_at(0.0);
    let node_rad = (3f64.sqrt() * sd_rad).min(MAX_NODE_RAD);
    [node_rad, -node_rad]
        .map(|turn_rad| {
            let change = (angles_at(turn_rad) - here).map(|angle| angle.sin().atan2(angle.cos()));
            change * change.transpose() / 6.0
        })
        .iter()
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    const SD_RAD: f64 = 0.003;

    fn level(sd_deg: f64) -> Vertical {
        Vertical::level(sd_deg.to_radians())
    }

    /// The line of a body that stands like this, with `SD_RAD` about both axes across it.
    fn line_of(axis: [f64; 3], attitude: &Attitude) -> MeasuredLine {
        let axis = Vector::from_xyz(Vector3::from(axis).normalize());
        let direction = attitude.ned_from_body() * axis;
        let u = direction.xyz();
        let covariance_rad2 = (Matrix3::identity() - u * u.transpose()) * SD_RAD.powi(2);
        MeasuredLine { axis, direction, covariance_rad2 }
    }

    fn estimate(axis: [f64; 3], attitude: &Attitude) -> AttitudeEstimate {
        AttitudeEstimate::of_line(&line_of(axis, attitude), &level(5.0), &Matrix3::zeros())
    }

    fn sd_deg(estimate: &AttitudeEstimate, angle: usize) -> f64 {
        estimate.covariance_rad2[(angle, angle)].sqrt().to_degrees()
    }

    proptest! {
        /// Along the body the line is heading and pitch; how the body rolls does not touch them.
        #[test]
        fn a_line_along_the_body(
            heading_rad in 0.0..core::f64::consts::TAU, pitch_rad in -1.2..1.2f64, roll_rad in -1.0..1.0f64,
        ) {
            let attitude = Attitude { heading_rad, pitch_rad, roll_rad };
            let found = estimate([1.0, 0.0, 0.0], &attitude);
            prop_assert!((found.heading_rad.unwrap() - heading_rad).abs() < 1e-9);
            prop_assert!((found.pitch_rad.unwrap() - pitch_rad).abs() < 1e-9);
            prop_assert_eq!((found.roll_rad, found.ned_from_body), (None, None));
            prop_assert!((found.line_elevation_rad.unwrap() - pitch_rad).abs() < 1e-9);
            let expected = [SD_RAD / pitch_rad.cos(), SD_RAD];
            for (angle, expected) in expected.iter().enumerate() {
                let sd_rad = found.covariance_rad2[(angle, angle)].sqrt();
                prop_assert!((sd_rad / expected - 1.0).abs() < 1e-6, "{angle}: {sd_rad}");
            }
        }
    }

    #[test]
    fn a_line_across_the_body_gives_heading_and_roll() {
        let attitude = Attitude { heading_rad: 1.0, pitch_rad: 0.0, roll_rad: 0.1 };
        let found = estimate([0.0, 2.0, 0.0], &attitude);
        assert!((found.heading_rad.unwrap() - 1.0).abs() < 1e-12);
        assert!((found.roll_rad.unwrap() - 0.1).abs() < 1e-12);
        assert_eq!((found.pitch_rad, found.ned_from_body), (None, None));
        // To the left the line falls where that to the right rises.
        let left = estimate([0.0, -2.0, 0.0], &attitude);
        assert!((left.roll_rad.unwrap() - 0.1).abs() < 1e-12);
        assert!((left.line_elevation_rad.unwrap() - 0.1).abs() < 1e-12);
    }

    #[test]
    fn an_oblique_line_gives_heading_and_its_elevation() {
        let attitude = Attitude { heading_rad: 4.0, pitch_rad: 0.0, roll_rad: 0.0 };
        let found = estimate([1.0, 1.0, 0.0], &attitude);
        assert!((found.heading_rad.unwrap() - 4.0).abs() < 1e-12);
        assert_eq!((found.pitch_rad, found.roll_rad), (None, None));
        assert!(found.line_elevation_rad.unwrap().abs() < 1e-12);
        // Turned by ψ about itself, a level line at 45° changes the heading by ψ²/4:
        // √(SD² + 3 (σ²/4)²).
        let expected = (SD_RAD.powi(2) + 3.0 * (5f64.to_radians().powi(2) / 4.0).powi(2)).sqrt();
        assert!((sd_deg(&found, 0) / expected.to_degrees() - 1.0).abs() < 0.02);
    }

    /// A line that also rises on the body: the unknown roll goes into the heading, `e_z/e_x` of it.
    #[test]
    fn a_rising_line_is_less_certain_of_the_heading() {
        let attitude = Attitude { heading_rad: 4.0, pitch_rad: 0.0, roll_rad: 0.0 };
        let found = estimate([1.0, 0.0, -0.25], &attitude);
        let expected = (SD_RAD.to_degrees() / 0.97).hypot(5.0 * 0.25);
        assert!((sd_deg(&found, 0) / expected - 1.0).abs() < 0.02, "{}", sd_deg(&found, 0));
        assert!(found.pitch_rad.is_some() && found.roll_rad.is_none());
        let mast = estimate([0.1, 0.0, -1.0], &attitude).certain_to(5f64.to_radians());
        assert_eq!(mast.heading_rad, None, "ten times the roll");
        let upright = estimate([0.0, 0.0, -1.0], &attitude);
        assert_eq!(upright.angles_rad(), [None; 3]);
        assert!((upright.line_elevation_rad.unwrap().to_degrees() - 90.0).abs() < 1e-9);
    }

    /// The last known vertical takes the place of the level one: all three angles come back.
    #[test]
    fn a_known_vertical_completes_the_attitude() {
        let attitude = Attitude { heading_rad: 3.0, pitch_rad: 0.2, roll_rad: -0.3 };
        let full = AttitudeEstimate::full(attitude.ned_from_body(), &(Matrix3::identity() * 1e-4));
        let vertical = Vertical::measured(&full).unwrap();
        // Since then the body has turned, but not tilted.
        let now = Attitude { heading_rad: 1.0, ..attitude };
        let line = line_of([0.3, 1.0, -0.2], &now);
        let found = AttitudeEstimate::of_line(&line, &vertical, &Matrix3::zeros());
        let error = found.ned_from_body.unwrap().matrix() - now.ned_from_body().matrix();
        assert!(error.norm() < 1e-12, "{error}");
        assert!(found.angles_rad().iter().all(Option::is_some));
    }

    /// Bodies that roll and pitch by 5° at random: for lines in every direction the squares of the
    /// errors are as large as their variances say (99.9 % of the mean of 4000, whose squares have at
    /// most the variance 2 of a χ², 10 where the heading depends on the square of the roll).
    #[test]
    fn errors_are_as_large_as_they_say() {
        const BODIES: usize = 4000;
        let mut random = Xoshiro256PlusPlus::seed_from_u64(31);
        let mut normal = |sd: f64| -> f64 { sd * random.sample::<f64, _>(StandardNormal) };
        let axes = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.2, 1.2, 0.0],
            [1.0, 0.0, -0.25],
            [1.0, 1.0, 0.0],
            [42.0, 0.0, -2.0],
            [-1.0, 0.3, 0.1],
            [1.0, 0.5, -0.6],
        ];
        for axis in axes {
            let mut squares = [(0.0, 0usize); 3];
            for body in 0..BODIES {
                let heading_rad = 0.01 + (body as f64) * 1.5e-3;
                let (pitch_rad, roll_rad) = (normal(5f64.to_radians()), normal(5f64.to_radians()));
                let truth = Attitude { heading_rad, pitch_rad, roll_rad };
                let mut line = line_of(axis, &truth);
                let noise = Vector3::from_fn(|_, _| normal(SD_RAD));
                line.direction = Vector::from_xyz(line.direction.xyz() + noise).direction();
                let found = AttitudeEstimate::of_line(&line, &level(5.0), &Matrix3::zeros());
                let wanted = [heading_rad, pitch_rad, roll_rad];
                for (k, angle) in found.angles_rad().into_iter().enumerate() {
                    let Some(angle) = angle else { continue };
                    let error = (angle - wanted[k]).sin();
                    squares[k].0 += error * error / found.covariance_rad2[(k, k)];
                    squares[k].1 += 1;
                }
            }
            for (k, (sum, count)) in squares.into_iter().enumerate().filter(|(_, s)| s.1 > 0) {
                let (mean, band) = (sum / count as f64, 3.29 * (10.0 / count as f64).sqrt());
                assert!((mean - 1.0).abs() < band, "{axis:?}, angle {k}: {mean} ± {band}");
            }
        }
    }
}
