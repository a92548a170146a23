//! What the integers of a run went through: the checks that they failed, what they do without, and
//! the antennas that had no part.

use std::collections::{BTreeMap, BTreeSet};

use kurs::solution::{Check, EpochSolution, LeftOut, Reason};
use serde::Serialize;

/// Counts over the rows of a run.
#[derive(Debug, Clone, Default)]
pub(crate) struct Integers {
    rows: u64,
    checks: BTreeMap<Reason, Checked>,
    left_out: BTreeMap<String, u64>,
    idle: BTreeMap<(usize, Reason), u64>,
}

/// One kind of check.
#[derive(Debug, Clone, Copy)]
struct Checked {
    rows: u64,
    failed: u64,
    /// The least probable of all.
    worst: Check,
}

/// A kind of check in `doctor.json`.
#[derive(Debug, Serialize)]
pub(crate) struct CheckRow {
    reason: &'static str,
    /// Epochs whose integers went through it, and of these the ones that failed.
    epochs: u64,
    failed: u64,
    /// The least probable of all, its degrees of freedom (0 where it has no distribution), its
    /// probability, and the least that is accepted.
    statistic: f64,
    degrees_of_freedom: usize,
    p_value: f64,
    level: f64,
}

/// Something that the integers of some epochs do without, in `doctor.json`.
#[derive(Debug, Serialize)]
pub(crate) struct LeftOutRow<'a> {
    what: &'a str,
    epochs: u64,
}

/// An antenna without a part in some epochs, in `doctor.json`.
#[derive(Debug, Serialize)]
pub(crate) struct IdleRow<'a> {
    pub(crate) antenna: &'a str,
    pub(crate) reason: &'static str,
    pub(crate) epochs: u64,
}

impl Integers {
    /// Counts all these rows; `names`: the antennas.
    pub(crate) fn of(rows: &[EpochSolution], names: &[String]) -> Self {
        let mut counted = Self::default();
        rows.iter().for_each(|row| counted.add(row, names));
        counted
    }

    /// Takes a row in.
    pub(crate) fn add(&mut self, row: &EpochSolution, names: &[String]) {
        self.rows += 1;
        let mut gone_through = BTreeSet::new();
        let mut failed = BTreeSet::new();
        for idle in &row.idle_antennas {
            *self.idle.entry(*idle).or_default() += 1;
        }
        let Some(integers) = &row.integers else { return };
        for check in &integers.checks {
            let first = Checked { rows: 0, failed: 0, worst: *check };
            let of_kind = self.checks.entry(check.reason).or_insert(first);
            // NaN is worst of all.
            if check.p_value.is_nan() || check.p_value < of_kind.worst.p_value {
                of_kind.worst = *check;
            }
            of_kind.rows += u64::from(gone_through.insert(check.reason));
            of_kind.failed += u64::from(check.fails() && failed.insert(check.reason));
        }
        if let Some(left_out) = integers.left_out {
            *self.left_out.entry(words(left_out, names)).or_default() += 1;
        }
    }

    /// Every kind of check that some epoch failed.
    pub(crate) fn failed(&self) -> Vec<CheckRow> {
        let failed = self.checks.iter().filter(|(_, checked)| checked.failed > 0);
        let row = |(reason, checked): (&Reason, &Checked)| CheckRow {
            reason: reason.word(),
            epochs: checked.rows,
            failed: checked.failed,
            statistic: checked.worst.statistic,
            degrees_of_freedom: checked.worst.degrees_of_freedom,
            p_value: checked.worst.p_value,
            level: checked.worst.level,
        };
        failed.map(row).collect()
    }

