//! From the configuration to the parts of the service.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use kurs::engine::Settings;
use kurs::ephemeris::NavigationData;
use kurs::frames::{Body, Geodetic, Vector};
use kurs::observation::matcher::Deadline;
use kurs::solution::{EpochSolution, PositionEstimate, PositionOrigin, Reason};
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::ros::bus::{MAX_DOMAIN, Publisher, TOPICS};
use kurs_formats::source::Source;
use kurs_live::{
    Address, Encode, Finish, Input, MakeEngine, Observer, Output, Page, Partner, Profile, Reloaded,
    Setup, Zenoh,
};
use nalgebra::Matrix3;

use super::day_tables::DayTables;
use super::messages::Leaves;
use super::{companions, messages};
use crate::copies::Copies;
use crate::failure::UsageError;
use crate::solve::config::{Loaded, OutputProfile, OutputTable};
use crate::solve::{self, phase_centers};
use crate::summary::Summary;

/// The service of a configuration.
pub(super) fn setup(
    loaded: &Loaded,
    tables: DayTables,
    summary: Arc<Mutex<Summary>>,
    once: bool,
) -> anyhow::Result<Setup> {
    let live = loaded.config.live.clone().unwrap_or_default();
    let state_dir = live.state_dir.as_ref().map(|directory| loaded.path(directory));
    let remembered = state_dir.as_deref().map(kurs_live::remembered).unwrap_or_default();
    let files = navigation_files(loaded)?;
    let of_files = kurs_live::newest_reference_time(&files);
    let mut navigation = remembered.navigation;
    let of_earlier_run = kurs_live::newest_reference_time(&navigation).or(remembered.time);
    navigation.update(&files);
    let clock = kurs_live::gps_time(SystemTime::now());

    let token = live.token_file.as_ref().map(|file| token(&loaded.path(file))).transpose()?;
    let body = live.body.unwrap_or_else(|| "body".to_owned());
    let at = live.page.as_deref().map(|text| page_address(text, token.is_some())).transpose()?;
    let page = at.map(|at| page(at, token, loaded, &body));
    check_ports(loaded)?;
    let is_relative = |output: &&OutputTable| output.profile == OutputProfile::Relative;
    let made = |wanted: bool| {
        let tables = loaded.config.output.iter().filter(|table| is_relative(table) == wanted);
        let made = tables.map(|table| outputs(table, &body, loaded));
        made.collect::<Result<Vec<_>, _>>().map(|outputs| outputs.concat())
    };
    let (relative, outputs) = (made(true)?, made(false)?);
    let tables = Arc::new(Mutex::new(tables));
    let tables_of_peers = Arc::clone(&tables);
    Ok(Setup {
        inputs: inputs(loaded)?,
        antennas: loaded.config.antenna.len(),
        navigation,
        make_engine: make_engine(loaded, page.is_some())?,
        imu: companions::imu(loaded)?,
        peers: companions::peers(loaded, &body, relative)?,
        finish: finish(),
        deadline: deadline(live.deadline_ms)?,
        station_max_age_s: station_max_age_s(loaded)?,
        common_clock: live.common_clock,
        known_time: of_files.or(of_earlier_run.filter(|time| is_of_these_days(*time, clock))),
        write_row: Box::new(move |row| {
            let mut summary = summary.lock().unwrap_or_else(PoisonError::into_inner);
            summary.add(row, row.shared_satellites >= 4);
            drop(summary);
            let mut tables = tables.lock().unwrap_or_else(PoisonError::into_inner);
            tables.write(row).map_err(|error| format!("{error:#}"))
        }),
        write_relative: Box::new(move |row| {
            let mut tables = tables_of_peers.lock().unwrap_or_else(PoisonError::into_inner);
            tables.write_relative(row).map_err(|error| format!("{error:#}"))
        }),
        outputs,
        gga: Box::new(messages::gga),
        first_gga: remembered.place.and_then(|place| gga_of_place(place, remembered.time)),
        page,
        state_dir,
        log_dir: loaded.config.log.as_ref().map(|log| loaded.path(&log.dir)),
        once,
    })
}

/// Whether a time that an earlier run left tells the week still: the system's clock is less than
/// half a week behind it, or before it, and then it is the clock that is wrong (that of a computer
/// without a battery begins anew).
fn is_of_these_days(time: GpsTime, clock: GpsTime) -> bool {
    const HALF_WEEK_S: f64 = 302_400.0;
    clock - time < HALF_WEEK_S
}

