//! What the observations of a working configuration tell a plan: place, bands, noise, attitude, time.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use kurs::engine::Settings;
use kurs::ephemeris::NavigationData;
use kurs::frames::Geodetic;
use kurs::signal::{Band, Signal, System};
use kurs::sky::{NoiseModel, Variances};
use kurs::solution::{EpochSolution, SignalResidual};
use kurs::time::GpsTime;

use crate::doctor::sample::Sample;
use crate::solve::config::{self, Overrides};
use crate::solve::{self, Input};

/// Epochs that are solved.
const MAX_EPOCHS: usize = 100;
/// Mean resultant length of headings that are one heading: a spread of about 30°.
const MIN_RESULTANT: f64 = 0.87;
/// Redundancy from which residuals tell a noise level.
const MIN_REDUNDANCY: f64 = 50.0;
/// The model of the noise for observations of 1 m at the zenith.
const AT_ZENITH: NoiseModel =
    NoiseModel { code_zenith_m: 1.0, phase_zenith_m: 1.0, full_cn0_dbhz: 45.0, channel_sd_m: 0.0 };

/// What was found; `None` where the observations do not tell.
#[derive(Debug)]
pub(super) struct Session {
    pub(super) navigation: NavigationData,
    pub(super) start: Option<GpsTime>,
    pub(super) place: Option<Geodetic>,
    /// Heading, pitch and roll.
    pub(super) angles_deg: [Option<f64>; 3],
    pub(super) bands: BTreeSet<Band>,
    /// Standard deviation of one antenna at the zenith.
    pub(super) code_sd_m: Option<f64>,
    pub(super) phase_sd_m: Option<f64>,
}

impl Session {
    /// Solves a sample of the configuration's session; `nav` in place of its navigation files.
    pub(super) fn read(configuration: &Path, nav: &[PathBuf]) -> anyhow::Result<Self> {
        let overrides = Overrides { nav, ..Overrides::default() };
        let loaded = config::load(Some(configuration), &overrides)?;
        let settings = Settings { residuals: true, ..loaded.settings()? };
        let Input { navigation, mut streams, phase_centers, .. } = Input::open(&loaded)?;
        let sample = Sample::take(&mut streams, MAX_EPOCHS)?;
        let bands =
            sample.shared_bands().into_iter().filter(|band| settings.wants(*band)).collect();
        let mut engine =
            solve::engine(&loaded, settings, navigation.clone(), phase_centers.mounts)?;
        let rows: Vec<EpochSolution> =
            sample.epochs.iter().map(|epoch| engine.push(epoch, None)).collect();
        let places: Vec<Geodetic> =
            rows.iter().filter_map(|row| row.position.map(|p| p.geodetic)).collect();
        Ok(Self {
            navigation,
            start: sample.attendance.session().first(),
            place: places.get(places.len() / 2).copied(),
            angles_deg: [0, 1, 2].map(|k| {
                let angle_deg = steady_angle_deg(&rows, k)?;
                Some(rounded(if k == 0 { angle_deg.rem_euclid(360.0) } else { angle_deg }, 10.0))
            }),
            bands,
            code_sd_m: zenith_sd_m(&rows, |residual| residual.code_m, |v| v.code_m2, 0.0)
                .map(|sd_m| rounded(sd_m, 1e3)),
            // Each epoch takes three coordinates of every baseline from the phases.
            phase_sd_m: zenith_sd_m(&rows, |residual| residual.phase_m, |v| v.phase_m2, 3.0)
                .map(|sd_m| rounded(sd_m, 1e4)),
        })
    }
}

/// To as many digits as mean something.
fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

/// The heading, pitch or roll of a body that keeps one, from −180 to 180.
fn steady_angle_deg(rows: &[EpochSolution], which: usize) -> Option<f64> {
    let fixed = rows.iter().filter(|row| row.is_fixed());
    let angles: Vec<f64> = fixed.filter_map(|row| row.attitude()?.angles_rad()[which]).collect();
    let (along, across) =
        angles.iter().fold((0.0, 0.0), |(c, s), rad| (c + rad.cos(), s + rad.sin()));
    let is_one = f64::hypot(along, across) > MIN_RESULTANT * angles.len() as f64;
    is_one.then(|| across.atan2(along).to_degrees())
}

/// Standard deviation of one observation of one antenna, taken to the zenith, from the residuals of
/// the fixed epochs.
///
/// Double differences of `N` observations of `m` antennas in `g` groups of one signal have
/// `N (m − 1)/m − g (m − 1)` redundant ones, less the coordinates that were estimated from them; the
/// squares of all residuals, over the variances that the model gives them for 1 m² at the zenith, add
/// up to that many times the variance at the zenith.
fn zenith_sd_m(
    rows: &[EpochSolution],
    of: impl Fn(&SignalResidual) -> Option<f64>,
    variance: impl Fn(Variances) -> f64,
    coordinates: f64,
) -> Option<f64> {
    let (mut squares_m2, mut redundancy) = (0.0, 0.0);
    for row in rows.iter().filter(|row| row.is_fixed()) {
        let mut antennas = BTreeSet::new();
        let mut groups: BTreeSet<(System, Signal)> = BTreeSet::new();
        let mut count = 0.0;
        for residual in row.residuals() {
            let Some(residual_m) = of(residual) else { continue };
            let sin_elevation = residual.elevation_rad.sin();
            let of_zenith =
                variance(AT_ZENITH.variances(residual.signal.band, sin_elevation, None));
            squares_m2 += residual_m * residual_m / of_zenith;
            count += 1.0;
            antennas.insert(residual.antenna);
            groups.insert((residual.satellite.system, residual.signal));
        }
        let m = antennas.len().max(1) as f64;
        let baselines = m - 1.0;
        redundancy += count * baselines / m - (groups.len() as f64 + coordinates) * baselines;
    }
    (redundancy > MIN_REDUNDANCY).then(|| (squares_m2 / redundancy).sqrt())
}
