//! `kurs live` on simulated logs: its rows are those of `kurs solve`, whatever way the bytes take.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

#[path = "../../../tests/outside.rs"]
mod outside;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use kurs::ephemeris::NavigationData;
use kurs::frames::Geodetic;
use kurs::observation::AntennaEpoch;
use kurs_formats::logs::{LogOptions, LogReader};
use kurs_formats::sbf::SbfWriter;
use kurs_formats::source::Source;
use kurs_formats::ubx::UbxWriter;

/// Two antennas at rest, twenty seconds across midnight of GPST, 5 Hz.
const SCENARIO: &str = r#"
seed = 5
start = "2024-03-09T23:59:50"
duration_s = 20.0
interval_s = 0.2
signals = ["G1C", "G2L", "E1C", "E5Q", "C2I"]

[output]
formats = ["ubx", "rtcm3", "sbf"]

[sky]
systems = ["G", "E", "C"]

[[body]]
name = "roof"
motion = { kind = "static", place = { latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }, heading_deg = 40.0, pitch_deg = 3.0 }
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, 0.0]
"#;

/// A hundred metres to the north of it.
const STATION: &str = r#"
[station]
name = "base"
place = { latitude_deg = 52.001, longitude_deg = 13.0, height_m = 90.0 }
"#;

/// The place of the station in a configuration.
fn station_position() -> String {
    let place = Geodetic::from_degrees(52.001, 13.0, 90.0).to_ecef().xyz();
    format!("position_ecef_m = [{}, {}, {}]\n", place.x, place.y, place.z)
}

const EPOCHS: usize = 101;

fn kurs() -> Command {
    Command::new(env!("CARGO_BIN_EXE_kurs"))
}

/// The simulated logs, made once.
fn logs() -> &'static Path {
    static LOGS: OnceLock<tempfile::TempDir> = OnceLock::new();
    LOGS.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), SCENARIO);
        folder
    })
    .path()
}

/// Makes the files of a scenario.
fn simulate(folder: &Path, text: &str) {
    let scenario = folder.join("scenario.toml");
    fs::write(&scenario, text).unwrap();
    let mut run = kurs();
    run.arg("simulate").arg(&scenario).args(["--quiet", "--out"]).arg(folder);
    assert!(run.status().unwrap().success());
}

/// The rows of `kurs solve`: the attitude and the baselines.
fn solve(folder: &Path, configuration: &str) -> [String; 2] {
    let file = folder.join("solve.toml");
    fs::write(&file, configuration).unwrap();
    let out = folder.join("solved");
    let run = kurs().arg("solve").arg(&file).arg("--quiet").arg("--out").arg(&out).status();
    assert!(run.unwrap().success());
    ["attitude.csv", "baselines.csv"].map(|name| fs::read_to_string(out.join(name)).unwrap())
}

/// The configuration of both antennas, each with a line of its own.
fn configuration(lines: [&str; 2], more: &str) -> String {
    let antenna = |index: usize| {
        let x = 1.2 * index as f64;
        let line = lines[index];
        format!("[[antenna]]\nname = \"A{index}\"\n{line}\nposition_m = [{x:.1}, 0.0, 0.0]\n")
    };
    // RTCM 3 has no week.
    let nav = "[nav]\nas_received = true\napproximate_time = 2024-03-10\n";
    format!("{}{}{nav}{more}", antenna(0), antenna(1))
}

/// What a run left: the attitude and the baselines, of all days.
fn rows(out: &Path) -> [String; 2] {
    ["attitude.csv", "baselines.csv"].map(|name| {
        let mut days: Vec<PathBuf> =
            fs::read_dir(out).unwrap().map(|e| e.unwrap().path()).collect();
        days.sort();
        let mut text = String::new();
        for file in days.iter().filter(|day| day.is_dir()).map(|day| day.join(name)) {
            let day = fs::read_to_string(file).unwrap();
            let rows = if text.is_empty() { &day } else { day.split_once('\n').unwrap().1 };
            text.push_str(rows);
        }
        text
    })
}

/// The rows of `kurs solve` on logs of this format.
fn solved(folder: &Path, format: &str, ambiguity: &str) -> [String; 2] {
    let obs = |index: usize| {
        format!("obs = [\"{}\"]", logs().join(format!("A{index}.{format}")).display())
    };
    let more = format!("[solve]\nambiguity = \"{ambiguity}\"\n");
    solve(folder, &configuration([&obs(0), &obs(1)], &more))
}

fn assert_same(live: &[String; 2], solved: &[String; 2], what: &str) {
    for (live, solved) in live.iter().zip(solved) {
        for (number, (live, solved)) in live.lines().zip(solved.lines()).enumerate() {
            assert_eq!(live, solved, "{what}, line {number}");
        }
        assert_eq!(live.lines().count(), solved.lines().count(), "{what}");
    }
    let rows = solved[0].lines().skip(1);
    assert_eq!(rows.clone().count(), EPOCHS);
    let fixed = rows.filter(|row| row.contains(",fixed,")).count();
    assert!(fixed > EPOCHS * 9 / 10, "{what}: {fixed} fixed");
}

/// A service that runs until it is dropped.
struct Service {
    child: Child,
    out: PathBuf,
}

impl Service {
    fn start(folder: &Path, configuration: &str, flags: &[&str]) -> Self {
        let file = folder.join("live.toml");
        fs::write(&file, configuration).unwrap();
        let out = folder.join("live");
        let mut command = kurs();
        command.arg("live").arg(&file).args(flags).arg("--out").arg(&out);
        let child = command.stdout(Stdio::null()).spawn().unwrap();
        Self { child, out }
    }

    /// Waits for its end.
    fn end(mut self, limit: Duration) -> (Option<i32>, PathBuf) {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return (status.code(), self.out.clone());
            }
            assert!(began.elapsed() < limit, "the service does not end");
            thread::sleep(Duration::from_millis(20));
        }
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits until something is there.
fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{what} does not come");
        thread::sleep(Duration::from_millis(20));
    }
}

/// A port that is free now.
fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Serves bytes to one client, in pieces of odd sizes with pauses of up to so many milliseconds.
fn serve(bytes: Vec<u8>, pause_ms: u64) -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut rest = bytes.as_slice();
        let mut state = u64::from(port);
        while !rest.is_empty() {
            // Knuth's multiplier: any sequence will do.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let length = rest.len().min(1 + (state >> 33) as usize % 3000);
            let (piece, behind) = rest.split_at(length);
            if stream.write_all(piece).is_err() {
                return;
            }
            rest = behind;
            if pause_ms > 0 {
                thread::sleep(Duration::from_millis((state >> 40) % pause_ms));
            }
        }
    });
    port
}

/// All epochs of a log; the navigation data in it go into `navigation`.
fn epochs_of(log: &Path, navigation: &mut NavigationData) -> Vec<AntennaEpoch> {
    let source = Source::new(fs::File::open(log).unwrap(), log.display().to_string()).unwrap();
    let mut reader = LogReader::of_stream(source, &LogOptions::default()).unwrap();
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).unwrap() {
        navigation.update(&reader.take_news());
        epochs.push(core::mem::take(&mut epoch));
    }
    epochs
}

fn log(index: usize, format: &str) -> Vec<u8> {
    fs::read(logs().join(format!("A{index}.{format}"))).unwrap()
}

#[test]
fn a_log_as_fast_as_possible_gives_the_rows_of_solve() {
    for format in ["ubx", "rtcm3", "sbf"] {
        for ambiguity in ["instantaneous", "continuous"] {
            let folder = tempfile::tempdir().unwrap();
            let stream = |index: usize| {
                let log = logs().join(format!("A{index}.{format}"));
                format!("stream = \"file://{}?speed=0\"", log.display())
            };
            let solve = format!("[solve]\nambiguity = \"{ambiguity}\"\n");
            let configuration = configuration([&stream(0), &stream(1)], &solve);
            let service = Service::start(folder.path(), &configuration, &["--once", "--quiet"]);
            let (status, out) = service.end(Duration::from_secs(120));
            assert_eq!(status, Some(0));
            let what = format!("{format} {ambiguity}");
            assert_same(&rows(&out), &solved(folder.path(), format, ambiguity), &what);
            let summary = fs::read_to_string(out.join("summary.json")).unwrap();
            assert!(summary.contains(&format!("\"epochs\": {EPOCHS}")), "{summary}");
        }
    }
}

/// NAV-STATUS of u-blox with this `spoofDetState`.
fn nav_status(spoofing: u8) -> Vec<u8> {
    let mut payload = [0; 16];
    payload[7] = spoofing << 3;
    kurs_formats::ubx::frame([0x01, 0x03], &payload)
}

