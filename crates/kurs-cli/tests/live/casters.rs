//! NTRIP casters: both versions, passwords, stalls, TLS.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use super::outside;
use super::stage::{
    EPOCHS, Partner, Service, assert_same, caster, configuration, free_port, kurs, log, rows,
    serve, solved, statuses, wait_for,
};

/// The body of an answer in chunks, one of them a single byte.
fn chunked(bytes: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    for piece in [&bytes[..1], &bytes[1..5000], &bytes[5000..]] {
        body.extend(format!("{:X};x=y\r\n", piece.len()).into_bytes());
        body.extend(piece);
        body.extend(b"\r\n");
    }
    body.extend(b"0\r\n\r\n");
    body
}

#[test]
fn casters_of_both_versions_give_the_rows_of_solve() {
    let folder = tempfile::tempdir().unwrap();
    let (one, asked_one) = caster("ICY 200 OK\r\n\r\n", log(0, "rtcm3"));
    let two = "HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nContent-Type: gnss/data\r\n\
               Transfer-Encoding: chunked\r\n\r\n";
    let (two, asked_two) = caster(two, chunked(&log(1, "rtcm3")));
    let streams = [
        format!("stream = \"ntrip://127.0.0.1:{one}/BOW\""),
        format!("stream = \"ntrip://me%40home:secret@127.0.0.1:{two}/STERN\""),
    ];
    let live = "[live]\ndeadline_ms = 20000\n";
    let configuration = configuration([&streams[0], &streams[1]], live);
    let service = Service::start(folder.path(), &configuration, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(120));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &solved(folder.path(), "rtcm3", "instantaneous"), "ntrip");
    assert!(asked_one.join().unwrap().starts_with("GET /BOW HTTP/1.1\r\n"));
    let asked = asked_two.join().unwrap();
    // me@home:secret
    assert!(asked.contains("Authorization: Basic bWVAaG9tZTpzZWNyZXQ=\r\n"), "{asked}");
}

/// One refuses the password: it is not asked again, and the other antenna goes on.
#[test]
fn a_refused_password_is_final_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let (port, _) = caster("HTTP/1.1 401 Unauthorized\r\n\r\n", Vec::new());
    let streams = [
        format!("stream = \"ntrip://me:secret@127.0.0.1:{port}/M\""),
        format!("stream = \"tcp://127.0.0.1:{}\"", serve(log(1, "ubx"), 0)),
    ];
    let file = folder.path().join("live.toml");
    fs::write(&file, configuration([&streams[0], &streams[1]], "")).unwrap();
    let mut command = kurs();
    command.arg("live").arg(&file).args(["--once", "--out"]).arg(folder.path().join("live"));
    let output = command.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    let why = "the caster refuses the password of me; it is not asked again before a restart";
    assert!(said.contains(why), "{said}");
    assert!(!said.contains("secret"), "{said}");
    assert_eq!(rows(&folder.path().join("live"))[0].lines().count(), EPOCHS + 1);
}

/// A mount point that has worked is absent for a moment, and the caster answers with its table: it
/// is asked again.
#[test]
fn a_mount_point_that_was_there_is_asked_for_again() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let bytes = log(0, "ubx");
        let middle = bytes.len() / 2;
        let table = "SOURCETABLE 200 OK\r\nContent-Type: text/plain\r\n\r\nENDSOURCETABLE\r\n";
        for (answer, body) in [
            ("ICY 200 OK\r\n\r\n", &bytes[..middle]),
            (table, &[][..]),
            ("ICY 200 OK\r\n\r\n", &bytes[middle..]),
        ] {
            let (mut stream, _) = listener.accept().unwrap();
            let _ = stream.write_all(answer.as_bytes());
            let _ = stream.write_all(body);
            // Closed with something unread it would take back what was sent.
            let _ = stream.shutdown(Shutdown::Write);
            let _ = stream.read_to_end(&mut Vec::new());
        }
    });
    let streams = [
        format!("stream = \"ntrip://127.0.0.1:{port}/M\""),
        "stream = \"tcp://127.0.0.1:1\"".to_owned(),
    ];
    let service =
        Service::start(folder.path(), &configuration([&streams[0], &streams[1]], ""), &[]);
    service.wait_for_words("no such mount point; it has worked before and is asked again");
    wait_for("the rest", || (statuses(&service.out).len() > EPOCHS * 3 / 4).then_some(()));
}

