//! One stream: connect, pass the bytes on, and when the connection breaks make it again, for ever.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};

use kurs::fusion::attitude::session::ImuSample;
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

use crate::address::Address;
use crate::back_off::{BackOff, GOOD_AFTER};
use crate::connection::Connection;
use crate::decoder::{self, Chunk, Decoded, Decoding, Pace, Permits};
use crate::imu::{self, ReadSamples};
use crate::lines::{self, Lines};
use crate::lock::lock;
use crate::ntrip::{self, NtripError};
use crate::peer::PeerLine;
use crate::record::{Recorder, gps_time};
use crate::status::StreamStatus;

/// A connection that brings nothing for so long is taken for dead.
const DATA_TIMEOUT: Duration = Duration::from_secs(30);
/// Bytes without any epoch for so long are those of a decoder that is stuck or of a wrong baud rate.
const EPOCH_TIMEOUT: Duration = Duration::from_secs(30);
/// A virtual station wants the position so often.
const GGA_INTERVAL: Duration = Duration::from_secs(10);
/// Pieces that may wait for a decoder before the connection is no longer read.
const MAX_CHUNKS: usize = 64;
/// Bytes that are read at once.
const BUFFER: usize = 64 * 1024;

/// A stream and what it carries: antennas, or lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// Where it comes from.
    pub address: Address,
    /// Antennas by their number, [`STATION`] for the fixed station, and what their part of the stream
    /// does not say by itself.
    pub antennas: Vec<(usize, String, LogOptions)>,
    /// Lines of text in place of antennas.
    pub lines: Option<Lines>,
}

impl Input {
    /// What it is called in messages.
    pub(crate) fn name(&self) -> &str {
        let of_antenna = self.antennas.first().map_or("stream", |(_, name, _)| name);
        self.lines.as_ref().map_or(of_antenna, Lines::name)
    }

    /// Whether a run over files ends without it.
    pub(crate) const fn is_optional(&self) -> bool {
        matches!(self.lines, Some(Lines::Peer(..)))
    }

    /// Tells that its connection has ended.
    pub(crate) fn tell_end(&self, events: &std::sync::mpsc::Sender<Event>) {
        for (antenna, ..) in &self.antennas {
            let _ = events.send(Event::Left { antenna: *antenna });
        }
        if self.lines == Some(Lines::Imu) {
            let _ = events.send(Event::ImuLeft);
        }
    }
}

/// The number that stands for the fixed station.
pub const STATION: usize = usize::MAX;

/// What an input tells the engine.
#[derive(Debug)]
pub(crate) enum Event {
    Epoch {
        antenna: usize,
        decoded: Box<Decoded>,
    },
    /// The connection of this antenna has ended.
    Left {
        antenna: usize,
    },
    /// Of the inertial sensor: GPS second of week, sample, when it came.
    Sample(f64, Box<ImuSample>, Instant),
    /// Its connection has ended.
    ImuLeft,
    /// Of another body, by its number.
    PeerLine(usize, Box<PeerLine>, Instant),
    /// A stream has come to its end and will not come again.
    InputEnded,
    Reload(Box<crate::service::NewEngine>),
    Stop,
}

/// What all inputs share.
#[derive(Clone)]
pub(crate) struct Shared {
    pub(crate) events: std::sync::mpsc::Sender<Event>,
    pub(crate) pace: Arc<Pace>,
    /// The newest position as a GGA sentence.
    pub(crate) gga: watch::Receiver<Option<String>>,
    /// The last time that is known from a row, an ephemeris or the state of an earlier run.
    pub(crate) known_time: watch::Receiver<Option<GpsTime>>,
    pub(crate) log_dir: Option<std::path::PathBuf>,
    /// Reads the lines of the inertial sensor.
    pub(crate) read_samples: Option<ReadSamples>,
    /// A closed connection is an end.
    pub(crate) once: bool,
}

