//! Coordinates relative to a fixed station whose place is known: by code differences for every
//! antenna (`docs/papers/004-three-antennas.md`: corrected coordinates of A, B, C), by carrier phase
//! for the first one.
//!
//! A differential correction is what the station's ranges are off at its known place; subtracting it
//! from an antenna's ranges is the difference of the two. So both are baselines from the station,
//! `x = x_station + b`, found by the same chain as those of the array, without known geometry.
//!
//! An epoch of the station that is older than the row's is carried to it by the broadcast orbits and clocks;
//! what they do not know grows with its age.

mod carried;

use std::borrow::Cow;

use nalgebra::Matrix3;

use crate::engine::{
    Ambiguities, Constraint, Engine, Estimator, PredictedAttitude, Settings, SettingsError,
    place_body,
};
use crate::ephemeris::NavigationData;
use crate::frames::{Ecef, Geodetic, Vector, enu_from_ned};
use crate::observation::{AntennaEpoch, ArrayEpoch};
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::solution::{
    BaselineEstimate, EpochSolution, PointEstimate, PositionEstimate, PositionOrigin,
};

/// An epoch that is older than this, s, is carried: receivers that sample closer together are used as they are.
const MIN_CARRIED_S: f64 = 0.010;
/// How much the clock of a satellite may run off its broadcast rate, s/s (what RTKLIB supposes for the age of
/// corrections: manual of version 2.4.2, "Satellite Clock Stability").
const CLOCK_STABILITY: f64 = 5e-12;
/// Dilution of precision of a coordinate that is not exceeded under a usual sky.
const COORDINATE_DOP: f64 = 3.0;
/// Until this age, s, what the clocks run off (4.5 mm) is as small as the noise of a phase, and integers may be judged.
const MAX_PHASE_AGE_S: f64 = 3.0;

/// Coordinates relative to the station that are farther than this, m, from those of the antenna's own code are in the
/// wrong place: errors of the antenna's code are in both, and what the station takes out, atmosphere and orbits, is
/// some tens of metres at worst.
const MAX_STATION_OFFSET_M: f64 = 50.0;

/// What came of the station's epochs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StationUse {
    /// Rows that had an epoch of the station.
    pub epochs: usize,
    /// Of these those whose coordinates are relative to it.
    pub used: usize,
    /// Of these those whose coordinates would have been in another place than the antenna's own code says.
    pub apart: usize,
    /// How far the last one of them was off, m.
    pub offset_m: f64,
}

/// An engine, beside a fixed station if there is one: rows then have the coordinates relative to it.
#[derive(Debug)]
pub struct Differential {
    engine: Engine,
    station: Option<StationChains>,
}

/// The station with its two chains; in both it is antenna 0.
#[derive(Debug)]
struct StationChains {
    position_m: Vector<Ecef>,
    /// Station and all antennas, code alone.
    code: Estimator,
    /// Station and first antenna, with integers.
    phase: Estimator,
    /// The same from each epoch alone: an epoch that is carried to several rows has the same noise in all of them.
    carried: Estimator,
    /// Station and antennas; keeps its buffers.
    epoch: ArrayEpoch,
    used: StationUse,
}

impl Differential {
    /// Puts a station at a known place (ECEF, m), whose observations are [`ArrayEpoch::station`], beside an
    /// engine.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn new(engine: Engine, station_m: Option<Vector<Ecef>>) -> Result<Self, SettingsError> {
        let station = station_m.map(|position_m| StationChains::new(position_m, engine.settings()));
        Ok(Self { station: station.transpose()?, engine })
    }

    /// Where the station is, ECEF, m; `None` without one.
    #[must_use]
    pub fn station_m(&self) -> Option<Vector<Ecef>> {
        self.station.as_ref().map(|station| station.position_m)
    }

    /// What came of the station's epochs so far.
    #[must_use]
    pub fn station_use(&self) -> StationUse {
        self.station.as_ref().map_or_else(StationUse::default, |station| station.used)
    }

    /// Puts the station at another place (ECEF, m), as virtual stations do; what was known of its phases is forgotten.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn put_station(&mut self, station_m: Vector<Ecef>) -> Result<(), SettingsError> {
        self.station = Some(StationChains::new(station_m, self.engine.settings())?);
        Ok(())
    }

    /// As [`Engine::insert`]: the engine and the station share what is known.
    pub fn insert(&mut self, news: &NavigationData) {
        self.engine.insert(news);
    }

    /// Attitude, baselines and position of one epoch ([`Engine::push_predicted`]), its coordinates relative to
    /// the station where that has the epoch too.
    pub fn push(
        &mut self,
        epoch: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
    ) -> EpochSolution {
        let mut row = self.engine.push_predicted(epoch, predicted);
        if let (Some(station), Some(observed)) = (&mut self.station, &epoch.station) {
            station.improve(&self.engine, epoch, observed, &mut row);
        }
        row
    }
}

