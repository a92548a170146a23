//! Where down is on the body: what is known beforehand of the turn that a line of antennas cannot see.
//!
//! Without anything better a body is level: down is its z axis, give or take the angle that it usually
//! rolls and pitches. Of an array that has lost antennas the last whole attitude is remembered. Its
//! vertical ages as the body swings: with `D` the mean of `ΔΔᵀ`, how it moved in a second so far,
//!
//! ```text
//! C(t) = C₀ + D · max(t, t²)       (t in seconds)
//! ```
//!
//! which is right for slow swings (they go on as they began) and for fast ones (that have turned round
//! by then). A ship rolls more than it pitches, so `D` is a matrix. A body of which nothing was seen yet
//! is taken to move in a second by as much as it may be off level; that stays one observation of `D`.

use nalgebra::{Matrix3, Matrix3x2};

use crate::frames::{Body, Vector};
use crate::solution::AttitudeEstimate;
use crate::time::GpsTime;

/// Verticals less than this apart are not compared: their noise would pass for a swing, s.
const MIN_LAG_S: f64 = 1.0;
/// Time in which what was seen of the swing fades to 1/e, s: some periods of a ship.
const FADING_S: f64 = 60.0;

/// The downward vertical in body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertical {
    /// Unit vector.
    pub down: Vector<Body>,
    /// Covariance of it, across (rank two), rad².
    pub covariance_rad2: Matrix3<f64>,
    /// Whether it was measured, by an earlier epoch; otherwise the body is supposed to be level.
    pub is_measured: bool,
}

/// The vertical of the last whole attitude, and how it ages.
#[derive(Debug, Clone, PartialEq)]
pub struct VerticalMemory {
    level_sd_rad: f64,
    last: Option<(GpsTime, Vertical)>,
    /// The one that the next is compared with.
    compared: Option<(GpsTime, Vector<Body>)>,
    /// Faded sum of `ΔΔᵀ` over squared lags, rad²/s², and for how many it counts.
    swings: Matrix3<f64>,
    count: f64,
}

impl Vertical {
    /// Of a body that is level give or take `sd_rad`, in roll and in pitch.
    #[must_use]
    pub fn level(sd_rad: f64) -> Self {
        let down = Vector::new(0.0, 0.0, 1.0);
        Self { down, covariance_rad2: across(&down) * sd_rad.powi(2), is_measured: false }
    }

    /// As an attitude has it: `Qᵀ d = (−sin p, cos p sin r, cos p cos r)`; `None` without pitch and
    /// roll.
    #[must_use]
    pub fn measured(attitude: &AttitudeEstimate) -> Option<Self> {
        let (sp, cp) = attitude.pitch_rad?.sin_cos();
        let (sr, cr) = attitude.roll_rad?.sin_cos();
        let by_angles = Matrix3x2::new(-cp, 0.0, -sp * sr, cp * cr, -sp * cr, -cp * sr);
        let of_angles = attitude.covariance_rad2.fixed_view::<2, 2>(1, 1);
        Some(Self {
            down: Vector::new(-sp, cp * sr, cp * cr),
            covariance_rad2: by_angles * of_angles * by_angles.transpose(),
            is_measured: true,
        })
    }

    /// `aᵀ C a`, `a = e × m / ‖e × m‖`: variance of the vertical in a turn about the line `e`, rad².
    pub(super) fn variance_rad2(&self, line: &Vector<Body>) -> f64 {
        let a = line.cross(&self.down).direction().xyz();
        a.dot(&(self.covariance_rad2 * a))
    }
}

impl VerticalMemory {
    /// Of a body that is level give or take `level_sd_rad`.
    #[must_use]
    pub fn new(level_sd_rad: f64) -> Self {
        Self { level_sd_rad, last: None, compared: None, swings: Matrix3::zeros(), count: 0.0 }
    }

    /// Takes in an attitude that is sure; one from a line of antennas says nothing new.
    pub fn remember(&mut self, time: GpsTime, attitude: &AttitudeEstimate) {
        let whole = Some(attitude).filter(|a| a.line_elevation_rad.is_none());
        let Some(vertical) = whole.and_then(Vertical::measured) else { return };
        self.last = Some((time, vertical));
        let Some((before, down_before)) = self.compared else {
            self.compared = Some((time, vertical.down));
            return;
        };
        let lag_s = time - before;
        if lag_s.abs() < MIN_LAG_S {
            return;
        }
        let keep = (-lag_s.abs() / FADING_S).exp();
        let rate = (vertical.down - down_before).xyz() / lag_s;
        self.swings = keep * self.swings + rate * rate.transpose();
        self.count = keep * self.count + 1.0;
        self.compared = Some((time, vertical.down));
    }

