//! Connections of browsers and machines: HTTP/1.1 by hyper, within limits that no client can
//! exceed.
//!
//! A request has to come within its time and size; a client that takes nothing is dropped; there
//! are only so many connections. What is answered is decided elsewhere.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpSocket};
use tokio::sync::Semaphore;
use tokio::time::{Sleep, sleep};

/// Two hundred pages have a feed each, and a browser asks for assets by up to six connections.
const MAX_CONNECTIONS: usize = 512;
/// A request's head has to be there within this time; a connection without a request ends after it.
const HEAD_TIMEOUT: Duration = Duration::from_secs(10);
/// A client that takes no byte for so long is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_secs(10);
/// Bytes of a request's head (hyper takes no less than 8192).
const MAX_HEAD: usize = 16 * 1024;
/// Header lines of a request.
const MAX_HEADERS: usize = 64;
/// What the system may keep for a client, bytes: rows that wait there get old unseen.
const SEND_BUFFER: u32 = 64 * 1024;
/// After an error of the listener, such as too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// Serves until the service stops; returns the address it is bound to.
pub(crate) fn serve(at: SocketAddr, router: Router) -> io::Result<SocketAddr> {
    let listener = listen(at)?;
    let bound = listener.local_addr()?;
    tokio::spawn(accept(listener, router));
    Ok(bound)
}

fn listen(at: SocketAddr) -> io::Result<TcpListener> {
    let socket = if at.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    socket.set_send_buffer_size(SEND_BUFFER)?;
    socket.bind(at)?;
    socket.listen(128)
}

async fn accept(listener: TcpListener, router: Router) {
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::debug!("the page takes no connection: {error}");
                sleep(PAUSE).await;
                continue;
            }
        };
        // Who comes when all places are taken is turned away, so that nobody waits in vain.
        let Ok(place) = Arc::clone(&room).try_acquire_owned() else { continue };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD_TIMEOUT)
                .max_buf_size(MAX_HEAD)
                .max_headers(MAX_HEADERS)
                .serve_connection(TokioIo::new(Impatient::new(stream, WRITE_TIMEOUT)), service)
                .await;
            if let Err(error) = served {
                tracing::debug!("a connection of the page broke: {error}");
            }
            drop(place);
        });
    }
}

/// A connection whose other side has to take bytes within a time.
struct Impatient<S> {
    stream: S,
    patience: Duration,
    /// Runs while bytes wait.
    deadline: Option<Pin<Box<Sleep>>>,
}

impl<S> Impatient<S> {
    const fn new(stream: S, patience: Duration) -> Self {
        Self { stream, patience, deadline: None }
    }

    /// Lets a write wait only until the deadline.
    fn within<T>(
        &mut self,
        written: Poll<io::Result<T>>,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.deadline = None;
            return written;
        }
        let patience = self.patience;
        let deadline = self.deadline.get_or_insert_with(|| Box::pin(sleep(patience)));
        deadline.as_mut().poll(context).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Impatient<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Impatient<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.within(written, context)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;

    /// The answer to bytes that are sent in one piece, empty if the connection is only closed.
    async fn answer(at: SocketAddr, bytes: &[u8]) -> Vec<u8> {
        let mut stream = TcpStream::connect(at).await.unwrap();
        let _ = stream.write_all(bytes).await;
        let _ = stream.shutdown().await;
        let mut answer = Vec::new();
        let _ = tokio::time::timeout(Duration::from_secs(5), stream.read_to_end(&mut answer))
            .await
            .expect("the connection ends");
        answer
    }

    /// A request with bytes of it altered, left out, doubled or cut: whatever comes is answered or
    /// closed, and the next request is served.
    #[tokio::test]
    async fn malformed_requests_are_answered_or_closed() {
        let router = Router::new().route("/", get(|| async { "well" }));
        let at = serve("127.0.0.1:0".parse().unwrap(), router).unwrap();
        let good = b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\nX-A: 1\r\n\r\n";
        let well = answer(at, good).await;
        assert!(well.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&well));
        // Knuth's multiplier: any sequence will do.
        let mut state = 5_u64;
        let mut random = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            usize::try_from(state >> 33).unwrap() % below
        };
        for _ in 0..500 {
            let mut bytes = good.to_vec();
            for _ in 0..=random(4) {
                let at = random(bytes.len());
                match random(5) {
                    0 => bytes[at] = u8::try_from(random(256)).unwrap(),
                    1 if bytes.len() > 1 => drop(bytes.remove(at)),
                    2 => bytes.truncate(at.max(1)),
                    3 => {
                        let copied = bytes[at..].to_vec();
                        bytes.extend(copied);
                    }
                    _ => bytes.insert(at, b"\r\n\0:% \xff"[random(7)]),
                }
            }
            let answered = answer(at, &bytes).await;
            assert!(answered.is_empty() || answered.starts_with(b"HTTP/1."), "{bytes:?}");
        }
        let long = [b"GET / HTTP/1.1\r\nX-A: ".as_slice(), &[b'a'; 2 * MAX_HEAD]].concat();
        let refused = answer(at, &long).await;
        assert!(!refused.starts_with(b"HTTP/1.1 200"));
        let many = "X-A: 1\r\n".repeat(MAX_HEADERS + 1);
        let many = answer(at, format!("GET / HTTP/1.1\r\n{many}\r\n").as_bytes()).await;
        assert!(!many.starts_with(b"HTTP/1.1 200"));
        assert!(answer(at, good).await.starts_with(b"HTTP/1.1 200"));
    }

    #[tokio::test]
    async fn a_client_that_takes_nothing_is_dropped() {
        let (ours, _theirs) = tokio::io::duplex(64);
        let mut ours = Impatient::new(ours, Duration::from_millis(50));
        let began = tokio::time::Instant::now();
        let outcome = ours.write_all(&[0; 65]).await;
        assert_eq!(outcome.unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert!(began.elapsed() >= Duration::from_millis(50));
    }
}
