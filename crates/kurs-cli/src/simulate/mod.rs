//! `kurs simulate`: a scenario in, observation and navigation files with the truth out.

#[cfg(test)]
mod every_key;
mod imu_files;
mod observation_files;
mod scenario_file;
mod stream;
mod truth_tables;

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::signal::Signal;
use kurs_formats::rinex::{ObservationFileHeader, write_navigation};
use kurs_sim::simulation::{SimulatedEpoch, Simulation};

use crate::failure::{ExitCode, UsageError};
use crate::interrupt::Watch;
use crate::output::{self, OutputFile, OutputFolder};
use crate::progress::{Progress, Work};
use crate::window::Window;
use observation_files::{ObservationFiles, file_name, signals_left_out};
use scenario_file::load;
use stream::StreamArgs;
use truth_tables::{AmbiguityTable, TruthTable};

/// Name of the navigation file.
const NAVIGATION: &str = "nav.rnx";

/// Observations of a simulated body with antennas, and the truth.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scenario file (TOML), or the name of a built-in one: roof-static, car, ship, uav, urban,
    /// few-satellites, leo, two-bodies, edge, canopy, street.
    scenario: PathBuf,
    /// Folder for the files.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/simulate")]
    out: PathBuf,
    /// Sets a key of the scenario, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    window: Window,
    #[command(flatten)]
    stream: StreamArgs,
    /// Prints what was written as JSON in place of the closing summary.
    #[arg(long)]
    json: bool,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder besides the files named after antennas.
const OUTPUTS: &[&str] =
    &["truth.csv", "ambiguities.csv", NAVIGATION, "kurs.toml", "fuse.toml", "imu.csv"];

impl Args {
    /// Simulates a built-in scenario.
    pub(crate) fn built_in(name: &str, out: PathBuf, quiet: bool) -> Self {
        let (set, window, stream) = (Vec::new(), Window::default(), StreamArgs::default());
        Self { scenario: name.into(), out, set, window, stream, json: false, quiet }
    }
}

/// A built-in scenario as live streams.
pub(crate) struct LiveScenario {
    simulation: Simulation,
    first_port: u16,
}

impl LiveScenario {
    /// Streams that will come from `first_port` on.
    pub(crate) fn built_in(name: &str, first_port: u16) -> anyhow::Result<Self> {
        let (scenario, attachments) = load(Path::new(name), &[])?;
        Ok(Self { simulation: Simulation::new(scenario, &attachments)?, first_port })
    }

    /// The `[[antenna]]` tables of `kurs live`.
    pub(crate) fn configuration(&self) -> String {
        stream::live_configuration(&self.simulation, self.first_port)
    }