/// A receiver that states spoofing before the 51st epoch and takes it back before the 71st: the rows between are refused, by
/// `solve` and `live` alike, and by neither if the flags are not to be used.
#[test]
fn stated_spoofing_refuses_rows() {
    let folder = tempfile::tempdir().unwrap();
    let mut pieces = pieces(&log(1, "ubx"));
    assert_eq!(pieces.len(), EPOCHS);
    pieces[50].splice(0..0, nav_status(2));
    pieces[70].splice(0..0, nav_status(1));
    let spoofed = folder.path().join("A1.ubx");
    fs::write(&spoofed, pieces.concat()).unwrap();
    let names = [logs().join("A0.ubx"), spoofed];
    let run = |command: &str, flags: &str| {
        let line = |index: usize| match command {
            "live" => format!("stream = \"file://{}?speed=0\"", names[index].display()),
            _ => format!("obs = [\"{}\"]", names[index].display()),
        };
        let file = folder.path().join(format!("{command}.toml"));
        fs::write(&file, configuration([&line(0), &line(1)], flags)).unwrap();
        let out = folder.path().join(format!("{command}-out"));
        let mut run = kurs();
        run.arg(command).arg(&file).args(["--quiet", "--out"]).arg(&out);
        if command == "live" {
            run.arg("--once");
        }
        assert!(run.status().unwrap().success());
        match command {
            "live" => rows(&out)[0].clone(),
            _ => fs::read_to_string(out.join("attitude.csv")).unwrap(),
        }
    };
    let solved = run("solve", "");
    assert_eq!(run("live", ""), solved);
    for (number, row) in solved.lines().skip(1).enumerate() {
        let is_refused = row.contains(",inconsistent,interference,");
        assert_eq!(is_refused, (50..70).contains(&number), "{number}: {row}");
    }
    let ignored = run("solve", "[solve]\nuse_interference_flags = false\n");
    assert!(!ignored.contains("interference"));
}

/// A station that is read as fast as the antennas, on which every row waits.
#[test]
fn logs_with_a_station_give_the_rows_of_solve() {
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), &(SCENARIO.to_owned() + STATION));
    let file = |name: &str| folder.path().join(name).display().to_string();
    let with_station = |key: &dyn Fn(&str) -> String| {
        let station = format!("[station]\n{}\n{}", key("base.ubx"), station_position());
        configuration([&key("A0.ubx"), &key("A1.ubx")], &station)
    };
    let obs = with_station(&|name| format!("obs = [\"{}\"]", file(name)));
    let wanted = solve(folder.path(), &obs);
    let live = with_station(&|name| format!("stream = \"file://{}?speed=0\"", file(name)));
    let service = Service::start(folder.path(), &live, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &wanted, "with a station");
}

/// In pieces of any size, with delays between the antennas that the deadline allows.
#[test]
fn tcp_gives_the_rows_of_solve() {
    for format in ["ubx", "rtcm3", "sbf"] {
        for ambiguity in ["instantaneous", "continuous"] {
            let folder = tempfile::tempdir().unwrap();
            let ports = [serve(log(0, format), 3), serve(log(1, format), 5)];
            let stream = |index: usize| format!("stream = \"tcp://127.0.0.1:{}\"", ports[index]);
            let more =
                format!("[live]\ndeadline_ms = 20000\n[solve]\nambiguity = \"{ambiguity}\"\n");
            let configuration = configuration([&stream(0), &stream(1)], &more);
            let service = Service::start(folder.path(), &configuration, &["--once", "--quiet"]);
            let (status, out) = service.end(Duration::from_secs(120));
            assert_eq!(status, Some(0));
            let what = format!("{format} {ambiguity}");
            assert_same(&rows(&out), &solved(folder.path(), format, ambiguity), &what);
        }
    }
}

/// Simulated logs as services get them, paced ten times faster than they were measured, and what `kurs solve` makes
/// of them: the same. Returns the rows and the lines that an output of profile `marine` sent.
fn paced_like_solved(scenario: &str, day: &str, format: &str) -> ([String; 2], Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), scenario);
    let dated = |lines: [&str; 2], more: &str| {
        configuration(lines, more)
            .replace("approximate_time = 2024-03-10", &format!("approximate_time = {day}"))
    };
    let file = |index: usize| folder.path().join(format!("A{index}.{format}"));
    let obs = [0, 1].map(|index| format!("obs = [\"{}\"]", file(index).display()));
    let solved = solve(folder.path(), &dated([&obs[0], &obs[1]], ""));

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let reading = thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        BufReader::new(stream).lines().map_while(Result::ok).collect()
    });
    let streams =
        [0, 1].map(|index| format!("stream = \"file://{}?speed=10\"", file(index).display()));
    let more = format!(
        "[live]\ndeadline_ms = 20000\n[[output]]\nto = \"tcp://127.0.0.1:{port}\"\nprofile = \"marine\"\n"
    );
    let text = dated([&streams[0], &streams[1]], &more);
    let service = Service::start(folder.path(), &text, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &solved, format);
    (solved, reading.join().unwrap())
}

/// One receiver's tags are a millisecond before the whole tenths of a second, those of the other one on them.
#[test]
fn tags_a_millisecond_off_are_those_of_one_epoch() {
    for format in ["ubx", "rtcm3", "sbf"] {
        let early = SCENARIO.replacen(
            "position_m = [0.0, 0.0, 0.0]",
            "position_m = [0.0, 0.0, 0.0]\ntag_offset_s = -0.001",
            1,
        );
        let (rows, _) = paced_like_solved(&early, "2024-03-10", format);
        // `.199`, `.399` and so on, whatever number of digits follows.
        let is_early = |row: &str| {
            let (time, _) = row.split_once(',').unwrap();
            time.split_once('.').unwrap().1[..3].ends_with("99")
        };
        assert!(rows[0].lines().skip(1).all(is_early), "{}", rows[0]);
    }
}

/// Across the end of 2016, when GPST − UTC went from 17 s to 18 s: in what the receivers send (UBX says the
/// difference, GLONASS counts in UTC), and in the UTC that leaves.
#[test]
fn a_leap_second_passes() {
    let across = SCENARIO
        .replace("2024-03-09T23:59:50", "2017-01-01T00:00:08")
        .replace("\"E1C\"", "\"R1C\", \"R2C\", \"E1C\"")
        .replace("systems = [\"G\",", "systems = [\"G\", \"R\",");
    for format in ["ubx", "rtcm3", "sbf"] {
        let (_, sentences) = paced_like_solved(&across, "2017-01-01", format);
        let times: Vec<&str> = sentences
            .iter()
            .filter_map(|line| line.strip_prefix("$GNZDA,"))
            .map(|line| line.rsplit_once(",00,00").unwrap().0)
            .skip_while(|time| !time.starts_with("235959.60"))
            .take(9)
            .collect();
        let wanted = [
            "235959.60,31,12,2016",
            "235959.80,31,12,2016",
            "235960.00,31,12,2016",
            "235960.20,31,12,2016",
            "235960.40,31,12,2016",
            "235960.60,31,12,2016",
            "235960.80,31,12,2016",
            "000000.00,01,01,2017",
            "000000.20,01,01,2017",
        ];
        assert_eq!(times, wanted, "{format}");
    }
}

/// Pieces of a UBX log, one for every epoch: each ends where the next RXM-RAWX begins.
fn pieces(log: &[u8]) -> Vec<Vec<u8>> {
    let rawx = [0xb5, 0x62, 0x02, 0x15];
    let mut starts: Vec<usize> =
        (0..log.len() - 4).filter(|at| log[*at..].starts_with(&rawx)).collect();
    starts[0] = 0;
    starts.push(log.len());
    starts.windows(2).map(|pair| log[pair[0]..pair[1]].to_vec()).collect()
}

