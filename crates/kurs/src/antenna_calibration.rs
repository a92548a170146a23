//! Phase centres of receiver antennas: where the electrical point is, by band and direction.
//!
//! What an antenna measures refers to a point that lies apart from its reference point (ARP, the
//! bottom of its mount) and moves by millimetres with the direction of the signal. Antennas of one
//! type share it, and it cancels between them where they point the same way; unlike antennas need
//! this table.
//!
//! Source and signs: M. Rothacher, R. Schmid, "ANTEX: The Antenna Exchange Format 1.4", 2010.

use std::collections::BTreeMap;

use crate::frames::{Body, Vector};
use crate::signal::Band;

/// Values of a pattern that are admitted, m.
const MAX_M: f64 = 10.0;

/// The phase centre of one antenna in one band.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseCenter {
    offset_m: [f64; 3],
    zenith: Axis,
    /// Variations by zenith angle alone.
    mean_m: Vec<f64>,
    azimuth: Option<Axis>,
    /// Variations by azimuth (rows) and zenith angle (columns); empty without `azimuth`.
    table_m: Vec<f64>,
}

/// Equidistant angles, degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// First angle.
    pub first_deg: f64,
    /// Last angle.
    pub last_deg: f64,
    /// Distance of two angles.
    pub step_deg: f64,
}

/// The numbers do not make a phase centre.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadCalibration {
    /// The angles do not ascend in equal steps, or are too many.
    #[error("angles from {first_deg} to {last_deg} in steps of {step_deg}")]
    Angles {
        /// First angle.
        first_deg: f64,
        /// Last angle.
        last_deg: f64,
        /// Step.
        step_deg: f64,
    },
    /// A pattern is not as long as its angles say.
    #[error("{found} values in a pattern of {expected}")]
    Length {
        /// Number of values found.
        found: usize,
        /// Number of values expected.
        expected: usize,
    },
    /// Not a number, or no length that an antenna can have.
    #[error("{value_m} m is no phase centre offset or variation")]
    Value {
        /// What was found.
        value_m: f64,
    },
}

impl Axis {
    /// How many angles there are: 2 to 1000.
    ///
    /// # Errors
    ///
    /// [`BadCalibration::Angles`].
    pub fn count(&self) -> Result<usize, BadCalibration> {
        let Self { first_deg, last_deg, step_deg } = *self;
        let steps = (last_deg - first_deg) / step_deg;
        let sane = step_deg > 0.0 && (0.5..999.5).contains(&steps) && first_deg.abs() <= 360.0;
        if !sane || (steps - steps.round()).abs() > 1e-6 {
            return Err(BadCalibration::Angles { first_deg, last_deg, step_deg });
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // at most 999
        let steps = steps.round() as usize;
        Ok(steps + 1)
    }

    /// Index of the angle below and the share of the one above it; the ends hold beyond the axis.
    fn place(&self, angle_deg: f64, count: usize) -> (usize, f64) {
        let steps = ((angle_deg - self.first_deg) / self.step_deg).clamp(0.0, (count - 1) as f64);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // clamped
        let below = (steps as usize).min(count - 2);
        (below, steps - below as f64)
    }
}

impl PhaseCenter {
    /// From the offset of the mean phase centre from the ARP (north, east, up in the antenna's own
    /// axes) and the variations: by zenith angle, and where measured by azimuth (first to last angle
    /// is a full turn) and zenith angle, azimuth by azimuth.
    ///
    /// # Errors
    ///
    /// [`BadCalibration`] if lengths, angles or values do not fit.
    pub fn new(
        offset_m: [f64; 3],
        zenith: Axis,
        mean_m: Vec<f64>,
        azimuth: Option<(Axis, Vec<f64>)>,
    ) -> Result<Self, BadCalibration> {
        let columns = zenith.count()?;
        let (azimuth, table_m) =
            azimuth.map_or((None, Vec::new()), |(axis, table)| (Some(axis), table));
        let rows = azimuth.map_or(Ok(0), |axis| axis.count())?;
        for (found, expected) in [(mean_m.len(), columns), (table_m.len(), rows * columns)] {
            if found != expected {
                return Err(BadCalibration::Length { found, expected });
            }
        }
        let mut values = offset_m.iter().chain(&mean_m).chain(&table_m);
        match values.find(|value| !(-MAX_M..=MAX_M).contains(*value)) {
            Some(value) => Err(BadCalibration::Value { value_m: *value }),
            None => Ok(Self { offset_m, zenith, mean_m, azimuth, table_m }),
        }
    }

    /// Offset of the mean phase centre from the ARP: north, east, up in the antenna's own axes.
    #[must_use]
    pub const fn offset_m(&self) -> [f64; 3] {
        self.offset_m
    }

