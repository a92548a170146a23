//! One command line for all commands: files told by their content, pipes, the part of a session,
//! folders that are cleared, interruption, a full disk, explanations, completions, formats for
//! other programs.
#![allow(clippy::unwrap_used)] // tests

use std::fs;
use std::io::Write as _;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command as Program, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use assert_cmd::Command;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use tempfile::TempDir;

const KURS: &str = env!("CARGO_BIN_EXE_kurs");

/// An example of `kurs fuse`.
const KURS_ARM: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/fuse/rotating-arm.toml");

/// Two antennas that stand, one minute: bow.rnx, stern.rnx, nav.rnx, kurs.toml, truth.csv.
const SCENARIO: &str = r#"
start = "2024-03-10T12:00:00"
duration_s = 59.0
interval_s = 1.0
signals = ["G1C", "G2W", "E1C", "E5Q"]
[sky]
systems = ["G", "E"]
[output]
formats = ["rinex", "crinex.gz", "ubx"]
[[body]]
name = "boat"
[body.motion]
kind = "static"
place = { latitude_deg = 59.9, longitude_deg = 29.7, height_m = 10.0 }
heading_deg = 280.0
[[body.antenna]]
name = "stern"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "bow"
position_m = [2.0, 0.0, 0.0]
"#;

/// One session for every test; nothing is written into it.
fn session() -> &'static Path {
    static SESSION: OnceLock<TempDir> = OnceLock::new();
    let folder = SESSION.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scenario.toml"), SCENARIO).unwrap();
        run(folder.path(), &["simulate", "scenario.toml", "--out", ".", "--quiet"]);
        folder
    });
    folder.path()
}

/// Runs the program in a folder; its output.
fn ran(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(KURS).current_dir(folder).args(arguments).output().unwrap()
}

