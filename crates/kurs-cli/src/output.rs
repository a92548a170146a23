//! Output files that are never half written: they go to a temporary name and are renamed, and the
//! files of a long run appear together or not at all.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read as _, Seek as _, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::Context;
use serde::Serialize;

use crate::failure::UsageError;

/// Begin of the name of the hidden folder in which a run makes its files; its process id follows.
const STAGING: &str = ".kurs.part";

/// A file in that folder, locked as long as the process lives: however it ends, and on whichever
/// machine that shares the folder, the system lets go of the lock.
const LOCK: &str = ".lock";

/// The file of a run that is given its place last, and taken away first.
pub(crate) const SUMMARY: &str = "summary.json";

/// Files and folders that are there only while they are made.
static TEMPORARIES: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn temporaries() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes what is in the making and ends the program: the end without the ordinary way out. The
/// list stays locked, so that a thread whose files are gone waits for that end, and does not come
/// before it with an error and a status of its own.
pub(crate) fn abandon(status: u8) -> ! {
    let temporaries = temporaries();
    temporaries.iter().for_each(|path| remove(path));
    std::process::exit(i32::from(status))
}

/// Removes a file or a folder; after a success there is nothing to remove.
fn remove(path: &Path) {
    let _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
}

/// A file or folder that is removed when this is dropped, and when the program must stop at once.
#[derive(Debug)]
pub(crate) struct Temporary(PathBuf);

impl Temporary {
    /// Takes charge of a path that exists, or is about to.
    pub(crate) fn new(path: PathBuf) -> Self {
        temporaries().insert(path.clone());
        Self(path)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        remove(&self.0);
        temporaries().remove(&self.0);
    }
}

/// The error where standard output takes nothing.
pub(crate) const UNPRINTED: &str = "standard output: cannot be written";

/// Prints a result: one that does not arrive, as on a full disk, is an error of the command.
pub(crate) fn print(text: impl Display) -> anyhow::Result<()> {
    let mut output = io::stdout().lock();
    write!(output, "{text}").and_then(|()| output.flush()).context(UNPRINTED)
}

/// Prints a value as indented JSON.
pub(crate) fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print(format_args!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Whether `--out` asks for standard output.
pub(crate) fn is_standard_output(out: &Path) -> bool {
    out.as_os_str() == "-"
}

/// Where the outputs of a run go: a folder, or for `-` one that is gone when its rows are printed.
#[derive(Debug)]
pub(crate) struct Destination {
    path: PathBuf,
    passing: Option<Temporary>,
}

impl Destination {
    /// As `--out` says.
    pub(crate) fn of(out: &Path) -> anyhow::Result<Self> {
        if !is_standard_output(out) {
            return Ok(Self { path: out.to_owned(), passing: None });
        }
        let path = std::env::temp_dir().join(format!("kurs-out-{}", std::process::id()));
        fs::create_dir(&path).with_context(|| format!("{}: cannot be made", path.display()))?;
        Ok(Self { passing: Some(Temporary::new(path.clone())), path })
    }

    /// The folder.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether rows go to standard output.
    pub(crate) const fn is_standard_output(&self) -> bool {
        self.passing.is_some()
    }

    /// Prints one of the files.
    pub(crate) fn print(self, name: &str) -> anyhow::Result<()> {
        let mut file = File::open(self.path.join(name))?;
        // Before the reader at the other end of the pipe has seen enough, which ends the program.
        drop(self);
        let mut output = io::stdout().lock();
        io::copy(&mut file, &mut output).and_then(|_| output.flush()).context(UNPRINTED)
    }
}

/// The outputs of one run: made in a hidden folder, given their places together by
/// [`OutputFolder::publish`]. Dropped before that it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct OutputFolder {
    target: PathBuf,
    /// Closed before its folder goes.
    lock: Option<File>,
    staging: Temporary,
    /// The target was not there before.
    is_new: bool,
}

impl OutputFolder {
    /// Prepares `target`: what an older run of the same command left there, under these names,
    /// goes; a `*` in a name stands for any letters.
    ///
    /// # Errors
    ///
    /// [`UsageError`] if one of the inputs would be lost that way.
    pub(crate) fn begin(target: &Path, names: &[&str], inputs: &[PathBuf]) -> anyhow::Result<Self> {
        refuse_inputs(target, names, inputs)?;
        let is_new = !target.exists();
        let staging = target.join(format!("{STAGING}{}", std::process::id()));
        if is_left_by_a_killed_run(&staging) {
            remove(&staging);
        }
        let made = fs::create_dir_all(&staging);
        made.with_context(|| format!("{}: cannot be made", target.display()))?;
        let staging = Temporary::new(staging);
        let lock = Some(locked(&staging.0)?);
        let folder = Self { target: target.to_owned(), lock, staging, is_new };
        let mut old: Vec<PathBuf> =
            fs::read_dir(target)?.flatten().map(|entry| entry.path()).collect();
        // Where the summary is, everything is.
        old.sort_by_key(|path| !path.ends_with(SUMMARY));
        for path in old {
            let Some(name) = path.file_name().and_then(|name| name.to_str()) else { continue };
            if name.starts_with(STAGING) && is_left_by_a_killed_run(&path) {
                remove(&path);
            }
            if is_one_of(name, names) && path.is_file() {
                fs::remove_file(&path)
                    .with_context(|| format!("{}: cannot be removed", path.display()))?;
            }
        }
        Ok(folder)
    }

