//! The rows of `kurs live` are those of `kurs solve`, whatever way the bytes take.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use kurs::ephemeris::NavigationData;
use kurs::frames::Geodetic;
use kurs_formats::sbf::SbfWriter;

use super::stage::{
    EPOCHS, Fault, Lines, Messages, Receivers, SCENARIO, Service, assert_same, configuration,
    epochs_of, free_port, get, log, logs, rows, serve, simulate, solve, solved, statuses, wait_for,
};

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

/// The station says where it is: coordinates are relative to it, as with the place in the
/// configuration. One that is 50 m away from what it says is not believed, and told.
#[test]
fn a_station_is_where_its_stream_says() {
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), &(SCENARIO.to_owned() + STATION));
    let stream =
        |name: &str| format!("stream = \"file://{}?speed=0\"", folder.path().join(name).display());
    // Error of the latitude and its standard deviation, m, of the last row.
    let last = |place: &str| {
        let station = format!("[station]\n{}\n{place}", stream("base.rtcm3"));
        let text = configuration([&stream("A0.ubx"), &stream("A1.ubx")], &station);
        let _ = fs::remove_dir_all(folder.path().join("live"));
        let service = Service::start(folder.path(), &text, &["--once"]);
        let (status, out) = service.end(Duration::from_secs(60));
        assert_eq!(status, Some(0));
        let all = rows(&out)[0].clone();
        let row: Vec<&str> = all.lines().last().unwrap().split(',').collect();
        let number = |k: usize| row[k].parse::<f64>().unwrap();
        let said = fs::read_to_string(folder.path().join("said.txt")).unwrap();
        ((number(20) - 52.0) * 111_300.0, number(23), said)
    };
    for place in [String::new(), station_position()] {
        let (error_m, sd_m, _) = last(&place);
        assert!(error_m.abs() < 0.05 && sd_m < 0.05, "{place:?}: {error_m} m, {sd_m} m");
    }
    let away = Geodetic::from_degrees(52.001_45, 13.0, 90.0).to_ecef().xyz();
    let (error_m, sd_m, said) =
        last(&format!("position_ecef_m = [{}, {}, {}]\n", away.x, away.y, away.z));
    assert!(said.contains("50 m from `position_ecef_m`"), "{said}");
    assert!(error_m.abs() < 5.0 && sd_m > 0.1, "{error_m} m, {sd_m} m");
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

/// Simulated logs as services get them, paced ten times faster than they were measured, and what
/// `kurs solve` makes of them: the same. Returns the rows and the lines that an output of profile
/// `marine` sent.
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

/// One receiver's tags are a millisecond before the whole tenths of a second, those of the other
/// one on them.
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

/// Across the end of 2016, when GPST − UTC went from 17 s to 18 s: in what the receivers send (UBX
/// says the difference, GLONASS counts in UTC), and in the UTC that leaves.
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

/// A station once a second, a second and a half late, beside antennas five times a second: the
/// coordinates are relative to it all the same, and without it the attitude is what it was.
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