/// What a configuration that was read again changes.
pub(super) fn reloaded(running: &Loaded, loaded: &Loaded) -> anyhow::Result<Reloaded> {
    Ok(Reloaded {
        not_taken_over: not_taken_over(running, loaded),
        inputs: inputs(loaded)?,
        antennas: loaded.config.antenna.len(),
        make_engine: make_engine(
            loaded,
            loaded.config.live.as_ref().is_some_and(|l| l.page.is_some()),
        )?,
    })
}

/// Tables and keys that differ from those of the running service, which keeps its own.
fn not_taken_over(running: &Loaded, loaded: &Loaded) -> Vec<String> {
    let table = |of: &Loaded| {
        let live = of.config.live.clone().unwrap_or_default();
        let value = serde_json::to_value(live).unwrap_or_default();
        value.as_object().cloned().unwrap_or_default()
    };
    let outputs = |of: &Loaded| serde_json::to_value(&of.config.output).unwrap_or_default();
    let log = |of: &Loaded| of.config.log.as_ref().map(|log| log.dir.clone());
    let (before, after) = (table(running), table(loaded));
    let keys = after.keys().filter(|key| before.get(*key) != after.get(*key));
    let mut changed: Vec<String> = keys.map(|key| format!("live.{key}")).collect();
    for (is_changed, name) in [
        (outputs(running) != outputs(loaded), "[[output]]"),
        (log(running) != log(loaded), "log.dir"),
    ] {
        changed.extend(is_changed.then(|| name.to_owned()));
    }
    changed
}

/// No two keys may listen at one port.
fn check_ports(loaded: &Loaded) -> Result<(), UsageError> {
    let config = &loaded.config;
    let antennas =
        config.antenna.iter().map(|a| (format!("antenna `{}` stream", a.name), &a.stream));
    let antennas = antennas.filter_map(|(key, stream)| Some((key, stream.clone()?)));
    let outputs = config.output.iter().zip(1..);
    let outputs = outputs.map(|(output, n)| (format!("output {n} to"), output.to.clone()));
    let page = config.live.as_ref().and_then(|live| live.page.clone());
    let page = page.map(|page| ("live.page".to_owned(), format!("tcp-listen://{page}")));
    let mut taken: Vec<(String, String)> = Vec::new();
    for (key, text) in antennas.chain(outputs).chain(page) {
        let Ok(Address::TcpListen { at }) = text.parse() else { continue };
        let other = taken.iter().find(|(_, other)| listen_at_one(other, &at));
        if let Some((other, _)) = other.filter(|(other, _)| !(is_stream(other) && is_stream(&key)))
        {
            return Err(UsageError(format!("{key}: {at} is taken by {other} already")));
        }
        taken.push((key, at));
    }
    Ok(())
}

/// Antennas may have one stream in common.
fn is_stream(key: &str) -> bool {
    key.ends_with("stream")
}

/// Whether two addresses have the same port of the same interface, or of any.
fn listen_at_one(one: &str, other: &str) -> bool {
    let parts = |at: &str| {
        let (host, port) = at.rsplit_once(':').unwrap_or((at, ""));
        let host = if host == "localhost" { "127.0.0.1" } else { host };
        (host.to_owned(), port.to_owned())
    };
    let ((one, port), (other, other_port)) = (parts(one), parts(other));
    let is_any = |host: &str| matches!(host, "0.0.0.0" | "[::]");
    // Port 0 is any that is free.
    port == other_port && port != "0" && (one == other || is_any(&one) || is_any(&other))
}

/// One input for every address; several antennas may share one.
fn inputs(loaded: &Loaded) -> Result<Vec<Input>, UsageError> {
    let mut inputs: Vec<Input> = Vec::new();
    let approximate_time = loaded.approximate_time();
    let mut add = |observer: Observer, name: &str, stream: Option<&String>, options: LogOptions| {
        let Some(stream) = stream else {
            let expected = "`stream` says where its bytes come from, such as tcp://HOST:PORT";
            return Err(UsageError(format!("{name}: no `stream`; {expected}")));
        };
        let address: Address =
            stream.parse().map_err(|error| UsageError(format!("{name}: stream {error}")))?;
        if address.is_bus() {
            let expected = "a bus has lines, an antenna bytes";
            return Err(UsageError(format!("{name}: stream \"{address}\": {expected}")));
        }
        let address = address.with_path(|path| loaded.path(&path));
        let antenna = (observer, name.to_owned(), options);
        match inputs.iter_mut().find(|input| input.address == address) {
            Some(input) => input.antennas.push(antenna),
            None => inputs.push(Input { address, antennas: vec![antenna], lines: None }),
        }
        Ok(())
    };
    let options = LogOptions { approximate_time, as_received: true, ..LogOptions::default() };
    for (number, a) in loaded.config.antenna.iter().enumerate() {
        let (protocol, station, antenna) = (a.protocol, a.station_id, a.antenna_id);
        let options = LogOptions { protocol, station, antenna, ..options };
        add(Observer::Antenna(number), &a.name, a.stream.as_ref(), options)?;
    }
    if let Some(s) = &loaded.config.station {
        let (protocol, station, antenna) = (s.protocol, s.station_id, s.antenna_id);
        let options = LogOptions { protocol, station, antenna, ..options };
        add(Observer::Station, "station", s.stream.as_ref(), options)?;
    }
    inputs.extend(companions::inputs(loaded)?);
    Ok(inputs)
}