/// Runs the program where it must succeed; standard output.
fn run(folder: &Path, arguments: &[&str]) -> String {
    let output = ran(folder, arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the program where it must fail with this status; standard error.
fn refused(folder: &Path, status: i32, arguments: &[&str]) -> String {
    let output = ran(folder, arguments);
    assert_eq!(output.status.code(), Some(status), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

fn json(folder: &Path, name: &str) -> Value {
    serde_json::from_str(&text(folder, name)).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// `stern.rnx` … of the session.
fn file(name: &str) -> String {
    let found = session().join(name);
    assert!(found.exists(), "{}: {:?}", found.display(), names(session()));
    found.display().to_string()
}

#[test]
fn files_are_told_by_their_content_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let (stern, bow, nav) = (file("stern.rnx"), file("bow.rnx"), file("nav.rnx"));
    let solve = |name: &str, files: &[&str]| {
        let arguments: Vec<&str> =
            ["solve", "--quiet", "--out", name].iter().chain(files).copied().collect();
        run(out, &arguments);
        text(&out.join(name), "attitude.csv")
    };
    let usual = solve("usual", &[&stern, &bow, "--nav", &nav]);
    assert_eq!(usual.lines().count(), 61);
    assert!(usual.lines().skip(1).all(|row| row.contains(",fixed,")), "{usual}");
    assert_eq!(solve("first", &["--nav", &nav, &stern, &bow]), usual, "--nav takes what follows");
    assert_eq!(solve("mixed", &[&nav, &stern, &bow]), usual);
    // The order of the antennas is that of the files: the first is the origin.
    let swapped = solve("swapped", &[&bow, &nav, &stern]);
    let heading = |rows: &str| -> f64 {
        rows.lines().nth(1).unwrap().split(',').nth(8).unwrap().parse().unwrap()
    };
    assert!((heading(&usual) - 280.0).abs() < 1.0 && (heading(&swapped) - 100.0).abs() < 1.0);
    // Logs bring their ephemerides.
    solve("logs", &[&file("stern.ubx"), &file("bow.ubx")]);
    let named = text(&out.join("usual"), "baselines.csv");
    assert!(named.lines().nth(1).unwrap().contains(",stern,bow,"), "{named}");

    let error = refused(out, 2, &["solve", &stern, &nav]);
    assert!(
        error.contains("at least two antennas are needed") && error.contains("antennas: stern"),
        "{error}"
    );
    fs::write(out.join("page.html"), "<!DOCTYPE html><p>log in").unwrap();
    let error = refused(out, 1, &["solve", &stern, &bow, "page.html"]);
    assert!(error.contains("page.html: found a web page"), "{error}");
}

#[test]
fn a_configuration_is_begun_from_files() {
    let folder = tempfile::tempdir().unwrap();
    let (stern, bow, nav) = (file("stern.rnx"), file("bow.crx.gz"), file("nav.rnx"));
    run(folder.path(), &["init", &nav, &stern, &bow]);
    let path = "kurs-out/init/kurs.toml";
    let written = text(folder.path(), path);
    assert!(written.contains("every 1 s; carrier phases of G1 G2 E1 E5"), "{written}");
    assert!(written.contains("# bands = [\"G1\", \"G2\", \"E1\", \"E5\"]"), "{written}");
    run(folder.path(), &["solve", path, "--quiet"]);
    assert_eq!(json(folder.path(), "kurs-out/solve/summary.json")["fixed"], 60);

    // What it proposes behind a # can be put in force.
    let in_force: Vec<String> = written
        .lines()
        .filter(|line| !line.starts_with("# ") || line.contains(" = ") || line.contains("[["))
        .map(|line| line.trim_start_matches("# ").to_owned())
        .collect();
    let places = in_force.join("\n").replacen("[0.0, 0.0, 0.0]", "[2.0, 0.0, 0.0]", 1);
    fs::write(folder.path().join("all.toml"), places).unwrap();
    let explained = run(folder.path(), &["solve", "all.toml", "--explain"]);
    assert!(explained.contains("point.0.name = \"mast\""), "{explained}");

    let error = refused(folder.path(), 2, &["init", &stern, &bow]);
    assert!(error.contains("--force replaces it"), "{error}");
    let printed = run(folder.path(), &["init", &stern, &bow, "--out", "-"]);
    assert!(printed.contains("# files = [\"brdc.rnx\"]"), "{printed}");

    // What cannot be solved is begun too, and says so in place of the next step.
    let of = |files: &[&str]| run(folder.path(), &[&["init", "--force"], files].concat());
    let told = of(&[&stern, &nav]);
    assert!(told.contains("\none antenna has no attitude: ") && !told.contains("next:"), "{told}");
    assert!(text(folder.path(), path).contains("\n# one antenna has no attitude: "));
    let earlier = text(session(), "bow.rnx").replace("> 2024 ", "> 2023 ");
    fs::write(folder.path().join("earlier.rnx"), earlier).unwrap();
    let told = of(&["earlier.rnx", &stern, &nav]);
    assert!(told.contains("\nno common time: earlier ends before stern begins, 2024-"), "{told}");
}

#[test]
fn pipes_are_inputs_and_outputs() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["solve", "-", &file("bow.rnx"), "--nav", &file("nav.rnx"), "--out", "-", "--quiet"];
    let output = Command::new(KURS)
        .current_dir(folder.path())
        .args(arguments)
        .pipe_stdin(session().join("stern.rnx"))
        .unwrap()
        .output()
        .unwrap();
    let rows = String::from_utf8(output.stdout).unwrap();
    assert_eq!(rows.lines().count(), 61, "{}", String::from_utf8_lossy(&output.stderr));
    assert!(rows.starts_with("time_gpst,"), "{rows}");
    assert_eq!(names(folder.path()), [""; 0]);

    let output = Command::new(KURS)
        .args(["inspect", "-"])
        .pipe_stdin(session().join("nav.rnx"))
        .unwrap()
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Whatever is text, for any command: packed, as a file and through standard input.
#[test]
fn text_may_be_packed_and_come_through_a_pipe() {
    let folder = tempfile::tempdir().unwrap();
    let [bow, stern, nav, kurs] = ["bow.rnx", "stern.rnx", "nav.rnx", "kurs.toml"].map(file);
    let array = "[[antenna]]\nname = \"A\"\nposition_m = [0.0, 0.0, 0.0]\n\
                 [[antenna]]\nname = \"B\"\nposition_m = [2.0, 0.0, 0.0]\n";
    let positions =
        "gps_week,tow_s,name,x_m,y_m,z_m\n2300,1,A,6378137.000,0,0\n2300,1,B,6378137.000,0,2\n";
    fs::write(folder.path().join("positions.csv"), positions).unwrap();
    let manifest = format!("label,files,nav\none,{bow};{stern},{nav}\n");
    let truth = text(session(), "truth.csv");
    let arm = fs::read_to_string(KURS_ARM).unwrap();
    for (before, what, after, status) in [
        (&["simulate"][..], SCENARIO, &["--every", "20"][..], 0),
        (&["plan"], array, &["--for", "10m"], 0),
        (&["orient"], array, &["positions.csv"], 0),
        (&["batch"], &manifest, &[], 0),
        (&["solve", &kurs, "--truth"], &truth, &[], 0),
        (&["fuse"], &arm, &["--set", "simulate.duration_s=3"], 0),
        // Of a log without a row its end is reached.
        (&["calibrate", "gyro-bias"], "time_s,gx_radps,gy_radps,gz_radps\n", &[], 1),
    ] {
        let packed = folder.path().join("packed");
        let mut encoder = GzEncoder::new(fs::File::create(&packed).unwrap(), Compression::fast());
        encoder.write_all(what.as_bytes()).unwrap();
        encoder.finish().unwrap();
        for input in ["packed", "-"] {
            let arguments = [before, &[input], after, &["--quiet", "--out", "out"]].concat();
            let mut program = Command::new(KURS);
            let program = program.current_dir(folder.path()).args(&arguments);
            let output = program.pipe_stdin(&packed).unwrap().output().unwrap();
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
            assert!(status == 0 || said.contains("no usable row"), "{arguments:?}: {said}");
        }
    }
}

/// A configuration that comes through a pipe has its paths from the working folder, and none is
/// made of pipes.
#[test]
fn a_configuration_may_be_a_pipe_and_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let piped = |arguments: &[&str], input: &str| {
        let mut kurs = Command::new(KURS);
        let kurs = kurs.current_dir(session()).args(arguments).pipe_stdin(session().join(input));
        kurs.unwrap().output().unwrap()
    };
    let out = folder.path().display().to_string();
    let output = piped(&["solve", "-", "--quiet", "--out", &out], "kurs.toml");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = piped(&["init", "-", "stern.rnx", "nav.rnx", "--out", &out], "bow.rnx");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("standard input: a pipe is gone when"), "{said}");
    let error = refused(folder.path(), 2, &["init", &file("truth.csv")]);
    assert!(
        error.contains("is some other text, expected observations and navigation data"),
        "{error}"
    );
}

/// Every epoch is solved from either end and has one row; streams, which have no end, are refused.
#[test]
fn a_session_is_solved_from_either_end() {
    let folder = tempfile::tempdir().unwrap();
    let (configuration, both) = (file("kurs.toml"), ["--set", "direction=both"]);
    let continuous = ["--set", "ambiguity=continuous", "--quiet"];
    run(folder.path(), &[&["solve", &configuration][..], &both, &continuous].concat());
    let rows = text(folder.path(), "kurs-out/solve/attitude.csv");
    assert_eq!((rows.lines().count(), rows.matches(",fixed,").count()), (61, 60), "{rows}");

    let error = refused(folder.path(), 2, &[&["live", &configuration][..], &both].concat());
    assert!(error.contains("a stream can only be solved as it comes"), "{error}");
}

/// A log that is not there has ended, and nobody waits for it.
#[test]
fn a_run_over_logs_ends_without_one_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let antenna = |name: &str, log: &str, x: f64| {
        format!(
            "[[antenna]]\nname = \"{name}\"\nstream = \"file://{log}?speed=0\"\nposition_m = [{x:.1}, 0.0, 0.0]\n"
        )
    };
    let there = file("bow.ubx");
    let configuration = antenna("stern", "absent.ubx", 0.0) + &antenna("bow", &there, 2.0);
    fs::write(folder.path().join("live.toml"), configuration).unwrap();
    let mut kurs = Command::new(KURS);
    let kurs = kurs.current_dir(folder.path()).args(["live", "live.toml", "--once"]);
    let output = kurs.timeout(Duration::from_secs(60)).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("absent.ubx") && said.contains("every epoch is lost"), "{said}");
}