    /// What is known at a time, for a turn about the line of antennas `line` (unit vector): the last
    /// vertical with its age, or, once a level body is the better guess, that.
    #[must_use]
    pub fn at(&self, time: GpsTime, line: &Vector<Body>) -> Vertical {
        let level = Vertical::level(self.level_sd_rad);
        let Some((then, mut vertical)) = self.last else { return level };
        let age_s = (time - then).max(0.0);
        let swing_rad2 =
            (across(&vertical.down) * self.level_sd_rad.powi(2) + self.swings) / (1.0 + self.count);
        vertical.covariance_rad2 += swing_rad2 * age_s.max(age_s * age_s);
        let is_better = vertical.variance_rad2(line) < level.variance_rad2(line);
        if is_better { vertical } else { level }
    }
}

/// `I − d dᵀ`.
fn across(down: &Vector<Body>) -> Matrix3<f64> {
    Matrix3::identity() - down.xyz() * down.xyz().transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Attitude;
    use proptest::prelude::*;

    fn attitude(pitch_rad: f64, roll_rad: f64, sd_rad: f64) -> AttitudeEstimate {
        let angles = Attitude { heading_rad: 2.0, pitch_rad, roll_rad };
        AttitudeEstimate::full(angles.ned_from_body(), &(Matrix3::identity() * sd_rad.powi(2)))
    }

    fn at(second: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, second).unwrap()
    }

    proptest! {
        #[test]
        fn an_attitude_knows_down(pitch in -1.4..1.4f64, roll in -3.0..3.0f64) {
            let estimate = attitude(pitch, roll, 0.01);
            let found = Vertical::measured(&estimate).unwrap();
            let down = estimate.ned_from_body.unwrap().inverse() * Vector::new(0.0, 0.0, 1.0);
            prop_assert!((found.down - down).norm() < 1e-12);
            // A turn that is alike about all axes moves any direction alike about both across it.
            let expected = across(&down) * 1e-4;
            prop_assert!((found.covariance_rad2 - expected).norm() < 1e-12);
        }
    }

    /// A ship that rolls ±10° in 8 s loses its roll within a second, but not its pitch; a body at rest
    /// keeps both for longer. All end at the level body.
    #[test]
    fn the_vertical_ages_as_the_body_swings() {
        let lifetime_s = |amplitude_deg: f64, line: [f64; 3]| {
            let line = Vector::from_xyz(line.into());
            let mut memory = VerticalMemory::new(5f64.to_radians());
            for second in 0..120 {
                let phase = f64::from(second) * core::f64::consts::TAU / 8.0;
                let roll_rad = (2.0 + amplitude_deg * phase.sin()).to_radians();
                memory.remember(at(f64::from(second)), &attitude(0.0, roll_rad, 0.002));
            }
            let is_measured = |age: u32| memory.at(at(119.0 + f64::from(age)), &line).is_measured;
            assert!(is_measured(0));
            (1..600).find(|age| !is_measured(*age)).unwrap()
        };
        let (forward, right) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        // √D: 10° · 2 sin(π/8) / √2 = 5.4° a second; at rest 5° / √53, of 52 comparisons in memory.
        assert_eq!(lifetime_s(10.0, forward), 1);
        assert_eq!(lifetime_s(10.0, right), 8);
        assert_eq!(lifetime_s(0.0, forward), 8);
    }

    #[test]
    fn a_line_says_nothing_new() {
        let mut memory = VerticalMemory::new(0.1);
        let forward = Vector::new(1.0, 0.0, 0.0);
        assert_eq!(memory.at(at(0.0), &forward), Vertical::level(0.1));
        let line = AttitudeEstimate { line_elevation_rad: Some(0.2), ..attitude(0.2, 0.0, 0.01) };
        memory.remember(at(0.0), &line);
        assert_eq!(memory.at(at(0.0), &forward), Vertical::level(0.1));
        memory.remember(at(1.0), &attitude(0.2, 0.0, 0.01));
        let found = memory.at(at(1.0), &forward);
        assert!(found.is_measured && (found.down.xyz().x + 0.2f64.sin()).abs() < 1e-12);
    }
}