/// Every tenth epoch has phases to which no integers fit: the search takes what the budget of an epoch allows, the row
/// says so, and neither it nor the one behind it is late.
#[test]
fn an_epoch_whose_search_is_hard_delays_no_other() {
    const EVERY: usize = 10;
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), SCENARIO);
    let start = Instant::now() + Duration::from_secs(2);
    let streams = [0, 1].map(|index: u16| {
        let mut navigation = NavigationData::default();
        let log = folder.path().join(format!("A{index}.ubx"));
        let mut epochs = epochs_of(&log, &mut navigation);
        let mut state = u64::from(index);
        for epoch in epochs.iter_mut().skip(EVERY).step_by(EVERY) {
            for observation in &mut epoch.observations {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let cycles = (state >> 40) as f64 / (1 << 24) as f64;
                observation.phase_cycles = observation.phase_cycles.map(|phase| phase + cycles);
            }
        }
        let mut writer = UbxWriter::new(Vec::new(), &navigation);
        epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
        let pieces = pieces(&writer.finish());
        assert_eq!(pieces.len(), EPOCHS);
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            for (piece, number) in pieces.iter().zip(0..) {
                let due = start + Duration::from_millis(100) * number;
                thread::sleep(due.saturating_duration_since(Instant::now()));
                stream.write_all(piece).unwrap();
            }
        });
        format!("stream = \"tcp://127.0.0.1:{port}\"")
    });
    let output = free_port();
    let more = format!("[[output]]\nto = \"tcp-listen://:{output}\"\nprofile = \"jsonl\"\n");
    let text = configuration([&streams[0], &streams[1]], &more);
    let service = Service::start(folder.path(), &text, &["--once", "--quiet"]);
    let messages = Messages::of_port(output);
    service.end(Duration::from_secs(60));

    let seconds = |value: &serde_json::Value| {
        let clock = value.as_str().unwrap().trim_end_matches('Z').split_once('T').unwrap().1;
        clock.split(':').fold(0.0, |sum, part| 60.0 * sum + part.parse::<f64>().unwrap())
    };
    let mut latencies_ms = [Vec::new(), Vec::new()];
    let mut is_behind = false;
    for row in messages.0.lock().unwrap().iter() {
        let latency_ms = 1e3 * (seconds(&row["row_out_utc"]) - seconds(&row["last_byte_in_utc"]));
        let is_hard = row["reason"] == "ratio" || row["reason"] == "budget";
        if row["status"] == "fixed" {
            latencies_ms[usize::from(is_behind)].push(latency_ms);
        }
        is_behind = is_hard;
    }
    let [usual_ms, behind_ms] = latencies_ms.map(|mut of| {
        of.sort_by(f64::total_cmp);
        assert!(of.len() >= EPOCHS / EVERY - 1, "{of:?}");
        of[of.len() / 2]
    });
    println!("median latency: {usual_ms:.2} ms, behind hard epochs {behind_ms:.2} ms");
    assert!(behind_ms < usual_ms + 5.0, "{behind_ms} ms, {usual_ms} ms");
    let is_at_its_end = |value: &serde_json::Value| value["reason"] == "budget";
    assert!(messages.like(0, is_at_its_end) > 0, "no search took the whole budget");
}

/// Datagrams to one antenna; the receiver of the other one connects by itself.
#[test]
fn datagrams_and_connections_of_receivers_give_the_rows_of_solve() {
    let folder = tempfile::tempdir().unwrap();
    let ports = [free_port(), free_port()];
    let streams = [
        format!("stream = \"udp://:{}\"", ports[0]),
        format!("stream = \"tcp-listen://:{}\"", ports[1]),
    ];
    let live = "[live]\ndeadline_ms = 20000\n";
    let text = configuration([&streams[0], &streams[1]], live);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let mut receiver = wait_for("the port", || TcpStream::connect(("127.0.0.1", ports[1])).ok());
    let sending = thread::spawn(move || receiver.write_all(&log(1, "ubx")).map(|()| receiver));
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for datagram in log(0, "ubx").chunks(1400) {
        socket.send_to(datagram, ("127.0.0.1", ports[0])).unwrap();
        // An empty one is no end.
        socket.send_to(&[], ("127.0.0.1", ports[0])).unwrap();
        thread::sleep(Duration::from_millis(2));
    }
    let out = service.out.clone();
    wait_for("the rows", || (statuses(&out).len() == EPOCHS).then_some(()));
    service.signal("-TERM");
    let (status, out) = service.end(Duration::from_secs(10));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &solved(folder.path(), "ubx", "instantaneous"), "udp");
    drop(sending.join().unwrap().unwrap());
}

/// An SBF receiver with two antennas, of which each table of the configuration names one.
#[test]
fn one_stream_may_carry_several_antennas() {
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), &(SCENARIO.to_owned() + "[clock]\ncommon = true\n"));
    let mut navigation = NavigationData::default();
    let epochs =
        ["A0.sbf", "A1.sbf"].map(|name| epochs_of(&folder.path().join(name), &mut navigation));
    let mut writer = SbfWriter::new(Vec::new(), &navigation);
    for (first, second) in epochs[0].iter().zip(&epochs[1]) {
        writer.write(&[first, second]).unwrap();
    }
    let log = writer.finish();
    let file = folder.path().join("both.sbf");
    fs::write(&file, &log).unwrap();

    let chosen = ["main", "aux1"];
    let obs = chosen.map(|id| format!("obs = [\"{}\"]\nantenna_id = \"{id}\"", file.display()));
    let wanted = solve(folder.path(), &configuration([&obs[0], &obs[1]], ""));

    let port = serve(log, 2);
    let streams =
        chosen.map(|id| format!("stream = \"tcp://127.0.0.1:{port}\"\nantenna_id = \"{id}\""));
    let more = "[live]\ndeadline_ms = 20000\ncommon_clock = true\n";
    let text = configuration([&streams[0], &streams[1]], more);
    let service = Service::start(folder.path(), &text, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &wanted, "two antennas of one stream");
}

/// The logs at the pace at which they were recorded, four times faster, with JSON lines and sentences
/// to clients, metrics and health, and a clean stop.
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

/// Status and body of a page.
fn get(port: u16, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let status = text.split(' ').nth(1).unwrap().parse().unwrap();
    (status, text.split_once("\r\n\r\n").unwrap().1.to_owned())
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

/// Numbers are those of the array in the axes of the reader; an array that does not suit is refused, by the service too.
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

/// A caster that answers like this and then sends these bytes; it gives back what it was asked.
fn caster(answer: &'static str, body: Vec<u8>) -> (u16, thread::JoinHandle<String>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let serving = thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut request = String::new();
        let mut reader = BufReader::new(stream.try_clone().unwrap());
        while !request.ends_with("\r\n\r\n") {
            assert!(reader.read_line(&mut request).unwrap() > 0, "{request}");
        }
        stream.write_all(answer.as_bytes()).unwrap();
        let _ = stream.write_all(&body);
        request
    });
    (port, serving)
}

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
    assert!(said.contains("the caster refuses the password of me"), "{said}");
    assert!(!said.contains("secret"), "{said}");
    assert_eq!(rows(&folder.path().join("live"))[0].lines().count(), EPOCHS + 1);
}

/// Simulated receivers on ports of their own.
struct Receivers {
    child: Child,
    port: u16,
}

impl Receivers {
    fn start(folder: &Path, format: &str, interval_s: f64, speed: &str) -> Self {
        let text = SCENARIO.replace("interval_s = 0.2", &format!("interval_s = {interval_s}"));
        Self::of_scenario(folder, &text, format, speed)
    }

    fn of_scenario(folder: &Path, text: &str, format: &str, speed: &str) -> Self {
        let scenario = folder.join("scenario.toml");
        fs::write(&scenario, text.replace("duration_s = 20.0", "duration_s = 600.0")).unwrap();
        // Six in a row are needed.
        let is_free = |port: u16| TcpListener::bind(("127.0.0.1", port)).is_ok();
        let port = (0..)
            .map(|_| free_port())
            .find(|port| *port < u16::MAX - 5 && (1..6).all(|more| is_free(port + more)));
        let port = port.unwrap();
        let mut command = kurs();
        command.arg("simulate").arg(&scenario).args(["--quiet", "--stream", &port.to_string()]);
        command.args(["--stream-format", format, "--speed", speed]);
        Self { child: command.spawn().unwrap(), port }
    }

    fn streams(&self) -> [String; 2] {
        [0, 1].map(|index| format!("stream = \"tcp://127.0.0.1:{}\"", self.port + index))
    }
}

