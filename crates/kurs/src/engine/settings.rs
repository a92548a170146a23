//! What the engine is told once: the array, the bands, the constraint, the limits.

use crate::array::{AntennaArray, ArrayError, MAX_SEPARATION_M};
use crate::float_solution::recursive::Motion;
use crate::frames::{Body, Ecef, Vector};
use crate::observation::AntennaEpoch;
use crate::observation::interference::Spoofing;
use crate::signal::{Band, System};
use crate::sky::NoiseModel;

use super::direction::Direction;

/// No antenna is farther from the middle of the Earth: the geostationary orbit is half of it.
const MAX_PLACE_M: f64 = 1e8;

/// What is known of the geometry inside the integer search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Constraint {
    /// Nothing.
    None,
    /// The length of every baseline.
    Length,
    /// All baselines: the array turns as one.
    Array,
}

/// What of the carrier phases is carried from one epoch to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ambiguities {
    /// Nothing: each epoch stands alone.
    Instantaneous,
    /// Phases are not used at all.
    CodeOnly,
    /// The float ambiguities, constant between cycle slips; the baselines move in this way.
    Continuous(Motion),
}

/// How the engine works.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Number of antennas.
    pub antennas: usize,
    /// Their places on the body, if known.
    pub array: Option<AntennaArray>,
    /// Further points of the body that are wanted.
    pub points_m: Vec<Vector<Body>>,
    /// Bands to use; `None`: every band that two antennas share.
    pub bands: Option<Vec<Band>>,
    /// Satellites below are ignored.
    pub elevation_mask_rad: f64,
    /// What is carried from one epoch to the next.
    pub ambiguities: Ambiguities,
    /// In which order the epochs come.
    pub direction: Direction,
    /// Known geometry in the integer search.
    pub constraint: Constraint,
    /// Standard deviation of each coordinate of the known antenna positions, m.
    pub array_sd_m: f64,
    /// Share of wrong fixes among fixes that acceptance keeps.
    pub max_wrong_fix_rate: f64,
    /// A row whose receivers state spoofing is refused.
    pub use_interference_flags: bool,
    /// What the body cannot exceed in pitch or roll.
    pub max_tilt_rad: f64,
    /// For antennas on one line: how far the angle that they cannot see may be from zero (1 sigma).
    pub roll_sd_rad: f64,
    /// Angles less certain than this are left out.
    pub max_angle_sd_rad: f64,
    /// Observation noise.
    pub noise: NoiseModel,
    /// Whether rows carry the residuals of every signal, and the integers.
    pub residuals: bool,
    /// Where the first antenna stands, if it is a fixed station, m.
    pub first_antenna_m: Option<Vector<Ecef>>,
}

/// What `kurs solve` does when it is told nothing, with two antennas.
impl Default for Settings {
    fn default() -> Self {
        Self {
            antennas: 2,
            array: None,
            points_m: Vec::new(),
            bands: None,
            elevation_mask_rad: 10f64.to_radians(),
            ambiguities: Ambiguities::Instantaneous,
            direction: Direction::Forward,
            constraint: Constraint::None,
            array_sd_m: 0.002,
            max_wrong_fix_rate: 0.001,
            use_interference_flags: true,
            max_tilt_rad: core::f64::consts::FRAC_PI_2,
            roll_sd_rad: 5f64.to_radians(),
            max_angle_sd_rad: 5f64.to_radians(),
            noise: NoiseModel {
                code_zenith_m: 0.2,
                phase_zenith_m: 0.0015,
                full_cn0_dbhz: 45.0,
                channel_sd_m: 0.0,
            },
            residuals: false,
            first_antenna_m: None,
        }
    }
}

