//! Configuration of `kurs solve`: file, flags and `--set` become one table, read strictly, and the
//! table remembers where each value came from.

use std::path::{Path, PathBuf};

use kurs::array::{AntennaArray, MAX_SEPARATION_M};
use kurs::engine::{Ambiguities, Constraint, Direction, Settings};
use kurs::float_solution::recursive::Motion;
use kurs::frames::{Body, Vector};
use kurs::signal::Band;
use kurs::sky::NoiseModel;
use kurs::time::{Calendar, GpsTime};
use kurs_formats::logs::{LogPart, Protocol};
use kurs_formats::sbf::AntennaId;
use kurs_formats::source::can_be_read_again;
use kurs_live::Profile;
use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::found_files::{FoundAntenna, FoundFiles};
use super::origins::Origins;
use crate::config_file;
use crate::failure::UsageError;
use crate::fuse::antennas::config::{AntennasConfig, FilterConfig};
use crate::fuse::imu::ImuConfig;
use crate::pipe;
use crate::window::Window;

/// The configuration as written.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    #[serde(default)]
    pub(crate) antenna: Vec<AntennaTable>,
    #[serde(default)]
    pub(crate) nav: NavTable,
    #[serde(default)]
    pub(crate) antex: AntexTable,
    #[serde(default)]
    pub(crate) solve: SolveTable,
    #[serde(default)]
    pub(crate) point: Vec<PointTable>,
    pub(crate) station: Option<StationTable>,
    /// What only `kurs live` reads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) live: Option<LiveTable>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) output: Vec<OutputTable>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) log: Option<LogTable>,
    /// The inertial sensor, with the tables of `kurs fuse` that go with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) imu: Option<ImuConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) antennas: Option<AntennasConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) filter: Option<FilterTable>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) peer: Vec<PeerTable>,
    // What `kurs plan` is told in the same file.
    #[serde(default, rename = "plan", skip_serializing)]
    _plan: IgnoredAny,
    #[serde(default, rename = "mask", skip_serializing)]
    _mask: IgnoredAny,
    #[serde(default, rename = "baseline", skip_serializing)]
    _baseline: IgnoredAny,
}

/// One antenna.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AntennaTable {
    pub(crate) name: String,
    #[serde(default)]
    pub(crate) obs: Vec<PathBuf>,
    /// `kurs live`: where the bytes come from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stream: Option<String>,
    pub(crate) position_m: Option<[f64; 3]>,
    /// IGS name of type and radome, to be found in the ANTEX files.
    pub(crate) antenna_type: Option<String>,
    /// The north mark against the body's forward axis, clockwise seen from above.
    pub(crate) antenna_orientation_deg: Option<f64>,
    /// Log of several protocols with observations: the one that is wanted.
    #[serde(
        default,
        deserialize_with = "protocol",
        serialize_with = "protocol_word",
        skip_serializing_if = "Option::is_none"
    )]
    pub(crate) protocol: Option<Protocol>,
    /// RTCM 3 log: the station that is this antenna.
    pub(crate) station_id: Option<u16>,
    /// SBF log: the antenna of the receiver that is this one: main, aux1, aux2.
    #[serde(
        default,
        deserialize_with = "antenna_id",
        serialize_with = "antenna_id_word",
        skip_serializing_if = "Option::is_none"
    )]
    pub(crate) antenna_id: Option<AntennaId>,
}

impl AntennaTable {
    /// Refuses a type without calibrations, an orientation without a type or out of range.
    fn check_calibration(&self, antex: &AntexTable) -> Result<(), UsageError> {
        let what = match (&self.antenna_type, self.antenna_orientation_deg) {
            (Some(_), _) if antex.files.is_empty() => {
                "`antenna_type` needs the calibrations: give `[antex] files`".into()
            }
            (None, Some(_)) => "`antenna_orientation_deg` without `antenna_type`".into(),
            (_, Some(degrees)) if !(-360.0..=360.0).contains(&degrees) => {
                format!("`antenna_orientation_deg` is {degrees}, expected -360 to 360")
            }
            _ => return Ok(()),
        };
        Err(UsageError(format!("antenna `{}`: {what}", self.name)))
    }
}

