//! Every kind of unusable input has its own message and exit status, and leaves nothing behind.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use tempfile::TempDir;

/// A navigation file with one GPS record, and observation files of some epochs.
struct Folder(TempDir);

/// RINEX 3 observation text: one satellite, `count` epochs from `hour` o'clock.
fn observations(hour: u32, count: u32) -> String {
    let mut text = String::new();
    let header = [
        ("     3.05           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        ("G    2 C1C L1C", "SYS / # / OBS TYPES"),
        ("  2024     6    24     0     0    0.0000000     GPS", "TIME OF FIRST OBS"),
        ("", "END OF HEADER"),
    ];
    for (content, label) in header {
        text += &format!("{content:<60}{label}\n");
    }
    for second in 0..count {
        text += &format!("> 2024 06 24 {hour:02} 00 {second:02}.0000000  0  1\n");
        text += "G05  22000000.000   115600000.000  \n";
    }
    text
}

/// RINEX 3 navigation text: GPS satellite 5, a circular orbit, on this day of June 2024.
fn navigation(day: u32) -> String {
    let mut text =
        format!("{:<60}RINEX VERSION / TYPE\n", "     3.05           NAVIGATION DATA     G");
    text += &format!("{:<60}END OF HEADER\n", "");
    text += &format!("G05 2024 06 {day:02} 08 00 00");
    let toe = f64::from(day - 23) * 86_400.0 + 8.0 * 3600.0;
    let numbers = [
        0.0, 0.0, 0.0, 10.0, 0.0, 4.5e-9, 1.0, 0.0, 0.01, 0.0, 5153.7, toe, 0.0, 1.0, 0.0, 0.96,
        250.0, 0.5, -8e-9, 0.0, 1.0, 2320.0, 0.0, 2.0, 0.0, 0.0, 10.0, toe, 4.0,
    ];
    for (index, value) in numbers.iter().enumerate() {
        if index >= 3 && (index - 3) % 4 == 0 {
            text += "\n    ";
        }
        text += &format!("{:>19}", format!("{value:.12E}"));
    }
    text + "\n"
}

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().expect("a temporary folder"));
        folder.write("a.obs", observations(8, 5));
        folder.write("b.obs", observations(8, 5));
        folder.write("later.obs", observations(15, 5));
        folder.write("good.nav", navigation(24));
        folder.write("otherday.nav", navigation(28));
        folder.write("empty", "");
        folder.write("noise", (0..5000u32).map(|i| (i * 7919 % 251) as u8).collect::<Vec<_>>());
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).expect("a file");
    }

    /// Runs `solve` with these arguments, in which `{}` stands for the folder; the exit status and
    /// what it said.
    fn solve(&self, arguments: &[&str]) -> (i32, String) {
        let folder = self.0.path().display().to_string();
        let arguments = arguments.iter().map(|a| a.replace("{}", &folder));
        let output = Command::cargo_bin("kurs")
            .expect("the program")
            .args(["solve", "--quiet", "--out"])
            .arg(self.path("out"))
            .args(arguments)
            .output()
            .expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!said.contains("panicked"), "{said}");
        (output.status.code().expect("it ends by itself"), said)
    }

    /// No file of an earlier run, whole or in part.
    fn assert_nothing_written(&self, case: &str) {
        let left: Vec<_> = fs::read_dir(self.path("out")).into_iter().flatten().collect();
        assert!(left.is_empty(), "{case}: {left:?}");
    }
}

