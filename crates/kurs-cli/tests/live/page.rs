//! The page: what it shows, and who may do what.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::thread;

use super::stage::{Receivers, Service, configuration, free_port, get, statuses, wait_for};

/// Beyond the loopback the page is for those who have the token.
#[test]
fn a_page_for_others_wants_a_token() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("token"), "0123456789abcdef\n").unwrap();
    let page = free_port();
    let live = format!("[live]\npage = \"0.0.0.0:{page}\"\ntoken_file = \"token\"\n");
    let stream = "stream = \"tcp://127.0.0.1:1\"";
    let service =
        Service::start(folder.path(), &configuration([stream, stream], &live), &["--quiet"]);
    let ask = |header: &str| {
        let mut stream = wait_for("the page", || TcpStream::connect(("127.0.0.1", page)).ok());
        write!(
            stream,
            "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{header}\r\n"
        )
        .unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text.split(' ').nth(1).unwrap().to_owned()
    };
    assert_eq!(ask(""), "401");
    assert_eq!(ask("Authorization: Bearer 0123456789abcdeF\r\n"), "401");
    assert_eq!(ask("Authorization: Bearer 0123456789abcdef0\r\n"), "401");
    assert_eq!(ask("Authorization: Bearer 0123456789abcdef\r\n"), "200");
    drop(service);
}

/// Without a token: nothing is asked for what is not there.
#[test]
fn a_page_at_the_loopback_says_that_something_is_not_there() {
    let folder = tempfile::tempdir().unwrap();
    let page = free_port();
    let live = format!("[live]\npage = \"127.0.0.1:{page}\"\n");
    let stream = "stream = \"tcp://127.0.0.1:1\"";
    let service =
        Service::start(folder.path(), &configuration([stream, stream], &live), &["--quiet"]);
    wait_for("the page", || TcpStream::connect(("127.0.0.1", page)).ok());
    assert_eq!(get(page, "/nix").0, 404);
    assert_eq!(get(page, "/metrics").0, 200);
    assert_eq!(request(page, "POST /api/mark", "", ""), "403", "changes need a token");
    drop(service);
}