fn antenna_id<'de, D: Deserializer<'de>>(text: D) -> Result<Option<AntennaId>, D::Error> {
    String::deserialize(text)?.parse().map(Some).map_err(serde::de::Error::custom)
}

#[allow(clippy::ref_option)] // as serde calls it
fn antenna_id_word<S: Serializer>(
    id: &Option<AntennaId>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    id.map(|id| id.to_string()).serialize(serializer)
}

#[allow(clippy::ref_option)] // as serde calls it
fn protocol_word<S: Serializer>(
    protocol: &Option<Protocol>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    protocol.map(word).serialize(serializer)
}

/// As a configuration names it.
const fn word(protocol: Protocol) -> &'static str {
    match protocol {
        Protocol::Ubx => "ubx",
        Protocol::Rtcm3 => "rtcm3",
        Protocol::Sbf => "sbf",
    }
}

fn protocol<'de, D: Deserializer<'de>>(text: D) -> Result<Option<Protocol>, D::Error> {
    String::deserialize(text)?.parse().map(Some).map_err(serde::de::Error::custom)
}

/// Antenna calibrations.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AntexTable {
    #[serde(default)]
    pub(crate) files: Vec<PathBuf>,
}

/// Navigation files.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NavTable {
    #[serde(default)]
    pub(crate) files: Vec<PathBuf>,
    /// Uses only the ephemerides of a log that came before the epoch, as a live run knows them.
    #[serde(default)]
    pub(crate) as_received: bool,
    /// Date, or date and time, of logs that do not tell it.
    pub(crate) approximate_time: Option<toml::value::Datetime>,
}

impl NavTable {
    fn check(&self) -> Result<(), UsageError> {
        match &self.approximate_time {
            Some(time) if gps_time(time).is_none() => Err(UsageError(format!(
                "nav.approximate_time is {time}, expected a date since 1980 such as 2024-06-24"
            ))),
            _ => Ok(()),
        }
    }
}

/// A fixed station at a known place.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StationTable {
    #[serde(default)]
    pub(crate) obs: Vec<PathBuf>,
    /// `kurs live`: where the bytes come from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stream: Option<String>,
    /// `kurs live`: where it is left out, a stream says it itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) position_ecef_m: Option<[f64; 3]>,
    /// `kurs live`: until which age an epoch serves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) max_age_s: Option<f64>,
    /// Log of several protocols with observations: the one that is wanted.
    #[serde(
        default,
        deserialize_with = "protocol",
        serialize_with = "protocol_word",
        skip_serializing_if = "Option::is_none"
    )]
    pub(crate) protocol: Option<Protocol>,
    /// RTCM 3 log: the station that is meant.
    pub(crate) station_id: Option<u16>,
    /// SBF log: the antenna of the receiver that is meant.
    #[serde(
        default,
        deserialize_with = "antenna_id",
        serialize_with = "antenna_id_word",
        skip_serializing_if = "Option::is_none"
    )]
    pub(crate) antenna_id: Option<AntennaId>,
}

impl StationTable {
    /// Refuses coordinates that are not on the Earth.
    fn check_place(&self) -> Result<(), UsageError> {
        let Some([x, y, z]) = self.position_ecef_m else { return Ok(()) };
        let radius_m = (x * x + y * y + z * z).sqrt();
        if (6.3e6..7e6).contains(&radius_m) {
            return Ok(());
        }
        Err(UsageError(format!(
            "station.position_ecef_m is {radius_m:.0} m from the Earth's centre, expected ECEF \
             coordinates of a place on the Earth"
        )))
    }

    /// For those who do not go by what the station says.
    ///
    /// # Errors
    ///
    /// [`UsageError`] without a place.
    pub(crate) fn check_has_place(&self) -> Result<(), UsageError> {
        let missing = "station: `position_ecef_m` is missing, its ECEF coordinates in metres";
        self.position_ecef_m.map(|_| ()).ok_or_else(|| UsageError(missing.into()))
    }

