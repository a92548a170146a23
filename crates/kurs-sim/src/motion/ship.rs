//! A ship on a straight course in a swell: every motion is a sum of waves around one period.

use core::f64::consts::TAU;

use kurs::frames::{Attitude, wrap_heading};

use super::{LevelPlane, Pose};
use crate::noise::Noise;
use crate::scenario::MotionPlan;

/// Waves of the spectrum: frequencies of a narrow band around the dominant one.
const WAVES: usize = 8;
/// Half the width of the band, as a share of the dominant frequency.
const HALF_BAND: f64 = 0.35;

/// See the module.
#[derive(Debug, Clone)]
pub struct Ship {
    plane: LevelPlane,
    heading_rad: f64,
    speed_mps: f64,
    roll: Swell,
    pitch: Swell,
    yaw: Swell,
    heave: Swell,
}

/// Waves of one degree of freedom: amplitude, angular frequency, phase.
#[derive(Debug, Clone)]
struct Swell([(f64, f64, f64); WAVES]);

impl Ship {
    pub(super) fn new(plan: &MotionPlan, noise: &mut Noise) -> Result<Self, String> {
        let MotionPlan::Ship {
            place,
            heading_deg,
            speed_mps,
            period_s,
            roll_rms_deg,
            pitch_rms_deg,
            yaw_rms_deg,
            heave_rms_m,
        } = plan
        else {
            return Err("not the plan of a ship".to_owned());
        };
        if *period_s <= 0.0 {
            return Err(format!("period_s: {period_s} must be above 0"));
        }
        let mut swell = |rms: f64| Swell::new(rms, TAU / period_s, noise);
        Ok(Self {
            plane: LevelPlane::at(place),
            heading_rad: heading_deg.to_radians(),
            speed_mps: *speed_mps,
            roll: swell(roll_rms_deg.to_radians()),
            pitch: swell(pitch_rms_deg.to_radians()),
            yaw: swell(yaw_rms_deg.to_radians()),
            heave: swell(*heave_rms_m),
        })
    }

    pub(super) fn pose(&self, time_s: f64) -> Pose {
        let (sin, cos) = self.heading_rad.sin_cos();
        let way_m = self.speed_mps * time_s;
        Pose {
            position_m: self.plane.point_m(way_m * sin, way_m * cos, self.heave.at(time_s)),
            attitude: Attitude {
                heading_rad: wrap_heading(self.heading_rad + self.yaw.at(time_s)),
                pitch_rad: self.pitch.at(time_s),
                roll_rad: self.roll.at(time_s),
            },
        }
    }
}

impl Swell {
    /// A bell-shaped spectrum with this RMS.
    fn new(rms: f64, frequency_radps: f64, noise: &mut Noise) -> Self {
        let place = |k: usize| 2.0 * k as f64 / (WAVES - 1) as f64 - 1.0;
        let power = |k: usize| (-2.0 * place(k) * place(k)).exp();
        let total: f64 = (0..WAVES).map(power).sum();
        Self(core::array::from_fn(|k| {
            // The RMS of a sine of amplitude a is a / √2.
            let amplitude = rms * (2.0 * power(k) / total).sqrt();
            (amplitude, frequency_radps * (1.0 + HALF_BAND * place(k)), TAU * noise.uniform())
        }))
    }

    fn at(&self, time_s: f64) -> f64 {
        self.0.iter().map(|(a, w, phase)| a * (w * time_s + phase).sin()).sum()
    }
}
