//! Whether the array is what the configuration says: geometry does not change from epoch to epoch,
//! so an epoch that fits among many that do not fits by chance.

use crate::solution::{Reason, Status};

/// Share of an epoch in the running average: ten epochs count.
const WEIGHT: f64 = 0.1;
/// Recent share of misfits from which on no epoch is trusted: three in a row, or every fourth.
const DOUBTFUL: f64 = 0.25;

/// Running share of the epochs with integers whose baselines break the known geometry.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GeometryDoubt {
    misfits: f64,
}

impl GeometryDoubt {
    /// The verdict on an epoch in the light of those before.
    pub(super) fn judge(
        &mut self,
        status: Status,
        reason: Option<Reason>,
    ) -> (Status, Option<Reason>) {
        let misfit = matches!(reason, Some(Reason::Length | Reason::Geometry));
        if misfit || status == Status::Fixed {
            self.misfits += WEIGHT * (f64::from(u8::from(misfit)) - self.misfits);
        }
        if status == Status::Fixed && self.misfits > DOUBTFUL {
            (Status::Inconsistent, Some(Reason::Geometry))
        } else {
            (status, reason)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIXED: (Status, Option<Reason>) = (Status::Fixed, None);
    const MISFIT: (Status, Option<Reason>) = (Status::Inconsistent, Some(Reason::Length));

    #[test]
    fn one_misfit_is_chance_many_are_not() {
        let mut doubt = GeometryDoubt::default();
        let mut judge = |(status, reason)| doubt.judge(status, reason);
        assert_eq!([judge(FIXED), judge(MISFIT), judge(FIXED)], [FIXED, MISFIT, FIXED]);
        for _ in 0..5 {
            assert_eq!(judge(MISFIT), MISFIT);
        }
        assert_eq!(judge(FIXED), (Status::Inconsistent, Some(Reason::Geometry)));
        // The array was set right, or the reflections are over.
        let recovered = (0..20).filter(|_| judge(FIXED) == FIXED).count();
        assert!((10..20).contains(&recovered), "{recovered}");
        // Epochs without integers say nothing.
        let float = (Status::Float, Some(Reason::Ratio));
        assert_eq!([judge(float), judge(FIXED)], [float, FIXED]);
    }
}
