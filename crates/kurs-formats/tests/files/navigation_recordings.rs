//! Navigation files of real receivers and precise orbits; skipped, visibly, where the recordings
//! are absent.

use std::collections::BTreeMap;
use std::path::PathBuf;

use kurs::ephemeris::{EphemerisStore, NavigationData, PreciseOrbits, SatelliteState};
use kurs::signal::{Satellite, System};
use kurs_formats::navigation::{self, ReadSummary};
use kurs_formats::source::Source;

/// A file below the folder of recordings, if it is there.
fn recording(name: &str) -> Option<PathBuf> {
    crate::outside::recording(name)
}

fn read(name: &str) -> Option<(NavigationData, ReadSummary)> {
    let mut data = NavigationData::default();
    let mut source = Source::open(recording(name)?).expect("readable");
    let summary = navigation::read(&mut source, &mut data).expect("navigation data");
    Some((data, summary))
}

/// Records per system as `grep -c` counts their first lines.
#[test]
fn every_record_is_read() {
    use System::{BeiDou, Galileo, Glonass, Gps, Qzss};
    let files: [(&str, &[(System, usize)]); 8] = [
        (
            "matrtklib_static/base.nav",
            &[(Gps, 13), (Galileo, 67), (BeiDou, 32), (Glonass, 19), (Qzss, 3)],
        ),
        ("upc2011/brdc0770.11n", &[(Gps, 194)]),
        ("geonet2005/07590920.05n", &[(Gps, 162)]),
        ("geonet2005/30400920.05n", &[(Gps, 164)]),
        (
            "formats/BRD400DLR_S_20230710000_01D_MN.rnx.gz",
            &[(Gps, 428), (Galileo, 5840), (BeiDou, 1061), (Glonass, 1240), (Qzss, 96)],
        ),
        (
            "formats/CORD00ARG_R_20240920000_01D_MN.rnx.gz",
            &[(Gps, 190), (Galileo, 1576), (BeiDou, 278), (Glonass, 438)],
        ),
        (
            "formats/KMS300DNK_R_20221591000_01H_MN.rnx.gz",
            &[(Gps, 30), (Galileo, 108), (BeiDou, 36), (Glonass, 24), (Qzss, 1)],
        ),
        (
            "orbits/MOJN00DNK_R_20201770000_01D_MN.rnx.gz",
            &[(Gps, 240), (Galileo, 1662), (BeiDou, 344), (Glonass, 464), (Qzss, 20)],
        ),
    ];
    for (name, expected) in files {
        let Some((data, summary)) = read(name) else { continue };
        println!("{name}: {:?}, read past {:?}", summary.records, summary.read_past);
        assert_eq!(summary.damage.total(), 0, "{name}: {:?}", summary.damage);
        assert!(!data.ephemerides.is_empty());
        for (system, count) in expected {
            assert_eq!(summary.records.get(system), Some(count), "{name} {system}");
        }
    }
}

const BROADCAST: &str = "orbits/MOJN00DNK_R_20201770000_01D_MN.rnx.gz";
const PRECISE: &str = "orbits/GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz";
const FIVE_SYSTEMS: &str = "orbits/COD0MGXFIN_20230500000_01D_05M_ORB.SP3.gz";

/// Distance of the antenna from the centre of mass towards the Earth, m: means over the satellites
/// of a system of the IGS14 values (igs14.atx). Broadcast positions are those of the antenna, SP3
/// positions those of the centre of mass.
fn antenna_offset_m(system: System) -> f64 {
    match system {
        System::Gps => 1.3,
        System::Galileo => 0.8,
        System::Glonass => 2.4,
        _ => 0.0,
    }
}

/// Broadcast minus precise position at every node, in 3D, after the antenna offset.
fn broadcast_errors_m(
    broadcast: &EphemerisStore,
    precise: &PreciseOrbits,
    system: System,
) -> Vec<f64> {
    let mut errors = Vec::new();
    for (satellite, nodes) in precise.iter().filter(|(satellite, _)| satellite.system == system) {
        for node in nodes {
            let Ok(state) = broadcast.state(satellite, node.time) else { continue };
            let outwards = state.position_m.direction() * antenna_offset_m(system);
            errors.push((state.position_m + outwards - node.position_m).norm());
        }
    }
    errors
}

