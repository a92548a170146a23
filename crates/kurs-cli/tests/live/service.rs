//! A service from its configuration to its end: what is wrong in it, what it explains, what it
//! serves, how it is told anew.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::Stdio;
use std::time::Duration;

use super::stage::{
    EPOCHS, Partner, Receivers, Service, configuration, free_port, get, kurs, logs, rows, statuses,
    wait_for,
};

/// The logs at the pace at which they were recorded, four times faster, with JSON lines and
/// sentences to clients, metrics and health, and a clean stop.
#[test]
fn a_paced_log_is_a_service_like_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let stream = |index: usize| {
        let log = logs().join(format!("A{index}.ubx"));
        format!("stream = \"file://{}?speed=4\"", log.display())
    };
    let ports = [(); 4].map(|()| free_port());
    let more = format!(
        "[live]\nbody = \"roof\"\npage = \"127.0.0.1:{}\"\nstate_dir = \"{}\"\n\
         [[output]]\nto = \"tcp-listen://:{}\"\nprofile = \"jsonl\"\n\
         [[output]]\nto = \"tcp-listen://:{}\"\nprofile = \"marine\"\nrate_hz = 1\n\
         [[output]]\nto = \"udp://:{}\"\nprofile = \"csv\"\n",
        ports[0],
        folder.path().join("state").display(),
        ports[1],
        ports[2],
        ports[3],
    );
    let datagrams = std::net::UdpSocket::bind(("127.0.0.1", ports[3])).unwrap();
    datagrams.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let configuration = configuration([&stream(0), &stream(1)], &more);
    let service = Service::start(folder.path(), &configuration, &["--quiet"]);
    let connect =
        |port: u16| wait_for("the output", || TcpStream::connect(("127.0.0.1", port)).ok());
    let lines = BufReader::new(connect(ports[1])).lines();
    let sentences = BufReader::new(connect(ports[2])).lines();

    let mut fixed: Vec<serde_json::Value> = Vec::new();
    let mut last = String::new();
    for line in lines.take(60) {
        let value: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        let time = value["measured_gpst"].as_str().unwrap().to_owned();
        assert!(time > last, "{time} after {last}: one epoch, one message");
        last = time;
        if value["status"] == "fixed" {
            fixed.push(value);
        }
    }
    assert!(fixed.len() > 50, "{}", fixed.len());
    for value in &fixed {
        let heading_deg = value["heading_deg"].as_f64().unwrap();
        assert!((heading_deg - 40.0).abs() < 2.0, "{value}");
        assert_eq!(value["body"], "roof");
    }
    let groups = sentences.take(24).filter(|line| line.as_ref().unwrap().starts_with("$GNHDT"));
    assert_eq!(groups.count(), 3, "eight sentences from GGA to XDR once a second of the log");
    let mut datagram = [0; 2048];
    let length = datagrams.recv(&mut datagram).unwrap();
    assert!(std::str::from_utf8(&datagram[..length]).unwrap().starts_with("2024-03-"));

    let metrics = get(ports[0], "/metrics").1;
    for name in [
        "kurs_rows_total{status=\"fixed\"}",
        "kurs_stream_up{stream=\"A1\"} 1",
        "kurs_latency_seconds_count",
    ] {
        assert!(metrics.contains(name), "{name}: {metrics}");
    }
    // The logs are over: that is no longer well.
    let trouble = wait_for("the end of the logs", || {
        let (status, body) = get(ports[0], "/healthz");
        (status == 503 && body.contains("no row")).then_some(body)
    });
    assert!(trouble.contains("A0 has ended"), "{trouble}");

    service.signal("-TERM");
    let (status, out) = service.end(Duration::from_secs(10));
    assert_eq!(status, Some(0));
    assert_eq!(rows(&out)[0].lines().count(), EPOCHS + 1);
    assert!(folder.path().join("state/ephemerides.rnx").exists());
}

