//! A file or stream as bytes and lines: gzip and `compress` are found by content and undone, memory
//! is bounded.
//!
//! The buffer has a fixed size and a line has a maximum length, so that neither a long file nor a
//! file without line ends takes more memory or more time than its bytes.

use std::fs::File;
use std::io::{self, BufRead, Read};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use flate2::read::MultiGzDecoder;

use crate::compress;
use crate::fingerprint::{Fingerprint, Passed};

/// Why a file cannot be read (further).
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A list of files has no entry.
    #[error("no file is given")]
    NoFile,
    /// The operating system refuses.
    #[error("{file}: {error}")]
    Io {
        /// Name of the file.
        file: String,
        /// Its reason.
        #[source]
        error: io::Error,
    },
    /// The content is something else.
    #[error("{file}: found {found}, expected {expected}")]
    WrongContent {
        /// Name of the file.
        file: String,
        /// What the content looks like.
        found: String,
        /// What can be read here.
        expected: &'static str,
    },
    /// A line without which the rest has no meaning.
    #[error("{file}, line {line}: {what}")]
    Line {
        /// Name of the file.
        file: String,
        /// Counted from 1.
        line: u64,
        /// What was found and expected.
        what: String,
    },
}

/// A buffered byte source with line access.
///
/// Lines are visited with a cursor: [`Source::advance`] moves to the next line, [`Source::line`] is
/// the line where the cursor stands, without its end (`\n` or `\r\n`).
pub struct Source {
    name: String,
    input: Box<dyn Read + Send>,
    /// What came from outside, packed as it is there.
    passed: Arc<Mutex<Passed>>,
    inflating: bool,
    buffer: Box<[u8]>,
    /// Unread bytes: `buffer[next..filled]`.
    next: usize,
    filled: usize,
    at_end: bool,
    broken_off: Option<String>,
    line: core::ops::Range<usize>,
    line_number: u64,
    /// The line went on beyond [`Source::LINE_MAX`].
    line_cut: bool,
    /// The input ended in the line.
    line_unended: bool,
    line_held: bool,
}

/// Passes on what it reads, and takes note of it.
struct Noted<R> {
    input: R,
    passed: Arc<Mutex<Passed>>,
}

impl<R: Read> Read for Noted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.input.read(buffer)?;
        if !buffer.is_empty() {
            locked(&self.passed).take(&buffer[..count]);
        }
        Ok(count)
    }
}

/// Nothing that holds the lock panics.
fn locked(passed: &Mutex<Passed>) -> MutexGuard<'_, Passed> {
    passed.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether a file can be opened again and gives the same bytes: a pipe or a terminal does not.
#[must_use]
pub fn can_be_read_again(path: impl AsRef<Path>) -> bool {
    // A missing file is reported where it is opened.
    std::fs::metadata(path).map_or(true, |data| data.is_file() || data.is_dir())
}

impl core::fmt::Debug for Source {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Source").field("name", &self.name).field("line", &self.line_number).finish()
    }
}

impl Source {
    /// Longest line that is given in full; what goes beyond is dropped.
    pub const LINE_MAX: usize = 16 * 1024;
    /// Bytes that are held at once.
    pub const BUFFER_SIZE: usize = 256 * 1024;

