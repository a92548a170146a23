//! `-` and pipes as input: what can be read only once is copied to a temporary file, for its
//! content is looked at before it is read.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::Context;
use kurs_formats::source::can_be_read_again;

use crate::output::Temporary;

/// The word for standard input.
pub(crate) const STANDARD_INPUT: &str = "-";

/// Copies of pipes, by their paths, and what the pipes are called. A name outlives its copy: the
/// message that ends a command is told when its files are gone.
static NAMES: Mutex<Vec<(String, String)>> = Mutex::new(Vec::new());

fn names() -> MutexGuard<'static, Vec<(String, String)>> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A text in which copies of pipes are called what the user called the pipes.
pub(crate) fn told(text: &str) -> String {
    names().iter().fold(text.to_owned(), |text, (copy, name)| text.replace(copy, name))
}

/// What the user calls a file.
pub(crate) fn named(path: &Path) -> String {
    told(&path.display().to_string())
}

/// The folder from which the paths in a file start: that of the file, of a pipe the working folder.
pub(crate) fn folder_of(path: &Path) -> PathBuf {
    let is_copy = names().iter().any(|(copy, _)| Path::new(copy) == path);
    let folder = path.parent().filter(|_| !is_copy);
    folder.map_or_else(PathBuf::new, Path::to_path_buf)
}

/// A file that can be read again and again: the one that was given, or the copy of what came
/// through a pipe, which lives as long as this.
#[derive(Debug, Clone)]
pub(crate) struct InputFile {
    path: PathBuf,
    copy: Option<Arc<Temporary>>,
}

impl InputFile {
    /// A file as it is; a copy of standard input (`-`) and of other pipes.
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        let is_input = path.as_os_str() == STANDARD_INPUT;
        if !is_input && can_be_read_again(path) {
            return Ok(Self { path: path.to_owned(), copy: None });
        }
        let name = if is_input { "standard input".to_owned() } else { path.display().to_string() };
        let copied = if is_input {
            copy(&mut io::stdin().lock(), "input", &name)
        } else {
            File::open(path).and_then(|mut pipe| copy(&mut pipe, "pipe", &name))
        };
        copied.with_context(|| format!("{name}: cannot be read"))
    }

    /// All of them.
    pub(crate) fn open_all(paths: &[PathBuf]) -> anyhow::Result<Vec<Self>> {
        paths.iter().map(|path| Self::open(path)).collect()
    }

    /// Whether it is a copy of a pipe.
    pub(crate) const fn is_copy(&self) -> bool {
        self.copy.is_some()
    }

    /// Where it can be read.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

/// Copies a pipe called `name` to a temporary file, `stem` with a number, in a folder of its own.
fn copy(pipe: &mut impl io::Read, stem: &str, name: &str) -> io::Result<InputFile> {
    static COUNT: AtomicUsize = AtomicUsize::new(1);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    let folder = std::env::temp_dir().join(format!("kurs-{}-{count}", std::process::id()));
    fs::create_dir(&folder)?;
    let path = folder.join(format!("{stem}{count}"));
    names().push((path.display().to_string(), name.to_owned()));
    let copy = Some(Arc::new(Temporary::new(folder)));
    io::copy(pipe, &mut File::create(&path)?)?;
    Ok(InputFile { path, copy })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_lives_as_long_as_it_is_used() {
        let file = copy(&mut &b"observations"[..], "pipe", "/dev/fd/63").unwrap();
        let path = file.path().to_owned();
        assert_eq!(told(&format!("{}:7: cut", path.display())), "/dev/fd/63:7: cut");
        assert_eq!(folder_of(&path), Path::new(""));
        assert_eq!(fs::read_to_string(&path).unwrap(), "observations");
        let other = file.clone();
        drop(file);
        assert!(path.exists());
        drop(other);
        assert!(!path.exists() && !path.parent().unwrap().exists());
    }
}
