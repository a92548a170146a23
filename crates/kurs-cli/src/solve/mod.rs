//! `kurs solve`: observation and navigation files in, attitude out.

mod backward;
pub(crate) mod config;
mod explain;
pub(crate) mod found_files;
mod identity;
pub(crate) mod input;
mod nmea;
mod origins;
pub(crate) mod phase_centers;
mod pos;
mod review;
pub(crate) mod session_args;
pub(crate) mod streams;

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use kurs::antenna_calibration::MountedAntenna;
use kurs::both_directions::BackwardRows;
use kurs::differential::Differential;
use kurs::engine::{Direction, Engine, Settings, SettingsError};
use kurs::ephemeris::NavigationData;
use kurs::frames::Vector;
use kurs::observation::ArrayEpoch;
use kurs::solution::{EpochSolution, Outcome, Reason};
use kurs_formats::nmea::Profile;

use crate::batch::FAILURE;
use crate::copies::Copies;
use crate::failure::{ExitCode, RequiredFix, UsageError};
use crate::interrupt::Watch;
use crate::output::{self, Destination, OutputFolder};
use crate::parquet_files;
use crate::pipe;
use crate::progress::{Progress, Work};
use crate::session_span::SessionSpan;
use crate::summary::{Damage, Summary, damaged};
use crate::table::TableFormat;
use crate::tables::Tables;
use crate::unobserved_bands::UnobservedBands;
use config::{DirectionKey, Loaded};
use explain::ExplainFormat;
pub(crate) use input::{Input, antenna_names};
use nmea::NmeaLog;
use pos::PosFiles;
use review::Review;
use session_args::SessionArgs;
use streams::Streams;

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &[
    FAILURE,
    "attitude.csv",
    "attitude.jsonl",
    "attitude.parquet",
    "attitude.nmea",
    "baselines.csv",
    "baselines.jsonl",
    "baselines.parquet",
    "points.csv",
    "points.jsonl",
    "points.parquet",
    "antennas.csv",
    "antennas.jsonl",
    "antennas.parquet",
    "position.pos",
    "baseline-*.pos",
    "summary.json",
    "report.html",
    "track.geojson",
    "track.kml",
];

/// Attitude, baselines and position from observation and navigation files.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Folder for the outputs; `-` writes the rows to standard output.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/solve")]
    out: PathBuf,
    /// Output formats.
    #[arg(long, value_enum, default_value = "csv", value_delimiter = ',')]
    format: Vec<Format>,
    /// Writes report.html: plots of the whole run on one page that needs no network; and the track
    /// for maps, track.geojson and track.kml.
    #[arg(long)]
    report: bool,
    /// Prints summary.json in place of the closing summary.
    #[arg(long)]
    json: bool,
    /// Compares with the truth.csv of a simulation, and the ambiguities.csv beside it.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Prints every key in force and where its value comes from, and stops; with `toml` as a
    /// configuration.
    #[arg(long, value_name = "FORMAT", value_enum, num_args = 0..=1, require_equals = true,
        default_missing_value = "text")]
    explain: Option<ExplainFormat>,
    #[command(flatten)]
    required_fix: RequiredFix,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// Solves a session of a manifest, whose status its caller tells.
    pub(crate) fn of_batch(session: SessionArgs, out: PathBuf, format: Vec<Format>) -> Self {
        Self {
            session,
            out,
            format,
            report: false,
            truth: None,
            json: false,
            explain: None,
            required_fix: RequiredFix::none(),
            quiet: true,
        }
    }

    /// Refuses several results for standard output.
    fn check_standard_output(&self) -> Result<(), UsageError> {
        if !output::is_standard_output(&self.out) {
            return Ok(());
        }
        match (self.format.len(), self.json) {
            (1, false) => Ok(()),
            (1, true) => Err(UsageError("--out - and --json both print: one is expected".into())),
            (found, _) => Err(UsageError(format!("--out - prints one --format, {found} found"))),
        }
    }

    /// Solves what was simulated, lays it against the truth and writes the report.
    pub(crate) fn of_simulation(
        config: PathBuf,
        truth: PathBuf,
        out: PathBuf,
        json: bool,
        quiet: bool,
    ) -> Self {
        Self {
            session: SessionArgs::of_configuration(config),
            out,
            format: vec![Format::Csv],
            report: true,
            truth: Some(truth),
            json,
            explain: None,
            required_fix: RequiredFix::default(),
            quiet,
        }
    }
}

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub(crate) enum Format {
    /// attitude.csv, baselines.csv, points.csv
    Csv,
    /// The rows of attitude.csv as JSON lines.
    Jsonl,
    /// attitude.nmea: GGA, RMC, VTG, ZDA, GST, HDT, ROT, XDR.
    Nmea,
    /// attitude.nmea as gpsd reads it: GGA, RMC, VTG, ZDA, PTNTHTM.
    #[value(name = "nmea:gpsd")]
    NmeaGpsd,
    /// All of them, PASHR, which has the standard deviations, and PTNL,AVR (not for gpsd).
    #[value(name = "nmea:survey")]
    NmeaSurvey,
    /// position.pos and baseline-A-B.pos, as RTKLIB writes solutions and RTKPLOT opens them.
    Pos,
    /// The rows as Parquet files (programs built with the feature `parquet`).
    Parquet,
}

