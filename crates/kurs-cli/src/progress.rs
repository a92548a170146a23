//! How far a long run is: a bar on a terminal, plain lines elsewhere, nothing with `--quiet`.

use std::fmt::Write as _;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between two plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);
/// Epochs between looks at the clock: drawing is slower than solving.
const EPOCHS_BETWEEN_LOOKS: u64 = 64;
/// Share of the work from which on the rest is shown; before, it would be a guess.
const MIN_SHARE_FOR_REST: f64 = 0.01;
/// Parts of the bar.
const PARTS: u64 = 1000;

/// The words of a command for what it does.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Work {
    /// What is done with an epoch: `solved`.
    pub(crate) done: &'static str,
    /// What is counted among the epochs: `fixed`.
    pub(crate) counted: Option<&'static str>,
}

impl Work {
    pub(crate) const SOLVE: Self = Self { done: "solved", counted: Some("fixed") };
    pub(crate) const BACKWARD: Self = Self { done: "solved backward", counted: Some("fixed") };
    pub(crate) const SURVEY: Self = Self { done: "surveyed", counted: Some("fixed") };
    pub(crate) const ORIENT: Self = Self { done: "oriented", counted: Some("fixed") };
    pub(crate) const SIMULATE: Self = Self { done: "simulated", counted: None };
}

/// Progress of a run over epochs.
pub(crate) struct Progress {
    kind: Kind,
    work: Work,
    started: Instant,
    epochs: u64,
    counted: u64,
}

enum Kind {
    Quiet,
    Bar(ProgressBar),
    Lines { last: Instant },
}

impl Kind {
    fn new(quiet: bool) -> Self {
        if quiet {
            Self::Quiet
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new(PARTS);
            let style = ProgressStyle::with_template("{bar:24} {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            Self::Bar(bar)
        } else {
            Self::Lines { last: Instant::now() }
        }
    }
}

impl Progress {
    /// Starts it.
    pub(crate) fn start(quiet: bool, work: Work) -> Self {
        let kind = Kind::new(quiet);
        Self { kind, work, started: Instant::now(), epochs: 0, counted: 0 }
    }

    /// One more epoch; `share`: how much of the work is done, 0 to 1, where that is known.
    pub(crate) fn epoch(&mut self, is_counted: bool, share: impl FnOnce() -> Option<f64>) {
        self.epochs += 1;
        self.counted += u64::from(is_counted);
        if !self.epochs.is_multiple_of(EPOCHS_BETWEEN_LOOKS) {
            return;
        }
        let elapsed_s = self.started.elapsed().as_secs_f64();
        match &mut self.kind {
            Kind::Quiet => {}
            Kind::Bar(bar) => {
                let share = share();
                let text = text(self.work, self.epochs, self.counted, share, elapsed_s);
                show(bar, share.unwrap_or(0.0), text);
            }
            Kind::Lines { last } if last.elapsed() >= LINE_EVERY => {
                *last = Instant::now();
                eprintln!("{}", text(self.work, self.epochs, self.counted, share(), elapsed_s));
            }
            Kind::Lines { .. } => {}
        }
    }

    /// Takes the bar away; returns how long the work took, s.
    pub(crate) fn finish(self) -> f64 {
        if let Kind::Bar(bar) = &self.kind {
            bar.finish_and_clear();
        }
        self.started.elapsed().as_secs_f64()
    }
}

/// Progress of a run over tasks that are counted.
pub(crate) struct Tasks {
    kind: Kind,
    name: &'static str,
    started: Instant,
    all: usize,
    done: usize,
    failed: usize,
}

impl Tasks {
    /// Starts it.
    pub(crate) fn start(quiet: bool, name: &'static str, all: usize) -> Self {
        Self { kind: Kind::new(quiet), name, started: Instant::now(), all, done: 0, failed: 0 }
    }

    /// One more task.
    pub(crate) fn done(&mut self, has_failed: bool) {
        self.done += 1;
        self.failed += usize::from(has_failed);
        let share = self.done as f64 / self.all.max(1) as f64;
        let left_s = self.started.elapsed().as_secs_f64() * (1.0 - share) / share;
        let text = format!(
            "{} of {} {}, {} without a fix, {} left",
            self.done,
            self.all,
            self.name,
            self.failed,
            duration(left_s)
        );
        match &mut self.kind {
            Kind::Quiet => {}
            Kind::Bar(bar) => show(bar, share, text),
            Kind::Lines { last } if last.elapsed() >= LINE_EVERY => {
                *last = Instant::now();
                eprintln!("{text}");
            }
            Kind::Lines { .. } => {}
        }
    }

    /// Takes the bar away.
    pub(crate) fn finish(self) {
        if let Kind::Bar(bar) = &self.kind {
            bar.finish_and_clear();
        }
    }
}

fn show(bar: &ProgressBar, share: f64, text: String) {
    bar.set_message(text);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 1000
    bar.set_position((share * PARTS as f64) as u64);
}

/// `42 %, 1200 epochs solved, 300 epochs/s, 99.1 % fixed, 2 min left`
fn text(work: Work, epochs: u64, counted: u64, share: Option<f64>, elapsed_s: f64) -> String {
    let mut text = share.map_or_else(String::new, |share| format!("{:.0} %, ", 100.0 * share));
    let per_s = epochs as f64 / elapsed_s.max(1e-9);
    let _ = write!(text, "{epochs} epochs {}, {per_s:.0} epochs/s", work.done);
    if let Some(word) = work.counted {
        let _ = write!(text, ", {:.1} % {word}", 100.0 * counted as f64 / epochs as f64);
    }
    if let Some(share) = share.filter(|share| *share >= MIN_SHARE_FOR_REST) {
        let _ = write!(text, ", {} left", duration(elapsed_s * (1.0 - share) / share));
    }
    text
}

fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_fit_the_command_and_the_rest_is_told_when_it_is_known() {
        assert_eq!(
            text(Work::SOLVE, 1280, 1270, Some(0.25), 4.0),
            "25 %, 1280 epochs solved, 320 epochs/s, 99.2 % fixed, 12 s left"
        );
        assert_eq!(
            text(Work::SIMULATE, 640, 0, Some(0.001), 2.0),
            "0 %, 640 epochs simulated, 320 epochs/s"
        );
        assert_eq!(
            text(Work::SURVEY, 640, 320, None, 2.0),
            "640 epochs surveyed, 320 epochs/s, 50.0 % fixed"
        );
        assert_eq!([20.0, 600.0, 9000.0].map(duration), ["20 s", "10 min", "2.5 h"]);
    }
}