/// First it says nothing, then nonsense, then that it is busy; in the end there is a stream.
#[test]
fn a_caster_that_stalls_is_asked_again() {
    let folder = tempfile::tempdir().unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let answers = ["", "\u{1}\u{2}\r\n\r\n", "HTTP/1.1 503 Busy\r\n\r\n", "ICY 200 OK\r\n\r\n"];
        let mut stalled = Vec::new();
        for answer in answers {
            let (mut stream, _) = listener.accept().unwrap();
            let _ = stream.write_all(answer.as_bytes());
            if answer.starts_with("ICY") {
                let _ = stream.write_all(&log(0, "ubx"));
            }
            if answer.is_empty() {
                stalled.push(stream);
            }
        }
    });
    let streams = [
        format!("stream = \"ntrip://127.0.0.1:{port}/M\""),
        format!("stream = \"tcp://127.0.0.1:{}\"", serve(log(1, "ubx"), 0)),
    ];
    let live = "[live]\ndeadline_ms = 60000\n";
    let service = Service::start(
        folder.path(),
        &configuration([&streams[0], &streams[1]], live),
        &["--once"],
    );
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    assert!(rows(&out)[0].contains(",fixed,"));
}

/// A caster with its own certificate, which the system is told to trust; another one is refused.
#[test]
fn a_caster_over_tls_must_show_a_certificate_that_is_trusted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let make = Command::new("openssl")
        .args(["req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"])
        .args(["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"])
        .args(["-addext", "basicConstraints=critical,CA:FALSE"])
        .args(["-keyout", &path("key.pem"), "-out", &path("cert.pem")])
        .output();
    let Ok(made) = make else { return outside::lacking("no openssl") };
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let run = |trusted: &str, out: &str| {
        let port = free_port();
        let mut server = Command::new("openssl")
            .args(["s_server", "-quiet", "-accept", &port.to_string()])
            .args(["-cert", &path("cert.pem"), "-key", &path("key.pem")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (mut input, output) = (server.stdin.take().unwrap(), server.stdout.take().unwrap());
        let server = Partner(server);
        wait_for("the caster", || TcpListener::bind(("127.0.0.1", port)).is_err().then_some(()));
        // Answers when the request has come.
        thread::spawn(move || {
            let mut line = String::new();
            if BufReader::new(output).read_line(&mut line).is_ok() && line.starts_with("GET /M") {
                let _ = input.write_all(b"ICY 200 OK\r\n\r\n");
                let _ = input.write_all(&log(0, "ubx"));
            }
        });
        let streams = [
            format!("stream = \"ntrips://localhost:{port}/M\""),
            format!("stream = \"tcp://127.0.0.1:{}\"", serve(log(1, "ubx"), 1)),
        ];
        let file = folder.path().join("live.toml");
        let live = "[live]\ndeadline_ms = 20000\n";
        fs::write(&file, configuration([&streams[0], &streams[1]], live)).unwrap();
        let mut command = kurs();
        command.arg("live").arg(&file).arg("--out").arg(path(out)).env("SSL_CERT_FILE", trusted);
        command.stdout(Stdio::null()).stderr(fs::File::create(path("said.txt")).unwrap());
        (Partner(command.spawn().unwrap()), server)
    };
    let running = run(&path("cert.pem"), "trusted");
    let out = PathBuf::from(path("trusted"));
    wait_for("fixed rows", || statuses(&out).iter().any(|(_, s)| s == "fixed").then_some(()));
    drop(running);
    fs::write(path("none.pem"), "").unwrap();
    let _running = run(&path("none.pem"), "refused");
    wait_for("a refusal", || {
        let said = fs::read_to_string(path("said.txt")).unwrap();
        said.to_lowercase().contains("certificate").then_some(())
    });
}
