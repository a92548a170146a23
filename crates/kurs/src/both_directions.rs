//! A session solved from either end: what a backward run says of each epoch, and the row that comes of both.
//!
//! What an engine carries from epoch to epoch – float ambiguities, noise levels, the integers of arcs – comes from
//! earlier epochs in a forward run and from later ones in a backward run ([`Direction::Backward`]). Of one epoch
//! they are two witnesses that have only its own observations in common.
//!
//! * Where both fix, they must agree; otherwise neither is believed ([`Reason::Contradiction`]). Of two that agree
//!   the forward row stands: they share the epoch's errors, so that no mean of them is better than either, and to take
//!   the surer one would be to take the more optimistic one.
//! * Where one fixes, its answer stands with its own standard deviations – unless the other run found the known
//!   lengths or the known array wrong there: that is true of the whole session, and a run needs time to learn it.
//! * Where neither fixes, the forward row stands.
//!
//! [`Direction::Backward`]: crate::engine::Direction::Backward

use crate::chi_square::chi_square_tail;
use crate::solution::{BaselineEstimate, EpochSolution, Reason};
use crate::time::GpsTime;

/// Two fixes with the same integers disagree this rarely, as a share: the level of all checks of right integers.
const FALSE_ALARM: f64 = 1e-5;

/// What a backward run has said: of the fixed rows all, of the others why they are not.
#[derive(Debug, Clone, Default)]
pub struct BackwardRows {
    /// The last epoch first.
    rows: Vec<Hindsight>,
}

#[derive(Debug, Clone)]
struct Hindsight {
    time: GpsTime,
    reason: Option<Reason>,
    fixed: Option<Box<EpochSolution>>,
}

impl BackwardRows {
    /// Takes the next row of the backward run: each is of an earlier epoch than the one before.
    pub fn push(&mut self, row: EpochSolution) {
        let (time, reason) = (row.time, row.reason());
        let fixed = row.is_fixed().then(|| Box::new(row));
        self.rows.push(Hindsight { time, reason, fixed });
    }

    /// The row of an epoch that both runs had, from that of the forward run; a row that only the forward run has
    /// stays as it is. The epochs come in the order of time.
    #[must_use]
    pub fn join(&mut self, mut forward: EpochSolution) -> EpochSolution {
        while self.rows.pop_if(|row| row.time < forward.time).is_some() {}
        let Some(backward) = self.rows.pop_if(|row| row.time == forward.time) else {
            return forward;
        };
        match (forward.is_fixed(), backward.fixed) {
            (true, Some(backward)) if !agree(&forward, &backward) => {
                forward.refuse(Reason::Contradiction);
                forward
            }
            (true, Some(_)) => forward,
            (true, None) => match backward.reason {
                Some(reason) if blames_the_array(reason) => {
                    forward.refuse(reason);
                    forward
                }
                _ => forward,
            },
            (false, Some(_)) if forward.reason().is_some_and(blames_the_array) => forward,
            (false, Some(backward)) => *backward,
            (false, None) => forward,
        }
    }
}

/// Whether this reason is one of the session rather than of the epoch.
fn blames_the_array(reason: Reason) -> bool {
    matches!(reason, Reason::Length | Reason::Geometry)
}

/// Whether the baselines that both have are the same within what they are uncertain by.
fn agree(one: &EpochSolution, other: &EpochSolution) -> bool {
    one.baselines.iter().all(|baseline| {
        let ends = |b: &&BaselineEstimate| (b.base, b.rover) == (baseline.base, baseline.rover);
        other.baselines.iter().find(ends).is_none_or(|other| is_same(baseline, other))
    })
}

