//! What stands beside the antennas in a configuration: the inertial sensor, and other bodies.

use std::sync::Arc;

use kurs_live::{Address, Imu, Input, Lines, Output, PeerSetup, ReadSamples, RelativeSettings};

use super::messages;
use super::sensor_lines::SensorLines;
use crate::failure::UsageError;
use crate::fuse::antennas::config::{self, FilterConfig};
use crate::fuse::imu::{ImuConfig, Mounted};
use crate::solve::config::Loaded;

/// Greatest age of another body's attitude, s, unless more is asked for.
const PEER_MAX_AGE_S: f64 = 1.0;

/// The sensor and the other bodies as inputs.
pub(super) fn inputs(loaded: &Loaded) -> Result<Vec<Input>, UsageError> {
    let of_lines = |address, lines| Input { address, antennas: Vec::new(), lines: Some(lines) };
    let mut inputs = Vec::new();
    if let Some(imu) = &loaded.config.imu {
        inputs.push(of_lines(imu_address(loaded, imu)?, Lines::Imu));
    }
    let peers = &loaded.config.peer;
    for (number, peer) in peers.iter().enumerate() {
        if peer.name.is_empty() || peers[..number].iter().any(|other| other.name == peer.name) {
            let name = &peer.name;
            return Err(UsageError(format!("peer `{name}`: the name is empty or used twice")));
        }
        let address = address_of_lines(loaded, &format!("peer `{}`: from", peer.name), &peer.from)?;
        inputs.push(of_lines(address, Lines::Peer(number, peer.name.clone())));
    }
    Ok(inputs)
}

/// Where lines of text come from, by the value of a key: anything but a caster.
fn address_of_lines(loaded: &Loaded, key: &str, stream: &str) -> Result<Address, UsageError> {
    match stream.parse().map_err(|error| UsageError(format!("{key} {error}")))? {
        Address::Ntrip(_) => {
            let expected =
                "expected serial://, tcp://, tcp-listen://, udp://, mqtt://, zenoh:// or file://";
            Err(UsageError(format!("{key}: {expected}")))
        }
        address => Ok(address.with_path(|path| loaded.path(&path))),
    }
}

fn imu_address(loaded: &Loaded, imu: &ImuConfig) -> Result<Address, UsageError> {
    match (&imu.stream, &imu.log) {
        (Some(stream), None) => address_of_lines(loaded, "imu.stream", stream),
        (None, Some(log)) => Ok(Address::File { path: loaded.path(log), speed: 0.0 }),
        (found, _) => {
            let found = if found.is_some() { "both" } else { "none" };
            let text = format!("imu: {found} of `stream` and `log` found, expected one");
            Err(UsageError(text))
        }
    }
}

/// The inertial sensor, if there is one.
pub(super) fn imu(loaded: &Loaded) -> anyhow::Result<Option<Imu>> {
    let Some(imu) = &loaded.config.imu else { return Ok(None) };
    let antennas = loaded.config.antennas.clone().unwrap_or_default();
    let filter = loaded.config.filter.clone().unwrap_or_default();
    let filter = FilterConfig {
        gate_sigmas: filter.gate_sigmas,
        order_window_s: filter.order_window_s,
        first_angle_sd_deg: filter.first_angle_sd_deg,
        smooth: false,
    };
    imu.check_values()?;
    config::check(&antennas, &filter, ("imu.interval_s", imu.interval_s))?;
    let mounted = Mounted::new(&loaded.path("".as_ref()), imu)?;
    let session = config::session(&antennas, imu, &filter, mounted.has_gyro_bias());
    let columns = imu.columns.clone();
    let lines = move || SensorLines::new(mounted.clone(), columns.as_deref());
    lines().map_err(|what| UsageError(format!("imu.columns: {what}")))?;
    let read: ReadSamples = Arc::new(move || match lines() {
        Ok(lines) => Box::new(lines),
        Err(what) => unreachable!("read before: {what}"),
    });
    Ok(Some(Imu { session, interval_s: imu.interval_s, read }))
}

/// The other bodies, if there are any; `outputs` are for them.
pub(super) fn peers(
    loaded: &Loaded,
    body: &str,
    outputs: Vec<Output>,
) -> Result<Option<PeerSetup>, UsageError> {
    let live = loaded.config.live.clone().unwrap_or_default();
    let max_age_s = live.peer_max_age_s.unwrap_or(PEER_MAX_AGE_S);
    if !(0.01..=60.0).contains(&max_age_s) {
        let text = format!("live.peer_max_age_s is {max_age_s}, expected 0.01 to 60");
        return Err(UsageError(text));
    }
    if loaded.config.peer.is_empty() {
        return match outputs.first() {
            None => Ok(None),
            Some(_) => Err(UsageError("output: profile \"relative\" needs a [[peer]]".into())),
        };
    }
    let solve = &loaded.config.solve;
    Ok(Some(PeerSetup {
        body: body.to_owned(),
        names: loaded.config.peer.iter().map(|peer| peer.name.clone()).collect(),
        max_age_s,
        settings: RelativeSettings {
            unseen_sd_rad: solve.roll_sd_deg.to_radians(),
            max_angle_sd_rad: solve.max_angle_sd_deg.to_radians(),
        },
        encode: Box::new(messages::relative_line),
        outputs,
    }))
}
