//! The simulated receivers as live streams: each antenna sends its log at a TCP port, epoch by
//! epoch, at the time at which it was measured or faster.

use std::cell::RefCell;
use std::io::{self, Write};
use std::net::{TcpListener, TcpStream};
use std::rc::Rc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
use kurs_formats::ubx::UbxWriter;
use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{SimulatedEpoch, Simulation};

use crate::failure::UsageError;
use crate::interrupt::Watch;
use crate::output;

/// A client that takes nothing for so long is dropped, so that the others get theirs.
const WRITE_TIMEOUT: Duration = Duration::from_secs(1);

/// How the streams are sent.
#[derive(Debug, Clone, Copy, clap::Args)]
pub(super) struct StreamArgs {
    /// Sends the observations as live streams at TCP ports of the loopback, from this one on, one
    /// for each antenna (a fixed station last), in place of files. Begins when every port has a
    /// client.
    #[arg(long, value_name = "PORT", value_parser = clap::value_parser!(u16).range(1..))]
    pub(super) stream: Option<u16>,
    /// Protocol of the streams.
    #[arg(long, value_enum, value_name = "PROTOCOL", default_value = "ubx", requires = "stream")]
    stream_format: StreamFormat,
    /// How many times faster than real time; 0: as fast as possible.
    #[arg(long, value_name = "N", default_value_t = 1.0, requires = "stream", value_parser = speed)]
    speed: f64,
}

impl Default for StreamArgs {
    fn default() -> Self {
        Self { stream: None, stream_format: StreamFormat::Ubx, speed: 1.0 }
    }
}

/// The addresses of the streams of a body, and the rest of a configuration of `kurs live` for them.
pub(super) fn live_configuration(simulation: &Simulation, first_port: u16) -> String {
    let mut text = String::new();
    let antennas = simulation.scenario().body.first().into_iter().flat_map(|body| &body.antenna);
    for (antenna, port) in antennas.zip(first_port..=u16::MAX) {
        let (name, position_m) = (&antenna.name, antenna.position_m);
        text += &format!(
            "[[antenna]]\nname = {name:?}\nstream = \"tcp://127.0.0.1:{port}\"\n\
             position_m = {position_m:?}\n\n"
        );
    }
    text
}

/// Protocol of the streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum StreamFormat {
    Ubx,
    Rtcm3,
    Sbf,
}

fn speed(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok();
    value.filter(|s| (0.0..=1e6).contains(s)).ok_or_else(|| "expected 0 to 1000000".to_owned())
}

