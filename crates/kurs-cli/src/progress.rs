//! How far a long run is: a bar on a terminal, plain lines elsewhere, nothing with `--quiet`.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

/// Time between two plain lines.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Progress of a run over epochs.
pub(crate) struct Progress {
    kind: Kind,
    started: Instant,
    epochs: u64,
    fixed: u64,
}

enum Kind {
    Quiet,
    Bar(ProgressBar),
    Lines { last: Instant },
}

impl Progress {
    /// Starts it; `bytes` is the size of all input, by which the rest is estimated.
    pub(crate) fn start(quiet: bool) -> Self {
        let kind = if quiet {
            Kind::Quiet
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new_spinner();
            let style = ProgressStyle::with_template("{spinner} {pos} epochs, {per_sec}, {msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
            Kind::Bar(bar)
        } else {
            Kind::Lines { last: Instant::now() }
        };
        Self { kind, started: Instant::now(), epochs: 0, fixed: 0 }
    }

    /// One more epoch.
    pub(crate) fn epoch(&mut self, fixed: bool) {
        self.epochs += 1;
        self.fixed += u64::from(fixed);
        let rate = 100.0 * self.fixed as f64 / self.epochs as f64;
        match &mut self.kind {
            Kind::Quiet => {}
            // Drawing is slower than solving: look at the clock only now and then.
            _ if !self.epochs.is_multiple_of(64) => {}
            Kind::Bar(bar) => {
                bar.set_message(format!("{rate:.1} % fixed"));
                bar.set_position(self.epochs);
            }
            Kind::Lines { last } if last.elapsed() >= LINE_EVERY => {
                *last = Instant::now();
                let per_s = self.epochs as f64 / self.started.elapsed().as_secs_f64();
                eprintln!("{} epochs, {per_s:.0} epochs/s, {rate:.1} % fixed", self.epochs);
            }
            Kind::Lines { .. } => {}
        }
    }

    /// Takes the bar away and tells how long it took, s.
    pub(crate) fn finish(self) -> f64 {
        if let Kind::Bar(bar) = &self.kind {
            bar.finish_and_clear();
        }
        self.started.elapsed().as_secs_f64()
    }
}