#[test]
fn what_is_wrong_in_a_configuration_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let good = "stream = \"tcp://127.0.0.1:1\"";
    for (lines, more, part) in [
        ([good, "obs = [\"a.ubx\"]"], "", "A1: no `stream`"),
        ([good, "stream = \"tcp://nowhere\""], "", "HOST:PORT"),
        ([good, good], "[live]\ndeadline_ms = 0\n", "live.deadline_ms is 0"),
        ([good, good], "[live]\npage = \"0.0.0.0:80\"\n", "loopback"),
        ([good, good], "[live]\npage = \"nowhere\"\n", "127.0.0.1:PORT"),
        ([good, good], "[live]\ntoken_file = \"none\"\n", "live.token_file"),
        ([good, good], "[live]\npages = 1\n", "`pages`"),
        (
            [good, good],
            "[live]\npage = \"127.0.0.1:7001\"\n[[output]]\nto = \"tcp-listen://:7001\"\nprofile = \"csv\"\n",
            "live.page: 127.0.0.1:7001 is taken by output 1 to already",
        ),
        ([good, good], "[[output]]\nto = \"file://a\"\nprofile = \"csv\"\n", "tcp-listen://"),
        (
            [good, good],
            "[[output]]\nto = \"udp://:1\"\nprofile = \"px5\"\n",
            "ardupilot:mavlink, px4,",
        ),
        (
            [good, good],
            "[[output]]\nto = \"udp://:1\"\nprofile = \"marine\"\nfloat = true\n",
            "profile `marine` has fixed angles alone",
        ),
    ] {
        let file = folder.path().join("live.toml");
        fs::write(&file, configuration(lines, more)).unwrap();
        let output =
            kurs().arg("live").arg(&file).arg("--out").arg(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(part), "{part}: {said}");
    }
}

/// Numbers are those of the array in the axes of the reader; an array that does not suit is
/// refused, by the service too.
#[test]
fn what_to_set_at_a_reader_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("live.toml");
    let explain = |places: &[[f64; 3]], output: &str, word: &str| {
        let antennas = places.iter().enumerate().map(|(k, place)| {
            format!(
                "[[antenna]]\nname = \"A{k}\"\nstream = \"udp://:{}\"\nposition_m = {place:?}\n",
                k + 1
            )
        });
        fs::write(&file, antennas.collect::<String>() + output).unwrap();
        let output = kurs().arg("live").arg(&file).args(["--explain", word]).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    };
    let three = [[0.5, 0.0, 0.0], [-0.7, 0.0, -0.2], [0.5, 0.9, 0.0]];
    let serial =
        "[[output]]\nto = \"serial:///dev/ttyS9?baud=230400\"\nprofile = \"ardupilot:ubx\"\n";
    for (word, parts) in [
        // From A1, behind, to A0: forward is positive.
        (
            "ardupilot:ubx",
            &[
                "MB_OFS_X = 1.200",
                "MB_OFS_Z = 0.200",
                "230400 baud",
                "at most 20 Hz",
                "GPS1_TYPE = 18 (",
            ][..],
        ),
        (
            "px4",
            &[
                "No [[output]] has",
                "from A0 to A1, 1.217 m",
                "(-1.200, 0.000, -0.200)",
                "GPS_YAW_OFFSET = 180.0",
            ],
        ),
        ("ardupilot", &["GPS1_TYPE = 5", "0.50 m away from it"]),
        ("ardupilot:mavlink", &["GPS1_TYPE = 14"]),
        ("gpsd", &["gpspipe -w"]),
        ("ros2", &["/kurs/imu"]),
        ("jsonl", &["attitude.csv"]),
    ] {
        let (status, said, error) = explain(&three, serial, word);
        assert_eq!(status, Some(0), "{word}: {error}");
        parts.iter().for_each(|part| assert!(said.contains(part), "{word}, {part}: {said}"));
    }
    let (status, _, error) = explain(&three, "", "px5");
    assert_eq!(status, Some(2));
    assert!(error.contains("unknown profile `px5`, expected one of jsonl"), "{error}");
    // A ship: the second antenna is 12 m away.
    let long = [[0.0, 0.0, 0.0], [-12.0, 0.0, 0.0]];
    let (status, _, error) = explain(&long, "", "px4");
    assert_eq!(status, Some(2));
    assert!(error.contains("less than 10 m away from the first"), "{error}");
    assert_eq!(explain(&long, "", "ardupilot:ubx").0, Some(0));
    fs::write(&file, fs::read_to_string(&file).unwrap() + &serial.replace("ardupilot:ubx", "px4"))
        .unwrap();
    let served = kurs().arg("live").arg(&file).arg("--out").arg(folder.path()).output().unwrap();
    assert_eq!(served.status.code(), Some(2));
}

