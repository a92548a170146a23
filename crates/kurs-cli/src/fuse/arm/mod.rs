//! `kurs fuse` with `[arm]`: GNSS and accelerometers on a rotating arm, recorded or simulated.

mod config;
mod input;
mod rows;
mod simulated;

use std::time::Instant;

use anyhow::anyhow;
use kurs::fusion::arm::session::{ArmSession, SessionRow};
use kurs::observation::AntennaEpoch;

use super::{Args, Inputs};
use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::interrupt::Watch;
use crate::output::{self, OutputFolder};
use crate::pipe;
use crate::summary::Damage;
use crate::truth::Truth;
use crate::window::Window;
use config::Config;
use input::Input;
use rows::Rows;
use simulated::TRUTH;

/// Runs the command.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read_with(&args.config, &args.set, "filter")?;
    let settings = config.session()?;
    let folder = &pipe::folder_of(&args.config);
    let mut truth = args.truth.clone();
    let inputs = config.inputs(&args.config);
    let outputs = OutputFolder::begin(&args.out, super::OUTPUTS, &inputs)?;
    let mut input = match (&config.simulate, &config.nav) {
        (Some(simulate), None) => {
            let recording = simulated::recording(&config, simulate, &settings.filter)?;
            if let Some(directory) = &args.write_inputs {
                let made = simulated::write_inputs(directory, &config, &recording)?;
                output::print(format_args!("next: kurs fuse {}\n", made.display()))?;
                return Ok(ExitCode::SUCCESS);
            }
            simulated::write_truth(outputs.path(), recording.clone())?;
            truth.get_or_insert_with(|| outputs.path().join(TRUTH));
            Input::simulated(folder, &config, recording)?
        }
        (None, Some(nav)) => Input::open(folder, &config, nav)?,
        _ => {
            let expected = "either [simulate], or [nav] with receiver.obs and accelerometer.file";
            return Err(UsageError(format!("{expected} must stand")).into());
        }
    };
    input.refuse_other_units(&settings.filter.arm)?;
    let truth = truth.map(|path| Truth::read(&path, &[])).transpose()?;
    let mut rows = Rows::create(outputs.path(), truth, args.report)?;
    let started = Instant::now();
    let watch = Watch::begin();
    let session = ArmSession::new(settings, input.navigation.clone());
    let (damage, too_late) = fuse(session, input, &mut rows, &args.window, &watch)?;
    let from = Inputs {
        files: &inputs,
        is_interrupted: watch.was_interrupted(),
        configuration: format!("{config:?}"),
        damage: &damage,
        too_late,
        wall_s: started.elapsed().as_secs_f64(),
    };
    let finished = rows.finish(outputs.path(), &from)?;
    outputs.publish()?;
    args.conclude(&finished.text, &damage)?;
    let why = match (finished.has_solution, finished.main_reason) {
        (true, _) => return Ok(watch.status(ExitCode::SUCCESS)),
        (false, Some(word)) => anyhow!("every epoch is lost, mostly because of `{word}`"),
        (false, None) => anyhow!("no epoch in any observation file"),
    };
    Err(watch.unless_interrupted(why))
}

/// Feeds both streams to the session, whichever is behind, and writes its rows; what was damaged,
/// and how many measurements came too late.
fn fuse(
    mut session: ArmSession,
    mut input: Input,
    rows: &mut Rows,
    window: &Window,
    watch: &Watch,
) -> anyhow::Result<(Vec<Damage>, usize)> {
    let mut epoch = AntennaEpoch::default();
    let mut too_late = 0;
    while !watch.asks_to_end() && input.next_epoch(&mut epoch)? {
        if !window.contains(epoch.time) {
            continue;
        }
        let time_s = session.seconds(epoch.time);
        while let Some((at_s, sample)) = input.next_sample_before(time_s) {
            too_late += usize::from(session.push_sample(at_s, sample).is_err());
            write_ready(rows, || session.next_row())?;
        }
        too_late += usize::from(session.push_epoch(std::mem::take(&mut epoch)).is_err());
        write_ready(rows, || session.next_row())?;
    }
    let end_s = if watch.was_interrupted() { 0.0 } else { f64::INFINITY };
    while let Some((at_s, sample)) = input.next_sample_before(end_s) {
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
