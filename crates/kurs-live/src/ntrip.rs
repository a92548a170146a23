//! NTRIP client, versions 1 and 2, plain or over TLS.
//!
//! Version 2 is asked for; a caster that closes the connection on that is asked in version 1 the
//! next time. The answer may be `ICY 200 OK` (version 1, no body framing) or an HTTP status with or
//! without chunks.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use rustls::pki_types::ServerName;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

use crate::address::{Ntrip, Place};
use crate::connection::Duplex;

/// The caster must have answered within this time.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest line of an answer, bytes.
const MAX_LINE: u64 = 4096;
/// Most header lines of an answer.
const MAX_HEADERS: usize = 64;

/// Why there is no stream.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NtripError {
    /// Trying again cannot help.
    #[error("{0}")]
    Final(String),
    /// The other version may be understood.
    #[error("the caster closed the connection without an answer")]
    NoAnswer,
    /// Anything else.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// A stream of a caster.
pub(crate) struct NtripStream {
    stream: BufReader<Box<dyn Duplex>>,
    /// Bytes left in the current chunk; `None`: the body has no chunks.
    chunk: Option<u64>,
}

/// Asks for a mount point; `gga` is a sentence with the position, for virtual stations.
pub(crate) async fn connect(
    caster: &Ntrip,
    version: u8,
    gga: Option<&str>,
) -> Result<NtripStream, NtripError> {
    let to = (caster.place.host.as_str(), caster.place.port);
    let tcp = timeout(ANSWER_TIMEOUT, TcpStream::connect(to)).await.map_err(io::Error::from)??;
    tcp.set_nodelay(true)?;
    let stream: Box<dyn Duplex> = match caster.tls {
        true => Box::new(encrypted(tcp, &caster.place.host).await?),
        false => Box::new(tcp),
    };
    let mut stream = BufReader::new(stream);
    stream.write_all(request(caster, version, gga).as_bytes()).await?;
    stream.flush().await?;
    let begun = timeout(ANSWER_TIMEOUT, NtripStream::begin(stream, caster)).await;
    let mut stream = begun.map_err(io::Error::from)??;
    if let Some(gga) = gga {
        stream.send(gga.as_bytes()).await?;
    }
    Ok(stream)
}

async fn encrypted(
    tcp: TcpStream,
    host: &str,
) -> Result<tokio_rustls::client::TlsStream<TcpStream>, NtripError> {
    let mut roots = rustls::RootCertStore::empty();
    for certificate in rustls_native_certs::load_native_certs().certs {
        // One that cannot be read trusts nobody.
        let _ = roots.add(certificate);
    }
    let config =
        rustls::ClientConfig::builder().with_root_certificates(roots).with_no_client_auth();
    let name = ServerName::try_from(host.to_owned())
        .map_err(|_| NtripError::Final(format!("{host} is no name that a certificate can have")))?;
    let connecting = TlsConnector::from(Arc::new(config)).connect(name, tcp);
    Ok(timeout(ANSWER_TIMEOUT, connecting).await.map_err(io::Error::from)??)
}

fn request(caster: &Ntrip, version: u8, gga: Option<&str>) -> String {
    let Ntrip { place, mount, .. } = caster;
    let (authority, user) = (place.authority(), &place.user);
    let agent = concat!("NTRIP Kurs/", env!("CARGO_PKG_VERSION"));
    let mut text = match version {
        1 => format!("GET /{mount} HTTP/1.0\r\nUser-Agent: {agent}\r\n"),
        _ => format!(
            "GET /{mount} HTTP/1.1\r\nHost: {authority}\r\nNtrip-Version: Ntrip/2.0\r\n\
             User-Agent: {agent}\r\nConnection: close\r\n"
        ),
    };
    if let Some((name, password)) = user {
        let credentials = base64(format!("{name}:{password}").as_bytes());
        text += &format!("Authorization: Basic {credentials}\r\n");
    }
    if let (Some(gga), 2) = (gga, version) {
        text += &format!("Ntrip-GGA: {}\r\n", gga.trim_end());
    }
    text + "\r\n"
}

/// Status line and header lines.
async fn answer(stream: &mut BufReader<Box<dyn Duplex>>) -> Result<Vec<String>, NtripError> {
    let mut lines: Vec<String> = Vec::new();
    loop {
        let mut line = Vec::new();
        (&mut *stream).take(MAX_LINE).read_until(b'\n', &mut line).await?;
        if line.is_empty() && lines.is_empty() {
            return Err(NtripError::NoAnswer);
        }
        let text = String::from_utf8_lossy(&line).trim_end().to_owned();
        let is_icy = lines.is_empty() && text.starts_with("ICY ");
        let is_end = text.is_empty() || !line.ends_with(b"\n");
        if !text.is_empty() {
            lines.push(text);
        }
        // Version 1 may send the stream right behind its only line.
        if is_icy || is_end || lines.len() > MAX_HEADERS {
            return Ok(lines);
        }
    }
}

