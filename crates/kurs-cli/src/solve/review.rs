//! What a run is shown and judged by, beside its tables: the report, the comparison with truth, and
//! what `kurs doctor` would say.

use std::path::Path;

use kurs::ephemeris::{EphemerisStore, NavigationData};
use kurs::observation::ArrayEpoch;
use kurs::solution::EpochSolution;

use super::config::Loaded;
use super::explain::ExplainFormat;
use super::session_args::Session;
use super::{Args, antenna_names};
use crate::copies::Copies;
use crate::doctor;
use crate::pipe;
use crate::report::{Report, Words};
use crate::summary::Summary;
use crate::truth::{Agreement, Truth};

/// See the module.
pub(super) struct Review {
    report: Option<(Report, EphemerisStore)>,
    truth: Option<(Truth, Agreement)>,
}

/// What `kurs doctor` would say first, where little is fixed or an antenna has no part; `None`
/// where enough is.
pub(super) fn in_one_line(loaded: &Loaded, summary: &Summary, copies: &Copies) -> Option<String> {
    if let Some(text) = copies.text(&antenna_names(loaded)) {
        return Some(text);
    }
    let share = summary.fixed_of_session().unwrap_or(0.0);
    let what = match summary.share_with_idle() {
        _ if share < doctor::WELL => format!("only {:.1} % of the session is fixed", 100.0 * share),
        idle if idle > doctor::MANY => {
            format!("an antenna has no part in {:.1} % of the rows", 100.0 * idle)
        }
        _ => return None,
    };
    Some(format!("{what}: {}", doctor::in_one_line(loaded, summary.main_reason())))
}

impl Review {
    /// As the command line asks; reads the truth.
    pub(super) fn new(
        args: &Args,
        loaded: &Loaded,
        navigation: &NavigationData,
    ) -> anyhow::Result<Self> {
        let names = antenna_names(loaded);
        let truth = args.truth.as_ref().map(|path| Truth::read(path, &names)).transpose()?;
        let positions: Vec<_> = loaded.config.antenna.iter().map(|a| a.position_m).collect();
        let report =
            args.report.then(|| (Report::new(names, &positions), navigation.ephemerides.clone()));
        Ok(Self { report, truth: truth.map(|truth| (truth, Agreement::default())) })
    }

    /// Takes an epoch in, and its row.
    pub(super) fn add(&mut self, epoch: &ArrayEpoch, row: &EpochSolution) {
        let mut known = None;
        if let Some((truth, agreement)) = &mut self.truth {
            known = truth.at(row.time);
            if let Some(known) = known {
                agreement.add(row, known, truth);
            }
        }
        if let Some((report, _)) = &mut self.report {
            report.add_statements(epoch);
            report.add(row, known);
        }
    }

    /// Writes the report and the track into `folder`.
    pub(super) fn write(
        &self,
        folder: &Path,
        session: &Session,
        summary: &Summary,
    ) -> anyhow::Result<()> {
        let Some((report, ephemerides)) = &self.report else { return Ok(()) };
        // The number of fixed epochs stands in the summary already.
        let headline = summary.headline().into_iter().chain(self.agreement().into_iter().skip(1));
        let words = Words {
            title: "Kurs: heading, pitch and roll",
            inputs: inputs(&session.loaded),
            headline: headline.collect(),
            moments: summary.means(),
            configuration: session.loaded.explain(ExplainFormat::Text),
            ephemerides: Some(ephemerides),
        };
        report.write(folder, &words)
    }

    /// How the fixed epochs agree with the truth, for the terminal.
    pub(super) fn text(&self) -> String {
        let rows = self.agreement();
        let width = rows.iter().map(|[name, _]| name.len()).max().unwrap_or(0);
        let line = |[name, value]: &[String; 2]| format!("{name:width$}  {value}\n");
        let title = if rows.is_empty() { "" } else { "\nagainst the truth\n" };
        title.to_owned() + &rows.iter().map(line).collect::<String>()
    }

    fn agreement(&self) -> Vec<[String; 2]> {
        self.truth
            .as_ref()
            .map_or_else(Vec::new, |(truth, agreement)| agreement.rows(truth.criterion()))
    }
}

/// What the run was made from: each antenna and table with its files.
fn inputs(loaded: &Loaded) -> Vec<[String; 2]> {
    let config = &loaded.config;
    let antennas = config.antenna.iter().map(|a| (format!("antenna {}", a.name), &a.obs));
    let station = config.station.iter().map(|s| ("station".to_owned(), &s.obs));
    let others = [("navigation", &config.nav.files), ("antenna calibrations", &config.antex.files)];
    let others = others.into_iter().map(|(name, files)| (name.to_owned(), files));
    let all = antennas.chain(station).chain(others).filter(|(_, files)| !files.is_empty());
    all.map(|(name, files)| {
        let files: Vec<String> = files.iter().map(|file| pipe::named(&loaded.path(file))).collect();
        [name, files.join(", ")]
    })
    .collect()
}