fn root_mean_square(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn broadcast_orbits_against_precise_ones() {
    let (Some((broadcast, _)), Some((precise, summary))) = (read(BROADCAST), read(PRECISE)) else {
        return;
    };
    println!("{PRECISE}: {:?}", summary.records);
    for (system, limit_m, least) in
        [(System::Gps, 3.0, 1500), (System::Galileo, 3.0, 1000), (System::Glonass, 8.0, 800)]
    {
        let errors =
            broadcast_errors_m(&broadcast.ephemerides, precise.ephemerides.precise(), system);
        let rms_m = root_mean_square(&errors);
        let worst = errors.iter().copied().fold(0.0, f64::max);
        println!("{system}: {} positions, 3D RMS {rms_m:.3} m, worst {worst:.3} m", errors.len());
        assert!(errors.len() > least, "{system}: {}", errors.len());
        assert!(rms_m <= limit_m, "{system}: {rms_m} m");
    }
}

/// Velocity of every record and precise orbit against differences of position over 2 s, which are
/// themselves off by a sixth of the third derivative of the orbit: up to 2e-5 m/s.
#[test]
fn velocities_are_differences_of_position() {
    let (Some((broadcast, _)), Some((precise, _))) = (read(BROADCAST), read(FIVE_SYSTEMS)) else {
        return;
    };
    let mut worst_mps = BTreeMap::new();
    let mut note = |kind: &str, satellite: Satellite, [before, now, after]: [SatelliteState; 3]| {
        let difference_mps = (after.position_m - before.position_m) * 0.5;
        let apart_mps = (difference_mps - now.velocity_mps).norm();
        let geo = if satellite.is_beidou_geo() { " GEO" } else { "" };
        let entry = worst_mps.entry(format!("{}{geo}, {kind}", satellite.system)).or_insert(0.0);
        *entry = f64::max(*entry, apart_mps);
    };
    for record in broadcast.ephemerides.iter() {
        for age_s in [-800.0, 17.0, 850.0] {
            let time = record.reference_time() + age_s;
            let at = |offset_s| record.state(time + offset_s).expect("near the reference time");
            note("broadcast", record.satellite(), [at(-1.0), at(0.0), at(1.0)]);
        }
    }
    let orbits = precise.ephemerides.precise();
    for (satellite, nodes) in orbits.iter() {
        for node in nodes.iter().skip(20).step_by(17) {
            let at = |offset_s: f64| orbits.state(satellite, node.time + 77.0 + offset_s);
            let (Some(before), Some(now), Some(after)) = (at(-1.0), at(0.0), at(1.0)) else {
                continue;
            };
            note("precise", satellite, [before, now, after]);
        }
    }
    assert_eq!(worst_mps.len(), 6 + 5, "{worst_mps:?}");
    for (orbit, worst_mps) in worst_mps {
        println!("{orbit}: velocity within {:.4} mm/s", worst_mps * 1e3);
        assert!(worst_mps <= 1e-3, "{orbit}: {worst_mps} m/s");
    }
}

/// Interpolated minus tabulated position at the nodes that `leaves_out` names by their index, away
/// from both ends of the file, in ascending order.
fn left_out_errors_m(
    whole: &PreciseOrbits,
    system: System,
    leaves_out: impl Fn(usize) -> bool,
) -> Vec<f64> {
    const FROM_THE_ENDS: usize = 15;
    let mut errors = Vec::new();
    for (satellite, nodes) in whole.iter().filter(|(satellite, _)| satellite.system == system) {
        let mut thinned = PreciseOrbits::default();
        for (_, node) in nodes.iter().enumerate().filter(|(i, _)| !leaves_out(*i)) {
            thinned.insert(satellite, *node);
        }
        for (i, node) in nodes.iter().enumerate() {
            if leaves_out(i) && (FROM_THE_ENDS..nodes.len() - FROM_THE_ENDS).contains(&i) {
                let position_m = thinned.position_m(satellite, node.time).expect("no gap");
                errors.push((position_m - node.position_m).norm());
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    errors
}

/// Two of three nodes left out: five minutes become fifteen.
#[test]
fn precise_orbits_against_left_out_nodes() {
    let Some((data, summary)) = read(FIVE_SYSTEMS) else { return };
    println!("{FIVE_SYSTEMS}: {:?}", summary.records);
    assert_eq!((summary.records.len(), summary.damage.total()), (5, 0));
    for system in summary.records.keys() {
        let errors = left_out_errors_m(data.ephemerides.precise(), *system, |i| i % 3 != 0);
        let worst_m = errors.last().copied().unwrap_or(f64::INFINITY);
        let rms_m = root_mean_square(&errors);
        println!("{system}: {} nodes, RMS {rms_m:.4} m, worst {worst_m:.4} m", errors.len());
        assert!(worst_m <= 0.02, "{system}: {worst_m} m");
    }
}
