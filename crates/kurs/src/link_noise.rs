//! What the antennas and bands together tell of the noise of each link.
//!
//! **Edges.** A satellite behind an edge in front of one antenna – a roof, a mast, a slope, foliage – is
//! received there by diffraction: weaker, and on a detour. Its phase is late by centimetres, alike on all
//! bands, and its code is fine. Nothing in the phase itself tells that. The other antenna does, which
//! receives the same satellite with full strength, and so does what this antenna usually receives at such
//! an elevation. With `d` the smaller of what is missing against the two, links whose phase is off by more
//! than 0.15 cycle were
//!
//! | `d`, dB | 0–2 | 2–4 | 4–6 | 6–8 | 8–10 | 10–12 | more |
//! |---|---|---|---|---|---|---|---|
//! | share | 0.0 % | 0.2 % | 2.2 % | 20 % | 39 % | 62 % | 75 % |
//!
//! (two stations in a mountain valley, 24 h of BeiDou; `docs/experiments/real-skies.md`). A phase that is
//! likely to be off determines no integer, so none is asked for: beyond [`MAX_MISSING_DB`] the phase is
//! left out. Below, it has the variance of what the edge may do, all of it common to the bands,
//!
//! `σ_e = E (d − d₀)`,   `E` = `EDGE_M_PER_DB`, `d₀` = `USUAL_SPREAD_DB`.
//!
//! **Bands.** Reflections and diffraction of one satellite are alike on all its bands. Taken as independent
//! they would average, and a fix of five bands would be sure of an error that it cannot see. With a share
//! `κ` of the variance `σ²` common to the satellite's `B` bands, their mean has the variance
//! `σ² (κ + (1 − κ)/B)`: that of `B` independent phases of
//!
//! `σ_B² = σ² (1 + κ (B − 1))`
//!
//! which is what they are given. It keeps the blocks of the double differences apart, is exact for the
//! baselines, and weighs differences between bands too little rather than too much. Residuals are
//! smaller than that: the mean of the bands has the full `σ_B²`, each of the `B − 1` differences only
//! `σ² (1 − κ)`; [`expected_square`] is what to expect of a normalised square.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::difference::Link;
use crate::signal::{Band, Satellite};

/// A phase with more missing than this is not used, dB: a fifth of them is off by more than 0.15 cycle.
pub const MAX_MISSING_DB: f64 = 6.0;
/// `d₀`: receivers, antennas and satellites differ by this without any edge, dB; below it no link was off.
const USUAL_SPREAD_DB: f64 = 2.0;
/// `E`: 2.2 % of the links with 4 to 6 dB are off by more than 0.15 cycle (29 mm), 2.3 standard deviations.
const EDGE_M_PER_DB: f64 = 0.004;
/// Satellites of one system differ in power by this, dB: so much less than usual says nothing yet.
const SATELLITE_SPREAD_DB: f64 = 3.0;
/// What antennas receive less at the horizon than at the zenith, dB: as in [`crate::sky::NoiseModel`].
const LOSS_AT_HORIZON_DB: f64 = 10.0;
/// Code residuals beyond this are outliers, in standard deviations: one in 150 of Gaussian noise.
const MAX_CODE_SIGMAS: f64 = 2.7;
/// Epochs that "no antenna lacks anything" counts for.
const PRIOR_EPOCHS: f64 = 1.0;
/// Epochs after which the past is forgotten.
const MEMORY_EPOCHS: f64 = 600.0;

/// `κ`: share of the variance that is common to the bands of a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Common {
    /// Of the code.
    pub code: f64,
    /// Of the phases.
    pub phase: f64,
}

/// Mean square to expect of a residual of one of `bands` bands, in units of the variance it was given.
#[must_use]
pub fn expected_square(bands: usize, common: f64) -> f64 {
    let b = bands.max(1) as f64;
    (1.0 + (b - 1.0) * (1.0 - common) / (1.0 + common * (b - 1.0))) / b
}

/// What each antenna usually receives on each band, and the buffers of an epoch.
#[derive(Debug, Clone, Default)]
pub struct LinkNoise {
    usual: BTreeMap<(usize, Band), Usual>,
    values_db: Vec<f64>,
    bands: BTreeMap<(usize, Satellite), usize>,
}

/// Sums over epochs of medians over satellites, dB.
#[derive(Debug, Clone, Copy, Default)]
struct Usual {
    /// C/N0 less the mean of all antennas that receive the same satellite.
    beside_others_db: f64,
    /// C/N0 as it would be at the zenith.
    at_zenith_db: f64,
    epochs: f64,
}

