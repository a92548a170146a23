//! What the metadata of a segment say, and what its data mean by them: the same for KVN and XML.

use std::collections::BTreeMap;

use kurs::signal::SPEED_OF_LIGHT_MPS;

use super::epoch::TimeSystem;
use super::{Observable, TdmError, TrackingData, TrackingRecord};

/// Metadata keywords that change nothing here; indexed ones without their index.
const METADATA_READ_PAST: [&str; 27] = [
    "TRACK_ID",
    "DATA_TYPES",
    "START_TIME",
    "STOP_TIME",
    "EPHEMERIS_NAME",
    "TRANSMIT_BAND",
    "RECEIVE_BAND",
    "TURNAROUND_NUMERATOR",
    "TURNAROUND_DENOMINATOR",
    "TIMETAG_REF",
    "INTEGRATION_INTERVAL",
    "INTEGRATION_REF",
    "FREQ_OFFSET",
    "RANGE_MODE",
    "REFERENCE_FRAME",
    "INTERPOLATION",
    "INTERPOLATION_DEGREE",
    "DOPPLER_COUNT_BIAS",
    "DOPPLER_COUNT_SCALE",
    "DOPPLER_COUNT_ROLLOVER",
    "TRANSMIT_DELAY",
    "RECEIVE_DELAY",
    "DATA_QUALITY",
    "CORRECTION_DOPPLER",
    "CORRECTION_MAG",
    "CORRECTION_RCS",
    "CORRECTION_RECEIVE",
];
const CORRECTIONS_READ_PAST: [&str; 3] =
    ["CORRECTION_TRANSMIT", "CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL"];

/// Data keywords without a use here; indexed ones without their index.
const DATA_READ_PAST: [&str; 25] = [
    "CARRIER_POWER",
    "CLOCK_BIAS",
    "CLOCK_DRIFT",
    "DOPPLER_COUNT",
    "DOPPLER_INSTANTANEOUS",
    "DOPPLER_INTEGRATED",
    "DOR",
    "MAG",
    "PC_N0",
    "PR_N0",
    "PRESSURE",
    "RCS",
    "RECEIVE_FREQ",
    "RECEIVE_PHASE_CT",
    "RHUMIDITY",
    "STEC",
    "TEMPERATURE",
    "TRANSMIT_FREQ",
    "TRANSMIT_FREQ_RATE",
    "TRANSMIT_PHASE_CT",
    "TROPO_DRY",
    "TROPO_WET",
    "VLBI_DELAY",
    "RECEIVE_POWER",
    "TRANSMIT_POWER",
];

/// No range is longer, out and back to a geostationary satellite (83 400 km) included: a modulus
/// from here on leaves no doubt.
const MAX_RANGE_M: f64 = 1e8;

/// Participants in the order of the signal, by index.
type Path = Vec<u32>;

/// The metadata of one segment.
#[derive(Debug, Default)]
pub(super) struct Metadata {
    time_system: Option<TimeSystem>,
    participants: BTreeMap<u32, String>,
    single_difference: bool,
    path: Path,
    path_1: Path,
    path_2: Path,
    angle_type: Option<String>,
    range_units: RangeUnits,
    range_modulus: f64,
    /// Corrections of angle 1, angle 2 and range, in the units of the file.
    corrections: [f64; 3],
    corrections_applied: Option<bool>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq)]
enum RangeUnits {
    #[default]
    Kilometres,
    Seconds,
    Undefined,
}

