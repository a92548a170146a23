//! Solutions as RTKLIB writes them, for RTKPLOT and what else reads `.pos` files: the position, and
//! each baseline as east, north and up.

use std::io::Write as _;
use std::path::Path;

use kurs::solution::{BaselineEstimate, EpochSolution, PositionEstimate, Status};
use kurs::time::GpsTime;
use nalgebra::Matrix3;

use crate::output::OutputFile;

/// Qualities of the format.
const FIX: u8 = 1;
const FLOAT: u8 = 2;
const DIFFERENTIAL: u8 = 4;
const SINGLE: u8 = 5;

/// With a station, a position is by carrier phase if its standard deviations are below this, m, …
const MAX_SD_BY_PHASE_M: f64 = 0.1;
/// … and by code differences below this, m; a receiver alone is not so good.
const MAX_SD_BY_CODE_M: f64 = 1.0;

/// `position.pos`, and `baseline-A-B.pos` for every antenna but the first.
#[derive(Debug)]
pub(super) struct PosFiles {
    position: OutputFile,
    baselines: Vec<OutputFile>,
    has_station: bool,
}

impl PosFiles {
    /// Starts the files in `directory`.
    pub(super) fn create(
        directory: &Path,
        antennas: &[String],
        has_station: bool,
    ) -> anyhow::Result<Self> {
        let mut position = OutputFile::create(directory, "position.pos")?;
        writeln!(
            position,
            "% program   : kurs {}\n%\n% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,4:dgps,5:single,\
             ns=# of satellites)\n%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   \
             sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio",
            env!("CARGO_PKG_VERSION")
        )?;
        let [first, others @ ..] = antennas else { return Err(anyhow::anyhow!("no antenna")) };
        let mut baselines = Vec::new();
        for other in others {
            let name = format!("baseline-{}-{}.pos", in_file_name(first), in_file_name(other));
            let mut file = OutputFile::create(directory, &name)?;
            writeln!(
                file,
                "% program   : kurs {}\n% baseline  : {first} to {other}\n%\n% (e/n/u-baseline=WGS84,Q=1:fix,\
                 2:float,ns=# of satellites)\n%  GPST                      e-baseline(m)  n-baseline(m)  \
                 u-baseline(m)   Q  ns   sde(m)   sdn(m)   sdu(m)  sden(m)  sdnu(m)  sdue(m) age(s)  ratio",
                env!("CARGO_PKG_VERSION")
            )?;
            baselines.push(file);
        }
        Ok(Self { position, baselines, has_station })
    }

    /// Writes the lines of one epoch; what it does not have has no line.
    pub(super) fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        if let Some(position) = &row.position {
            let quality = if self.has_station { quality(position) } else { SINGLE };
            let geodetic = &position.geodetic;
            writeln!(
                self.position,
                "{} {:14.9} {:14.9} {:10.4} {}",
                clock(row.time),
                geodetic.latitude_rad.to_degrees(),
                geodetic.longitude_rad.to_degrees(),
                geodetic.height_m,
                rest(quality, row, north_east_up(&position.covariance_m2))
            )?;
        }
        for baseline in row.baselines.iter().filter(|baseline| baseline.base == 0) {
            let file = baseline.rover.checked_sub(1).and_then(|k| self.baselines.get_mut(k));
            if let Some(file) = file {
                let [east, north, up] = baseline.baseline_m.xyz().into();
                let quality = quality_of_baseline(baseline);
                let rest = rest(quality, row, east_north_up(&baseline.covariance_m2));
                writeln!(file, "{} {east:14.4} {north:14.4} {up:14.4} {rest}", clock(row.time))?;
            }
        }
        Ok(())
    }

    /// Gives the files their names.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        self.position.finish()?;
        self.baselines.into_iter().try_for_each(OutputFile::finish)
    }
}

/// A name with nothing in it that a file name cannot have.
fn in_file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect()
}