    /// How much longer the range is than one measured to the ARP, in metres: **subtract it from a
    /// pseudorange or from a phase in metres**. The angles are in the antenna's own axes: azimuth
    /// clockwise from its north mark, elevation above its plane.
    #[must_use]
    pub fn correction_m(&self, azimuth_rad: f64, elevation_rad: f64) -> f64 {
        let (sin_elevation, cos_elevation) = elevation_rad.sin_cos();
        let (sin_azimuth, cos_azimuth) = azimuth_rad.sin_cos();
        // −PCO · e + PCV
        let [north, east, up] = self.offset_m;
        let along = (north * cos_azimuth + east * sin_azimuth) * cos_elevation + up * sin_elevation;
        self.variation_m(azimuth_rad, elevation_rad) - along
    }

    /// [`PhaseCenter::correction_m`] where nobody knows how the antenna is turned about its vertical
    /// axis: the horizontal offset and the dependence on the azimuth are left out.
    #[must_use]
    pub fn mean_correction_m(&self, elevation_rad: f64) -> f64 {
        self.mean_variation_m(elevation_rad) - self.offset_m[2] * elevation_rad.sin()
    }

    fn mean_variation_m(&self, elevation_rad: f64) -> f64 {
        let (column, share) =
            self.zenith.place(90.0 - elevation_rad.to_degrees(), self.mean_m.len());
        self.mean_m[column] + share * (self.mean_m[column + 1] - self.mean_m[column])
    }

    /// The variation alone, interpolated in both angles.
    fn variation_m(&self, azimuth_rad: f64, elevation_rad: f64) -> f64 {
        let Some(azimuth) = self.azimuth else { return self.mean_variation_m(elevation_rad) };
        let columns = self.mean_m.len();
        let (column, share) = self.zenith.place(90.0 - elevation_rad.to_degrees(), columns);
        let row =
            |pattern: &[f64]| pattern[column] + share * (pattern[column + 1] - pattern[column]);
        let turned_deg = (azimuth_rad.to_degrees() - azimuth.first_deg).rem_euclid(360.0);
        let rows = self.table_m.len() / columns;
        let (below, share) = azimuth.place(azimuth.first_deg + turned_deg, rows);
        let at = |index: usize| row(&self.table_m[index * columns..(index + 1) * columns]);
        at(below) + share * (at(below + 1) - at(below))
    }
}

/// The phase centres of one antenna, by band.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AntennaCalibration {
    bands: BTreeMap<Band, PhaseCenter>,
}

impl AntennaCalibration {
    /// Adds or replaces a band.
    pub fn insert(&mut self, band: Band, center: PhaseCenter) {
        self.bands.insert(band, center);
    }

    /// The phase centre of a band.
    #[must_use]
    pub fn phase_center(&self, band: Band) -> Option<&PhaseCenter> {
        self.bands.get(&band)
    }

    /// The phase centre of a band, else that of the calibrated band with the nearest frequency: many
    /// calibrations know GPS and GLONASS only, whose bands lie beside those of the other systems.
    #[must_use]
    pub fn nearest_phase_center(&self, band: Band) -> Option<&PhaseCenter> {
        let frequency_hz = |band: Band| band.frequency_hz(Some(0));
        let apart_hz = |known: Band| {
            frequency_hz(known)
                .zip(frequency_hz(band))
                .map_or(f64::INFINITY, |(known, wanted)| (known - wanted).abs())
        };
        self.bands.get(&band).or_else(|| {
            let nearest =
                self.bands.iter().min_by(|(a, _), (b, _)| apart_hz(**a).total_cmp(&apart_hz(**b)));
            nearest.map(|(_, center)| center)
        })
    }

    /// [`PhaseCenter::correction_m`] of a band; `None` if the band was not calibrated.
    #[must_use]
    pub fn correction_m(&self, band: Band, azimuth_rad: f64, elevation_rad: f64) -> Option<f64> {
        Some(self.bands.get(&band)?.correction_m(azimuth_rad, elevation_rad))
    }

    /// The calibrated bands in their order.
    pub fn bands(&self) -> impl Iterator<Item = Band> {
        self.bands.keys().copied()
    }
}

/// An antenna on a body, its plane level with the body's.
#[derive(Debug, Clone, PartialEq)]
pub struct MountedAntenna {
    calibration: AntennaCalibration,
    orientation_rad: f64,
}

impl MountedAntenna {
    /// `orientation_rad`: how far the antenna's north mark is turned from the body's forward axis,
    /// clockwise seen from above.
    #[must_use]
    pub const fn new(calibration: AntennaCalibration, orientation_rad: f64) -> Self {
        Self { calibration, orientation_rad }
    }

