//! Output files that are never half written: they go to a temporary name and are renamed.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;

/// A file in the making. Dropped without [`OutputFile::finish`] it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct OutputFile {
    writer: Option<BufWriter<File>>,
    temporary: PathBuf,
    target: PathBuf,
}

impl OutputFile {
    /// Starts `directory/name`; the directory is made if needed.
    pub(crate) fn create(directory: &Path, name: &str) -> anyhow::Result<Self> {
        fs::create_dir_all(directory)
            .with_context(|| format!("{}: cannot be made", directory.display()))?;
        let target = directory.join(name);
        let temporary = directory.join(format!(".{name}.part{}", std::process::id()));
        let file = File::create(&temporary)
            .with_context(|| format!("{}: cannot be written", temporary.display()))?;
        Ok(Self { writer: Some(BufWriter::with_capacity(1 << 16, file)), temporary, target })
    }

    /// Gives the file its name.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        if let Some(mut writer) = self.writer.take() {
            writer
                .flush()
                .with_context(|| format!("{}: write failed", self.temporary.display()))?;
        }
        fs::rename(&self.temporary, &self.target)
            .with_context(|| format!("{}: cannot be written", self.target.display()))
    }
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
        self.writer.as_mut().map_or(Ok(0), |writer| writer.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        // After `finish` the temporary name is gone and there is nothing to remove.
        let _ = fs::remove_file(&self.temporary);
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
}