impl Format {
    /// Refuses formats that this program was built without, and two that would be one file.
    ///
    /// # Errors
    ///
    /// [`UsageError`] that names the cargo feature, or the file.
    pub(crate) fn check(formats: &[Self]) -> Result<(), UsageError> {
        for (index, format) in formats.iter().enumerate() {
            let is_same = |other: &&Self| **other != *format && other.rows() == format.rows();
            if formats[..index].iter().any(|other| is_same(&other)) {
                return Err(UsageError(format!(
                    "--format: two of the formats are {}, one is expected",
                    format.rows()
                )));
            }
        }
        if formats.contains(&Self::Parquet) { parquet_files::check() } else { Ok(()) }
    }

    /// The file with the rows of the attitude.
    pub(crate) const fn rows(self) -> &'static str {
        match self {
            Self::Csv => "attitude.csv",
            Self::Jsonl => "attitude.jsonl",
            Self::Nmea | Self::NmeaGpsd | Self::NmeaSurvey => "attitude.nmea",
            Self::Pos => "position.pos",
            Self::Parquet => "attitude.parquet",
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    Format::check(&args.format)?;
    args.check_standard_output()?;
    let session = args.session.load()?;
    let loaded = &session.loaded;
    let settings =
        Settings { residuals: args.report || args.truth.is_some(), ..loaded.settings()? };
    if let Some(format) = args.explain {
        output::print(pipe::told(&loaded.explain(format)))?;
        return Ok(ExitCode::SUCCESS);
    }

    let destination = Destination::of(&args.out)?;
    let folder = OutputFolder::begin(destination.path(), OUTPUTS, &session.inputs())?;
    let mut input = Input::open(loaded)?;
    if !args.quiet {
        input.phase_centers.tell();
    }
    input.streams.keep_systems(|system| settings.wants_system(system));
    let mut results = Results::begin(args, loaded, &settings, &input.navigation, folder.path())?;
    let watch = Watch::begin();
    let backward = backward_rows(args, loaded, &settings, &input, &watch)?;
    let Input { navigation, mut streams, phase_centers, mut damage } = input;
    let mut engine = engine(loaded, settings, navigation, phase_centers.mounts)?;
    let mut progress = Progress::start(args.quiet, Work::SOLVE);
    solve_rows(&mut streams, &mut engine, backward, &watch, &mut progress, &mut results)?;
    let wall_s = progress.finish();

    let Results { outputs, review, mut summary, copies, spans, unobserved } = results;
    damage.extend(streams.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)));
    damage.extend(streams.late());
    damage.extend(input::misdated(loaded, &spans));
    damage.extend(input::station_trouble(loaded, engine.station_use()));
    if summary.epochs() == 0 {
        let (spans, damaged) = (streams.spans(), damaged(&damage));
        let why = anyhow!("no epoch in any observation file ({spans}){damaged}");
        return Err(watch.unless_interrupted(why));
    }
    if watch.was_interrupted() {
        summary.interrupt();
    }
    summary.miss_bands(&unobserved);
    outputs.finish()?;
    review.write(folder.path(), &session, &summary)?;
    let identity = session.identity(&args.format, &streams.fingerprints());
    let file = summary.file(&identity, &damage, wall_s);
    output::write_json(folder.path(), "summary.json", &file)?;
    folder.publish()?;

    match () {
        () if destination.is_standard_output() => destination.print(args.format[0].rows())?,
        () if args.json => output::print_json(&file)?,
        () if !args.quiet => {
            let told = closing(&summary, &damage, &args.out);
            output::print(format_args!("{told}{}", review.text()))?;
            if !watch.was_interrupted()
                && let Some(line) = review::in_one_line(loaded, &summary, &copies)
            {
                output::print(format_args!("{line}\n"))?;
            }
        }
        () => {}
    }
    if summary.has_solution() {
        return Ok(watch.status(args.required_fix.exit_code(&summary)));
    }
    let why = why_nothing(loaded, &summary, &streams, &unobserved);
    Err(watch.unless_interrupted(anyhow!("{why}")))
}

