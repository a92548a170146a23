//! What the scenario does to signals: outages, interference, slips and biases, with their names
//! looked up.

use kurs::ephemeris::Ephemeris;
use kurs::signal::{Band, Satellite, Signal, System};

use crate::receivable::{Receivable, present};
use crate::scenario::{BeiDouOrbit, Bias, Interference, Outage, Scenario, Slip};
use crate::scenario_error::ScenarioError;

/// Semi-major axes above this are geosynchronous, √m.
const GEOSYNCHRONOUS_SQRT_AXIS: f64 = 6_400.0;

/// Everything that goes wrong, ready to be asked.
#[derive(Debug, Clone, Default)]
pub(crate) struct Disturbances {
    outages: Vec<(Outage, Vec<Satellite>, Vec<Band>)>,
    interference: Vec<(Interference, Vec<Band>)>,
    slips: Vec<(Slip, Satellite, Band)>,
    biases: Vec<SelectedBias>,
}

/// A bias with the names of what it belongs to looked up; empty and `None` select all.
#[derive(Debug, Clone)]
struct SelectedBias {
    plan: Bias,
    satellites: Vec<Satellite>,
    system: Option<System>,
    signal: Option<Signal>,
}

impl Disturbances {
    /// # Errors
    ///
    /// [`ScenarioError`] for a name of nothing that is received, and for keys that contradict each
    /// other: nothing in a scenario is without effect.
    pub(crate) fn new(
        scenario: &Scenario,
        receivable: &Receivable<'_>,
    ) -> Result<Self, ScenarioError> {
        let bands = |key: &str, names: &[String]| {
            names.iter().map(|name| receivable.band(key, name)).collect::<Result<Vec<_>, _>>()
        };
        let mut found = Self::default();
        for outage in &scenario.outage {
            for name in &outage.antennas {
                receivable.antenna("outage.antennas", name)?;
            }
            let satellites = outage.satellites.iter();
            let satellites = satellites.map(|name| receivable.satellite("outage.satellites", name));
            let satellites = satellites.collect::<Result<_, _>>()?;
            let bands = bands("outage.bands", &outage.bands)?;
            found.outages.push((outage.clone(), satellites, bands));
        }
        for interference in &scenario.interference {
            let bands = bands("interference.bands", &interference.bands)?;
            found.interference.push((interference.clone(), bands));
        }
        for slip in &scenario.slip {
            let signals = receivable.antenna("slip.antenna", &slip.antenna)?;
            let satellite = receivable.satellite("slip.satellite", &slip.satellite)?;
            let band: Band = receivable.band("slip.band", &slip.band)?;
            let is_tracked =
                band.system == satellite.system && signals.iter().any(|s| s.band == band);
            let wanted = format!("a band that {} tracks of {satellite}", slip.antenna);
            present(is_tracked, "slip.band", &slip.band, &wanted)?;
            found.slips.push((slip.clone(), satellite, band));
        }
        for name in scenario.canopy.iter().flat_map(|canopy| &canopy.antennas) {
            receivable.antenna("canopy.antennas", name)?;
        }
        for bias in &scenario.bias {
            found.biases.push(SelectedBias::new(bias, receivable)?);
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
        let chosen = self.biases.iter().filter(|bias| bias.is_of(antenna, signal, ephemeris));
        chosen.fold((0.0, 0.0), |(code_m, phase_cycles), SelectedBias { plan, .. }| {
            (
                code_m + plan.code_m + plan.code_m_per_channel * channel,
                phase_cycles + plan.phase_cycles + plan.phase_cycles_per_channel * channel,
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

impl SelectedBias {
    /// # Errors
    ///
    /// [`ScenarioError`] for names of nothing that is received, or that contradict each other or what
    /// belongs to one system only.
    fn new(bias: &Bias, receivable: &Receivable<'_>) -> Result<Self, ScenarioError> {
        if !bias.antenna.is_empty() {
            receivable.antenna("bias.antenna", &bias.antenna)?;
        }
        let satellites = bias.satellites.iter();
        let satellites = satellites.map(|name| receivable.satellite("bias.satellites", name));
        let satellites: Vec<Satellite> = satellites.collect::<Result<_, _>>()?;
        let signal = bias.signal.as_ref().map(|name| receivable.signal("bias.signal", name));
        let signal = signal.transpose()?;
        let system = bias.system.as_ref().map(|name| receivable.system("bias.system", name));
        let system = system.transpose()?;
        let of = |only: System| {
            system.is_none_or(|system| system == only)
                && signal.is_none_or(|signal| signal.band.system == only)
        };
        if let (Some(system), Some(name)) = (system, &bias.signal) {
            let wanted = format!("a signal of bias.system {}", system.letter());
            present(of(system), "bias.signal", name, &wanted)?;
        }
        for (satellite, name) in satellites.iter().zip(&bias.satellites) {
            let wanted = "a satellite of the same system as bias.system and bias.signal";
            present(of(satellite.system), "bias.satellites", name, wanted)?;
        }
        if let Some(orbit) = bias.orbit {
            let wanted = "none with another system than C";
            present(of(System::BeiDou), "bias.orbit", &format!("{orbit:?}"), wanted)?;
        }
        for (key, value) in [
            ("bias.code_m_per_channel", bias.code_m_per_channel),
            ("bias.phase_cycles_per_channel", bias.phase_cycles_per_channel),
        ] {
            let is_possible = value == 0.0 || of(System::Glonass);
            present(is_possible, key, &value.to_string(), "0 with another system than R")?;
        }
        Ok(Self { plan: bias.clone(), satellites, system, signal })
    }

    fn is_of(&self, antenna: &str, signal: Signal, ephemeris: &Ephemeris) -> bool {
        let Self { plan, satellites, system, signal: only } = self;
        (plan.antenna.is_empty() || plan.antenna == antenna)
            && (satellites.is_empty() || satellites.contains(&ephemeris.satellite()))
            && system.is_none_or(|system| system == signal.band.system)
            && only.is_none_or(|only| only == signal)
            && plan.orbit.is_none_or(|orbit| beidou_orbit(ephemeris) == Some(orbit))
    }
}
