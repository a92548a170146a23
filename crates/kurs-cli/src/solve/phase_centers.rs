//! The phase centres of the antennas whose type the configuration names.

use kurs::antenna_calibration::{AntennaCalibrations, MountedAntenna};
use kurs_formats::antex;
use kurs_formats::source::Source;

use super::config::{AntennaTable, Loaded};
use crate::failure::UsageError;
use crate::summary::Damage;

/// The calibrated antennas.
#[derive(Debug, Default)]
pub(crate) struct PhaseCenters {
    /// One entry an antenna, in the order of the configuration.
    pub(crate) mounts: Vec<Option<MountedAntenna>>,
    /// Which calibration and bands serve, in words.
    notes: Vec<String>,
}

impl PhaseCenters {
    /// Tells on the terminal which calibrations serve.
    pub(crate) fn tell(&self) {
        self.notes.iter().for_each(|note| eprintln!("note: {note}"));
    }
}

/// Finds the calibrations; what was damaged in the ANTEX files is added to `damage`.
pub(crate) fn read(loaded: &Loaded, damage: &mut Vec<Damage>) -> anyhow::Result<PhaseCenters> {
    let mut calibrations = AntennaCalibrations::default();
    for file in &loaded.config.antex.files {
        let path = loaded.path(file);
        let (found, log) = antex::read(&mut Source::open(&path)?)?;
        for (name, calibration) in found.iter() {
            calibrations.insert(&name, calibration.clone());
        }
        let entries = log.listed().iter();
        damage.extend(entries.map(|d| Damage::new(path.display().to_string(), d)));
    }
    let mut found = PhaseCenters::default();
    for antenna in &loaded.config.antenna {
        found.mounts.push(mounted(antenna, &calibrations, &mut found.notes)?);
    }
    Ok(found)
}

fn mounted(
    antenna: &AntennaTable,
    calibrations: &AntennaCalibrations,
    notes: &mut Vec<String>,
) -> Result<Option<MountedAntenna>, UsageError> {
    let Some(name) = &antenna.antenna_type else { return Ok(None) };
    let Some((known, calibration)) = calibrations.find_named(name) else {
        let likeness = |known: &str| {
            let without_radome = known.split_ascii_whitespace().next().unwrap_or_default();
            strsim::jaro(name, known).max(strsim::jaro(name, without_radome))
        };
        let nearest = calibrations
            .iter()
            .map(|(known, _)| (likeness(&known), known))
            .filter(|(likeness, _)| *likeness > 0.7)
            .max_by(|(a, _), (b, _)| a.total_cmp(b));
        let hint =
            nearest.map_or_else(String::new, |(_, known)| format!(", the nearest is {known:?}"));
        return Err(UsageError(format!(
            "antenna `{}`: `antenna_type` {name:?} is not in the ANTEX files{hint}",
            antenna.name
        )));
    };
    let bands: Vec<String> = calibration.bands().map(|band| band.to_string()).collect();
    if bands.is_empty() {
        return Err(UsageError(format!(
            "antenna `{}`: `antenna_type` {known:?} has no usable band in the ANTEX files",
            antenna.name
        )));
    }
    notes.push(format!(
        "antenna {}: calibration of {known:?}, bands {}; other bands take the nearest in frequency",
        antenna.name,
        bands.join(" ")
    ));
    let orientation_rad = antenna.antenna_orientation_deg.unwrap_or(0.0).to_radians();
    Ok(Some(MountedAntenna::new(calibration.clone(), orientation_rad)))
}
