//! The files of a session in any order: their content tells which is the configuration, which has
//! observations, ephemerides, or antenna calibrations.

use std::fmt;
use std::path::{Path, PathBuf};

use kurs_formats::content::Content;
use kurs_formats::logs::{self, LogPart};
use kurs_formats::source::{ReadError, Source};

use crate::failure::UsageError;
use crate::pipe::InputFile;

/// What was expected of a file that is of no known kind.
const EXPECTED: &str = "a configuration (TOML), observations (RINEX, or a log: UBX, RTCM 3, SBF), navigation \
    data, orbits (SP3) or antennas (ANTEX)";
/// Letters of a site in the names of IGS files: `ABMF00GLP_R_2024…`, and of the older
/// `abmf1760.24o`.
const SITE_OF_LONG_NAME: usize = 9;
const SITE_OF_SHORT_NAME: usize = 4;

/// What was found.
#[derive(Debug, Clone, Default)]
pub(crate) struct FoundFiles {
    pub(crate) configuration: Option<PathBuf>,
    /// In the order of the files.
    pub(crate) antennas: Vec<FoundAntenna>,
    /// Navigation data and orbits.
    nav: Vec<PathBuf>,
    /// Navigation data and orbits that `--nav` named.
    nav_option: Vec<PathBuf>,
    /// Antenna calibrations.
    pub(crate) antex: Vec<PathBuf>,
}

/// An antenna with its observation files.
#[derive(Debug, Clone)]
pub(crate) struct FoundAntenna {
    pub(crate) name: String,
    pub(crate) files: Vec<PathBuf>,
    /// The part that is meant, in a log that has several.
    pub(crate) part: Option<LogPart>,
    /// The site whose hours and days the files are, by their names.
    site: Option<String>,
}

/// What one file is for.
enum Purpose {
    Configuration,
    Observations(Vec<Option<LogPart>>),
    Navigation,
    Antennas,
}

impl FoundFiles {
    /// Looks into the files. `nav` are those after `--nav`, an option that takes every file behind
    /// it: where no antenna is `named` and there is no configuration, observations among them are
    /// antennas, those of logs if antennas are missing.
    pub(crate) fn sort(
        files: &[InputFile],
        nav: &[InputFile],
        named: usize,
    ) -> anyhow::Result<Self> {
        let mut found = Self::default();
        for file in files {
            found.take(file, purpose(file.path())?)?;
        }
        let mut logs = Vec::new();
        let may_be_antennas = named == 0 && found.configuration.is_none();
        for file in nav {
            match purpose(file.path()) {
                Ok(purpose @ Purpose::Observations(_)) if may_be_antennas => {
                    if is_log(file.path())? {
                        logs.push((file, purpose));
                    } else {
                        found.take(file, purpose)?;
                    }
                }
                // What cannot be used is reported where it is read.
                _ => found.nav_option.push(file.path().to_owned()),
            }
        }
        let are_missing = found.antennas.len() < 2;
        for (file, purpose) in logs {
            if are_missing {
                found.take(file, purpose)?;
            } else {
                found.nav_option.push(file.path().to_owned());
            }
        }
        Ok(found)
    }

    /// Navigation data from everywhere, and where it stands on the command line.
    pub(crate) fn navigation(&self) -> (Vec<PathBuf>, &'static str) {
        let origin = if self.nav.is_empty() { "--nav" } else { "command line" };
        (self.nav.iter().chain(&self.nav_option).cloned().collect(), origin)
    }

    fn take(&mut self, file: &InputFile, purpose: Purpose) -> Result<(), UsageError> {
        let path = file.path().to_owned();
        match purpose {
            Purpose::Navigation => self.nav.push(path),
            Purpose::Antennas => self.antex.push(path),
            Purpose::Observations(parts) => {
                let parts = if parts.is_empty() { vec![None] } else { parts };
                for part in parts {
                    self.take_antenna(file, part);
                }
            }
            Purpose::Configuration => {
                if let Some(other) = self.configuration.replace(path) {
                    return Err(UsageError(format!(
                        "two configurations, {} and {}: one is expected",
                        other.display(),
                        file.path().display()
                    )));
                }
            }
        }
        Ok(())
    }