/// The parts of one input.
pub(crate) struct Running {
    input: Input,
    statuses: Vec<Arc<StreamStatus>>,
    permits: Vec<Arc<Permits>>,
    shared: Shared,
    recorder: Option<Recorder>,
    ntrip_version: u8,
    /// Something came over it.
    has_worked: bool,
    /// The date that ephemerides of an earlier connection told, against the one in force.
    told_date: Arc<Mutex<Option<GpsTime>>>,
}

/// Whether bytes come, and epochs.
struct Progress {
    epochs: u64,
    since: Instant,
    last_bytes: Instant,
}

impl Progress {
    fn new(epochs: u64) -> Self {
        let now = Instant::now();
        Self { epochs, since: now, last_bytes: now }
    }

    fn note_bytes(&mut self, now: Instant) {
        self.last_bytes = now;
    }

    /// When the connection is taken for dead, unless bytes come.
    fn silent_at(&self) -> Instant {
        self.last_bytes + DATA_TIMEOUT
    }

    /// What is wrong, in words.
    fn trouble(&mut self, epochs: u64, now: Instant) -> Option<String> {
        if epochs != self.epochs {
            (self.epochs, self.since) = (epochs, now);
        }
        if now >= self.silent_at() {
            return Some(format!("nothing came for {} s", DATA_TIMEOUT.as_secs()));
        }
        let is_stuck = now - self.since > EPOCH_TIMEOUT;
        is_stuck.then(|| format!("bytes come, but no epoch for {} s", EPOCH_TIMEOUT.as_secs()))
    }
}

/// How a connection ended.
enum End {
    Closed,
    Broken(String),
    /// Another one takes its place.
    Replaced(TcpStream),
    /// Trying again cannot help.
    Final(String),
}

impl Running {
    pub(crate) fn new(
        input: Input,
        statuses: Vec<Arc<StreamStatus>>,
        permits: Vec<Arc<Permits>>,
        shared: Shared,
    ) -> Self {
        let is_file = input.address.is_file();
        let recorder = shared.log_dir.as_ref().filter(|_| !is_file);
        let recorder = recorder.map(|directory| Recorder::new(directory, input.name()));
        Self {
            input,
            statuses,
            permits,
            shared,
            recorder,
            ntrip_version: 2,
            has_worked: false,
            told_date: Arc::default(),
        }
    }

    /// Runs until the stream has ended for good.
    pub(crate) async fn run(mut self) {
        if let Address::TcpListen { at } = self.input.address.clone() {
            self.listen(&at).await;
        } else {
            self.connect_again_and_again().await;
        }
        self.statuses.iter().for_each(|status| status.note_end());
        if !self.input.is_optional() {
            let _ = self.shared.events.send(Event::InputEnded);
        }
    }

    async fn connect_again_and_again(&mut self) {
        let mut back_off = match self.input.address {
            Address::Ntrip(_) => BackOff::of_caster(),
            _ => BackOff::of_own(),
        };
        let is_file = self.input.address.is_file();
        loop {
            let began = Instant::now();
            let (end, was_open) = match self.open().await {
                Ok(connection) => (self.pump(connection, None).await, true),
                Err(end) => (end, false),
            };
            match end {
                End::Closed | End::Replaced(_) => {
                    if is_file || self.shared.once {
                        return;
                    }
                    self.note("the other side closed the connection");
                }
                End::Broken(what) => {
                    self.note(&what);
                    if is_file || (self.shared.once && was_open) {
                        return;
                    }
                }
                // What has worked may work again: a mount point is absent while its receiver is.
                End::Final(what) if self.has_worked => {
                    self.note(&format!("{what}; it has worked before and is asked again"));
                }
                End::Final(what) => {
                    self.note(&format!("{what}; it is not asked again before a restart"));
                    // Nobody is to wait for what never came.
                    return self.input.tell_end(&self.shared.events);
                }
            }
            if was_open && began.elapsed() > GOOD_AFTER {
                back_off.reset();
            }
            tokio::time::sleep(back_off.next()).await;
        }
    }