/// SIGHUP with another stream for one antenna: the connection of the other one stays.
#[test]
fn a_reload_changes_only_what_has_changed() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "1");
    let page = free_port();
    let [first, second] = receivers.streams();
    let live = format!("[live]\npage = \"127.0.0.1:{page}\"\n");
    let text = configuration([&first, &second], &live);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let out = service.out.clone();
    wait_for("fixed rows", || statuses(&out).iter().any(|(_, s)| s == "fixed").then_some(()));
    // The same receiver by another name.
    let moved = second.replace("127.0.0.1", "localhost");
    fs::write(folder.path().join("live.toml"), configuration([&first, &moved], &live)).unwrap();
    service.signal("-HUP");
    let count = |metrics: &str, stream: &str| -> u32 {
        let name = format!("kurs_stream_connections_total{{stream=\"{stream}\"}} ");
        let line = metrics.lines().find(|line| line.starts_with(&name)).unwrap();
        line[name.len()..].parse().unwrap()
    };
    let metrics = wait_for("the second connection", || {
        let metrics = get(page, "/metrics").1;
        (count(&metrics, "A1") == 2).then_some(metrics)
    });
    assert_eq!(count(&metrics, "A0"), 1);
    let before = statuses(&out).len();
    wait_for("fixed rows after the reload", || {
        statuses(&out)[before..].iter().any(|(_, s)| s == "fixed").then_some(())
    });
    // What is not taken over is named.
    let more =
        format!("{live}body = \"other\"\n[[output]]\nto = \"udp://:9\"\nprofile = \"csv\"\n");
    fs::write(folder.path().join("live.toml"), configuration([&first, &moved], &more)).unwrap();
    service.signal("-HUP");
    service.wait_for_words("changed, but only by a restart: live.body, [[output]]");
    // A configuration that is wrong changes nothing.
    fs::write(folder.path().join("live.toml"), "nonsense = 1").unwrap();
    service.signal("-HUP");
    let before = statuses(&out).len();
    wait_for("fixed rows after a wrong reload", || {
        statuses(&out)[before..].iter().any(|(_, s)| s == "fixed").then_some(())
    });
}

/// The demonstration as a user would see it: a line of text names the port, which has a heading.
#[test]
fn the_demonstration_gives_a_heading_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = kurs();
    command.args(["demo", "--live", "--out"]).arg(folder.path());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut told = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut told).unwrap();
    let demo = Partner(child);
    let port = told.split("127.0.0.1:").nth(1).unwrap().split(',').next().unwrap();
    let stream = wait_for("the output", || TcpStream::connect(format!("127.0.0.1:{port}")).ok());
    let heading_deg = BufReader::new(stream).lines().take(50).find_map(|line| {
        let value: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        value["heading_deg"].as_f64()
    });
    // The car stands with its nose to the north for ten seconds.
    let heading_deg = heading_deg.expect("a heading within five seconds");
    assert!(heading_deg.min(360.0 - heading_deg) < 3.0, "{heading_deg}");
    drop(demo);
}
