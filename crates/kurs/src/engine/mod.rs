//! The chain from one epoch's observations to attitude: [`Engine::push`] reads as the method.
//!
//! | step | file |
//! |---|---|
//! | locate | `locate.rs`: each antenna by itself; which of them take part |
//! | difference | `difference.rs`: links, their noise, double differences |
//! | float | `difference.rs`: the float solution, and what it teaches of the noise (`noise_levels.rs`, `residuals.rs`, `slowness.rs`, `phase_changes.rs`) |
//! | carry | `estimator.rs`: what earlier epochs know of the ambiguities |
//! | fix | `fix.rs`, `search.rs`, `likelihood.rs`, `subset.rs`, `code_free.rs`, `predicted_attitude.rs`; their common `work_budget.rs` |
//! | orient | `orientation.rs` |
//! | accept | `acceptance.rs`, with the session's `array_misfit.rs`, `session_fit.rs`, `witness.rs` |
//! | row | `row.rs` |
//! | learn | `learn.rs`: what the session keeps of the epoch |
//!
//! An epoch on its way:
//!
//! | name | is |
//! |---|---|
//! | `Epoch` | links, double differences and the float solution |
//! | `Found` | the best integers of one search, and how probable others are |
//! | `Fix` | these, the baselines that belong to them and the checks of the integers: *accepted* if all hold, *sure* if others are improbable, *strong* if hardly any were to choose from |
//! | `Searched` | the epoch with the `Fix` that is left after all trials |
//! | `Oriented` | that with its attitude |
//! | `Judged` | that with all checks, of which the first that fails decides |
//!
//! A run may go backward ([`Direction`]): then all that is remembered sees the epochs in a mirror (`direction.rs`).

mod acceptance;
mod array_misfit;
mod body_velocity;
mod code_free;
mod difference;
mod direction;
mod estimator;
mod fix;
mod learn;
mod likelihood;
mod locate;
mod noise_levels;
mod orientation;
mod phase_changes;
mod predicted_attitude;
mod residuals;
mod row;
mod search;
mod session_fit;
mod settings;
mod slowness;
mod stages;
mod subset;
mod witness;
mod work_budget;

pub use direction::Direction;
pub(crate) use estimator::Estimator;
pub use predicted_attitude::PredictedAttitude;
pub(crate) use row::place_body;
pub use settings::{Ambiguities, Constraint, Settings, SettingsError};

use crate::antenna_calibration::MountedAntenna;
use crate::ephemeris::NavigationData;
use crate::observation::ArrayEpoch;
use crate::solution::{EpochSolution, Reason};

/// The estimator with its navigation data: one epoch of all antennas in, one row out.
#[derive(Debug)]
pub struct Engine {
    navigation: NavigationData,
    estimator: Estimator,
}

impl Engine {
    /// An engine for these settings and navigation data.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] for settings that cannot work.
    pub fn new(settings: Settings, navigation: NavigationData) -> Result<Self, SettingsError> {
        Ok(Self { navigation, estimator: Estimator::new(settings)? })
    }

    /// An engine that knows the phase centres of the antennas (`None` where they are not known). The places
    /// of the antennas, and the baselines, are then those of their reference points.
    ///
    /// The phase centres turn with the body, by the attitude of the last epoch that was fixed; until
    /// there is one, the horizontal offsets (some millimetres) are left out.
    #[must_use]
    pub fn with_phase_centers(mut self, mounts: Vec<Option<MountedAntenna>>) -> Self {
        self.estimator.set_phase_centers(mounts);
        self
    }

    /// What the engine was told.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        self.estimator.settings()
    }

    /// The navigation data in use.
    #[must_use]
    pub fn navigation(&self) -> &NavigationData {
        &self.navigation
    }

    /// Takes in navigation data that were received after all others: they count from the next epoch on.
    pub fn insert(&mut self, news: &NavigationData) {
        self.navigation.update(news);
    }

    /// Attitude, baselines and position of one epoch, the next one in the [`Direction`] of the settings.
    pub fn push(&mut self, epoch: &ArrayEpoch) -> EpochSolution {
        self.push_predicted(epoch, None)
    }

    /// Attitude, baselines and position of an epoch whose attitude is predicted: with a known array, the
    /// prediction decides between integers that the epoch alone is not sure of, and a fix that contradicts it
    /// is refused ([`EpochSolution::prediction`]). It does not enter the attitude.
    pub fn push_predicted(
        &mut self,
        epoch: &ArrayEpoch,
        predicted: Option<&PredictedAttitude>,
    ) -> EpochSolution {
        if epoch.antennas.iter().flatten().all(|antenna| self.settings().trusts(antenna)) {
            return self.estimator.push(&self.navigation, epoch, predicted);
        }
        let mut row = self.estimator.push_untrusted(&self.navigation, epoch, predicted);
        row.refuse(Reason::Interference);
        row
    }
}
