//! One stream: connect, and when the connection breaks make it again, for ever.

use std::io;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use kurs::time::GpsTime;
use tokio::net::{TcpListener, TcpStream};

use super::{Event, Input, Shared};
use crate::address::Address;
use crate::back_off::{BackOff, GOOD_AFTER};
use crate::connection::Connection;
use crate::intake::Intake;
use crate::lock::lock;
use crate::ntrip::{self, NtripError};
use crate::record::Recorder;
use crate::status::StreamStatus;

/// The parts of one input.
pub(crate) struct Running {
    pub(super) input: Input,
    pub(super) intakes: Vec<Intake>,
    pub(super) shared: Shared,
    pub(super) recorder: Option<Recorder>,
    ntrip_version: u8,
    /// Something came over it.
    pub(super) has_worked: bool,
    /// The date that ephemerides of an earlier connection told, against the one in force.
    pub(super) told_date: Arc<Mutex<Option<GpsTime>>>,
}

/// How a connection ended.
pub(super) enum End {
    Closed,
    Broken(String),
    /// Another one takes its place.
    Replaced(TcpStream),
    /// Trying again cannot help.
    Final(String),
}

impl Running {
    pub(crate) fn new(input: Input, intakes: Vec<Intake>, shared: Shared) -> Self {
        let is_file = input.address.is_file();
        let recorder = shared.log_dir.as_ref().filter(|_| !is_file);
        let recorder = recorder.map(|directory| Recorder::new(directory, input.name()));
        Self {
            input,
            intakes,
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
        self.statuses().for_each(|status| status.note_end());
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

    /// Serves one connection after the other; a new one takes the place of the old, whose peer may
    /// be gone without a word.
    async fn listen(&mut self, at: &str) {
        let mut back_off = BackOff::of_own();
        let listener = self.bind(at, &mut back_off).await;
        let mut next = None;
        loop {
            let stream = match next.take() {
                Some(stream) => stream,
                None => self.accept(&listener, &mut back_off).await,
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

    async fn bind(&self, at: &str, back_off: &mut BackOff) -> TcpListener {
        loop {
            match TcpListener::bind(at).await {
                Ok(listener) => return listener,
                Err(error) => self.note(&format!("{at} cannot be listened at: {error}")),
            }
            tokio::time::sleep(back_off.next()).await;
        }
    }

    async fn accept(&self, listener: &TcpListener, back_off: &mut BackOff) -> TcpStream {
        loop {
            match listener.accept().await {
                Ok((stream, _)) => return stream,
                Err(error) => self.note(&error.to_string()),
            }
            tokio::time::sleep(back_off.next()).await;
        }
    }

    pub(super) fn statuses(&self) -> impl Iterator<Item = &StreamStatus> {
        self.intakes.iter().map(|intake| &*intake.status)
    }

    pub(super) fn note(&self, what: &str) {
        self.statuses().for_each(|status| status.note_error(what));
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
                let gga = lock(&self.shared.known.gga).clone();
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
}
