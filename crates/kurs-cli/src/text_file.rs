//! Text files, as every command reads them: what is packed with gzip or `compress` is unpacked.

use std::io::{self, Read};
use std::path::Path;

use anyhow::{Context, anyhow};
use kurs_formats::source::{ReadError, Source};

/// A text file that is read once from its beginning; damaged packed data is an error.
pub(crate) struct TextFile(Source);

impl TextFile {
    pub(crate) fn open(path: &Path) -> anyhow::Result<Self> {
        Source::open(path).map(Self).map_err(|error| match error {
            ReadError::Io { file, error } => {
                anyhow!(error).context(format!("{file}: cannot be read"))
            }
            other => other.into(),
        })
    }
}

impl Read for TextFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.0.read(buffer)?;
        let is_end = count == 0 && !buffer.is_empty();
        match self.0.take_broken_off().filter(|_| is_end) {
            Some(what) => Err(io::Error::other(what)),
            None => Ok(count),
        }
    }
}

/// The whole text of a file.
pub(crate) fn text(path: &Path) -> anyhow::Result<String> {
    let mut text = String::new();
    let read = TextFile::open(path)?.read_to_string(&mut text);
    read.with_context(|| format!("{}: cannot be read", path.display()))?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use std::io::Write as _;

    #[test]
    fn packed_text_is_unpacked_and_a_cut_one_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        let lines: String = (0..3000).map(|k| format!("line {}\n", k * 7919 % 10_007)).collect();
        let mut packed = GzEncoder::new(Vec::new(), Compression::default());
        packed.write_all(lines.as_bytes()).unwrap();
        let packed = packed.finish().unwrap();
        for bytes in [lines.as_bytes(), &packed] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(text(&path).unwrap(), lines);
        }
        std::fs::write(&path, &packed[..packed.len() / 2]).unwrap();
        let error = format!("{:#}", text(&path).unwrap_err());
        assert!(error.contains("text: cannot be read: the packed data is damaged"), "{error}");
    }
}
