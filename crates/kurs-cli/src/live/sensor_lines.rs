//! The lines of an inertial sensor as they come: CSV as in the logs of `kurs fuse`.

use kurs::fusion::attitude::session::ImuSample;
use kurs_live::SampleLines;

use crate::fuse::gravity_check::{self, AT_REST_MPS2};
use crate::fuse::imu::Mounted;
use crate::sensor_log::Columns;

/// Accelerations that are enough to tell whether the unit of the header is right.
const LOOKED_AT: usize = 200;

/// One connection.
pub(super) struct SensorLines {
    mounted: Mounted,
    columns: Option<Columns>,
    /// The first line may be the end of one.
    is_first: bool,
    /// Sizes of the first accelerations, m/s².
    norms_mps2: Vec<f64>,
    /// What is wrong with all of them.
    refused: Option<String>,
}

impl SensorLines {
    /// `columns`: the header of lines that come without one.
    pub(super) fn new(mounted: Mounted, columns: Option<&str>) -> Result<Self, String> {
        let mut new =
            Self { mounted, columns: None, is_first: true, norms_mps2: Vec::new(), refused: None };
        new.columns = columns.map(|header| columns_of(&record(header))).transpose()?;
        Ok(new)
    }

    /// Refuses accelerometers in another unit when enough of them have been seen.
    fn look_at(&mut self, norm_mps2: f64) {
        if self.norms_mps2.len() < LOOKED_AT {
            self.norms_mps2.push(norm_mps2);
            if self.norms_mps2.len() == LOOKED_AT {
                let norms_mps2 = self.norms_mps2.clone();
                let judged = gravity_check::refuse_other_units(norms_mps2, AT_REST_MPS2);
                self.refused = judged.err().map(|error| error.to_string());
            }
        }
    }
}

impl SampleLines for SensorLines {
    fn sample(&mut self, line: &str) -> Result<Option<(f64, ImuSample)>, String> {
        let is_first = core::mem::replace(&mut self.is_first, false);
        if line.starts_with('#') {
            return Ok(None);
        }
        let record = record(line);
        if record.iter().any(|field| field == "time_s") {
            self.columns = Some(columns_of(&record)?);
            return Ok(None);
        }
        if is_first {
            return Ok(None);
        }
        if let Some(refused) = &self.refused {
            return Err(refused.clone());
        }
        let columns = self.columns.as_ref().ok_or(
            "no header (`time_s, gx_degps, …`) came before it: [imu] columns says what the columns are",
        )?;
        let row = columns.row(&record)?;
        if let Some(force) = row.accelerometer {
            self.look_at(force.norm());
        }
        Ok(Some(self.mounted.sample(&row)))
    }
}

fn record(line: &str) -> csv::StringRecord {
    line.split(',').map(str::trim).collect::<Vec<_>>().into()
}

fn columns_of(header: &csv::StringRecord) -> Result<Columns, String> {
    let columns = Columns::of_header(header)?;
    if columns.has_gyro() {
        Ok(columns)
    } else {
        Err("no gyro columns (gx_radps, gy_radps, gz_radps)".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuse::imu::ImuConfig;

    fn lines(columns: Option<&str>) -> SensorLines {
        let mounted = Mounted::new(std::path::Path::new(""), &ImuConfig::default()).unwrap();
        SensorLines::new(mounted, columns).unwrap()
    }

    #[test]
    fn lines_are_read_once_the_columns_are_known() {
        let mut lines = lines(None);
        assert_eq!(lines.sample("23.1,1,2,3"), Ok(None), "the end of a line");
        assert!(lines.sample("24.1,1,2,3").unwrap_err().contains("[imu] columns"));
        assert_eq!(lines.sample("time_s, gx_radps, gy_radps, gz_radps"), Ok(None));
        let (tow_s, sample) = lines.sample("100.25, 1, 2, 3").unwrap().unwrap();
        assert_eq!((tow_s, sample.rate_radps.unwrap().xyz().z), (100.25, 3.0));
        assert_eq!(lines.sample("# nothing"), Ok(None));
        for (line, part) in [("100.3,1,2", "column 4"), ("100.3,1,x,3", "`x`"), ("", "``")] {
            assert!(lines.sample(line).unwrap_err().contains(part), "{line}");
        }
        assert!(lines.sample("time_s,ax_mps2,ay_mps2,az_mps2").unwrap_err().contains("gyro"));
    }

    #[test]
    fn accelerations_in_another_unit_are_refused() {
        let header = "time_s,gx_radps,gy_radps,gz_radps,ax_mps2,ay_mps2,az_mps2";
        let mut lines = lines(Some(header));
        let last = (0..=LOOKED_AT + 1).map(|_| lines.sample("5.0,0,0,0,0,0,-1.0")).last().unwrap();
        assert!(last.unwrap_err().contains("probably g"));
    }
}
