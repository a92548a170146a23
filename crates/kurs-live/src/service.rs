//! The service put together: inputs, engine, outputs, page; and its life from start to stop.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, Instant, SystemTime};

use kurs::differential::Differential;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::observation::ArrayEpoch;
use kurs::observation::matcher::{Deadline, Matcher};
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs::turn_rate::TurnRate;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;
use tokio::task::JoinHandle;

use crate::address::Address;
use crate::decoder::{Pace, Permits};
use crate::estimator::{Antenna, EXPIRES, Estimator, StationEpochs};
use crate::imu::{Carrier, Imu};
use crate::input::{Event, Input, Running, STATION, Shared};
use crate::lines::Lines;
use crate::output::{self, Output};
use crate::page::{Command, Hub, MAX_COMMANDS, Page};
use crate::peer::{PeerSetup, Peers, RelativeRow};
use crate::state::StateFiles;
use crate::station_place::StationPlace;
use crate::status::{Brings, Status, StreamStatus};
use crate::systemd;

/// Rows that may wait for the files: a minute at 100 Hz.
const MAX_ROWS: usize = 6000;
/// Outputs get so long to send what they have when the service stops.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// The engine is taken for stuck when its thread shows no life for so long.
const STUCK_AFTER: Duration = Duration::from_secs(5);

/// When the bytes of a row came in, and when it went out.
#[derive(Debug, Clone, Copy)]
pub struct Times {
    /// The first byte of the first antenna's epoch.
    pub first_byte: Instant,
    /// The last byte of the last antenna's epoch.
    pub last_byte: Instant,
    /// When that byte came, by the system's clock.
    pub last_byte_utc: SystemTime,
    /// The row was there.
    pub row_out: Instant,
    /// When the row was there, by the system's clock.
    pub row_out_utc: SystemTime,
    /// How much older than the row the station's epoch in it is, s.
    pub station_age_s: Option<f64>,
}

/// Makes an engine that knows these navigation data; the error is for the log.
pub type MakeEngine = Box<dyn Fn(NavigationData) -> Result<Differential, String> + Send>;
/// What is done to a row behind the engine.
pub type Finish = Box<dyn FnMut(&ArrayEpoch, &mut EpochSolution) + Send>;
/// Writes a row to the files; the error is for the log.
pub type WriteRow = Box<dyn FnMut(&EpochSolution) -> Result<(), String> + Send>;
/// Writes another body as seen from this one to the files; the error is for the log.
pub type WriteRelative = Box<dyn FnMut(&RelativeRow) -> Result<(), String> + Send>;
/// The position of a row as a GGA sentence, for casters.
pub type Gga = Box<dyn Fn(&EpochSolution) -> Option<String> + Send>;

/// Everything that the service is made of.
pub struct Setup {
    /// Streams.
    pub inputs: Vec<Input>,
    /// Number of antennas.
    pub antennas: usize,
    /// Navigation data that count from the start.
    pub navigation: NavigationData,
    /// Makes the engine.
    pub make_engine: MakeEngine,
    /// The inertial sensor, if one of the inputs is its.
    pub imu: Option<Imu>,
    /// The other bodies, if some of the inputs are theirs.
    pub peers: Option<PeerSetup>,
    /// Behind the engine.
    pub finish: Finish,
    /// When a row goes without late antennas.
    pub deadline: Deadline,
    /// Until which age, s, a station's epoch serves.
    pub station_max_age_s: f64,
    /// All antennas have one clock: their tags are watched.
    pub common_clock: bool,
    /// Time that is known before anything came.
    pub known_time: Option<GpsTime>,
    /// Rows to files.
    pub write_row: WriteRow,
    /// Other bodies to files.
    pub write_relative: WriteRelative,
    /// Rows to others.
    pub outputs: Vec<Output>,
    /// Position to casters.
    pub gga: Gga,
    /// Where the body was, for casters that want to know before the first row.
    pub first_gga: Option<String>,
    /// What is shown of it, and to whom.
    pub page: Option<Page>,
    /// Where a restart finds what this run knew.
    pub state_dir: Option<PathBuf>,
    /// Where the bytes of the streams go.
    pub log_dir: Option<PathBuf>,
    /// Ends when every stream has ended.
    pub once: bool,
}

/// What a reload changes.
pub struct Reloaded {
    /// Streams; those that are as before go on.
    pub inputs: Vec<Input>,
    /// Number of antennas; another one needs a restart.
    pub antennas: usize,
    /// Makes the engine.
    pub make_engine: MakeEngine,
    /// Keys that have changed and wait for a restart.
    pub not_taken_over: Vec<String>,
}