    /// Where the files are to be made.
    pub(crate) fn path(&self) -> &Path {
        &self.staging.0
    }

    /// Gives all files their places.
    pub(crate) fn publish(self) -> anyhow::Result<()> {
        let mut names = Vec::new();
        for entry in fs::read_dir(self.path())? {
            names.push(entry?.file_name());
        }
        names.retain(|name| name != LOCK);
        // Where the summary is, everything is.
        names.sort_by_key(|name| (name == SUMMARY, name.clone()));
        for name in names {
            let (made, target) = (self.path().join(&name), self.target.join(&name));
            fs::rename(&made, &target)
                .with_context(|| format!("{}: cannot be written", target.display()))?;
        }
        Ok(())
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        drop(self.lock.take());
        remove(self.path());
        if self.is_new {
            // Only where it is empty.
            let _ = fs::remove_dir(&self.target);
        }
    }
}

/// The lock of a hidden folder; a file system that knows none has leftovers for ever.
fn locked(staging: &Path) -> anyhow::Result<File> {
    let path = staging.join(LOCK);
    let file = File::create(&path);
    let file = file.with_context(|| format!("{}: cannot be written", published(&path)))?;
    let _ = file.try_lock();
    Ok(file)
}

/// Whether a hidden folder belongs to a process that is no more: nobody holds its lock.
fn is_left_by_a_killed_run(staging: &Path) -> bool {
    let lock = File::options().write(true).open(staging.join(LOCK));
    lock.is_ok_and(|lock| lock.try_lock().is_ok())
}

fn is_one_of(name: &str, patterns: &[&str]) -> bool {
    patterns.iter().any(|pattern| match pattern.split_once('*') {
        Some((start, end)) => {
            name.len() >= start.len() + end.len() && name.starts_with(start) && name.ends_with(end)
        }
        None => name == *pattern,
    })
}

/// An input must not become an output by a slip of the hand.
fn refuse_inputs(target: &Path, names: &[&str], inputs: &[PathBuf]) -> Result<(), UsageError> {
    let Ok(target) = target.canonicalize() else { return Ok(()) };
    for input in inputs {
        let Ok(place) = input.canonicalize() else { continue };
        let name = place.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if place.parent() == Some(&target) && is_one_of(name, names) {
            return Err(UsageError(format!(
                "{}: this is one of the inputs, and would be overwritten: choose another --out",
                input.display()
            )));
        }
    }
    Ok(())
}

/// Name of a file when its run is done: without the hidden folder in which it is made.
fn published(file: &Path) -> String {
    let is_staging = |part: &Component| part.as_os_str().to_string_lossy().starts_with(STAGING);
    let parts = file.components().filter(|part| !is_staging(part));
    parts.collect::<PathBuf>().display().to_string()
}

/// A file in the making. Dropped without [`OutputFile::finish`] it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct OutputFile {
    writer: Option<BufWriter<File>>,
    /// After [`OutputFile::finish`] there is none with that name to be removed.
    /// Its name until it is finished; `None`: it has its own from the start.
    temporary: Option<Temporary>,
    target: PathBuf,
}

impl OutputFile {
    /// Starts `directory/name`; the directory is made if needed.
    pub(crate) fn create(directory: &Path, name: &str) -> anyhow::Result<Self> {
        fs::create_dir_all(directory)
            .with_context(|| format!("{}: cannot be made", directory.display()))?;
        let target = directory.join(name);
        let temporary = directory.join(format!(".{name}.part{}", std::process::id()));
        let temporary = Temporary::new(temporary);
        let file = File::create(&temporary.0)
            .with_context(|| format!("{}: cannot be written", published(&target)))?;
        let writer = Some(BufWriter::with_capacity(1 << 16, file));
        Ok(Self { writer, temporary: Some(temporary), target })
    }

