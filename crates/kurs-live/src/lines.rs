//! Streams of text: bytes of a connection to lines, whatever else is among them.

use tokio::sync::mpsc;

use crate::decoder::Chunk;

/// Longest line, bytes: a row of all columns has less than 2 kB.
const LONGEST: usize = 16 * 1024;

/// Whom the lines of a stream are for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Lines {
    /// The inertial sensor.
    Imu,
    /// Another body, by its number, with its name.
    Peer(usize, String),
}

impl Lines {
    /// The stream's name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Imu => "imu",
            Self::Peer(_, name) => name,
        }
    }
}

/// Gives every line with the chunk that ends it, `None` in place of one that is too long or no
/// text, until the chunks end or nothing takes the lines any more.
pub(crate) fn read(
    mut chunks: mpsc::Receiver<Chunk>,
    mut give: impl FnMut(Option<&str>, &Chunk) -> bool,
) {
    let mut line = Vec::new();
    let mut is_too_long = false;
    while let Some(chunk) = chunks.blocking_recv() {
        let mut pieces = chunk.bytes.split(|byte| *byte == b'\n').peekable();
        while let Some(piece) = pieces.next() {
            is_too_long |= line.len() + piece.len() > LONGEST;
            if !is_too_long {
                line.extend_from_slice(piece);
            }
            if pieces.peek().is_none() {
                break;
            }
            let text = core::str::from_utf8(&line).ok().filter(|_| !is_too_long).map(str::trim);
            if text != Some("") && !give(text, &chunk) {
                return;
            }
            line.clear();
            is_too_long = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::time::{Instant, SystemTime};

    /// Lines cut anywhere, a huge one, one that is no text, and half of one at the end.
    #[test]
    fn lines_are_put_together_again() {
        let text =
            [b"one\r\ntwo\n\n\xff\xfe\n", &[b'x'; 3 * LONGEST][..], b"\nthree\nfou"].concat();
        for length in [1, 7, text.len()] {
            let (sender, receiver) = mpsc::channel(text.len());
            for bytes in text.chunks(length) {
                let chunk = Chunk {
                    bytes: Arc::from(bytes),
                    arrived: Instant::now(),
                    utc: SystemTime::now(),
                };
                sender.try_send(chunk).unwrap();
            }
            drop(sender);
            let mut lines = Vec::new();
            read(receiver, |line, _| {
                lines.push(line.map(str::to_owned));
                true
            });
            let wanted = [Some("one"), Some("two"), None, None, Some("three")];
            assert_eq!(lines, wanted.map(|line| line.map(str::to_owned)), "{length}");
        }
    }
}