impl Drop for Receivers {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Time and status of every row in a file that is being written.
fn statuses(out: &Path) -> Vec<(String, String)> {
    rows_so_far(out).into_iter().map(|row| (row.time, row.status)).collect()
}

/// What tests look at in a row.
#[derive(Debug)]
struct Row {
    time: String,
    status: String,
    antennas: String,
}

/// Every row in a file that is being written.
fn rows_so_far(out: &Path) -> Vec<Row> {
    let Ok(days) = fs::read_dir(out) else { return Vec::new() };
    let mut days: Vec<PathBuf> = days.map(|e| e.unwrap().path().join("attitude.csv")).collect();
    days.sort();
    let text: String = days.iter().filter_map(|day| fs::read_to_string(day).ok()).collect();
    let rows = text.lines().filter(|line| !line.starts_with("time_gpst"));
    let fields = rows.map(|row| row.split(',').map(str::to_owned).collect::<Vec<_>>());
    // The last one may be half written.
    let whole = fields.filter(|fields| fields.len() > 6);
    let row =
        |f: Vec<String>| Row { time: f[0].clone(), status: f[3].clone(), antennas: f[5].clone() };
    whole.map(row).collect()
}

/// Killed with the first rows, and again in the midst of a row, and started again: fixed again with the first
/// epoch, though the receivers say their ephemerides but once; in the same file, whose half row is gone.
#[test]
fn a_killed_service_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "4");
    let state = folder.path().join("state");
    let live = format!("[live]\nstate_dir = \"{}\"\n", state.display());
    let streams = receivers.streams();
    let configuration = configuration([&streams[0], &streams[1]], &live);
    let service = Service::start(folder.path(), &configuration, &["--quiet"]);
    let out = service.out.clone();
    wait_for("the first rows", || (statuses(&out).len() > 20).then_some(()));
    let kept = || state.join("last.txt").exists() && state.join("ephemerides.rnx").exists();
    wait_for("the state", || kept().then_some(()));
    service.signal("-KILL");
    service.end(Duration::from_secs(10));
    let service = Service::start(folder.path(), &configuration, &["--quiet"]);
    let killed = statuses(&out).len();
    wait_for("rows after the restart", || (statuses(&out).len() > killed + 5).then_some(()));
    assert_goes_on(&rows_so_far(&out), killed);
    service.signal("-KILL");
    service.end(Duration::from_secs(10));

    let day = fs::read_dir(&out).unwrap().map(|e| e.unwrap().path()).max().unwrap();
    let file = day.join("attitude.csv");
    let text = fs::read_to_string(&file).unwrap() + "2024-03-10T00:00:0";
    fs::write(&file, text).unwrap();
    let killed = statuses(&out).len();
    let service = Service::start(folder.path(), &configuration, &["--quiet"]);
    wait_for("rows after the restart", || (statuses(&out).len() > killed + 10).then_some(()));
    drop(service);
    assert_goes_on(&rows_so_far(&out), killed);
}

/// Rows in order, of which those from number `killed` on are fixed as soon as both antennas have an epoch.
fn assert_goes_on(all: &[Row], killed: usize) {
    assert!(all.windows(2).all(|pair| pair[0].time < pair[1].time), "{all:?}");
    let (whole, of_one): (Vec<_>, Vec<_>) =
        all[killed..].iter().partition(|row| row.antennas == "2");
    assert!(whole.len() > 3 && whole.iter().all(|row| row.status == "fixed"), "{whole:?}");
    // The first epoch may have come to one antenna only, before the other was connected.
    assert!(of_one.len() <= 1, "{of_one:?}");
}

/// The cable of one antenna is cut in mid-message and put back: rows go on without it, then with it,
/// and nothing is wrong. Two hundred clients that never read disturb nobody.
#[test]
fn a_cut_cable_and_clients_that_do_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "sbf", 0.1, "1");
    let cable = free_port();
    let (cut, is_cut) = std::sync::mpsc::channel::<()>();
    let to = receivers.port + 1;
    let joint = thread::spawn(move || {
        let listener = TcpListener::bind(("127.0.0.1", cable)).unwrap();
        let receiver = || TcpStream::connect(("127.0.0.1", to)).ok();
        let mut from = wait_for("the receiver", receiver);
        let mut buffer = [0; 100];
        loop {
            let (mut client, _) = listener.accept().unwrap();
            // Noise on the line, then pieces of a hundred bytes.
            let mut alive = client.write_all(&[0xb5, 0x62, 0xd3, 0x00, 0x24, 0x40, 0xff]).is_ok();
            while alive && is_cut.try_recv().is_err() {
                let Ok(count @ 1..) = from.read(&mut buffer) else { return };
                alive = client.write_all(&buffer[..count]).is_ok();
            }
        }
    });
    let port = free_port();
    let output = format!("[[output]]\nto = \"tcp-listen://:{port}\"\nprofile = \"jsonl\"\n");
    let streams = [receivers.streams()[0].clone(), format!("stream = \"tcp://127.0.0.1:{cable}\"")];
    let configuration = configuration([&streams[0], &streams[1]], &output);
    let service = Service::start(folder.path(), &configuration, &["--quiet"]);
    let out = service.out.clone();
    let connect = || TcpStream::connect(("127.0.0.1", port));
    let reader = wait_for("the output", || connect().ok());
    let clients: Vec<TcpStream> = (0..200).map(|_| connect().unwrap()).collect();
    let fixed = |from: usize| {
        let all = statuses(&out);
        all.iter().skip(from).filter(|(_, status)| status == "fixed").count()
    };
    wait_for("fixed rows", || (fixed(0) > 10).then_some(()));
    cut.send(()).unwrap();
    let before = statuses(&out).len();
    wait_for("fixed rows after the cut", || (fixed(before) > 10).then_some(()));
    let all = statuses(&out);
    assert!(all.iter().any(|(_, status)| status == "lost"), "nothing was cut: {all:?}");
    assert!(all.windows(2).all(|pair| pair[0].0 < pair[1].0), "{all:?}");

    // What a client that reads got in the meantime.
    let mut count = 0;
    for line in BufReader::new(reader).lines().take(20) {
        let value: serde_json::Value = serde_json::from_str(&line.unwrap()).unwrap();
        if let Some(heading_deg) = value["heading_deg"].as_f64() {
            assert_eq!(value["status"], "fixed");
            assert!((heading_deg - 40.0).abs() < 2.0, "{value}");
        }
        count += 1;
    }
    assert_eq!(count, 20);
    drop((clients, service, receivers));
    drop(joint);
}

/// What happens on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// The receiver says nothing, the connection stays.
    Silent,
    /// Random bytes in place of what was sent.
    Noise,
    /// Every byte comes as another one.
    WrongBaud,
    /// Every epoch comes twice.
    Twice,
    /// Connections are closed as soon as they are made.
    Storm,
    /// One epoch of five gets through.
    Sparse,
}

/// Lines between receivers and service, on which things happen.
#[derive(Clone)]
struct Lines {
    ports: Vec<u16>,
    state: Arc<Mutex<Vec<Line>>>,
    attempts: Arc<AtomicUsize>,
}

struct Line {
    fault: Fault,
    /// To which client the bytes go.
    to: usize,
    delay: Duration,
    client: Option<TcpStream>,
}

impl Lines {
    fn new(receivers: &Receivers, count: u16) -> Self {
        let line = |to| Line { fault: Fault::None, to, delay: Duration::ZERO, client: None };
        let state = Arc::new(Mutex::new((0..usize::from(count)).map(line).collect::<Vec<_>>()));
        let attempts = Arc::new(AtomicUsize::new(0));
        let start = |index: u16| {
            let listener = TcpListener::bind("127.0.0.1:0").unwrap();
            let port = listener.local_addr().unwrap().port();
            let (number, from) = (usize::from(index), receivers.port + index);
            let (of_clients, of_receiver, of_bytes) = (state.clone(), state.clone(), state.clone());
            let attempts = attempts.clone();
            let (has_client, client_there) = mpsc::channel();
            thread::spawn(move || {
                for client in listener.incoming().map_while(Result::ok) {
                    attempts.fetch_add(1, Relaxed);
                    let line = &mut of_clients.lock().unwrap()[number];
                    line.client = (line.fault != Fault::Storm).then_some(client);
                    let _ = has_client.send(());
                }
            });
            let (bytes, queued) = mpsc::channel::<(Instant, Vec<u8>)>();
            thread::spawn(move || {
                // The receiver begins with the service.
                client_there.recv().unwrap();
                let connect = || TcpStream::connect(("127.0.0.1", from)).ok();
                let mut receiver = wait_for("the receiver", connect);
                let mut buffer = vec![0; 65_536];
                while let Ok(count @ 1..) = receiver.read(&mut buffer) {
                    let due = Instant::now() + of_receiver.lock().unwrap()[number].delay;
                    if bytes.send((due, buffer[..count].to_vec())).is_err() {
                        return;
                    }
                }
            });
            thread::spawn(move || {
                for (piece, (due, bytes)) in queued.iter().enumerate() {
                    thread::sleep(due.saturating_duration_since(Instant::now()));
                    let mut lines = of_bytes.lock().unwrap();
                    let Line { fault, to, .. } = lines[number];
                    let Some(client) = &mut lines[to].client else { continue };
                    let sent = altered(fault, bytes, piece);
                    if fault == Fault::Storm || client.write_all(&sent).is_err() {
                        lines[to].client = None;
                    }
                }
            });
            port
        };
        let ports = (0..count).map(start).collect();
        Self { ports, state, attempts }
    }

    fn stream(&self, index: usize) -> String {
        format!("stream = \"tcp://127.0.0.1:{}\"", self.ports[index])
    }

    fn set(&self, faults: &[(usize, Fault)]) {
        for (index, fault) in faults {
            self.state.lock().unwrap()[*index].fault = *fault;
        }
    }
}

