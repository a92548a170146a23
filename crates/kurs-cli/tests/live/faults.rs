//! Faults of streams, disks and the service itself: rows go on, and no wrong one leaves as fixed.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::{Duration, Instant};

use kurs::ephemeris::NavigationData;
use kurs_formats::ubx::UbxWriter;

use super::outside;
use super::stage::{
    EPOCHS, Fault, Lines, Messages, Receivers, Row, SCENARIO, Service, configuration, epochs_of,
    free_port, get, kurs, log, logs, rows, rows_so_far, simulate, statuses, wait_for,
};

/// NAV-STATUS of u-blox with this `spoofDetState`.
fn nav_status(spoofing: u8) -> Vec<u8> {
    let mut payload = [0; 16];
    payload[7] = spoofing << 3;
    kurs_formats::ubx::frame([0x01, 0x03], &payload)
}

/// A receiver that states spoofing before the 51st epoch and takes it back before the 71st: the
/// rows between are refused, by `solve` and `live` alike, and by neither if the flags are not to be
/// used.
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

/// Pieces of a UBX log, one for every epoch: each ends where the next RXM-RAWX begins.
fn pieces(log: &[u8]) -> Vec<Vec<u8>> {
    let rawx = [0xb5, 0x62, 0x02, 0x15];
    let mut starts: Vec<usize> =
        (0..log.len() - 4).filter(|at| log[*at..].starts_with(&rawx)).collect();
    starts[0] = 0;
    starts.push(log.len());
    starts.windows(2).map(|pair| log[pair[0]..pair[1]].to_vec()).collect()
}

/// Every tenth epoch has phases to which no integers fit: the search takes what the budget of an
/// epoch allows, the row says so, and neither it nor the one behind it is late.
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

/// Killed with the first rows, and again in the midst of a row, and started again: fixed again with
/// the first epoch, though the receivers say their ephemerides but once; in the same file, whose
/// half row is gone.
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

/// Rows in order, of which those from number `killed` on are fixed as soon as both antennas have an
/// epoch.
fn assert_goes_on(all: &[Row], killed: usize) {
    assert!(all.windows(2).all(|pair| pair[0].time < pair[1].time), "{all:?}");
    let (whole, of_one): (Vec<_>, Vec<_>) =
        all[killed..].iter().partition(|row| row.antennas == "2");
    assert!(whole.len() > 3 && whole.iter().all(|row| row.status == "fixed"), "{whole:?}");
    // The first epoch may have come to one antenna only, before the other was connected.
    assert!(of_one.len() <= 1, "{of_one:?}");
}

/// The cable of one antenna is cut in mid-message and put back: rows go on without it, then with
/// it, and nothing is wrong. Two hundred clients that never read disturb nobody.
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

/// Three antennas whose clocks step by milliseconds, and one thing after the other on their lines:
/// in the meantime nothing wrong leaves, afterwards all three are in fixed rows again, and nothing
/// needs a hand.
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

/// One antenna is always half a second late where rows wait a tenth: it is named, by how much,
/// until it comes in time.
#[test]
fn an_antenna_that_is_always_late_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let receivers = Receivers::start(folder.path(), "ubx", 0.2, "1");
    let lines = Lines::new(&receivers, 2);
    let page = free_port();
    let more = format!("[live]\ndeadline_ms = 100\npage = \"127.0.0.1:{page}\"\n");
    let text = configuration([&lines.stream(0), &lines.stream(1)], &more);
    let service = Service::start(folder.path(), &text, &[]);
    let is_well = || (get(page, "/healthz").0 == 200).then_some(());
    wait_for("rows", || (statuses(&service.out).len() > 5).then_some(()));
    wait_for("good health", is_well);
    lines.state.lock().unwrap()[1].delay = Duration::from_millis(500);
    wait_for("the late one in /healthz", || {
        get(page, "/healthz").1.contains("A1 is late by 0.").then_some(())
    });
    service.wait_for_words("A1 is late by 0.");
    lines.state.lock().unwrap()[1].delay = Duration::ZERO;
    service.wait_for_words("A1 is in time again");
    wait_for("good health", is_well);
}

/// The disk takes no more than forty kilobytes of any file for a while: messages leave all the
/// same, and when there is room again the files go on with whole rows.
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
