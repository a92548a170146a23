//! What a file holds, in two numbers.

use std::hash::Hasher;
use std::io::{self, Read};
use std::path::Path;

use twox_hash::XxHash3_64;

/// Bytes of a file that are read at once.
const PIECE: usize = 1 << 16;

/// Size and hash of a file's bytes as stored: tells contents apart, if not against forgery.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fingerprint {
    /// Bytes.
    pub size: u64,
    /// XXH3 of them.
    pub hash: u64,
}

impl Fingerprint {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Those of the operating system.
    pub fn of_file(path: &Path) -> io::Result<Self> {
        let (mut file, mut passed) = (std::fs::File::open(path)?, Passed::default());
        let mut buffer = vec![0; PIECE];
        loop {
            match file.read(&mut buffer) {
                Ok(count) => passed.take(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            if let Some(content) = passed.whole() {
                return Ok(content);
            }
        }
    }
}

/// The bytes of a file that were read so far.
#[derive(Default)]
pub(crate) struct Passed {
    size: u64,
    hash: XxHash3_64,
    is_at_end: bool,
}

impl Passed {
    /// Takes in what a reader gave next: nothing at the end.
    pub(crate) fn take(&mut self, piece: &[u8]) {
        self.size += piece.len() as u64;
        self.hash.write(piece);
        self.is_at_end = piece.is_empty();
    }

    /// How many there were.
    pub(crate) fn size(&self) -> u64 {
        self.size
    }

    /// The whole, if it was read to its end.
    pub(crate) fn whole(&self) -> Option<Fingerprint> {
        self.is_at_end.then(|| Fingerprint { size: self.size, hash: self.hash.finish() })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;
    use crate::source::Source;

    /// A file that is read line by line has the fingerprint of one that is read at once, packed or
    /// not, and none before its end.
    #[test]
    fn reading_tells_the_fingerprint() {
        let folder = tempfile::tempdir().unwrap();
        let text = "a line of some length\n".repeat(40_000);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(text.as_bytes()).unwrap();
        for bytes in [text.as_bytes(), &packed.finish().unwrap()] {
            let path = folder.path().join("file");
            std::fs::write(&path, bytes).unwrap();
            let mut source = Source::open(&path).unwrap();
            assert!(source.advance().unwrap());
            // One buffer of many was read, but for what is packed.
            assert!(source.fingerprint().is_none() || bytes.len() < Source::BUFFER_SIZE);
            while source.advance().unwrap() {}
            let fingerprint = source.fingerprint().unwrap();
            assert_eq!(fingerprint, Fingerprint::of_file(&path).unwrap());
            assert_eq!(fingerprint.size, bytes.len() as u64);
        }
    }
}