    /// Serves one connection after the other; a new one takes the place of the old, whose peer may be
    /// gone without a word.
    async fn listen(&mut self, at: &str) {
        let mut back_off = BackOff::of_own();
        loop {
            let listener = match TcpListener::bind(at).await {
                Ok(listener) => listener,
                Err(error) => {
                    self.note(&format!("{at} cannot be listened at: {error}"));
                    tokio::time::sleep(back_off.next()).await;
                    continue;
                }
            };
            let mut next = None;
            loop {
                let stream = match next.take() {
                    Some(stream) => stream,
                    None => match listener.accept().await {
                        Ok((stream, _)) => stream,
                        Err(error) => {
                            self.note(&error.to_string());
                            tokio::time::sleep(back_off.next()).await;
                            continue;
                        }
                    },
                };
                match self.pump(Connection::Tcp(stream), Some(&listener)).await {
                    End::Replaced(newer) => next = Some(newer),
                    End::Broken(what) | End::Final(what) => self.note(&what),
                    End::Closed => {}
                }
                if self.shared.once && next.is_none() {
                    return;
                }
            }
        }
    }

    fn note(&self, what: &str) {
        self.statuses.iter().for_each(|status| status.note_error(what));
    }

    async fn open(&mut self) -> Result<Connection, End> {
        let address = &self.input.address;
        let broken = |error: io::Error| End::Broken(format!("{address}: {error}"));
        match &self.input.address {
            Address::Tcp { to } => Connection::tcp(to).await.map_err(broken),
            Address::Serial { path, baud } => Connection::serial(path, *baud).map_err(broken),
            Address::Udp { at } => Connection::udp(at).await.map_err(broken),
            Address::File { path, speed } => {
                let named = |error| End::Final(format!("{}: {error}", path.display()));
                Connection::file(path, *speed).await.map_err(named)
            }
            Address::Ntrip(caster) => {
                let gga = self.shared.gga.borrow().clone();
                match ntrip::connect(caster, self.ntrip_version, gga.as_deref()).await {
                    Ok(stream) => Ok(Connection::Ntrip(Box::new(stream))),
                    Err(NtripError::Final(what)) => Err(End::Final(what)),
                    Err(error) => {
                        if matches!(error, NtripError::NoAnswer) {
                            self.ntrip_version = 3 - self.ntrip_version;
                        }
                        Err(End::Broken(error.to_string()))
                    }
                }
            }
            #[cfg(feature = "mqtt")]
            Address::Mqtt(topic) => {
                crate::mqtt::subscribe(topic).await.map(Connection::Bus).map_err(broken)
            }
            #[cfg(not(feature = "mqtt"))]
            Address::Mqtt(_) => Err(End::Final("the feature `mqtt` is not built in".into())),
            #[cfg(feature = "zenoh")]
            Address::Zenoh(key) => {
                crate::zenoh::subscribe(key).await.map(Connection::Bus).map_err(broken)
            }
            #[cfg(not(feature = "zenoh"))]
            Address::Zenoh(_) => Err(End::Final("the feature `zenoh` is not built in".into())),
            Address::TcpListen { at } => Err(End::Final(format!("{at} is listened at"))),
        }
    }

    /// Passes bytes on to new decoders until the connection ends; then waits until they are done.
    async fn pump(&mut self, mut connection: Connection, listener: Option<&TcpListener>) -> End {
        self.statuses.iter().for_each(|status| status.note_connection(true));
        let is_marked = connection.is_marked();
        let (chunks, decoders) = self.start_decoders(is_marked);
        let end = self.pass_on(&mut connection, listener, &chunks).await;
        drop((chunks, connection));
        for decoder in decoders {
            let _ = decoder.await;
        }
        self.statuses.iter().for_each(|status| status.note_connection(false));
        self.input.tell_end(&self.shared.events);
        end
    }

