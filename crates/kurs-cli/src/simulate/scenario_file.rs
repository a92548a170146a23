//! Scenario files, the built-in ones too, and the files that they refer to.

use std::path::{Path, PathBuf};

use anyhow::Context;
use kurs::ephemeris::NavigationData;
use kurs_formats::source::Source;
use kurs_sim::motion::RecordedPose;
use kurs_sim::scenario::{MotionPlan, Place, Scenario};
use kurs_sim::simulation::Attachments;
use serde::Deserialize;

use crate::config_file;
use crate::failure::UsageError;
use crate::pipe::{self, InputFile, STANDARD_INPUT};
use crate::text_file::TextFile;

/// Scenarios that the program carries.
const BUILT_IN: [(&str, &str); 11] = [
    ("roof-static", include_str!("../../scenarios/roof-static.toml")),
    ("car", include_str!("../../scenarios/car.toml")),
    ("ship", include_str!("../../scenarios/ship.toml")),
    ("uav", include_str!("../../scenarios/uav.toml")),
    ("urban", include_str!("../../scenarios/urban.toml")),
    ("few-satellites", include_str!("../../scenarios/few-satellites.toml")),
    ("leo", include_str!("../../scenarios/leo.toml")),
    ("two-bodies", include_str!("../../scenarios/two-bodies.toml")),
    ("edge", include_str!("../../scenarios/edge.toml")),
    ("canopy", include_str!("../../scenarios/canopy.toml")),
    ("street", include_str!("../../scenarios/street.toml")),
];

/// Reads a scenario file, or a built-in scenario by its name, with the values of `--set`, and the
/// files that it refers to.
pub(crate) fn load(path: &Path, set: &[String]) -> anyhow::Result<(Scenario, Attachments)> {
    let name = path.to_string_lossy();
    let built_in = BUILT_IN.iter().find(|(known, _)| *known == name);
    // A folder may have the name of a built-in one.
    let is_there = (path.exists() && !path.is_dir()) || name == STANDARD_INPUT;
    let file = is_there.then(|| InputFile::open(path)).transpose()?;
    let scenario: Scenario = match (built_in, &file) {
        (_, Some(file)) => config_file::read_with(file.path(), set, "")?,
        (Some((_, text)), None) => config_file::parse_with(text, &name, set, "")?,
        _ => {
            let known: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
            let known = known.join(", ");
            let text = format!("{name}: no such file, and no built-in scenario ({known})");
            return Err(UsageError(text).into());
        }
    };
    let folder = file.map_or_else(PathBuf::new, |file| pipe::folder_of(file.path()));
    let attachments = attachments(&scenario, &folder)?;
    Ok((scenario, attachments))
}

fn attachments(scenario: &Scenario, folder: &Path) -> anyhow::Result<Attachments> {
    let mut attachments = Attachments::default();
    if let Some(file) = &scenario.sky.navigation {
        let mut data = NavigationData::default();
        let mut source = Source::open(folder.join(file))?;
        kurs_formats::navigation::read(&mut source, &mut data)?;
        attachments.navigation = Some(data);
    }
    for body in &scenario.body {
        attachments.recorded.push(match &body.motion {
            MotionPlan::Recorded { file } => Some(recorded(&folder.join(file))?),
            _ => None,
        });
    }
    Ok(attachments)
}

/// A row of a recorded motion.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    time_s: f64,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
    heading_deg: f64,
    pitch_deg: f64,
    roll_deg: f64,
}

fn recorded(path: &Path) -> anyhow::Result<Vec<RecordedPose>> {
    let file = TextFile::open(path)?;
    let mut poses = Vec::new();
    for row in csv::Reader::from_reader(file).deserialize() {
        let row: Row = row.with_context(|| path.display().to_string())?;
        let Row { latitude_deg, longitude_deg, height_m, .. } = row;
        poses.push(RecordedPose {
            time_s: row.time_s,
            place: Place { latitude_deg, longitude_deg, height_m },
            angles_deg: [row.heading_deg, row.pitch_deg, row.roll_deg],
        });
    }
    Ok(poses)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs_sim::simulation::{SimulatedEpoch, Simulation};

    /// Every built-in scenario runs and sees satellites with every antenna.
    #[test]
    fn built_in_scenarios_run() {
        for (name, _) in BUILT_IN {
            let (scenario, attachments) = load(Path::new(name), &[]).unwrap();
            let mut simulation = Simulation::new(scenario, &attachments).unwrap();
            let mut epoch = SimulatedEpoch::default();
            assert!(simulation.next_epoch(&mut epoch), "{name}");
            for body in &epoch.bodies {
                for antenna in body.observed.antennas.iter().flatten() {
                    let seen = antenna.observations.len();
                    // Houses leave a few of one band, an open sky twelve and more.
                    assert!(seen >= 8, "{name}: {seen} observations");
                }
            }
        }
    }

    #[test]
    fn an_unknown_scenario_is_wrong_usage() {
        let error = load(Path::new("boat"), &[]).unwrap_err();
        assert!(error.is::<UsageError>());
        assert!(error.to_string().contains("few-satellites"), "{error}");
    }
}
