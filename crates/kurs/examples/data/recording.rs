//! Two recorded epochs of two antennas and the orbits of their satellites, from the tables in this folder.
#![allow(dead_code)] // every user needs a part

use std::error::Error;
use std::str::FromStr;

use kurs::ephemeris::{Ephemeris, KeplerElements, KeplerEphemeris, Message};
use kurs::observation::{AntennaEpoch, ArrayEpoch, Lock, Observation};
use kurs::signal::{Satellite, System};
use kurs::{GpsTime, NavigationData};

/// The GPS week of the recording.
pub(crate) const WEEK: i32 = 2320;
/// The known distance of the two antennas, m.
pub(crate) const LENGTH_M: f64 = 0.99;

const ORBITS: &str = include_str!("orbits.csv");
const OBSERVATIONS: &str = include_str!("observations.csv");

/// The elements of every orbit.
///
/// # Errors
///
/// A field that is not what it should be.
pub(crate) fn orbits() -> Result<Vec<KeplerElements>, Box<dyn Error>> {
    ORBITS.lines().skip(1).map(orbit).collect()
}

/// All orbits, as an engine takes them.
///
/// # Errors
///
/// Elements that no orbit has.
pub(crate) fn navigation(orbits: &[KeplerElements]) -> Result<NavigationData, Box<dyn Error>> {
    let mut navigation = NavigationData::default();
    for elements in orbits {
        let orbit = KeplerEphemeris::new(*elements)?;
        navigation.ephemerides.insert(Ephemeris::Kepler(orbit));
    }
    Ok(navigation)
}

/// The epochs in the order of time.
///
/// # Errors
///
/// A field that is not what it should be.
pub(crate) fn epochs() -> Result<Vec<ArrayEpoch>, Box<dyn Error>> {
    let mut epochs: Vec<ArrayEpoch> = Vec::new();
    for line in OBSERVATIONS.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let time = at(fields[0])?;
        if epochs.last().is_none_or(|last| last.time != time) {
            epochs.push(ArrayEpoch { time, antennas: vec![None, None], station: None });
        }
        let antenna: usize = fields[1].parse()?;
        let begun = epochs.last_mut().and_then(|last| last.antennas.get_mut(antenna));
        let of_antenna = begun.ok_or("more than two antennas")?;
        let observed =
            of_antenna.get_or_insert_with(|| AntennaEpoch { time, ..AntennaEpoch::default() });
        observed.observations.push(Observation {
            satellite: fields[2].parse()?,
            signal: fields[3].parse()?,
            pseudorange_m: Some(fields[4].parse()?),
            phase_cycles: Some(fields[5].parse()?),
            doppler_hz: Some(fields[6].parse()?),
            cn0_dbhz: Some(fields[7].parse()?),
            lock: Lock::default(),
        });
    }
    Ok(epochs)
}

/// One line of `orbits.csv`.
fn orbit(line: &str) -> Result<KeplerElements, Box<dyn Error>> {
    let fields: Vec<&str> = line.split(',').collect();
    let satellite: Satellite = fields[0].parse()?;
    let number = |column: usize| f64::from_str(fields[column]);
    let message = match satellite.system {
        System::Galileo => Message::GalileoInav,
        _ => Message::Lnav,
    };
    Ok(KeplerElements {
        satellite,
        message,
        reference_time: at(fields[2])?,
        clock_reference_time: at(fields[3])?,
        transmission_time: at(fields[4])?,
        issue: fields[5].parse()?,
        clock_bias_s: number(6)?,
        clock_drift: number(7)?,
        clock_drift_rate: number(8)?,
        sqrt_axis: number(9)?,
        eccentricity: number(10)?,
        mean_anomaly_rad: number(11)?,
        mean_motion_correction_radps: number(12)?,
        perigee_rad: number(13)?,
        node_rad: number(14)?,
        node_rate_radps: number(15)?,
        inclination_rad: number(16)?,
        inclination_rate_radps: number(17)?,
        latitude_harmonics_rad: [number(18)?, number(19)?],
        radius_harmonics_m: [number(20)?, number(21)?],
        inclination_harmonics_rad: [number(22)?, number(23)?],
        group_delays_s: [number(24)?, number(25)?],
        health: fields[26].parse()?,
        accuracy_m: number(27)?,
        fit_interval_s: None,
    })
}

/// A second of the recording's week.
fn at(tow_s: &str) -> Result<GpsTime, Box<dyn Error>> {
    Ok(GpsTime::from_week_tow(WEEK, tow_s.parse()?).ok_or("a second outside the week")?)
}