/// A new engine for the old one's place.
pub(crate) struct NewEngine {
    pub(crate) make: MakeEngine,
}

impl core::fmt::Debug for NewEngine {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("NewEngine")
    }
}

/// What goes to the files.
pub(crate) enum ForFiles {
    Row(Box<EpochSolution>),
    /// Other bodies at one row of this one.
    Relative(Vec<RelativeRow>),
}

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
        error: std::io::Error,
    },
    /// The engine cannot be made.
    #[error("{0}")]
    Engine(String),
}

fn io(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> ServiceError {
    let what = what.into();
    move |error| ServiceError::Io { what, error }
}

/// Runs the service until SIGINT or SIGTERM, or (once) until every stream has ended. `reload` reads the
/// configuration again, on SIGHUP.
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
        .map_err(io("the service cannot start its threads"))?;
    let result = runtime.block_on(serve(setup, reload));
    // Decoders of connections that are still open wait for bytes that do not matter any more.
    runtime.shutdown_background();
    result
}

/// The running inputs with what they were made of.
struct Inputs {
    running: Vec<(Input, JoinHandle<()>)>,
    permits: Vec<Arc<Permits>>,
    station_permits: Arc<Permits>,
    statuses: Vec<Arc<StreamStatus>>,
    station_status: Arc<StreamStatus>,
    imu: Arc<StreamStatus>,
    imu_permits: Arc<Permits>,
    peers: Vec<Arc<StreamStatus>>,
    shared: Shared,
}

impl Inputs {
    fn start(&mut self, input: Input) {
        let of = |antenna: usize| match antenna {
            STATION => (Arc::clone(&self.station_status), Arc::clone(&self.station_permits)),
            _ => (Arc::clone(&self.statuses[antenna]), Arc::clone(&self.permits[antenna])),
        };
        let (statuses, permits) = match &input.lines {
            Some(Lines::Imu) => (vec![Arc::clone(&self.imu)], vec![Arc::clone(&self.imu_permits)]),
            Some(Lines::Peer(number, _)) => {
                (vec![Arc::clone(&self.peers[*number])], vec![Arc::default()])
            }
            None => input.antennas.iter().map(|(antenna, ..)| of(*antenna)).unzip(),
        };
        let running = Running::new(input.clone(), statuses, permits, self.shared.clone());
        self.running.push((input, tokio::spawn(running.run())));
    }

    /// Connects the stream of this name anew; tells whether there is one.
    fn restart(&mut self, name: &str) -> bool {
        let is_named = |input: &Input| {
            let of_lines = input.lines.as_ref().is_some_and(|lines| lines.name() == name);
            of_lines || input.antennas.iter().any(|(_, of, _)| of == name)
        };
        let place = self.running.iter().position(|(input, task)| {
            // A recording would begin again, and an ended stream is counted out.
            is_named(input) && !input.address.is_file() && !task.is_finished()
        });
        let Some(place) = place else { return false };
        let input = self.end(place);
        tracing::info!(stream = name, "restarted");
        self.start(input);
        true
    }

    /// Ends a running stream.
    fn end(&mut self, place: usize) -> Input {
        let (input, task) = self.running.remove(place);
        task.abort();
        input.tell_end(&self.shared.events);
        input
    }

    /// Whether the sensor and the peers are the same, wherever their lines come from.
    fn have_the_lines_of(&self, inputs: &[Input]) -> bool {
        let new = inputs.iter().filter_map(|input| input.lines.as_ref());
        self.running.iter().filter_map(|(input, _)| input.lines.as_ref()).eq(new)
    }

    /// Streams that are as before go on, others end, new ones begin.
    fn change(&mut self, inputs: Vec<Input>) {
        while let Some(place) = self.running.iter().position(|(input, _)| !inputs.contains(input)) {
            self.end(place);
        }
        for input in inputs {
            if !self.running.iter().any(|(running, _)| *running == input) {
                self.start(input);
            }
        }
    }
}