    /// Until which age an epoch serves, s.
    ///
    /// # Errors
    ///
    /// [`UsageError`] if it is out of range.
    pub(crate) fn max_age_s(&self) -> Result<f64, UsageError> {
        /// An older epoch is of no use unless more is asked for.
        const USUAL_S: f64 = 10.0;
        let max_age_s = self.max_age_s.unwrap_or(USUAL_S);
        if (0.0..=60.0).contains(&max_age_s) {
            return Ok(max_age_s);
        }
        Err(UsageError(format!("station.max_age_s is {max_age_s}, expected 0 to 60")))
    }
}

/// A further point of the body.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PointTable {
    pub(crate) name: String,
    pub(crate) position_m: [f64; 3],
}

impl PointTable {
    /// Refuses a place that no body reaches.
    pub(crate) fn check(&self) -> Result<(), UsageError> {
        let [x, y, z] = self.position_m;
        if Vector::<Body>::new(x, y, z).norm() <= MAX_SEPARATION_M {
            return Ok(());
        }
        Err(UsageError(format!(
            "point `{}`: `position_m` is [{x}, {y}, {z}], expected metres on the body, at most {MAX_SEPARATION_M} \
             from its origin",
            self.name
        )))
    }
}

/// The service of `kurs live`.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct LiveTable {
    /// Name in messages.
    pub(crate) body: Option<String>,
    pub(crate) deadline_ms: Option<f64>,
    pub(crate) state_dir: Option<PathBuf>,
    /// Address of `/healthz` and `/metrics`.
    pub(crate) page: Option<String>,
    /// Its first line is what those who ask for the page have to show.
    pub(crate) token_file: Option<PathBuf>,
    /// All antennas have one clock: tags that differ are reported.
    #[serde(default)]
    pub(crate) common_clock: bool,
    /// Until which age the attitude of another body serves, s.
    pub(crate) peer_max_age_s: Option<f64>,
}

/// Where messages go.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OutputTable {
    pub(crate) to: String,
    pub(crate) profile: OutputProfile,
    pub(crate) rate_hz: Option<f64>,
    /// Angles of float rows leave too.
    #[serde(default)]
    pub(crate) float: bool,
    /// Angles that a gyro carried leave too.
    #[serde(default)]
    pub(crate) predicted: bool,
}

/// Another body.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PeerTable {
    pub(crate) name: String,
    /// Where its JSON lines come from.
    pub(crate) from: String,
}

/// The filter of `kurs fuse`, for streams.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct FilterTable {
    pub(crate) gate_sigmas: f64,
    pub(crate) order_window_s: f64,
    pub(crate) first_angle_sd_deg: f64,
}

impl Default for FilterTable {
    /// That of `kurs fuse`, but that hardly anything waits for what is out of order: a stream has
    /// its order, and only the clock of a receiver is off by up to some milliseconds.
    fn default() -> Self {
        let FilterConfig { gate_sigmas, first_angle_sd_deg, .. } = FilterConfig::default();
        Self { gate_sigmas, first_angle_sd_deg, order_window_s: 0.01 }
    }
}

/// What messages look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub(crate) enum OutputProfile {
    /// The columns of `attitude.csv` as JSON lines, with the times of the message.
    Jsonl,
    /// The rows of `attitude.csv`.
    Csv,
    /// Other bodies as seen from this one, as JSON lines.
    Relative,
    /// For readers with a format of their own.
    Of(Profile),
}

impl TryFrom<String> for OutputProfile {
    type Error = String;

    fn try_from(word: String) -> Result<Self, String> {
        match word.as_str() {
            "jsonl" => Ok(Self::Jsonl),
            "csv" => Ok(Self::Csv),
            "relative" => Ok(Self::Relative),
            word => Profile::of_word(word).map(Self::Of).ok_or_else(|| {
                let known: Vec<&str> =
                    ["jsonl", "csv", "relative"].into_iter().chain(Profile::words()).collect();
                format!("unknown profile `{word}`, expected one of {}", known.join(", "))
            }),
        }
    }
}