#[test]
fn only_a_part_of_the_session_counts() {
    let folder = tempfile::tempdir().unwrap();
    let window = ["--from", "2024-03-10T12:00:10", "--to", "2024-03-10T12:00:40", "--every", "5"];
    let configuration = file("kurs.toml");
    let solve: Vec<&str> =
        ["solve", &configuration, "--quiet"].iter().chain(&window).copied().collect();
    run(folder.path(), &solve);
    let rows = text(folder.path(), "kurs-out/solve/attitude.csv");
    let times: Vec<&str> = rows.lines().skip(1).map(|row| &row[14..19]).collect();
    assert_eq!(times, ["00:10", "00:15", "00:20", "00:25", "00:30", "00:35", "00:40"]);

    let survey = run(folder.path(), &["survey", &configuration, "--json", "--every", "2"]);
    let surveyed: Value = serde_json::from_str(&survey).unwrap();
    assert_eq!(surveyed["fixes"], 30);
    let error = refused(
        folder.path(),
        2,
        &["solve", &configuration, "--from", "2024-03-10T12:00:10", "--to", "2024-03-10"],
    );
    assert!(error.contains("is before --from"), "{error}");
    let error = refused(folder.path(), 2, &["solve", &configuration, "--from", "noon"]);
    assert!(error.contains("expected a GPS time such as"), "{error}");
}