    async fn pass_on(
        &mut self,
        connection: &mut Connection,
        listener: Option<&TcpListener>,
        chunks: &[mpsc::Sender<Chunk>],
    ) -> End {
        let mut buffer = vec![0; BUFFER];
        let mut gga_due = tokio::time::interval(GGA_INTERVAL);
        gga_due.tick().await;
        let waits = !self.input.address.is_file();
        let wants_gga = matches!(self.input.address, Address::Ntrip(_));
        let mut progress = Progress::new(self.epochs());
        loop {
            if waits && let Some(what) = progress.trouble(self.epochs(), Instant::now()) {
                return End::Broken(what);
            }
            let silent_at = progress.silent_at();
            let silence = async {
                if waits {
                    tokio::time::sleep_until(silent_at.into()).await
                } else {
                    core::future::pending().await
                }
            };
            let accepted = async {
                match listener {
                    Some(listener) => listener.accept().await,
                    None => core::future::pending().await,
                }
            };
            let count = tokio::select! {
                biased;
                read = connection.read(&mut buffer) => match read {
                    Ok(0) => return End::Closed,
                    Ok(count) => count,
                    Err(error) => return End::Broken(format!("the connection broke: {error}")),
                },
                newer = accepted => match newer {
                    Ok((stream, _)) => return End::Replaced(stream),
                    Err(_) => continue,
                },
                () = silence => continue,
                _ = gga_due.tick(), if wants_gga => {
                    let gga = self.shared.gga.borrow().clone();
                    if let Some(gga) = gga
                        && let Err(error) = connection.send(gga.as_bytes()).await
                    {
                        return End::Broken(format!("the connection broke: {error}"));
                    }
                    continue;
                }
            };
            let (arrived, utc) = (Instant::now(), SystemTime::now());
            let chunk = Chunk { bytes: Arc::from(&buffer[..count]), arrived, utc };
            self.has_worked = true;
            progress.note_bytes(arrived);
            self.statuses.iter().for_each(|status| status.note_bytes(count));
            if let Some(recorder) = &mut self.recorder
                && let Err(error) = recorder.write(&chunk)
            {
                self.note(&format!("the raw log pauses: {error}"));
            }
            let mut taken = false;
            for decoder in chunks {
                taken |= decoder.send(chunk.clone()).await.is_ok();
            }
            if !taken {
                return End::Broken("no decoder takes the bytes".into());
            }
        }
    }

    fn epochs(&self) -> u64 {
        self.statuses.iter().map(|status| status.epochs()).sum()
    }

    /// Reads lines for whom they are.
    fn start_reader(
        &self,
        lines: &Lines,
        is_marked: bool,
    ) -> (Vec<mpsc::Sender<Chunk>>, Vec<JoinHandle<()>>) {
        let (sender, receiver) = mpsc::channel(MAX_CHUNKS);
        let (events, status) = (self.shared.events.clone(), Arc::clone(&self.statuses[0]));
        let reading = match (lines, &self.shared.read_samples) {
            (Lines::Peer(number, _), _) => {
                let number = *number;
                tokio::task::spawn_blocking(move || read_peer(number, receiver, &status, &events))
            }
            (Lines::Imu, Some(read)) => {
                let mut samples = read();
                let permits = Arc::clone(&self.permits[0]);
                let pace = self.pace(is_marked);
                let is_unpaced = self.input.address.is_unpaced_file();
                tokio::task::spawn_blocking(move || {
                    lines::read(receiver, |line, chunk| {
                        let read = line.ok_or_else(|| "no line of text".to_owned());
                        match read.and_then(|line| samples.sample(line)) {
                            Ok(None) => true,
                            Ok(Some((tow_s, sample))) => {
                                if let Some((pace, speed)) = &pace {
                                    pace.wait_for_tow(tow_s, *speed);
                                }
                                status.note_line(gps_time(chunk.utc).nearest_with_tow(tow_s));
                                permits.acquire_of(if is_unpaced {
                                    imu::MAX_AHEAD
                                } else {
                                    usize::MAX
                                });
                                let arrived =
                                    if pace.is_some() { Instant::now() } else { chunk.arrived };
                                events.send(Event::Sample(tow_s, Box::new(sample), arrived)).is_ok()
                            }
                            Err(what) => {
                                status.note_bad_line(&what);
                                true
                            }
                        }
                    });
                })
            }
            (Lines::Imu, None) => tokio::task::spawn_blocking(move || drop(receiver)),
        };
        (vec![sender], vec![reading])
    }