/// `2024/06/24 08:20:00.000`
fn clock(time: GpsTime) -> String {
    time.calendar().iso(3).replace('-', "/").replace('T', " ")
}

/// Quality, satellites, standard deviations and roots of covariances, age, ratio.
fn rest(quality: u8, row: &EpochSolution, deviations_m: [f64; 6]) -> String {
    let deviations = deviations_m.map(|sd| format!("{sd:8.4}")).join(" ");
    let ratio = row.integers.as_ref().and_then(|integers| integers.ratio);
    let ratio = ratio.unwrap_or(0.0).min(999.9);
    format!("{quality:3} {:3} {deviations} {:6.2} {ratio:6.1}", row.satellites, 0.0)
}

fn quality(position: &PositionEstimate) -> u8 {
    let worst_m = (0..3).map(|k| position.covariance_m2[(k, k)].sqrt()).fold(0.0, f64::max);
    match worst_m {
        sd if sd < MAX_SD_BY_PHASE_M => FIX,
        sd if sd < MAX_SD_BY_CODE_M => DIFFERENTIAL,
        _ => SINGLE,
    }
}

const fn quality_of_baseline(baseline: &BaselineEstimate) -> u8 {
    match baseline.status {
        Status::Fixed => FIX,
        _ => FLOAT,
    }
}

/// `sdn sde sdu sdne sdeu sdun` of a covariance of north, east, down.
fn north_east_up(covariance: &Matrix3<f64>) -> [f64; 6] {
    let c = |i, j| covariance[(i, j)];
    // Up is the negative of down.
    [c(0, 0), c(1, 1), c(2, 2), c(0, 1), -c(1, 2), -c(2, 0)].map(signed_root)
}

/// `sde sdn sdu sden sdnu sdue` of a covariance of east, north, up.
fn east_north_up(covariance: &Matrix3<f64>) -> [f64; 6] {
    let c = |i, j| covariance[(i, j)];
    [c(0, 0), c(1, 1), c(2, 2), c(0, 1), c(1, 2), c(2, 0)].map(signed_root)
}

/// The format has the root of a covariance, with its sign.
fn signed_root(value: f64) -> f64 {
    value.abs().sqrt().copysign(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Vector;
    use kurs::solution::{IntegerReport, Reason};

    #[test]
    fn lines_are_those_of_rtklib() {
        let time = GpsTime::from_week_tow(2320, 113_400.2).unwrap();
        let mut row = EpochSolution::lost(time, Reason::Ratio);
        row.satellites = 9;
        let mut integers = IntegerReport::default();
        integers.ratio = Some(12.34);
        row.integers = Some(integers);
        let c = Matrix3::new(4.0, 0.09, -0.25, 0.09, 1.0, 0.0, -0.25, 0.0, 9.0);
        row.baselines.push(BaselineEstimate {
            base: 0,
            rover: 1,
            status: Status::Fixed,
            baseline_m: Vector::new(1.5, -2.25, 0.125),
            covariance_m2: c,
        });
        let folder = tempfile::tempdir().unwrap();
        let names = ["A 0".to_owned(), "A1".to_owned()];
        let mut files = PosFiles::create(folder.path(), &names, false).unwrap();
        files.write(&row).unwrap();
        files.finish().unwrap();
        let text = std::fs::read_to_string(folder.path().join("baseline-A_0-A1.pos")).unwrap();
        assert_eq!(
            text.lines().last().unwrap(),
            "2024/06/24 07:30:00.200         1.5000        -2.2500         0.1250   1   9   2.0000   \
             1.0000   3.0000   0.3000   0.0000  -0.5000   0.00   12.3"
        );
        let position = std::fs::read_to_string(folder.path().join("position.pos")).unwrap();
        assert!(position.lines().all(|line| line.starts_with('%')), "{position}");
        assert_eq!(north_east_up(&c), [2.0, 1.0, 3.0, 0.3, 0.0, 0.5]);
    }
}