    /// Sends everything at real time.
    pub(crate) fn send(mut self) -> anyhow::Result<()> {
        let (watch, args) = (Watch::begin(), StreamArgs::default());
        stream::send(&mut self.simulation, args, self.first_port, true, &watch)?;
        Ok(())
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.window.check()?;
    let (scenario, attachments) = load(&args.scenario, &args.set)?;
    let mut simulation = Simulation::new(scenario, &attachments)
        .map_err(|error| UsageError(format!("{}: {error}", args.scenario.display())))?;
    let watch = Watch::begin();
    if let Some(port) = args.stream.stream {
        let epochs = stream::send(&mut simulation, args.stream, port, args.quiet, &watch)?;
        if !args.quiet {
            output::print(format_args!("{epochs} epochs sent\n"))?;
        }
        return Ok(watch.status(ExitCode::SUCCESS));
    }
    let folder = OutputFolder::begin(&args.out, OUTPUTS, std::slice::from_ref(&args.scenario))?;
    let mut files = Files::default();
    let mut progress = Progress::start(args.quiet, Work::SIMULATE);
    let mut epoch = SimulatedEpoch::default();
    let (start, duration_s) = (simulation.start(), simulation.scenario().duration_s);
    let mut epochs = 0_usize;
    while !watch.asks_to_end() && simulation.next_epoch(&mut epoch) {
        let Some(time) = epoch.bodies.first().map(|body| body.truth.time) else { break };
        if !args.window.contains(time) {
            continue;
        }
        if files.antennas.is_empty() {
            files = Files::create(folder.path(), &simulation, &epoch)?;
        }
        files.write(&epoch)?;
        epochs += 1;
        progress.epoch(false, || Some((time - start) / duration_s.max(1e-9)));
    }
    progress.finish();
    if epochs == 0 {
        let why = anyhow!("no epoch of the scenario is inside --from and --to");
        return Err(watch.unless_interrupted(why));
    }
    files.finish()?;
    write_navigation_file(folder.path(), simulation.navigation())?;
    write_configurations(folder.path(), &simulation)?;
    let bodies = &simulation.scenario().body;
    let names = |word: &str, index: usize| of_body(word, index, &bodies[index]);
    imu_files::write(folder.path(), &simulation, names)?;
    folder.publish()?;
    if args.json {
        let (out, interrupted) = (args.out.display().to_string(), watch.was_interrupted());
        output::print_json(
            &serde_json::json!({ "epochs": epochs, "out": out, "interrupted": interrupted }),
        )?;
    } else if !args.quiet {
        output::print(closing(&args.out, epochs))?;
    }
    Ok(watch.status(ExitCode::SUCCESS))
}

/// The closing lines: what is there, and what to do with it.
fn closing(out: &Path, epochs: usize) -> String {
    let [solve, fuse, solved] = ["kurs.toml", "fuse.toml", "solved"].map(|name| out.join(name));
    let next = format!(
        "{epochs} epochs written to {}\nnext: kurs solve {}",
        out.display(),
        solve.display()
    );
    if fuse.is_file() {
        format!("{next} --out {}\nthen: kurs fuse {}\n", solved.display(), fuse.display())
    } else {
        format!("{next}\n")
    }
}

/// Everything that is written epoch by epoch.
#[derive(Default)]
struct Files {
    /// Antennas of all bodies in turn, then that of the station.
    antennas: Vec<ObservationFiles>,
    truth: Vec<TruthTable>,
    ambiguities: Option<AmbiguityTable>,
}

impl Files {
    fn create(
        directory: &Path,
        simulation: &Simulation,
        first: &SimulatedEpoch,
    ) -> anyhow::Result<Self> {
        let scenario = simulation.scenario();
        let mut files = Self::default();
        let create = |name: &str, header: &ObservationFileHeader| {
            let formats = &scenario.output.formats;
            for format in formats {
                let missing: Vec<String> = signals_left_out(*format, &header.signals)
                    .iter()
                    .map(Signal::to_string)
                    .collect();
                if !missing.is_empty() {
                    let missing = missing.join(", ");
                    eprintln!(
                        "{}: the format has no {missing}: left out",
                        file_name(name, *format)
                    );
                }
            }
            ObservationFiles::create(directory, name, formats, header, simulation.navigation())
        };
        for (index, (body, made)) in scenario.body.iter().zip(&first.bodies).enumerate() {
            for (antenna, observed) in body.antenna.iter().zip(&made.observed.antennas) {
                let first = observed.as_ref().map_or(made.observed.time, |o| o.time);
                let mut header = header(simulation, &antenna.name, antenna.signals.as_ref());
                (header.first, header.position_m) = (first, made.truth.position_m);
                files.antennas.push(create(&antenna.name, &header)?);
            }
            files.truth.push(TruthTable::create(directory, &of_body("truth", index, body), body)?);
        }
        if let Some(station) = &scenario.station {
            let mut header = header(simulation, &station.name, station.signals.as_ref());
            header.position_m = station.place.geodetic().to_ecef();
            files.antennas.push(create(&station.name, &header)?);
        }
        files.ambiguities = Some(AmbiguityTable::create(directory)?);
        Ok(files)
    }