/// What leaves the line in place of these bytes.
fn altered(fault: Fault, mut bytes: Vec<u8>, piece: usize) -> Vec<u8> {
    match fault {
        Fault::None => bytes,
        Fault::Silent | Fault::Storm => Vec::new(),
        Fault::Sparse if piece.is_multiple_of(5) => bytes,
        Fault::Sparse => Vec::new(),
        Fault::Twice => bytes.repeat(2),
        Fault::WrongBaud => bytes.iter().map(|byte| byte.rotate_left(3) ^ 0x55).collect(),
        Fault::Noise => {
            let mut state = piece as u64 + 1;
            for byte in &mut bytes {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                *byte = (state >> 56) as u8;
            }
            bytes
        }
    }
}

/// Messages of an output, as they come.
#[derive(Clone, Default)]
struct Messages(Arc<Mutex<Vec<serde_json::Value>>>);

impl Messages {
    fn of_port(port: u16) -> Self {
        let messages = Self::default();
        let list = messages.0.clone();
        let stream = wait_for("the output", || TcpStream::connect(("127.0.0.1", port)).ok());
        thread::spawn(move || {
            for line in BufReader::new(stream).lines().map_while(Result::ok) {
                list.lock().unwrap().push(serde_json::from_str(&line).unwrap());
            }
        });
        messages
    }

    fn count(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    /// How many from this number on are like that.
    fn like(&self, from: usize, is_like: impl Fn(&serde_json::Value) -> bool) -> usize {
        self.0.lock().unwrap()[from..].iter().filter(|value| is_like(value)).count()
    }

    /// Every heading that left was right, and no time came twice.
    fn check(&self, heading_deg: f64) {
        let list = self.0.lock().unwrap();
        for value in list.iter() {
            if let Some(found_deg) = value["heading_deg"].as_f64() {
                assert_eq!(value["status"], "fixed");
                assert!((found_deg - heading_deg).abs() < 3.0, "{value}");
            }
        }
        let time = |value: &serde_json::Value| value["measured_gpst"].as_str().unwrap().to_owned();
        assert!(list.windows(2).all(|pair| time(&pair[0]) < time(&pair[1])));
    }
}

/// Three antennas whose clocks step by milliseconds, and one thing after the other on their lines: in the
/// meantime nothing wrong leaves, afterwards all three are in fixed rows again, and nothing needs a hand.
#[test]
fn nothing_wrong_leaves_whatever_the_streams_do() {
    let folder = tempfile::tempdir().unwrap();
    let text = SCENARIO.to_owned()
        + "[[body.antenna]]\nname = \"A2\"\nposition_m = [0.0, 0.9, 0.0]\n\
           [clock]\nbias_sd_s = 4e-4\ndrift_sd = 2e-5\n";
    let receivers = Receivers::of_scenario(folder.path(), &text, "ubx", "5");
    let lines = Lines::new(&receivers, 3);
    let (page, output) = (free_port(), free_port());
    let more = format!(
        "[[antenna]]\nname = \"A2\"\n{}\nposition_m = [0.0, 0.9, 0.0]\n[live]\ndeadline_ms = 100\n\
         page = \"127.0.0.1:{page}\"\n[[output]]\nto = \"tcp-listen://:{output}\"\nprofile = \"jsonl\"\n",
        lines.stream(2)
    );
    let text = configuration([&lines.stream(0), &lines.stream(1)], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let messages = Messages::of_port(output);
    let whole = |value: &serde_json::Value| value["status"] == "fixed" && value["antennas"] == 3;
    let all_is_well = |after: &str| {
        let from = messages.count();
        wait_for(after, || (messages.like(from, whole) > 10).then_some(()));
    };
    all_is_well("the start");
    let connected = lines.attempts.load(Relaxed);
    for (faults, told) in [
        (&[(1, Fault::Silent)][..], Some("A1 is connected, but no epoch came")),
        (&[(1, Fault::Noise)], Some("A1 is connected, but no epoch came")),
        (&[(2, Fault::WrongBaud)], Some("A2 is connected, but no epoch came")),
        (&[(0, Fault::Twice)], None),
        (&[(0, Fault::Storm), (1, Fault::Storm), (2, Fault::Storm)], Some("no row for")),
    ] {
        let from = messages.count();
        lines.set(faults);
        match told {
            Some(told) => wait_for(told, || {
                let (status, body) = get(page, "/healthz");
                (status == 503 && body.contains(told)).then_some(())
            }),
            None => thread::sleep(Duration::from_secs(1)),
        }
        if told.is_some_and(|told| told.starts_with('A')) {
            let two = |value: &serde_json::Value| value["antennas"] == 2;
            assert!(messages.like(from, two) > 0, "{faults:?}: rows without the silent one");
        }
        thread::sleep(Duration::from_millis(500));
        lines.set(&faults.iter().map(|(index, _)| (*index, Fault::None)).collect::<Vec<_>>());
        all_is_well(&format!("the end of {faults:?}"));
        wait_for("good health", || (get(page, "/healthz").0 == 200).then_some(()));
    }
    // Everyone waits longer and longer: in the second or two of the storm there were few attempts.
    let attempts = lines.attempts.load(Relaxed) - connected;
    assert!((3..30).contains(&attempts), "{attempts}");

    // The plugs of two antennas are swapped: that is another array, of which nothing is believed.
    let swap = |to: [usize; 2]| {
        let mut state = lines.state.lock().unwrap();
        (state[1].to, state[2].to) = (to[0], to[1]);
    };
    swap([2, 1]);
    thread::sleep(Duration::from_secs(3));
    swap([1, 2]);
    all_is_well("the swap");
    messages.check(40.0);
    drop(service);
}

/// One antenna comes half a second after the other: its rows are in the file and go to nobody.
#[test]
fn what_is_older_than_300_ms_does_not_leave() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "1");
    let lines = Lines::new(&receivers, 2);
    let (page, output) = (free_port(), free_port());
    let more = format!(
        "[live]\ndeadline_ms = 2000\npage = \"127.0.0.1:{page}\"\n\
         [[output]]\nto = \"tcp-listen://:{output}\"\nprofile = \"jsonl\"\n"
    );
    let text = configuration([&lines.stream(0), &lines.stream(1)], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let messages = Messages::of_port(output);
    wait_for("messages", || (messages.count() > 5).then_some(()));
    lines.state.lock().unwrap()[1].delay = Duration::from_millis(500);
    let expired = || {
        let metrics = get(page, "/metrics").1;
        let line = metrics.lines().find(|line| line.starts_with("kurs_messages_expired_total "));
        line.unwrap().split_once(' ').unwrap().1.parse::<u32>().unwrap()
    };
    wait_for("old messages", || (expired() > 2).then_some(()));
    let (before, rows) = (messages.count(), statuses(&service.out).len());
    wait_for("rows in the file", || (statuses(&service.out).len() > rows + 10).then_some(()));
    assert_eq!(messages.count(), before, "nothing left");
    assert!(statuses(&service.out)[rows..].iter().all(|(_, status)| status == "fixed"));
    lines.state.lock().unwrap()[1].delay = Duration::ZERO;
    wait_for("messages again", || (messages.count() > before + 5).then_some(()));
    messages.check(40.0);
}

/// A station once a second, a second and a half late, beside antennas five times a second: the coordinates are
/// relative to it all the same, and without it the attitude is what it was.
#[test]
fn a_late_station_serves_every_row() {
    let folder = tempfile::tempdir().unwrap();
    let receivers =
        Receivers::of_scenario(folder.path(), &(SCENARIO.to_owned() + STATION), "rtcm3", "1");
    let lines = Lines::new(&receivers, 3);
    lines.set(&[(2, Fault::Sparse)]);
    lines.state.lock().unwrap()[2].delay = Duration::from_millis(1500);
    let (page, output) = (free_port(), free_port());
    let more = format!(
        "[live]\npage = \"127.0.0.1:{page}\"\n[station]\n{}\nmax_age_s = 4\n{}\
         [[output]]\nto = \"tcp-listen://:{output}\"\nprofile = \"jsonl\"\n",
        lines.stream(2),
        station_position(),
    );
    let text = configuration([&lines.stream(0), &lines.stream(1)], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let messages = Messages::of_port(output);
    let is_aged = |value: &serde_json::Value| {
        value["station_age_s"].as_f64().is_some_and(|age_s| (1.3..3.0).contains(&age_s))
    };
    wait_for("rows with a late station", || (messages.like(0, is_aged) > 20).then_some(()));
    assert!(get(page, "/metrics").1.contains("\nkurs_station_age_seconds "));
    let (mut by_phase, mut count) = (0, 0);
    for value in messages.0.lock().unwrap().iter().filter(|value| is_aged(value)) {
        let number = |name: &str| value[name].as_f64().unwrap();
        count += 1;
        if number("sd_north_m") < 0.05 {
            by_phase += 1;
            // 1e-6 degrees are a decimetre.
            assert!((number("latitude_deg") - 52.0).abs() < 1e-6, "{value}");
            assert!((number("longitude_deg") - 13.0).abs() < 1e-6, "{value}");
            assert!((number("height_m") - 100.0).abs() < 0.1, "{value}");
        }
    }
    assert!(2 * by_phase > count, "{by_phase} of {count}");

    lines.set(&[(2, Fault::Silent)]);
    let alone = |value: &serde_json::Value| {
        value["status"] == "fixed" && value.get("station_age_s").is_none()
    };
    let from = messages.count();
    wait_for("rows without station", || (messages.like(from, alone) > 10).then_some(()));
    assert!(!get(page, "/metrics").1.contains("\nkurs_station_age_seconds "));
    assert!(get(page, "/healthz").1.contains("station is connected, but no epoch came"));
    messages.check(40.0);
    drop(service);
}

/// The disk takes no more than forty kilobytes of any file for a while: messages leave all the same, and
/// when there is room again the files go on with whole rows.
#[test]
fn a_full_disk_costs_rows_of_the_files_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "5");
    let [first, second] = receivers.streams();
    let output = free_port();
    let more = format!(
        "[log]\ndir = \"raw\"\n[[output]]\nto = \"tcp-listen://:{output}\"\nprofile = \"jsonl\"\n"
    );
    let file = folder.path().join("live.toml");
    fs::write(&file, configuration([&first, &second], &more)).unwrap();
    let out = folder.path().join("live");
    // A limit of 80 blocks of 512 bytes, of which no signal is made.
    let limited = "trap '' XFSZ; ulimit -S -f 80; exec \"$0\" live \"$1\" --quiet --out \"$2\"";
    let mut command = Command::new("sh");
    command.args(["-c", limited, env!("CARGO_BIN_EXE_kurs")]).arg(&file).arg(&out);
    let said = fs::File::create(folder.path().join("said.txt")).unwrap();
    let service = Service { child: command.stderr(said).spawn().unwrap(), out };
    let messages = Messages::of_port(output);
    wait_for("a full disk", || {
        let said = fs::read_to_string(folder.path().join("said.txt")).unwrap();
        (said.contains("a row cannot be written") && said.contains("the raw log pauses"))
            .then_some(())
    });
    let from = messages.count();
    wait_for("messages", || (messages.count() > from + 25).then_some(()));
    let id = service.child.id().to_string();
    let rows = statuses(&service.out).len();
    match Command::new("prlimit").args(["--pid", &id, "--fsize=unlimited"]).status() {
        Ok(status) => assert!(status.success()),
        Err(error) => return outside::lacking(&format!("prlimit: {error}")),
    }
    wait_for("rows in the file", || (statuses(&service.out).len() > rows + 10).then_some(()));
    messages.check(40.0);
    let all = statuses(&service.out);
    assert!(all.windows(2).all(|pair| pair[0].0 < pair[1].0), "whole rows in their order");
    drop(service);
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

/// Two hundred pages, and clients that never read, beside one output: what the pages show is what leaves there, row by row.
/// Only the token changes anything.
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
    // A configuration that is wrong changes nothing.
    fs::write(folder.path().join("live.toml"), "nonsense = 1").unwrap();
    service.signal("-HUP");
    let before = statuses(&out).len();
    wait_for("fixed rows after a wrong reload", || {
        statuses(&out)[before..].iter().any(|(_, s)| s == "fixed").then_some(())
    });
}