#[test]
fn every_run_clears_what_an_older_one_left() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("kurs-out/solve");
    let configuration = file("kurs.toml");
    let all = "csv,jsonl,nmea,pos";
    run(folder.path(), &["solve", &configuration, "--report", "--format", all, "--quiet"]);
    let everything = [
        "attitude.csv",
        "attitude.jsonl",
        "attitude.nmea",
        "baseline-stern-bow.pos",
        "baselines.csv",
        "baselines.jsonl",
        "position.pos",
        "report.html",
        "summary.json",
        "track.geojson",
        "track.kml",
    ];
    assert_eq!(names(&out), everything);
    fs::write(out.join("notes.txt"), "mine").unwrap();
    run(folder.path(), &["solve", &configuration, "--quiet"]);
    assert_eq!(names(&out), ["attitude.csv", "baselines.csv", "notes.txt", "summary.json"]);
    // Of a run that fails nothing is left, and nothing that could be taken for its result.
    let arguments =
        ["solve", &file("stern.rnx"), &file("bow.rnx"), &file("nav.rnx"), "--from", "2025-01-01"];
    let error = refused(folder.path(), 1, &arguments);
    assert!(error.contains("no epoch"), "{error}");
    assert_eq!(names(&out), ["notes.txt"]);
}

#[test]
fn every_key_has_its_source() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("boat.toml");
    let mut body = fs::read_to_string(session().join("kurs.toml")).unwrap();
    for name in ["stern.rnx", "bow.rnx", "nav.rnx"] {
        body = body.replace(name, &file(name));
    }
    body = body.replace(
        "\n[solve]\n",
        "approximate_time = 2024-03-10\n\n[solve]\nelevation_mask_deg = 12.5\n",
    );
    fs::write(&config, &body).unwrap();
    let line_of = |text: &str| 1 + body.lines().position(|line| line.starts_with(text)).unwrap();
    let explained = run(
        folder.path(),
        &["solve", "boat.toml", "--nav", &file("nav.rnx"), "--set", "bands=[G1]", "--explain"],
    );
    let has = |line: &str| assert!(explained.lines().any(|l| l == line), "{line}\n{explained}");
    has("solve.bands = [\"G1\"]  [--set]");
    has("solve.constraint = \"length\"  [default: every antenna has a position]");
    has("solve.max_tilt_deg = 90.0  [default]");
    has(&format!("solve.elevation_mask_deg = 12.5  [boat.toml:{}]", line_of("elevation")));
    has(&format!("nav.approximate_time = 2024-03-10  [boat.toml:{}]", line_of("approximate")));
    has(&format!("nav.files = [\"{}\"]  [--nav]", file("nav.rnx")));
    has(&format!("antenna.0.name = \"stern\"  [boat.toml:{}]", line_of("name = \"stern\"")));

    // As a configuration it says the same.
    let as_toml =
        run(folder.path(), &["solve", "boat.toml", "--set", "bands=[G1]", "--explain=toml"]);
    fs::write(folder.path().join("again.toml"), &as_toml).unwrap();
    let values = |text: &str| -> Vec<String> {
        let lines = text.lines().map(|line| line.split("  [").next().unwrap().to_owned());
        lines.collect()
    };
    let again = run(folder.path(), &["solve", "again.toml", "--explain"]);
    assert_eq!(values(&again), values(&explained));
}

/// Starts the program, interrupts it once it has written something, and waits for its end.
#[cfg(unix)]
fn interrupted(folder: &Path, out: &Path, arguments: &[&str]) -> Output {
    interrupted_when(folder, arguments, || {
        let parts = fs::read_dir(out).into_iter().flatten().flatten();
        let mut written =
            parts.filter(|e| e.path().is_dir()).flat_map(|e| fs::read_dir(e.path()).unwrap());
        written.any(|file| file.unwrap().metadata().is_ok_and(|data| data.len() > 0))
    })
}

