//! What the tests stand on: simulated logs and receivers, services and their rows, waiting.

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
use kurs::observation::AntennaEpoch;
use kurs_formats::logs::{LogOptions, LogReader};
use kurs_formats::source::Source;

use super::outside;

/// Two antennas at rest, twenty seconds across midnight of GPST, 5 Hz.
pub(crate) const SCENARIO: &str = r#"
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

pub(crate) const EPOCHS: usize = 101;

pub(crate) fn kurs() -> Command {
    Command::new(env!("CARGO_BIN_EXE_kurs"))
}

/// The simulated logs, made once.
pub(crate) fn logs() -> &'static Path {
    static LOGS: OnceLock<tempfile::TempDir> = OnceLock::new();
    LOGS.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), SCENARIO);
        folder
    })
    .path()
}

/// Makes the files of a scenario.
pub(crate) fn simulate(folder: &Path, text: &str) {
    let scenario = folder.join("scenario.toml");
    fs::write(&scenario, text).unwrap();
    let mut run = kurs();
    run.arg("simulate").arg(&scenario).args(["--quiet", "--out"]).arg(folder);
    assert!(run.status().unwrap().success());
}

/// The rows of `kurs solve`: the attitude and the baselines.
pub(crate) fn solve(folder: &Path, configuration: &str) -> [String; 2] {
    let file = folder.join("solve.toml");
    fs::write(&file, configuration).unwrap();
    let out = folder.join("solved");
    let run = kurs().arg("solve").arg(&file).arg("--quiet").arg("--out").arg(&out).status();
    assert!(run.unwrap().success());
    ["attitude.csv", "baselines.csv"].map(|name| fs::read_to_string(out.join(name)).unwrap())
}

