//! What `kurs fuse` writes for antennas and an inertial sensor: `attitude.csv` and `smoothed.csv`
//! with the columns of `kurs solve`, `health.csv`, `summary.json`.

use std::path::Path;

use kurs::fusion::attitude::session::{AttitudeSession, FusedRow};
use kurs::fusion::health::Event;
use kurs::solution::{PredictionRole, Status};
use kurs::time::GpsTime;
use serde::Serialize;

use crate::fuse::agreement::{Agreement, TruthSummary};
use crate::fuse::events::{self, EventLog};
use crate::fuse::{Inputs, words};
use crate::output;
use crate::report::Report;
use crate::summary::{Summary, SummaryFile};
use crate::table::{Table, TableFormat};
use crate::tables::{AttitudeTable, TimeColumns};
use crate::truth::Truth;

/// Health of the filter since the row before.
const HEALTH: &[&str] = &[
    "time_gpst",
    "gps_week",
    "tow_s",
    "coasting_s",
    "attitude_used",
    "attitude_rejected",
    "attitude_nis",
    "velocity_used",
    "velocity_rejected",
    "velocity_nis",
    "saturated",
    "unusable",
    "repeated",
    "without_samples_s",
    "prediction",
    "event",
];

/// More than this share of a run without samples is worth a word.
const MANY_WITHOUT_SAMPLES: f64 = 0.03;

/// The tables in the making.
pub(super) struct Rows {
    attitude: AttitudeTable,
    smoothed: Option<AttitudeTable>,
    health: Table,
    truth: Option<Truth>,
    filtered_agreement: Agreement,
    smoothed_agreement: Agreement,
    summary: Summary,
    total: Total,
    /// Whether the antennas' epochs are solved here, with what the filter predicts.
    is_predicted: bool,
    report: Option<Report>,
    events: EventLog,
}

/// How the run ended.
pub(super) struct Finished {
    pub(super) has_solution: bool,
    /// For the terminal.
    pub(super) text: String,
}

/// Sums over all rows; attitudes and velocities count as one each, not by component.
#[derive(Debug, Default, Serialize)]
struct Total {
    attitudes_used: usize,
    attitudes_rejected: usize,
    /// Mean normalised innovation squared of a component; 1 for noise as stated.
    attitude_mean_nis: Option<f64>,
    velocities_used: usize,
    velocities_rejected: usize,
    velocity_mean_nis: Option<f64>,
    /// Fixes that the prediction decided on, and that it refused.
    fixed_by_prediction: usize,
    refused_by_prediction: usize,
    /// How often the filter was given up because it rejected most measurements of many epochs in a row.
    given_up: usize,
    saturated: usize,
    unusable: usize,
    repeated: usize,
    without_samples_s: f64,
    longest_coasting_s: f64,
    too_late: usize,
    /// Times of the first row and the last.
    #[serde(skip)]
    run: Option<[GpsTime; 2]>,
    #[serde(skip)]
    attitude_nis: f64,
    #[serde(skip)]
    velocity_nis: f64,
}

/// What stands in `summary.json` besides the summary of the rows.
#[derive(Debug, Serialize)]
struct FusionSummary<'a> {
    #[serde(flatten)]
    rows: SummaryFile<'a>,
    filter: Total,
    events: &'a [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<TruthSummary>,
    #[serde(skip_serializing_if = "Option::is_none")]
    truth_smoothed: Option<TruthSummary>,
}

impl Rows {
    /// `antennas`: names of those whose epochs are solved here; none if their attitudes are given.
    pub(super) fn create(
        directory: &Path,
        truth: Option<Truth>,
        smooth: bool,
        antennas: Vec<String>,
        with_report: bool,
    ) -> anyhow::Result<Self> {
        let format = TableFormat::Csv;
        let smoothed = smooth.then(|| AttitudeTable::create(directory, "smoothed", format));
        let smoothed = smoothed.transpose()?;
        Ok(Self {
            attitude: AttitudeTable::create(directory, "attitude", format)?,
            smoothed,
            health: Table::create(directory, "health", format, HEALTH)?,
            truth,
            filtered_agreement: Agreement::default(),
            smoothed_agreement: Agreement::default(),
            is_predicted: !antennas.is_empty(),
            report: with_report.then(|| Report::new(vec!["body".to_owned()], &[])),
            summary: Summary::new(antennas),
            total: Total::default(),
            events: EventLog::default(),
        })
    }

