//! What a program gives the service: its parts, and functions for what is particular to the
//! program.

use std::path::PathBuf;
use std::time::{Instant, SystemTime};

use kurs::differential::Differential;
use kurs::ephemeris::NavigationData;
use kurs::observation::ArrayEpoch;
use kurs::observation::matcher::Deadline;
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;

use crate::imu::Imu;
use crate::input::Input;
use crate::output::Output;
use crate::page::Page;
use crate::peer::{PeerSetup, RelativeRow};

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
