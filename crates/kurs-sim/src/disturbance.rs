//! What the scenario does to signals: outages, interference, slips and biases, with their names
//! looked up.

use kurs::ephemeris::Ephemeris;
use kurs::signal::{Band, Satellite, Signal, System};

use crate::scenario::{BeiDouOrbit, Bias, Interference, Outage, Scenario, Slip};
use crate::simulation::ScenarioError;

/// Semi-major axes above this are geosynchronous, √m.
const GEOSYNCHRONOUS_SQRT_AXIS: f64 = 6_400.0;

/// Everything that goes wrong, ready to be asked.
#[derive(Debug, Clone, Default)]
pub(crate) struct Disturbances {
    outages: Vec<(Outage, Vec<Satellite>, Vec<Band>)>,
    interference: Vec<(Interference, Vec<Band>)>,
    slips: Vec<(Slip, Satellite, Band)>,
    biases: Vec<(Bias, Option<System>, Option<Signal>)>,
}

impl Disturbances {
    pub(crate) fn new(scenario: &Scenario, antennas: &[&str]) -> Result<Self, ScenarioError> {
        let known = |key: &str, name: &String| {
            let is_known = name.is_empty() || antennas.contains(&name.as_str());
            let all = || antennas.join(", ");
            let wrong = || ScenarioError::new(key, format!("{name:?} is none of {}", all()));
            is_known.then_some(()).ok_or_else(wrong)
        };
        let mut found = Self::default();
        for outage in &scenario.outage {
            outage.antennas.iter().try_for_each(|name| known("outage.antennas", name))?;
            let satellites = parse_all("outage.satellites", &outage.satellites)?;
            let bands = parse_all("outage.bands", &outage.bands)?;
            found.outages.push((outage.clone(), satellites, bands));
        }
        for interference in &scenario.interference {
            let bands = parse_all("interference.bands", &interference.bands)?;
            found.interference.push((interference.clone(), bands));
        }
        for slip in &scenario.slip {
            known("slip.antenna", &slip.antenna)?;
            let satellite = parse("slip.satellite", &slip.satellite)?;
            found.slips.push((slip.clone(), satellite, parse("slip.band", &slip.band)?));
        }
        for bias in &scenario.bias {
            known("bias.antenna", &bias.antenna)?;
            let system =
                bias.system.as_ref().map(|name| system("bias.system", name)).transpose()?;
            let signal = bias.signal.as_ref().map(|name| parse("bias.signal", name)).transpose()?;
            found.biases.push((bias.clone(), system, signal));
        }
        Ok(found)
    }

    /// Whether an outage hides the signal.
    pub(crate) fn hidden(
        &self,
        time_s: f64,
        antenna: &str,
        satellite: Satellite,
        band: Band,
    ) -> bool {
        self.outages.iter().any(|(outage, satellites, bands)| {
            (outage.from_s..outage.to_s).contains(&time_s)
                && (outage.antennas.is_empty() || outage.antennas.iter().any(|a| a == antenna))
                && (satellites.is_empty() || satellites.contains(&satellite))
                && (bands.is_empty() || bands.contains(&band))
        })
    }

    /// How many dB-Hz the signal is weaker.
    pub(crate) fn cn0_drop_db(&self, time_s: f64, band: Band) -> f64 {
        let drop = |(interference, bands): &(Interference, Vec<Band>)| {
            let on = (interference.from_s..interference.to_s).contains(&time_s)
                && (bands.is_empty() || bands.contains(&band));
            if on { interference.cn0_drop_db } else { 0.0 }
        };
        self.interference.iter().map(drop).sum()
    }

    /// Cycles slipped in the last `interval_s`, and whether the receiver says so.
    pub(crate) fn slip(
        &self,
        time_s: f64,
        interval_s: f64,
        antenna: &str,
        satellite: Satellite,
        band: Band,
    ) -> Option<(i64, bool)> {
        let mut now = self.slips.iter().filter(|(slip, slipping, slipped)| {
            let since_s = time_s - slip.time_s;
            (0.0..interval_s).contains(&since_s)
                && slip.antenna == antenna
                && (*slipping, *slipped) == (satellite, band)
        });
        now.next().map(|(slip, ..)| (i64::from(slip.cycles), slip.flagged))
    }

    /// Constant offsets of pseudorange (m) and phase (cycles).
    pub(crate) fn bias(&self, antenna: &str, signal: Signal, ephemeris: &Ephemeris) -> (f64, f64) {
        let channel = match ephemeris {
            Ephemeris::Glonass(glonass) => f64::from(glonass.elements().channel),
            Ephemeris::Kepler(_) => 0.0,
        };
        let chosen = self.biases.iter().filter(|(bias, system, only)| {
            (bias.antenna.is_empty() || bias.antenna == antenna)
                && system.is_none_or(|system| system == signal.band.system)
                && only.is_none_or(|only| only == signal)
                && bias.orbit.is_none_or(|orbit| beidou_orbit(ephemeris) == Some(orbit))
        });
        chosen.fold((0.0, 0.0), |(code_m, phase_cycles), (bias, ..)| {
            (
                code_m + bias.code_m + bias.code_m_per_channel * channel,
                phase_cycles + bias.phase_cycles + bias.phase_cycles_per_channel * channel,
            )
        })
    }
}

fn beidou_orbit(ephemeris: &Ephemeris) -> Option<BeiDouOrbit> {
    match ephemeris {
        Ephemeris::Kepler(kepler) if kepler.elements().satellite.system == System::BeiDou => {
            let elements = kepler.elements();
            Some(if elements.satellite.is_beidou_geo() {
                BeiDouOrbit::Geo
            } else if elements.sqrt_axis > GEOSYNCHRONOUS_SQRT_AXIS {
                BeiDouOrbit::Igso
            } else {
                BeiDouOrbit::Meo
            })
        }
        _ => None,
    }
}

pub(crate) fn parse<T: core::str::FromStr<Err: core::fmt::Display>>(
    key: &str,
    text: &str,
) -> Result<T, ScenarioError> {
    text.parse().map_err(|error: T::Err| ScenarioError::new(key, error.to_string()))
}

fn parse_all<T: core::str::FromStr<Err: core::fmt::Display>>(
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
    letter.ok_or_else(|| {
        ScenarioError::new(key, format!("{name:?} is not the letter of a system (G, R, E, C, J)"))
    })
}