/// Settings that cannot work; afterwards configuration is no longer a reason to fail.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// Fewer than two antennas.
    #[error("{found} antenna, at least two are needed for an attitude")]
    FewAntennas {
        /// Number of antennas.
        found: usize,
    },
    /// The antenna positions do not make an array.
    #[error(transparent)]
    Array(#[from] ArrayError),
    /// As many positions as antennas are needed.
    #[error("{positions} positions for {antennas} antennas")]
    Positions {
        /// Positions given.
        positions: usize,
        /// Antennas given.
        antennas: usize,
    },
    /// A constraint needs the positions of the antennas.
    #[error("a constraint needs the position of every antenna")]
    ConstraintWithoutPositions,
    /// Each band counts once.
    #[error("bands: {0} is given twice")]
    RepeatedBand(Band),
    /// A number outside its range.
    #[error("{field} is {found}, expected {low} to {high}")]
    OutOfRange {
        /// The field of [`Settings`].
        field: &'static str,
        /// What was given.
        found: f64,
        /// The smallest value that makes sense.
        low: f64,
        /// The largest one.
        high: f64,
    },
}

impl Settings {
    /// Checks everything that can be checked before the first epoch.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] naming the first setting that cannot work.
    pub fn check(&self) -> Result<(), SettingsError> {
        if self.antennas < 2 {
            return Err(SettingsError::FewAntennas { found: self.antennas });
        }
        match &self.array {
            Some(array) if array.len() != self.antennas => {
                return Err(SettingsError::Positions {
                    positions: array.len(),
                    antennas: self.antennas,
                });
            }
            None if self.constraint != Constraint::None => {
                return Err(SettingsError::ConstraintWithoutPositions);
            }
            Some(array) => array.check_extent()?,
            None => {}
        }
        let bands = self.bands.as_deref().unwrap_or_default();
        if let Some(k) = (0..bands.len()).find(|k| bands[..*k].contains(&bands[*k])) {
            return Err(SettingsError::RepeatedBand(bands[k]));
        }
        let within = |field, found: f64, low: f64, high: f64| {
            let is_inside = (low..=high).contains(&found);
            let refused = SettingsError::OutOfRange { field, found, low, high };
            if is_inside { Ok(()) } else { Err(refused) }
        };
        let angle = |field, found_rad, low_deg: f64, high_deg: f64| {
            within(field, found_rad, low_deg.to_radians(), high_deg.to_radians())
        };
        angle("elevation_mask_rad", self.elevation_mask_rad, -5.0, 89.0)?;
        angle("max_tilt_rad", self.max_tilt_rad, 0.0, 180.0)?;
        angle("roll_sd_rad", self.roll_sd_rad, 0.0, 180.0)?;
        angle("max_angle_sd_rad", self.max_angle_sd_rad, 1e-3, 180.0)?;
        within("array_sd_m", self.array_sd_m, 0.0, 10.0)?;
        if let Ambiguities::Continuous(Motion::RandomWalk { m_per_sqrt_s }) = self.ambiguities {
            within("m_per_sqrt_s", m_per_sqrt_s, 1e-6, 1e3)?;
        }
        within("code_zenith_m", self.noise.code_zenith_m, 1e-6, 100.0)?;
        within("phase_zenith_m", self.noise.phase_zenith_m, 1e-6, 100.0)?;
        within("full_cn0_dbhz", self.noise.full_cn0_dbhz, 0.0, 100.0)?;
        within("channel_sd_m", self.noise.channel_sd_m, 0.0, 1.0)?;
        for point in &self.points_m {
            within("points_m", point.norm(), 0.0, MAX_SEPARATION_M)?;
        }
        if let Some(place) = self.first_antenna_m {
            within("first_antenna_m", place.norm(), 0.0, MAX_PLACE_M)?;
        }
        within("max_wrong_fix_rate", self.max_wrong_fix_rate, 1e-9, 0.5)
    }

    /// Whether what this receiver measures may be taken: unless it says itself that its signals are spoofed.
    #[must_use]
    pub fn trusts(&self, antenna: &AntennaEpoch) -> bool {
        !self.use_interference_flags || antenna.interference.spoofing != Spoofing::Stated
    }

    /// Whether satellites of this system are used at all; positions take all their bands.
    #[must_use]
    pub fn wants_system(&self, system: System) -> bool {
        self.bands.as_ref().is_none_or(|bands| bands.iter().any(|band| band.system == system))
    }

