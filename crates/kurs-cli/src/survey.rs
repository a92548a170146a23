//! `kurs survey`: where the antennas are on the body, from the array's own observations.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

use anyhow::{Context, bail};
use kurs::engine::{Constraint, Engine, Settings};
use kurs::observation::ArrayEpoch;
use kurs::orientation::geometry::GeometryError;
use kurs::orientation::moved::Moved;
use kurs::orientation::survey::{Survey, SurveyedArray};
use serde::Serialize;

use crate::copies::Copies;
use crate::failure::ExitCode;
use crate::interrupt::Watch;
use crate::output::{self, OutputFile, OutputFolder};
use crate::page::Page;
use crate::progress::{Progress, Work};
use crate::solve::config::Loaded;
use crate::solve::session_args::SessionArgs;
use crate::solve::streams::Streams;
use crate::solve::{Input, antenna_names};

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &["array.toml", "survey.json", "report.html"];

/// Antenna positions of an array from its own data, at rest or moving.
///
/// Positions that the configuration has are not used, only compared.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Folder for array.toml.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/survey")]
    out: PathBuf,
    /// Writes report.html: the closing table on one page.
    #[arg(long)]
    report: bool,
    /// Prints the array as JSON in place of the closing table.
    #[arg(long)]
    json: bool,
    /// No progress and no closing table.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let session = args.session.load()?;
    let loaded = &session.loaded;
    let settings = Settings { array: None, constraint: Constraint::None, ..loaded.settings()? };
    let names = antenna_names(loaded);
    let folder = OutputFolder::begin(&args.out, OUTPUTS, &session.inputs())?;
    let Input { navigation, mut streams, phase_centers, .. } = Input::open(loaded)?;
    let mut engine = Engine::new(settings, navigation)?.with_phase_centers(phase_centers.mounts);

    let watch = Watch::begin();
    let survey = survey_rows(args.quiet, &mut streams, &mut engine, &watch, &names)?;
    let array = surveyed_array(&survey, &names).map_err(|why| watch.unless_interrupted(why))?;
    let mut file = OutputFile::create(folder.path(), "array.toml")?;
    file.write_all(block(&array, &names).as_bytes())?;
    file.finish()?;
    let surveyed = SurveyFile::new(&array, &names, watch.was_interrupted());
    output::write_json(folder.path(), "survey.json", &surveyed)?;
    let told = closing(&array, loaded);
    if args.report {
        let mut page = Page::new("Kurs: the array from its own data");
        page.columns(&told);
        page.paragraph(&format!("Made by kurs {}.", env!("CARGO_PKG_VERSION")));
        page.write(folder.path(), "report.html")?;
    }
    folder.publish()?;
    if args.json {
        output::print_json(&surveyed)?;
    } else if !args.quiet {
        let array = args.out.join("array.toml");
        output::print(format_args!("{told}written to {}\n", array.display()))?;
    }
    Ok(watch.status(ExitCode::SUCCESS))
}

/// Solves the session without known geometry.
fn survey_rows(
    quiet: bool,
    streams: &mut Streams,
    engine: &mut Engine,
    watch: &Watch,
    names: &[String],
) -> anyhow::Result<Survey> {
    let (mut survey, mut copies) = (Survey::new(names.len()), Copies::default());
    let mut progress = Progress::start(quiet, Work::SURVEY);
    let mut epoch = ArrayEpoch::default();
    while !watch.asks_to_end() && streams.next(&mut epoch)? {
        streams.news(&epoch).iter().for_each(|news| engine.insert(news));
        copies.add(&epoch);
        let row = engine.push(&epoch);
        survey.add(&row);
        progress.epoch(row.is_fixed(), || streams.share());
    }
    progress.finish();
    if let Some(text) = copies.text(names) {
        bail!("{text}");
    }
    Ok(survey)
}

fn surveyed_array(survey: &Survey, names: &[String]) -> anyhow::Result<SurveyedArray> {
    let named = |error: GeometryError| anyhow::anyhow!("{}", error.named(names));
    if let Some(moved) = survey.moved() {
        bail!("{}", moved_text(&moved, names));
    }
    let array = survey.array().map_err(named).context(
        "too few epochs are fixed without known geometry; more satellites or bands help, or \
         measure by hand and compare with `kurs doctor`",
    )?;
    if array.fixes == 0 {
        bail!("no epoch has fixed baselines to all antennas");
    }
    Ok(array)
}

