//! A gyro beside the antennas: the rows are those of `kurs fuse`, and never wait for it.

use std::fs;
use std::io::Write;
use std::net::TcpListener;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use super::stage::{
    Fault, Lines, Messages, Receivers, Service, configuration, free_port, get, kurs, rows, serve,
    wait_for,
};

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

/// Antennas and sensor through TCP in pieces of any size, none of them at the pace of the others;
/// the sensor from a log; and rows between the epochs.
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

/// Lines of a sensor at a port, as `time_s` of a body at rest on the roof: level but for its pitch
/// of 3°.
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

/// A gyro that says nothing, whose time goes back, that is late, then there again: the antennas'
/// rows go on, what is wrong is named. Carried rows leave the output that asks for them alone.
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
