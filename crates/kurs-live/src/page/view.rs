//! What an epoch shows of the sky and of the array.

use std::collections::BTreeMap;

use kurs::link_noise::MAX_MISSING_DB;
use kurs::observation::ArrayEpoch;
use kurs::signal::Satellite;
use kurs::solution::EpochSolution;
use serde_json::{Value, json};

/// A satellite as an antenna receives it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Seen {
    satellite: Satellite,
    /// The strongest of its signals, dB-Hz.
    cn0_dbhz: Option<f64>,
    /// How much weaker than it should be, dB; `None` where it has no part in the row.
    missing_db: Option<f64>,
}

/// Where an antenna is from the first one, seen from above with the bow up, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Offset {
    antenna: usize,
    forward_m: f64,
    right_m: f64,
    up_m: f64,
    length_m: f64,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct View {
    /// Azimuth and elevation, rad, of the satellites that had a part in a row.
    directions: BTreeMap<Satellite, (f64, f64)>,
    antennas: Vec<Vec<Seen>>,
    offsets: Vec<Offset>,
}

impl View {
    /// Takes an epoch and its row.
    pub(super) fn take(&mut self, epoch: &ArrayEpoch, row: &EpochSolution) {
        let mut missing_db: BTreeMap<(usize, Satellite), f64> = BTreeMap::new();
        for residual in row.residuals() {
            let direction = (residual.azimuth_rad, residual.elevation_rad);
            self.directions.insert(residual.satellite, direction);
            let most = missing_db.entry((residual.antenna, residual.satellite)).or_default();
            *most = most.max(residual.missing_db);
        }
        let seen_by = |antenna: usize| {
            let mut cn0_dbhz: BTreeMap<Satellite, Option<f64>> = BTreeMap::new();
            let observed = epoch.antennas[antenna].iter().flat_map(|of| &of.observations);
            for observation in observed {
                let most = cn0_dbhz.entry(observation.satellite).or_default();
                *most = [*most, observation.cn0_dbhz].into_iter().flatten().reduce(f64::max);
            }
            let seen = |(satellite, cn0_dbhz)| Seen {
                satellite,
                cn0_dbhz,
                missing_db: missing_db.get(&(antenna, satellite)).copied(),
            };
            cn0_dbhz.into_iter().map(seen).collect()
        };
        self.antennas = (0..epoch.antennas.len()).map(seen_by).collect();
        let in_view = |satellite: &Satellite| {
            self.antennas.iter().flatten().any(|seen| seen.satellite == *satellite)
        };
        self.directions.retain(|satellite, _| in_view(satellite));
        if row.is_fixed() {
            self.offsets = offsets(row);
        }
    }

    /// `[[satellite, azimuth, elevation, C/N0, missing], …]` of each antenna.
    pub(super) fn sky(&self) -> Value {
        let tenth = |value: f64| (value * 10.0).round() / 10.0;
        let seen = |seen: &Seen| {
            let direction = self.directions.get(&seen.satellite);
            json!([
                seen.satellite.to_string(),
                direction.map(|(azimuth_rad, _)| tenth(azimuth_rad.to_degrees().rem_euclid(360.0))),
                direction.map(|(_, elevation_rad)| tenth(elevation_rad.to_degrees())),
                seen.cn0_dbhz.map(tenth),
                seen.missing_db.map(tenth),
            ])
        };
        let antennas = self.antennas.iter();
        let antennas: Vec<Vec<Value>> = antennas.map(|of| of.iter().map(seen).collect()).collect();
        json!({ "behind_db": MAX_MISSING_DB, "antennas": antennas })
    }

    pub(super) fn offsets(&self) -> Value {
        let millimetres = |value: f64| (value * 1e3).round() / 1e3;
        let offset = |offset: &Offset| {
            json!({
                "antenna": offset.antenna,
                "forward_m": millimetres(offset.forward_m),
                "right_m": millimetres(offset.right_m),
                "up_m": millimetres(offset.up_m),
                "length_m": millimetres(offset.length_m),
            })
        };
        self.offsets.iter().map(offset).collect::<Vec<_>>().into()
    }
}