    /// Opens a file.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if it cannot be opened or read, [`ReadError::WrongContent`] if it is
    /// compressed by a method other than gzip and `compress` (`.Z`).
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        let name = path.as_ref().display().to_string();
        let file = File::open(&path)
            .and_then(|file| match file.metadata()?.is_dir() {
                true => Err(io::Error::from(io::ErrorKind::IsADirectory)),
                false => Ok(file),
            })
            .map_err(|error| ReadError::Io { file: name.clone(), error })?;
        Self::new(file, name)
    }

    /// Wraps a stream; `name` stands for it in messages.
    ///
    /// # Errors
    ///
    /// As [`Source::open`].
    pub fn new(
        input: impl Read + Send + 'static,
        name: impl Into<String>,
    ) -> Result<Self, ReadError> {
        let passed = Arc::<Mutex<Passed>>::default();
        let mut source = Self {
            name: name.into(),
            input: Box::new(Noted { input, passed: Arc::clone(&passed) }),
            passed,
            inflating: false,
            buffer: vec![0; Self::BUFFER_SIZE].into_boxed_slice(),
            next: 0,
            filled: 0,
            at_end: false,
            broken_off: None,
            line: 0..0,
            line_number: 0,
            line_cut: false,
            line_unended: false,
            line_held: false,
        };
        source.undo_compression()?;
        Ok(source)
    }

    /// Unpacks gzip and `compress`, and passes over the mark that some editors put before UTF-8
    /// text.
    fn undo_compression(&mut self) -> Result<(), ReadError> {
        let is_compress = self.start(6)?.starts_with(&compress::MAGIC);
        let method = match self.start(6)? {
            [0x1f, 0x8b | 0x9d, ..] => None,
            [b'B', b'Z', b'h', b'1'..=b'9', ..] => Some("bzip2"),
            [b'P', b'K', 3, 4, ..] => Some("a ZIP archive"),
            [0xfd, b'7', b'z', b'X', b'Z', 0, ..] => Some("xz"),
            [0x28, 0xb5, 0x2f, 0xfd, ..] => Some("zstd"),
            [0xef, 0xbb, 0xbf, ..] => {
                self.next += 3;
                return Ok(());
            }
            _ => return Ok(()),
        };
        if let Some(method) = method {
            return Err(self.wrong_content(
                format!("{method} compression"),
                "plain text, gzip or compress (unpack the file, or pack it again with gzip)",
            ));
        }
        let packed = io::Cursor::new(self.buffer[self.next..self.filled].to_vec());
        let rest = core::mem::replace(&mut self.input, Box::new(io::empty()));
        let whole = packed.chain(rest);
        self.input = if is_compress {
            let error = |error| ReadError::Io { file: self.name.clone(), error };
            Box::new(compress::Decoder::new(whole).map_err(error)?)
        } else {
            Box::new(MultiGzDecoder::new(whole))
        };
        (self.inflating, self.next, self.filled, self.at_end) = (true, 0, 0, false);
        Ok(())
    }

    /// Name of the file, for messages.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bytes that were read so far, as they stand in the file: of a packed one, packed.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        locked(&self.passed).size()
    }

    /// What the file holds, once it was read to its end.
    #[must_use]
    pub fn fingerprint(&self) -> Option<Fingerprint> {
        locked(&self.passed).whole()
    }

    /// At least `length` bytes from here on, fewer if the input ends before (at most
    /// [`Source::BUFFER_SIZE`] fit); nothing is consumed.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if reading fails.
    pub fn start(&mut self, length: usize) -> Result<&[u8], ReadError> {
        while self.filled - self.next < length.min(Self::BUFFER_SIZE) && !self.at_end {
            self.refill()?;
        }
        Ok(&self.buffer[self.next..self.filled])
    }

    /// Moves to the next line; `false` at the end.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if reading fails.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        if core::mem::take(&mut self.line_held) {
            return Ok(true);
        }
        if core::mem::take(&mut self.line_cut) {
            self.skip_rest_of_line()?;
        }
        let mut searched = 0;
        loop {
            let unread = &self.buffer[self.next..self.filled];
            if let Some(offset) = memchr::memchr(b'\n', &unread[searched..]) {
                let end = self.next + searched + offset;
                self.take_line(end, end + 1);
                return Ok(true);
            }
            searched = unread.len();
            if searched >= Self::LINE_MAX {
                let end = self.next + Self::LINE_MAX;
                self.take_line(end, end);
                self.line_cut = true;
                return Ok(true);
            }
            if self.at_end {
                let last_line = searched > 0;
                self.take_line(self.filled, self.filled);
                self.line_number -= u64::from(!last_line);
                self.line_unended = true;
                return Ok(last_line);
            }
            self.refill()?;
        }
    }

    fn take_line(&mut self, end: usize, next: usize) {
        let carriage_return = end > self.next && self.buffer[end - 1] == b'\r';
        self.line = self.next..end - usize::from(carriage_return);
        self.next = next;
        self.line_number += 1;
    }

    fn skip_rest_of_line(&mut self) -> Result<(), ReadError> {
        loop {
            if let Some(offset) = memchr::memchr(b'\n', &self.buffer[self.next..self.filled]) {
                self.next += offset + 1;
                return Ok(());
            }
            self.next = self.filled;
            if self.at_end {
                return Ok(());
            }
            self.refill()?;
        }
    }

    /// The line where the cursor stands.
    #[must_use]
    pub fn line(&self) -> &[u8] {
        &self.buffer[self.line.clone()]
    }

    /// Its number, counted from 1.
    #[must_use]
    pub const fn line_number(&self) -> u64 {
        self.line_number
    }

    /// Whether all of it is there: it was not longer than [`Source::LINE_MAX`], and the input did
    /// not end without a line end.
    #[must_use]
    pub const fn line_is_whole(&self) -> bool {
        !self.line_cut && !self.line_unended
    }

    /// The next [`Source::advance`] stays at this line.
    pub const fn hold_line(&mut self) {
        self.line_held = true;
    }

    /// Why the packed data ended before its end, if it did: what came before is good. It is told
    /// once, because readers come to the end of a file more than once.
    pub const fn take_broken_off(&mut self) -> Option<String> {
        self.broken_off.take()
    }

    /// An error that says what was found here instead of what was expected.
    #[must_use]
    pub fn wrong_content(&self, found: impl Into<String>, expected: &'static str) -> ReadError {
        ReadError::WrongContent { file: self.name.clone(), found: found.into(), expected }
    }

    /// An error at the line where the cursor stands.
    #[must_use]
    pub fn bad_line(&self, what: impl Into<String>) -> ReadError {
        ReadError::Line { file: self.name.clone(), line: self.line_number, what: what.into() }
    }

    /// Reads more; the unread bytes move to the front, so a line borrowed before is gone.
    fn refill(&mut self) -> Result<(), ReadError> {
        if self.next > 0 {
            self.buffer.copy_within(self.next..self.filled, 0);
            self.filled -= self.next;
            self.next = 0;
        }
        loop {
            match self.input.read(&mut self.buffer[self.filled..]) {
                Ok(0) => self.at_end = true,
                Ok(count) => self.filled += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) if self.inflating && is_damage(&error) => {
                    self.broken_off = Some(format!("the packed data is damaged: {error}"));
                    self.at_end = true;
                }
                Err(error) => return Err(ReadError::Io { file: self.name.clone(), error }),
            }
            return Ok(());
        }
    }
}