/// Whether an attitude can be solved: that takes two antennas.
fn is_capable(streams: &Streams) -> bool {
    streams.antennas_with_epochs() >= 2
}

/// The rows from the end of the session to its begin, where both directions are asked for.
fn backward_rows(
    args: &Args,
    loaded: &Loaded,
    settings: &Settings,
    input: &Input,
    watch: &Watch,
) -> anyhow::Result<BackwardRows> {
    if loaded.config.solve.direction == DirectionKey::Forward || !is_capable(&input.streams) {
        return Ok(BackwardRows::default());
    }
    let settings = Settings { direction: Direction::Backward, ..settings.clone() };
    let mounts = input.phase_centers.mounts.clone();
    let engine = engine(loaded, settings, input.navigation.clone(), mounts)?;
    let mut progress = Progress::start(args.quiet, Work::BACKWARD);
    let rows = backward::solve(loaded, &input.navigation, engine, watch, &mut progress)?;
    progress.finish();
    Ok(rows)
}

/// Solves epoch by epoch and joins each row with that of the backward run.
fn solve_rows(
    streams: &mut Streams,
    engine: &mut Differential,
    mut backward: BackwardRows,
    watch: &Watch,
    progress: &mut Progress,
    results: &mut Results,
) -> anyhow::Result<()> {
    let capable = is_capable(streams);
    let mut epoch = ArrayEpoch::default();
    while !watch.asks_to_end() && streams.next(&mut epoch)? {
        streams.news(&epoch).iter().for_each(|news| engine.insert(news));
        let row = if capable { engine.push(&epoch, None) } else { not_capable(&epoch) };
        let is_fixed = results.add(&epoch, backward.join(row))?;
        progress.epoch(is_fixed, || streams.share());
    }
    Ok(())
}

/// What comes of the epochs and their rows.
struct Results {
    outputs: Outputs,
    review: Review,
    summary: Summary,
    copies: Copies,
    /// The times of each antenna's epochs.
    spans: Vec<SessionSpan>,
    unobserved: UnobservedBands,
}

impl Results {
    fn begin(
        args: &Args,
        loaded: &Loaded,
        settings: &Settings,
        navigation: &NavigationData,
        folder: &Path,
    ) -> anyhow::Result<Self> {
        let names = antenna_names(loaded);
        Ok(Self {
            review: Review::new(args, loaded, navigation)?,
            outputs: Outputs::create(folder, &args.format, loaded)?,
            spans: names.iter().map(|_| SessionSpan::default()).collect(),
            summary: Summary::new(names),
            copies: Copies::default(),
            unobserved: UnobservedBands::of(settings.bands.as_deref()),
        })
    }