#[cfg(unix)]
fn interrupted_when(folder: &Path, arguments: &[&str], is_at_work: impl Fn() -> bool) -> Output {
    let child = Program::new(KURS)
        .current_dir(folder)
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while !is_at_work() && begun.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(5));
    }
    let signalled = Program::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(signalled.unwrap().success());
    child.wait_with_output().unwrap()
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_is_a_valid_result() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("kurs-out/simulate");
    let scenario = file("scenario.toml");
    let arguments = ["simulate", &scenario, "--set", "duration_s=80000"];
    let output = interrupted(folder.path(), &out, &arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains("interrupted"), "{said}");
    assert!(names(&out).iter().all(|name| !name.starts_with('.')), "{:?}", names(&out));
    let simulated = text(&out, "truth.csv").lines().count() - 1;
    assert!((1..80_000).contains(&simulated), "{simulated}");
    run(folder.path(), &["simulate", &scenario, "--set", "duration_s=6000", "--quiet"]);

    let out = folder.path().join("kurs-out/solve");
    let output =
        interrupted(folder.path(), &out, &["solve", "kurs-out/simulate/kurs.toml", "--report"]);
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    let summary = json(&out, "summary.json");
    assert_eq!(summary["interrupted"], true);
    let rows = text(&out, "attitude.csv");
    assert_eq!(summary["epochs"], rows.lines().count() as u64 - 1);
    assert!(rows.ends_with('\n') && rows.lines().count() < 6000);
    let expected = [
        "attitude.csv",
        "baselines.csv",
        "report.html",
        "summary.json",
        "track.geojson",
        "track.kml",
    ];
    assert_eq!(names(&out), expected);

    // A session of an archive that is cut short, and has nothing to show, has not failed.
    let manifest = "label,config,set\nday,kurs-out/simulate/kurs.toml,elevation_mask_deg=89\n";
    fs::write(folder.path().join("archive.csv"), manifest).unwrap();
    let out = folder.path().join("kurs-out/batch/session=day");
    let output = interrupted(folder.path(), &out, &["batch", "archive.csv"]);
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!out.join("failure.json").exists());
}

/// With a part of the car nothing is solved, and what is not there yet is no error of the input.
#[cfg(unix)]
#[test]
fn a_run_interrupted_too_early_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("kurs-out/demo");
    let output = interrupted(folder.path(), &out, &["demo"]);
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!out.join("attitude.csv").exists());

    // A day of which only the evening is wanted: nothing of it is there yet.
    let out = folder.path().join("kurs-out/simulate");
    let scenario = file("scenario.toml");
    let evening = ["--set", "duration_s=80000", "--from", "2024-03-11T10:00:00"];
    let arguments = [&["simulate", &scenario][..], &evening].concat();
    let output = interrupted_when(folder.path(), &arguments, || out.exists());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains("interrupted before there was"), "{said}");
}

/// One that waits for somebody to send to.
#[cfg(unix)]
#[test]
fn an_interrupted_stream_is_not_done() {
    let folder = tempfile::tempdir().unwrap();
    let is_free = |port: u16| TcpListener::bind(("127.0.0.1", port)).is_ok();
    let first = (20_000..30_000).find(|port| is_free(*port) && is_free(port + 1)).unwrap();
    let (scenario, port) = (file("scenario.toml"), first.to_string());
    let arguments = ["simulate", &scenario, "--stream", &port];
    // Whoever asks whether it listens is its first client.
    let is_listening = || TcpStream::connect(("127.0.0.1", first)).is_ok();
    let output = interrupted_when(folder.path(), &arguments, is_listening);
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The limit on the size of files stands for a full disk: a write fails in the middle of a table.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing_half() {
    let folder = tempfile::tempdir().unwrap();
    for (command, input, blocks, named) in [
        ("solve", "kurs.toml", 16, "kurs-out/solve/attitude.csv"),
        ("simulate", "scenario.toml", 16, ".rnx"),
        ("man", "", 1, "kurs-out/man: cannot be written"),
    ] {
        let input = if input.is_empty() { String::new() } else { file(input) };
        let limited =
            format!("trap '' XFSZ; ulimit -f {blocks}; exec {KURS} {command} {input} --quiet");
        let output =
            Program::new("sh").current_dir(folder.path()).args(["-c", &limited]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(&format!("{named}: File too large")), "{said}");
        assert!(!said.contains(".kurs.part"), "{said}");
        assert!(!folder.path().join("kurs-out").join(command).exists());
    }
}

#[test]
fn results_that_would_be_lost_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let kurs = file("kurs.toml");
    for (more, expected) in [
        (&["--format", "nmea,nmea:gpsd"][..], "two of the formats are attitude.nmea"),
        (&["--out", "-", "--format", "nmea,csv"], "--out - prints one --format, 2 found"),
        (&["--out", "-", "--json"], "--out - and --json both print"),
    ] {
        let error = refused(folder.path(), 2, &[&["solve", &kurs][..], more].concat());
        assert!(error.contains(expected), "{error}");
    }
}