#[test]
fn unusable_files_exit_1_and_are_named() {
    let folder = Folder::new();
    for (antenna, nav, expected) in [
        ("{}/empty", "{}/good.nav", "empty: found an empty file"),
        ("{}/noise", "{}/good.nav", "noise: found"),
        ("{}/good.nav", "{}/good.nav", "found a RINEX navigation file"),
        ("{}/missing.obs", "{}/good.nav", "missing.obs: No such file"),
        ("{}", "{}/good.nav", "is a directory"),
        ("{}/a.obs", "{}/a.obs", "found a RINEX observation file"),
        ("{}/a.obs", "{}/empty", "empty: found an empty file"),
        ("{}/a.obs", "{}/missing.nav", "missing.nav: No such file"),
    ] {
        let antenna_a = format!("A={antenna}");
        let (status, said) =
            folder.solve(&["--antenna", &antenna_a, "--antenna", "B={}/b.obs", "--nav", nav]);
        assert_eq!(status, 1, "{antenna} {nav}: {said}");
        assert!(said.contains(expected), "{antenna} {nav}: {said}");
        assert!(said.matches("No such file").count() <= 1, "said once: {said}");
        folder.assert_nothing_written(antenna);
    }
}

/// Where no epoch can be read, the reason is more than that there is none.
#[test]
fn damage_that_leaves_no_epoch_is_named() {
    let folder = Folder::new();
    folder.write("broken.obs", observations(8, 1).replace("> 2024 06 24", "> 2024 99 24"));
    let both = ["--antenna", "A={}/broken.obs", "--antenna", "B={}/broken.obs"];
    let (status, said) = folder.solve(&[&both[..], &["--nav", "{}/good.nav"]].concat());
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("no epoch in any observation file"), "{said}");
    assert!(said.contains("broken.obs:5: not an epoch line"), "{said}");
}

/// Antennas that lie where no body reaches would make a search without bounds.
#[test]
fn antennas_as_far_apart_as_planets_are_refused() {
    let folder = Folder::new();
    let both = ["--antenna", "A={}/a.obs@0,0,0", "--antenna", "B={}/b.obs@9e9,0,0"];
    let (status, said) = folder.solve(&[&both[..], &["--nav", "{}/good.nav"]].concat());
    assert_eq!(status, 2, "{said}");
    assert!(said.contains("`A` and `B` are 9000000000 m apart"), "{said}");
}

#[test]
fn data_that_do_not_belong_together_exit_1_with_rows_that_say_so() {
    let folder = Folder::new();
    for (antenna, nav, expected, reason) in [
        ("{}/later.obs", "{}/good.nav", "do not overlap", "few_antennas"),
        ("{}/b.obs", "{}/otherday.nav", "of the same day?", "no_ephemeris"),
        ("{}/b.obs", "{}/good.nav", "few_satellites", "few_satellites"),
    ] {
        let antenna_b = format!("B={antenna}");
        let (status, said) =
            folder.solve(&["--antenna", "A={}/a.obs", "--antenna", &antenna_b, "--nav", nav]);
        assert_eq!(status, 1, "{said}");
        assert!(said.contains(expected), "{said}");
        let rows = fs::read_to_string(folder.path("out/attitude.csv")).expect("rows");
        assert!(
            rows.lines().skip(1).all(|row| row.contains(&format!(",lost,{reason},"))),
            "{rows}"
        );
    }
}

#[test]
fn an_antenna_without_any_epoch_is_not_capable() {
    let folder = Folder::new();
    folder.write("none.obs", observations(8, 0));
    let (status, said) = folder.solve(&[
        "--antenna",
        "A={}/a.obs",
        "--antenna",
        "B={}/none.obs",
        "--nav",
        "{}/good.nav",
    ]);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("only one antenna has observations"), "{said}");
    let rows = fs::read_to_string(folder.path("out/attitude.csv")).expect("rows");
    assert_eq!(rows.matches(",not_capable,few_antennas,").count(), 5, "{rows}");
}

/// An antenna that is there, and of which no epoch can be read.
#[test]
fn an_antenna_of_unread_epochs_says_why() {
    let folder = Folder::new();
    folder.write("broken.obs", observations(8, 5).replace("> 2024 06 24", "> 2024 99 24"));
    let (status, said) = folder.solve(&[
        "--antenna",
        "A={}/a.obs",
        "--antenna",
        "B={}/broken.obs",
        "--nav",
        "{}/good.nav",
    ]);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("B has no epoch\nB: 1 damaged places, first: "), "{said}");
    assert!(said.contains("broken.obs:5: not an epoch line"), "{said}");
}

