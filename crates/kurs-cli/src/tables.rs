//! The tables `attitude`, `baselines` and `points`: their columns, in the order that users' scripts
//! rely on, for every command that writes them.

use std::io::Write;
use std::path::Path;

use kurs::signal::SPEED_OF_LIGHT_MPS;
use kurs::solution::{AttitudeEstimate, EpochSolution, PointEstimate, PositionEstimate, Status};
use kurs::time::GpsTime;
use kurs::turn_rate::{AngleRates, TurnRate, course_rad};
use kurs_live::RelativeRow;
use nalgebra::Matrix3;

use crate::output::OutputFile;
use crate::table::{Table, TableFormat};

pub(crate) const ATTITUDE: &[&str] = &[
    "time_gpst",
    "gps_week",
    "tow_s",
    "status",
    "reason",
    "antennas",
    "satellites",
    "ambiguities",
    "heading_deg",
    "pitch_deg",
    "roll_deg",
    "heading_sd_deg",
    "pitch_sd_deg",
    "roll_sd_deg",
    "cov_hp_deg2",
    "cov_hr_deg2",
    "cov_pr_deg2",
    "success_rate",
    "ratio",
    "residual_rms_m",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "sd_north_m",
    "sd_east_m",
    "sd_down_m",
    "vel_north_mps",
    "vel_east_mps",
    "vel_down_mps",
    "clock_bias_m",
    "time_utc",
    "qw",
    "qx",
    "qy",
    "qz",
    "line_elevation_deg",
    "heading_rate_degps",
    "pitch_rate_degps",
    "roll_rate_degps",
    "heading_rate_sd_degps",
    "pitch_rate_sd_degps",
    "roll_rate_sd_degps",
    "course_deg",
];

pub(crate) const BASELINES: &[&str] = &[
    "time_gpst",
    "gps_week",
    "tow_s",
    "base",
    "rover",
    "status",
    "east_m",
    "north_m",
    "up_m",
    "length_m",
    "sd_east_m",
    "sd_north_m",
    "sd_up_m",
    "cov_en_m2",
    "cov_eu_m2",
    "cov_nu_m2",
];

pub(crate) const POINTS: &[&str] = &[
    "time_gpst",
    "gps_week",
    "tow_s",
    "name",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "sd_north_m",
    "sd_east_m",
    "sd_down_m",
    "status",
];

pub(crate) const RELATIVE: &[&str] = &[
    "time_gpst",
    "body",
    "peer",
    "heading_deg",
    "pitch_deg",
    "roll_deg",
    "heading_sd_deg",
    "pitch_sd_deg",
    "roll_sd_deg",
    "cov_hp_deg2",
    "cov_hr_deg2",
    "cov_pr_deg2",
    "east_m",
    "north_m",
    "up_m",
    "own_age_s",
    "peer_age_s",
    "status",
    "reason",
];

/// The table `attitude`, or one of another name with its columns.
#[derive(Debug)]
pub(crate) struct AttitudeTable<W = OutputFile> {
    table: Table<W>,
    turn_rate: TurnRate,
}

/// The tables of one run, in one format.
#[derive(Debug)]
pub(crate) struct Tables<W = OutputFile> {
    antennas: Vec<String>,
    points: Vec<String>,
    attitude_table: AttitudeTable<W>,
    baseline_table: Table<W>,
    point_table: Option<Table<W>>,
    /// Antennas by code differences to a station.
    antenna_table: Option<Table<W>>,
}

impl Tables {
    /// Starts the tables in `directory`; `points` is written only if there are any.
    pub(crate) fn create(
        directory: &Path,
        format: TableFormat,
        antennas: Vec<String>,
        points: Vec<String>,
    ) -> anyhow::Result<Self> {
        let table = |stem, columns| Table::create(directory, stem, format, columns);
        Ok(Self {
            attitude_table: AttitudeTable::create(directory, "attitude", format)?,
            baseline_table: table("baselines", BASELINES)?,
            point_table: (!points.is_empty()).then(|| table("points", POINTS)).transpose()?,
            antenna_table: None,
            antennas,
            points,
        })
    }