/// Numbers below zero are values: what is wrong with them is told, and no way to make them others.
#[test]
fn negative_numbers_are_told_of_by_their_options() {
    let folder = tempfile::tempdir().unwrap();
    let kurs = file("kurs.toml");
    for (arguments, expected) in [
        (&["solve", &kurs, "--every", "-1"][..], "'-1' for '--every <SECONDS>'"),
        (&["solve", &kurs, "--require-fix", "-3"], "'-3' for '--require-fix <PERCENT>'"),
        (&["calibrate", "multi-pose", "a.csv", "--gravity", "-9.8"], "--gravity: -9.8 found"),
    ] {
        let error = refused(folder.path(), 2, arguments);
        assert!(error.contains(expected) && !error.contains("-- -"), "{error}");
    }
}

/// What is printed must arrive, whichever command prints it.
#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_printed_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let [bow, stern, nav, kurs] = ["bow.rnx", "stern.rnx", "nav.rnx", "kurs.toml"].map(file);
    for arguments in [
        &["--help"][..],
        &["completions", "bash"],
        &["man"],
        &["inspect", &bow],
        &["inspect", "--json", &nav],
        &["init", &bow, &stern, &nav, "--out", "-"],
        &["solve", &kurs, "--explain"],
        &["solve", &kurs, "--json", "--every", "20"],
        &["solve", &kurs, "--every", "20"],
        &["solve", &kurs, "--every", "20", "--out", "-"],
        &["plan", &kurs, "--for", "10m"],
    ] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let mut program = Program::new(KURS);
        let program = program.current_dir(folder.path()).args(arguments);
        let output = program.stdout(full).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("error: standard output: cannot be written: No space"), "{said}");
    }
}

#[test]
fn shells_and_the_manual_know_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = run(folder.path(), &["completions", shell]);
        assert!(script.contains("calibrate") && script.contains("every"), "{shell}");
    }
    run(folder.path(), &["man", "--quiet"]);
    let pages = names(&folder.path().join("kurs-out/man"));
    for page in ["kurs.1", "kurs-solve.1", "kurs-init.1", "kurs-calibrate-six-position.1"] {
        assert!(pages.iter().any(|name| name == page), "{page}: {pages:?}");
    }
    let page = text(folder.path(), "kurs-out/man/kurs-solve.1");
    assert!(page.contains("\\-\\-explain") && page.contains(".SH"), "{page}");
}

#[test]
fn reports_say_what_they_are_made_from() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["solve", &file("kurs.toml"), "--report", "--quiet"]);
    let out = folder.path().join("kurs-out/solve");
    let page = text(&out, "report.html");
    for wanted in [
        "2024-03-10T12:00:00.000 to 2024-03-10T12:00:59.000 GPS time (59 s), every 1 s",
        &file("stern.rnx"),
        concat!("kurs ", env!("CARGO_PKG_VERSION")),
        "\"type\":\"date\"",
        "class=\"plot time\"",
        "Heading rate, degrees/s",
        "\\u003cb\\u003e▲",
    ] {
        let found = page.contains(wanted)
            || page.contains(&wanted.replace("\\u003c", "<").replace("\\u003e", ">"));
        assert!(found, "{wanted}");
    }
    let track = json(&out, "track.geojson");
    let places = track["features"][0]["geometry"]["coordinates"].as_array().unwrap();
    assert_eq!(places.len(), 60);
    assert!((places[0][0].as_f64().unwrap() - 29.7).abs() < 1e-3);
    assert!(text(&out, "track.kml").contains("<LineString>"));
}

/// Coordinates through a pipe; the pages of other commands are of the same kind.
#[test]
fn coordinates_come_through_a_pipe_and_have_a_report() {
    let folder = tempfile::tempdir().unwrap();
    fs::copy(session().join("kurs.toml"), folder.path().join("boat.toml")).unwrap();
    let mut config = text(folder.path(), "boat.toml").split("[nav]").next().unwrap().to_owned();
    config = config.lines().filter(|line| !line.starts_with("obs")).collect::<Vec<_>>().join("\n");
    fs::write(folder.path().join("boat.toml"), config).unwrap();
    // Two metres to the north are 17.95e-6 degrees there.
    let mut table = String::from("time_gpst,name,latitude_deg,longitude_deg,height_m\n");
    for second in 0..20 {
        for (name, latitude) in [("stern", 59.9), ("bow", 59.9 + 17.95e-6)] {
            table += &format!("2024-03-10T12:00:{second:02},{name},{latitude:.9},29.7,10.0\n");
        }
    }
    let output = Command::new(KURS)
        .current_dir(folder.path())
        .args([
            "orient",
            "boat.toml",
            "-",
            "--report",
            "--json",
            "--every",
            "2",
            "--set",
            "sd_down_m=0.03",
        ])
        .write_stdin(table)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&summary["epochs"], &summary["interrupted"]), (&10.into(), &false.into()));
    let out = folder.path().join("kurs-out/orient");
    let page = text(&out, "report.html");
    assert!(page.contains("Kurs: attitude from coordinates") && page.contains("every 2 s"));
    assert_eq!(json(&out, "track.geojson")["features"][0]["geometry"]["type"], "LineString");
}

