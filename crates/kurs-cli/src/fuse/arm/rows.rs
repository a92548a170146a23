//! What `kurs fuse` writes: `attitude.csv` as `kurs solve` does, `health.csv`, `summary.json`.

use std::path::Path;

use kurs::fusion::arm::filter::Health;
use kurs::fusion::arm::session::SessionRow;
use kurs::fusion::health::Tally;
use kurs::solution::Status;
use serde::Serialize;

use crate::fuse::agreement::{Agreement, TruthSummary};
use crate::fuse::events::{self, EventLog};
use crate::fuse::{Inputs, words};
use crate::output;
use crate::report::Report;
use crate::summary::Summary;
use crate::table::{Table, TableFormat};
use crate::tables::{AttitudeTable, TimeColumns};
use crate::truth::Truth;

/// Health of the filter since the row before.
const HEALTH: &[&str] = &[
    "time_gpst",
    "gps_week",
    "tow_s",
    "gnss_used",
    "gnss_rejected",
    "gnss_nis",
    "accelerometer_used",
    "accelerometer_rejected",
    "accelerometer_nis",
    "saturated",
    "unusable",
    "event",
];

/// The tables in the making.
pub(super) struct Rows {
    attitude: AttitudeTable,
    health: Table,
    truth: Option<Truth>,
    agreement: Agreement,
    summary: Summary,
    total: Health,
    report: Option<Report>,
    events: EventLog,
}

/// What stands in `summary.json` besides the summary of the rows.
#[derive(Debug, Serialize)]
struct FusionSummary<'a> {
    #[serde(flatten)]
    rows: crate::summary::SummaryFile<'a>,
    filter: FilterSummary,
    events: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<TruthSummary>,
}

#[derive(Debug, Serialize)]
struct FilterSummary {
    gnss: TallySummary,
    accelerometer: TallySummary,
    saturated: usize,
    unusable: usize,
    too_late: usize,
}

#[derive(Debug, Serialize)]
struct TallySummary {
    used: usize,
    rejected: usize,
    /// Mean normalised innovation squared of the used ones; 1 for noise as stated.
    mean_nis: Option<f64>,
}

impl Rows {
    pub(super) fn create(
        directory: &Path,
        truth: Option<Truth>,
        with_report: bool,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            attitude: AttitudeTable::create(directory, "attitude", TableFormat::Csv)?,
            health: Table::create(directory, "health", TableFormat::Csv, HEALTH)?,
            truth,
            agreement: Agreement::default(),
            summary: Summary::new(Vec::new()),
            total: Health::default(),
            report: with_report.then(|| Report::new(vec!["body".to_owned()], &[])),
            events: EventLog::default(),
        })
    }

    /// Writes the rows of one epoch.
    pub(super) fn write(&mut self, row: &SessionRow) -> anyhow::Result<()> {
        let solution = &row.solution;
        let time = TimeColumns::new(solution.time);
        self.attitude.write(&time, solution)?;
        self.summary.add(solution, false);
        self.total.add(&row.health);
        self.write_health(&time, row)?;
        if let Some(truth) = &self.truth {
            self.agreement.add(solution, truth);
        }
        if let Some(report) = &mut self.report {
            report.add(solution, self.truth.as_ref().and_then(|truth| truth.at(solution.time)));
        }
        self.events.tell(&row.events);
        Ok(())
    }

    fn write_health(&mut self, time: &TimeColumns, row: &SessionRow) -> anyhow::Result<()> {
        let (t, health) = (&mut self.health, &row.health);
        let whole = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
        time.write(t);
        for tally in [health.gnss, health.accelerometer] {
            t.integer(whole(tally.used));
            t.integer(whole(tally.rejected));
            t.real(Some(tally.nis), 3);
        }
        t.integer(whole(health.saturated));
        t.integer(whole(health.unusable));
        t.text(&events::in_one_field(&row.events));
        t.end_row()
    }

    /// Ends the tables; `false` if no row has an attitude.
    pub(super) fn finish(
        mut self,
        directory: &Path,
        inputs: &Inputs<'_>,
    ) -> anyhow::Result<Finished> {
        if inputs.is_interrupted {
            self.summary.interrupt();
        }
        let filter = FilterSummary {
            gnss: TallySummary::of(&self.total.gnss),
            accelerometer: TallySummary::of(&self.total.accelerometer),
            saturated: self.total.saturated,
            unusable: self.total.unusable,
            too_late: inputs.too_late,
        };
        let finished = Finished {
            has_solution: self.summary.has_solution(),
            main_reason: self.summary.main_reason(),
            text: text(&self.summary, &filter, &self.agreement),
        };
        if let Some(report) = &self.report {
            let title = "Kurs: one antenna and accelerometers on a rotating arm";
            report.write(directory, &words(title, &self.summary, inputs.files))?;
        }
        let summary = FusionSummary {
            rows: self.summary.file(&inputs.configuration, inputs.damage, inputs.wall_s),
            filter,
            events: self.events.texts(),
            truth: self.agreement.summary(),
        };
        self.attitude.finish()?;
        self.health.finish()?;
        output::write_json(directory, "summary.json", &summary)?;
        Ok(finished)
    }
}

/// How the run ended.
pub(super) struct Finished {
    pub(super) has_solution: bool,
    pub(super) main_reason: Option<&'static str>,
    /// For the terminal.
    pub(super) text: String,
}

impl TallySummary {
    fn of(tally: &Tally) -> Self {
        let mean_nis = (tally.used > 0).then(|| tally.nis / tally.used as f64);
        Self { used: tally.used, rejected: tally.rejected, mean_nis }
    }
}

/// The few lines a user wants to see at the end.
fn text(summary: &Summary, filter: &FilterSummary, agreement: &Agreement) -> String {
    let mut lines = vec![format!(
        "{} epochs: {} with attitude, {} lost",
        summary.epochs(),
        summary.count(Status::Float),
        summary.count(Status::Lost)
    )];
    for (name, tally) in [("GNSS", &filter.gnss), ("accelerometers", &filter.accelerometer)] {
        let nis = tally.mean_nis.map_or_else(String::new, |nis| format!(", mean NIS {nis:.3}"));
        lines.push(format!("{name}: {} used, {} rejected{nis}", tally.used, tally.rejected));
    }
    lines.extend(events::left_out([
        ("saturated", filter.saturated),
        ("not a number", filter.unusable),
        ("too late", filter.too_late),
    ]));
    lines.extend(agreement.text("filter"));
    lines.join("\n")
}