/// Navigation data of the files that the configuration names.
pub(crate) fn navigation_files(loaded: &Loaded) -> anyhow::Result<NavigationData> {
    let mut data = NavigationData::default();
    for file in &loaded.config.nav.files {
        let mut source = Source::open(loaded.path(file))?;
        kurs_formats::navigation::read_near(&mut source, loaded.approximate_time(), &mut data)?;
    }
    Ok(data)
}

/// A page shows satellites by signal, which the engine reports only if it is wanted.
fn make_engine(loaded: &Loaded, has_page: bool) -> anyhow::Result<MakeEngine> {
    let mut damage = Vec::new();
    let phase_centers = phase_centers::read(loaded, &mut damage)?;
    phase_centers.tell();
    let settings = Settings { residuals: has_page, ..loaded.settings()? };
    let loaded = loaded.clone();
    Ok(Box::new(move |navigation| {
        let mounts = phase_centers.mounts.clone();
        solve::engine(&loaded, settings.clone(), navigation, mounts)
            .map_err(|error| format!("{error:#}"))
    }))
}

/// What `kurs solve` does to a row behind the engine.
fn finish() -> Finish {
    let mut copies = Copies::default();
    Box::new(move |epoch, row| {
        if copies.add(epoch) {
            solve::refuse_zero_baseline(row);
        }
    })
}

fn deadline(milliseconds: Option<f64>) -> Result<Deadline, UsageError> {
    match milliseconds {
        None => Ok(Deadline::HalfInterval),
        Some(ms) if (1.0..=60_000.0).contains(&ms) => Ok(Deadline::Seconds(ms * 1e-3)),
        Some(ms) => Err(UsageError(format!("live.deadline_ms is {ms}, expected 1 to 60000"))),
    }
}

/// One output; on the bus of ROS 2 one for every topic.
fn outputs(output: &OutputTable, body: &str, loaded: &Loaded) -> Result<Vec<Output>, UsageError> {
    let wrong = |what: String| UsageError(format!("output `{}`: {what}", output.to));
    let address: Address = output.to.parse().map_err(|error| wrong(format!("{error}")))?;
    if matches!(address, Address::Ntrip(_) | Address::File { .. }) {
        let expected = "expected serial://, tcp://, tcp-listen://, udp://, mqtt:// or zenoh://";
        return Err(wrong(expected.into()));
    }
    if let Some(rate_hz) = output.rate_hz
        && !(1e-3..=1000.0).contains(&rate_hz)
    {
        return Err(wrong(format!("rate_hz is {rate_hz}, expected 0.001 to 1000")));
    }
    if let (Address::Zenoh(place), OutputProfile::Of(Profile::Ros2)) = (&address, output.profile) {
        return on_the_bus_of_ros(output, place).map_err(wrong);
    }
    let leaves = Leaves { float: output.float, predicted: output.predicted };
    let (encode, partner, rate_hz) = match output.profile {
        OutputProfile::Csv => (messages::csv(leaves), Partner::default(), None),
        OutputProfile::Jsonl => (messages::json_lines(leaves, body), Partner::default(), None),
        // Other bodies have an encoder of their own.
        OutputProfile::Relative => {
            let nothing: Encode = Arc::new(|_, _, _| None);
            (nothing, Partner::default(), None)
        }
        OutputProfile::Of(profile)
            if (output.float || output.predicted) && !profile.takes_float() =>
        {
            let word = profile.word();
            return Err(wrong(format!(
                "profile `{word}` has fixed angles alone; `float` and `predicted` are for jsonl, csv and ros2, which say how \
                 certain each angle is"
            )));
        }
        OutputProfile::Of(profile) => {
            let refused = |what| wrong(format!("profile `{}`: {what}", profile.word()));
            let line = profile.line(&positions_m(loaded)).map_err(refused)?;
            let partner = profile.partner(address.baud());
            (profile.encode(line, output.float, output.predicted), partner, profile.rate_hz())
        }
    };
    Ok(vec![Output { address, rate_hz: output.rate_hz.or(rate_hz), encode, partner }])
}

