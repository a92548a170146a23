//! Coordinates relative to a fixed station whose place is known: by code differences for every
//! antenna (seed 004: corrected coordinates of A, B, C), by carrier phase for the first one.
//!
//! A differential correction is what the station's ranges are off at its known place; subtracting it
//! from an antenna's ranges is the difference of the two. So both are baselines from the station,
//! `x = x_station + b`, found by the same chain as those of the array, without known geometry.

use super::Engine;
use super::settings::{Ambiguities, Constraint, Settings, SettingsError};
use crate::ephemeris::NavigationData;
use crate::frames::{Ecef, Geodetic, Vector, enu_from_ned};
use crate::observation::{AntennaEpoch, ArrayEpoch};
use crate::solution::{BaselineEstimate, EpochSolution, PointEstimate, Status};

/// The station with its two chains; in both it is antenna 0.
#[derive(Debug)]
pub(super) struct Station {
    position_m: Vector<Ecef>,
    /// Station and all antennas, code alone.
    code: Engine,
    /// Station and first antenna, with integers.
    phase: Engine,
    /// Station and antennas; keeps its buffers.
    epoch: ArrayEpoch,
}

impl Station {
    /// A station at `position_m` for the antennas of `settings`.
    pub(super) fn new(
        position_m: Vector<Ecef>,
        settings: &Settings,
        navigation: &NavigationData,
    ) -> Result<Self, SettingsError> {
        let chain = |antennas, ambiguities| {
            let settings = Settings {
                antennas,
                array: None,
                points_m: Vec::new(),
                ambiguities,
                constraint: Constraint::None,
                residuals: false,
                first_antenna_m: Some(position_m),
                ..settings.clone()
            };
            Engine::new(settings, navigation.clone())
        };
        Ok(Self {
            position_m,
            code: chain(settings.antennas + 1, Ambiguities::CodeOnly)?,
            phase: chain(2, settings.ambiguities)?,
            epoch: ArrayEpoch::default(),
        })
    }

    /// As [`Engine::insert`].
    pub(super) fn insert(&mut self, news: &NavigationData) {
        self.code.insert(news);
        self.phase.insert(news);
    }

    /// Gives the row the antennas' coordinates by code, and puts the first antenna's coordinates by
    /// phase, if its integers are accepted, or else by code, in the place of its own.
    pub(super) fn improve(
        &mut self,
        epoch: &ArrayEpoch,
        observed: &AntennaEpoch,
        row: &mut EpochSolution,
    ) {
        self.epoch.time = epoch.time;
        self.epoch.antennas.resize(epoch.antennas.len() + 1, None);
        let buffers = self.epoch.antennas.iter_mut();
        for (buffer, antenna) in buffers
            .zip(core::iter::once(Some(observed)).chain(epoch.antennas.iter().map(Option::as_ref)))
        {
            match (buffer.as_mut(), antenna) {
                (Some(buffer), Some(antenna)) => buffer.clone_from(antenna),
                (_, antenna) => *buffer = antenna.cloned(),
            }
        }
        let by_code = self.code.push(&self.epoch);
        let end_of = |baseline: &BaselineEstimate| self.end_of(baseline);
        row.by_code = by_code.baselines.iter().map(end_of).collect();

        let by_phase = self.phase.push(&self.epoch);
        let fixed = by_phase.baselines.first().filter(|_| by_phase.status == Status::Fixed);
        let first = fixed.map(|baseline| self.end_of(baseline));
        let best = first.or_else(|| row.by_code.iter().find(|place| place.index == 0).copied());
        if let (Some(position), Some(best)) = (&mut row.position, best) {
            position.geodetic = best.geodetic;
            position.position_m = best.geodetic.to_ecef();
            position.covariance_m2 = best.covariance_m2;
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
