//! Ctrl-C, and the signal by which services and queues end a program: a run that watches for it
//! ends at the next epoch with a valid result of what there is; any other run stops at once and
//! leaves no file behind that is not whole.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::failure::ExitCode;
use crate::output;

/// Exit status of an interrupted run: 128 and the number of the interrupt signal, as in shells.
pub const INTERRUPTED: u8 = 130;

/// A run was told to end before it had anything to show.
#[derive(Debug, thiserror::Error)]
#[error("interrupted before there was a result")]
pub(crate) struct Interrupted;

static IS_WANTED: AtomicBool = AtomicBool::new(false);
/// Number of runs that watch for a request to end.
static WATCHING: AtomicUsize = AtomicUsize::new(0);

/// Catches the signals from now on; once for a process.
#[cfg(unix)]
pub(crate) fn catch() {
    use signal_hook::consts::{SIGINT, SIGTERM};
    static IS_CAUGHT: AtomicBool = AtomicBool::new(false);
    if IS_CAUGHT.swap(true, Ordering::SeqCst) {
        return;
    }
    // Without it the signals end the program as they always do.
    let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]) else { return };
    std::thread::spawn(move || signals.forever().for_each(|_| arrived()));
}

/// Other systems end the program as they always do.
#[cfg(not(unix))]
pub(crate) fn catch() {}

/// The first signal asks a run that watches for its end; the second, or one that nobody watches
/// for, does not wait.
fn arrived() {
    let is_first = !IS_WANTED.swap(true, Ordering::SeqCst);
    if is_first && WATCHING.load(Ordering::SeqCst) > 0 {
        eprintln!("interrupted: what there is gets written (once more: stop at once)");
        return;
    }
    output::abandon(INTERRUPTED)
}

/// Asks every run that watches for its end, as the first signal does; `false` takes it back.
pub(crate) fn ask_to_end(is_wanted: bool) {
    IS_WANTED.store(is_wanted, Ordering::SeqCst);
}

/// While it lives, the first signal does not stop the program but is to be asked for.
#[derive(Debug)]
pub(crate) struct Watch {
    was_told: AtomicBool,
}

impl Watch {
    pub(crate) fn begin() -> Self {
        WATCHING.fetch_add(1, Ordering::SeqCst);
        Self { was_told: AtomicBool::new(false) }
    }

    /// Whether the run is to end here.
    pub(crate) fn asks_to_end(&self) -> bool {
        let is_wanted = IS_WANTED.load(Ordering::Relaxed);
        self.was_told.fetch_or(is_wanted, Ordering::Relaxed);
        is_wanted
    }

    /// Whether the run was told to end; what comes after its last epoch does not interrupt it.
    pub(crate) fn was_interrupted(&self) -> bool {
        self.was_told.load(Ordering::Relaxed)
    }

    /// Why the run has nothing to show: that it was interrupted, or else `why`.
    pub(crate) fn unless_interrupted(&self, why: anyhow::Error) -> anyhow::Error {
        if self.was_interrupted() { Interrupted.into() } else { why }
    }

    /// The exit status of the run: `done`, unless it was interrupted.
    pub(crate) fn status(&self, done: ExitCode) -> ExitCode {
        if self.was_interrupted() { ExitCode::from(INTERRUPTED) } else { done }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        WATCHING.fetch_sub(1, Ordering::SeqCst);
    }
}
