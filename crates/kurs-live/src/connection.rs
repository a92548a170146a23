//! One connection, whatever it is made of: bytes come in until it ends.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serial2_tokio::SerialPort;
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::{Instant, sleep_until, timeout};

#[cfg(any(feature = "mqtt", feature = "zenoh"))]
use crate::bus::Subscription;
use crate::ntrip::NtripStream;

/// A connection that cannot be made within this time is tried again.
pub(crate) const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// A file that is played as fast as possible is read in pieces of this size.
const PIECE: usize = 16 * 1024;

/// An open connection.
pub(crate) enum Connection {
    Tcp(TcpStream),
    Serial(SerialPort),
    Udp(UdpSocket),
    Ntrip(Box<NtripStream>),
    #[cfg(any(feature = "mqtt", feature = "zenoh"))]
    Bus(Subscription),
    File(tokio::fs::File),
    Marked(Box<MarkedFile>),
}

impl Connection {
    /// Connects to `HOST:PORT`.
    pub(crate) async fn tcp(to: &str) -> io::Result<Self> {
        let stream = timeout(CONNECT_TIMEOUT, TcpStream::connect(to)).await??;
        stream.set_nodelay(true)?;
        Ok(Self::Tcp(stream))
    }

    /// Opens a serial port.
    pub(crate) fn serial(path: &Path, baud: u32) -> io::Result<Self> {
        Ok(Self::Serial(SerialPort::open(path, baud)?))
    }

    /// Receives datagrams.
    pub(crate) async fn udp(at: &str) -> io::Result<Self> {
        Ok(Self::Udp(UdpSocket::bind(at).await?))
    }

    /// Opens a log; one with time marks is played with them.
    pub(crate) async fn file(path: &Path, speed: f64) -> io::Result<Self> {
        let file = tokio::fs::File::open(path).await?;
        let marks = marks_of(path);
        if speed == 0.0 || !marks.exists() {
            return Ok(Self::File(file));
        }
        let marks = tokio::fs::read_to_string(&marks).await?;
        let marks = marks.lines().filter_map(|line| {
            let (end, unix_ns) = line.split_once(',')?;
            Some((end.parse().ok()?, unix_ns.parse().ok()?))
        });
        let marks: Vec<(u64, u64)> = marks.collect();
        let next = 0;
        Ok(Self::Marked(Box::new(MarkedFile { file, marks, next, read: 0, speed, began: None })))
    }

    /// Whether the log brings its own pace.
    pub(crate) const fn is_marked(&self) -> bool {
        matches!(self, Self::Marked(_))
    }

    /// The next bytes; 0 at the end.
    pub(crate) async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer).await,
            Self::Serial(port) => port.read(buffer).await,
            Self::Udp(socket) => loop {
                // An empty datagram is not an end.
                match socket.recv(buffer).await? {
                    0 => continue,
                    count => return Ok(count),
                }
            },
            Self::Ntrip(stream) => stream.read(buffer).await,
            #[cfg(any(feature = "mqtt", feature = "zenoh"))]
            Self::Bus(subscription) => subscription.read(buffer).await,
            Self::File(file) => {
                let piece = buffer.len().min(PIECE);
                file.read(&mut buffer[..piece]).await
            }
            Self::Marked(file) => file.read(buffer).await,
        }
    }

    /// Sends to the other side, where that is possible.
    pub(crate) async fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Ntrip(stream) => stream.send(bytes).await,
            _ => Ok(()),
        }
    }
}

/// The file with the time marks of a log.
pub(crate) fn marks_of(log: &Path) -> PathBuf {
    let mut name = log.as_os_str().to_owned();
    name.push(".marks");
    name.into()
}

/// A log whose bytes come at the times at which they were recorded.
pub(crate) struct MarkedFile {
    file: tokio::fs::File,
    /// Offset behind each piece, and when it came, ns of Unix time.
    marks: Vec<(u64, u64)>,
    next: usize,
    read: u64,
    speed: f64,
    began: Option<(Instant, u64)>,
}

impl MarkedFile {
    async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.marks.get(self.next).is_some_and(|(end, _)| *end <= self.read) {
            self.next += 1;
        }
        let mut length = buffer.len();
        if let Some((end, unix_ns)) = self.marks.get(self.next) {
            let (began, first_ns) = *self.began.get_or_insert((Instant::now(), *unix_ns));
            let due_s = unix_ns.saturating_sub(first_ns) as f64 * 1e-9 / self.speed;
            sleep_until(began + Duration::from_secs_f64(due_s)).await;
            length = length.min(usize::try_from(end - self.read).unwrap_or(length));
        }
        let count = self.file.read(&mut buffer[..length]).await?;
        self.read += count as u64;
        Ok(count)
    }
}

/// Anything that bytes can be read from and written to.
pub(crate) trait Duplex: AsyncRead + tokio::io::AsyncWrite + Unpin + Send {}

impl<T: AsyncRead + tokio::io::AsyncWrite + Unpin + Send> Duplex for T {}
