//! The scripts of this folder in Rust, with the same lines: `cargo run -p kurs-py --example twins NAME`.
#![allow(clippy::print_stdout)] // an example

use std::error::Error;
use std::path::{Path, PathBuf};

use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::selection::{Baselines, Criterion, Graph, select};
use kurs_cli::embedded;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

type Done = Result<(), Box<dyn Error>>;

fn main() -> Done {
    match std::env::args().nth(1).as_deref() {
        Some("first_heading") => first_heading(),
        Some("compare_constraints") => compare_constraints(),
        Some("plan_an_array") => plan_an_array(),
        Some("fuse_a_gyro") => fuse_a_gyro(),
        Some("monte_carlo") => monte_carlo(),
        other => Err(format!("{other:?}: expected the name of a script in this folder").into()),
    }
}

fn first_heading() -> Done {
    let folder = Folder::new("first-heading")?;
    kurs(&["simulate", "roof-static", "--set", "duration_s=30", "--out", folder.name()])?;
    kurs(&["solve", &folder.file("kurs.toml"), "--out", &folder.file("solved")])?;
    let rows = Rows::read(&folder.file("solved/attitude.csv"))?;
    let fixed = rows.fixed();
    let mean = |name| -> Result<f64, Box<dyn Error>> {
        let values = rows.numbers(name)?;
        Ok(fixed.iter().map(|row| values[*row]).sum::<f64>() / fixed.len() as f64)
    };
    println!("{} of {} epochs fixed", fixed.len(), rows.rows.len());
    println!("heading {:.1}, pitch {:.1} degrees", mean("heading_deg")?, mean("pitch_deg")?);
    Ok(())
}

fn compare_constraints() -> Done {
    let folder = Folder::new("compare-constraints")?;
    kurs(&["simulate", "roof-static", "--set", "duration_s=30", "--out", folder.name()])?;
    for constraint in ["none", "length", "array"] {
        let out = folder.file("solved");
        let set = format!("constraint={constraint}");
        let config = folder.file("kurs.toml");
        let keys = ["--set", "bands=[G1,E1]", "--set", "elevation_mask_deg=25", "--set", &set];
        kurs(&[&["solve", &config, "--out", &out], &keys[..]].concat())?;
        let rows = Rows::read(&folder.file("solved/attitude.csv"))?;
        println!("{constraint}: {} of {} epochs fixed", rows.fixed().len(), rows.rows.len());
    }
    Ok(())
}

fn plan_an_array() -> Done {
    let places = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let array =
        AntennaArray::new(places.iter().map(|[x, y, z]| Vector::new(*x, *y, *z)).collect())?;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let baselines = Baselines::of(&array)?;
    let chosen =
        select(&baselines, Graph::SpanningTree, Criterion::TraceOfCovariance, &mut random)?;
    println!("baselines {:?}, criterion {:.3}", chosen.pairs, chosen.value);

    let antenna = |(number, place): (usize, &[f64; 3])| {
        format!("[[antenna]]\nname = \"A{number}\"\nposition_m = {place:?}\n")
    };
    let folder = Folder::new("plan-an-array")?;
    let file = folder.file("array.toml");
    std::fs::write(&file, places.iter().enumerate().map(antenna).collect::<String>())?;
    kurs(&["plan", &file, "--at", "2024-06-24T00:00:00", "--for", "6h", "--out", folder.name()])?;
    let plan = std::fs::read_to_string(folder.file("plan.json"))?;
    let plan: serde_json::Value = serde_json::from_str(&plan)?;
    let headings = plan["epochs"].as_array().map(Vec::as_slice).unwrap_or_default().iter();
    let headings: Vec<f64> =
        headings.filter_map(|epoch| epoch["heading_sd_deg"].as_f64()).collect();
    let worst = headings.iter().fold(0.0_f64, |worst, heading| worst.max(*heading));
    println!("heading to {worst:.3} degrees or better in {} epochs", headings.len());
    Ok(())
}