impl Metadata {
    /// Takes one keyword of the metadata.
    pub(super) fn set(&mut self, keyword: &str, value: &str, line: usize) -> Result<(), TdmError> {
        let error = |what: String| TdmError::new(line, keyword, what);
        let one_of = |expected: &str| error(format!("`{value}` found, expected {expected}"));
        let number = || {
            let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| one_of("a number"))
        };
        match keyword {
            "TIME_SYSTEM" => {
                let system =
                    TimeSystem::named(value).ok_or_else(|| one_of("UTC, GPS, TAI or TT"))?;
                self.time_system = Some(system);
            }
            "MODE" => {
                self.single_difference = match value {
                    "SEQUENTIAL" => false,
                    "SINGLE_DIFF" => true,
                    _ => return Err(one_of("SEQUENTIAL or SINGLE_DIFF")),
                };
            }
            "PATH" => self.path = path(value).ok_or_else(|| one_of("indices such as 1,2,1"))?,
            "PATH_1" => self.path_1 = path(value).ok_or_else(|| one_of("indices such as 2,1"))?,
            "PATH_2" => self.path_2 = path(value).ok_or_else(|| one_of("indices such as 2,3"))?,
            "ANGLE_TYPE" => self.angle_type = Some(value.to_owned()),
            "RANGE_UNITS" => {
                self.range_units = match value {
                    "km" => RangeUnits::Kilometres,
                    "s" => RangeUnits::Seconds,
                    "RU" => RangeUnits::Undefined,
                    _ => return Err(one_of("km, s or RU")),
                };
            }
            "RANGE_MODULUS" => self.range_modulus = number()?,
            "CORRECTION_ANGLE_1" => self.corrections[0] = number()?,
            "CORRECTION_ANGLE_2" => self.corrections[1] = number()?,
            "CORRECTION_RANGE" => self.corrections[2] = number()?,
            "CORRECTIONS_APPLIED" => {
                self.corrections_applied = match value {
                    "YES" => Some(true),
                    "NO" => Some(false),
                    _ => return Err(one_of("YES or NO")),
                };
            }
            _ if keyword.starts_with("PARTICIPANT_") => {
                let index = keyword["PARTICIPANT_".len()..].parse().ok();
                let index = index.ok_or_else(|| error("the index is not a number".to_owned()))?;
                if self.participants.insert(index, value.to_owned()).is_some() {
                    return Err(error("given twice in one segment".to_owned()));
                }
            }
            _ => {
                let bare = without_index(keyword);
                if !METADATA_READ_PAST.contains(&bare) && !CORRECTIONS_READ_PAST.contains(&bare) {
                    return Err(error("not a metadata keyword of this standard".to_owned()));
                }
            }
        }
        Ok(())
    }

    /// Takes one data record: its meaning goes to `data`.
    pub(super) fn record(
        &self,
        keyword: &str,
        time_tag: &str,
        value: &str,
        line: usize,
        data: &mut TrackingData,
    ) -> Result<(), TdmError> {
        let error = |what: String| TdmError::new(line, keyword, what);
        let system = self.time_system.ok_or_else(|| {
            TdmError::new(line, "TIME_SYSTEM", "missing in the metadata of this segment")
        })?;
        let time = system
            .instant(time_tag)
            .ok_or_else(|| error(format!("`{time_tag}` found, expected a date and time")))?;
        if !matches!(keyword, "ANGLE_1" | "ANGLE_2" | "RANGE") {
            if !DATA_READ_PAST.contains(&without_index(keyword)) {
                return Err(error("not a data keyword of this standard".to_owned()));
            }
            *data.read_past.entry(keyword.to_owned()).or_default() += 1;
            return Ok(());
        }
        let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
        let number = number.ok_or_else(|| error(format!("`{value}` found, expected a number")))?;

        let (observable, path) = self.observable(keyword, line)?;
        let [object, station] = self.ends(path, line)?;
        let reference = match observable {
            Observable::RangeDifference => Some(self.ends(&self.path_1, line)?[1].clone()),
            _ => None,
        };
        let value = self.in_si_units(keyword, number, line)?;
        data.records.push(TrackingRecord {
            time,
            station: station.clone(),
            reference,
            object: object.clone(),
            observable,
            value,
            line,
        });
        Ok(())
    }

    fn observable(&self, keyword: &str, line: usize) -> Result<(Observable, &Path), TdmError> {
        if keyword == "RANGE" && self.single_difference {
            // 3.3.2.5.4: the value of PATH_2 minus that of PATH_1
            return Ok((Observable::RangeDifference, &self.path_2));
        }
        if self.path.len() < 2 {
            return Err(TdmError::new(line, "PATH", "missing in the metadata of this segment"));
        }
        if keyword != "RANGE" {
            return match self.angle_type.as_deref() {
                Some("AZEL") if keyword == "ANGLE_1" => Ok((Observable::Azimuth, &self.path)),
                Some("AZEL") => Ok((Observable::Elevation, &self.path)),
                Some(other) => {
                    let what = format!("`{other}` found, only AZEL can be used");
                    Err(TdmError::new(line, "ANGLE_TYPE", what))
                }
                None => Err(TdmError::new(line, "ANGLE_TYPE", "missing in the metadata")),
            };
        }
        match self.path.as_slice() {
            [_, _] => Ok((Observable::OneWayRange, &self.path)),
            [first, _, last] if first == last => Ok((Observable::TwoWayRange, &self.path)),
            _ => {
                let what = "ranges over more than one station and one object cannot be used";
                Err(TdmError::new(line, "PATH", what))
            }
        }
    }

    /// Names of the last two participants of a path: the object and the station.
    fn ends(&self, path: &Path, line: usize) -> Result<[&String; 2], TdmError> {
        let keyword = if self.single_difference { "PATH_2" } else { "PATH" };
        let [.., object, station] = path.as_slice() else {
            return Err(TdmError::new(line, keyword, "missing in the metadata of this segment"));
        };
        let name = |index: &u32| {
            self.participants.get(index).ok_or_else(|| {
                TdmError::new(line, &format!("PARTICIPANT_{index}"), "named in a path but missing")
            })
        };
        Ok([name(object)?, name(station)?])
    }

    /// Degrees to radians; kilometres or seconds to metres; pending corrections added.
    fn in_si_units(&self, keyword: &str, number: f64, line: usize) -> Result<f64, TdmError> {
        let [angle_1, angle_2, range] = self.corrections;
        let correction = match keyword {
            "ANGLE_1" => angle_1,
            "ANGLE_2" => angle_2,
            _ => range,
        };
        let corrected = match self.corrections_applied {
            Some(false) => number + correction,
            None if correction != 0.0 => {
                let what = "missing, though a correction is given";
                return Err(TdmError::new(line, "CORRECTIONS_APPLIED", what));
            }
            _ => number,
        };
        if keyword != "RANGE" {
            return if (-180.0..360.0).contains(&number) {
                Ok(corrected.to_radians())
            } else {
                let what = format!("{number} found, expected degrees from -180 to below 360");
                Err(TdmError::new(line, keyword, what))
            };
        }
        let unit_m = match self.range_units {
            RangeUnits::Kilometres => 1e3,
            RangeUnits::Seconds => SPEED_OF_LIGHT_MPS,
            RangeUnits::Undefined => {
                let what = "RU found: range units have no length of their own";
                return Err(TdmError::new(line, "RANGE_UNITS", what));
            }
        };
        if self.range_modulus != 0.0 && self.range_modulus.abs() * unit_m < MAX_RANGE_M {
            let what = format!("{} found: ambiguous ranges cannot be used", self.range_modulus);
            return Err(TdmError::new(line, "RANGE_MODULUS", what));
        }
        Ok(corrected * unit_m)
    }
}

fn path(value: &str) -> Option<Path> {
    let path: Path =
        value.split(',').map(|index| index.trim().parse().ok()).collect::<Option<_>>()?;
    (path.len() >= 2).then_some(path)
}

/// `RECEIVE_FREQ_2` without its index; `DOPPLER_COUNT` as it is.
fn without_index(keyword: &str) -> &str {
    match keyword.rsplit_once('_') {
        Some((bare, "1" | "2" | "3" | "4" | "5")) => bare,
        _ => keyword,
    }
}