/// Whether the body comes in chunks; an error that says what the caster refuses.
fn judge(answer: &[String], caster: &Ntrip) -> Result<bool, NtripError> {
    let status = answer.first().map_or("", String::as_str);
    let mut words = status.split_ascii_whitespace();
    let (protocol, code) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
    let has = |name: &str, value: &str| {
        answer.iter().filter_map(|line| line.split_once(':')).any(|(n, v)| {
            n.trim().eq_ignore_ascii_case(name) && v.to_ascii_lowercase().contains(value)
        })
    };
    let no_mount = || NtripError::Final(format!("{caster}: the caster has no such mount point"));
    match (protocol, code) {
        ("SOURCETABLE", _) => Err(no_mount()),
        (_, "401" | "403") => {
            let user = caster.place.user.as_ref().map_or("nobody", |(name, _)| name);
            Err(NtripError::Final(format!("{caster}: the caster refuses the password of {user}")))
        }
        (_, "404") => Err(no_mount()),
        (_, "200") if has("content-type", "sourcetable") => Err(no_mount()),
        (_, "200") => Ok(has("transfer-encoding", "chunked")),
        _ => Err(NtripError::Io(io::Error::other(format!("the caster answers {status:?}")))),
    }
}

/// What the client makes of all that a caster sends: the bytes of the stream.
///
/// # Errors
///
/// Why there is no stream, in words.
pub fn body_of_answer(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let user = Some(("name".to_owned(), "password".to_owned()));
    let place = Place { host: "caster".into(), port: 2101, user };
    let caster = Ntrip { place, mount: "M".into(), tls: false };
    let sent: Box<dyn Duplex> =
        Box::new(tokio::io::join(io::Cursor::new(bytes.to_owned()), tokio::io::sink()));
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    runtime.map_err(|error| error.to_string())?.block_on(async {
        let begun = NtripStream::begin(BufReader::new(sent), &caster).await;
        let mut stream = begun.map_err(|error| error.to_string())?;
        let (mut body, mut buffer) = (Vec::new(), [0; 1000]);
        // What comes before an error has been passed on.
        while let Ok(count @ 1..) = stream.read(&mut buffer).await {
            body.extend_from_slice(&buffer[..count]);
        }
        Ok(body)
    })
}

impl NtripStream {
    /// Reads what comes before the stream.
    async fn begin(
        mut stream: BufReader<Box<dyn Duplex>>,
        caster: &Ntrip,
    ) -> Result<Self, NtripError> {
        let answer = answer(&mut stream).await?;
        let is_chunked = judge(&answer, caster)?;
        Ok(Self { stream, chunk: is_chunked.then_some(0) })
    }