/// Records that are there and of no use are told: what is damaged, and what kinds they are.
#[test]
fn navigation_data_that_cannot_be_used_say_why() {
    let folder = Folder::new();
    folder.write("broken.nav", navigation(24).replace("G05 2024", "G05 20x4"));
    let record = navigation(24).split_once("END OF HEADER\n").unwrap().1.to_owned();
    let header = navigation(24).replace(&record, "").replace("     3.05 ", "     4.00 ");
    folder.write("other.nav", format!("{header}> EPH G05 CNAV\n{record}"));
    let both = ["--antenna", "A={}/a.obs", "--antenna", "B={}/b.obs", "--nav"];
    let (status, said) = folder.solve(&[&both[..], &["{}/broken.nav"]].concat());
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("no usable ephemeris in "), "{said}");
    assert!(said.contains("\n1 damaged places, first: "), "{said}");
    assert!(said.contains("broken.nav:3: "), "{said}");
    let (status, said) = folder.solve(&[&both[..], &["{}/other.nav"]].concat());
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("\nrecords of kinds that are not used: G CNAV 1\n"), "{said}");
}

/// A part of the session in which nothing is: the option is named, and what the files have.
#[test]
fn a_window_beside_the_files_is_named() {
    let folder = Folder::new();
    let both = ["--antenna", "A={}/a.obs", "--antenna", "B={}/later.obs", "--nav", "{}/good.nav"];
    let spans = "A from 2024-06-24T08:00:00.000 to 2024-06-24T08:00:04.000, \
                 B from 2024-06-24T15:00:00.000 to 2024-06-24T15:00:04.000";
    for (options, told) in [
        (["--from", "2030-01-01T00:00:00"], "--from 2030-01-01T00:00:00.000"),
        (["--every", "1e9"], "--every 1000000000"),
    ] {
        let (status, said) = folder.solve(&[&both[..], &options].concat());
        assert_eq!(status, 1, "{said}");
        let expected = format!("{told} leaves no epoch of the observation files: {spans}");
        assert!(said.contains(&expected), "{said}");
        folder.assert_nothing_written(told);
    }
    let (status, said) = folder.solve(&[&both[..], &["--from", "2024-06-24T09:00:00"]].concat());
    assert_eq!(status, 1, "{said}");
    let expected = format!(
        "A has no epoch, B from 2024-06-24T15:00:00.000 to 2024-06-24T15:00:04.000; \
                            without --from 2024-06-24T09:00:00.000: {spans}"
    );
    assert!(said.contains(&expected), "{said}");
}

/// The copy of a pipe has a name that nobody knows and a place that is gone.
#[test]
fn pipes_are_called_what_the_user_calls_them() {
    let folder = Folder::new();
    let whole = observations(8, 5);
    let mut kurs = Command::cargo_bin("kurs").expect("the program");
    kurs.args(["solve", "-"]).arg(folder.path("b.obs")).arg("--nav").arg(folder.path("good.nav"));
    kurs.arg("--out").arg(folder.path("out")).write_stdin(&whole[..whole.len() - 20]);
    let output = kurs.output().expect("it runs");
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(said.contains("1 damaged places, first: standard input:14: "), "{said}");
    let summary = fs::read_to_string(folder.path("out/summary.json")).expect("a summary");
    assert!(summary.contains("\"file\": \"standard input\""), "{summary}");
    let mut kurs = Command::cargo_bin("kurs").expect("the program");
    let output = kurs.args(["inspect", "/dev/null", "--json"]).output().expect("it runs");
    let said = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    assert!(said.contains("/dev/null: found an empty file"), "{said}");
    assert!(said.contains("\"file\": \"/dev/null\""), "{said}");
}

