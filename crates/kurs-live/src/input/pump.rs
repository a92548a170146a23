//! The bytes of one connection, passed on until it ends.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use tokio::net::{TcpListener, TcpStream};

use super::progress::Progress;
use super::readers::Reader;
use super::running::{End, Running};
use crate::address::Address;
use crate::connection::Connection;
use crate::decoder::Chunk;
use crate::lock::lock;

/// A virtual station wants the position so often.
const GGA_INTERVAL: Duration = Duration::from_secs(10);
/// Bytes that are read at once.
const BUFFER: usize = 64 * 1024;

impl Running {
    /// Passes bytes on to new readers until the connection ends; then waits until they are done.
    pub(super) async fn pump(
        &mut self,
        mut connection: Connection,
        listener: Option<&TcpListener>,
    ) -> End {
        self.statuses().for_each(|status| status.note_connection(true));
        let readers = self.start_readers(connection.is_marked());
        let end = self.pass_on(&mut connection, listener, &readers).await;
        drop(connection);
        // All of them hear that nothing more comes before one of them is waited for.
        let tasks: Vec<_> = readers.into_iter().map(|reader| reader.task).collect();
        for task in tasks {
            let _ = task.await;
        }
        self.statuses().for_each(|status| status.note_connection(false));
        self.input.tell_end(&self.shared.events);
        end
    }

    async fn pass_on(
        &mut self,
        connection: &mut Connection,
        listener: Option<&TcpListener>,
        readers: &[Reader],
    ) -> End {
        let mut buffer = vec![0; BUFFER];
        let mut gga_due = tokio::time::interval(GGA_INTERVAL);
        gga_due.tick().await;
        let waits = !self.input.address.is_file();
        let wants_gga = matches!(self.input.address, Address::Ntrip(_));
        let mut progress = Progress::new(self.epochs());
        loop {
            if waits && let Some(what) = progress.trouble(self.epochs(), Instant::now()) {
                return End::Broken(what);
            }
            let going_on = tokio::select! {
                biased;
                read = connection.read(&mut buffer) => match read {
                    Ok(0) => return End::Closed,
                    Ok(count) => {
                        progress.note_bytes(Instant::now());
                        self.give(&buffer[..count], readers).await
                    }
                    Err(error) => Err(broken(&error)),
                },
                newer = next_client(listener) => match newer {
                    Ok(stream) => return End::Replaced(stream),
                    Err(_) => Ok(()),
                },
                () = tokio::time::sleep_until(progress.silent_at().into()), if waits => Ok(()),
                _ = gga_due.tick(), if wants_gga => self.send_gga(connection).await,
            };
            if let Err(end) = going_on {
                return end;
            }
        }
    }

    /// Gives a piece to the raw log and to all readers.
    async fn give(&mut self, bytes: &[u8], readers: &[Reader]) -> Result<(), End> {
        let (arrived, utc) = (Instant::now(), SystemTime::now());
        let chunk = Chunk { bytes: Arc::from(bytes), arrived, utc };
        self.has_worked = true;
        self.statuses().for_each(|status| status.note_bytes(bytes.len()));
        if let Some(recorder) = &mut self.recorder
            && let Err(error) = recorder.write(&chunk)
        {
            self.note(&format!("the raw log pauses: {error}"));
        }
        let mut taken = false;
        for reader in readers {
            taken |= reader.chunks.send(chunk.clone()).await.is_ok();
        }
        if taken { Ok(()) } else { Err(End::Broken("no decoder takes the bytes".into())) }
    }

    /// Tells a caster where the body is, if that is known.
    async fn send_gga(&self, connection: &mut Connection) -> Result<(), End> {
        let gga = lock(&self.shared.known.gga).clone();
        let Some(gga) = gga else { return Ok(()) };
        connection.send(gga.as_bytes()).await.map_err(|error| broken(&error))
    }

    fn epochs(&self) -> u64 {
        self.statuses().map(|status| status.epochs()).sum()
    }
}

fn broken(error: &io::Error) -> End {
    End::Broken(format!("the connection broke: {error}"))
}

/// The next connection that is made to this one's place, where connections are waited for.
async fn next_client(listener: Option<&TcpListener>) -> io::Result<TcpStream> {
    match listener {
        Some(listener) => listener.accept().await.map(|(stream, _)| stream),
        None => core::future::pending().await,
    }
}