    /// The next bytes of the stream; 0 at its end.
    pub(crate) async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(left) = self.chunk else { return self.stream.read(buffer).await };
        let left = if left > 0 { left } else { self.next_chunk().await? };
        if left == 0 {
            return Ok(0);
        }
        let length = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        let count = self.stream.read(&mut buffer[..length]).await?;
        self.chunk = Some(left - count as u64);
        Ok(count)
    }

    /// The size of the next chunk; lines end behind chunks too.
    async fn next_chunk(&mut self) -> io::Result<u64> {
        loop {
            let mut line = Vec::new();
            if (&mut self.stream).take(MAX_LINE).read_until(b'\n', &mut line).await? == 0 {
                return Ok(0);
            }
            let line = String::from_utf8_lossy(&line);
            let size = line.split(';').next().unwrap_or("").trim();
            if !size.is_empty() {
                let wrong = || io::Error::other(format!("{size:?} is no size of a chunk"));
                return u64::from_str_radix(size, 16).map_err(|_| wrong());
            }
        }
    }

    /// Sends a sentence to the caster.
    pub(crate) async fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes).await?;
        self.stream.flush().await
    }
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0u32, |bits, byte| bits << 8 | u32::from(*byte));
        let bits = bits << (8 * (3 - group.len()));
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= group.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn caster() -> Ntrip {
        let user = Some(("me".to_owned(), "secret".to_owned()));
        let place = Place { host: "h".into(), port: 2101, user };
        Ntrip { place, mount: "M".into(), tls: false }
    }

    /// The examples of RFC 4648, section 10.
    #[test]
    fn base64_of_the_standard() {
        let examples = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ];
        for (plain, encoded) in examples {
            assert_eq!(base64(plain.as_bytes()), encoded);
        }
    }

    #[test]
    fn requests_of_both_versions() {
        let two = request(&caster(), 2, Some("$GPGGA,*00\r\n"));
        assert!(two.starts_with("GET /M HTTP/1.1\r\nHost: h:2101\r\nNtrip-Version: Ntrip/2.0\r\n"));
        assert!(two.contains("\r\nAuthorization: Basic bWU6c2VjcmV0\r\n"), "{two}");
        assert!(two.ends_with("\r\nNtrip-GGA: $GPGGA,*00\r\n\r\n"), "{two}");
        let mut anonymous = caster();
        anonymous.place.user = None;
        let one = request(&anonymous, 1, Some("$GPGGA,*00\r\n"));
        assert!(one.starts_with("GET /M HTTP/1.0\r\nUser-Agent: NTRIP Kurs/"), "{one}");
        assert!(one.ends_with("\r\n\r\n") && !one.contains("GGA") && !one.contains("Auth"));
    }

    #[test]
    fn answers_are_judged() {
        let judged = |lines: &[&str]| {
            let lines: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
            match judge(&lines, &caster()) {
                Ok(chunked) => format!("stream {chunked}"),
                Err(NtripError::Final(what)) => format!("final {what}"),
                Err(error) => format!("again {error}"),
            }
        };
        assert_eq!(judged(&["ICY 200 OK"]), "stream false");
        assert_eq!(judged(&["HTTP/1.1 200 OK", "Content-Type: gnss/data"]), "stream false");
        assert_eq!(judged(&["HTTP/1.1 200 OK", "transfer-encoding: Chunked"]), "stream true");
        let refused = judged(&["HTTP/1.1 401 Unauthorized"]);
        assert!(refused.starts_with("final") && refused.contains("password of me"), "{refused}");
        for lines in [
            &["SOURCETABLE 200 OK"][..],
            &["HTTP/1.1 404 Not Found"],
            &["HTTP/1.1 200 OK", "Content-Type: gnss/sourcetable"],
        ] {
            assert!(judged(lines).contains("no such mount point"), "{lines:?}");
        }
        assert!(judged(&["HTTP/1.1 503 Busy"]).starts_with("again"));
        assert!(judged(&["\u{fffd}nonsense"]).starts_with("again"));
    }

    #[test]
    fn whatever_a_caster_sends_is_read_to_its_end() {
        let body = |text: &str| body_of_answer(text.as_bytes());
        assert_eq!(body("ICY 200 OK\r\nstream").unwrap(), b"stream");
        assert_eq!(body("HTTP/1.0 200 OK\n\nstream").unwrap(), b"stream");
        let chunked = "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n";
        assert_eq!(
            body(&format!("{chunked}3\r\nstr\r\n3;x\r\neam\r\n0\r\n\r\n")).unwrap(),
            b"stream"
        );
        // Cut off, without a size, with one that is larger than all that comes.
        assert_eq!(body(&format!("{chunked}6\r\nstre")).unwrap(), b"stre");
        assert_eq!(body(&format!("{chunked}3\r\nstr\r\nnone\r\neam")).unwrap(), b"str");
        assert_eq!(body(&format!("{chunked}FFFFFFFFFFFFFFFF\r\nstr")).unwrap(), b"str");
        assert_eq!(body(&format!("{chunked}1FFFFFFFFFFFFFFFF\r\nstr")).unwrap(), b"");
        assert!(body("").unwrap_err().contains("without an answer"));
        assert!(body(&"x".repeat(100_000)).unwrap_err().contains("the caster answers"));
        let endless = format!("HTTP/1.1 200 OK\r\n{}", "A: b\r\n".repeat(100_000));
        assert!(body(&endless).is_ok(), "no more than the first lines are kept");
    }

    /// Bytes of an answer changed, left out and doubled at random: something is made of all of
    /// them.
    #[test]
    fn mutated_answers_are_answers() {
        let answer = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nstr\r\n3;x\r\neam\r\n0\r\n\r\n";
        // Knuth's multiplier: any sequence will do.
        let mut state = 1u64;
        let mut below = |limit: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as usize % limit
        };
        let mut streams = 0;
        for _ in 0..3000 {
            let mut bytes = answer.to_vec();
            for _ in 0..=below(4) {
                let at = below(bytes.len());
                match below(3) {
                    0 => bytes[at] = u8::try_from(below(256)).unwrap(),
                    1 => bytes.truncate(at + 1),
                    _ => bytes.extend_from_within(at..),
                }
            }
            match body_of_answer(&bytes) {
                Ok(body) => {
                    streams += 1;
                    assert!(body.len() <= bytes.len());
                }
                Err(what) => assert!(!what.is_empty()),
            }
        }
        assert!(streams > 1000, "{streams}");
    }
}