impl From<OutputProfile> for String {
    fn from(profile: OutputProfile) -> Self {
        match profile {
            OutputProfile::Jsonl => "jsonl",
            OutputProfile::Csv => "csv",
            OutputProfile::Relative => "relative",
            OutputProfile::Of(profile) => profile.word(),
        }
        .to_owned()
    }
}

/// Raw logs of the streams.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LogTable {
    pub(crate) dir: PathBuf,
}

/// The method's settings; every key has a default.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SolveTable {
    pub(crate) bands: Option<Vec<String>>,
    pub(crate) elevation_mask_deg: f64,
    pub(crate) ambiguity: AmbiguityKey,
    pub(crate) direction: DirectionKey,
    pub(crate) motion: MotionKey,
    pub(crate) random_walk_m: f64,
    pub(crate) constraint: Option<ConstraintKey>,
    pub(crate) array_sd_m: f64,
    pub(crate) max_wrong_fix_rate: f64,
    /// Rows whose receivers state spoofing are refused.
    pub(crate) use_interference_flags: bool,
    pub(crate) max_tilt_deg: f64,
    pub(crate) roll_sd_deg: f64,
    pub(crate) max_angle_sd_deg: f64,
    pub(crate) code_sd_m: f64,
    pub(crate) phase_sd_m: f64,
    pub(crate) glonass_channel_sd_m: f64,
}

/// How ambiguities are carried from epoch to epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum AmbiguityKey {
    Instantaneous,
    Continuous,
}

/// From which end the session is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum DirectionKey {
    Forward,
    Both,
}

/// How baselines move from epoch to epoch while ambiguities are carried on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MotionKey {
    Free,
    Static,
    RandomWalk,
}

/// What is known of the array in the integer search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ConstraintKey {
    Array,
    Length,
    None,
}

impl Default for SolveTable {
    fn default() -> Self {
        Self {
            bands: None,
            elevation_mask_deg: 10.0,
            ambiguity: AmbiguityKey::Instantaneous,
            direction: DirectionKey::Forward,
            motion: MotionKey::Free,
            random_walk_m: 0.1,
            constraint: None,
            array_sd_m: 0.002,
            max_wrong_fix_rate: 0.001,
            use_interference_flags: true,
            max_tilt_deg: 90.0,
            roll_sd_deg: 5.0,
            max_angle_sd_deg: 5.0,
            code_sd_m: 0.2,
            phase_sd_m: 0.0015,
            glonass_channel_sd_m: 0.0,
        }
    }
}

/// A configuration in force, with the origin of every key.
#[derive(Debug, Clone)]
pub(crate) struct Loaded {
    pub(crate) config: Config,
    /// Which epochs count.
    pub(crate) window: Window,
    /// Folder that relative paths start from.
    folder: PathBuf,
    pub(super) origins: Origins,
    text: String,
}

/// What the command line adds to or puts in place of a file.
#[derive(Debug, Default)]
pub(crate) struct Overrides<'a> {
    /// Files without names of antennas.
    pub(crate) found: Option<&'a FoundFiles>,
    /// `NAME=OBS[#ID][@X,Y,Z]`
    pub(crate) antennas: &'a [String],
    /// Files in place of those of an antenna of the file.
    pub(crate) observations: &'a [(String, Vec<PathBuf>)],
    /// Navigation files.
    pub(crate) nav: &'a [PathBuf],
    /// `key=value`
    pub(crate) set: &'a [String],
    /// Which epochs count.
    pub(crate) window: Window,
    /// Streams take the place of files.
    pub(crate) is_live: bool,
}