async fn serve(
    setup: Setup,
    reload: impl Fn() -> Result<Reloaded, String>,
) -> Result<(), ServiceError> {
    let signals = || "signals cannot be received";
    let mut stop = [
        signal(SignalKind::interrupt()).map_err(io(signals()))?,
        signal(SignalKind::terminate()).map_err(io(signals()))?,
    ];
    let mut hang_up = signal(SignalKind::hangup()).map_err(io(signals()))?;

    let status = Arc::new(Status::new());
    let (commands, mut commanded) = tokio::sync::mpsc::channel(MAX_COMMANDS);
    let page = setup.page.map(|page| {
        let (at, log_dir) = (page.at, setup.log_dir.clone());
        let served = Hub::serve(page, Arc::clone(&status), log_dir, commands);
        served.map_err(io(format!("page {at}")))
    });
    let page = page.transpose()?.map(|(hub, bound)| {
        tracing::info!("page at http://{bound}/");
        hub
    });
    let (events, received) = mpsc::channel();
    let (gga_sender, gga) = watch::channel(setup.first_gga);
    let (time_sender, known_time) = watch::channel(setup.known_time);
    let shared = Shared {
        events: events.clone(),
        pace: Arc::new(Pace::default()),
        gga,
        known_time,
        log_dir: setup.log_dir,
        read_samples: setup.imu.as_ref().map(|imu| Arc::clone(&imu.read)),
        once: setup.once,
    };
    let stream_status = |number: usize| {
        let input = setup.inputs.iter().find(|i| i.antennas.iter().any(|(n, ..)| *n == number));
        let name = input.and_then(|i| i.antennas.iter().find(|(n, ..)| *n == number));
        let name = name.map_or_else(|| "station".to_owned(), |(_, name, _)| name.clone());
        let baud = input.and_then(|i| match i.address {
            Address::Serial { baud, .. } => Some(baud),
            _ => None,
        });
        Arc::new(StreamStatus::new(name, baud))
    };
    let of_lines = |input: &Input, brings| {
        let baud = match input.address {
            Address::Serial { baud, .. } => Some(baud),
            _ => None,
        };
        Arc::new(StreamStatus::new(input.name().to_owned(), baud).bringing(brings))
    };
    let imu_input = setup.inputs.iter().find(|input| input.lines == Some(Lines::Imu));
    let imu_status = imu_input.map(|input| of_lines(input, Brings::Samples));
    let peers: Vec<_> = setup
        .inputs
        .iter()
        .filter(|input| input.is_optional())
        .map(|input| of_lines(input, Brings::Peer))
        .collect();
    let mut inputs = Inputs {
        running: Vec::new(),
        permits: (0..setup.antennas).map(|_| Arc::default()).collect(),
        station_permits: Arc::default(),
        statuses: (0..setup.antennas).map(stream_status).collect(),
        station_status: stream_status(STATION),
        imu: imu_status.clone().unwrap_or_else(|| stream_status(STATION)),
        imu_permits: Arc::default(),
        peers: peers.clone(),
        shared,
    };
    let has_station = setup.inputs.iter().any(|i| i.antennas.iter().any(|(n, ..)| *n == STATION));
    let station = has_station.then(|| Arc::clone(&inputs.station_status));
    status.set_streams(
        inputs.statuses.iter().cloned().chain(station).chain(imu_status).chain(peers).collect(),
    );

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
    let is_unpaced = is_unpaced(&setup.inputs);
    let mut with_antennas = setup.inputs.iter().filter(|input| input.lines.is_none());
    let all_unpaced = with_antennas.all(|input| input.address.is_unpaced_file());
    let is_imu_unpaced = imu_input.is_some_and(|input| input.address.is_unpaced_file());
    let (rows, written) = mpsc::sync_channel(MAX_ROWS);
    let writer = start_writer(setup.write_row, setup.write_relative, written)?;
    let heartbeat = Arc::new(AtomicU64::new(0));
    let carrier = setup.imu.map(|imu| {
        let (imu_status, permits) = (Arc::clone(&inputs.imu), Arc::clone(&inputs.imu_permits));
        Carrier::new(imu, setup.deadline, is_imu_unpaced, imu_status, permits)
    });
    let state = setup.state_dir.map(StateFiles::new);
    let start_output = |output| output::start(output, Arc::clone(&status));
    let engine = (setup.make_engine)(setup.navigation.clone()).map_err(ServiceError::Engine)?;
    let estimator = Estimator {
        station_place: StationPlace::new(engine.station_m(), Arc::clone(&inputs.station_status)),
        carrier,
        peers: setup.peers.map(|peers| Peers::new(peers, start_output)),
        turn_rate: TurnRate::default(),
        engine,
        finish: setup.finish,
        // Logs that are read as fast as possible wait for each other; everything else has a deadline.
        matcher: match is_unpaced {
            true => Matcher::new(setup.antennas),
            false => Matcher::new(setup.antennas).with_deadline(setup.deadline),
        },
        complete: VecDeque::new(),
        newest: None,
        received: AsReceived::new(setup.antennas),
        antennas: antennas(&inputs),
        station: StationEpochs::new(
            Arc::clone(&inputs.station_permits),
            setup.station_max_age_s,
            has_station && all_unpaced,
        ),
        common_clock: setup.common_clock,
        navigation: setup.navigation,
        status: Arc::clone(&status),
        sinks: setup.outputs.into_iter().map(start_output).collect(),
        rows,
        page,
        gga: (gga_sender, setup.gga),
        known_time: time_sender,
        state: state.transpose().map_err(io("the service cannot start its threads"))?,
        began: Instant::now(),
        inputs: setup.inputs.iter().filter(|input| !input.is_optional()).count(),
        once: setup.once,
        heartbeat: Arc::clone(&heartbeat),
    };
    let mut solving = tokio::task::spawn_blocking(move || estimator.run(&received));
    setup.inputs.into_iter().for_each(|input| inputs.start(input));
    systemd::notify("READY=1");
    tokio::spawn(tell_systemd(heartbeat));

    loop {
        tokio::select! {
            _ = &mut solving => break,
            () = any(&mut stop) => {
                systemd::notify("STOPPING=1");
                let _ = events.send(Event::Stop);
                let _ = (&mut solving).await;
                break;
            }
            _ = hang_up.recv() => match reload() {
                Ok(new) if new.antennas != inputs.statuses.len() => {
                    tracing::error!("another number of antennas needs a restart; nothing was changed");
                }
                Ok(new) if !inputs.have_the_lines_of(&new.inputs) => {
                    tracing::error!(
                        "another inertial sensor or other peers need a restart; nothing was changed"
                    );
                }
                Ok(new) => {
                    if !new.not_taken_over.is_empty() {
                        tracing::warn!("changed, but only by a restart: {}", new.not_taken_over.join(", "));
                    }
                    inputs.change(new.inputs);
                    let make = NewEngine { make: new.make_engine };
                    let _ = events.send(Event::Reload(Box::new(make)));
                }
                Err(what) => tracing::error!("nothing was changed: {what}"),
            },
            Some(Command::Restart { name, done }) = commanded.recv() => {
                let _ = done.send(inputs.restart(&name));
            }
        }
    }
    inputs.running.iter().for_each(|(_, task)| task.abort());
    // The engine is gone, and with it the sender of rows: the writer ends with the last one.
    let _ = tokio::task::spawn_blocking(move || writer.join()).await;
    tokio::time::sleep(LAST_WORDS).await;
    Ok(())
}