    /// How much longer a range of `band` is than one to the antenna's reference point (m), for a
    /// line of sight (unit vector) in the axes of the body.
    #[must_use]
    pub fn correction_m(&self, band: Band, line_of_sight: Vector<Body>) -> f64 {
        let [forward, right, down]: [f64; 3] = line_of_sight.xyz().into();
        let azimuth_rad = right.atan2(forward) - self.orientation_rad;
        let elevation_rad = (-down).atan2(forward.hypot(right));
        let center = self.calibration.nearest_phase_center(band);
        center.map_or(0.0, |center| center.correction_m(azimuth_rad, elevation_rad))
    }

    /// The correction while the attitude is not known: that of a level body with any heading.
    #[must_use]
    pub fn level_correction_m(&self, band: Band, elevation_rad: f64) -> f64 {
        let center = self.calibration.nearest_phase_center(band);
        center.map_or(0.0, |center| center.mean_correction_m(elevation_rad))
    }
}

/// Calibrations of many antenna types, by IGS name: `"TRM59800.00     SCIS"` (type and radome).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AntennaCalibrations {
    types: BTreeMap<(String, String), AntennaCalibration>,
}

impl AntennaCalibrations {
    /// Adds or replaces an antenna type.
    pub fn insert(&mut self, name: &str, calibration: AntennaCalibration) {
        self.types.insert(type_and_radome(name), calibration);
    }

    /// The calibration of a type: with its radome, else that of the same antenna without one, as
    /// the IGS does.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<&AntennaCalibration> {
        self.find_named(name).map(|(_, calibration)| calibration)
    }

    /// [`AntennaCalibrations::find`], with the name of the calibration that serves.
    #[must_use]
    pub fn find_named(&self, name: &str) -> Option<(String, &AntennaCalibration)> {
        let (antenna, radome) = type_and_radome(name);
        let with_radome = self.types.get_key_value(&(antenna.clone(), radome));
        let found =
            with_radome.or_else(|| self.types.get_key_value(&(antenna, NO_RADOME.to_owned())));
        found.map(|(key, calibration)| (igs_name(key), calibration))
    }

    /// Whether there is this type with just this radome.
    #[must_use]
    pub fn contains(&self, name: &str) -> bool {
        self.types.contains_key(&type_and_radome(name))
    }

    /// Every type with its radome, in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (String, &AntennaCalibration)> {
        self.types.iter().map(|(key, calibration)| (igs_name(key), calibration))
    }

    /// Number of antenna types.
    #[must_use]
    pub fn len(&self) -> usize {
        self.types.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.types.is_empty()
    }
}

const NO_RADOME: &str = "NONE";

fn igs_name((antenna, radome): &(String, String)) -> String {
    format!("{antenna:<16}{radome}")
}