    /// Goes on with a file that is there under its own name from the start; part of a line at its
    /// end, which a run that was killed may have left, goes. `true` if it was there and has
    /// anything in it.
    pub(crate) fn append(directory: &Path, name: &str) -> anyhow::Result<(Self, bool)> {
        fs::create_dir_all(directory)
            .with_context(|| format!("{}: cannot be made", directory.display()))?;
        let target = directory.join(name);
        let open = || -> io::Result<(File, u64)> {
            let file = File::options().read(true).append(true).create(true).open(&target)?;
            let length = whole_lines(&file)?;
            file.set_len(length)?;
            Ok((file, length))
        };
        let (file, length) =
            open().with_context(|| format!("{}: cannot be written", target.display()))?;
        let writer = Some(BufWriter::with_capacity(1 << 16, file));
        Ok((Self { writer, temporary: None, target }, length > 0))
    }

    /// Gives the file its name.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        self.flush()?;
        drop(self.writer.take());
        let Some(temporary) = &self.temporary else { return Ok(()) };
        fs::rename(&temporary.0, &self.target)
            .with_context(|| format!("{}: cannot be written", published(&self.target)))
    }

    /// What went wrong, with the name of the file.
    fn named(&self, error: &io::Error) -> io::Error {
        io::Error::new(error.kind(), format!("{}: {error}", published(&self.target)))
    }
}

/// Length of the file without part of a line at its end.
fn whole_lines(mut file: &File) -> io::Result<u64> {
    /// Longer than any row.
    const LAST: u64 = 64 * 1024;
    let length = file.metadata()?.len();
    let start = length.saturating_sub(LAST);
    file.seek(SeekFrom::Start(start))?;
    let mut end = Vec::new();
    file.read_to_end(&mut end)?;
    let whole = end.iter().rposition(|byte| *byte == b'\n').map_or(0, |at| at + 1);
    Ok(start + whole as u64)
}

/// Writes a value as `directory/name`, indented JSON.
pub(crate) fn write_json(
    directory: &Path,
    name: &str,
    value: &impl Serialize,
) -> anyhow::Result<()> {
    let mut file = OutputFile::create(directory, name)?;
    serde_json::to_writer_pretty(&mut file, value)?;
    file.finish()
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.writer.as_mut().map_or(Ok(0), |writer| writer.write(bytes));
        written.map_err(|error| self.named(&error))
    }

    fn flush(&mut self) -> io::Result<()> {
        let flushed = self.writer.as_mut().map_or(Ok(()), Write::flush);
        flushed.map_err(|error| self.named(&error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_of_an_unfinished_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = OutputFile::create(folder.path(), "a.csv").unwrap();
        file.write_all(b"half a row").unwrap();
        drop(file);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);

        let mut file = OutputFile::create(folder.path(), "a.csv").unwrap();
        file.write_all(b"a row\n").unwrap();
        file.finish().unwrap();
        assert_eq!(fs::read_to_string(folder.path().join("a.csv")).unwrap(), "a row\n");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn the_files_of_a_run_appear_together_and_old_ones_go() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out");
        let names = || -> Vec<String> {
            let entries = fs::read_dir(&target).unwrap();
            let mut names: Vec<String> =
                entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
            names.sort();
            names
        };
        let begun = OutputFolder::begin(&target, &["a.csv", "report.html"], &[]).unwrap();
        drop(begun);
        assert!(!target.exists(), "nothing is left of a run that failed");

        for old in ["a.csv", "report.html", "mine.txt"] {
            fs::create_dir_all(&target).unwrap();
            fs::write(target.join(old), "old").unwrap();
        }
        let begun = OutputFolder::begin(&target, &["a.csv", "report.html"], &[]).unwrap();
        let mut file = OutputFile::create(begun.path(), "a.csv").unwrap();
        file.write_all(b"new").unwrap();
        file.finish().unwrap();
        assert!(!target.join("a.csv").exists(), "not before all are there");
        begun.publish().unwrap();
        assert_eq!(names(), ["a.csv", "mine.txt"]);
        assert_eq!(fs::read_to_string(target.join("a.csv")).unwrap(), "new");

        let error = OutputFolder::begin(&target, &["a.csv"], &[target.join("a.csv")]).unwrap_err();
        assert!(error.is::<UsageError>() && error.to_string().contains("one of the inputs"));
        assert_eq!(names(), ["a.csv", "mine.txt"]);
    }

    /// Whatever the number of its process: that may be given again, or be one of another machine.
    #[test]
    fn what_a_killed_run_left_goes_and_what_a_run_makes_stays() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join(format!("{STAGING}1"));
        fs::create_dir(&left).unwrap();
        let alive = locked(&left).unwrap();
        drop(OutputFolder::begin(folder.path(), &[], &[]).unwrap());
        assert!(left.exists());
        drop(alive);
        drop(OutputFolder::begin(folder.path(), &[], &[]).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