    fn write(&mut self, epoch: &SimulatedEpoch) -> anyhow::Result<()> {
        let of_bodies =
            epoch.bodies.iter().flat_map(|body| body.observed.antennas.iter().flatten());
        for (files, observed) in self.antennas.iter_mut().zip(of_bodies.chain(&epoch.station)) {
            if !observed.observations.is_empty() {
                files.write(observed)?;
            }
        }
        for (table, body) in self.truth.iter_mut().zip(&epoch.bodies) {
            table.write(&body.truth)?;
        }
        self.ambiguities.as_mut().map_or(Ok(()), |table| table.write(&epoch.changes))
    }

    fn finish(self) -> anyhow::Result<()> {
        for files in self.antennas {
            for left_out in files.left_out() {
                eprintln!(
                    "note: {left_out}: the message has no room for a value (they are in {NAVIGATION})"
                );
            }
            files.finish()?;
        }
        for table in self.truth {
            table.finish()?;
        }
        self.ambiguities.map_or(Ok(()), AmbiguityTable::finish)
    }
}

/// What an observation file says of itself; time and place are filled in by the caller.
fn header(
    simulation: &Simulation,
    name: &str,
    own_signals: Option<&Vec<String>>,
) -> ObservationFileHeader {
    let scenario = simulation.scenario();
    let records = simulation.navigation().ephemerides.iter();
    let systems: Vec<_> = records.map(|record| record.satellite().system).collect();
    let names = own_signals.unwrap_or(&scenario.signals);
    let signals = names.iter().filter_map(|name| name.parse::<Signal>().ok());
    let channel = |record: &Ephemeris| match record {
        Ephemeris::Glonass(g) => Some((record.satellite().number, g.elements().channel)),
        Ephemeris::Kepler(_) => None,
    };
    ObservationFileHeader {
        marker: name.to_owned(),
        position_m: kurs::frames::Vector::new(0.0, 0.0, 0.0),
        interval_s: scenario.interval_s,
        first: simulation.start(),
        signals: signals.filter(|signal| systems.contains(&signal.band.system)).collect(),
        glonass_channels: simulation.navigation().ephemerides.iter().filter_map(channel).collect(),
    }
}

fn write_navigation_file(directory: &Path, navigation: &NavigationData) -> anyhow::Result<()> {
    let mut file = OutputFile::create(directory, NAVIGATION)?;
    write_navigation(&mut file, navigation)?;
    file.finish()
}

/// `truth` for the first body, `truth-NAME` for others.
fn of_body(word: &str, index: usize, body: &kurs_sim::scenario::Body) -> String {
    if index == 0 { word.to_owned() } else { format!("{word}-{}", body.name) }
}

/// A configuration of `kurs solve` for every body with two antennas.
fn write_configurations(directory: &Path, simulation: &Simulation) -> anyhow::Result<()> {
    use std::io::Write as _;
    let scenario = simulation.scenario();
    let Some(format) = scenario.output.formats.first() else { return Ok(()) };
    for (index, body) in scenario.body.iter().enumerate() {
        if body.antenna.len() < 2 {
            continue;
        }
        let mut file =
            OutputFile::create(directory, &format!("{}.toml", of_body("kurs", index, body)))?;
        for antenna in &body.antenna {
            writeln!(file, "[[antenna]]\nname = {:?}", antenna.name)?;
            writeln!(file, "obs = [{:?}]", file_name(&antenna.name, *format))?;
            writeln!(file, "position_m = {:?}\n", antenna.position_m)?;
        }
        writeln!(file, "[nav]\nfiles = [{NAVIGATION:?}]")?;
        if let Some(station) = &scenario.station {
            let position_m = station.place.geodetic().to_ecef().xyz();
            writeln!(file, "\n[station]\nobs = [{:?}]", file_name(&station.name, *format))?;
            writeln!(file, "position_ecef_m = {:?}", position_m.as_slice())?;
        }
        writeln!(file, "\n[solve]\narray_sd_m = {:?}", scenario.array_sd_m)?;
        file.finish()?;
    }
    Ok(())
}