/// The baselines turned by the heading alone; empty without one.
fn offsets(row: &EpochSolution) -> Vec<Offset> {
    let heading_rad = row.attitude().and_then(|attitude| attitude.heading_rad);
    let Some((sine, cosine)) = heading_rad.map(f64::sin_cos) else { return Vec::new() };
    let offset = |baseline: &kurs::solution::BaselineEstimate| {
        let (east, north, up) = {
            let enu = baseline.baseline_m.xyz();
            (enu.x, enu.y, enu.z)
        };
        Offset {
            antenna: baseline.rover,
            forward_m: north * cosine + east * sine,
            right_m: east * cosine - north * sine,
            up_m: up,
            length_m: (east * east + north * north + up * up).sqrt(),
        }
    };
    row.baselines.iter().map(offset).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Vector;
    use kurs::observation::{AntennaEpoch, Lock, Observation};
    use kurs::solution::{
        AttitudeEstimate, BaselineEstimate, Outcome, Reason, SignalReport, SignalResidual, Status,
    };
    use kurs::time::GpsTime;
    use nalgebra::Matrix3;

    /// Heading 90°: the second antenna, two metres east and one south of the first, is ahead and to
    /// the right.
    #[test]
    fn antennas_are_seen_from_above_and_satellites_by_antenna() {
        let time = GpsTime::from_week_tow(2300, 0.0).unwrap();
        let (satellite, signal) = ("G07".parse().unwrap(), "G1C".parse().unwrap());
        let observation = |name: &str, cn0_dbhz| Observation {
            satellite: name.parse().unwrap(),
            signal,
            pseudorange_m: None,
            phase_cycles: None,
            doppler_hz: None,
            cn0_dbhz: Some(cn0_dbhz),
            lock: Lock::default(),
        };
        let antenna =
            |observations| Some(AntennaEpoch { time, observations, ..AntennaEpoch::default() });
        let epoch = ArrayEpoch {
            time,
            antennas: vec![
                antenna(vec![observation("G07", 44.0), observation("G07", 47.25)]),
                antenna(vec![observation("G07", 36.0), observation("G09", 30.0)]),
                None,
            ],
            station: None,
        };
        let zero = Matrix3::zeros();
        let mut row = EpochSolution::lost(time, Reason::Slip);
        row.outcome = Outcome::Fixed {
            attitude: AttitudeEstimate {
                heading_rad: Some(90_f64.to_radians()),
                pitch_rad: None,
                roll_rad: None,
                covariance_rad2: zero,
                installation_rad2: zero,
                ned_from_body: None,
                line_elevation_rad: None,
            },
        };
        row.baselines = vec![BaselineEstimate {
            base: 0,
            rover: 1,
            status: Status::Fixed,
            baseline_m: Vector::new(2.0, -1.0, 0.5),
            covariance_m2: zero,
        }];
        let residual = |antenna, missing_db| SignalResidual {
            antenna,
            satellite,
            signal,
            azimuth_rad: 1.0,
            elevation_rad: 0.5,
            code_m: None,
            phase_m: None,
            missing_db,
        };
        let residuals = vec![residual(0, 0.0), residual(1, 8.0)];
        let mut signals = SignalReport::default();
        signals.residuals = residuals;
        row.signals = Some(signals);
        let mut view = View::default();
        view.take(&epoch, &row);
        let antennas = &view.sky()["antennas"];
        assert_eq!(antennas[0], json!([["G07", 57.3, 28.6, 47.3, 0.0]]));
        assert_eq!(
            antennas[1],
            json!([["G07", 57.3, 28.6, 36.0, 8.0], ["G09", null, null, 30.0, null]])
        );
        assert_eq!(antennas[2], json!([]));
        let offset = &view.offsets()[0];
        let found = ["forward_m", "right_m", "up_m", "length_m"].map(|key| offset[key].as_f64());
        assert_eq!(found, [2.0, 1.0, 0.5, 2.291].map(Some));
    }
}
