//! Coordinates relative to a fixed station whose place is known: by code differences for every
//! antenna (seed 004: corrected coordinates of A, B, C), by carrier phase for the first one.
//!
//! A differential correction is what the station's ranges are off at its known place; subtracting it
//! from an antenna's ranges is the difference of the two. So both are baselines from the station,
//! `x = x_station + b`, found by the same chain as those of the array, without known geometry.

use crate::engine::{
    Ambiguities, Constraint, Engine, Estimator, PredictedAttitude, Settings, SettingsError,
    place_body,
};
use crate::ephemeris::NavigationData;
use crate::frames::{Ecef, Geodetic, Vector, enu_from_ned};
use crate::observation::{AntennaEpoch, ArrayEpoch};
use crate::solution::{BaselineEstimate, EpochSolution, PointEstimate, PositionOrigin};

/// An engine, beside a fixed station if there is one: rows then have the coordinates relative to it.
#[derive(Debug)]
pub struct Differential {
    engine: Engine,
    station: Option<Station>,
}

/// The station with its two chains; in both it is antenna 0.
#[derive(Debug)]
struct Station {
    position_m: Vector<Ecef>,
    /// Station and all antennas, code alone.
    code: Estimator,
    /// Station and first antenna, with integers.
    phase: Estimator,
    /// Station and antennas; keeps its buffers.
    epoch: ArrayEpoch,
}

impl Differential {
    /// Puts a station at a known place (ECEF, m), whose observations are [`ArrayEpoch::station`], beside an
    /// engine.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn new(engine: Engine, station_m: Option<Vector<Ecef>>) -> Result<Self, SettingsError> {
        let station = station_m.map(|position_m| Station::new(position_m, engine.settings()));
        Ok(Self { station: station.transpose()?, engine })
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

impl Station {
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
            epoch: ArrayEpoch::default(),
        })
    }

    /// Gives the row the antennas' coordinates by code, and puts the coordinates of the antenna whose position it
    /// has in the place of its own: by phase for the first one, if its integers are accepted, or else by code.
    fn improve(
        &mut self,
        engine: &Engine,
        epoch: &ArrayEpoch,
        observed: &AntennaEpoch,
        row: &mut EpochSolution,
    ) {
        self.epoch.time = epoch.time;
        self.epoch.antennas.resize(epoch.antennas.len() + 1, None);
        let observed =
            core::iter::once(Some(observed)).chain(epoch.antennas.iter().map(Option::as_ref));
        for (buffer, antenna) in self.epoch.antennas.iter_mut().zip(observed) {
            match (buffer.as_mut(), antenna) {
                (Some(buffer), Some(antenna)) => buffer.clone_from(antenna),
                (_, antenna) => *buffer = antenna.cloned(),
            }
        }
        let navigation = engine.navigation();
        let by_code = self.code.push(navigation, &self.epoch, None);
        let by_phase = self.phase.push(navigation, &self.epoch, None);
        row.by_code = by_code.baselines.iter().map(|baseline| self.end_of(baseline)).collect();
        let fixed = by_phase.baselines.first().filter(|_| by_phase.is_fixed());
        let first = fixed.map(|baseline| self.end_of(baseline));
        let origin = match first {
            Some(_) => PositionOrigin::StationPhase,
            None => PositionOrigin::StationCode,
        };
        let best = first.or_else(|| row.by_code.first().copied());
        if let (Some(position), Some(best)) = (&mut row.position, best) {
            position.antenna = Some(best.index);
            position.geodetic = best.geodetic;
            position.position_m = best.geodetic.to_ecef();
            position.covariance_m2 = best.covariance_m2;
            position.origin = origin;
            place_body(row, engine.settings());
        }
    }

    /// `x = x_station + b`.
    fn end_of(&self, baseline: &BaselineEstimate) -> PointEstimate {
        let ned_from_ecef = Geodetic::from_ecef(self.position_m).ned_from_ecef();
        let ecef_from_enu = (enu_from_ned() * ned_from_ecef).inverse();
        PointEstimate {
            index: baseline.rover - 1,
            geodetic: Geodetic::from_ecef(self.position_m + ecef_from_enu * baseline.baseline_m),
            covariance_m2: enu_from_ned().inverse().turn_covariance(&baseline.covariance_m2),
        }
    }
}