/// Sends the whole scenario from port `first_port` on; returns the number of epochs.
pub(super) fn send(
    simulation: &mut Simulation,
    args: StreamArgs,
    first_port: u16,
    is_quiet: bool,
    watch: &Watch,
) -> anyhow::Result<usize> {
    let listeners = listen(simulation.scenario(), first_port, is_quiet)?;
    let mut receivers: Vec<Receiver> = Vec::new();
    let (mut epoch, mut count) = (SimulatedEpoch::default(), 0);
    let mut begin = None;
    while !watch.asks_to_end() && simulation.next_epoch(&mut epoch) {
        if receivers.is_empty() {
            let navigation = simulation.navigation();
            for (listener, place) in listeners.iter().zip(places(simulation, &epoch)) {
                let Some(first) = first_client(listener, watch)? else { return Ok(count) };
                receivers.push(Receiver::new(listener, first, place, args, navigation)?);
            }
        }
        let Some(time) = epoch.bodies.first().map(|body| body.truth.time) else { break };
        let (began, first) = *begin.get_or_insert_with(|| (Instant::now(), time));
        if args.speed > 0.0 {
            let due = began + Duration::from_secs_f64((time - first) / args.speed);
            thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let observed = epoch.bodies.iter().flat_map(|body| &body.observed.antennas);
        for (receiver, observed) in receivers.iter_mut().zip(observed.chain([&epoch.station])) {
            if let Some(observed) = observed.as_ref().filter(|o| !o.observations.is_empty()) {
                receiver.send(observed)?;
            }
        }
        count += 1;
    }
    Ok(count)
}

/// Opens a port for each antenna, a fixed station last, from `first_port` on.
fn listen(
    scenario: &Scenario,
    first_port: u16,
    is_quiet: bool,
) -> anyhow::Result<Vec<TcpListener>> {
    let bodies = scenario.body.iter().flat_map(|body| &body.antenna).map(|a| a.name.clone());
    let names: Vec<String> =
        bodies.chain(scenario.station.iter().map(|s| s.name.clone())).collect();
    let last_port = usize::from(first_port) + names.len() - 1;
    if last_port > usize::from(u16::MAX) {
        let text = format!(
            "--stream {first_port}: {} streams need ports up to {last_port}, of which {} is the last",
            names.len(),
            u16::MAX
        );
        return Err(UsageError(text).into());
    }
    let listeners = names.iter().zip(first_port..=u16::MAX).map(|(name, port)| {
        let listener = TcpListener::bind(("127.0.0.1", port));
        let listener = listener.with_context(|| format!("port {port} for antenna {name}"))?;
        if !is_quiet {
            output::print(format_args!("{name}: stream = \"tcp://127.0.0.1:{port}\"\n"))?;
        }
        Ok(listener)
    });
    listeners.collect()
}

/// Waits for somebody to send to; `None` if the wait is interrupted.
fn first_client(listener: &TcpListener, watch: &Watch) -> io::Result<Option<TcpStream>> {
    const LOOK_AGAIN: Duration = Duration::from_millis(20);
    listener.set_nonblocking(true)?;
    while !watch.asks_to_end() {
        match listener.accept() {
            Ok((client, _)) => return Ok(Some(client)),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => thread::sleep(LOOK_AGAIN),
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

/// Where the antennas are at the start, and the station.
fn places(simulation: &Simulation, first: &SimulatedEpoch) -> Vec<Vector<Ecef>> {
    let bodies = first.bodies.iter();
    let antennas =
        bodies.flat_map(|body| body.observed.antennas.iter().map(|_| body.truth.position_m));
    let station = simulation.scenario().station.iter();
    antennas.chain(station.map(|station| station.place.geodetic().to_ecef())).collect()
}

/// One receiver with its port.
struct Receiver {
    listener: TcpListener,
    clients: Vec<TcpStream>,
    writer: Writer,
    sent: Pending,
}

enum Writer {
    Ubx(UbxWriter<Pending>),
    Rtcm3(Rtcm3Writer<Pending>),
    Sbf(Box<SbfWriter<Pending>>),
}

/// Bytes of an epoch on their way from the writer to the clients.
#[derive(Debug, Clone, Default)]
struct Pending(Rc<RefCell<Vec<u8>>>);

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Receiver {
    /// The first client gets the ephemerides that are sent at the start.
    fn new(
        listener: &TcpListener,
        first: TcpStream,
        place: Vector<Ecef>,
        args: StreamArgs,
        navigation: &NavigationData,
    ) -> io::Result<Self> {
        /// Every antenna has a stream of its own.
        const STATION: u16 = 1;
        let sent = Pending::default();
        let output = sent.clone();
        let writer = match args.stream_format {
            StreamFormat::Ubx => Writer::Ubx(UbxWriter::new(output, navigation)),
            StreamFormat::Rtcm3 => {
                Writer::Rtcm3(Rtcm3Writer::new(output, STATION, place, navigation))
            }
            StreamFormat::Sbf => Writer::Sbf(Box::new(SbfWriter::new(output, navigation))),
        };
        let listener = listener.try_clone()?;
        let mut receiver = Self { listener, clients: Vec::new(), writer, sent };
        receiver.add(first)?;
        Ok(receiver)
    }

    fn add(&mut self, client: TcpStream) -> io::Result<()> {
        client.set_nonblocking(false)?;
        client.set_nodelay(true)?;
        client.set_write_timeout(Some(WRITE_TIMEOUT))?;
        self.clients.push(client);
        Ok(())
    }

    /// Sends an epoch to everyone who is there.
    fn send(&mut self, epoch: &AntennaEpoch) -> io::Result<()> {
        while let Ok((client, _)) = self.listener.accept() {
            self.add(client)?;
        }
        match &mut self.writer {
            Writer::Ubx(writer) => writer.write(epoch),
            Writer::Rtcm3(writer) => writer.write(epoch),
            Writer::Sbf(writer) => writer.write(&[epoch]),
        }?;
        let bytes = core::mem::take(&mut *self.sent.0.borrow_mut());
        // A client that is gone, or does not read, is dropped.
        self.clients.retain_mut(|client| client.write_all(&bytes).is_ok());
        Ok(())
    }
}
