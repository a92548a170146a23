//! The phase centres of the antennas whose type the configuration names.

use kurs::antenna_calibration::{AntennaCalibrations, MountedAntenna};
use kurs_formats::antex;
use kurs_formats::source::Source;

use super::config::{AntennaTable, Loaded};
use crate::failure::UsageError;
use crate::summary::Damage;

/// One entry an antenna, in the order of the configuration; what was damaged in the ANTEX files.
pub(super) fn read(
    loaded: &Loaded,
    damage: &mut Vec<Damage>,
) -> anyhow::Result<Vec<Option<MountedAntenna>>> {
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
    let mounts = loaded.config.antenna.iter().map(|antenna| mounted(antenna, &calibrations));
    Ok(mounts.collect::<Result<_, _>>()?)
}

fn mounted(
    antenna: &AntennaTable,
    calibrations: &AntennaCalibrations,
) -> Result<Option<MountedAntenna>, UsageError> {
    let Some(name) = &antenna.antenna_type else { return Ok(None) };
    let Some(calibration) = calibrations.find(name) else {
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
    let orientation_rad = antenna.antenna_orientation_deg.unwrap_or(0.0).to_radians();
    Ok(Some(MountedAntenna::new(calibration.clone(), orientation_rad)))
}