/// The topics of ROS 2; the key of the address is the number of their domain.
fn on_the_bus_of_ros(output: &OutputTable, place: &Zenoh) -> Result<Vec<Output>, String> {
    let domain = place.key.parse().ok().filter(|domain| *domain <= MAX_DOMAIN);
    let domain = domain.ok_or_else(|| {
        format!(
            "profile `ros2`: the key {:?} is no ROS domain, expected 0 to {MAX_DOMAIN}",
            place.key
        )
    })?;
    let of_topic = |topic| {
        let publisher = Publisher { domain, topic };
        Output {
            address: Address::Zenoh(Zenoh { key: publisher.key(), ..place.clone() }),
            rate_hz: output.rate_hz,
            encode: kurs_live::on_the_bus_of_ros(topic, output.float, output.predicted),
            partner: Partner { publisher: Some(publisher), ..Partner::default() },
        }
    };
    Ok(TOPICS.map(of_topic).into())
}

/// Where the antennas are on the body; empty if that is not known.
pub(super) fn positions_m(loaded: &Loaded) -> Vec<Vector<Body>> {
    let positions = loaded.config.antenna.iter().map(|antenna| antenna.position_m);
    let known: Option<Vec<[f64; 3]>> = positions.collect();
    known.unwrap_or_default().into_iter().map(|[x, y, z]| Vector::new(x, y, z)).collect()
}

/// Logs read at full speed have no order of arrival: only an epoch of the same time serves.
fn station_max_age_s(loaded: &Loaded) -> Result<f64, UsageError> {
    let Some(station) = &loaded.config.station else { return Ok(0.0) };
    let max_age_s = station.max_age_s()?;
    let address = station.stream.as_ref().and_then(|stream| stream.parse::<Address>().ok());
    Ok(if address.is_some_and(|a| a.is_unpaced_file()) { 0.0 } else { max_age_s })
}

/// The page of this body.
fn page(at: SocketAddr, token: Option<String>, loaded: &Loaded, body: &str) -> Page {
    let antennas = loaded.config.antenna.iter();
    Page {
        at,
        token,
        body: body.to_owned(),
        antennas: antennas.map(|antenna| (antenna.name.clone(), antenna.position_m)).collect(),
        encode: messages::page_line(body),
        encode_relative: messages::relative_line,
    }
}

/// Nobody beyond this machine may see the page without a token.
fn page_address(text: &str, has_token: bool) -> Result<SocketAddr, UsageError> {
    let address = text.parse::<SocketAddr>().map_err(|_| {
        UsageError(format!("live.page is {text:?}, expected an address: 127.0.0.1:PORT"))
    })?;
    if !address.ip().is_loopback() && !has_token {
        return Err(UsageError(format!(
            "live.page is {text:?}, which others reach: expected a loopback address, or `token_file`"
        )));
    }
    Ok(address)
}