#[test]
fn wrong_configuration_exits_2_and_names_the_key() {
    let folder = Folder::new();
    let good =
        ["--antenna", "A={}/a.obs@0,0,0", "--antenna", "B={}/b.obs@1,0,0", "--nav", "{}/good.nav"];
    for (more, expected) in [
        (
            ["--set", "elevation_mask=5"],
            "unknown key `elevation_mask`, did you mean `elevation_mask_deg`?",
        ),
        (["--set", "elevation_mask_deg=high"], "--set elevation_mask_deg=high"),
        (["--set", "elevation_mask_deg=95"], "elevation_mask_deg is 95"),
        (["--set", "bands=[X1]"], "\"X1\" is not a band"),
        (["--set", "bands=[]"], "`bands` is empty"),
        (["--set", "novalue"], "--set novalue: expected key=value"),
        (["--set", "constraint=sphere"], "--set constraint=sphere"),
        (["--set", "ambiguity=sometimes"], "--set ambiguity=sometimes"),
        (["--set", "direction=backward"], "--set direction=backward"),
        (["--antenna", "A={}/b.obs@2,0,0"], "name `A`"),
        (["--antenna", "C={}/b.obs"], "`position_m` is missing for C"),
        (["--antenna", "C={}/b.obs@1,0,0"], "`B` and `C` are 0.0000 m apart"),
        (["--antenna", "C"], "expected NAME=OBS"),
    ] {
        let (status, said) = folder.solve(&[&good[..], &more[..]].concat());
        assert_eq!(status, 2, "{more:?}: {said}");
        assert!(said.contains(expected), "{more:?}: {said}");
        folder.assert_nothing_written(expected);
    }
    let both = ["--set", "direction=both", "--set", "nav.as_received=true"];
    let (status, said) = folder.solve(&[&good[..], &both[..]].concat());
    assert_eq!(
        (status, said.contains("a backward run knows what came later")),
        (2, true),
        "{said}"
    );
    let (status, said) = folder.solve(&["--antenna", "A={}/a.obs", "--nav", "{}/good.nav"]);
    assert_eq!((status, said.contains("at least two antennas are needed")), (2, true), "{said}");
    let (status, said) = folder.solve(&[]);
    assert_eq!((status, said.contains("configuration file")), (2, true), "{said}");
}

#[test]
fn a_configuration_file_names_its_lines() {
    let folder = Folder::new();
    let antennas = "[[antenna]]\nname = \"A\"\nobs = [\"a.obs\"]\n[[antenna]]\nname = \"B\"\nobs = [\"b.obs\"]\n";
    for (more, expected) in [
        (
            "[nav]\nfile = [\"good.nav\"]\n",
            "kurs.toml:8: unknown key `file`, did you mean `files`?",
        ),
        ("[nav]\nfiles = \"good.nav\"\n", "kurs.toml:8: invalid type"),
        ("[solve\n", "kurs.toml:7:"),
        (
            "position_m = [-6,0, -2,0, 0,1]\n",
            "kurs.toml:7: `antenna.position_m` has 6 values, which is too many",
        ),
        (
            "[[point]]\nname = \"P\"\nposition_m = [1e9, 0, 0]\n",
            "point `P`: `position_m` is [1000000000, 0, 0], expected metres on the body",
        ),
        (
            "[[point]]\nname = \"P\"\nposition_m = [nan, 0, 0]\n",
            "point `P`: `position_m` is [NaN, 0, 0], expected metres on the body",
        ),
        ("", "no navigation file"),
    ] {
        folder.write("kurs.toml", format!("{antennas}{more}"));
        let (status, said) = folder.solve(&["{}/kurs.toml"]);
        assert_eq!(status, 2, "{said}");
        assert!(said.contains(expected), "{expected}: {said}");
    }
    let (status, said) = folder.solve(&["{}/absent.toml"]);
    assert_eq!((status, said.contains("absent.toml: cannot be read")), (2, true), "{said}");
}