/// Raw logs have every byte, and give the same rows again.
#[test]
fn a_raw_log_plays_again_what_came() {
    let folder = tempfile::tempdir().unwrap();
    let ports = [serve(log(0, "ubx"), 3), serve(log(1, "ubx"), 3)];
    let stream = |index: usize| format!("stream = \"tcp://127.0.0.1:{}\"", ports[index]);
    let more = "[live]\ndeadline_ms = 20000\n[log]\ndir = \"raw\"\n";
    let text = configuration([&stream(0), &stream(1)], more);
    let service = Service::start(folder.path(), &text, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    let wanted = rows(&out);
    let raw = |index: usize| -> PathBuf {
        let files = fs::read_dir(folder.path().join("raw")).unwrap().map(|e| e.unwrap().path());
        let name = |file: &PathBuf| file.file_name().unwrap().to_string_lossy().into_owned();
        let mut files = files.filter(|f| name(f).starts_with(&format!("A{index}-")));
        files.find(|f| name(f).ends_with(".raw")).unwrap()
    };
    for index in [0, 1] {
        assert_eq!(fs::read(raw(index)).unwrap(), log(index, "ubx"));
    }
    let again = |index: usize| format!("stream = \"file://{}?speed=1\"", raw(index).display());
    let more = "[live]\ndeadline_ms = 20000\n";
    let text = configuration([&again(0), &again(1)], more);
    let second = folder.path().join("second");
    fs::create_dir(&second).unwrap();
    let service = Service::start(&second, &text, &["--once", "--quiet"]);
    let (status, out) = service.end(Duration::from_secs(60));
    assert_eq!(status, Some(0));
    assert_same(&rows(&out), &wanted, "played again");
}

/// A car with a gyro, and three seconds without satellites.
const CAR: &str = r#"
seed = 6
start = "2024-03-09T23:59:50"
duration_s = 24.0
interval_s = 0.2
signals = ["G1C", "G2L", "E1C", "E5Q"]

[output]
formats = ["ubx"]

[sky]
systems = ["G", "E"]

[[body]]
name = "car"
[body.motion]
kind = "car"
place = { latitude_deg = 55.75, longitude_deg = 37.62, height_m = 200.0 }
waypoints_m = [[0, 0], [0, 60], [60, 60], [60, -40]]
speed_mps = 8.0
wait_s = 4.0
turn_radius_m = 12.0
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, -0.03]
[[body.antenna]]
name = "A2"
position_m = [0.1, 0.8, 0.0]
[body.imu]
position_m = [-0.5, 0.1, 0.4]
mounting_deg = [2.0, -1.0, 180.0]
gyro_bias_degph = [10.0, -8.0, 6.0]

[[outage]]
from_s = 12.1
to_s = 15.1
"#;

/// The car's logs, `imu.csv`, `fuse.toml`, `truth.csv`, made once.
fn car() -> &'static Path {
    static LOGS: OnceLock<tempfile::TempDir> = OnceLock::new();
    LOGS.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let scenario = folder.path().join("scenario.toml");
        fs::write(&scenario, CAR).unwrap();
        let mut run = kurs();
        run.arg("simulate").arg(&scenario).args(["--quiet", "--out"]).arg(folder.path());
        assert!(run.status().unwrap().success());
        folder
    })
    .path()
}

/// Antennas with a line each.
fn car_antennas(line: impl Fn(usize) -> String) -> String {
    let places = ["[0.0, 0.0, 0.0]", "[1.2, 0.0, -0.03]", "[0.1, 0.8, 0.0]"];
    let antennas = places.iter().enumerate().map(|(index, place)| {
        let line = line(index);
        format!("[[antenna]]\nname = \"A{index}\"\n{line}\nposition_m = {place}\n")
    });
    antennas.collect::<String>() + "[nav]\nas_received = true\n"
}

/// The tables of `fuse.toml` from [imu] on, with this line for where the samples are.
fn car_sensor(line: &str) -> String {
    let written = fs::read_to_string(car().join("fuse.toml")).unwrap();
    let imu = &written[written.find("[imu]").unwrap()..];
    imu.replace("file = \"imu.csv\"", line)
}

/// The rows of `kurs fuse` on the car's logs, whose prediction helps the integers.
fn fused(folder: &Path, interval: &str) -> String {
    let obs =
        |index: usize| format!("obs = [\"{}\"]", car().join(format!("A{index}.ubx")).display());
    fs::write(folder.join("kurs.toml"), car_antennas(obs)).unwrap();
    let file = format!("file = \"{}\"", car().join("imu.csv").display());
    let text = format!(
        "[antennas]\nsolve = \"kurs.toml\"\n[filter]\norder_window_s = 0.01\n{interval}{}",
        car_sensor(&file)
    );
    fs::write(folder.join("fuse.toml"), text).unwrap();
    let out = folder.join("fused");
    let mut run = kurs();
    run.arg("fuse").arg(folder.join("fuse.toml")).arg("--quiet").arg("--out").arg(&out);
    assert!(run.status().unwrap().success());
    fs::read_to_string(out.join("attitude.csv")).unwrap()
}

fn assert_carried(live: &str, fused: &str, what: &str) {
    for (number, (live, fused)) in live.lines().zip(fused.lines()).enumerate() {
        assert_eq!(live, fused, "{what}, line {number}");
    }
    assert_eq!(live.lines().count(), fused.lines().count(), "{what}");
    assert!(fused.contains(",float,predicted,") && fused.contains(",fixed,"), "{what}");
}

