//! Reads the recordings of `../shared/data` (or `KURS_DATA`): counts per file.

use std::path::PathBuf;

use kurs::observation::AntennaEpoch;
use kurs_formats::rinex::observation::ObservationReader;

fn data() -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let folder = std::env::var_os("KURS_DATA").map_or_else(|| default.into(), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no recordings in {}", folder.display());
    None
}

/// Epochs, and numbers in the columns of signals.
fn counts(file: &str, folder: &std::path::Path) -> (usize, usize) {
    let mut reader = ObservationReader::open(folder.join(file)).unwrap();
    let (mut epochs, mut values) = (0, 0);
    let mut epoch = AntennaEpoch::default();
    while reader.next_epoch(&mut epoch).unwrap() {
        epochs += 1;
        for o in &epoch.observations {
            let numbers = [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz];
            values += numbers.iter().flatten().count();
        }
    }
    println!("{file}: {epochs} epochs, {values} values, damage {:?}", reader.damage());
    (epochs, values)
}

/// 23 satellites of five columns make 115 fields; all 23 of P1 are zero, which means missing.
#[test]
fn blank_system_letters() {
    let Some(folder) = data() else { return };
    assert_eq!(counts("formats/KOSG0010.95O", &folder), (3, 115 - 23));
}

#[test]
fn every_file_is_read() {
    let Some(folder) = data() else { return };
    for file in [
        "upc2011/UPC10770.11o",
        "upc2011/UPC20770.11o",
        "geonet2005/07590920.05o",
        "geonet2005/30400920.05o",
        "matrtklib_static/base.obs",
        "matrtklib_static/rover.obs",
        "formats/ACOR00ESP_R_20213550000_01D_30S_MO.rnx",
        "formats/DUTH0630.22O",
        "formats/LARM0010.22O",
        "formats/pdel0010.21o",
        "formats/gps_10MSps.23O.gz",
    ] {
        assert!(counts(file, &folder).0 > 0);
    }
}