fn is_same(one: &BaselineEstimate, other: &BaselineEstimate) -> bool {
    let difference_m = (one.baseline_m - other.baseline_m).xyz();
    // What they have in common cancels, so this is more than the difference is uncertain by.
    let covariance_m2 = one.covariance_m2 + other.covariance_m2;
    covariance_m2.cholesky().is_some_and(|factor| {
        let square = difference_m.dot(&factor.solve(&difference_m));
        chi_square_tail(square, 3) >= FALSE_ALARM
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::frames::Vector;
    use crate::solution::{AttitudeEstimate, Outcome, Status};

    const SD_M: f64 = 0.003;
    const LEVEL: AttitudeEstimate = AttitudeEstimate {
        heading_rad: Some(0.0),
        pitch_rad: None,
        roll_rad: None,
        covariance_rad2: Matrix3::new(1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        installation_rad2: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        ned_from_body: None,
        line_elevation_rad: None,
    };

    fn row(time_s: f64, east_m: f64, outcome: Outcome) -> EpochSolution {
        let time = GpsTime::from_week_tow(2300, time_s).unwrap();
        let mut row = EpochSolution::lost(time, Reason::FewAntennas);
        row.outcome = outcome;
        row.baselines = vec![BaselineEstimate {
            base: 0,
            rover: 1,
            status: row.status(),
            baseline_m: Vector::new(east_m, 1.0, 0.0),
            covariance_m2: Matrix3::identity() * (SD_M * SD_M),
        }];
        row
    }

    fn fixed(time_s: f64, east_m: f64) -> EpochSolution {
        row(time_s, east_m, Outcome::Fixed { attitude: LEVEL })
    }

    fn unsure(time_s: f64) -> EpochSolution {
        row(time_s, 0.0, Outcome::Float { attitude: None, reason: Some(Reason::Ratio) })
    }

    fn joined(forward: EpochSolution, backward: EpochSolution) -> EpochSolution {
        let mut rows = BackwardRows::default();
        rows.push(backward);
        rows.join(forward)
    }

    #[test]
    fn two_fixes_that_agree_are_fixed() {
        let row = joined(fixed(1.0, 2.0), fixed(1.0, 2.01));
        assert_eq!((row.status(), row.reason()), (Status::Fixed, None));
        assert_eq!(row.baselines[0].baseline_m.xyz().x, 2.0);
    }

    #[test]
    fn neither_of_two_that_disagree_is_believed() {
        // 5 cm are 11.8 standard deviations of the difference.
        let row = joined(fixed(1.0, 2.0), fixed(1.0, 2.05));
        let refused = (Status::Inconsistent, Some(Reason::Contradiction));
        assert_eq!((row.status(), row.reason()), refused);
        assert_eq!(row.baselines[0].status, Status::Inconsistent);
    }

    #[test]
    fn the_only_fix_stands() {
        assert_eq!(joined(fixed(1.0, 2.0), unsure(1.0)).status(), Status::Fixed);
        let row = joined(unsure(1.0), fixed(1.0, 2.0));
        assert_eq!((row.status(), row.baselines[0].baseline_m.xyz().x), (Status::Fixed, 2.0));
    }

    #[test]
    fn a_length_found_wrong_from_one_end_is_wrong_from_the_other() {
        let wrong = |time_s| {
            row(time_s, 2.0, Outcome::Inconsistent { attitude: None, reason: Reason::Length })
        };
        assert_eq!(joined(fixed(1.0, 2.0), wrong(1.0)).reason(), Some(Reason::Length));
        assert_eq!(joined(wrong(1.0), fixed(1.0, 2.0)).reason(), Some(Reason::Length));
    }

    #[test]
    fn rows_meet_by_their_time() {
        let mut rows = BackwardRows::default();
        [3.0, 2.0, 1.0].into_iter().for_each(|time_s| rows.push(fixed(time_s, time_s)));
        assert_eq!(rows.join(unsure(2.0)).baselines[0].baseline_m.xyz().x, 2.0);
        assert_eq!(rows.join(unsure(2.5)).status(), Status::Float);
        assert_eq!(rows.join(unsure(3.0)).baselines[0].baseline_m.xyz().x, 3.0);
        assert_eq!(rows.join(unsure(4.0)).status(), Status::Float);
    }
}