    fn take_antenna(&mut self, file: &InputFile, part: Option<LogPart>) {
        let path = file.path().to_owned();
        let (name, is_site) = name_of(file.path());
        let name = part.map_or(name.clone(), |part| match part {
            LogPart::Receiver => format!("{name}-ubx"),
            LogPart::Antenna(id) => format!("{name}-{id}"),
            LogPart::Station(id) => format!("{name}-{id}"),
        });
        let site = (is_site && part.is_none()).then(|| name.clone());
        if let Some(antenna) = site.as_deref().and_then(|site| self.of_site(site, &path)) {
            antenna.files.push(path);
            return;
        }
        let is_taken = self.antennas.iter().any(|antenna| antenna.name == name);
        let name = if is_taken { self.free_name(&name, &path) } else { name };
        self.antennas.push(FoundAntenna { name, files: vec![path], part, site });
    }

    /// The antenna of which this file has another hour or day: with files beside it, or elsewhere under other names. Files
    /// of one name in two folders are those of two receivers that were named alike.
    fn of_site(&mut self, site: &str, file: &Path) -> Option<&mut FoundAntenna> {
        let is_of_site = |antenna: &FoundAntenna| antenna.site.as_deref() == Some(site);
        let is_beside = |other: &PathBuf| other.parent() == file.parent();
        let has_its_name = |other: &PathBuf| other.file_name() == file.file_name();
        let mut all = self.antennas.iter();
        let beside = all.position(|a| is_of_site(a) && a.files.iter().any(is_beside));
        let apart = |a: &FoundAntenna| is_of_site(a) && !a.files.iter().any(has_its_name);
        let index = beside.or_else(|| self.antennas.iter().position(apart))?;
        self.antennas.get_mut(index)
    }

    /// A name that no antenna has yet, for files of one name in several folders.
    fn free_name(&self, name: &str, file: &Path) -> String {
        let folder = file.parent().and_then(Path::file_name);
        let in_folder = folder.map(|folder| format!("{}-{name}", folder.to_string_lossy()));
        let counted = (2..).map(|count| format!("{name}-{count}"));
        let is_free = |name: &String| self.antennas.iter().all(|antenna| antenna.name != *name);
        in_folder.into_iter().chain(counted).find(is_free).unwrap_or_else(|| name.to_owned())
    }
}

impl fmt::Display for FoundFiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.antennas.iter().map(|antenna| antenna.name.as_str()).collect();
        let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        write!(
            f,
            "antennas: {names}; navigation files: {}; antenna calibrations: {}",
            self.nav.len() + self.nav_option.len(),
            self.antex.len()
        )
    }
}

fn is_log(path: &Path) -> Result<bool, ReadError> {
    Content::of_file(path).map(|content| content.is_log())
}

fn purpose(path: &Path) -> anyhow::Result<Purpose> {
    // What is missing is told as for any configuration.
    if path.extension().is_some_and(|extension| extension == "toml") {
        return Ok(Purpose::Configuration);
    }
    Ok(match Content::of_file(path)? {
        Content::Text(_) => Purpose::Configuration,
        Content::RinexObservation | Content::CompactRinex => Purpose::Observations(Vec::new()),
        Content::RinexNavigation | Content::Sp3 => Purpose::Navigation,
        Content::Antex => Purpose::Antennas,
        content if content.is_log() => of_log(path)?,
        Content::Nmea => {
            let text = "NMEA sentences hold coordinates, no observations: `kurs orient` takes them";
            return Err(UsageError(format!("{}: {text}", path.display())).into());
        }
        other => return Err(Source::open(path)?.wrong_content(other.to_string(), EXPECTED).into()),
    })
}