/// Which antenna was moved, when, and by how much.
fn moved_text(moved: &Moved, names: &[String]) -> String {
    let antennas: Vec<&str> = moved.antennas.iter().map(|k| names[*k].as_str()).collect();
    let who = match antennas[..] {
        [only] => format!("antenna {only} was moved"),
        [] => "antennas were moved".to_owned(),
        _ => format!("antenna {} was moved", antennas.join(" or ")),
    };
    let changed = moved.distances.iter().map(|step| {
        format!(
            "{}-{} from {:.4} to {:.4} m ({:+.4} m)",
            names[step.first],
            names[step.second],
            step.before_m,
            step.after_m,
            step.after_m - step.before_m
        )
    });
    let [last, first] = moved.between;
    format!(
        "{who} between {last} and {first}, or its baselines are fixed wrongly on one side of that: {}; \
         survey either side alone, with --to {last} or --from {first}",
        changed.collect::<Vec<_>>().join(", ")
    )
}

/// `survey.json`.
#[derive(Debug, Serialize)]
struct SurveyFile<'a> {
    version: &'static str,
    fixes: usize,
    independent: f64,
    antennas: Vec<SurveyedAntenna<'a>>,
    interrupted: bool,
}

#[derive(Debug, Serialize)]
struct SurveyedAntenna<'a> {
    name: &'a str,
    position_m: [f64; 3],
    sd_m: [f64; 3],
    /// Scatter of one epoch.
    scatter_m: [f64; 3],
}

impl<'a> SurveyFile<'a> {
    fn new(array: &SurveyedArray, names: &'a [String], interrupted: bool) -> Self {
        let antenna = |(k, name): (usize, &'a String)| SurveyedAntenna {
            name,
            position_m: array.positions_m[k].xyz().into(),
            sd_m: array.sd_m[k],
            scatter_m: array.scatter_m[k],
        };
        Self {
            version: env!("CARGO_PKG_VERSION"),
            fixes: array.fixes,
            independent: array.independent,
            antennas: names.iter().enumerate().map(antenna).collect(),
            interrupted,
        }
    }
}

/// `[[antenna]]` tables for a configuration.
fn block(array: &SurveyedArray, names: &[String]) -> String {
    let mut text = format!(
        "# Surveyed from {} fixed epochs, which count for {:.0} independent ones: the first antenna is\n\
         # the origin, x goes through the second, the next one off that line is in the x-y plane, z is\n\
         # down.\n",
        array.fixes, array.independent
    );
    let rows = names.iter().zip(&array.positions_m).zip(&array.sd_m);
    for ((name, position), [x, y, z]) in rows {
        let p = position.xyz();
        let name = toml::Value::from(name.as_str());
        let _ = write!(
            text,
            "\n[[antenna]]\nname = {name}\nposition_m = [{:.4}, {:.4}, {:.4}] # sd {x:.4}, {y:.4}, {z:.4} m\n",
            p.x, p.y, p.z
        );
    }
    text
}

/// The table on the terminal; distances lie beside those of the configuration, if it has positions.
fn closing(array: &SurveyedArray, loaded: &Loaded) -> String {
    let names = antenna_names(loaded);
    let mut table = comfy_table::Table::new();
    table.load_preset(comfy_table::presets::NOTHING);
    table.set_header(["antenna", "forward m", "right m", "down m", "scatter of one epoch m"]);
    for ((name, position), [x, y, z]) in names.iter().zip(&array.positions_m).zip(&array.scatter_m)
    {
        let p = position.xyz();
        table.add_row([
            name.clone(),
            format!("{:.4}", p.x),
            format!("{:.4}", p.y),
            format!("{:.4}", p.z),
            format!("{x:.4} {y:.4} {z:.4}"),
        ]);
    }
    let mut text = format!(
        "{} fixed epochs, as good as {:.0} independent ones\n{table}\n",
        array.fixes, array.independent
    );
    let known: Option<Vec<_>> = loaded.config.antenna.iter().map(|a| a.position_m).collect();
    let Some(known) = known else { return text };
    for (j, second) in names.iter().enumerate() {
        for (i, first) in names.iter().enumerate().take(j) {
            let found_m = (array.positions_m[j] - array.positions_m[i]).norm();
            let square = |axis: usize| (known[j][axis] - known[i][axis]).powi(2);
            let known_m = (0..3).map(square).sum::<f64>().sqrt();
            let _ = writeln!(
                text,
                "{first}-{second}: {found_m:.4} m, in the configuration {known_m:.4} m, difference {:+.4} m",
                found_m - known_m
            );
        }
    }
    text
}