/// Whether all streams of antennas are logs that are read as fast as possible.
fn is_unpaced(inputs: &[Input]) -> bool {
    let mut of_antennas = inputs.iter().filter(|i| i.antennas.iter().any(|(n, ..)| *n != STATION));
    of_antennas.all(|input| input.address.is_unpaced_file())
}

fn antennas(inputs: &Inputs) -> Vec<Antenna> {
    let parts = inputs.permits.iter().zip(&inputs.statuses);
    parts
        .map(|(permits, status)| Antenna {
            permits: Arc::clone(permits),
            status: Arc::clone(status),
            out: 0,
            arrivals: VecDeque::new(),
        })
        .collect()
}

/// Files have a thread of their own: a disk that stalls delays nothing else.
fn start_writer(
    mut write_row: WriteRow,
    mut write_relative: WriteRelative,
    rows: mpsc::Receiver<ForFiles>,
) -> Result<thread::JoinHandle<()>, ServiceError> {
    let write = move || {
        let mut last_error = String::new();
        for rows in rows {
            let written = match rows {
                ForFiles::Row(row) => write_row(&row),
                ForFiles::Relative(rows) => rows.iter().try_for_each(&mut write_relative),
            };
            match written {
                Ok(()) => last_error.clear(),
                // One that goes on and on is told of once.
                Err(error) if error == last_error => {}
                Err(error) => {
                    tracing::error!("a row cannot be written: {error}");
                    last_error = error;
                }
            }
        }
    };
    let named = thread::Builder::new().name("rows".into());
    named.spawn(write).map_err(io("the service cannot start its threads"))
}

async fn any(signals: &mut [Signal; 2]) {
    let [first, second] = signals;
    tokio::select! {
        _ = first.recv() => {}
        _ = second.recv() => {}
    }
}

/// Feeds the watchdog of systemd as long as the engine's thread lives.
async fn tell_systemd(heartbeat: Arc<AtomicU64>) {
    let Some(interval) = systemd::watchdog_interval() else { return };
    let (mut last, mut seen) = (0, Instant::now());
    loop {
        let now = heartbeat.load(Relaxed);
        if now != last {
            (last, seen) = (now, Instant::now());
        }
        if seen.elapsed() < STUCK_AFTER {
            systemd::notify("WATCHDOG=1");
        }
        tokio::time::sleep(interval).await;
    }
}