    /// Writes a row of the filter.
    pub(super) fn write(&mut self, row: &FusedRow) -> anyhow::Result<()> {
        let solution = &row.solution;
        let time = TimeColumns::new(solution.time);
        self.attitude.write(&time, solution)?;
        self.summary.add(solution, false);
        self.total.add(row);
        self.write_health(&time, row)?;
        if let Some(truth) = &self.truth {
            self.filtered_agreement.add(solution, truth);
        }
        if let Some(report) = &mut self.report {
            report.add(solution, self.truth.as_ref().and_then(|truth| truth.at(solution.time)));
        }
        self.events.tell(&row.events);
        Ok(())
    }

    /// Writes the rows of the backward pass.
    pub(super) fn write_smoothed(&mut self, session: AttitudeSession) -> anyhow::Result<()> {
        let Some(table) = &mut self.smoothed else { return Ok(()) };
        for solution in session.into_smoothed() {
            table.write(&TimeColumns::new(solution.time), &solution)?;
            if let Some(truth) = &self.truth {
                self.smoothed_agreement.add(&solution, truth);
            }
        }
        Ok(())
    }

    fn write_health(&mut self, time: &TimeColumns, row: &FusedRow) -> anyhow::Result<()> {
        let (t, health) = (&mut self.health, &row.health);
        let whole = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
        time.write(t);
        t.real(Some(health.coasting_s), 3);
        for tally in [health.attitude, health.velocity] {
            t.integer(whole(tally.used));
            t.integer(whole(tally.rejected));
            t.real(Some(tally.nis), 3);
        }
        t.integer(whole(health.saturated));
        t.integer(whole(health.unusable));
        t.integer(whole(health.repeated));
        t.real(Some(health.without_samples_s), 3);
        t.text(row.solution.prediction().map_or("", PredictionRole::word));
        t.text(&events::in_one_field(&row.events));
        t.end_row()
    }

    /// Ends the tables.
    pub(super) fn finish(mut self, directory: &Path, inputs: &Inputs) -> anyhow::Result<Finished> {
        self.total.too_late = inputs.too_late;
        if inputs.is_interrupted {
            self.summary.interrupt();
        }
        let finished = Finished { has_solution: self.summary.has_solution(), text: self.text() };
        if let Some(report) = &self.report {
            let title = "Kurs: antennas and inertial sensor";
            report.write(directory, &words(title, &self.summary, inputs.files))?;
        }
        let summary = FusionSummary {
            rows: self.summary.file(&inputs.configuration, inputs.damage, inputs.wall_s),
            filter: self.total.with_means(),
            events: self.events.texts(),
            truth: self.filtered_agreement.summary(),
            truth_smoothed: self.smoothed_agreement.summary(),
        };
        self.attitude.finish()?;
        self.smoothed.map_or(Ok(()), AttitudeTable::finish)?;
        self.health.finish()?;
        output::write_json(directory, "summary.json", &summary)?;
        Ok(finished)
    }

    /// The few lines a user wants to see at the end.
    fn text(&self) -> String {
        let total = &self.total;
        let count = |status| self.summary.count(status);
        let mut lines = vec![format!(
            "{} rows: {} with a fix, {} carried on, {} without attitude",
            self.summary.epochs(),
            count(Status::Fixed),
            count(Status::Float),
            self.summary.epochs() - count(Status::Fixed) - count(Status::Float)
        )];
        lines.push(format!(
            "attitudes: {} used, {} rejected; longest time without one {:.1} s",
            total.attitudes_used, total.attitudes_rejected, total.longest_coasting_s
        ));
        if total.velocities_used + total.velocities_rejected > 0 {
            lines.push(format!(
                "velocities: {} used, {} rejected",
                total.velocities_used, total.velocities_rejected
            ));
        }
        if self.is_predicted {
            lines.push(format!(
                "the prediction decided on the integers of {} and refused {} fixes",
                total.fixed_by_prediction, total.refused_by_prediction
            ));
        }
        lines.extend(total.contradictions());
        lines.extend(events::left_out([
            ("saturated", total.saturated),
            ("not a number", total.unusable),
            ("with the time of the one before", total.repeated),
            ("too late", total.too_late),
        ]));
        lines.extend(total.without_samples());
        lines.extend(self.filtered_agreement.text("filter"));
        lines.extend(self.smoothed_agreement.text("smoothed"));
        lines.join("\n")
    }
}