    /// Takes an epoch and its row; tells whether the row is fixed.
    fn add(&mut self, epoch: &ArrayEpoch, mut row: EpochSolution) -> anyhow::Result<bool> {
        self.unobserved.add(epoch);
        for (span, antenna) in self.spans.iter_mut().zip(&epoch.antennas) {
            antenna.iter().for_each(|own| span.add(own.time));
        }
        if self.copies.add(epoch) {
            refuse_zero_baseline(&mut row);
        }
        self.summary.add(&row, row.shared_satellites >= 4);
        self.outputs.write(&row)?;
        self.review.add(epoch, &row);
        Ok(row.is_fixed())
    }
}

/// Removes what a run left in its folder.
pub(crate) fn remove_result(folder: &Path) -> anyhow::Result<()> {
    if folder.exists() {
        drop(OutputFolder::begin(folder, OUTPUTS, &[])?);
    }
    Ok(())
}

/// The engine of a configuration, beside its station if it has one.
pub(crate) fn engine(
    loaded: &Loaded,
    settings: Settings,
    navigation: NavigationData,
    mounts: Vec<Option<MountedAntenna>>,
) -> anyhow::Result<Differential> {
    let unusable = |error: SettingsError| UsageError(in_keys(&error));
    let engine = Engine::new(settings, navigation).map_err(unusable)?.with_phase_centers(mounts);
    let station = loaded.config.station.as_ref();
    let station_m = station.and_then(|s| s.position_ecef_m).map(|[x, y, z]| Vector::new(x, y, z));
    Ok(Differential::new(engine, station_m).map_err(unusable)?)
}

/// The setting that the engine refuses, by its key in the configuration, angles in degrees.
fn in_keys(error: &SettingsError) -> String {
    let SettingsError::OutOfRange { field, found, low, high } = error else {
        return error.to_string();
    };
    let key = match field.strip_suffix("_rad") {
        Some(stem) => {
            let [found, low, high] =
                [found, low, high].map(|rad| (rad.to_degrees() * 1e9).round() / 1e9);
            return format!("{stem}_deg is {found}, expected {low} to {high} degrees");
        }
        None => match *field {
            "m_per_sqrt_s" => "random_walk_m",
            "code_zenith_m" => "code_sd_m",
            "phase_zenith_m" => "phase_sd_m",
            "channel_sd_m" => "glonass_channel_sd_m",
            as_it_is => as_it_is,
        },
    };
    let unit = if key.ends_with("_m") { " m" } else { "" };
    format!("{key} is {found}, expected {low} to {high}{unit}")
}

/// The row of an epoch of which no attitude can ever come: only one antenna has any observations.
fn not_capable(epoch: &ArrayEpoch) -> EpochSolution {
    let mut row = EpochSolution::lost(epoch.time, Reason::FewAntennas);
    row.outcome = Outcome::NotCapable;
    row.antennas = epoch.antennas.iter().flatten().count();
    row
}

/// An epoch whose antennas are one recording: its baselines are zero, which no array has.
pub(crate) fn refuse_zero_baseline(row: &mut EpochSolution) {
    row.refuse_attitude(Reason::Geometry);
}

/// Everything that is written row by row.
struct Outputs {
    directory: PathBuf,
    formats: Vec<Format>,
    tables: Vec<Tables>,
    nmea: Option<NmeaLog>,
    pos: Option<PosFiles>,
}

