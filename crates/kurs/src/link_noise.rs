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
use crate::median::median;
use crate::signal::{Band, System};
use crate::sky::LOSS_AT_HORIZON_DB;

/// A phase with more missing than this is not used, dB: a fifth of them is off by more than 0.15 cycle.
pub const MAX_MISSING_DB: f64 = 6.0;
/// `d₀`: receivers, antennas and satellites differ by this without any edge, dB; below it no link was off.
const USUAL_SPREAD_DB: f64 = 2.0;
/// `E`: 2.2 % of the links with 4 to 6 dB are off by more than 0.15 cycle (29 mm), 2.3 standard deviations.
const EDGE_M_PER_DB: f64 = 0.004;
/// Satellites of one system differ in power by this, dB: so much less than usual says nothing yet.
const SATELLITE_SPREAD_DB: f64 = 3.0;
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
    usual: BTreeMap<Band, Vec<Usual>>,
    strengths: Vec<Strengths>,
    bands: Vec<u8>,
}

/// C/N0 of one antenna's satellites on one band.
#[derive(Debug, Clone, Default)]
struct Strengths {
    beside_others_db: Vec<f64>,
    at_zenith_db: Vec<f64>,
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
            let group = &mut links[group.clone()];
            let Some(band) = group.first().map(|link| link.signal.band) else { continue };
            self.learn(band, group);
            let usual = &self.usual[&band];
            for of_satellite in group.chunk_by_mut(|a, b| a.satellite == b.satellite) {
                look_for_edges(of_satellite, usual);
            }
        }
        self.share_between_bands(links, common);
    }

    /// Learns from the medians of one group of links.
    fn learn(&mut self, band: Band, group: &[Link]) {
        for strengths in &mut self.strengths {
            strengths.beside_others_db.clear();
            strengths.at_zenith_db.clear();
        }
        for of_satellite in group.chunk_by(|a, b| a.satellite == b.satellite) {
            let mean_db = mean_cn0(of_satellite);
            for link in of_satellite {
                let antennas = self.strengths.len().max(link.antenna + 1);
                self.strengths.resize_with(antennas, Strengths::default);
                let strengths = &mut self.strengths[link.antenna];
                let beside_others_db = link.cn0_dbhz.zip(mean_db).map(|(own, mean)| own - mean);
                strengths.beside_others_db.extend(beside_others_db);
                strengths.at_zenith_db.extend(at_zenith_db(link));
            }
        }
        let usual = self.usual.entry(band).or_default();
        usual.resize_with(self.strengths.len().max(usual.len()), Usual::default);
        for (usual, strengths) in usual.iter_mut().zip(&mut self.strengths) {
            let Some(beside_others_db) = median(&mut strengths.beside_others_db) else { continue };
            let Some(at_zenith_db) = median(&mut strengths.at_zenith_db) else { continue };
            let keep = 1.0 - 1.0 / MEMORY_EPOCHS;
            usual.beside_others_db = usual.beside_others_db * keep + beside_others_db;
            usual.at_zenith_db = usual.at_zenith_db * keep + at_zenith_db;
            usual.epochs = usual.epochs * keep + 1.0;
        }
    }

    /// `σ_B² = σ² (1 + κ (B − 1)) + B σ_e²`
    fn share_between_bands(&mut self, links: &mut [Link], common: Common) {
        let place = |link: &Link| {
            let of_antenna = link.antenna * System::ALL.len() + link.satellite.system as usize;
            (of_antenna << u8::BITS) + usize::from(link.satellite.number)
        };
        let places = links.iter().map(|link| place(link) + 1).max().unwrap_or(0);
        self.bands.clear();
        self.bands.resize(places, 0);
        for link in links.iter() {
            self.bands[place(link)] += 1;
        }
        for link in links {
            link.bands = usize::from(self.bands[place(link)]);
            let more = link.bands as f64 - 1.0;
            let edge_m = EDGE_M_PER_DB * (link.missing_db - USUAL_SPREAD_DB).max(0.0);
            link.variances.phase_m2 = link.variances.phase_m2 * (1.0 + common.phase * more)
                + link.bands as f64 * edge_m * edge_m;
            link.variances.code_m2 *= 1.0 + common.code * more;
        }
    }
}

/// One satellite on one band at all antennas that receive it, beside what each of these usually receives.
fn look_for_edges(links: &mut [Link], usual: &[Usual]) {
    let usual_of = |link: &Link| usual.get(link.antenna).filter(|usual| usual.epochs > 0.0);
    let strength_db = |link: &Link| {
        let usual = usual_of(link)?;
        Some(link.cn0_dbhz? - usual.beside_others_db / (usual.epochs + PRIOR_EPOCHS))
    };
    let strongest_db = links.iter().filter_map(strength_db).fold(f64::NEG_INFINITY, f64::max);
    for link in links {
        let (Some(usual), Some(own_db), Some(zenith_db)) =
            (usual_of(link), strength_db(link), at_zenith_db(link))
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
    Some(link.cn0_dbhz? + LOSS_AT_HORIZON_DB * (1.0 - link.direction.sin_elevation()))
}
