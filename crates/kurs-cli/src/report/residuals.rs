//! What the solution leaves of the signals, gathered over the whole run: by satellite and signal,
//! and by place in the sky.

use std::collections::BTreeMap;

use kurs::signal::{Satellite, Signal, System};
use kurs::solution::SignalResidual;

/// Side of a cell of the sky, degrees.
const CELL_DEG: f64 = 2.0;

/// Number and sum of squares.
#[derive(Debug, Clone, Copy, Default)]
struct Squares {
    count: u64,
    sum: f64,
}

/// Satellite, elevation and azimuth in whole cells.
pub(super) type Cell = (Satellite, i64, i64);

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Residuals {
    /// Code and phase, m².
    by_signal: BTreeMap<(Signal, Satellite), [Squares; 2]>,
    /// Phase, m².
    by_cell: BTreeMap<Cell, Squares>,
}

/// Root mean square residuals of one signal.
pub(super) struct OfSignal {
    pub(super) signal: Signal,
    /// Satellite and RMS.
    pub(super) code_m: Vec<(Satellite, f64)>,
    pub(super) phase_m: Vec<(Satellite, f64)>,
}

/// A cell of the sky in which a satellite was.
pub(super) struct OfCell {
    pub(super) satellite: Satellite,
    pub(super) azimuth_rad: f64,
    pub(super) elevation_rad: f64,
    /// RMS of the phases.
    pub(super) phase_m: f64,
}

impl Squares {
    fn add(&mut self, value: f64) {
        self.count += 1;
        self.sum += value * value;
    }

    fn rms(self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum / self.count as f64).sqrt())
    }
}

impl Residuals {
    /// Takes the residuals of an epoch in.
    pub(super) fn add<'a>(&mut self, residuals: impl IntoIterator<Item = &'a SignalResidual>) {
        for residual in residuals {
            let key = (residual.signal, residual.satellite);
            let [code, phase] = self.by_signal.entry(key).or_default();
            if let Some(code_m) = residual.code_m {
                code.add(code_m);
            }
            if let Some(phase_m) = residual.phase_m {
                phase.add(phase_m);
                let place = [residual.elevation_rad, residual.azimuth_rad].map(cell);
                self.by_cell
                    .entry((residual.satellite, place[0], place[1]))
                    .or_default()
                    .add(phase_m);
            }
        }
    }

    /// A row for each signal, in the order of systems and bands.
    pub(super) fn by_signal(&self) -> Vec<OfSignal> {
        let mut rows: Vec<OfSignal> = Vec::new();
        for ((signal, satellite), [code, phase]) in &self.by_signal {
            if rows.last().is_none_or(|row| row.signal != *signal) {
                rows.push(OfSignal { signal: *signal, code_m: Vec::new(), phase_m: Vec::new() });
            }
            if let Some(row) = rows.last_mut() {
                row.code_m.extend(code.rms().map(|rms| (*satellite, rms)));
                row.phase_m.extend(phase.rms().map(|rms| (*satellite, rms)));
            }
        }
        rows
    }

    /// The cells in which phases of a system were left with residuals.
    pub(super) fn by_cell(&self, system: System) -> Vec<OfCell> {
        let of_system =
            self.by_cell.iter().filter(|((satellite, ..), _)| satellite.system == system);
        of_system
            .filter_map(|((satellite, elevation, azimuth), squares)| {
                Some(OfCell {
                    satellite: *satellite,
                    azimuth_rad: centre_rad(*azimuth),
                    elevation_rad: centre_rad(*elevation),
                    phase_m: squares.rms()?,
                })
            })
            .collect()
    }
}

/// The middle of a cell.
pub(super) fn centre_rad(cell: i64) -> f64 {
    ((cell as f64 + 0.5) * CELL_DEG).to_radians()
}

#[allow(clippy::cast_possible_truncation)] // at most some hundred cells
pub(super) fn cell(angle_rad: f64) -> i64 {
    (angle_rad.to_degrees() / CELL_DEG).floor() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_are_gathered_by_signal_and_by_place() {
        let residual = |satellite: &str, signal: &str, phase_m: Option<f64>| SignalResidual {
            antenna: 0,
            satellite: satellite.parse().unwrap(),
            signal: signal.parse().unwrap(),
            azimuth_rad: 45f64.to_radians(),
            elevation_rad: 31f64.to_radians(),
            code_m: Some(1.0),
            phase_m,
            missing_db: 0.0,
        };
        let mut residuals = Residuals::default();
        residuals.add(&[residual("G05", "G1C", Some(0.003)), residual("G05", "G2W", None)]);
        residuals.add(&[residual("G05", "G1C", Some(-0.004)), residual("E01", "E1C", Some(0.001))]);
        let rows = residuals.by_signal();
        let names: Vec<String> = rows.iter().map(|row| row.signal.to_string()).collect();
        assert_eq!(names.len(), 3, "{names:?}");
        let first = rows.iter().find(|row| row.signal.to_string() == "G1C").unwrap();
        assert!((first.phase_m[0].1 - 0.0125f64.sqrt() * 1e-1 / 10f64.sqrt()).abs() < 1e-9);
        let second = rows.iter().find(|row| row.signal.to_string() == "G2W").unwrap();
        assert!(second.phase_m.is_empty() && second.code_m[0].1 == 1.0);
        let cells = residuals.by_cell(System::Gps);
        assert_eq!(cells.len(), 1);
        assert!((cells[0].elevation_rad.to_degrees() - 31.0).abs() < 1e-9);
        assert!((cells[0].azimuth_rad.to_degrees() - 45.0).abs() < 1e-9);
    }
}