/// A file that ends in the middle of an epoch: what stands before it is solved, and the cut listed.
#[test]
fn a_cut_file_keeps_what_came_before() {
    let folder = Folder::new();
    let whole = observations(8, 5);
    folder.write("cut.obs", &whole[..whole.len() - 20]);
    folder.solve(&["--antenna", "A={}/a.obs", "--antenna", "B={}/cut.obs", "--nav", "{}/good.nav"]);
    let summary = fs::read_to_string(folder.path("out/summary.json")).expect("a summary");
    let summary: serde_json::Value = serde_json::from_str(&summary).expect("JSON");
    assert_eq!(summary["epochs"], 5);
    let damage = summary["damage"].as_array().expect("a list");
    assert!(
        damage
            .iter()
            .any(|d| d["file"].as_str().is_some_and(|f| Path::new(f).ends_with("cut.obs"))),
        "{damage:?}"
    );
}

/// A receiver that does not know the date when it is switched on: its first epochs make no session
/// of years.
#[test]
fn epochs_of_a_wrong_date_are_damage_and_no_gap() {
    let folder = Folder::new();
    let right = observations(8, 20);
    let (header, epochs) = right.split_at(right.find('>').expect("an epoch"));
    let wrong = observations(8, 2).replace("> 2024 06", "> 2021 03");
    let wrong = &wrong[wrong.find('>').expect("an epoch")..];
    folder.write("misdated.obs", format!("{header}{wrong}{epochs}"));
    folder.write("long.obs", &right);
    let mut kurs = Command::cargo_bin("kurs").expect("the program");
    kurs.arg("solve").args(["misdated.obs", "long.obs"].map(|name| folder.path(name)));
    kurs.arg("--nav").arg(folder.path("good.nav")).arg("--out").arg(folder.path("out"));
    let output = kurs.output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("fixed of the session: 0.00 % of 22 epochs\n"), "{said}");
    assert!(!said.contains("gaps"), "{said}");
    let expected = "misdated.obs:1: 2 epochs from 2021-03-24T08:00:00.000 to 2021-03-24T08:00:01.000, \
                    far from all others: a wrong date?";
    assert!(said.contains(expected), "{said}");
}

/// `kurs … | head`: a reader that goes away is no fault and no panic.
#[test]
fn a_closed_pipe_ends_the_program_quietly() {
    let out = TempDir::new().unwrap();
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin!("kurs"))
        .args(["demo", "--out"])
        .arg(out.path())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(!stderr.contains("panicked"), "{stderr}");
    assert_eq!(output.status.code(), None, "ended by the signal: {stderr}");
}

/// A fast receiver that is switched on while a slow one runs, and an epoch that is dated a minute
/// too early: neither an unusual interval nor an epoch that is dropped ends the session.
#[test]
fn every_epoch_has_its_row_whatever_comes_before() {
    let folder = Folder::new();
    let slow = observations(8, 20);
    let (header, _) = slow.split_once("> ").unwrap();
    let mut fast = header.to_owned();
    for tenths in 56..=190 {
        fast += &format!("> 2024 06 24 08 00 {:>2}.{}000000  0  1\n", tenths / 10, tenths % 10);
        fast += "G05  22000000.000   115600000.000  \n";
    }
    folder.write("slow.obs", &slow);
    folder.write("fast.obs", fast);
    folder.write("early.obs", slow.replacen("08 00 00.0", "07 59 01.0", 1));
    let rows = |antennas: &[&str]| {
        let files = antennas.iter().map(|name| format!("{{}}/{name}"));
        let arguments: Vec<String> = files.chain(["--nav".into(), "{}/good.nav".into()]).collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let _ = folder.solve(&arguments);
        fs::read_to_string(folder.path("out/attitude.csv")).unwrap().lines().count() - 1
    };
    assert_eq!(rows(&["slow.obs", "fast.obs"]), 20 + 121);
    assert_eq!(rows(&["fast.obs", "slow.obs", "slow.obs"]), 20 + 121);
    assert_eq!(rows(&["early.obs", "b.obs"]), 1 + 20);
}