    /// Whether double differences of this band are formed.
    #[must_use]
    pub fn wants(&self, band: Band) -> bool {
        self.bands.as_ref().is_none_or(|bands| bands.contains(&band))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The field that is refused after a change of settings that work.
    fn refused(change: impl Fn(&mut Settings)) -> Option<&'static str> {
        let mut settings = Settings { antennas: 2, ..Settings::default() };
        settings.check().expect("two antennas with nothing known");
        change(&mut settings);
        match settings.check() {
            Ok(()) => None,
            Err(SettingsError::OutOfRange { field, .. }) => Some(field),
            Err(other) => panic!("{other}"),
        }
    }

    #[test]
    fn every_number_out_of_its_range_is_named() {
        type Field = (&'static str, fn(&mut Settings) -> &mut f64, [f64; 2]);
        let fields: [Field; 10] = [
            ("elevation_mask_rad", |s| &mut s.elevation_mask_rad, [-0.08, 1.55]),
            ("max_tilt_rad", |s| &mut s.max_tilt_rad, [0.0, 3.1]),
            ("roll_sd_rad", |s| &mut s.roll_sd_rad, [0.0, 3.1]),
            ("max_angle_sd_rad", |s| &mut s.max_angle_sd_rad, [1e-4, 3.1]),
            ("array_sd_m", |s| &mut s.array_sd_m, [0.0, 10.0]),
            ("code_zenith_m", |s| &mut s.noise.code_zenith_m, [1e-6, 100.0]),
            ("phase_zenith_m", |s| &mut s.noise.phase_zenith_m, [1e-6, 100.0]),
            ("full_cn0_dbhz", |s| &mut s.noise.full_cn0_dbhz, [0.0, 100.0]),
            ("channel_sd_m", |s| &mut s.noise.channel_sd_m, [0.0, 1.0]),
            ("max_wrong_fix_rate", |s| &mut s.max_wrong_fix_rate, [1e-9, 0.5]),
        ];
        for (name, field, inside) in fields {
            for value in inside {
                assert_eq!(refused(|s| *field(s) = value), None, "{name}: {value}");
            }
            for value in [-0.1, 200.0, f64::NAN, f64::INFINITY] {
                assert_eq!(refused(|s| *field(s) = value), Some(name), "{value}");
            }
        }
        let walk = |m_per_sqrt_s| Ambiguities::Continuous(Motion::RandomWalk { m_per_sqrt_s });
        assert_eq!(refused(|s| s.ambiguities = walk(0.0)), Some("m_per_sqrt_s"));
        let nowhere = Vector::new(f64::NAN, 0.0, 0.0);
        assert_eq!(refused(|s| s.points_m.push(nowhere)), Some("points_m"));
        assert_eq!(refused(|s| s.points_m.push(Vector::new(2e5, 0.0, 0.0))), Some("points_m"));
        let place = Vector::new(0.0, f64::INFINITY, 0.0);
        assert_eq!(refused(|s| s.first_antenna_m = Some(place)), Some("first_antenna_m"));
    }

    #[test]
    fn what_does_not_go_together_is_told() {
        let array =
            AntennaArray::new((0..3).map(|k| Vector::new(f64::from(k), 0.0, 0.0)).collect());
        let two = Settings { antennas: 2, ..Settings::default() };
        let one = Settings { antennas: 1, ..two.clone() };
        assert_eq!(one.check(), Err(SettingsError::FewAntennas { found: 1 }));
        let more = Settings { array: array.ok(), ..two.clone() };
        assert_eq!(more.check(), Err(SettingsError::Positions { positions: 3, antennas: 2 }));
        let told = Settings { constraint: Constraint::Length, ..two.clone() };
        assert_eq!(told.check(), Err(SettingsError::ConstraintWithoutPositions));
        let l1 = Band::new(System::Gps, 1);
        let twice = Settings { bands: Some(vec![l1, l1]), ..two };
        assert_eq!(twice.check(), Err(SettingsError::RepeatedBand(l1)));
    }
}
