//! `truth.csv` and `ambiguities.csv`.

use std::path::Path;

use kurs::frames::{Geodetic, enu_from_ned};
use kurs::time::GpsTime;
use kurs_sim::AmbiguityChange;
use kurs_sim::scenario::Body;
use kurs_sim::simulation::BodyTruth;

use crate::output::OutputFile;

/// The true state of one body, a row for each epoch.
pub(super) struct TruthTable {
    rows: csv::Writer<OutputFile>,
}

impl TruthTable {
    pub(super) fn create(directory: &Path, name: &str, body: &Body) -> anyhow::Result<Self> {
        let mut rows =
            csv::Writer::from_writer(OutputFile::create(directory, &format!("{name}.csv"))?);
        let fixed = [
            "gps_week",
            "tow_s",
            "heading_deg",
            "pitch_deg",
            "roll_deg",
            "latitude_deg",
            "longitude_deg",
            "height_m",
            "vel_north_mps",
            "vel_east_mps",
            "vel_down_mps",
        ];
        let mut header: Vec<String> = fixed.map(str::to_owned).to_vec();
        for antenna in body.antenna.iter().skip(1) {
            header.extend(["east", "north", "up"].map(|axis| format!("{}_{axis}_m", antenna.name)));
        }
        header.extend(body.antenna.iter().map(|antenna| format!("{}_clock_s", antenna.name)));
        rows.write_record(&header)?;
        Ok(Self { rows })
    }

    pub(super) fn write(&mut self, truth: &BodyTruth) -> anyhow::Result<()> {
        let place = Geodetic::from_ecef(truth.position_m);
        let attitude = &truth.attitude;
        let mut row = time_fields(truth.time).to_vec();
        for angle in [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad] {
            row.push(format!("{:.6}", angle.to_degrees()));
        }
        for angle in [place.latitude_rad, place.longitude_rad] {
            row.push(format!("{:.10}", angle.to_degrees()));
        }
        row.push(format!("{:.4}", place.height_m));
        row.extend(truth.velocity_mps.xyz().iter().map(|v| format!("{v:.5}")));
        for baseline in &truth.baselines_m {
            let enu = enu_from_ned() * *baseline;
            row.extend(enu.xyz().iter().map(|c| format!("{c:.5}")));
        }
        row.extend(truth.clocks_s.iter().map(|clock| format!("{clock:.12}")));
        self.rows.write_record(&row)?;
        Ok(())
    }

    pub(super) fn finish(self) -> anyhow::Result<()> {
        finish(self.rows)
    }
}

/// Whole cycles of every phase: a row where they are drawn or change.
pub(super) struct AmbiguityTable {
    rows: csv::Writer<OutputFile>,
}

impl AmbiguityTable {
    pub(super) fn create(directory: &Path) -> anyhow::Result<Self> {
        let mut rows = csv::Writer::from_writer(OutputFile::create(directory, "ambiguities.csv")?);
        rows.write_record([
            "gps_week",
            "tow_s",
            "antenna",
            "satellite",
            "signal",
            "cycles",
            "slip_cycles",
            "flagged",
        ])?;
        Ok(Self { rows })
    }

    pub(super) fn write(&mut self, changes: &[AmbiguityChange]) -> anyhow::Result<()> {
        for change in changes {
            let [week, tow] = time_fields(change.time);
            self.rows.write_record([
                week,
                tow,
                change.antenna.clone(),
                change.satellite.to_string(),
                change.signal.to_string(),
                change.cycles.to_string(),
                change.slip.map_or_else(String::new, |cycles| cycles.to_string()),
                change.flagged.to_string(),
            ])?;
        }
        Ok(())
    }

    pub(super) fn finish(self) -> anyhow::Result<()> {
        finish(self.rows)
    }
}

fn time_fields(time: GpsTime) -> [String; 2] {
    [time.week().to_string(), format!("{:.7}", time.tow_s())]
}

fn finish(rows: csv::Writer<OutputFile>) -> anyhow::Result<()> {
    let file = rows.into_inner().map_err(|error| anyhow::anyhow!("{}", error.error()))?;
    file.finish()
}
