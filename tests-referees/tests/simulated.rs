//! Simulated observation files against every referee: the same counts and values as were simulated.
//!
//! ```text
//! cd tests-referees && cargo test --test simulated -- --nocapture
//! ```

#[path = "../../tests/outside.rs"]
mod outside;

use std::fs::{self, File};
use std::path::Path;

use kurs::ephemeris::Ephemeris;
use kurs::observation::AntennaEpoch;
use kurs_formats::rinex::{CompactWriter, ObservationFileHeader, ObservationWriter};
use kurs_referees::{Totals, convbin, crx2rnx, georinex, kurs, rinex_crate};
use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};

/// Observations are written with three decimals.
const ROUNDING: f64 = 0.5e-3;

type Referee = (&'static str, fn(&Path) -> Result<Totals, String>);

const OF_PLAIN: [Referee; 3] =
    [("rinex 0.24", rinex_crate), ("convbin", convbin), ("georinex", georinex)];
const OF_COMPACT: [Referee; 2] = [("rinex 0.24", rinex_crate), ("crx2rnx", crx2rnx)];

/// A part of a ready scenario: three systems, or four with slips and outages.
fn simulation(text: &str, signals: &[&str]) -> Simulation {
    let mut scenario: Scenario = toml::from_str(text).expect("a ready scenario");
    (scenario.duration_s, scenario.interval_s) = (60.0, 1.0);
    scenario.signals = signals.iter().map(|name| (*name).to_owned()).collect();
    Simulation::new(scenario, &Attachments::default()).expect("a ready scenario")
}

/// Writes the first antenna, plain and compact; what was simulated.
fn write(simulation: &mut Simulation, plain: &Path, compact: &Path) -> std::io::Result<Totals> {
    let records = simulation.navigation().ephemerides.iter();
    let channel = |record: &Ephemeris| match record {
        Ephemeris::Glonass(g) => Some((record.satellite().number, g.elements().channel)),
        Ephemeris::Kepler(_) => None,
    };
    let header = ObservationFileHeader {
        marker: "A0".to_owned(),
        position_m: kurs::frames::Vector::new(2_847_000.0, 2_196_000.0, 5_249_000.0),
        interval_s: 1.0,
        first: simulation.start(),
        signals: simulation.scenario().signals.iter().filter_map(|s| s.parse().ok()).collect(),
        glonass_channels: records.filter_map(channel).collect(),
    };
    let mut plain = ObservationWriter::new(File::create(plain)?, &header)?;
    let compact = CompactWriter::new(File::create(compact)?, header.first)?;
    let mut compact = ObservationWriter::new(compact, &header)?;
    let mut totals = Totals::with_digits();
    let mut epoch = SimulatedEpoch::default();
    while simulation.next_epoch(&mut epoch) {
        let observed = epoch.bodies[0].observed.antennas[0].as_ref().expect("an antenna");
        if observed.observations.is_empty() {
            continue;
        }
        plain.write(observed)?;
        compact.write(observed)?;
        add(&mut totals, observed);
    }
    plain.finish()?;
    compact.finish()?.finish()?;
    Ok(totals)
}

fn add(totals: &mut Totals, epoch: &AntennaEpoch) {
    for o in &epoch.observations {
        let numbers = [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz];
        for (quantity, number) in numbers.into_iter().enumerate() {
            totals.add(quantity, number.unwrap_or_default(), o.lock.0);
        }
    }
}

#[test]
fn simulated_files_are_read_alike_by_everyone() {
    let folder = std::env::temp_dir().join(format!("kurs-simulated-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    let mut failures = Vec::new();
    for (name, text, signals) in [
        ("car", include_str!("../../scenarios/car.toml"), &["G1C", "G2W", "E1C", "E5Q", "C2I"][..]),
        ("urban", include_str!("../../scenarios/urban.toml"), &["G1C", "R1C", "R2C", "E1C", "C2I"]),
    ] {
        let [plain, compact] = ["rnx", "crx"].map(|ending| folder.join(format!("{name}.{ending}")));
        let simulated = write(&mut simulation(text, signals), &plain, &compact).expect("files");
        let ours = kurs(&plain);
        assert_eq!((ours.counts, ours.digits), (simulated.counts, simulated.digits), "{name}");
        for quantity in 0..4 {
            let off = (ours.sums[quantity] - simulated.sums[quantity]).abs();
            assert!(off <= ROUNDING * ours.counts[quantity] as f64 + 1e-3, "{name}: {off}");
        }
        assert_eq!(ours.difference(&kurs(&compact)), None, "{name}, compact");
        let plainly = OF_PLAIN.map(|referee| (referee, &plain));
        let compactly = OF_COMPACT.map(|referee| (referee, &compact));
        for ((referee, read), path) in plainly.into_iter().chain(compactly) {
            let result = match read(path).map(|theirs| ours.difference(&theirs)) {
                Err(error) => {
                    outside::lacking(&format!("{referee}: {error}"));
                    "skipped".to_owned()
                }
                Ok(None) => "equal".to_owned(),
                Ok(Some(difference)) => {
                    failures.push(format!("{name}, {referee}: {difference}"));
                    format!("DIFFERENT: {difference}")
                }
            };
            println!(
                "{name:<8}{:<6}{referee:<12}{result}",
                path.extension().unwrap_or_default().display()
            );
        }
    }
    fs::remove_dir_all(&folder).expect("the folder");
    assert!(failures.is_empty(), "{failures:#?}");
}