    /// The tables and `antennas` with them: coordinates of every antenna by code differences to a
    /// station, as `kurs orient` reads them.
    pub(crate) fn with_antennas(
        mut self,
        directory: &Path,
        format: TableFormat,
    ) -> anyhow::Result<Self> {
        self.antenna_table = Some(Table::create(directory, "antennas", format, POINTS)?);
        Ok(self)
    }

    /// Goes on with the tables in `directory`, and with the rates of the rows before.
    pub(crate) fn append(
        directory: &Path,
        antennas: Vec<String>,
        points: Vec<String>,
        with_antennas: bool,
        turn_rate: TurnRate,
    ) -> anyhow::Result<Self> {
        let table = |stem, columns| Table::append(directory, stem, columns);
        let optional = |is_wanted: bool, stem| is_wanted.then(|| table(stem, POINTS)).transpose();
        Ok(Self {
            attitude_table: AttitudeTable::append(directory, turn_rate)?,
            baseline_table: table("baselines", BASELINES)?,
            point_table: optional(!points.is_empty(), "points")?,
            antenna_table: optional(with_antennas, "antennas")?,
            antennas,
            points,
        })
    }

    /// What the rates of the next row follow from.
    pub(crate) fn into_turn_rate(self) -> TurnRate {
        self.attitude_table.turn_rate
    }

    /// Hands all rows on to the system.
    pub(crate) fn flush(&mut self) -> anyhow::Result<()> {
        self.attitude_table.table.flush()?;
        self.baseline_table.flush()?;
        self.point_table.as_mut().map_or(Ok(()), Table::flush)?;
        self.antenna_table.as_mut().map_or(Ok(()), Table::flush)
    }

    /// Gives the files their names.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.attitude_table.finish()?;
        self.baseline_table.finish()?;
        self.antenna_table.map_or(Ok(()), Table::finish)?;
        self.point_table.map_or(Ok(()), Table::finish)
    }
}

impl Tables<Vec<u8>> {
    /// Tables without files: CSV without header lines.
    pub(crate) fn in_memory(
        antennas: Vec<String>,
        points: Vec<String>,
        with_antennas: bool,
    ) -> Self {
        let table = |columns| Table::in_memory(TableFormat::Csv, columns);
        Self {
            attitude_table: AttitudeTable {
                table: table(ATTITUDE),
                turn_rate: TurnRate::default(),
            },
            baseline_table: table(BASELINES),
            point_table: (!points.is_empty()).then(|| table(POINTS)),
            antenna_table: with_antennas.then(|| table(POINTS)),
            antennas,
            points,
        }
    }

    /// The rows of `attitude`, `baselines`, `points` and `antennas` since the last call.
    pub(crate) fn take_text(&mut self) -> [Vec<u8>; 4] {
        let of = |table: &mut Option<Table<Vec<u8>>>| {
            table.as_mut().map(Table::take_text).unwrap_or_default()
        };
        [
            self.attitude_table.table.take_text(),
            self.baseline_table.take_text(),
            of(&mut self.point_table),
            of(&mut self.antenna_table),
        ]
    }
}

impl<W: Write> Tables<W> {
    /// Writes the rows of one epoch.
    pub(crate) fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        let time = TimeColumns::new(row.time);
        self.attitude_table.write(&time, row)?;
        self.write_baselines(&time, row)?;
        self.write_points(&time, row)
    }

    fn write_baselines(&mut self, time: &TimeColumns, row: &EpochSolution) -> anyhow::Result<()> {
        for baseline in &row.baselines {
            let t = &mut self.baseline_table;
            time.write(t);
            t.text(&self.antennas[baseline.base]);
            t.text(&self.antennas[baseline.rover]);
            t.text(baseline.status.word());
            for component in baseline.baseline_m.xyz().iter() {
                t.real(Some(*component), 5);
            }
            t.real(Some(baseline.baseline_m.norm()), 5);
            standard_deviations(t, Some(&baseline.covariance_m2), 5);
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                t.real(Some(baseline.covariance_m2[(i, j)]), 10);
            }
            t.end_row()?;
        }
        Ok(())
    }

    fn write_points(&mut self, time: &TimeColumns, row: &EpochSolution) -> anyhow::Result<()> {
        let status = row.status();
        if let Some(table) = &mut self.point_table {
            write_places(table, time, &row.points, &self.points, status)?;
        }
        if let Some(table) = &mut self.antenna_table {
            write_places(table, time, &row.by_code, &self.antennas, Status::Float)?;
        }
        Ok(())
    }
}