impl Total {
    fn add(&mut self, fused: &FusedRow) {
        let FusedRow { health, solution: row, events, .. } = fused;
        let prediction = row.prediction();
        self.given_up += events.iter().filter(|(_, event)| *event == Event::LockedOut).count();
        self.run = Some([self.run.map_or(row.time, |[first, _]| first), row.time]);
        self.attitudes_used += health.attitude.used / 3;
        self.attitudes_rejected += health.attitude.rejected / 3;
        self.attitude_nis += health.attitude.nis;
        self.velocities_used += health.velocity.used / 3;
        self.velocities_rejected += health.velocity.rejected / 3;
        self.velocity_nis += health.velocity.nis;
        self.fixed_by_prediction += usize::from(prediction == Some(PredictionRole::Decided));
        self.refused_by_prediction += usize::from(prediction == Some(PredictionRole::Refused));
        self.saturated += health.saturated;
        self.unusable += health.unusable;
        self.repeated += health.repeated;
        self.without_samples_s += health.without_samples_s;
        self.longest_coasting_s = self.longest_coasting_s.max(health.coasting_s);
    }

    /// Lines for the terminal: where antennas and sensor do not fit each other as well as they should.
    fn contradictions(&self) -> Vec<String> {
        let refused = self.attitudes_rejected + self.refused_by_prediction;
        let attitudes = ("attitudes", self.attitudes_used, refused, self.attitude_nis);
        let (used, rejected) = (self.velocities_used, self.velocities_rejected);
        let velocities = ("velocities", used, rejected, self.velocity_nis);
        let line = |(what, used, rejected, nis): (&str, usize, usize, f64)| {
            if 4 * rejected > used {
                return Some(format!(
                    "many {what} were rejected: are unit, mounting and time of the sensor right?"
                ));
            }
            let mean = mean_nis(nis, used).filter(|mean| *mean > largest_mean_nis(used))?;
            Some(format!(
                "the {what} are further from the prediction than is expected (mean square {mean:.1} times): \
                 mounting (imu.mounting_sd_deg), time or noise of the sensor, or the antennas' standard \
                 deviations, are not as stated, and those of the result are too small"
            ))
        };
        let given_up = (self.given_up > 0).then(|| {
            format!(
                "the filter was given up {} times because it rejected most measurements: are sign, unit, mounting \
                 and time of the sensor right? Angles and their standard deviations before that are not to be used",
                self.given_up
            )
        });
        given_up.into_iter().chain([attitudes, velocities].into_iter().filter_map(line)).collect()
    }

    /// A line for the terminal, if samples are missing.
    fn without_samples(&self) -> Option<String> {
        let length_s = self.run.map_or(0.0, |[first, last]| last - first);
        let share = self.without_samples_s / length_s;
        let bridged = format!("{:.1} s without samples were bridged", self.without_samples_s);
        if share > MANY_WITHOUT_SAMPLES {
            let percent = 100.0 * share;
            return Some(format!(
                "{bridged}, {percent:.0} % of the run: nothing says how the body turned in them; are rows of the \
                 sensor missing, or its times not those of the antennas?"
            ));
        }
        (self.without_samples_s > 0.0).then_some(bridged)
    }

    fn with_means(self) -> Self {
        Self {
            attitude_mean_nis: mean_nis(self.attitude_nis, self.attitudes_used),
            velocity_mean_nis: mean_nis(self.velocity_nis, self.velocities_used),
            ..self
        }
    }
}

/// Of a component; 1 for noise as stated.
fn mean_nis(sum: f64, count: usize) -> Option<f64> {
    (count > 0).then(|| sum / (3 * count) as f64)
}

/// More than a third above what is expected, and more than chance leaves of three components each: the
/// mean square of n of them is 1 ± √(2/n).
fn largest_mean_nis(count: usize) -> f64 {
    const SIGMAS: f64 = 4.0;
    let by_chance = 1.0 + SIGMAS * (2.0 / (3 * count) as f64).sqrt();
    by_chance.max(4.0 / 3.0)
}
