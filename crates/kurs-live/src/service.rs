//! The service put together: inputs, engine, outputs, page; and its life from start to stop.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use kurs::ephemeris::AsReceived;
use kurs::observation::matcher::{Deadline, Matcher};
use kurs::turn_rate::TurnRate;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::task::JoinHandle;

use crate::files;
use crate::imu::Carrier;
use crate::input::{Event, Input, Known, Observer};
use crate::inputs::Inputs;
use crate::intake::Intakes;
use crate::lines::Lines;
use crate::outlets::{EXPIRES, Outlets};
use crate::output;
use crate::page::{Command, Hub, MAX_COMMANDS};
use crate::peer::Peers;
use crate::setup::{Reloaded, Setup};
use crate::solver::{Antenna, Solver};
use crate::state::StateFiles;
use crate::station_epochs::StationEpochs;
use crate::station_place::StationPlace;
use crate::status::Status;
use crate::systemd;

/// Outputs get so long to send what they have when the service stops.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// What is said when the system has no thread.
const NO_THREADS: &str = "the service cannot start its threads";

/// Why the service cannot run.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The operating system refuses something that is needed.
    #[error("{what}: {error}")]
    Io {
        /// What was tried.
        what: String,
        /// Why not.
        #[source]
        error: io::Error,
    },
    /// The engine cannot be made.
    #[error("{0}")]
    Engine(String),
}

fn refused(what: impl Into<String>) -> impl FnOnce(io::Error) -> ServiceError {
    let what = what.into();
    move |error| ServiceError::Io { what, error }
}

/// Runs the service until SIGINT or SIGTERM, or (once) until every stream has ended. `reload` reads
/// the configuration again, on SIGHUP.
///
/// # Errors
///
/// [`ServiceError`] if it cannot start.
pub fn run(
    setup: Setup,
    reload: impl Fn() -> Result<Reloaded, String>,
) -> Result<(), ServiceError> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(refused(NO_THREADS))?;
    let result = runtime.block_on(serve(setup, reload));
    // Decoders of connections that are still open wait for bytes that do not matter any more.
    runtime.shutdown_background();
    result
}

async fn serve(
    mut setup: Setup,
    reload: impl Fn() -> Result<Reloaded, String>,
) -> Result<(), ServiceError> {
    let signals = Signals::listen().map_err(refused("signals cannot be received"))?;
    let status = Arc::new(Status::new());
    let (page, commands) = open_page(&mut setup, &status)?;
    let gga = Mutex::new(setup.first_gga.take());
    let known = Arc::new(Known { time: Mutex::new(setup.known_time), gga });
    let (mut inputs, events) = Inputs::new(&setup, Arc::clone(&known));
    status.set_streams(inputs.intakes.statuses(has_station(&setup.inputs)));
    warn_of_long_deadline(&setup);
    let streams = setup.inputs.clone();
    let mut solving = start_solver(setup, &inputs.intakes, status, page, known, events)?;
    streams.into_iter().for_each(|input| inputs.start(input));
    systemd::notify("READY=1");
    tokio::spawn(systemd::feed_watchdog(Arc::clone(&solving.heartbeat)));

    run_until_stopped(&mut inputs, &mut solving.thread, signals, commands, reload).await;
    inputs.abort();
    // The engine is gone, and with it the sender of rows: the writer ends with the last one.
    let _ = tokio::task::spawn_blocking(move || solving.writer.join()).await;
    tokio::time::sleep(LAST_WORDS).await;
    Ok(())
}

/// The signals that a service obeys.
struct Signals {
    interrupt: Signal,
    terminate: Signal,
    hang_up: Signal,
}

impl Signals {
    fn listen() -> io::Result<Self> {
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hang_up: signal(SignalKind::hangup())?,
        })
    }
}

type Commands = tokio::sync::mpsc::Receiver<Command>;

/// Serves the page, if one is wanted; with what it will ask for.
fn open_page(
    setup: &mut Setup,
    status: &Arc<Status>,
) -> Result<(Option<Arc<Hub>>, Commands), ServiceError> {
    let (sender, commands) = tokio::sync::mpsc::channel(MAX_COMMANDS);
    let Some(page) = setup.page.take() else { return Ok((None, commands)) };
    let what = format!("page {}", page.at);
    let served = Hub::serve(page, Arc::clone(status), setup.log_dir.clone(), sender);
    let (hub, bound) = served.map_err(refused(what))?;
    tracing::info!("page at http://{bound}/");
    Ok((Some(hub), commands))
}

fn warn_of_long_deadline(setup: &Setup) {
    if let Deadline::Seconds(wait_s) = setup.deadline
        && !(setup.once || setup.outputs.is_empty())
        && wait_s >= EXPIRES.as_secs_f64()
    {
        tracing::warn!(
            "live.deadline_ms is {:.0}: a row that waits so long for a late or silent antenna leaves by no output, \
             which send nothing after {} ms",
            1e3 * wait_s,
            EXPIRES.as_millis()
        );
    }
}

