//! What `solve`, `survey` and `doctor` are given: a configuration, or files that are told apart by
//! their content, with the keys and the part of the session that the command line sets.

use std::path::{Path, PathBuf};

use kurs_formats::fingerprint::Fingerprint;

use super::config::{self, Loaded, Overrides};
use super::found_files::FoundFiles;
use super::{Format, identity};
use crate::failure::UsageError;
use crate::pipe::InputFile;
use crate::window::Window;

/// The arguments.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct SessionArgs {
    /// Configuration file (TOML); or observation, navigation, orbit (SP3) and antenna (ANTEX) files
    /// in any order, `-` for standard input: their content tells what they are.
    #[arg(value_name = "FILE")]
    files: Vec<PathBuf>,
    /// An antenna: its name, observation file, and place on the body (m: forward, right, down).
    #[arg(long, value_name = "NAME=OBS[#ID][@X,Y,Z]")]
    antenna: Vec<String>,
    /// Navigation files.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    nav: Vec<PathBuf>,
    /// Sets a key of the table `solve`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    window: Window,
    /// Files of a manifest, in place of those that the configuration names for an antenna.
    #[arg(skip)]
    observations: Vec<(String, Vec<PathBuf>)>,
}

/// A configuration in force and the files that it came from.
pub(crate) struct Session {
    pub(crate) loaded: Loaded,
    /// The configuration file.
    file: Option<PathBuf>,
    /// Copies of pipes live as long as this.
    _files: Vec<InputFile>,
}

impl SessionArgs {
    /// A session of one configuration file.
    pub(crate) fn of_configuration(file: PathBuf) -> Self {
        Self { files: vec![file], ..Self::default() }
    }

    /// A session of one row of a manifest.
    pub(crate) fn of_manifest(
        files: Vec<PathBuf>,
        nav: Vec<PathBuf>,
        observations: Vec<(String, Vec<PathBuf>)>,
        set: Vec<String>,
    ) -> Self {
        Self { files, nav, observations, set, ..Self::default() }
    }

    /// Sorts the files and reads the configuration.
    pub(crate) fn load(&self) -> anyhow::Result<Session> {
        if [self.files.len(), self.nav.len(), self.antenna.len()] == [0; 3] {
            let expected = "give a configuration file, or the observation files of two antennas and --nav FILE";
            return Err(UsageError(expected.into()).into());
        }
        let files = InputFile::open_all(&self.files)?;
        let nav = InputFile::open_all(&self.nav)?;
        let found = FoundFiles::sort(&files, &nav, self.antenna.len())?;
        let given = found.antennas.len() + self.antenna.len();
        if given < 2 && found.configuration.is_none() {
            let text = "at least two antennas are needed for an attitude, found";
            return Err(UsageError(format!("{text} {given}; among the files are {found}")).into());
        }
        let overrides = Overrides {
            found: Some(&found),
            antennas: &self.antenna,
            observations: &self.observations,
            nav: &[],
            set: &self.set,
            window: self.window,
            is_live: false,
        };
        let file = found.configuration.clone();
        let loaded = config::load(file.as_deref(), &overrides)?;
        Ok(Session { loaded, file, _files: files.into_iter().chain(nav).collect() })
    }
}

impl Session {
    /// The text that stands for the keys in force, what is written, the program and the contents of all inputs, of
    /// which these are `known` by name.
    pub(crate) fn identity(&self, formats: &[Format], known: &[(String, Fingerprint)]) -> String {
        identity::of(&self.loaded, formats, known)
    }

    /// Every file that is read.
    pub(crate) fn inputs(&self) -> Vec<PathBuf> {
        self.loaded.inputs(self.file.as_deref().map(Path::new))
    }
}
