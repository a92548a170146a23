//! What is known of a session beforehand, and the form of what is found.

use kurs::antenna_calibration::MountedAntenna;
use kurs::array::AntennaArray;
use kurs::engine::Settings;
use kurs::ephemeris::NavigationData;
use serde::Serialize;

use crate::report::views::Views;

/// A share of the epochs that makes something a cause.
pub(crate) const MANY: f64 = 0.2;
/// A trial with this many more of the epochs fixed mends something.
pub(super) const MENDED: f64 = 0.3;

/// One cause.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// One word for programs.
    pub(super) code: &'static str,
    /// In words.
    pub(super) cause: String,
    /// What shows it.
    pub(super) evidence: String,
    /// What to change.
    pub(super) advice: String,
}

/// What is known beforehand.
pub(super) struct Patient<'a> {
    pub(super) names: &'a [String],
    pub(super) settings: &'a Settings,
    pub(super) array: Option<&'a AntennaArray>,
    pub(super) navigation: &'a NavigationData,
    pub(super) mounts: &'a [Option<MountedAntenna>],
    /// The views of the rows that are solved as configured.
    pub(super) views: &'a Views,
}