impl LinkNoise {
    /// Gives the links of an epoch (grouped: sorted by satellite and antenna within each group) the variances
    /// that all antennas and bands together tell, and takes out the phases that an edge has spoilt.
    pub fn apply(&mut self, links: &mut [Link], groups: &[Range<usize>], common: Common) {
        for group in groups {
            self.learn(&links[group.clone()]);
            for of_satellite in links[group.clone()].chunk_by_mut(|a, b| a.satellite == b.satellite)
            {
                self.look_for_edges(of_satellite);
            }
        }
        self.share_between_bands(links, common);
    }

    /// Learns from the medians of one group of links.
    fn learn(&mut self, group: &[Link]) {
        let Some(band) = group.first().map(|link| link.signal.band) else { return };
        let last = group.iter().map(|link| link.antenna).max().unwrap_or(0);
        for antenna in 0..=last {
            self.values_db.clear();
            for of_satellite in group.chunk_by(|a, b| a.satellite == b.satellite) {
                let own_db = of_satellite.iter().find(|l| l.antenna == antenna);
                if let (Some(own_db), Some(mean_db)) =
                    (own_db.and_then(|l| l.cn0_dbhz), mean_cn0(of_satellite))
                {
                    self.values_db.push(own_db - mean_db);
                }
            }
            let Some(beside_others_db) = median(&mut self.values_db) else { continue };
            self.values_db.clear();
            let own = group.iter().filter(|link| link.antenna == antenna);
            self.values_db.extend(own.filter_map(at_zenith_db));
            let Some(at_zenith_db) = median(&mut self.values_db) else { continue };

            let usual = self.usual.entry((antenna, band)).or_default();
            let keep = 1.0 - 1.0 / MEMORY_EPOCHS;
            usual.beside_others_db = usual.beside_others_db * keep + beside_others_db;
            usual.at_zenith_db = usual.at_zenith_db * keep + at_zenith_db;
            usual.epochs = usual.epochs * keep + 1.0;
        }
    }

    /// One satellite on one band at all antennas that receive it.
    fn look_for_edges(&self, links: &mut [Link]) {
        let strength_db = |link: &Link| {
            let usual = self.usual.get(&(link.antenna, link.signal.band))?;
            Some(link.cn0_dbhz? - usual.beside_others_db / (usual.epochs + PRIOR_EPOCHS))
        };
        let strongest_db = links.iter().filter_map(strength_db).fold(f64::NEG_INFINITY, f64::max);
        for link in links {
            let usual = self.usual.get(&(link.antenna, link.signal.band));
            let (Some(usual), Some(own_db), Some(zenith_db)) =
                (usual, strength_db(link), at_zenith_db(link))
            else {
                continue;
            };
            let less_than_usual_db = usual.at_zenith_db / usual.epochs - zenith_db;
            let missing_db =
                (strongest_db - own_db).min(less_than_usual_db + SATELLITE_SPREAD_DB).max(0.0);
            link.missing_db = missing_db;
            if missing_db > MAX_MISSING_DB {
                link.phase_m = None;
            }
        }
    }

    /// `σ_B² = σ² (1 + κ (B − 1)) + B σ_e²`
    fn share_between_bands(&mut self, links: &mut [Link], common: Common) {
        self.bands.clear();
        for link in links.iter() {
            *self.bands.entry((link.antenna, link.satellite)).or_default() += 1;
        }
        for link in links {
            link.bands = self.bands[&(link.antenna, link.satellite)];
            let more = link.bands as f64 - 1.0;
            let edge_m = EDGE_M_PER_DB * (link.missing_db - USUAL_SPREAD_DB).max(0.0);
            link.variances.phase_m2 = link.variances.phase_m2 * (1.0 + common.phase * more)
                + link.bands as f64 * edge_m * edge_m;
            link.variances.code_m2 *= 1.0 + common.code * more;
        }
    }
}

/// Gives code whose normalised residual is an outlier the variance that makes it one of `MAX_CODE_SIGMAS`, as
/// Huber's estimator weighs it; whether there was any.
///
/// Reflections put metres on the code for tens of seconds; they should neither decide nor veto.
pub fn weigh_code_outliers(links: &mut [Link], residuals: &[(usize, f64)]) -> bool {
    let mut any = false;
    for (link, z) in residuals.iter().filter(|(_, z)| z.abs() > MAX_CODE_SIGMAS) {
        links[*link].variances.code_m2 *= (z / MAX_CODE_SIGMAS).powi(2);
        any = true;
    }
    any
}

/// Mean C/N0 of the links, if all have one.
fn mean_cn0(links: &[Link]) -> Option<f64> {
    let sum_db: Option<f64> = links.iter().map(|link| link.cn0_dbhz).sum();
    Some(sum_db? / links.len().max(1) as f64)
}

/// C/N0 that a link would have at the zenith.
fn at_zenith_db(link: &Link) -> Option<f64> {
    Some(link.cn0_dbhz? + LOSS_AT_HORIZON_DB * (1.0 - link.elevation_rad.sin()))
}

fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let in_range = middle < values.len();
    in_range.then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