impl StationChains {
    fn new(position_m: Vector<Ecef>, settings: &Settings) -> Result<Self, SettingsError> {
        let estimator = |antennas, ambiguities| {
            Estimator::new(Settings {
                antennas,
                array: None,
                points_m: Vec::new(),
                ambiguities,
                constraint: Constraint::None,
                residuals: false,
                first_antenna_m: Some(position_m),
                ..settings.clone()
            })
        };
        Ok(Self {
            position_m,
            code: estimator(settings.antennas + 1, Ambiguities::CodeOnly)?,
            phase: estimator(2, settings.ambiguities)?,
            carried: estimator(2, Ambiguities::Instantaneous)?,
            epoch: ArrayEpoch::default(),
            used: StationUse::default(),
        })
    }

    /// Gives the row the antennas' coordinates by code, and puts the coordinates of the antenna whose position it
    /// has in the place of its own: by phase for the first one, if its integers are accepted, or else by code. A
    /// station that is not where it is said to be shows against the antenna's own code, and is not used; nor is what a
    /// receiver does not trust.
    fn improve(
        &mut self,
        engine: &Engine,
        epoch: &ArrayEpoch,
        observed: &AntennaEpoch,
        row: &mut EpochSolution,
    ) {
        let navigation = engine.navigation();
        let antennas = epoch.antennas.iter().flatten();
        let is_trusted =
            antennas.chain([observed]).all(|antenna| engine.settings().trusts(antenna));
        let push = |chain: &mut Estimator, epoch: &ArrayEpoch| match is_trusted {
            true => chain.push(navigation, epoch, None),
            false => chain.push_untrusted(navigation, epoch, None),
        };
        let age_s = epoch.time - observed.time;
        let is_carried = age_s > MIN_CARRIED_S;
        let observed = match is_carried {
            true => Cow::Owned(carried::carried(observed, epoch.time, self.position_m, navigation)),
            false => Cow::Borrowed(observed),
        };
        self.epoch.time = epoch.time;
        self.epoch.antennas.resize(epoch.antennas.len() + 1, None);
        let observed = core::iter::once(Some(observed.as_ref()))
            .chain(epoch.antennas.iter().map(Option::as_ref));
        for (buffer, antenna) in self.epoch.antennas.iter_mut().zip(observed) {
            match (buffer.as_mut(), antenna) {
                (Some(buffer), Some(antenna)) => buffer.clone_from(antenna),
                (_, antenna) => *buffer = antenna.cloned(),
            }
        }
        let by_code = push(&mut self.code, &self.epoch);
        let by_phase = match is_carried {
            false => Some(push(&mut self.phase, &self.epoch)),
            true if age_s <= MAX_PHASE_AGE_S => Some(push(&mut self.carried, &self.epoch)),
            true => None,
        };
        self.used.epochs += 1;
        if !is_trusted {
            return;
        }
        let grown_m = match is_carried {
            true => COORDINATE_DOP * CLOCK_STABILITY * SPEED_OF_LIGHT_MPS * age_s,
            false => 0.0,
        };
        let end_of = |baseline: &BaselineEstimate| self.end_of(baseline, grown_m);
        row.by_code = by_code.baselines.iter().map(end_of).collect();
        let fixed = by_phase.filter(EpochSolution::is_fixed);
        let first = fixed.and_then(|by_phase| by_phase.baselines.first().map(end_of));
        let origin = match first {
            Some(_) => PositionOrigin::StationPhase,
            None => PositionOrigin::StationCode,
        };
        let best = first.or_else(|| row.by_code.first().copied());
        let (Some(own), Some(best)) = (row.position, best) else { return };
        let own_points = core::mem::take(&mut row.points);
        row.position = Some(PositionEstimate {
            antenna: Some(best.index),
            geodetic: best.geodetic,
            position_m: best.geodetic.to_ecef(),
            covariance_m2: best.covariance_m2,
            origin,
            ..own
        });
        place_body(row, engine.settings());
        let offset_m = row.position.map_or(0.0, |found| (found.position_m - own.position_m).norm());
        if offset_m > MAX_STATION_OFFSET_M {
            self.used.apart += 1;
            self.used.offset_m = offset_m;
            (row.position, row.points) = (Some(own), own_points);
            row.by_code.clear();
        } else {
            self.used.used += 1;
        }
    }

    /// `x = x_station + b`, each coordinate less certain by what the age of the station's epoch adds, m.
    fn end_of(&self, baseline: &BaselineEstimate, grown_m: f64) -> PointEstimate {
        let ned_from_ecef = Geodetic::from_ecef(self.position_m).ned_from_ecef();
        let ecef_from_enu = (enu_from_ned() * ned_from_ecef).inverse();
        PointEstimate {
            index: baseline.rover - 1,
            geodetic: Geodetic::from_ecef(self.position_m + ecef_from_enu * baseline.baseline_m),
            covariance_m2: enu_from_ned().inverse().turn_covariance(&baseline.covariance_m2)
                + Matrix3::identity() * grown_m.powi(2),
        }
    }
}
