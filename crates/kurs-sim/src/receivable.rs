//! What there is to receive: the satellites of the sky and the signals that each antenna tracks of
//! them. Names in a scenario are looked up here, so that none is without effect.

use core::fmt;
use core::str::FromStr;

use kurs::signal::{Band, Satellite, Signal, System};

use crate::scenario::Scenario;
use crate::scenario_error::ScenarioError;

/// See the module.
#[derive(Debug)]
pub(crate) struct Receivable<'a> {
    satellites: &'a [Satellite],
    antennas: Vec<(&'a str, Vec<Signal>)>,
}

impl<'a> Receivable<'a> {
    /// # Errors
    ///
    /// [`ScenarioError`] if an antenna tracks no signal of the sky's systems.
    pub(crate) fn new(
        scenario: &'a Scenario,
        satellites: &'a [Satellite],
    ) -> Result<Self, ScenarioError> {
        let of_bodies = scenario.body.iter().flat_map(|body| &body.antenna);
        let of_bodies = of_bodies.map(|a| ("body.antenna.signals", &a.name, a.signals.as_ref()));
        let station = scenario.station.iter();
        let station = station.map(|s| ("station.signals", &s.name, s.signals.as_ref()));
        let mut antennas = Vec::new();
        for (key, name, own) in of_bodies.chain(station) {
            let (key, names) = own.map_or(("signals", &scenario.signals), |own| (key, own));
            let mut signals: Vec<Signal> = parse_all(key, names)?;
            signals.retain(|s| satellites.iter().any(|sat| sat.system == s.band.system));
            if signals.is_empty() {
                let problem = format!("{names:?}, expected a signal of a system in the sky");
                return Err(ScenarioError::new(key, problem));
            }
            antennas.push((name.as_str(), signals));
        }
        Ok(Self { satellites, antennas })
    }

    /// The signals of an antenna.
    pub(crate) fn antenna(&self, key: &str, name: &str) -> Result<&[Signal], ScenarioError> {
        let found = self.antennas.iter().find(|(known, _)| *known == name);
        found.map(|(_, signals)| signals.as_slice()).ok_or_else(|| {
            let known: Vec<&str> = self.antennas.iter().map(|(name, _)| *name).collect();
            ScenarioError::new(key, format!("{name:?}, expected one of {}", known.join(", ")))
        })
    }

    /// A satellite of the sky.
    pub(crate) fn satellite(&self, key: &str, name: &str) -> Result<Satellite, ScenarioError> {
        let satellite = parse(key, name)?;
        let is_there = self.satellites.contains(&satellite);
        present(is_there, key, name, "a satellite of the sky").map(|()| satellite)
    }

    /// A system of the sky.
    pub(crate) fn system(&self, key: &str, name: &str) -> Result<System, ScenarioError> {
        let system = system(key, name)?;
        let is_there = self.satellites.iter().any(|satellite| satellite.system == system);
        present(is_there, key, name, "a system of the sky").map(|()| system)
    }

    /// A band that some antenna tracks.
    pub(crate) fn band(&self, key: &str, name: &str) -> Result<Band, ScenarioError> {
        let band = parse(key, name)?;
        let mut signals = self.antennas.iter().flat_map(|(_, signals)| signals);
        let is_there = signals.any(|signal| signal.band == band);
        present(is_there, key, name, "a band that an antenna tracks").map(|()| band)
    }

    /// A signal that some antenna tracks.
    pub(crate) fn signal(&self, key: &str, name: &str) -> Result<Signal, ScenarioError> {
        let signal = parse(key, name)?;
        let is_there = self.antennas.iter().any(|(_, signals)| signals.contains(&signal));
        present(is_there, key, name, "a signal that an antenna tracks").map(|()| signal)
    }
}

/// Refuses a name that is well written, and of nothing that is there.
pub(crate) fn present(
    is_there: bool,
    key: &str,
    name: &str,
    wanted: &str,
) -> Result<(), ScenarioError> {
    let wrong = || ScenarioError::new(key, format!("{name:?}, expected {wanted}"));
    is_there.then_some(()).ok_or_else(wrong)
}

pub(crate) fn parse<T: FromStr<Err: fmt::Display>>(
    key: &str,
    text: &str,
) -> Result<T, ScenarioError> {
    text.parse().map_err(|error: T::Err| ScenarioError::new(key, error.to_string()))
}

pub(crate) fn parse_all<T: FromStr<Err: fmt::Display>>(
    key: &str,
    texts: &[String],
) -> Result<Vec<T>, ScenarioError> {
    texts.iter().map(|text| parse(key, text)).collect()
}

/// A system by its letter.
pub(crate) fn system(key: &str, name: &str) -> Result<System, ScenarioError> {
    let letter = match name.as_bytes() {
        [letter] => System::from_letter(*letter),
        _ => None,
    };
    let wrong = || ScenarioError::new(key, format!("{name:?}, expected one of G, R, E, C, J"));
    letter.ok_or_else(wrong)
}