/// Reads the configuration file (if any), applies flags and `--set`.
pub(crate) fn load(file: Option<&Path>, overrides: &Overrides<'_>) -> Result<Loaded, UsageError> {
    overrides.window.check()?;
    let mut table = toml::Table::new();
    let mut origins = Origins::default();
    let mut folder = PathBuf::new();
    if let Some(path) = file {
        let name = path.display().to_string();
        let text = config_file::text(path)?;
        // Read once into the typed form, for messages with line numbers.
        let _: Config = config_file::parse(&text, &name)?;
        table = config_file::parse(&text, &name)?;
        folder = pipe::folder_of(path);
        origins.of_file(&text, &name);
    }
    let mut antennas = Vec::new();
    if let Some(found) = overrides.found {
        antennas.extend(
            found.antennas.iter().map(|antenna| (found_antenna(antenna), "command line".into())),
        );
        let (nav, origin) = found.navigation();
        set_files(&mut table, "nav", &nav, origin, &mut origins);
        set_files(&mut table, "antex", &found.antex, "command line", &mut origins);
    }
    for flag in overrides.antennas {
        antennas.push((antenna_flag(flag)?, format!("--antenna {flag}")));
    }
    if !antennas.is_empty() {
        origins.forget("antenna");
        for (index, (antenna, origin)) in antennas.iter().enumerate() {
            origins.of_keys(&format!("antenna.{index}"), antenna, origin);
        }
        let antennas = antennas.into_iter().map(|(antenna, _)| toml::Value::Table(antenna));
        table.insert("antenna".into(), toml::Value::Array(antennas.collect()));
    }
    for (name, files) in overrides.observations {
        set_observations(&mut table, name, files, &mut origins)?;
    }
    set_files(&mut table, "nav", overrides.nav, "--nav", &mut origins);
    for assignment in overrides.set {
        let set_key = config_file::set(&mut table, assignment, "solve")?;
        origins.set(&set_key, "--set");
        typed(&table).map_err(|what| UsageError(format!("--set {assignment}: {what}")))?;
    }
    let (config, text) = typed(&table).map_err(UsageError)?;
    let loaded = Loaded { config, window: overrides.window, folder, origins, text };
    loaded.check()?;
    if overrides.is_live {
        loaded.check_live()?;
    } else {
        loaded.check_files()?;
    }
    Ok(loaded)
}

/// Puts files in place of `[name] files`; none leave it as it is.
fn set_files(
    table: &mut toml::Table,
    name: &str,
    files: &[PathBuf],
    origin: &str,
    origins: &mut Origins,
) {
    if files.is_empty() {
        return;
    }
    let files = toml::Value::Array(files.iter().map(|path| absolute(path)).collect());
    let inner = table.entry(name).or_insert_with(|| toml::Table::new().into());
    if let toml::Value::Table(inner) = inner {
        inner.insert("files".into(), files);
        origins.set(&format!("{name}.files"), origin);
    }
}

/// Puts files in place of the `obs` of an antenna.
fn set_observations(
    table: &mut toml::Table,
    name: &str,
    files: &[PathBuf],
    origins: &mut Origins,
) -> Result<(), UsageError> {
    let mut antennas: Vec<&mut toml::Table> = match table.get_mut("antenna") {
        Some(toml::Value::Array(antennas)) => {
            antennas.iter_mut().filter_map(toml::Value::as_table_mut).collect()
        }
        _ => Vec::new(),
    };
    let is_named = |antenna: &&mut toml::Table| {
        antenna.get("name").and_then(toml::Value::as_str) == Some(name)
    };
    let Some(index) = antennas.iter().position(is_named) else {
        let text = format!("obs:{name}: the configuration has no antenna `{name}`");
        return Err(UsageError(text));
    };
    let files = toml::Value::Array(files.iter().map(|path| absolute(path)).collect());
    antennas[index].insert("obs".into(), files);
    origins.set(&format!("antenna.{index}.obs"), "manifest");
    Ok(())
}

/// An antenna of files whose content tells.
fn found_antenna(found: &FoundAntenna) -> toml::Table {
    let mut table = toml::Table::new();
    table.insert("name".into(), found.name.clone().into());
    let files = found.files.iter().map(|path| absolute(path)).collect();
    table.insert("obs".into(), toml::Value::Array(files));
    match found.part {
        Some(LogPart::Receiver) => table.insert("protocol".into(), word(Protocol::Ubx).into()),
        Some(LogPart::Station(id)) => table.insert("station_id".into(), i64::from(id).into()),
        Some(LogPart::Antenna(id)) => table.insert("antenna_id".into(), id.to_string().into()),
        None => None,
    };
    table
}

