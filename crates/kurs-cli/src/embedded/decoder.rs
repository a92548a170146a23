//! Bytes of one receiver, given piece by piece, to epochs: a reader in a thread that waits for the
//! next piece, and a caller that waits until the reader has made of the last one what it can.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs_formats::logs::{LogOptions, LogReader};
use kurs_formats::source::{ReadError, Source};

/// An epoch and the navigation data that came before it.
pub(super) type Decoded = (AntennaEpoch, NavigationData);

/// See the module.
#[derive(Debug)]
pub(super) struct ByteDecoder {
    pipe: Arc<Pipe>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Pipe {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    bytes: VecDeque<u8>,
    /// No more will come.
    is_closed: bool,
    /// The reader has used everything and waits.
    is_waiting: bool,
    has_ended: bool,
    decoded: Vec<Decoded>,
    error: Option<String>,
}

impl Pipe {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ByteDecoder {
    pub(super) fn new(name: &str, options: &LogOptions) -> Self {
        let pipe = Arc::new(Pipe::default());
        let (of_thread, name, options) = (Arc::clone(&pipe), name.to_owned(), *options);
        let thread = std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| decode(&of_thread, name, &options)));
            let panicked = |_| Err("the decoder stopped by an error of its own".to_owned());
            let error = outcome.unwrap_or_else(panicked).err();
            let mut state = of_thread.lock();
            (state.has_ended, state.error) = (true, error);
            of_thread.changed.notify_all();
        });
        Self { pipe, thread: Some(thread) }
    }

    /// Gives the next bytes; what they complete, and what is wrong with them if nothing can be made
    /// of them.
    pub(super) fn push(&self, bytes: &[u8]) -> (Vec<Decoded>, Option<String>) {
        let mut state = self.pipe.lock();
        state.bytes.extend(bytes);
        state.is_waiting = false;
        self.take(state)
    }

    /// No more bytes will come: what is left.
    pub(super) fn finish(self) -> (Vec<Decoded>, Option<String>) {
        let mut state = self.pipe.lock();
        (state.is_closed, state.is_waiting) = (true, false);
        self.take(state)
    }

    fn take(&self, state: MutexGuard<'_, State>) -> (Vec<Decoded>, Option<String>) {
        self.pipe.changed.notify_all();
        let is_busy = |state: &mut State| !state.is_waiting && !state.has_ended;
        let state = self.pipe.changed.wait_while(state, is_busy);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        (std::mem::take(&mut state.decoded), state.error.take())
    }
}

impl Drop for ByteDecoder {
    fn drop(&mut self) {
        let mut state = self.pipe.lock();
        (state.is_closed, state.is_waiting) = (true, false);
        drop(state);
        self.pipe.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // One that panicked has left its message.
            let _ = thread.join();
        }
    }
}

fn decode(pipe: &Arc<Pipe>, name: String, options: &LogOptions) -> Result<(), String> {
    let told = |error: ReadError| error.to_string();
    let source = Source::new(PipeReader(Arc::clone(pipe)), name).map_err(told)?;
    let mut reader = LogReader::of_stream(source, options).map_err(told)?;
    loop {
        let mut epoch = AntennaEpoch::default();
        if !reader.next_epoch(&mut epoch).map_err(told)? {
            return Ok(());
        }
        let news = reader.take_news();
        pipe.lock().decoded.push((epoch, news));
    }
}

/// The bytes as one stream; reading waits for the next ones.
struct PipeReader(Arc<Pipe>);

impl Read for PipeReader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut state = self.0.lock();
        while state.bytes.is_empty() && !state.is_closed {
            state.is_waiting = true;
            self.0.changed.notify_all();
            state = self.0.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.bytes.read(out)
    }
}