/// The threads behind the inputs.
struct Solving {
    thread: JoinHandle<()>,
    /// Writes the rows to the files.
    writer: thread::JoinHandle<()>,
    /// Grows as long as the engine's thread lives.
    heartbeat: Arc<AtomicU64>,
}

/// Starts the engine's thread with everything behind it.
fn start_solver(
    setup: Setup,
    intakes: &Intakes,
    status: Arc<Status>,
    page: Option<Arc<Hub>>,
    known: Arc<Known>,
    events: mpsc::Receiver<Event>,
) -> Result<Solving, ServiceError> {
    let matcher = matcher(&setup);
    let station = station_epochs(&setup, intakes);
    let is_imu_unpaced = are_unpaced(&setup.inputs, |input| input.lines == Some(Lines::Imu));
    let (rows, writer) =
        files::start(setup.write_row, setup.write_relative).map_err(refused(NO_THREADS))?;
    let engine = (setup.make_engine)(setup.navigation.clone()).map_err(ServiceError::Engine)?;
    let start_output = |output| output::start(output, Arc::clone(&status));
    let outlets = Outlets {
        peers: setup.peers.map(|peers| Peers::new(peers, start_output)),
        sinks: setup.outputs.into_iter().map(start_output).collect(),
        status: Arc::clone(&status),
        page,
        turn_rate: TurnRate::default(),
        known,
        gga: setup.gga,
        rows,
        once: setup.once,
    };
    let carrier = setup.imu.zip(intakes.imu.clone());
    let solver = Solver {
        station_place: StationPlace::new(engine.station_m(), Arc::clone(&intakes.station.status)),
        engine,
        carrier: carrier
            .map(|(imu, intake)| Carrier::new(imu, setup.deadline, is_imu_unpaced, intake)),
        finish: setup.finish,
        matcher,
        complete: VecDeque::new(),
        newest: None,
        received: AsReceived::new(setup.antennas),
        antennas: intakes.antennas.iter().cloned().map(Antenna::new).collect(),
        station,
        common_clock: setup.common_clock,
        navigation: setup.navigation,
        status,
        outlets,
        state: setup.state_dir.map(StateFiles::new).transpose().map_err(refused(NO_THREADS))?,
        began: Instant::now(),
        inputs: setup.inputs.iter().filter(|input| !input.is_optional()).count(),
        once: setup.once,
        heartbeat: Arc::default(),
    };
    let heartbeat = Arc::clone(&solver.heartbeat);
    let thread = tokio::task::spawn_blocking(move || solver.run(&events));
    Ok(Solving { thread, writer, heartbeat })
}

/// Logs that are read as fast as possible wait for each other; everything else has a deadline.
fn matcher(setup: &Setup) -> Matcher {
    match are_unpaced(&setup.inputs, Input::has_antennas) {
        true => Matcher::new(setup.antennas),
        false => Matcher::new(setup.antennas).with_deadline(setup.deadline),
    }
}

fn station_epochs(setup: &Setup, intakes: &Intakes) -> StationEpochs {
    let are_logs = are_unpaced(&setup.inputs, |input| input.lines.is_none());
    let is_awaited = has_station(&setup.inputs) && are_logs;
    let permits = Arc::clone(&intakes.station.permits);
    StationEpochs::new(permits, setup.station_max_age_s, is_awaited)
}

fn has_station(inputs: &[Input]) -> bool {
    inputs.iter().any(|input| input.name_of(Observer::Station).is_some())
}

/// Whether all inputs of a kind are logs that are read as fast as possible.
fn are_unpaced(inputs: &[Input], is_of_kind: impl Fn(&Input) -> bool) -> bool {
    let mut of_kind = inputs.iter().filter(|input| is_of_kind(input));
    of_kind.all(|input| input.address.is_unpaced_file())
}

/// Obeys signals and the page until the engine's thread ends, by itself or because a signal says
/// so.
async fn run_until_stopped(
    inputs: &mut Inputs,
    solving: &mut JoinHandle<()>,
    mut signals: Signals,
    mut commands: Commands,
    reload: impl Fn() -> Result<Reloaded, String>,
) {
    loop {
        tokio::select! {
            _ = &mut *solving => return,
            _ = signals.interrupt.recv() => break,
            _ = signals.terminate.recv() => break,
            _ = signals.hang_up.recv() => inputs.reload(reload()),
            Some(command) = commands.recv() => inputs.obey(command),
        }
    }
    systemd::notify("STOPPING=1");
    inputs.tell(Event::Stop);
    let _ = solving.await;
}
