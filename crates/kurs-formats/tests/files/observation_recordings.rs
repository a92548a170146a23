//! Reads the recordings of `../shared/data` (or `KURS_DATA`): what is in each file.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::path::{Path, PathBuf};

use kurs::observation::AntennaEpoch;
use kurs_formats::rinex::observation::ObservationReader;

fn data() -> Option<PathBuf> {
    crate::outside::recording("")
}

/// All epochs of a file, which must be without damage.
fn epochs(path: &Path) -> Vec<AntennaEpoch> {
    let mut reader = ObservationReader::open(path).unwrap();
    let mut epochs = Vec::new();
    let mut epoch = AntennaEpoch::default();
    while reader.next_epoch(&mut epoch).unwrap() {
        epochs.push(epoch.clone());
    }
    assert_eq!(reader.damage(), [], "{}", path.display());
    epochs
}

/// Numbers in the columns of signals.
fn values(epochs: &[AntennaEpoch]) -> usize {
    let observations = epochs.iter().flat_map(|epoch| &epoch.observations);
    let numbers =
        observations.flat_map(|o| [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz]);
    numbers.flatten().count()
}

/// 23 satellites of five columns make 115 fields; all 23 of P1 are zero, which means missing.
#[test]
fn blank_system_letters() {
    let Some(folder) = data() else { return };
    let path = folder.join("formats/KOSG0010.95O");
    let epochs = epochs(&path);
    assert_eq!((epochs.len(), values(&epochs)), (3, 115 - 23));
    let mut reader = ObservationReader::open(path).unwrap();
    while reader.next_epoch(&mut AntennaEpoch::default()).unwrap() {}
    assert_eq!(reader.field_count(), 115);
}

/// Counted by a separate program: epoch lines, and fields that are neither blank nor zero (after
/// `crx2rnx` where the file is compact).
#[test]
fn every_epoch_and_number_is_read() {
    let Some(folder) = data() else { return };
    for (file, epoch_count, value_count) in [
        ("upc2011/UPC10770.11o", 1800, 82_091),
        ("upc2011/UPC20770.11o", 1800, 81_544),
        ("geonet2005/07590920.05o", 120, 3740),
        ("geonet2005/30400920.05o", 120, 4150),
        ("matrtklib_static/base.obs", 301, 175_391),
        ("matrtklib_static/rover.obs", 301, 180_068),
        ("formats/ACOR00ESP_R_20213550000_01D_30S_MO.rnx", 25, 9036),
        ("formats/DUTH0630.22O", 3, 392),
        ("formats/LARM0010.22O", 4, 864),
        ("formats/pdel0010.21o", 67, 10_548),
        ("formats/gps_10MSps.23O.gz", 4, 64),
        ("formats/AJAC3550.21D", 2, 576),
        ("formats/delf0010.21d", 105, 14_533),
        ("formats/zegv0010.21d", 19, 3475),
        ("formats/KMS300DNK_R_20221591000_01H_30S_MO.crx", 19, 6694),
        ("formats/GRAS00FRA_R_20223151700_15M_01S_MO.crx.gz", 900, 405_184),
        ("formats/ESBC00DNK_R_20201770000_01D_30S_MO.crx.gz", 2880, 1_657_584),
    ] {
        let epochs = epochs(&folder.join(file));
        assert_eq!((epochs.len(), values(&epochs)), (epoch_count, value_count), "{file}");
    }
}

#[test]
fn compact_files_equal_plain_ones() {
    let Some(folder) = data() else { return };
    for (compact, plain) in [
        (
            "formats/ACOR00ESP_R_20213550000_01D_30S_MO.crx",
            "formats/ACOR00ESP_R_20213550000_01D_30S_MO.rnx",
        ),
        ("formats/DUTH0630.22D", "formats/DUTH0630.22O"),
        ("formats/KOSG0010.95D", "formats/KOSG0010.95O"),
    ] {
        assert_eq!(epochs(&folder.join(compact)), epochs(&folder.join(plain)), "{compact}");
    }
}