/// The table as a configuration, and as text; what is wrong with it otherwise.
fn typed(table: &toml::Table) -> Result<(Config, String), String> {
    let text = toml::to_string(table).map_err(|error| error.to_string())?;
    Ok((config_file::typed(table)?, text))
}

fn absolute(path: &Path) -> toml::Value {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    toml::Value::String(absolute.display().to_string())
}

/// A date of TOML, with or without a time of day; some seconds between time scales do not matter.
fn gps_time(time: &toml::value::Datetime) -> Option<GpsTime> {
    let date = time.date?;
    let (hour, minute) = time.time.map_or((12, 0), |time| (time.hour, time.minute));
    GpsTime::from_calendar(Calendar {
        year: i32::from(date.year),
        month: date.month,
        day: date.day,
        hour,
        minute,
        second: 0.0,
    })
}

/// `NAME=OBS[#ID][@X,Y,Z]`; ID: protocol, station (RTCM 3) or antenna (SBF) of a log with several.
fn antenna_flag(flag: &str) -> Result<toml::Table, UsageError> {
    let expected = || {
        UsageError(format!(
            "--antenna {flag}: expected NAME=OBS, NAME=OBS@X,Y,Z or, of one log with several antennas, \
             NAME=OBS#aux1@X,Y,Z"
        ))
    };
    let (name, rest) = flag
        .split_once('=')
        .filter(|(n, r)| !n.is_empty() && !r.is_empty())
        .ok_or_else(expected)?;
    let (obs, position) = match rest.rsplit_once('@') {
        Some((obs, coordinates)) => {
            let numbers: Result<Vec<f64>, _> =
                coordinates.split(',').map(|c| c.trim().parse()).collect();
            match numbers {
                Ok(xyz) if xyz.len() == 3 => (obs, Some(xyz)),
                // An @ in a file name does not begin a position.
                _ if Path::new(rest).exists() => (rest, None),
                _ => return Err(expected()),
            }
        }
        None => (rest, None),
    };
    let mut table = toml::Table::new();
    // A # in a file name chooses nothing.
    let chosen = obs.rsplit_once('#').filter(|_| !Path::new(obs).exists());
    let obs = chosen.map_or(obs, |(obs, _)| obs);
    match chosen.map(|(_, id)| (id, id.parse::<u16>())) {
        Some((_, Ok(station))) => table.insert("station_id".into(), i64::from(station).into()),
        Some((id, Err(_))) if id.parse::<Protocol>().is_ok() => {
            table.insert("protocol".into(), id.into())
        }
        Some((id, Err(_))) => table.insert("antenna_id".into(), id.into()),
        None => None,
    };
    table.insert("name".into(), name.into());
    table.insert("obs".into(), toml::Value::Array(vec![absolute(Path::new(obs))]));
    if let Some(xyz) = position {
        table.insert(
            "position_m".into(),
            toml::Value::Array(xyz.into_iter().map(Into::into).collect()),
        );
    }
    Ok(table)
}

impl Loaded {
    /// A path of the configuration, relative to its file's folder.
    pub(crate) fn path(&self, path: &Path) -> PathBuf {
        self.folder.join(path)
    }

    /// Every file that the configuration names.
    pub(crate) fn input_files(&self) -> Vec<PathBuf> {
        let Config { antenna, station, nav, antex, .. } = &self.config;
        let observed =
            antenna.iter().flat_map(|a| &a.obs).chain(station.iter().flat_map(|s| &s.obs));
        observed.chain(&nav.files).chain(&antex.files).map(|file| self.path(file)).collect()
    }

    /// `[nav] approximate_time`
    pub(crate) fn approximate_time(&self) -> Option<GpsTime> {
        self.config.nav.approximate_time.as_ref().and_then(gps_time)
    }

