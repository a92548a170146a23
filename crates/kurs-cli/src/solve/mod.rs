//! `kurs solve`: observation and navigation files in, attitude out.

pub(crate) mod config;
pub(crate) mod input;
mod nmea;
mod phase_centers;
mod review;
pub(crate) mod streams;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use kurs::antenna_calibration::MountedAntenna;
use kurs::engine::{Engine, Settings, SettingsError};
use kurs::ephemeris::NavigationData;
use kurs::frames::Vector;
use kurs::observation::ArrayEpoch;
use kurs::solution::{EpochSolution, Reason, Status};

use crate::failure::UsageError;
use crate::output;
use crate::progress::Progress;
use crate::summary::{Damage, Summary};
use crate::table::TableFormat;
use crate::tables::Tables;
use config::{Loaded, Overrides};
pub(crate) use input::{Input, antenna_names};
use nmea::NmeaLog;
use review::Review;
use streams::Streams;

/// Attitude, baselines and position from observation and navigation files.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML); not needed with --antenna and --nav.
    config: Option<PathBuf>,
    /// An antenna: its name, observation file, and place on the body (m: forward, right, down).
    #[arg(long, value_name = "NAME=OBS[#ID][@X,Y,Z]")]
    antenna: Vec<String>,
    /// Navigation files.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    nav: Vec<PathBuf>,
    /// Sets a key of the table `solve`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// Output formats.
    #[arg(long, value_enum, default_value = "csv", value_delimiter = ',')]
    format: Vec<Format>,
    /// Writes report.html: plots of the whole run on one page that needs no network.
    #[arg(long)]
    report: bool,
    /// Compares with the truth.csv of a simulation, and the ambiguities.csv beside it.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Prints every key in force and where its value comes from, and stops.
    #[arg(long)]
    explain: bool,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// Solves what was simulated, lays it against the truth and writes the report.
    pub(crate) fn of_simulation(
        config: PathBuf,
        truth: PathBuf,
        out: PathBuf,
        quiet: bool,
    ) -> Self {
        Self {
            config: Some(config),
            antenna: Vec::new(),
            nav: Vec::new(),
            set: Vec::new(),
            out,
            format: vec![Format::Csv],
            report: true,
            truth: Some(truth),
            explain: false,
            quiet,
        }
    }
}

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// attitude.csv, baselines.csv, points.csv
    Csv,
    /// The same rows as JSON lines.
    Jsonl,
    /// attitude.nmea: HDT, THS, PASHR, GGA.
    Nmea,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if args.config.is_none() && args.antenna.is_empty() {
        let expected = "give a configuration file, or --antenna NAME=OBS twice and --nav FILE";
        return Err(UsageError(expected.into()).into());
    }
    let overrides = Overrides { antennas: &args.antenna, nav: &args.nav, set: &args.set };
    let loaded = config::load(args.config.as_deref(), &overrides)?;
    let settings =
        Settings { residuals: args.report || args.truth.is_some(), ..loaded.settings()? };
    if args.explain {
        print!("{}", loaded.explain());
        return Ok(ExitCode::SUCCESS);
    }

    let Input { navigation, mut streams, phase_centers, mut damage } = Input::open(&loaded)?;
    if !args.quiet {
        phase_centers.tell();
    }
    let mut review = Review::new(args, &loaded, &navigation)?;
    let mut engine = engine(&loaded, settings, navigation, phase_centers.mounts)?;
    let mut outputs = Outputs::create(&args.out, &args.format, &loaded)?;
    let capable = streams.antennas_with_epochs() >= 2;

    let mut summary = Summary::new(antenna_names(&loaded));
    let mut progress = Progress::start(args.quiet);
    let mut epoch = ArrayEpoch::default();
    while streams.next(&mut epoch)? {
        streams.news(&epoch).iter().for_each(|news| engine.insert(news));
        let row = if capable { engine.push(&epoch) } else { not_capable(&epoch) };
        summary.add(&row, row.shared_satellites >= 4);
        outputs.write(&row)?;
        review.add(&row);
        progress.epoch(row.status == Status::Fixed);
    }
    let wall_s = progress.finish();

    damage.extend(streams.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)));
    if summary.epochs() == 0 {
        bail!("no epoch in any observation file ({}){}", streams.spans(), damaged(&damage));
    }
    let file = summary.file(loaded.text(), &damage, wall_s);
    output::write_json(&args.out, "summary.json", &file)?;
    outputs.finish()?;
    review.write(args, &loaded, &summary)?;

    if !args.quiet {
        print!("{}", closing(&summary, &damage, &args.out));
        print!("{}", review.text());
    }
    if summary.has_solution() {
        return Ok(ExitCode::SUCCESS);
    }
    bail!("{}", why_nothing(&summary, &streams, capable));
}