fn is_damage(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof)
}

impl Read for Source {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}

impl BufRead for Source {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.next == self.filled && !self.at_end {
            self.refill().map_err(io::Error::other)?;
        }
        Ok(&self.buffer[self.next..self.filled])
    }

    fn consume(&mut self, count: usize) {
        self.next = (self.next + count).min(self.filled);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn lines(bytes: &[u8]) -> Vec<String> {
        let mut source = Source::new(io::Cursor::new(bytes.to_vec()), "test").unwrap();
        let mut lines = Vec::new();
        while source.advance().unwrap() {
            lines.push(String::from_utf8_lossy(source.line()).into_owned());
        }
        assert_eq!(source.line_number(), lines.len() as u64);
        lines
    }

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn line_ends() {
        assert_eq!(lines(b""), [""; 0]);
        assert_eq!(lines(b"a\nb"), ["a", "b"]);
        assert_eq!(lines(b"a\r\n\r\nb\r\n"), ["a", "", "b"]);
        assert_eq!(lines(b"\n\n"), ["", ""]);
    }

    #[test]
    fn gzip_members_follow_each_other() {
        let both = [packed(b"first\nsec"), packed(b"ond\n")].concat();
        assert_eq!(lines(&both), ["first", "second"]);
    }

    /// "aaaa", packed by `compress`, whole and with an invalid code behind it.
    #[test]
    fn files_of_compress() {
        let file = b"\x1f\x9d\x90a\x02\x86\x01";
        assert_eq!(lines(file), ["aaaa"]);
        let mut source = Source::new(&b"\x1f\x9d\x90a\xfe\xff\xff"[..], "test").unwrap();
        assert!(source.advance().unwrap());
        assert_eq!(source.line(), b"a");
        assert!(source.take_broken_off().is_some());
    }

    #[test]
    fn cut_gzip_keeps_what_came_before() {
        let text: String = (0..20_000).map(|i| format!("line {}\n", i * 7919 % 10_007)).collect();
        let whole = packed(text.as_bytes());
        let cut = whole[..whole.len() / 2].to_vec();
        let mut source = Source::new(io::Cursor::new(cut), "test").unwrap();
        while source.advance().unwrap() {}
        assert!(source.line_number() > 5000, "{}", source.line_number());
        assert!(source.take_broken_off().is_some());
    }

    #[test]
    fn long_lines_are_cut_and_the_next_line_is_whole() {
        let mut bytes = vec![b'x'; 5_000_000];
        bytes.extend_from_slice(b"\nnext\n");
        let found = lines(&bytes);
        assert_eq!((found[0].len(), found[1].as_str()), (Source::LINE_MAX, "next"));
        assert_eq!(found.len(), 2);
    }

    /// Each kind by its first bytes, with more behind them.
    #[test]
    fn other_compressions_are_named() {
        for (start, name) in [
            (&b"BZh91AY"[..], "bzip2"),
            (b"PK\x03\x04\x14\x00", "a ZIP archive"),
            (b"\xfd7zXZ\x00", "xz"),
            (b"\x28\xb5\x2f\xfd", "zstd"),
        ] {
            let file = [start, &[4; 100]].concat();
            let error = Source::new(io::Cursor::new(file), "packed").unwrap_err();
            let what = format!("packed: found {name} compression, expected plain text");
            assert!(error.to_string().starts_with(&what), "{error}");
        }
    }

    #[test]
    fn a_held_line_comes_again() {
        let mut source = Source::new(&b"a\nb\n"[..], "test").unwrap();
        assert!(source.advance().unwrap());
        source.hold_line();
        assert!(source.advance().unwrap());
        assert_eq!((source.line(), source.line_number()), (&b"a"[..], 1));
        assert!(source.advance().unwrap());
        assert_eq!(source.line(), b"b");
    }
}
