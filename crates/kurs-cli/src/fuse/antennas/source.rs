//! Where the antennas' rows come from: a file that `kurs solve` wrote, or the observations
//! themselves, solved epoch by epoch with what the filter predicts.

use std::path::Path;
use std::vec::IntoIter;

use anyhow::{Context, bail};
use kurs::differential::Differential;
use kurs::fusion::attitude::feed::AttitudeFeed;
use kurs::fusion::time_order::TooLate;
use kurs::observation::ArrayEpoch;
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;

use super::config::{AntennasConfig, RowsFrom};
use super::solved_rows;
use crate::failure::UsageError;
use crate::progress::{Progress, Work};
use crate::solve::config::{self, Loaded, Overrides};
use crate::solve::streams::Streams;
use crate::solve::{self, Input};
use crate::summary::Damage;
use crate::window::Window;

/// Rows whose spacing says how often the antennas measure.
const SPACINGS: usize = 200;

/// The antennas' rows in time order, one ahead.
pub(super) struct Source {
    kind: Kind,
    /// Rows at least so often; `None`: nothing is filled in.
    interval_s: Option<f64>,
    /// Read, but not yet taken.
    next: Option<Next>,
    damage: Vec<Damage>,
}

enum Kind {
    Solved(IntoIter<EpochSolution>),
    Observed(Box<Observed>),
}

/// The chain of `kurs solve`.
struct Observed {
    engine: Differential,
    streams: Streams,
    epoch: ArrayEpoch,
    loaded: Loaded,
    progress: Progress,
}

enum Next {
    Row(Box<EpochSolution>),
    /// In the buffer of the chain.
    Epoch(GpsTime),
}

impl Source {
    /// Opens what `[antennas]` names; `interval_s` from `[output]`.
    pub(super) fn open(
        folder: &Path,
        antennas: &AntennasConfig,
        interval_s: Option<f64>,
        window: Window,
        quiet: bool,
    ) -> anyhow::Result<Self> {
        match antennas.rows_from()? {
            RowsFrom::Attitudes(file) => {
                let (mut rows, damage) = solved_rows::read(&folder.join(file))?;
                rows.retain(|row| window.contains(row.time));
                if antennas.latitude_deg.is_none() && rows.iter().all(|r| r.position.is_none()) {
                    let text = "antennas.latitude_deg: the attitude file has no positions, so it must be given";
                    return Err(UsageError(text.to_owned()).into());
                }
                let interval_s = interval_s.or_else(|| usual_spacing(&rows));
                let kind = Kind::Solved(rows.into_iter());
                Ok(Self { kind, interval_s, next: None, damage })
            }
            RowsFrom::Observations(file) => {
                let (observed, damage) = Observed::open(&folder.join(file), window, quiet)?;
                let kind = Kind::Observed(Box::new(observed));
                Ok(Self { kind, interval_s, next: None, damage })
            }
        }
    }

    /// Rows at least so often, s, as far as that is known.
    pub(super) const fn interval_s(&self) -> Option<f64> {
        self.interval_s
    }

    /// Time tag of the next row.
    pub(super) fn next_time(&mut self) -> anyhow::Result<Option<GpsTime>> {
        if self.next.is_none() {
            self.next = match &mut self.kind {
                Kind::Solved(rows) => rows.next().map(|row| Next::Row(Box::new(row))),
                Kind::Observed(observed) => {
                    let more = observed.streams.next(&mut observed.epoch)?;
                    // Known as soon as an epoch is read ahead.
                    self.interval_s = self.interval_s.or(observed.streams.interval_s());
                    more.then_some(Next::Epoch(observed.epoch.time))
                }
            };
        }
        Ok(self.next.as_ref().map(Next::time))
    }

    /// Gives that row to the session.
    pub(super) fn feed(&mut self, feed: &mut AttitudeFeed) -> Result<(), TooLate> {
        match (self.next.take(), &mut self.kind) {
            (Some(Next::Row(row)), _) => feed.push_row(*row),
            (Some(Next::Epoch(_)), Kind::Observed(chain)) => {
                let news = chain.streams.news(&chain.epoch);
                news.iter().for_each(|news| chain.engine.insert(news));
                let row = feed.solve(&chain.epoch, &mut chain.engine);
                chain.progress.epoch(row.is_fixed(), || chain.streams.share());
                feed.push_row(row)
            }
            _ => Ok(()),
        }
    }

    /// Names of the antennas whose epochs are solved here; none if their attitudes are given.
    pub(super) fn antenna_names(&self) -> Vec<String> {
        match &self.kind {
            Kind::Solved(_) => Vec::new(),
            Kind::Observed(observed) => solve::antenna_names(&observed.loaded),
        }
    }

    /// The text that stands for the antennas in the hash of the configuration, and everything that
    /// was damaged.
    pub(super) fn finish(mut self) -> (String, Vec<Damage>) {
        match self.kind {
            Kind::Solved(_) => (String::new(), self.damage),
            Kind::Observed(observed) => {
                observed.progress.finish();
                let of_files = observed.streams.damage().into_iter();
                self.damage.extend(of_files.map(|d| Damage::new(d.file, &d.damage)));
                (observed.loaded.text().to_owned(), self.damage)
            }
        }
    }
}

impl Next {
    const fn time(&self) -> GpsTime {
        match self {
            Self::Row(row) => row.time,
            Self::Epoch(time) => *time,
        }
    }
}

impl Observed {
    fn open(file: &Path, window: Window, quiet: bool) -> anyhow::Result<(Self, Vec<Damage>)> {
        let loaded = config::load(Some(file), &Overrides { window, ..Overrides::default() })?;
        let settings = loaded.settings()?;
        let Input { navigation, streams, phase_centers, damage } = Input::open(&loaded)?;
        if streams.antennas_with_epochs() < 2 {
            bail!("{}", solve::input::one_antenna(&loaded, &streams));
        }
        if !quiet {
            phase_centers.tell();
        }
        let engine = solve::engine(&loaded, settings, navigation, phase_centers.mounts)
            .with_context(|| file.display().to_string())?;
        let progress = Progress::start(quiet, Work::SOLVE);
        Ok((Self { engine, streams, epoch: ArrayEpoch::default(), loaded, progress }, damage))
    }
}

/// The median of the first spacings.
fn usual_spacing(rows: &[EpochSolution]) -> Option<f64> {
    let mut spacings: Vec<f64> =
        rows.windows(2).take(SPACINGS).map(|pair| pair[1].time - pair[0].time).collect();
    spacings.sort_by(f64::total_cmp);
    spacings.get(spacings.len() / 2).copied()
}
