//! Programs of others feed the service and read it.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;

use super::stage::{
    Partner, Receivers, Service, configuration, free_port, logs, statuses, wait_for,
};

/// RTKLIB's str2str as a caster, socat with a serial port, gpsd as the reader.
#[test]
fn foreign_programs_feed_it_and_read_it() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "rtcm3", 0.2, "1");
    let (caster, port) = (free_port(), free_port());
    let from = format!("tcpcli://127.0.0.1:{}", receivers.port);
    let to = format!("ntripc://:{caster}/BOW");
    let Some(_str2str) = Partner::start("str2str", &["-in", &from, "-out", &to]) else { return };
    let line = folder.path().join("ttyKurs");
    let pty = format!("pty,rawer,link={}", line.display());
    let from = format!("tcp:127.0.0.1:{}", receivers.port + 1);
    let Some(_socat) = Partner::start("socat", &[&pty, &from]) else { return };
    wait_for("the serial port", || line.exists().then_some(()));

    let streams = [
        format!("stream = \"ntrip://127.0.0.1:{caster}/BOW\""),
        format!("stream = \"serial://{}?baud=460800\"", line.display()),
    ];
    let more = format!("[[output]]\nto = \"tcp-listen://:{port}\"\nprofile = \"gpsd\"\n");
    let text = configuration([&streams[0], &streams[1]], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let out = service.out.clone();
    wait_for("fixed rows", || statuses(&out).iter().any(|(_, s)| s == "fixed").then_some(()));

    let daemon = free_port().to_string();
    let device = format!("tcp://127.0.0.1:{port}");
    let Some(_gpsd) = Partner::start("gpsd", &["-n", "-N", "-S", &daemon, &device]) else { return };
    let mut client = wait_for("gpsd", || TcpStream::connect(format!("127.0.0.1:{daemon}")).ok());
    client.write_all(b"?WATCH={\"enable\":true,\"json\":true};\n").unwrap();
    client.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut lines = BufReader::new(client).lines().map_while(Result::ok);
    // Of the two antennas the roll is unknown.
    let mut report = |class: &str, name: &str| {
        let found = lines.find_map(|line| {
            let value: serde_json::Value = serde_json::from_str(&line).unwrap();
            (value["class"] == class && value["roll"].is_null()).then(|| value[name].as_f64())?
        });
        found.unwrap_or_else(|| panic!("gpsd gives no {name} in {class}"))
    };
    for (class, name, wanted, limit) in [
        ("ATT", "heading", 40.0, 2.0),
        ("ATT", "pitch", 3.0, 3.0),
        ("TPV", "lat", 52.0, 1e-3),
        ("TPV", "altHAE", 100.0, 30.0),
    ] {
        let found = report(class, name);
        assert!((found - wanted).abs() < limit, "{class} {name}: {found}");
    }
}

/// The client of pygnssutils, which hands on to a service what a caster sends.
const NTRIP_CLIENT: &str = r#"
import socket, time
from pygnssutils import GNSSNTRIPClient

service = socket.create_connection(("127.0.0.1", SERVICE))
GNSSNTRIPClient().run(server="127.0.0.1", port=CASTER, mountpoint="pygnssutils", ntripuser="me", ntrippassword="secret", output=service)
time.sleep(60)
"#;

/// The casters of pygnssutils (PyPI), one for each antenna, with a password; the stream of the
/// second one comes through its client.
#[test]
fn casters_and_client_of_pygnssutils_feed_it() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "rtcm3", 0.2, "1");
    let casters = [free_port(), free_port()];
    let mut partners = Vec::new();
    for (port, caster) in (receivers.port..).zip(casters) {
        let (from, to) = (format!("127.0.0.1:{port}"), caster.to_string());
        let flags =
            ["-N", "1", "-H", "127.0.0.1", "--ntripuser", "me", "--ntrippassword", "secret"];
        let arguments = [&["-S", &from, "-O", &to], &flags[..]].concat();
        let Some(partner) = Partner::start("gnssserver", &arguments) else { return };
        partners.push(partner);
        wait_for("the caster", || TcpStream::connect(("127.0.0.1", caster)).ok());
    }
    let port = free_port();
    let streams = [
        format!("stream = \"ntrip://me:secret@127.0.0.1:{}/pygnssutils\"", casters[0]),
        format!("stream = \"tcp-listen://127.0.0.1:{port}\""),
    ];
    // The ephemerides were sent before anybody listened.
    let files = format!("as_received = true\nfiles = [\"{}\"]", logs().join("nav.rnx").display());
    let text = configuration([&streams[0], &streams[1]], "").replace("as_received = true", &files);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    wait_for("the service", || TcpStream::connect(("127.0.0.1", port)).ok());
    let client = NTRIP_CLIENT.replace("CASTER", &casters[1].to_string());
    let client = client.replace("SERVICE", &port.to_string());
    let _client = Partner::start("python3", &["-c", &client]);
    let fixed = |out: &Path| statuses(out).iter().filter(|(_, s)| s == "fixed").count();
    wait_for("fixed rows", || (fixed(&service.out) > 10).then_some(()));
}
