//! Runs every case of the vector files: inputs as exact doubles, results computed with 50 digits.
//!
//! `cargo test --release -p kurs --test vectors -- --nocapture`
//!
//! The folder is `KURS_VECTORS`, by default `../shared/vectors` seen from the workspace root. Every
//! `*.json` in it is read; of each, the lists under the top-level keys of [`KINDS`] are run. One
//! module here holds the checks of one kind.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

mod attitude;
mod baseline;
mod case;
mod filter;
#[path = "../../../../tests/outside.rs"]
mod outside;
mod three_point;
mod trajectory;

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use case::Outcome;
use serde_json::Value;

/// Compares one case with the code; what is missing from the case is an error.
type Check = fn(&Value, &mut Outcome) -> Result<(), String>;

/// Top-level key of the file, `kind` within it, and the code that checks it (`None`: no such code
/// in the library yet).
const KINDS: [(&str, &str, Option<Check>); 7] = [
    ("attitude", "phase", Some(attitude::phase)),
    ("attitude", "omega", Some(attitude::omega)),
    ("attitude", "phase_collinear", Some(attitude::phase_collinear)),
    ("three_point", "three_point", Some(three_point::three_point)),
    ("baseline", "baseline", Some(baseline::check)),
    ("trajectory", "trajectory", Some(trajectory::check)),
    ("filter_model", "filter_model", Some(filter::check)),
];

#[test]
fn every_case_of_every_file() {
    let Some(files) = vector_files() else { return };
    let mut failed = 0;
    for (key, kind, check) in KINDS {
        let cases: Vec<(String, &Value)> =
            files.iter().flat_map(|(file, value)| cases_of(file, value, key, kind)).collect();
        if cases.is_empty() {
            continue;
        }
        match check {
            None => println!("{kind}: not implemented"),
            Some(check) => failed += run(kind, check, &cases),
        }
    }
    for (file, value) in &files {
        failed += unknown_kinds(file, value);
    }
    assert_eq!(failed, 0, "failing vectors are listed above");
}

/// Runs the cases of one kind, prints its line and the failing cases; returns how many fail.
fn run(kind: &str, check: Check, cases: &[(String, &Value)]) -> usize {
    let mut worst: f64 = 0.0;
    let mut failures = Vec::new();
    for (name, case) in cases {
        let mut outcome = Outcome::default();
        let ran = catch_unwind(AssertUnwindSafe(|| check(case, &mut outcome)));
        match ran {
            Ok(Ok(())) => {}
            Ok(Err(message)) => outcome.failures.push(message),
            Err(_) => outcome.failures.push("panicked".to_owned()),
        }
        worst = worst.max(outcome.worst);
        if !outcome.failures.is_empty() {
            failures.push(format!("  {name}: {}", outcome.failures.join("; ")));
        }
    }
    println!("{kind}: {}/{}, worst {worst:.1e}", cases.len() - failures.len(), cases.len());
    for failure in &failures {
        println!("{failure}");
    }
    failures.len()
}

/// The cases of one kind in one file, with a name for the report.
fn cases_of<'a>(
    file: &str,
    value: &'a Value,
    key: &str,
    kind: &str,
) -> impl Iterator<Item = (String, &'a Value)> {
    let list = value[key].as_array().map_or(&[][..], Vec::as_slice);
    list.iter().enumerate().filter(move |(_, case)| kind_of(case, key) == kind).map(
        move |(index, case)| {
            let name = case["name"].as_str().or(case["id"].as_str()).unwrap_or(key);
            (format!("{file} {key}[{index}] {name}"), case)
        },
    )
}

/// The case's own kind; lists of a single kind do not repeat it.
fn kind_of<'a>(case: &'a Value, key: &'a str) -> &'a str {
    case["kind"].as_str().unwrap_or(key)
}

/// Cases under a known key whose kind nobody checks would be skipped silently: they count as
/// failures.
fn unknown_kinds(file: &str, value: &Value) -> usize {
    let mut keys: Vec<&str> = KINDS.iter().map(|(key, ..)| *key).collect();
    keys.dedup();
    let mut unknown = 0;
    for key in keys {
        for case in value[key].as_array().map_or(&[][..], Vec::as_slice) {
            let kind = kind_of(case, key);
            if !KINDS.iter().any(|(other, known, _)| *other == key && *known == kind) {
                println!("{file} {key}: unknown kind `{kind}`");
                unknown += 1;
            }
        }
    }
    unknown
}

/// Name and content of every JSON file in the folder, sorted; `None` if there is no such folder.
fn vector_files() -> Option<Vec<(String, Value)>> {
    let mut paths: Vec<PathBuf> = fs::read_dir(outside::vectors()?)
        .ok()?
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
        .collect();
    paths.sort();
    let read = |path: &PathBuf| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let text = fs::read_to_string(path).unwrap();
        let value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, value)
    };
    (!paths.is_empty()).then(|| paths.iter().map(read).collect())
}