fn type_and_radome(name: &str) -> (String, String) {
    let mut words = name.split_ascii_whitespace();
    let antenna = words.next().unwrap_or_default().to_ascii_uppercase();
    (antenna, words.next().unwrap_or(NO_RADOME).to_ascii_uppercase())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::System;

    const ZENITH: Axis = Axis { first_deg: 0.0, last_deg: 90.0, step_deg: 30.0 };
    const AZIMUTH: Axis = Axis { first_deg: 0.0, last_deg: 360.0, step_deg: 90.0 };

    fn center() -> PhaseCenter {
        let table: Vec<f64> = [0.0, 1.0, 2.0, 3.0, 0.0]
            .into_iter()
            .flat_map(|row| [0.0, 0.001, 0.002, 0.003].map(|column| column + row * 0.010))
            .collect();
        let mean = vec![0.0, 0.001, 0.002, 0.003];
        PhaseCenter::new([0.001, -0.002, 0.060], ZENITH, mean, Some((AZIMUTH, table))).unwrap()
    }

    #[test]
    fn by_hand() {
        let at = |azimuth: f64, elevation: f64| {
            center().correction_m(azimuth.to_radians(), elevation.to_radians())
        };
        // Zenith: the whole height, no variation.
        assert!((at(0.0, 90.0) - -0.060).abs() < 1e-15);
        // East at 30°: −(−0.002 cos 30° + 0.060 sin 30°) + 0.002 + 0.010.
        let expected = 0.002 * 30f64.to_radians().cos() - 0.030 + 0.012;
        assert!((at(90.0, 30.0) - expected).abs() < 1e-15);
        // Half-way between east and south, and between two zenith angles.
        let variation = center().variation_m(135f64.to_radians(), 45f64.to_radians());
        assert!((variation - (0.0015 + 0.015)).abs() < 1e-15, "{variation}");
        // West to north turns through the end of the table.
        let variation = center().variation_m((-45f64).to_radians(), 60f64.to_radians());
        assert!((variation - (0.001 + 0.015)).abs() < 1e-15, "{variation}");
        // Below the horizon the last zenith angle holds.
        let variation = center().variation_m(0.0, -0.2);
        assert_eq!(variation, 0.003);
    }

    #[test]
    fn without_azimuth_only_the_offset_turns() {
        let center = PhaseCenter::new([0.0; 3], ZENITH, vec![0.0, 0.003, 0.0, 0.0], None).unwrap();
        assert_eq!(
            center.correction_m(1.0, 75f64.to_radians()),
            center.correction_m(4.0, 75f64.to_radians())
        );
        assert!((center.correction_m(1.0, 75f64.to_radians()) - 0.0015).abs() < 1e-15);
    }

    #[test]
    fn unlike_antennas_differ_by_the_offsets() {
        let at_height =
            |up: f64| PhaseCenter::new([0.0, 0.0, up], ZENITH, vec![0.0; 4], None).unwrap();
        let band = Band::new(System::Gps, 1);
        let mut first = AntennaCalibration::default();
        first.insert(band, at_height(0.090));
        let mut second = AntennaCalibration::default();
        second.insert(band, at_height(0.050));
        for elevation_deg in [10.0f64, 30.0, 80.0] {
            let elevation = elevation_deg.to_radians();
            let difference = second.correction_m(band, 0.3, elevation).unwrap()
                - first.correction_m(band, 0.3, elevation).unwrap();
            assert!((difference - 0.040 * elevation.sin()).abs() < 1e-15);
        }
        assert_eq!(first.correction_m(Band::new(System::Gps, 5), 0.0, 1.0), None);
        assert_eq!(first.bands().collect::<Vec<_>>(), [band]);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let new = |zenith, mean: Vec<f64>| PhaseCenter::new([0.0; 3], zenith, mean, None);
        assert!(matches!(new(ZENITH, vec![0.0; 3]), Err(BadCalibration::Length { .. })));
        assert!(matches!(new(ZENITH, vec![f64::NAN; 4]), Err(BadCalibration::Value { .. })));
        for step_deg in [0.0, -5.0, f64::NAN, 1e-9, 7.0, 1e9] {
            let axis = Axis { step_deg, ..ZENITH };
            assert!(matches!(new(axis, vec![0.0; 4]), Err(BadCalibration::Angles { .. })));
        }
    }

    /// An antenna with its north mark to the right of the body: what comes from the right comes from
    /// its north, what comes from behind from its east.
    #[test]
    fn a_mounted_antenna_turns_with_the_body() {
        let north_east_up = PhaseCenter::new([0.010, 0.003, 0.060], ZENITH, vec![0.0; 4], None);
        let mut calibration = AntennaCalibration::default();
        let band = Band::new(System::Gps, 1);
        calibration.insert(band, north_east_up.unwrap());
        let mounted = MountedAntenna::new(calibration, 90f64.to_radians());
        let at = |x, y, z| mounted.correction_m(band, Vector::new(x, y, z));
        assert!((at(0.0, 1.0, 0.0) - -0.010).abs() < 1e-15);
        assert!((at(-1.0, 0.0, 0.0) - -0.003).abs() < 1e-15);
        assert!((at(0.0, 0.0, -1.0) - -0.060).abs() < 1e-15);
        assert!((mounted.level_correction_m(band, 30f64.to_radians()) - -0.030).abs() < 1e-15);
        // E1 has the frequency of G1; a band far away takes what there is.
        let e1 = Band::new(System::Galileo, 1);
        assert_eq!(mounted.correction_m(e1, Vector::new(0.0, 0.0, -1.0)), at(0.0, 0.0, -1.0));
    }

    #[test]
    fn an_unknown_radome_is_none() {
        let mut all = AntennaCalibrations::default();
        let mut bare = AntennaCalibration::default();
        bare.insert(Band::new(System::Gps, 1), center());
        all.insert("TRM59800.00     NONE", bare.clone());
        all.insert("TRM59800.00     SCIS", AntennaCalibration::default());
        assert_eq!(all.find("TRM59800.00     SCIT"), Some(&bare));
        assert_eq!(all.find("trm59800.00"), Some(&bare));
        assert_eq!(all.find("TRM59800.00 SCIS"), Some(&AntennaCalibration::default()));
        assert_eq!(all.find("LEIAR25"), None);
        let named = all.find_named("TRM59800.00 SCIT").map(|(name, _)| name);
        assert_eq!(named.as_deref(), Some("TRM59800.00     NONE"));
        assert!(all.contains("TRM59800.00 SCIS") && !all.contains("TRM59800.00 SCIT"));
        assert_eq!((all.len(), all.is_empty()), (2, false));
    }
}