/// Antennas and sensor through TCP in pieces of any size, none of them at the pace of the others; the sensor
/// from a log; and rows between the epochs.
#[test]
fn a_gyro_beside_the_antennas_gives_the_rows_of_fuse() {
    for (is_log, interval_s) in [(false, None), (false, Some(0.1)), (true, None)] {
        let folder = tempfile::tempdir().unwrap();
        let log = |index: usize| fs::read(car().join(format!("A{index}.ubx"))).unwrap();
        let ports = [0, 1, 2].map(|index| serve(log(index), 4));
        let antennas =
            car_antennas(|index| format!("stream = \"tcp://127.0.0.1:{}\"", ports[index]));
        let samples = car().join("imu.csv");
        let line = match is_log {
            true => format!("log = \"{}\"", samples.display()),
            false => {
                let port = serve(fs::read(&samples).unwrap(), 2);
                format!("stream = \"tcp://127.0.0.1:{port}\"")
            }
        };
        let interval = interval_s.map_or(String::new(), |s| format!("interval_s = {s}\n"));
        let more =
            format!("{}\n{interval}[live]\ndeadline_ms = 20000\n", car_sensor(&line).trim_end());
        let service = Service::start(folder.path(), &(antennas + &more), &["--once", "--quiet"]);
        let (status, out) = service.end(Duration::from_secs(120));
        assert_eq!(status, Some(0));
        let output = match interval_s {
            Some(s) => format!("[output]\ninterval_s = {s}\n"),
            None => String::new(),
        };
        let what = format!("log {is_log}, {interval_s:?}");
        assert_carried(&rows(&out)[0], &fused(folder.path(), &output), &what);
    }
}

/// Lines of a sensor at a port, as `time_s` of a body at rest on the roof: level but for its pitch of 3°.
struct Gyro {
    port: u16,
    /// Added to its times, in place of which nothing comes while it is no number.
    late_s: Arc<Mutex<f64>>,
}

impl Gyro {
    /// From this second of week on, `speed` times faster than time.
    fn start(tow_s: f64, speed: f64) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let late_s = Arc::new(Mutex::new(0.0_f64));
        let of_thread = late_s.clone();
        thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let began = Instant::now();
            let mut alive = stream.write_all(b"time_s,gx_degps,gy_degps,gz_degps\n").is_ok();
            while alive {
                thread::sleep(Duration::from_millis(5));
                let late_s = *of_thread.lock().unwrap();
                if late_s.is_finite() {
                    let at_s = tow_s + speed * began.elapsed().as_secs_f64() + late_s;
                    let line = format!("{:.4},0.0,0.0,0.0\n", at_s.rem_euclid(604_800.0));
                    alive = stream.write_all(line.as_bytes()).is_ok();
                }
            }
        });
        Self { port, late_s }
    }

    fn set(&self, late_s: f64) {
        *self.late_s.lock().unwrap() = late_s;
    }
}

/// A gyro that says nothing, whose time goes back, that is late, then there again: the antennas' rows go on, what
/// is wrong is named. Carried rows leave the output that asks for them alone.
#[test]
fn a_gyro_never_stops_the_rows_of_the_antennas() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "1");
    let lines = Lines::new(&receivers, 2);
    // The week begins anew after ten seconds.
    let gyro = Gyro::start(604_790.0, 1.0);
    let (page, with, without) = (free_port(), free_port(), free_port());
    let more = format!(
        "[live]\npage = \"127.0.0.1:{page}\"\n[imu]\nstream = \"tcp://127.0.0.1:{}\"\n\
         [[output]]\nto = \"tcp-listen://:{with}\"\nprofile = \"jsonl\"\npredicted = true\n\
         [[output]]\nto = \"tcp-listen://:{without}\"\nprofile = \"jsonl\"\n",
        gyro.port
    );
    let text = configuration([&lines.stream(0), &lines.stream(1)], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let [with, without] = [with, without].map(Messages::of_port);
    let fixed = |value: &serde_json::Value| value["status"] == "fixed";
    let rows_go_on = |what: &str| {
        let from = without.count();
        wait_for(what, || (without.like(from, fixed) > 8).then_some(()));
    };
    rows_go_on("fixed rows");
    for (late_s, told) in [
        (f64::NAN, Some("imu is connected, but no sample came")),
        (-5.0, None),
        (-3000.0, None),
        (0.0, None),
    ] {
        gyro.set(late_s);
        rows_go_on(&format!("rows with a gyro {late_s} s off"));
        if let Some(told) = told {
            wait_for(told, || get(page, "/healthz").1.contains(told).then_some(()));
        }
    }
    let metrics = get(page, "/metrics").1;
    let late =
        metrics.lines().find(|line| line.starts_with("kurs_stream_late_total{stream=\"imu\"}"));
    let late: u64 = late.unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(late > 0);

    // Nothing comes from the antennas: the gyro goes on for the one output.
    let carried = |value: &serde_json::Value| value["reason"] == "predicted";
    let (from, of_without) = (with.count(), without.count());
    lines.set(&[(0, Fault::Silent), (1, Fault::Silent)]);
    wait_for("carried rows", || (with.like(from, carried) > 8).then_some(()));
    lines.set(&[(0, Fault::None), (1, Fault::None)]);
    rows_go_on("the end of the silence");
    let has_heading = |value: &serde_json::Value| carried(value) && value["heading_deg"].is_f64();
    assert!(with.like(from, has_heading) > 8);
    assert_eq!(without.like(of_without, has_heading), 0);
    for value in with.0.lock().unwrap().iter().filter(|value| has_heading(value)) {
        let error_deg = (value["heading_deg"].as_f64().unwrap() - 40.0).abs();
        let sd_deg = value["heading_sd_deg"].as_f64().unwrap();
        assert!(error_deg < 5.0 * sd_deg, "{value}");
    }
    without.check(40.0);
    drop(service);
}

/// Two bodies under one sky, each with three antennas, on one band: of several the engine takes half of the noise to be common
/// to them, as under real skies, and the simulated one is not.
const TWO_BODIES: &str = r#"
seed = 9
start = "2024-03-10T12:00:00"
duration_s = 20.0
interval_s = 0.2
signals = ["G1C", "E1C"]

[sky]
systems = ["G", "E"]

[[body]]
name = "tractor"
motion = { kind = "static", place = { latitude_deg = 51.6, longitude_deg = 46.0, height_m = 60.0 }, heading_deg = 350.0, pitch_deg = 2.0, roll_deg = -1.0 }
[[body.antenna]]
name = "T0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "T1"
position_m = [1.2, 0.0, 0.0]
[[body.antenna]]
name = "T2"
position_m = [0.0, 1.0, 0.0]

[[body]]
name = "implement"
motion = { kind = "static", place = { latitude_deg = 51.60005, longitude_deg = 46.0, height_m = 60.0 }, heading_deg = 20.0, pitch_deg = -3.0, roll_deg = 4.0 }
[[body.antenna]]
name = "I0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "I1"
position_m = [1.2, 0.0, 0.0]
[[body.antenna]]
name = "I2"
position_m = [0.0, 1.0, 0.0]
"#;

/// Heading, pitch, roll of the second body in the axes of the first, degrees.
fn seen_from([first, second]: [[f64; 3]; 2]) -> [f64; 3] {
    let [first, second] = [first, second].map(|angles| {
        let [heading_rad, pitch_rad, roll_rad] = angles.map(f64::to_radians);
        kurs::frames::Attitude { heading_rad, pitch_rad, roll_rad }.ned_from_body().matrix()
    });
    let seen = kurs::frames::Rotation::from_matrix(first.transpose() * second);
    let seen = kurs::frames::Attitude::from_ned_from_body(&seen);
    [seen.heading_rad, seen.pitch_rad, seen.roll_rad].map(f64::to_degrees)
}

fn number(value: &serde_json::Value, name: &str) -> f64 {
    value[name].as_f64().unwrap_or_else(|| panic!("{name}: {value}"))
}

/// Of the errors of heading, pitch and roll, by their covariance.
fn normalised_square(value: &serde_json::Value, truth_deg: [f64; 3]) -> f64 {
    let names = ["heading", "pitch", "roll"];
    let error = nalgebra::Vector3::from_fn(|k, _| {
        let error = number(value, &format!("{}_deg", names[k])) - truth_deg[k];
        (error + 180.0).rem_euclid(360.0) - 180.0
    });
    let mut covariance = nalgebra::Matrix3::from_fn(|i, j| {
        if i == j { number(value, &format!("{}_sd_deg", names[i])).powi(2) } else { 0.0 }
    });
    for (i, j, name) in [(0, 1, "cov_hp_deg2"), (0, 2, "cov_hr_deg2"), (1, 2, "cov_pr_deg2")] {
        covariance[(i, j)] = number(value, name);
        covariance[(j, i)] = number(value, name);
    }
    (covariance.try_inverse().unwrap() * error).dot(&error)
}