    /// What the integers do without, the most frequent first.
    pub(crate) fn left_out(&self) -> Vec<LeftOutRow<'_>> {
        let rows = self.left_out.iter().map(|(what, epochs)| LeftOutRow { what, epochs: *epochs });
        let mut rows: Vec<_> = rows.collect();
        rows.sort_by_key(|row| std::cmp::Reverse(row.epochs));
        rows
    }

    /// Antennas that had observations and no part.
    pub(crate) fn idle<'a>(&self, names: &'a [String]) -> Vec<IdleRow<'a>> {
        let row = |((antenna, reason), epochs): (&(usize, Reason), &u64)| IdleRow {
            antenna: &names[*antenna],
            reason: reason.word(),
            epochs: *epochs,
        };
        self.idle.iter().map(row).collect()
    }

    /// Everything in sentences.
    pub(crate) fn sentences(&self, names: &[String]) -> Vec<String> {
        let checks = self.failed().into_iter().map(|row| row.sentence());
        let left_out = self.left_out().into_iter().map(|LeftOutRow { what, epochs }| {
            format!("integers without {what} in {epochs} of {} epochs", self.rows)
        });
        let idle = self.idle(names).into_iter().map(|IdleRow { antenna, reason, epochs }| {
            format!("antenna {antenna} had no part in {epochs} of {} epochs: `{reason}`", self.rows)
        });
        checks.chain(left_out).chain(idle).collect()
    }

    /// What is known of the check that gave rows this reason.
    pub(crate) fn sentence_of(&self, word: &str) -> Option<String> {
        self.failed().into_iter().find(|row| row.reason == word).map(|row| row.sentence())
    }
}

impl CheckRow {
    fn sentence(&self) -> String {
        let Self { reason, epochs, failed, statistic, degrees_of_freedom, p_value, level } = self;
        let worst = match degrees_of_freedom {
            0 => String::new(),
            _ => format!(
                "; at worst {statistic:.1} with {degrees_of_freedom} degrees of freedom, whose probability is \
                 {p_value:.0e} (accepted from {level:.0e})"
            ),
        };
        format!("check `{reason}` failed in {failed} of {epochs} epochs{worst}")
    }
}

/// What was left out.
fn words(left_out: LeftOut, names: &[String]) -> String {
    match left_out {
        LeftOut::MixedReceiverPhases => "phases with unknown biases between mixed receivers".into(),
        LeftOut::System(system) => format!("all of {system}"),
        LeftOut::Code => "code".into(),
        LeftOut::Link { antenna, satellite } => {
            format!("the phases of {satellite} at {}", names[antenna])
        }
        LeftOut::Band(band) => format!("the phases of band {band}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::IntegerReport;
    use kurs::time::GpsTime;

    fn check(reason: Reason, p_value: f64) -> Check {
        Check { reason, statistic: 80.0, degrees_of_freedom: 12, p_value, level: 1e-5 }
    }

    fn row(checks: Vec<Check>, left_out: Option<LeftOut>) -> EpochSolution {
        let mut row = EpochSolution::lost(GpsTime::default(), Reason::Residuals);
        let mut integers = IntegerReport::default();
        (integers.checks, integers.left_out) = (checks, left_out);
        row.integers = Some(integers);
        row
    }

    #[test]
    fn a_kind_of_check_fails_once_in_an_epoch() {
        let names = ["A", "B"].map(str::to_owned);
        let satellite = "G07".parse().unwrap();
        let two_lengths = [3e-6, 2e-11].map(|p| check(Reason::Length, p));
        let mut idle = row(two_lengths.to_vec(), None);
        idle.idle_antennas = vec![(1, Reason::FewSatellites)];
        let rows = [
            row([0.5, 0.4].map(|p| check(Reason::Length, p)).to_vec(), None),
            idle,
            row(vec![check(Reason::Tilt, 1.0)], Some(LeftOut::Link { antenna: 1, satellite })),
        ];
        let counted = Integers::of(&rows, &names);
        assert_eq!(
            counted.sentences(&names),
            [
                "check `length` failed in 1 of 2 epochs; at worst 80.0 with 12 degrees of freedom, whose \
                 probability is 2e-11 (accepted from 1e-5)",
                "integers without the phases of G07 at B in 1 of 3 epochs",
                "antenna B had no part in 1 of 3 epochs: `few_satellites`",
            ]
        );
        assert_eq!(counted.sentence_of("tilt"), None);
    }
}
