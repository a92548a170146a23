//! Every observation file of `../shared/data` against every referee:
//!
//! ```text
//! pip install hatanaka georinex      # and the Debian package rtklib, for convbin
//! cd tests-referees && cargo test --release --test observations -- --nocapture
//! ```

use std::path::Path;

use kurs_referees::{Totals, convbin, crx2rnx, georinex, kurs, recordings, rinex_crate};

const FILES: [&str; 21] = [
    "geonet2005/07590920.05o",
    "geonet2005/30400920.05o",
    "matrtklib_static/base.obs",
    "matrtklib_static/rover.obs",
    "upc2011/UPC10770.11o",
    "upc2011/UPC20770.11o",
    "formats/ACOR00ESP_R_20213550000_01D_30S_MO.crx",
    "formats/ACOR00ESP_R_20213550000_01D_30S_MO.rnx",
    "formats/AJAC3550.21D",
    "formats/DUTH0630.22D",
    "formats/DUTH0630.22O",
    "formats/ESBC00DNK_R_20201770000_01D_30S_MO.crx.gz",
    "formats/GRAS00FRA_R_20223151700_15M_01S_MO.crx.gz",
    "formats/KMS300DNK_R_20221591000_01H_30S_MO.crx",
    "formats/KOSG0010.95D",
    "formats/KOSG0010.95O",
    "formats/LARM0010.22O",
    "formats/delf0010.21d",
    "formats/gps_10MSps.23O.gz",
    "formats/pdel0010.21o",
    "formats/zegv0010.21d",
];

const NO_LETTERS: &str = "loses satellites whose system letter is blank";
const DROPPED_COLUMN: &str = "drops the column X1 and takes every other one for its neighbour";
const CHANNEL: &str = "writes the channel numbers X1 of BeiDou as pseudoranges C1X";
const NEEDS_RANGE: &str = "drops phases on L2 without a pseudorange P2";
const TWO_BANDS: &str = "gives the digits of bands 1 and 2 only";

/// Where a referee differs, and why. A note that is no longer true fails the test.
const EXPLAINED: [(&str, &str, &str); 13] = [
    ("rinex 0.24", "formats/KOSG0010.95D", NO_LETTERS),
    ("rinex 0.24", "formats/KOSG0010.95O", NO_LETTERS),
    ("rinex 0.24", "matrtklib_static/base.obs", DROPPED_COLUMN),
    ("rinex 0.24", "matrtklib_static/rover.obs", DROPPED_COLUMN),
    ("convbin", "matrtklib_static/base.obs", CHANNEL),
    ("convbin", "matrtklib_static/rover.obs", CHANNEL),
    ("convbin", "upc2011/UPC10770.11o", NEEDS_RANGE),
    ("convbin", "upc2011/UPC20770.11o", NEEDS_RANGE),
    ("georinex", "matrtklib_static/base.obs", TWO_BANDS),
    ("georinex", "matrtklib_static/rover.obs", TWO_BANDS),
    ("georinex", "formats/ACOR00ESP_R_20213550000_01D_30S_MO.crx", TWO_BANDS),
    ("georinex", "formats/ACOR00ESP_R_20213550000_01D_30S_MO.rnx", TWO_BANDS),
    ("georinex", "formats/KMS300DNK_R_20221591000_01H_30S_MO.crx", TWO_BANDS),
];

/// A referee, and the files that it can read at all.
type Referee = (&'static str, fn(&Path) -> Result<Totals, String>, fn(&str) -> bool);

fn is_compact(file: &str) -> bool {
    file.contains(".crx") || file.ends_with(['d', 'D'])
}

const REFEREES: [Referee; 4] = [
    ("rinex 0.24", rinex_crate, |_| true),
    ("crx2rnx", crx2rnx, is_compact),
    ("convbin", convbin, |file| !is_compact(file)),
    // It needs minutes for the long ones.
    ("georinex", georinex, |file| !file.contains("ESBC") && !file.contains("GRAS")),
];

#[test]
fn counts_sums_and_digits_are_equal() {
    let Some(folder) = recordings() else {
        println!("skipped: no recordings");
        return;
    };
    let mut failures = Vec::new();
    println!("{:<52}{:<12}result", "file", "referee");
    for file in FILES {
        let ours = kurs(&folder.join(file));
        for (name, read, _) in REFEREES.iter().filter(|(_, _, reads)| reads(file)) {
            let note = EXPLAINED.iter().find(|(referee, of, _)| referee == name && of == &file);
            let result = match (read(&folder.join(file)), note) {
                (Err(error), None) => format!("skipped: {error}"),
                (Err(error), Some((_, _, why))) => format!("not read ({error}): {why}"),
                (Ok(theirs), note) => match (ours.difference(&theirs), note) {
                    (None, None) => "equal".to_owned(),
                    (Some(difference), Some((_, _, why))) => format!("{why} ({difference})"),
                    (None, Some((_, _, why))) => {
                        failures.push(format!("{file}, {name}: no longer true: {why}"));
                        "equal".to_owned()
                    }
                    (Some(difference), None) => {
                        failures.push(format!("{file}, {name}: {difference}"));
                        format!("DIFFERENT: {difference}")
                    }
                },
            };
            println!("{file:<52}{name:<12}{result}");
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
