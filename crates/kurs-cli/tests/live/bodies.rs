//! Several bodies: relative orientation against the truth, a broker in between.

use std::collections::BTreeMap;
use std::fs;
use std::net::TcpStream;
use std::process::Command;
use std::time::Duration;

use super::outside;
use super::stage::{
    Messages, Partner, Receivers, Service, configuration, free_port, number, simulate, wait_for,
};

/// Two bodies under one sky, each with three antennas, on one band: of several the engine takes
/// half of the noise to be common to them, as under real skies, and the simulated one is not.
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

/// Two services, each of which sees the other as it is; one is killed and comes back. In between
/// the other says that it is silent.
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
    // Of rows with both attitudes of one time, of each body, and of the few that the rates brought to it, of both.
    let mut squares = BTreeMap::<&str, Vec<f64>>::new();
    for (index, messages) in seen.iter().enumerate() {
        let truth = seen_from([angles[index], angles[1 - index]]);
        let list = messages.0.lock().unwrap();
        for value in list.iter().filter(|value| fixed(value)) {
            assert_eq!(
                (&value["body"], &value["peer"]),
                (&bodies[index].into(), &bodies[1 - index].into())
            );
            let number = |name: &str| number(value, name);
            let is_aged = number("own_age_s").abs().max(number("peer_age_s").abs()) > 1e-3;
            let rows = if is_aged { "brought to one time" } else { bodies[index] };
            squares.entry(rows).or_default().push(normalised_square(value, truth));
            // Five and a half metres to the north or the south, by code.
            let north_m = number("north_m") - if index == 0 { 5.563 } else { -5.563 };
            assert!(north_m.abs() < 15.0 && number("east_m").abs() < 15.0, "{value}");
            assert!(number("peer_age_s").abs() < 1.0, "{value}");
        }
    }
    assert!(bodies.iter().all(|body| squares.contains_key(body)));
    for (rows, squares) in &squares {
        let count = squares.len() as f64;
        let (nees, band) = (squares.iter().sum::<f64>() / count, 3.29 * (6.0 / count).sqrt());
        println!("{rows}: NEES {nees:.3}, 3 ± {band:.3}, {count} rows");
        // What is allowed for a rate that changes does not happen at rest.
        let least = if bodies.contains(rows) { 3.0 - band } else { 0.0 };
        assert!((least..3.0 + band).contains(&nees), "{rows}: {nees}, {count}");
    }
    let file =
        fs::read_dir(&first.out).unwrap().next().unwrap().unwrap().path().join("relative.csv");
    let text = fs::read_to_string(file).unwrap();
    assert!(text.starts_with("time_gpst,body,peer,heading_deg,"));
    let lost = format!(",tractor,implement{}0.0000,,lost,peer_silent\n", ",".repeat(13));
    assert!(text.contains(&lost), "{text}");
    drop((first, second));
}

/// A body that publishes its rows at a broker and is its own peer there, beside a foreign reader;
/// the broker is killed and comes back.
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
