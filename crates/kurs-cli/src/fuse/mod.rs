//! `kurs fuse`: GNSS and accelerometers on a rotating arm, from recordings or simulated.

mod config;
mod input;
mod rows;
mod simulated;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm_session::{ArmSession, SessionRow};
use kurs::observation::AntennaEpoch;

use crate::config_file;
use crate::failure::UsageError;
use crate::summary::Damage;
use crate::truth::Truth;
use config::Config;
use input::{Input, TimedSample};
use rows::Rows;

/// Attitude from one antenna and accelerometers on a rotating arm.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML).
    config: PathBuf,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// Compares with the truth.csv of a simulation.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Writes what the simulated arm would have recorded, with a configuration to fuse it, and stops.
    #[arg(long, value_name = "DIR")]
    write_inputs: Option<PathBuf>,
    /// No closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read(&args.config)?;
    let settings = config.session()?;
    let folder = args.config.parent().unwrap_or(Path::new(""));
    let mut truth = args.truth.clone();
    let input = match (&config.simulate, &config.nav) {
        (Some(simulate), None) => {
            let recording = simulated::recording(&config, simulate, &settings.filter)?;
            if let Some(directory) = &args.write_inputs {
                let made = simulated::write_inputs(directory, &config, &recording)?;
                println!("next: kurs fuse {}", made.display());
                return Ok(ExitCode::SUCCESS);
            }
            simulated::write_truth(&args.out, recording.clone())?;
            truth.get_or_insert_with(|| args.out.join(simulated::TRUTH));
            Input::simulated(folder, &config, recording)?
        }
        (None, Some(nav)) => Input::open(folder, &config, nav)?,
        _ => {
            let expected = "either [simulate], or [nav] with receiver.obs and accelerometer.file";
            return Err(UsageError(format!("{expected} must stand")).into());
        }
    };
    refuse_other_units(&settings.filter.arm, &input.samples)?;
    let truth = truth.map(|path| Truth::read(&path, &[])).transpose()?;
    let mut rows = Rows::create(&args.out, truth)?;
    let started = Instant::now();
    let session = ArmSession::new(settings, input.navigation.clone());
    let (damage, too_late) = fuse(session, input, &mut rows)?;
    let wall_s = started.elapsed().as_secs_f64();
    let finished = rows.finish(&args.out, &format!("{config:?}"), &damage, too_late, wall_s)?;
    if !args.quiet {
        println!("{}", finished.text);
        damage.iter().take(1).for_each(|d| println!("{} damaged places, first: {d}", damage.len()));
        println!("written to {}", args.out.display());
    }
    match (finished.has_solution, finished.main_reason) {
        (true, _) => Ok(ExitCode::SUCCESS),
        (false, Some(word)) => bail!("every epoch is lost, mostly because of `{word}`"),
        (false, None) => bail!("no epoch in any observation file"),
    }
}

/// Feeds both streams to the session, whichever is behind, and writes its rows; what was damaged,
/// and how many measurements came too late.
fn fuse(
    mut session: ArmSession,
    mut input: Input,
    rows: &mut Rows,
) -> anyhow::Result<(Vec<Damage>, usize)> {
    let samples = std::mem::take(&mut input.samples);
    let mut samples = samples.into_iter().peekable();
    let mut epoch = AntennaEpoch::default();
    let mut too_late = 0;
    while input.next_epoch(&mut epoch)? {
        let time_s = session.seconds(epoch.time);
        while let Some((at_s, sample)) = samples.next_if(|(at_s, _)| *at_s <= time_s) {
            too_late += usize::from(session.push_sample(at_s, sample).is_err());
            write_ready(rows, || session.next_row())?;
        }
        too_late += usize::from(session.push_epoch(std::mem::take(&mut epoch)).is_err());
        write_ready(rows, || session.next_row())?;
    }
    for (at_s, sample) in samples {
        too_late += usize::from(session.push_sample(at_s, sample).is_err());
    }
    write_ready(rows, || session.last_row())?;
    Ok((input.damage(), too_late))
}

fn write_ready(
    rows: &mut Rows,
    mut next: impl FnMut() -> Option<SessionRow>,
) -> anyhow::Result<()> {
    while let Some(row) = next() {
        rows.write(&row)?;
    }
    Ok(())
}

/// Refuses accelerometers whose size is not that of gravity and the arm's centripetal acceleration.
fn refuse_other_units(arm: &RotatingArm, samples: &[TimedSample]) -> anyhow::Result<()> {
    let mut norms: Vec<f64> = samples.iter().map(|(_, s)| s.specific_force_mps2.norm()).collect();
    norms.sort_by(f64::total_cmp);
    let Some(found) = norms.get(norms.len() / 2) else { bail!("no accelerometer sample") };
    let turning_mps2 = arm.speed_mps() * core::f64::consts::TAU * arm.rate_hz;
    let expected = turning_mps2.hypot(9.81);
    if (0.3..3.0).contains(&(found / expected)) {
        return Ok(());
    }
    let likely = [("g", 9.806_65), ("mg", 9.806_65e-3), ("cm/s²", 0.01)];
    let unit = likely.iter().find(|(_, one)| (0.5..2.0).contains(&(found * one / expected)));
    let hint = unit.map_or("is the unit in the header right?".to_owned(), |(unit, _)| {
        format!("the unit is probably {unit}, name it in the header")
    });
    bail!(
        "accelerometers read {found:.2} m/s² in the middle, gravity and the arm make about \
         {expected:.2} m/s²: {hint}"
    );
}
