//! Messages of a bus as a stream of lines: what every kind of bus has in common.

use std::io;

use tokio::sync::mpsc;
use tokio::task::AbortHandle;

/// Messages that may wait to be read: as many rows as are kept of a peer.
pub(crate) const MAX_WAITING: usize = 64;

/// Messages that come from a bus, read as lines.
pub(crate) struct Subscription {
    messages: mpsc::Receiver<io::Result<Vec<u8>>>,
    /// The last message, and how much of it was read.
    current: Vec<u8>,
    at: usize,
    task: AbortHandle,
}

impl Subscription {
    /// To the messages that `task` receives; it ends with the subscription.
    pub(crate) const fn new(
        messages: mpsc::Receiver<io::Result<Vec<u8>>>,
        task: AbortHandle,
    ) -> Self {
        Self { messages, current: Vec::new(), at: 0, task }
    }

    /// The next bytes; 0 at the end. Every message is one line.
    pub(crate) async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at == self.current.len() {
            let Some(message) = self.messages.recv().await else { return Ok(0) };
            (self.current, self.at) = (message?, 0);
            if self.current.last() != Some(&b'\n') {
                self.current.push(b'\n');
            }
        }
        let rest = &self.current[self.at..];
        let count = rest.len().min(buffer.len());
        buffer[..count].copy_from_slice(&rest[..count]);
        self.at += count;
        Ok(count)
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// A line as a message, which has an end of its own.
pub(crate) fn message_of(line: &[u8]) -> &[u8] {
    line.trim_ascii_end()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn every_message_is_a_line() {
        let (sender, receiver) = mpsc::channel(MAX_WAITING);
        let task = tokio::spawn(async {}).abort_handle();
        let mut subscription = Subscription::new(receiver, task);
        for message in [&b"{}"[..], b"[1]\n", b""] {
            sender.send(Ok(message_of(message).to_vec())).await.unwrap();
        }
        sender.send(Err(io::ErrorKind::ConnectionReset.into())).await.unwrap();
        drop(sender);
        let (mut read, mut buffer) = (Vec::new(), [0; 2]);
        let end = loop {
            match subscription.read(&mut buffer).await {
                Ok(count) => read.extend_from_slice(&buffer[..count]),
                Err(error) => break error,
            }
        };
        assert_eq!(read, b"{}\n[1]\n\n");
        assert_eq!(end.kind(), io::ErrorKind::ConnectionReset);
        assert_eq!(subscription.read(&mut buffer).await.unwrap(), 0);
    }
}