    /// The text that stands for this configuration in its hash.
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Every antenna, and the station if there is one, must have files.
    fn check_files(&self) -> Result<(), UsageError> {
        self.check_direction()?;
        let Config { antenna, station, .. } = &self.config;
        if let Some(without) = antenna.iter().find(|a| a.obs.is_empty()) {
            return Err(UsageError(format!("antenna `{}`: `obs` names no file", without.name)));
        }
        station.as_ref().map_or(Ok(()), StationTable::check_has_place)?;
        if station.as_ref().is_some_and(|station| station.obs.is_empty()) {
            return Err(UsageError("station: `obs` names no file".into()));
        }
        Ok(())
    }

    /// A stream has no end to begin from.
    fn check_live(&self) -> Result<(), UsageError> {
        if self.config.solve.direction == DirectionKey::Forward {
            return Ok(());
        }
        Err(UsageError(
            "solve.direction is \"both\", expected \"forward\": a stream can only be solved as it comes".into(),
        ))
    }

    /// Files that both directions need twice, and what the later one would know.
    fn check_direction(&self) -> Result<(), UsageError> {
        if self.config.solve.direction == DirectionKey::Forward {
            return Ok(());
        }
        if self.config.nav.as_received {
            return Err(UsageError(
                "solve.direction is \"both\" and nav.as_received is true, expected one of them: a backward run \
                 knows what came later"
                    .into(),
            ));
        }
        match self.input_files().into_iter().find(|file| !can_be_read_again(file)) {
            None => Ok(()),
            Some(file) => Err(UsageError(format!(
                "solve.direction is \"both\", which reads every file twice: {} can be read once only",
                file.display()
            ))),
        }
    }

    fn check(&self) -> Result<(), UsageError> {
        let Config { antenna, point, station, .. } = &self.config;
        if antenna.len() < 2 {
            return Err(UsageError(format!(
                "{} `[[antenna]]` in the configuration, at least two are needed for an attitude",
                antenna.len()
            )));
        }
        self.check_names()?;
        self.config.nav.check()?;
        station.as_ref().map_or(Ok(()), StationTable::check_place)?;
        antenna.iter().try_for_each(|a| a.check_calibration(&self.config.antex))?;
        point.iter().try_for_each(PointTable::check)?;
        self.check_positions()
    }

    /// Every antenna and point must have a name of its own.
    fn check_names(&self) -> Result<(), UsageError> {
        let Config { antenna, point, .. } = &self.config;
        let names: Vec<&String> =
            antenna.iter().map(|a| &a.name).chain(point.iter().map(|p| &p.name)).collect();
        for (index, name) in names.iter().enumerate() {
            if name.is_empty() || names[..index].contains(name) {
                return Err(UsageError(format!(
                    "name `{name}` of antenna or point is empty or used twice"
                )));
            }
        }
        Ok(())
    }

    /// All antennas must have a position, or none; points need them.
    fn check_positions(&self) -> Result<(), UsageError> {
        let Config { antenna, point, .. } = &self.config;
        let without: Vec<&str> =
            antenna.iter().filter(|a| a.position_m.is_none()).map(|a| a.name.as_str()).collect();
        if without.is_empty() || point.is_empty() && without.len() == antenna.len() {
            return Ok(());
        }
        if without.len() < antenna.len() {
            return Err(UsageError(format!(
                "`position_m` is missing for {}: give it for every antenna or for none",
                without.join(", ")
            )));
        }
        Err(UsageError("`[[point]]` needs the `position_m` of every antenna".into()))
    }

    /// Settings of the engine.
    pub(crate) fn settings(&self) -> Result<Settings, UsageError> {
        self.config.settings()
    }
}

impl Config {
    /// The constraint in force: the known array wherever it is known; of two antennas that is their
    /// length.
    pub(crate) fn constraint(&self) -> Constraint {
        let antennas = &self.antenna;
        let whole = if antennas.len() == 2 { Constraint::Length } else { Constraint::Array };
        match self.solve.constraint {
            Some(ConstraintKey::None) => Constraint::None,
            Some(ConstraintKey::Length) => Constraint::Length,
            Some(ConstraintKey::Array) => whole,
            None if antennas.first().is_some_and(|a| a.position_m.is_some()) => whole,
            None => Constraint::None,
        }
    }