/// Coordinates of points or antennas, named by their index.
fn write_places(
    t: &mut Table<impl Write>,
    time: &TimeColumns,
    places: &[PointEstimate],
    names: &[String],
    status: Status,
) -> anyhow::Result<()> {
    for place in places {
        time.write(t);
        t.text(&names[place.index]);
        t.real(Some(place.geodetic.latitude_rad.to_degrees()), 10);
        t.real(Some(place.geodetic.longitude_rad.to_degrees()), 10);
        t.real(Some(place.geodetic.height_m), 4);
        standard_deviations(t, Some(&place.covariance_m2), 4);
        t.text(status.word());
        t.end_row()?;
    }
    Ok(())
}

impl AttitudeTable {
    /// Starts the table.
    pub(crate) fn create(
        directory: &Path,
        stem: &str,
        format: TableFormat,
    ) -> anyhow::Result<Self> {
        let table = Table::create(directory, stem, format, ATTITUDE)?;
        Ok(Self { table, turn_rate: TurnRate::default() })
    }

    /// Goes on with `attitude` in `directory`, where the rows before had these rates.
    fn append(directory: &Path, turn_rate: TurnRate) -> anyhow::Result<Self> {
        Ok(Self { table: Table::append(directory, "attitude", ATTITUDE)?, turn_rate })
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.table.finish()
    }
}

impl<W: Write> AttitudeTable<W> {
    /// Writes the row of one epoch; they come in the order of time.
    pub(crate) fn write(&mut self, time: &TimeColumns, row: &EpochSolution) -> anyhow::Result<()> {
        let rates = self.turn_rate.push(row);
        write_attitude(&mut self.table, time, row, &rates)
    }
}

/// Writes the row of one epoch, whose angles change with these rates.
pub(crate) fn write_attitude(
    t: &mut Table<impl Write>,
    time: &TimeColumns,
    row: &EpochSolution,
    rates: &AngleRates,
) -> anyhow::Result<()> {
    time.write(t);
    t.text(row.status().word());
    t.text(row.reason().map_or("", |reason| reason.word()));
    let integers = row.integers.as_ref();
    let ambiguities = integers.map_or(0, |integers| integers.ambiguities);
    for count in [row.antennas, row.satellites, ambiguities] {
        t.integer(i64::try_from(count).unwrap_or(i64::MAX));
    }
    attitude_columns(t, row.attitude());
    t.real(integers.and_then(|integers| integers.success_rate), 6);
    t.real(integers.and_then(|integers| integers.ratio), 3);
    t.real(row.residual_rms_m, 5);
    position_columns(t, row.position.as_ref());
    // The tag is by the receiver's clock: true time is the tag less the clock bias, if known.
    let bias_s =
        row.position.and_then(|p| p.clock_m).map_or(0.0, |clock_m| clock_m / SPEED_OF_LIGHT_MPS);
    let utc = row.time_utc.unwrap_or_else(|| (row.time + -bias_s).utc());
    t.text(&format!("{}Z", utc.iso(7)));
    let quaternion = row.attitude().and_then(|a| a.ned_from_body).map(|r| r.quaternion());
    for i in 0..4 {
        t.real(quaternion.map(|q| q[i]), 9);
    }
    let line_elevation = row.attitude().and_then(|a| a.line_elevation_rad);
    t.real(line_elevation.map(f64::to_degrees), 5);
    rates.iter().for_each(|rate| t.real(rate.map(|r| r.radps.to_degrees()), 5));
    rates.iter().for_each(|rate| t.real(rate.map(|r| r.sd_radps.to_degrees()), 5));
    let course = row.position.as_ref().and_then(course_rad);
    t.real(course.map(f64::to_degrees), 3);
    t.end_row()
}

