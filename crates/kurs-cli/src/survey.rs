//! `kurs survey`: where the antennas are on the body, from the array's own observations.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail};
use kurs::engine::{Constraint, Engine, Settings};
use kurs::observation::ArrayEpoch;
use kurs::orientation::survey::{Survey, SurveyedArray};
use kurs::solution::Status;

use crate::output::OutputFile;
use crate::progress::Progress;
use crate::solve::config::{self, Loaded, Overrides};
use crate::solve::{Input, antenna_names};

/// Antenna positions of an array from its own data, at rest or moving.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML) as for `kurs solve`; positions in it are not used, only compared.
    config: PathBuf,
    /// Sets a key of the table `solve`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder for array.toml.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// No progress and no closing table.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let overrides = Overrides { set: &args.set, ..Overrides::default() };
    let loaded = config::load(Some(&args.config), &overrides)?;
    let settings = Settings { array: None, constraint: Constraint::None, ..loaded.settings()? };
    let names = antenna_names(&loaded);
    let Input { navigation, mut streams, phase_centers, .. } = Input::open(&loaded)?;
    let mut engine = Engine::new(settings, navigation)?.with_phase_centers(phase_centers.mounts);

    let mut survey = Survey::new(names.len());
    let mut progress = Progress::start(args.quiet);
    let mut epoch = ArrayEpoch::default();
    while streams.next(&mut epoch)? {
        streams.news(&epoch).iter().for_each(|news| engine.insert(news));
        let row = engine.push(&epoch);
        survey.add(&row);
        progress.epoch(row.status == Status::Fixed);
    }
    progress.finish();

    let named = |error: kurs::orientation::geometry::GeometryError| {
        anyhow::anyhow!("{error} (antennas are counted from 0: {})", names.join(", "))
    };
    let array = survey.array().map_err(named).context(
        "too few epochs are fixed without known geometry; more satellites or bands help, or \
         measure by hand and compare with `kurs doctor`",
    )?;
    if array.fixes == 0 {
        bail!("no epoch has fixed baselines to all antennas");
    }
    let mut file = OutputFile::create(&args.out, "array.toml")?;
    file.write_all(block(&array, &names).as_bytes())?;
    file.finish()?;
    if !args.quiet {
        print!("{}", closing(&array, &loaded));
        println!("written to {}", args.out.join("array.toml").display());
    }
    Ok(ExitCode::SUCCESS)
}

/// `[[antenna]]` tables for a configuration.
fn block(array: &SurveyedArray, names: &[String]) -> String {
    let mut text = format!(
        "# Surveyed from {} fixed epochs, which count for {:.0} independent ones: the first antenna is\n\
         # the origin, x goes through the second, the next one off that line is in the x-y plane, z is\n\
         # down.\n",
        array.fixes, array.independent
    );
    let rows = names.iter().zip(&array.positions_m).zip(array.sd_m());
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