fn fuse_a_gyro() -> Done {
    let scenario =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/fuse/car-with-gyro.toml");
    let folder = Folder::new("fuse-a-gyro")?;
    let scenario = scenario.display().to_string();
    let set = ["--set", "duration_s=75", "--set", "interval_s=0.2"];
    kurs(&[&["simulate", &scenario, "--out", folder.name()], &set[..]].concat())?;
    kurs(&["solve", &folder.file("kurs.toml"), "--out", &folder.file("solved")])?;
    kurs(&["fuse", &folder.file("fuse.toml"), "--out", &folder.file("fused")])?;
    for (name, place) in [("antennas", "solved"), ("with gyro", "fused")] {
        let rows = Rows::read(&folder.file(&format!("{place}/attitude.csv")))?;
        let known =
            rows.numbers("heading_deg")?.iter().filter(|heading| heading.is_finite()).count();
        println!("{name}: {known} headings");
    }
    Ok(())
}

/// The seeds are others than those of the script, the lines the same.
fn monte_carlo() -> Done {
    let folder = Folder::new("monte-carlo")?;
    let (mut squares, runs) = (Vec::new(), 10);
    for run in 1..=runs {
        let seed = format!("seed={run}");
        let set = ["--set", "duration_s=10", "--set", &seed];
        kurs(&[&["simulate", "roof-static", "--out", folder.name()], &set[..]].concat())?;
        kurs(&["solve", &folder.file("kurs.toml"), "--out", &folder.file("solved")])?;
        let rows = Rows::read(&folder.file("solved/attitude.csv"))?;
        let truth = Rows::read(&folder.file("truth.csv"))?.numbers("heading_deg")?;
        let (found, sd) = (rows.numbers("heading_deg")?, rows.numbers("heading_sd_deg")?);
        let square = |row: &usize| ((found[*row] - truth[*row]) / sd[*row]).powi(2);
        squares.extend(rows.fixed().iter().map(square));
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("{runs} runs, {} fixed epochs", squares.len());
    let is_fair = if 0.5 < mean && mean < 2.0 { "True" } else { "False" };
    println!("mean square of error over standard deviation between 0.5 and 2: {is_fair}");
    Ok(())
}

/// Runs a command without its printed lines.
fn kurs(arguments: &[&str]) -> Result<u8, embedded::Failure> {
    embedded::call(["kurs"].iter().chain(arguments).chain(&["--quiet"]))
}

/// A folder that goes when it is done with.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> std::io::Result<Self> {
        let path = std::env::temp_dir().join(format!("kurs-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path)?;
        Ok(Self(path))
    }

    fn name(&self) -> &str {
        self.0.to_str().unwrap_or_default()
    }

    fn file(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A table that a command wrote.
struct Rows {
    names: csv::StringRecord,
    rows: Vec<csv::StringRecord>,
}

impl Rows {
    fn read(path: &str) -> Result<Self, csv::Error> {
        let mut reader = csv::Reader::from_path(path)?;
        Ok(Self {
            names: reader.headers()?.clone(),
            rows: reader.records().collect::<Result<_, _>>()?,
        })
    }

    fn column(&self, name: &str) -> Result<usize, String> {
        self.names.iter().position(|other| other == name).ok_or(format!("no column {name}"))
    }

    /// NaN for an empty field.
    fn numbers(&self, name: &str) -> Result<Vec<f64>, String> {
        let column = self.column(name)?;
        Ok(self.rows.iter().map(|row| row[column].parse().unwrap_or(f64::NAN)).collect())
    }

    /// Numbers of the fixed rows.
    fn fixed(&self) -> Vec<usize> {
        let status = self.column("status").unwrap_or_default();
        (0..self.rows.len()).filter(|row| &self.rows[*row][status] == "fixed").collect()
    }
}