/// Counts as RTKPLOT reads them: date, time, coordinates, quality, satellites, eight more.
#[test]
fn solutions_are_written_as_rtklib_does() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["solve", &file("kurs.toml"), "--format", "pos", "--quiet"]);
    let out = folder.path().join("kurs-out/solve");
    let baseline = text(&out, "baseline-stern-bow.pos");
    let rows: Vec<Vec<&str>> = baseline
        .lines()
        .filter(|line| !line.starts_with('%'))
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(rows.len(), 60);
    assert!(rows.iter().all(|row| row.len() == 15 && row[5] == "1"), "{:?}", rows[0]);
    assert_eq!((rows[0][0], rows[0][1]), ("2024/03/10", "12:00:00.000"));
    // East and north of two metres towards 280°.
    let [east, north] = [2, 3].map(|k| rows[0][k].parse::<f64>().unwrap());
    assert!((east + 1.970).abs() < 0.02 && (north - 0.347).abs() < 0.02, "{east} {north}");
    let position = text(&out, "position.pos");
    let row: Vec<&str> = position.lines().last().unwrap().split_whitespace().collect();
    assert_eq!((row.len(), row[5]), (15, "5"));
    assert!((row[2].parse::<f64>().unwrap() - 59.9).abs() < 1e-3);
}

#[test]
fn the_same_flags_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let of = |command: &[&str]| run(folder.path(), &[command, &["--help"]].concat());
    for command in ["solve", "survey", "orient", "fuse", "track", "simulate"] {
        let help = of(&[command]);
        for flag in ["--set", "--quiet", "--from", "--to", "--every", "--json", "--out"] {
            assert!(help.contains(flag), "{command} {flag}");
        }
    }
    for command in ["solve", "orient", "fuse", "track"] {
        assert!(of(&[command]).contains("--report"), "{command}");
    }
    let solved: Value =
        serde_json::from_str(&run(folder.path(), &["solve", &file("kurs.toml"), "--json"]))
            .unwrap();
    assert_eq!(solved, json(folder.path(), "kurs-out/solve/summary.json"));
}

/// A manifest with two good sessions and one without its configuration, in a folder of its own.
fn archive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let config = session().join("kurs.toml").display().to_string();
    let rows = format!(
        "label,config,obs:bow,set\n# a comment\nday 1,{config},,\nday 2,{config},,bands=[G1]\nday 3,absent.toml,,\n"
    );
    fs::write(folder.path().join("m.csv"), rows).unwrap();
    folder
}

fn modified(path: &Path) -> std::time::SystemTime {
    fs::metadata(path).unwrap().modified().unwrap()
}