    /// What is carried from epoch to epoch.
    fn ambiguities(&self) -> Ambiguities {
        let solve = &self.solve;
        let motion = match solve.motion {
            MotionKey::Free => Motion::Free,
            MotionKey::Static => Motion::Static,
            MotionKey::RandomWalk => Motion::RandomWalk { m_per_sqrt_s: solve.random_walk_m },
        };
        match solve.ambiguity {
            AmbiguityKey::Instantaneous => Ambiguities::Instantaneous,
            AmbiguityKey::Continuous => Ambiguities::Continuous(motion),
        }
    }

    /// Settings of the engine.
    pub(crate) fn settings(&self) -> Result<Settings, UsageError> {
        let Config { antenna, solve, point, .. } = self;
        let positions: Option<Vec<_>> =
            antenna.iter().map(|a| a.position_m.map(|[x, y, z]| Vector::new(x, y, z))).collect();
        let named = |error| UsageError(self.with_names(&error));
        let array = positions.map(AntennaArray::new).transpose().map_err(named)?;
        array.as_ref().map_or(Ok(()), AntennaArray::check_extent).map_err(named)?;
        let bands = solve.bands.as_ref().map(|bands| self.bands(bands)).transpose()?;
        let settings = Settings {
            antennas: antenna.len(),
            array,
            points_m: point
                .iter()
                .map(|p| p.position_m)
                .map(|[x, y, z]| Vector::new(x, y, z))
                .collect(),
            bands,
            elevation_mask_rad: solve.elevation_mask_deg.to_radians(),
            ambiguities: self.ambiguities(),
            direction: Direction::Forward,
            constraint: self.constraint(),
            array_sd_m: solve.array_sd_m,
            max_wrong_fix_rate: solve.max_wrong_fix_rate,
            use_interference_flags: solve.use_interference_flags,
            max_tilt_rad: solve.max_tilt_deg.to_radians(),
            roll_sd_rad: solve.roll_sd_deg.to_radians(),
            max_angle_sd_rad: solve.max_angle_sd_deg.to_radians(),
            residuals: false,
            first_antenna_m: None,
            noise: NoiseModel {
                code_zenith_m: solve.code_sd_m,
                phase_zenith_m: solve.phase_sd_m,
                full_cn0_dbhz: 45.0,
                channel_sd_m: solve.glonass_channel_sd_m,
            },
        };
        settings.check().map_err(|error| UsageError(super::in_keys(&error)))?;
        Ok(settings)
    }

    fn bands(&self, names: &[String]) -> Result<Vec<Band>, UsageError> {
        if names.is_empty() {
            return Err(UsageError(
                "`bands` is empty; leave it out to use every shared band".into(),
            ));
        }
        names
            .iter()
            .map(|name| name.parse().map_err(|error| UsageError(format!("bands: {error}"))))
            .collect()
    }

    /// An array error with the antennas' names in place of their numbers.
    fn with_names(&self, error: &kurs::array::ArrayError) -> String {
        use kurs::array::ArrayError;
        let name = |index: usize| &self.antenna[index].name;
        match error {
            ArrayError::Coincident { first, second, distance_m } => format!(
                "antennas `{}` and `{}` are {distance_m:.4} m apart: two antennas cannot be at one place",
                name(*first),
                name(*second)
            ),
            ArrayError::FarApart { first, second, distance_m } => format!(
                "antennas `{}` and `{}` are {distance_m:.0} m apart: `position_m` is in metres on one body",
                name(*first),
                name(*second)
            ),
            ArrayError::NotFinite { antenna } => {
                format!("`position_m` of antenna `{}` is not a finite number", name(*antenna))
            }
            ArrayError::TooFew { .. } => error.to_string(),
        }
    }
}
