//! An ANTEX file: antenna types and their calibrated bands.

use kurs_formats::source::{ReadError, Source};
use serde::Serialize;

use super::DamageReport;

/// What is in an ANTEX file.
#[derive(Debug, Serialize)]
pub(super) struct AntennaReport {
    pub(super) file: String,
    pub(super) types: Vec<AntennaType>,
    pub(super) damage: DamageReport,
}

/// One type of antenna.
#[derive(Debug, Serialize)]
pub(super) struct AntennaType {
    /// With its radome.
    pub(super) name: String,
    pub(super) bands: Vec<Center>,
}

/// A calibrated band.
#[derive(Debug, Serialize)]
pub(super) struct Center {
    pub(super) band: String,
    /// Phase centre from the reference point: north, east, up, m.
    pub(super) offset_m: [f64; 3],
}

/// Reads the file.
pub(super) fn inspect(source: &mut Source) -> Result<AntennaReport, ReadError> {
    let file = source.name().to_owned();
    let (antennas, damage) = kurs_formats::antex::read(source)?;
    let types = antennas.iter().map(|(name, calibration)| AntennaType {
        name,
        bands: calibration
            .bands()
            .filter_map(|band| {
                let offset_m = calibration.phase_center(band)?.offset_m();
                Some(Center { band: band.to_string(), offset_m })
            })
            .collect(),
    });
    Ok(AntennaReport {
        file,
        types: types.collect(),
        damage: DamageReport::new(damage.listed(), damage.total()),
    })
}