    /// Of a log without time marks that is not read as fast as possible.
    fn pace(&self, is_marked: bool) -> Option<(Arc<Pace>, f64)> {
        match self.input.address {
            Address::File { speed, .. } if speed > 0.0 && !is_marked => {
                Some((Arc::clone(&self.shared.pace), speed))
            }
            _ => None,
        }
    }

    /// A decoder for every antenna of the stream.
    fn start_decoders(&self, is_marked: bool) -> (Vec<mpsc::Sender<Chunk>>, Vec<JoinHandle<()>>) {
        if let Some(lines) = &self.input.lines {
            return self.start_reader(lines, is_marked);
        }
        let pace = self.pace(is_marked);
        let told = *lock(&self.told_date);
        let known_time = told.or(*self.shared.known_time.borrow());
        let parts = self.input.antennas.iter().zip(&self.statuses).zip(&self.permits);
        parts
            .map(|(((antenna, name, options), status), permits)| {
                let (sender, receiver) = mpsc::channel(MAX_CHUNKS);
                let near = known_time.or(options.approximate_time);
                let near = near.unwrap_or_else(|| gps_time(SystemTime::now()));
                let decoding = Decoding {
                    name: format!("{name} ({})", self.input.address),
                    options: LogOptions { approximate_time: Some(near), ..*options },
                    permits: Arc::clone(permits),
                    status: Arc::clone(status),
                    told_date: Arc::clone(&self.told_date),
                    pace: pace.clone(),
                };
                let (antenna, events) = (*antenna, self.shared.events.clone());
                let give = move |decoded| {
                    events.send(Event::Epoch { antenna, decoded: Box::new(decoded) }).is_ok()
                };
                let decode = move || decoder::decode(&decoding, receiver, give);
                (sender, tokio::task::spawn_blocking(decode))
            })
            .unzip()
    }
}

/// Rows of another body until its connection ends.
fn read_peer(
    number: usize,
    chunks: mpsc::Receiver<Chunk>,
    status: &StreamStatus,
    events: &std::sync::mpsc::Sender<Event>,
) {
    lines::read(chunks, |line, chunk| {
        match line.ok_or_else(|| "no line of text".to_owned()).and_then(PeerLine::read) {
            Ok(line) => {
                status.note_line(Some(line.state.time));
                events.send(Event::PeerLine(number, Box::new(line), chunk.arrived)).is_ok()
            }
            Err(what) => {
                status.note_bad_line(&what);
                true
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_without_epochs_are_noticed() {
        let mut progress = Progress::new(3);
        let began = progress.since;
        let mut trouble = |epochs: u64, now: Instant| {
            progress.note_bytes(now);
            progress.trouble(epochs, now)
        };
        assert_eq!(trouble(3, began + EPOCH_TIMEOUT), None);
        assert_eq!(trouble(4, began + 2 * EPOCH_TIMEOUT), None);
        assert_eq!(trouble(4, began + 3 * EPOCH_TIMEOUT), None);
        let told = trouble(4, began + 3 * EPOCH_TIMEOUT + Duration::from_millis(1));
        assert_eq!(told.unwrap(), "bytes come, but no epoch for 30 s");
    }

    /// However often something else is to be done meanwhile.
    #[test]
    fn a_connection_that_says_nothing_is_silent_after_its_time() {
        let mut progress = Progress::new(0);
        let began = progress.last_bytes;
        for seconds in [10, 20, 29] {
            assert_eq!(progress.trouble(0, began + Duration::from_secs(seconds)), None);
        }
        assert_eq!(progress.silent_at(), began + DATA_TIMEOUT);
        let told = progress.trouble(0, began + DATA_TIMEOUT);
        assert_eq!(told.unwrap(), "nothing came for 30 s");
    }
}