impl Outputs {
    fn create(directory: &Path, formats: &[Format], loaded: &Loaded) -> anyhow::Result<Self> {
        let points: Vec<String> = loaded.config.point.iter().map(|p| p.name.clone()).collect();
        let mut tables = Vec::new();
        // Parquet files are made of whole CSV files.
        let wants_csv = formats.iter().any(|f| matches!(f, Format::Csv | Format::Parquet));
        let wants_jsonl = formats.contains(&Format::Jsonl);
        for (is_wanted, format) in
            [(wants_csv, TableFormat::Csv), (wants_jsonl, TableFormat::Jsonl)]
        {
            if is_wanted {
                let names = antenna_names(loaded);
                let created = Tables::create(directory, format, names, points.clone())?;
                tables.push(match loaded.config.station {
                    Some(_) => created.with_antennas(directory, format)?,
                    None => created,
                });
            }
        }
        let profiles = [
            (Format::NmeaSurvey, Profile::Survey),
            (Format::NmeaGpsd, Profile::Gpsd),
            (Format::Nmea, Profile::Marine),
        ];
        let wanted = profiles.iter().find(|(format, _)| formats.contains(format));
        let nmea = wanted.map(|(_, profile)| NmeaLog::create(directory, *profile)).transpose()?;
        let pos = formats
            .contains(&Format::Pos)
            .then(|| {
                PosFiles::create(directory, &antenna_names(loaded), loaded.config.station.is_some())
            })
            .transpose()?;
        Ok(Self { directory: directory.to_owned(), formats: formats.to_vec(), tables, nmea, pos })
    }

    fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        for tables in &mut self.tables {
            tables.write(row)?;
        }
        self.pos.as_mut().map_or(Ok(()), |pos| pos.write(row))?;
        self.nmea.as_mut().map_or(Ok(()), |nmea| nmea.write(row))
    }

    fn finish(self) -> anyhow::Result<()> {
        for tables in self.tables {
            tables.finish()?;
        }
        if self.formats.contains(&Format::Parquet) {
            for stem in ["attitude", "baselines", "points", "antennas"] {
                let rows = self.directory.join(format!("{stem}.csv"));
                if rows.exists() {
                    parquet_files::write(&self.directory, stem)?;
                    if !self.formats.contains(&Format::Csv) {
                        std::fs::remove_file(rows)?;
                    }
                }
            }
        }
        self.pos.map_or(Ok(()), PosFiles::finish)?;
        self.nmea.map_or(Ok(()), NmeaLog::finish)
    }
}

/// What stands on the terminal at the end.
fn closing(summary: &Summary, damage: &[Damage], out: &Path) -> String {
    format!("{}{}\nwritten to {}\n", summary.text(), damaged(damage), out.display())
}

/// Why not a single row has a solution.
fn why_nothing(
    loaded: &Loaded,
    summary: &Summary,
    streams: &Streams,
    unobserved: &UnobservedBands,
) -> String {
    if streams.antennas_with_epochs() < 2 {
        return input::one_antenna(loaded, streams);
    }
    if let Some(text) = unobserved.nothing_left() {
        return text;
    }
    match summary.main_reason() {
        Some("few_antennas") => {
            format!("no epoch has two antennas, the files do not overlap: {}", streams.spans())
        }
        Some("no_ephemeris") => format!(
            "no ephemeris for the satellites in view: are the navigation data of the same day? {}",
            streams.spans()
        ),
        Some(word) => format!("every epoch is lost, mostly because of `{word}`"),
        None => "every epoch is lost".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_engine_refuses_is_told_by_keys() {
        let told = |change: fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            in_keys(&settings.check().unwrap_err())
        };
        let mask = told(|settings| settings.elevation_mask_rad = 95f64.to_radians());
        assert_eq!(mask, "elevation_mask_deg is 95, expected -5 to 89 degrees");
        let certain = told(|settings| settings.max_angle_sd_rad = 0.0);
        assert_eq!(certain, "max_angle_sd_deg is 0, expected 0.001 to 180 degrees");
        let survey = told(|settings| settings.array_sd_m = 11.0);
        assert_eq!(survey, "array_sd_m is 11, expected 0 to 10 m");
        let rate = told(|settings| settings.max_wrong_fix_rate = 0.0);
        assert_eq!(rate, "max_wrong_fix_rate is 0, expected 0.000000001 to 0.5");
    }
}
