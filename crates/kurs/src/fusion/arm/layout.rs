//! The blocks of the state vector of the rotating-frame filters, named once.
//!
//! `x, y, z, Δ, vx, vy, vz, Δ̇, ax, ay, az, r, p, h, ṙ, ṗ, ḣ`, then as the settings ask: angular
//! accelerations, accelerometer biases, arm angle, one carrier-phase ambiguity for each slot. ECEF,
//! m, s and rad; the clock in m.

use core::ops::Range;

/// Position of the centre of rotation.
pub const POSITION: Range<usize> = 0..3;
/// Δ, receiver clock bias.
pub const CLOCK: usize = 3;
/// Velocity.
pub const VELOCITY: Range<usize> = 4..7;
/// Δ̇, receiver clock rate.
pub const CLOCK_RATE: usize = 7;
/// Acceleration.
pub const ACCELERATION: Range<usize> = 8..11;
/// Angles r, p, h, or the attitude error (rotation vector in body axes).
pub const ATTITUDE: Range<usize> = 11..14;
/// ṙ, ṗ, ḣ, or the angular velocity in body axes.
pub const RATE: Range<usize> = 14..17;
/// States of the paper.
pub const PAPER_STATES: usize = 17;

/// Where the optional blocks are; the ones that are absent are empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// r̈, p̈, ḧ, or the angular acceleration in body axes.
    pub angular_acceleration: Range<usize>,
    /// Accelerometer biases in triad axes.
    pub bias: Range<usize>,
    /// Correction of the arm's angle.
    pub arm_angle: Range<usize>,
    /// Carrier-phase ambiguities in m.
    pub ambiguities: Range<usize>,
}

impl Layout {
    /// The layout of given options.
    #[must_use]
    pub const fn new(
        angular_acceleration: bool,
        bias: bool,
        arm_angle: bool,
        ambiguity_slots: usize,
    ) -> Self {
        let start = PAPER_STATES;
        let after_acceleration = start + if angular_acceleration { 3 } else { 0 };
        let after_bias = after_acceleration + if bias { 3 } else { 0 };
        let after_angle = after_bias + if arm_angle { 1 } else { 0 };
        Self {
            angular_acceleration: start..after_acceleration,
            bias: after_acceleration..after_bias,
            arm_angle: after_bias..after_angle,
            ambiguities: after_angle..after_angle + ambiguity_slots,
        }
    }

    /// Number of states.
    #[must_use]
    pub const fn states(&self) -> usize {
        self.ambiguities.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_follow_each_other() {
        let all = Layout::new(true, true, true, 4);
        assert_eq!(all.angular_acceleration, 17..20);
        assert_eq!(all.bias, 20..23);
        assert_eq!(all.arm_angle, 23..24);
        assert_eq!(all.ambiguities, 24..28);
        assert_eq!(all.states(), 28);
        assert_eq!(Layout::new(false, false, false, 0).states(), 17);
        assert_eq!(Layout::new(true, false, false, 0).states(), 20);
    }
}
