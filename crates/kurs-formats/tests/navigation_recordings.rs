//! Navigation files of real receivers; skipped, visibly, where the recordings are absent.

use std::path::PathBuf;

use kurs::ephemeris::NavigationData;
use kurs::signal::System;
use kurs_formats::navigation::{self, ReadSummary};
use kurs_formats::source::Source;

/// A file below the folder of recordings, if it is there.
fn recording(name: &str) -> Option<PathBuf> {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let folder = std::env::var_os("KURS_DATA").map_or_else(|| PathBuf::from(root), PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        eprintln!("skipped: no {}", path.display());
    }
    path.exists().then_some(path)
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