/// The feed of a page: names and contents of its messages.
fn feed(port: u16) -> impl Iterator<Item = (String, serde_json::Value)> {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    write!(stream, "GET /feed HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut lines = BufReader::new(stream).lines().map_while(Result::ok);
    std::iter::from_fn(move || {
        let name = lines.find_map(|line| line.strip_prefix("event: ").map(str::to_owned))?;
        let data = lines.find_map(|line| line.strip_prefix("data: ").map(str::to_owned))?;
        Some((name, serde_json::from_str(&data).unwrap()))
    })
}

/// Status of a request with these header lines and this body.
fn request(port: u16, line: &str, headers: &str, body: &str) -> String {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    let length = body.len();
    write!(
        stream,
        "{line} HTTP/1.1\r\nHost: localhost:{port}\r\nConnection: close\r\nContent-Length: {length}\r\n\
         {headers}\r\n{body}"
    )
    .unwrap();
    let mut text = Vec::new();
    let _ = stream.read_to_end(&mut text);
    String::from_utf8_lossy(&text).split(' ').nth(1).unwrap_or("closed").to_owned()
}

/// Two hundred pages, and clients that never read, beside one output: what the pages show is what
/// leaves there, row by row. Only the token changes anything.
#[test]
fn pages_show_the_stream_and_change_nothing_without_the_token() {
    const TOKEN: &str = "0123456789abcdef";
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("token"), TOKEN).unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.1, "1");
    let [page, lines] = [(); 2].map(|()| free_port());
    // A peer of its own.
    let live = format!(
        "[live]\nbody = \"roof\"\npage = \"127.0.0.1:{page}\"\ntoken_file = \"token\"\n[log]\ndir = \"logs\"\n\
         [[peer]]\nname = \"mirror\"\nfrom = \"tcp://127.0.0.1:{lines}\"\n[[output]]\nto = \"tcp-listen://127.0.0.1:{lines}\"\nprofile = \"jsonl\"\n"
    );
    let streams = receivers.streams();
    let text = configuration([&streams[0], &streams[1]], &live);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let output = wait_for("the output", || TcpStream::connect(("127.0.0.1", lines)).ok());
    wait_for("fixed rows", || {
        let all = statuses(&service.out);
        (all.iter().filter(|(_, status)| status == "fixed").count() > 5).then_some(())
    });
    let silent: Vec<TcpStream> = (0..20)
        .map(|_| {
            let mut stream = TcpStream::connect(("127.0.0.1", page)).unwrap();
            write!(stream, "GET /feed HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
            stream
        })
        .collect();
    let sent = thread::spawn(move || {
        let lines = BufReader::new(output).lines().map(Result::unwrap);
        let lines = lines.map(|line| serde_json::from_str::<serde_json::Value>(&line).unwrap());
        lines.take(60).collect::<Vec<_>>()
    });
    let pages: Vec<_> = (0..200).map(|_| feed(page)).collect();
    let shown: Vec<Vec<(String, serde_json::Value)>> =
        pages.into_iter().map(|page| page.take(20).collect()).collect();
    let sent = sent.join().unwrap();
    let mut compared = 0;
    for messages in &shown {
        let first: Vec<&str> = messages.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(first[..3], ["hello", "history", "state"]);
        assert_eq!(messages[0].1["body"], "roof");
        assert!(messages[1].1["points"].as_array().unwrap().len() > 1);
        for (_, row) in messages.iter().filter(|(name, _)| name == "row") {
            let of_output = sent.iter().find(|sent| sent["time_gpst"] == row["time_gpst"]);
            compared += usize::from(of_output.is_some_and(|of_output| {
                assert_eq!(of_output, row);
                true
            }));
        }
    }
    assert!(compared > 1000, "{compared} rows of pages are among those of the output");

    let state = shown[0].iter().rfind(|(name, _)| name == "state").unwrap();
    assert_eq!(state.1["streams"].as_array().unwrap().len(), 3);
    assert!(state.1["sky"]["antennas"][1].as_array().unwrap().len() > 5, "{}", state.1);
    let ahead_m = state.1["array"][0]["forward_m"].as_f64().unwrap();
    assert!((ahead_m - 1.2).abs() < 0.05, "{ahead_m}");
    assert_eq!(state.1["streams"][0]["trouble"], serde_json::Value::Null);

    let shows = format!("Authorization: Bearer {TOKEN}\r\n");
    let elsewhere = format!("{shows}Origin: http://elsewhere.example\r\n");
    let attempts = ["POST /api/mark", "POST /api/streams/A0/restart", "GET /api/streams/A0/log"];
    for line in attempts {
        let wrong = "Authorization: Bearer 0123456789abcdeF\r\n";
        for (headers, status) in [("", "401"), (wrong, "401"), (elsewhere.as_str(), "403")] {
            assert_eq!(request(page, line, headers, "not to be seen"), status, "{line} {headers}");
        }
    }
    assert!(!folder.path().join("logs/marks.csv").exists());
    let of = |line: &str, body: &str| request(page, line, &shows, body);
    assert_eq!(of("POST /api/mark", "anchor up"), "200");
    assert_eq!(of("POST /api/mark", "two\nlines"), "400");
    assert_eq!(of("POST /api/mark", &"x".repeat(5000)), "413");
    for stream in ["A0", "mirror"] {
        assert_eq!(of(&format!("POST /api/streams/{stream}/restart"), ""), "200");
    }
    assert_eq!(of("POST /api/streams/nobody/restart", ""), "404");
    assert_eq!(of("GET /api/streams/A1/log", ""), "200");
    assert_eq!(of("GET /api/streams/..%2f..%2ftoken/log", ""), "404");
    let marks = fs::read_to_string(folder.path().join("logs/marks.csv")).unwrap();
    assert_eq!(marks.lines().count(), 1);
    assert!(marks.ends_with(",\"anchor up\"\n"), "{marks}");
    let happened = wait_for("the mark", || {
        let (_, events) = feed(page).find(|(name, _)| name == "events")?;
        events.to_string().contains("anchor up").then_some(events)
    });
    assert!(!happened.to_string().contains("not to be seen"));
    for stream in ["A0", "mirror"] {
        wait_for("a connection made again", || {
            let metrics = get(page, "/metrics").1;
            let again = format!("kurs_stream_connections_total{{stream=\"{stream}\"}} 2");
            metrics.contains(&again).then_some(())
        });
    }
    drop((silent, service, receivers));
}