/// The configuration of both antennas, each with a line of its own.
pub(crate) fn configuration(lines: [&str; 2], more: &str) -> String {
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
pub(crate) fn rows(out: &Path) -> [String; 2] {
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
pub(crate) fn solved(folder: &Path, format: &str, ambiguity: &str) -> [String; 2] {
    let obs = |index: usize| {
        format!("obs = [\"{}\"]", logs().join(format!("A{index}.{format}")).display())
    };
    let more = format!("[solve]\nambiguity = \"{ambiguity}\"\n");
    solve(folder, &configuration([&obs(0), &obs(1)], &more))
}

pub(crate) fn assert_same(live: &[String; 2], solved: &[String; 2], what: &str) {
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
pub(crate) struct Service {
    pub(crate) child: Child,
    pub(crate) out: PathBuf,
}

impl Service {
    pub(crate) fn start(folder: &Path, configuration: &str, flags: &[&str]) -> Self {
        let file = folder.join("live.toml");
        fs::write(&file, configuration).unwrap();
        let out = folder.join("live");
        let mut command = kurs();
        command.arg("live").arg(&file).args(flags).arg("--out").arg(&out);
        let said = fs::File::create(folder.join("said.txt")).unwrap();
        let child = command.stdout(Stdio::null()).stderr(said).spawn().unwrap();
        Self { child, out }
    }

    /// Waits until its log has this.
    pub(crate) fn wait_for_words(&self, words: &str) {
        let log = self.out.with_file_name("said.txt");
        wait_for(words, || fs::read_to_string(&log).unwrap().contains(words).then_some(()));
    }

    /// Waits for its end.
    pub(crate) fn end(mut self, limit: Duration) -> (Option<i32>, PathBuf) {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return (status.code(), self.out.clone());
            }
            assert!(began.elapsed() < limit, "the service does not end");
            thread::sleep(Duration::from_millis(20));
        }
    }

    pub(crate) fn signal(&self, name: &str) {
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
pub(crate) fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
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
pub(crate) fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// Serves bytes to one client, in pieces of odd sizes with pauses of up to so many milliseconds.
pub(crate) fn serve(bytes: Vec<u8>, pause_ms: u64) -> u16 {
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
pub(crate) fn epochs_of(log: &Path, navigation: &mut NavigationData) -> Vec<AntennaEpoch> {
    let source = Source::new(fs::File::open(log).unwrap(), log.display().to_string()).unwrap();
    let mut reader = LogReader::of_stream(source, &LogOptions::default()).unwrap();
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).unwrap() {
        navigation.update(&reader.take_news());
        epochs.push(core::mem::take(&mut epoch));
    }
    epochs
}

pub(crate) fn log(index: usize, format: &str) -> Vec<u8> {
    fs::read(logs().join(format!("A{index}.{format}"))).unwrap()
}

/// Status and body of a page.
pub(crate) fn get(port: u16, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let status = text.split(' ').nth(1).unwrap().parse().unwrap();
    (status, text.split_once("\r\n\r\n").unwrap().1.to_owned())
}

/// A caster that answers like this and then sends these bytes; it gives back what it was asked.
pub(crate) fn caster(answer: &'static str, body: Vec<u8>) -> (u16, thread::JoinHandle<String>) {
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

/// Simulated receivers on ports of their own.
pub(crate) struct Receivers {
    pub(crate) child: Child,
    pub(crate) port: u16,
}

impl Receivers {
    pub(crate) fn start(folder: &Path, format: &str, interval_s: f64, speed: &str) -> Self {
        let text = SCENARIO.replace("interval_s = 0.2", &format!("interval_s = {interval_s}"));
        Self::of_scenario(folder, &text, format, speed)
    }

    pub(crate) fn of_scenario(folder: &Path, text: &str, format: &str, speed: &str) -> Self {
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

    pub(crate) fn streams(&self) -> [String; 2] {
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
pub(crate) fn statuses(out: &Path) -> Vec<(String, String)> {
    rows_so_far(out).into_iter().map(|row| (row.time, row.status)).collect()
}

/// What tests look at in a row.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) time: String,
    pub(crate) status: String,
    pub(crate) antennas: String,
}

/// Every row in a file that is being written.
pub(crate) fn rows_so_far(out: &Path) -> Vec<Row> {
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

/// What happens on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
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
pub(crate) struct Lines {
    pub(crate) ports: Vec<u16>,
    pub(crate) state: Arc<Mutex<Vec<Line>>>,
    pub(crate) attempts: Arc<AtomicUsize>,
}

pub(crate) struct Line {
    pub(crate) fault: Fault,
    /// To which client the bytes go.
    pub(crate) to: usize,
    pub(crate) delay: Duration,
    pub(crate) client: Option<TcpStream>,
}

impl Lines {
    pub(crate) fn new(receivers: &Receivers, count: u16) -> Self {
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

    pub(crate) fn stream(&self, index: usize) -> String {
        format!("stream = \"tcp://127.0.0.1:{}\"", self.ports[index])
    }

    pub(crate) fn set(&self, faults: &[(usize, Fault)]) {
        for (index, fault) in faults {
            self.state.lock().unwrap()[*index].fault = *fault;
        }
    }
}

/// What leaves the line in place of these bytes.
pub(crate) fn altered(fault: Fault, mut bytes: Vec<u8>, piece: usize) -> Vec<u8> {
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
pub(crate) struct Messages(pub(crate) Arc<Mutex<Vec<serde_json::Value>>>);

impl Messages {
    pub(crate) fn of_port(port: u16) -> Self {
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

    pub(crate) fn count(&self) -> usize {
        self.0.lock().unwrap().len()
    }

    /// How many from this number on are like that.
    pub(crate) fn like(&self, from: usize, is_like: impl Fn(&serde_json::Value) -> bool) -> usize {
        self.0.lock().unwrap()[from..].iter().filter(|value| is_like(value)).count()
    }

    /// Every heading that left was right, and no time came twice.
    pub(crate) fn check(&self, heading_deg: f64) {
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

pub(crate) fn number(value: &serde_json::Value, name: &str) -> f64 {
    value[name].as_f64().unwrap_or_else(|| panic!("{name}: {value}"))
}

/// A program that ends with the test; `None` if it is not installed.
pub(crate) struct Partner(pub(crate) Child);

impl Partner {
    pub(crate) fn start(program: &str, arguments: &[&str]) -> Option<Self> {
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