#[test]
fn a_batch_solves_each_session_once_and_counts_the_failed() {
    let folder = archive();
    let folder = folder.path();
    let output = ran(folder, &["batch", "m.csv", "--out", "out"]);
    assert_eq!(output.status.code(), Some(3));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        said.starts_with(
            "2 of 3 sessions done, 0 with nothing fixed, 1 failed\nfirst failure: day 3: "
        ),
        "{said}"
    );
    let status = fs::read_to_string(folder.join("out/manifest-status.csv")).unwrap();
    let lines: Vec<&str> = status.lines().collect();
    assert_eq!(lines[0], "label,status,reason,configuration_hash,epochs,fixed,wall_s");
    assert!(
        lines[1].starts_with("day 1,done,,") && lines[3].starts_with("day 3,failed,"),
        "{status}"
    );
    assert!(folder.join("out/session=day%203/failure.json").exists());

    // The rows are those of `kurs solve`, and what is done stays.
    let rows = folder.join("out/session=day%201/attitude.csv");
    run(session(), &["solve", "kurs.toml", "--out", folder.join("alone").to_str().unwrap()]);
    assert_eq!(fs::read(&rows).unwrap(), fs::read(folder.join("alone/attitude.csv")).unwrap());
    let before = modified(&rows);
    ran(folder, &["batch", "m.csv", "--out", "out", "-q"]);
    assert_eq!(modified(&rows), before);
    ran(folder, &["batch", "m.csv", "--out", "out", "-q", "--set", "elevation_mask_deg=15"]);
    assert_ne!(modified(&rows), before);

    // Two dialects have one name: the other one is another result.
    for (format, has_sd) in [("nmea:survey", true), ("nmea", false)] {
        ran(folder, &["batch", "m.csv", "--out", "out", "-q", "--format", format]);
        let sentences = fs::read_to_string(rows.with_file_name("attitude.nmea")).unwrap();
        assert_eq!(sentences.contains("PASHR"), has_sd, "{format}");
    }

    // Sessions of an older manifest stay, and are told.
    let manifest = fs::read_to_string(folder.join("m.csv")).unwrap();
    let (others, _) = manifest.split_once("day 2").unwrap();
    fs::write(folder.join("m.csv"), others).unwrap();
    let said = ran(folder, &["batch", "m.csv", "--out", "out"]).stdout;
    let expected = "1 of 1 sessions done, 0 with nothing fixed, 0 failed\n\
                    2 folders of sessions that are not in the manifest\n";
    assert!(String::from_utf8(said).unwrap().starts_with(expected));
}

/// A result that is there when an attempt fails is one of other inputs: here one of these would be
/// overwritten.
#[test]
fn an_older_result_is_none_of_a_run_that_failed() {
    let folder = archive();
    let folder = folder.path();
    let batch = |more: &str| {
        let output = ran(folder, &["batch", "m.csv", "--out", "out", "--session", "day 1", more]);
        (output.status.code(), String::from_utf8(output.stdout).unwrap())
    };
    assert_eq!(batch("-q").0, Some(0));
    let target = folder.join("out/session=day%201");
    fs::copy(session().join("bow.rnx"), target.join("attitude.jsonl")).unwrap();
    let manifest = fs::read_to_string(folder.join("m.csv")).unwrap();
    let manifest = manifest.replacen(
        ",,
",
        ",out/session=day%201/attitude.jsonl,
",
        1,
    );
    fs::write(folder.join("m.csv"), manifest).unwrap();
    let (status, said) = batch("--jobs=1");
    assert_eq!(status, Some(1), "{said}");
    assert!(
        said.contains(
            "
first failure: day 1: "
        ) && said.contains("one of the inputs"),
        "{said}"
    );
    assert!(target.join("summary.json").exists() && target.join("failure.json").exists());
    let counts = ran(folder, &["batch", "m.csv", "--out", "out", "--merge", "--json"]).stdout;
    let counts: Value = serde_json::from_slice(&counts).unwrap();
    assert_eq!(counts["failed"].as_u64(), Some(1));
}

#[test]
fn parts_of_a_batch_are_merged_as_often_as_wanted() {
    let folder = archive();
    let folder = folder.path();
    run(folder, &["batch", "m.csv", "--out", "out", "--shard", "0/3", "-q"]);
    assert!(!folder.join("out/manifest-status.csv").exists());
    let merge = || ran(folder, &["batch", "m.csv", "--out", "out", "--merge", "--json"]);
    let counts: Value = serde_json::from_slice(&merge().stdout).unwrap();
    assert_eq!((counts["done"].as_u64(), counts["missing"].as_u64()), (Some(1), Some(2)));
    run(folder, &["batch", "m.csv", "--out", "out", "--session", "day 2", "-q"]);
    assert_eq!(
        ran(folder, &["batch", "m.csv", "--out", "out", "--shard", "2/3"]).status.code(),
        Some(1)
    );
    let once = merge();
    let counts: Value = serde_json::from_slice(&once.stdout).unwrap();
    assert_eq!((counts["done"].as_u64(), counts["failed"].as_u64()), (Some(2), Some(1)));
    let status = fs::read(folder.join("out/manifest-status.csv")).unwrap();
    assert_eq!((merge().stdout, merge().status.code()), (once.stdout, Some(3)));
    assert_eq!(fs::read(folder.join("out/manifest-status.csv")).unwrap(), status);

    for wrong in [&["--shard", "3/3"][..], &["--session", "day 9"], &["--jobs", "0"]] {
        let arguments = [&["batch", "m.csv", "--out", "out"], wrong].concat();
        assert_eq!(ran(folder, &arguments).status.code(), Some(2), "{wrong:?}");
    }
}