/// `time_gpst, gps_week, tow_s`, made ready once for all rows of an epoch.
pub(crate) struct TimeColumns {
    gpst: String,
    week: i64,
    tow_s: f64,
    digits: usize,
}

impl TimeColumns {
    pub(crate) fn new(time: GpsTime) -> Self {
        let digits = if time.as_nanoseconds() % 1_000_000 == 0 { 3 } else { 7 };
        let gpst = time.calendar().iso(digits);
        Self { gpst, week: time.week(), tow_s: time.tow_s(), digits }
    }

    pub(crate) fn write(&self, t: &mut Table<impl Write>) {
        t.text(&self.gpst);
        t.integer(self.week);
        t.real(Some(self.tow_s), self.digits);
    }
}

/// Writes another body as seen from this one.
pub(crate) fn write_relative(t: &mut Table<impl Write>, row: &RelativeRow) -> anyhow::Result<()> {
    t.text(&TimeColumns::new(row.time).gpst);
    t.text(&row.body);
    t.text(&row.peer);
    let relative = row.relative.as_ref();
    angle_columns(
        t,
        relative.map_or([None; 3], |relative| relative.angles_rad),
        relative.map(|relative| &relative.covariance_rad2),
    );
    let between_m = relative.and_then(|relative| relative.east_north_up_m);
    (0..3).for_each(|axis| t.real(between_m.map(|m| m[axis]), 4));
    row.ages_s.iter().for_each(|age_s| t.real(*age_s, 4));
    t.text(row.status.word());
    t.text(&row.reason);
    t.end_row()
}

/// `heading_deg` to `cov_pr_deg2`
fn attitude_columns(t: &mut Table<impl Write>, attitude: Option<&AttitudeEstimate>) {
    let angles = attitude.map_or([None; 3], |a| [a.heading_rad, a.pitch_rad, a.roll_rad]);
    angle_columns(t, angles, attitude.map(|a| &a.covariance_rad2));
}

/// Three angles with their covariance.
fn angle_columns(
    t: &mut Table<impl Write>,
    angles: [Option<f64>; 3],
    covariance_rad2: Option<&Matrix3<f64>>,
) {
    for angle in angles {
        t.real(angle.map(f64::to_degrees), 5);
    }
    let degrees = 1f64.to_degrees();
    let covariance = covariance_rad2.map(|rad2| rad2 * degrees * degrees);
    for (i, angle) in angles.iter().enumerate() {
        t.real(angle.and(covariance).map(|c| c[(i, i)].sqrt()), 5);
    }
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        t.real(angles[i].and(angles[j]).and(covariance).map(|c| c[(i, j)]), 9);
    }
}

/// `latitude_deg` to `clock_bias_m`
fn position_columns(t: &mut Table<impl Write>, position: Option<&PositionEstimate>) {
    t.real(position.map(|p| p.geodetic.latitude_rad.to_degrees()), 10);
    t.real(position.map(|p| p.geodetic.longitude_rad.to_degrees()), 10);
    t.real(position.map(|p| p.geodetic.height_m), 4);
    standard_deviations(t, position.map(|p| &p.covariance_m2), 4);
    let velocity = position.and_then(|p| p.velocity_mps).map(|v| v.xyz());
    for i in 0..3 {
        t.real(velocity.map(|v| v[i]), 4);
    }
    t.real(position.and_then(|p| p.clock_m), 4);
}

fn standard_deviations(
    t: &mut Table<impl Write>,
    covariance: Option<&Matrix3<f64>>,
    decimals: usize,
) {
    for i in 0..3 {
        t.real(covariance.map(|c| c[(i, i)].sqrt()), decimals);
    }
}
