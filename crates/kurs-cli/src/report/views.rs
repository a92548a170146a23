//! The sky as each antenna sees it: where signals arrive weaker than they usually do and than at
//! the other antennas, because something stands in the way.

use std::collections::BTreeMap;

use kurs::link_noise::MAX_MISSING_DB;
use kurs::signal::Satellite;
use kurs::solution::SignalResidual;
use serde::Serialize;

use super::residuals::{Cell, cell, centre_rad};

/// Share of the epochs above which a satellite counts as behind something at an antenna.
const MIN_SHARE: f64 = 0.05;

/// What is missing of the signals, by antenna and place in the sky.
#[derive(Debug, Clone, Default)]
pub(crate) struct Views {
    cells: BTreeMap<(usize, Cell), Mean>,
    satellites: BTreeMap<(usize, Satellite), OfSatellite>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    count: u64,
    sum: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct OfSatellite {
    epochs: u64,
    hidden: u64,
    /// Sums over the epochs in which it is hidden.
    missing_db: f64,
    elevation_rad: f64,
    east: f64,
    north: f64,
}

/// A cell of the sky of one antenna.
pub(super) struct View {
    pub(super) satellite: Satellite,
    pub(super) azimuth_rad: f64,
    pub(super) elevation_rad: f64,
    /// Mean over the epochs.
    pub(super) missing_db: f64,
}

/// A satellite that something stands before at one antenna, in `doctor.json`: means over the epochs
/// in which it does.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct HiddenRow {
    pub(crate) antenna: String,
    satellite: String,
    azimuth_deg: f64,
    elevation_deg: f64,
    missing_db: f64,
    /// Epochs in which its phases there were not used for that, of those in which it was received.
    epochs: u64,
    of: u64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
    }

    fn value(self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

impl Views {
    /// Takes the signals of an epoch in; the weakest of a satellite at an antenna counts.
    pub(crate) fn add(&mut self, signals: &[SignalResidual]) {
        let mut weakest: BTreeMap<(usize, Satellite), &SignalResidual> = BTreeMap::new();
        for signal in signals {
            let known = weakest.entry((signal.antenna, signal.satellite)).or_insert(signal);
            if signal.missing_db > known.missing_db {
                *known = signal;
            }
        }
        for ((antenna, satellite), signal) in weakest {
            let place = (satellite, cell(signal.elevation_rad), cell(signal.azimuth_rad));
            self.cells.entry((antenna, place)).or_default().add(signal.missing_db);
            let known = self.satellites.entry((antenna, satellite)).or_default();
            known.epochs += 1;
            if signal.missing_db > MAX_MISSING_DB {
                known.hidden += 1;
                known.missing_db += signal.missing_db;
                known.elevation_rad += signal.elevation_rad;
                known.east += signal.azimuth_rad.sin();
                known.north += signal.azimuth_rad.cos();
            }
        }
    }

    /// The sky of an antenna; nothing if none of its signals is weakened.
    pub(super) fn of_antenna(&self, antenna: usize) -> Vec<View> {
        let is_hidden =
            |((of, _), s): (&(usize, Satellite), &OfSatellite)| *of == antenna && s.hidden > 0;
        if !self.satellites.iter().any(is_hidden) {
            return Vec::new();
        }
        let of_antenna = self.cells.iter().filter(|((of, _), _)| *of == antenna);
        let view = |((_, (satellite, elevation, azimuth)), mean): (&(usize, Cell), &Mean)| View {
            satellite: *satellite,
            azimuth_rad: centre_rad(*azimuth),
            elevation_rad: centre_rad(*elevation),
            missing_db: mean.value(),
        };
        of_antenna.map(view).collect()
    }

    /// Satellites that something stands before, the most frequent first.
    pub(crate) fn hidden(&self, names: &[String]) -> Vec<HiddenRow> {
        let often = |s: &OfSatellite| s.hidden as f64 > MIN_SHARE * s.epochs as f64;
        let hidden = self.satellites.iter().filter(|(_, s)| often(s));
        let row = |((antenna, satellite), s): (&(usize, Satellite), &OfSatellite)| HiddenRow {
            antenna: names[*antenna].clone(),
            satellite: satellite.to_string(),
            // Not 360° of what is a trifle west of north.
            azimuth_deg: s.east.atan2(s.north).to_degrees().round().rem_euclid(360.0).abs(),
            elevation_deg: (s.elevation_rad / s.hidden as f64).to_degrees(),
            missing_db: s.missing_db / s.hidden as f64,
            epochs: s.hidden,
            of: s.epochs,
        };
        let mut rows: Vec<HiddenRow> = hidden.map(row).collect();
        rows.sort_by_key(|row| std::cmp::Reverse(row.epochs));
        rows
    }

    /// Share of the signals' epochs at each antenna whose satellite is behind something there.
    pub(crate) fn share_hidden(&self, antenna: usize) -> f64 {
        let of_antenna = || self.satellites.iter().filter(|((of, _), _)| *of == antenna);
        let hidden: u64 = of_antenna().map(|(_, s)| s.hidden).sum();
        hidden as f64 / of_antenna().map(|(_, s)| s.epochs).sum::<u64>().max(1) as f64
    }
}

impl HiddenRow {
    /// `at A1 G05 (azimuth 122°, elevation 31°) is weaker by 9 dB in 40 of 61 epochs`
    pub(crate) fn sentence(&self) -> String {
        let Self { antenna, satellite, azimuth_deg, elevation_deg, missing_db, epochs, of } = self;
        format!(
            "at {antenna} {satellite} (azimuth {azimuth_deg:.0}°, elevation {elevation_deg:.0}°) is weaker by \
             {missing_db:.0} dB in {epochs} of {of} epochs"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(
        antenna: usize,
        satellite: &str,
        azimuth_deg: f64,
        missing_db: f64,
    ) -> SignalResidual {
        SignalResidual {
            antenna,
            satellite: satellite.parse().unwrap(),
            signal: "G1C".parse().unwrap(),
            azimuth_rad: azimuth_deg.to_radians(),
            elevation_rad: 31f64.to_radians(),
            code_m: None,
            phase_m: None,
            missing_db,
        }
    }

    #[test]
    fn a_satellite_behind_something_at_one_antenna_is_named() {
        let mut views = Views::default();
        // About north: the mean azimuth of 359° and 1° is not 180°.
        for (azimuth_deg, missing_db) in [(359.0, 8.0), (1.0, 10.0), (3.0, 0.5)] {
            views.add(&[
                signal(0, "G05", azimuth_deg, 0.0),
                signal(1, "G05", azimuth_deg, missing_db),
                signal(1, "G05", azimuth_deg, 0.0),
                signal(1, "G07", 90.0, 1.0),
            ]);
        }
        let names = ["A0", "A1"].map(str::to_owned);
        let hidden = views.hidden(&names);
        assert_eq!(hidden.len(), 1);
        assert_eq!(
            hidden[0].sentence(),
            "at A1 G05 (azimuth 0°, elevation 31°) is weaker by 9 dB in 2 of 3 epochs"
        );
        assert!(views.of_antenna(0).is_empty());
        assert_eq!(views.of_antenna(1).len(), 4);
        assert_eq!((views.share_hidden(0), views.share_hidden(1)), (0.0, 2.0 / 6.0));
    }
}
