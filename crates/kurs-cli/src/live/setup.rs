//! From the configuration to the parts of the service.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use kurs::ephemeris::NavigationData;
use kurs::frames::Geodetic;
use kurs::observation::matcher::Deadline;
use kurs::solution::{EpochSolution, PositionEstimate, PositionOrigin, Reason};
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::source::Source;
use kurs_live::{Address, Finish, Input, MakeEngine, Output, Reloaded, STATION, Setup};
use nalgebra::Matrix3;

use super::day_tables::DayTables;
use super::messages;
use crate::copies::Copies;
use crate::failure::UsageError;
use crate::solve::config::{Loaded, OutputTable};
use crate::solve::{self, phase_centers};
use crate::summary::Summary;

/// The service of a configuration.
pub(super) fn setup(
    loaded: &Loaded,
    mut tables: DayTables,
    summary: Arc<Mutex<Summary>>,
    once: bool,
) -> anyhow::Result<Setup> {
    let live = loaded.config.live.clone().unwrap_or_default();
    let state_dir = live.state_dir.as_ref().map(|directory| loaded.path(directory));
    let remembered = state_dir.as_deref().map(kurs_live::remembered).unwrap_or_default();
    let files = navigation_files(loaded)?;
    let newest = kurs_live::newest_reference_time(&files);
    let mut navigation = remembered.navigation;
    navigation.update(&files);
    let newest = newest.or_else(|| kurs_live::newest_reference_time(&navigation));

    let token = live.token_file.as_ref().map(|file| token(&loaded.path(file))).transpose()?;
    let body = live.body.unwrap_or_else(|| "body".to_owned());
    let outputs = loaded.config.output.iter().map(|output| self::output(output, &body));
    Ok(Setup {
        inputs: inputs(loaded)?,
        antennas: loaded.config.antenna.len(),
        navigation,
        make_engine: make_engine(loaded)?,
        finish: finish(),
        deadline: deadline(live.deadline_ms)?,
        station_max_age_s: station_max_age_s(loaded)?,
        common_clock: live.common_clock,
        known_time: newest.or(remembered.time),
        write_row: Box::new(move |row| {
            let mut summary = summary.lock().unwrap_or_else(PoisonError::into_inner);
            summary.add(row, row.shared_satellites >= 4);
            drop(summary);
            tables.write(row).map_err(|error| format!("{error:#}"))
        }),
        outputs: outputs.collect::<Result<_, _>>()?,
        gga: Box::new(messages::gga),
        first_gga: remembered.place.and_then(|place| gga_of_place(place, remembered.time)),
        page: live.page.as_deref().map(|text| page(text, token.is_some())).transpose()?,
        token,
        state_dir,
        log_dir: loaded.config.log.as_ref().map(|log| loaded.path(&log.dir)),
        once,
    })
}

/// What a configuration that was read again changes.
pub(super) fn reloaded(loaded: &Loaded) -> anyhow::Result<Reloaded> {
    Ok(Reloaded {
        inputs: inputs(loaded)?,
        antennas: loaded.config.antenna.len(),
        make_engine: make_engine(loaded)?,
    })
}

/// One input for every address; several antennas may share one.
fn inputs(loaded: &Loaded) -> Result<Vec<Input>, UsageError> {
    let mut inputs: Vec<Input> = Vec::new();
    let approximate_time = loaded.approximate_time();
    let mut add = |number: usize, name: &str, stream: Option<&String>, options: LogOptions| {
        let Some(stream) = stream else {
            let expected = "`stream` says where its bytes come from, such as tcp://HOST:PORT";
            return Err(UsageError(format!("{name}: no `stream`; {expected}")));
        };
        let address: Address =
            stream.parse().map_err(|error| UsageError(format!("{name}: stream {error}")))?;
        let address = address.with_path(|path| loaded.path(&path));
        let antenna = (number, name.to_owned(), options);
        match inputs.iter_mut().find(|input| input.address == address) {
            Some(input) => input.antennas.push(antenna),
            None => inputs.push(Input { address, antennas: vec![antenna] }),
        }
        Ok(())
    };
    let options = LogOptions { approximate_time, as_received: true, ..LogOptions::default() };
    for (number, a) in loaded.config.antenna.iter().enumerate() {
        let (protocol, station, antenna) = (a.protocol, a.station_id, a.antenna_id);
        let options = LogOptions { protocol, station, antenna, ..options };
        add(number, &a.name, a.stream.as_ref(), options)?;
    }
    if let Some(s) = &loaded.config.station {
        let (protocol, station, antenna) = (s.protocol, s.station_id, s.antenna_id);
        let options = LogOptions { protocol, station, antenna, ..options };
        add(STATION, "station", s.stream.as_ref(), options)?;
    }
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

fn make_engine(loaded: &Loaded) -> anyhow::Result<MakeEngine> {
    let mut damage = Vec::new();
    let phase_centers = phase_centers::read(loaded, &mut damage)?;
    phase_centers.tell();
    let (loaded, settings) = (loaded.clone(), loaded.settings()?);
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

fn output(output: &OutputTable, body: &str) -> Result<Output, UsageError> {
    let wrong = |what: String| UsageError(format!("output `{}`: {what}", output.to));
    let address: Address = output.to.parse().map_err(|error| wrong(format!("{error}")))?;
    if matches!(address, Address::Ntrip(_) | Address::File { .. }) {
        return Err(wrong("expected serial://, tcp://, tcp-listen:// or udp://".into()));
    }
    if let Some(rate_hz) = output.rate_hz
        && !(1e-3..=1000.0).contains(&rate_hz)
    {
        return Err(wrong(format!("rate_hz is {rate_hz}, expected 0.001 to 1000")));
    }
    let encode = messages::encoder(output, body);
    Ok(Output { address, rate_hz: output.rate_hz, encode })
}

/// Logs that are read as fast as possible have no order of arrival: only an epoch of the same time serves.
fn station_max_age_s(loaded: &Loaded) -> Result<f64, UsageError> {
    let Some(station) = &loaded.config.station else { return Ok(0.0) };
    let max_age_s = station.max_age_s()?;
    let address = station.stream.as_ref().and_then(|stream| stream.parse::<Address>().ok());
    Ok(if address.is_some_and(|a| a.is_unpaced_file()) { 0.0 } else { max_age_s })
}

/// Nobody beyond this machine may see the page without a token.
fn page(text: &str, has_token: bool) -> Result<SocketAddr, UsageError> {
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