/// The engine of a configuration.
pub(crate) fn engine(
    loaded: &Loaded,
    settings: Settings,
    navigation: NavigationData,
    mounts: Vec<Option<MountedAntenna>>,
) -> anyhow::Result<Engine> {
    let unusable = |error: SettingsError| UsageError(error.to_string());
    let engine = Engine::new(settings, navigation).map_err(unusable)?.with_phase_centers(mounts);
    let Some(station) = &loaded.config.station else { return Ok(engine) };
    let [x, y, z] = station.position_ecef_m;
    Ok(engine.with_station(Vector::new(x, y, z)).map_err(unusable)?)
}

/// The row of an epoch of which no attitude can ever come: only one antenna has any observations.
fn not_capable(epoch: &ArrayEpoch) -> EpochSolution {
    let mut row = EpochSolution::lost(epoch.time, Reason::FewAntennas);
    row.status = Status::NotCapable;
    row.antennas = epoch.antennas.iter().flatten().count();
    row
}

/// Everything that is written row by row.
struct Outputs {
    tables: Vec<Tables>,
    nmea: Option<NmeaLog>,
}

impl Outputs {
    fn create(directory: &Path, formats: &[Format], loaded: &Loaded) -> anyhow::Result<Self> {
        let points: Vec<String> = loaded.config.point.iter().map(|p| p.name.clone()).collect();
        let mut tables = Vec::new();
        for (wanted, format) in
            [(Format::Csv, TableFormat::Csv), (Format::Jsonl, TableFormat::Jsonl)]
        {
            if formats.contains(&wanted) {
                let names = antenna_names(loaded);
                let created = Tables::create(directory, format, names, points.clone())?;
                tables.push(match loaded.config.station {
                    Some(_) => created.with_antennas(directory, format)?,
                    None => created,
                });
            }
        }
        let nmea =
            formats.contains(&Format::Nmea).then(|| NmeaLog::create(directory)).transpose()?;
        Ok(Self { tables, nmea })
    }

    fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        for tables in &mut self.tables {
            tables.write(row)?;
        }
        self.nmea.as_mut().map_or(Ok(()), |nmea| nmea.write(row))
    }

    fn finish(self) -> anyhow::Result<()> {
        for tables in self.tables {
            tables.finish()?;
        }
        self.nmea.map_or(Ok(()), NmeaLog::finish)
    }
}

/// What stands on the terminal at the end.
fn closing(summary: &Summary, damage: &[Damage], out: &Path) -> String {
    format!("{}{}\nwritten to {}\n", summary.text(), damaged(damage), out.display())
}

/// How much was damaged and where first, as a line of its own; nothing if nothing was.
fn damaged(damage: &[Damage]) -> String {
    damage.first().map_or_else(String::new, |first| {
        let Damage { file, line, what } = first;
        format!("\n{} damaged places, first: {file}:{line}: {what}", damage.len())
    })
}

/// Why not a single row has a solution.
fn why_nothing(summary: &Summary, streams: &Streams, capable: bool) -> String {
    if !capable {
        return format!("only one antenna has observations: {}", streams.spans());
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
