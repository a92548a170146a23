//! How noisy each receiver is on each band, against the noise model.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use kurs::signal::Band;
use kurs::sky::NoiseModel;
use kurs::solution::{EpochSolution, SignalResidual};
use serde::Serialize;

/// Receivers this many times noisier than the model are named.
const NOISY: f64 = 2.0;

/// Root mean square residuals of one receiver on one band, taken to the zenith, as multiples of the
/// noise model.
#[derive(Debug, Clone, Serialize)]
pub(super) struct NoiseRow {
    pub(super) antenna: String,
    pub(super) band: String,
    pub(super) code: Option<f64>,
    pub(super) phase: Option<f64>,
}

/// Sum of squares and their number.
type Squares = (f64, u32);

/// Every receiver on every band. Of two antennas the residuals are shared between both: they tell
/// the pair.
pub(super) fn noise(rows: &[EpochSolution], model: &NoiseModel, names: &[String]) -> Vec<NoiseRow> {
    let mut sums: BTreeMap<(usize, Band), [Squares; 2]> = BTreeMap::new();
    for residual in rows.iter().flat_map(EpochSolution::residuals) {
        let SignalResidual { antenna, signal, elevation_rad, code_m, phase_m, .. } = *residual;
        let of_band = sums.entry((antenna, signal.band)).or_default();
        let kinds = [(code_m, model.code_zenith_m), (phase_m, model.phase_zenith_m)];
        for ((sum, count), (value_m, expected_m)) in of_band.iter_mut().zip(kinds) {
            if let Some(value_m) = value_m {
                *sum += (value_m * elevation_rad.sin() / expected_m).powi(2);
                *count += 1;
            }
        }
    }
    let rms = |(sum, count): Squares| (count > 0).then(|| (sum / f64::from(count)).sqrt());
    let row = |((antenna, band), [code, phase]): ((usize, Band), [Squares; 2])| NoiseRow {
        antenna: names[antenna].clone(),
        band: band.to_string(),
        code: rms(code),
        phase: rms(phase),
    };
    sums.into_iter().map(row).collect()
}

/// The noisy ones in a sentence each.
pub(super) fn text(rows: &[NoiseRow]) -> String {
    let mut text = String::new();
    for NoiseRow { antenna, band, code, phase } in rows {
        let kinds = [("code", code), ("phase", phase)];
        let noisy = kinds.iter().filter_map(|(kind, times)| {
            let times = times.filter(|times| *times > NOISY)?;
            Some(format!("{kind} {times:.1} times"))
        });
        let noisy: Vec<String> = noisy.collect();
        if !noisy.is_empty() {
            let _ = writeln!(text, "{antenna} on {band}: {} the noise model", noisy.join(", "));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::engine::Settings;
    use kurs::solution::{Reason, SignalReport};
    use kurs::time::GpsTime;

    #[test]
    fn a_noisy_band_of_a_receiver_is_named() {
        let residual = |antenna: usize, signal: &str, code_m: f64| SignalResidual {
            antenna,
            satellite: "G05".parse().unwrap(),
            signal: signal.parse().unwrap(),
            azimuth_rad: 0.0,
            elevation_rad: core::f64::consts::FRAC_PI_2,
            code_m: Some(code_m),
            phase_m: Some(0.0015),
            missing_db: 0.0,
        };
        let mut row = EpochSolution::lost(GpsTime::default(), Reason::FewSatellites);
        let mut signals = SignalReport::default();
        signals.residuals =
            vec![residual(0, "G1C", 0.2), residual(1, "G1C", 0.1), residual(1, "G2W", -0.8)];
        row.signals = Some(signals);
        let names = ["A0", "A1"].map(str::to_owned);
        let rows = noise(&[row], &Settings::default().noise, &names);
        let code: Vec<f64> = rows.iter().filter_map(|row| row.code).collect();
        assert_eq!(code, [1.0, 0.5, 4.0]);
        assert!(rows.iter().all(|row| row.phase == Some(1.0)));
        assert_eq!(text(&rows), "A1 on G2: code 4.0 times the noise model\n");
    }
}