/// Two services, each of which sees the other as it is; one is killed and comes back. In between the other says
/// that it is silent.
#[test]
fn two_bodies_see_each_other_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    // Receivers send ephemerides once, before the one that is killed comes back.
    simulate(folder.path(), TWO_BODIES);
    let receivers = Receivers::of_scenario(folder.path(), TWO_BODIES, "ubx", "2");
    let bodies = ["tractor", "implement"];
    let (rows, relative) = ([free_port(), free_port()], [free_port(), free_port()]);
    let places = ["[0.0, 0.0, 0.0]", "[1.2, 0.0, 0.0]", "[0.0, 1.0, 0.0]"];
    let configuration = |index: usize| {
        let antennas =
            places.iter().zip(receivers.port + 3 * u16::try_from(index).unwrap()..).enumerate();
        let antennas = antennas.map(|(number, (place, port))| {
            let stream = format!("stream = \"tcp://127.0.0.1:{port}\"");
            format!("[[antenna]]\nname = \"A{number}\"\n{stream}\nposition_m = {place}\n")
        });
        antennas.collect::<String>()
            + &format!(
                "[nav]\nfiles = [\"../nav.rnx\"]\n[solve]\narray_sd_m = 0.0\n[live]\nbody = \"{}\"\n[[peer]]\nname = \"{}\"\nfrom = \"tcp://127.0.0.1:{}\"\n\
                 [[output]]\nto = \"tcp-listen://:{}\"\nprofile = \"jsonl\"\n\
                 [[output]]\nto = \"tcp-listen://:{}\"\nprofile = \"relative\"\n",
                bodies[index],
                bodies[1 - index],
                rows[1 - index],
                rows[index],
                relative[index]
            )
    };
    let start = |index: usize| {
        let folder = folder.path().join(bodies[index]);
        fs::create_dir_all(&folder).unwrap();
        Service::start(&folder, &configuration(index), &["--quiet"])
    };
    let services = [start(0), start(1)];
    let seen = relative.map(Messages::of_port);
    let fixed = |value: &serde_json::Value| value["status"] == "fixed";
    for messages in &seen {
        wait_for("relative rows", || (messages.like(0, fixed) > 60).then_some(()));
    }

    let [first, second] = services;
    second.signal("-KILL");
    second.end(Duration::from_secs(10));
    let from = seen[0].count();
    let is_silent = |value: &serde_json::Value| {
        value["status"] == "lost"
            && value["reason"] == "peer_silent"
            && value["heading_deg"].is_null()
    };
    wait_for("a silent peer", || (seen[0].like(from, is_silent) > 3).then_some(()));
    let second = start(1);
    let from = seen[0].count();
    wait_for("the peer again", || (seen[0].like(from, fixed) > 10).then_some(()));

    let angles = [[350.0, 2.0, -1.0], [20.0, -3.0, 4.0]];
    for (index, messages) in seen.iter().enumerate() {
        let truth = seen_from([angles[index], angles[1 - index]]);
        let list = messages.0.lock().unwrap();
        // Of rows with both attitudes of one time, and of those that the rates brought to it.
        let mut squares = [Vec::new(), Vec::new()];
        for value in list.iter().filter(|value| fixed(value)) {
            assert_eq!(
                (&value["body"], &value["peer"]),
                (&bodies[index].into(), &bodies[1 - index].into())
            );
            let number = |name: &str| number(value, name);
            let is_aged = number("own_age_s").abs().max(number("peer_age_s").abs()) > 1e-3;
            squares[usize::from(is_aged)].push(normalised_square(value, truth));
            // Five and a half metres to the north or the south, by code.
            let north_m = number("north_m") - if index == 0 { 5.563 } else { -5.563 };
            assert!(north_m.abs() < 15.0 && number("east_m").abs() < 15.0, "{value}");
            assert!(number("peer_age_s").abs() < 1.0, "{value}");
        }
        for (squares, what) in squares.iter().zip(["of one time", "brought to one time"]) {
            let count = squares.len() as f64;
            let (nees, band) = (squares.iter().sum::<f64>() / count, 3.29 * (6.0 / count).sqrt());
            println!("{}, {what}: NEES {nees:.3}, 3 ± {band:.3}, {count} rows", bodies[index]);
            // What is allowed for a rate that changes does not happen at rest.
            let least = if what == "of one time" { 3.0 - band } else { 0.0 };
            assert!((least..3.0 + band).contains(&nees), "{what}: {nees}, {count}");
        }
    }
    let file =
        fs::read_dir(&first.out).unwrap().next().unwrap().unwrap().path().join("relative.csv");
    let text = fs::read_to_string(file).unwrap();
    assert!(text.starts_with("time_gpst,body,peer,heading_deg,"));
    let lost = format!(",tractor,implement{}0.0000,,lost,peer_silent\n", ",".repeat(13));
    assert!(text.contains(&lost), "{text}");
    drop((first, second));
}

/// A program that ends with the test; `None` if it is not installed.
struct Partner(Child);

impl Partner {
    fn start(program: &str, arguments: &[&str]) -> Option<Self> {
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        match command.spawn() {
            Ok(child) => Some(Self(child)),
            Err(error) => {
                outside::lacking(&format!("{program}: {error}"));
                None
            }
        }
    }
}

impl Drop for Partner {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A body that publishes its rows at a broker and is its own peer there, beside a foreign reader; the broker is killed and
/// comes back.
#[test]
#[cfg(feature = "mqtt")]
fn a_broker_passes_attitudes_on() {
    let folder = tempfile::tempdir().unwrap();
    let port = free_port();
    let settings = folder.path().join("mosquitto.conf");
    fs::write(&settings, format!("listener {port} 127.0.0.1\nallow_anonymous true\n")).unwrap();
    let settings = settings.display().to_string();
    let Some(broker) = Partner::start("mosquitto", &["-c", &settings]) else { return };
    wait_for("the broker", || TcpStream::connect(("127.0.0.1", port)).ok());
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "2");
    let relative = free_port();
    let topic = format!("mqtt://127.0.0.1:{port}/kurs/ferry");
    let more = format!(
        "[live]\nbody = \"ferry\"\n[[peer]]\nname = \"mirror\"\nfrom = \"{topic}\"\n\
         [[output]]\nto = \"{topic}\"\nprofile = \"jsonl\"\n\
         [[output]]\nto = \"tcp-listen://:{relative}\"\nprofile = \"relative\"\n"
    );
    let streams = receivers.streams();
    let text = configuration([&streams[0], &streams[1]], &more);
    let service = Service::start(folder.path(), &text, &["--quiet"]);
    let seen = Messages::of_port(relative);
    let is_fixed = |value: &serde_json::Value| value["status"] == "fixed";
    let sees_itself = |after: &str| {
        let from = seen.count();
        wait_for(after, || (seen.like(from, is_fixed) > 10).then_some(()));
    };
    sees_itself("the start");

    let mut reader = Command::new("mosquitto_sub");
    reader.args(["-h", "127.0.0.1", "-p", &port.to_string(), "-t", "kurs/#", "-C", "5"]);
    match reader.output() {
        Ok(read) => {
            let read = String::from_utf8(read.stdout).unwrap();
            assert_eq!(read.lines().count(), 5, "{read}");
            for line in read.lines() {
                let row: serde_json::Value = serde_json::from_str(line).unwrap();
                assert_eq!((&row["body"], &row["status"]), (&"ferry".into(), &"fixed".into()));
                assert!((row["heading_deg"].as_f64().unwrap() - 40.0).abs() < 2.0, "{line}");
            }
        }
        Err(error) => outside::lacking(&format!("mosquitto_sub: {error}")),
    }

    drop(broker);
    let from = seen.count();
    let is_silent = |value: &serde_json::Value| value["reason"] == "peer_silent";
    wait_for("a silent peer", || (seen.like(from, is_silent) > 3).then_some(()));
    let broker = Partner::start("mosquitto", &["-c", &settings]);
    sees_itself("the broker's return");
    for value in seen.0.lock().unwrap().iter().filter(|value| is_fixed(value)) {
        let heading_deg = value["heading_deg"].as_f64().unwrap();
        assert!(((heading_deg + 180.0).rem_euclid(360.0) - 180.0).abs() < 1.0, "{value}");
    }
    drop((service, broker));
}

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

/// The casters of pygnssutils (PyPI), one for each antenna, with a password; the stream of the second one
/// comes through its client.
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

/// A caster with a certificate of its own, which the system is told to trust; another one is refused.
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