/// The first line of the file, long enough not to be guessed.
fn token(path: &Path) -> Result<String, UsageError> {
    const MIN_LENGTH: usize = 16;
    let wrong = |what: String| UsageError(format!("live.token_file {}: {what}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    let line = text.lines().next().unwrap_or("").trim();
    if line.len() < MIN_LENGTH || !line.bytes().all(|byte| byte.is_ascii_graphic()) {
        let found = line.len();
        let text = format!("{found} characters, expected {MIN_LENGTH} or more, without spaces");
        return Err(wrong(text));
    }
    Ok(line.to_owned())
}

fn gga_of_place(geodetic: Geodetic, time: Option<GpsTime>) -> Option<String> {
    let mut row = EpochSolution::lost(time?, Reason::FewAntennas);
    row.position = Some(PositionEstimate {
        antenna: Some(0),
        geodetic,
        position_m: geodetic.to_ecef(),
        covariance_m2: Matrix3::zeros(),
        velocity_mps: None,
        clock_m: None,
        hdop: None,
        origin: PositionOrigin::Alone,
    });
    messages::gga(&row)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::antenna_names;
    use crate::solve::config::{Overrides, load};
    use std::path::PathBuf;

    /// Every table that a live configuration may have.
    const EVERYTHING: &str = r#"
[[antenna]]
name = "A0"
stream = "serial:///dev/ttyACM0?baud=460800"
position_m = [0.0, 0.0, 0.0]
[[antenna]]
name = "A1"
stream = "ntrip://me:secret@127.0.0.1:2101/MOUNT"
position_m = [1.2, 0.0, 0.0]
station_id = 7
[live]
body = "ferry"
deadline_ms = 50
page = "127.0.0.1:8080"
peer_max_age_s = 1.5
[station]
stream = "tcp-listen://:5017"
position_ecef_m = [3500000.0, 800000.0, 5200000.0]
max_age_s = 10
[imu]
stream = "udp://:5018"
columns = "time_s,gx_degps,gy_degps,gz_degps"
interval_s = 0.1
[antennas]
correlation_s = 2.0
[filter]
gate_sigmas = 4.0
[[output]]
to = "tcp-listen://127.0.0.1:2947"
profile = "marine"
rate_hz = 10
[[output]]
to = "tcp://127.0.0.1:2948"
profile = "relative"
[[peer]]
name = "barge"
from = "tcp://127.0.0.1:7400"
[log]
dir = "logs"
"#;

    /// A state that is a week old must not put streams without a week into the last one.
    #[test]
    fn an_old_state_does_not_tell_the_week() {
        let clock = GpsTime::from_week_tow(2447, 300_000.0).unwrap();
        for (age_s, is_used) in
            [(60.0, true), (2.0 * 86_400.0, true), (604_800.0, false), (-30.0 * 86_400.0, true)]
        {
            assert_eq!(is_of_these_days(clock + -age_s, clock), is_used, "{age_s} s");
        }
    }

    #[test]
    fn a_port_has_one_key() {
        for (one, other, is_one) in [
            ("127.0.0.1:80", "127.0.0.1:80", true),
            ("localhost:80", "127.0.0.1:80", true),
            ("0.0.0.0:80", "192.168.1.2:80", true),
            ("[::]:80", "[::1]:80", true),
            ("127.0.0.1:80", "127.0.0.1:81", false),
            ("127.0.0.1:80", "192.168.1.2:80", false),
            ("127.0.0.1:0", "127.0.0.1:0", false),
        ] {
            assert_eq!(listen_at_one(one, other), is_one, "{one} {other}");
        }
    }

    fn outcome(folder: &Path, text: &str) -> Result<(), String> {
        let file: PathBuf = folder.join("live.toml");
        std::fs::write(&file, text).unwrap();
        let overrides = Overrides { is_live: true, ..Overrides::default() };
        let loaded = load(Some(&file), &overrides).map_err(|error| error.to_string())?;
        let summary = Arc::new(Mutex::new(Summary::new(antenna_names(&loaded))));
        let tables = DayTables::new(folder, &loaded);
        let made = setup(&loaded, tables, summary, false).map_err(|error| format!("{error:#}"))?;
        assert!(made.inputs.len() >= 2 && made.antennas >= 2);
        Ok(())
    }

    /// Bytes changed, lines left out, doubled and swapped, values in place of others: a service or
    /// an error that has words.
    #[test]
    fn whatever_a_configuration_says_there_is_a_service_or_an_error_with_words() {
        const MUTATIONS: usize = 1000;
        const VALUES: [&str; 8] =
            ["-1", "1e999", "nan", "\"\"", "[]", "{}", "\"tcp://h:1\"", "9223372036854775807"];
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(outcome(folder.path(), EVERYTHING), Ok(()));
        // Knuth's multiplier: any sequence will do.
        let mut state = 1u64;
        let mut next = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            usize::try_from(state >> 33).unwrap() % below
        };
        let mut refused = 0;
        for _ in 0..MUTATIONS {
            let mut lines: Vec<String> = EVERYTHING.lines().map(str::to_owned).collect();
            for _ in 0..=next(2) {
                let (line, other) = (next(lines.len()), next(lines.len()));
                match next(5) {
                    0 => {
                        lines.remove(line);
                    }
                    1 => lines.insert(other, lines[line].clone()),
                    2 => lines.swap(line, other),
                    3 => {
                        let value = VALUES[next(VALUES.len())];
                        if let Some((key, _)) = lines[line].split_once('=') {
                            lines[line] = format!("{key}= {value}");
                        }
                    }
                    _ => {
                        let mut bytes = lines[line].clone().into_bytes();
                        if !bytes.is_empty() {
                            let place = next(bytes.len());
                            bytes[place] = u8::try_from(32 + next(95)).unwrap();
                        }
                        lines[line] = String::from_utf8(bytes).unwrap();
                    }
                }
            }
            if let Err(error) = outcome(folder.path(), &lines.join("\n")) {
                refused += 1;
                assert!(error.split_whitespace().count() >= 3, "{error}");
            }
        }
        assert!((MUTATIONS / 10..MUTATIONS).contains(&refused), "{refused}");
    }
}