/// The antennas in a log; one without observations serves for its ephemerides.
fn of_log(path: &Path) -> Result<Purpose, ReadError> {
    let parts = logs::census(&mut Source::open(path)?)?.parts;
    Ok(match parts.len() {
        0 => Purpose::Navigation,
        1 => Purpose::Observations(Vec::new()),
        _ => Purpose::Observations(parts.into_iter().map(Some).collect()),
    })
}

/// Name of the antenna of a file, and whether it is that of a site, as IGS names have it.
fn name_of(file: &Path) -> (String, bool) {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.split('.').next().unwrap_or_default();
    let bytes = stem.as_bytes();
    let is_long = bytes.len() > SITE_OF_LONG_NAME + 3
        && bytes[..SITE_OF_LONG_NAME].iter().all(u8::is_ascii_alphanumeric)
        && matches!(
            &bytes[SITE_OF_LONG_NAME..SITE_OF_LONG_NAME + 3],
            [b'_', b'R' | b'S' | b'U', b'_']
        );
    let is_short = bytes.len() == SITE_OF_SHORT_NAME + 4
        && bytes[SITE_OF_SHORT_NAME..SITE_OF_SHORT_NAME + 3].iter().all(u8::is_ascii_digit)
        && name[stem.len()..].len() >= 4
        && name.as_bytes()[stem.len() + 1..stem.len() + 3].iter().all(u8::is_ascii_digit);
    match (is_long, is_short) {
        (true, _) => (stem[..SITE_OF_LONG_NAME].to_owned(), true),
        (_, true) => (stem[..SITE_OF_SHORT_NAME].to_owned(), true),
        _ => (stem.to_owned(), false),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn antennas_are_named_after_their_files() {
        let of = |file: &str| name_of(Path::new(file));
        assert_eq!(of("data/a0.rnx.gz"), ("a0".into(), false));
        assert_eq!(of("ABMF00GLP_R_20241760000_01D_30S_MO.crx.gz"), ("ABMF00GLP".into(), true));
        assert_eq!(of("abmf176a.24o"), ("abmf".into(), true));
        assert_eq!(of("boat2024.rnx"), ("boat2024".into(), false));
        assert_eq!(of("abmf1760.24d.gz"), ("abmf".into(), true));
    }

    #[test]
    fn files_of_one_name_in_two_folders_are_two_antennas() {
        let mut found = FoundFiles::default();
        for file in ["bow/obs.rnx", "stern/obs.rnx", "obs.rnx"] {
            found.take_antenna(&InputFile::open(Path::new(file)).unwrap(), None);
        }
        let names: Vec<&str> = found.antennas.iter().map(|a| a.name.as_str()).collect();
        assert_eq!(names, ["obs", "stern-obs", "obs-2"]);
        for hour in ["abmf176a.24o", "abmf176b.24o"] {
            found.take_antenna(&InputFile::open(Path::new(hour)).unwrap(), None);
        }
        assert_eq!((found.antennas.len(), found.antennas[3].files.len()), (4, 2));
    }

    /// Septentrio's receivers are all named SEPT, whatever their files are in.
    #[test]
    fn days_of_two_receivers_of_one_name_are_two_antennas() {
        let days = ["bow/SEPT0701.24o", "bow/SEPT0711.24o", "stern/SEPT0701.24o"];
        let more = ["stern/SEPT0711.24o", "days/072/SEPT0721.24o"];
        let mut found = FoundFiles::default();
        for file in days.iter().chain(&more) {
            found.take_antenna(&InputFile::open(Path::new(file)).unwrap(), None);
        }
        let of = |antenna: &FoundAntenna| (antenna.name.clone(), antenna.files.len());
        let found: Vec<_> = found.antennas.iter().map(of).collect();
        assert_eq!(found, [("SEPT".into(), 3), ("stern-SEPT".into(), 2)]);
    }
}
