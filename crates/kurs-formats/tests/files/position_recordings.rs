//! Positions by the code of each system alone, from broadcast and from precise orbits, against the
//! known places of the antennas.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::path::{Path, PathBuf};

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::observation::AntennaEpoch;
use kurs::point::{self, PointSettings};
use kurs::signal::System;
use kurs::sky::NoiseModel;
use kurs_formats::navigation;
use kurs_formats::observations::ObservationSource;
use kurs_formats::source::Source;

/// Of a receiver at a known place.
struct Recording {
    observations: &'static str,
    /// Mosaic-X5: survey of its authors (to a decimetre); ESBC: coordinates in the header.
    place_m: [f64; 3],
    /// Epochs between two that are used.
    stride: usize,
}

const MOSAIC: Recording = Recording {
    observations: "matrtklib_static/base.obs",
    place_m: [-3_817_681.096_5, 3_562_839.457_8, 3_650_159.159_3],
    stride: 10,
};
const ESBC: Recording = Recording {
    observations: "formats/ESBC00DNK_R_20201770000_01D_30S_MO.crx.gz",
    place_m: [3_582_105.291, 532_589.731_3, 5_232_754.805_4],
    stride: 20,
};
const BROADCAST: &str = "orbits/MOJN00DNK_R_20201770000_01D_MN.rnx.gz";
const PRECISE: &str = "orbits/GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz";

fn data() -> Option<PathBuf> {
    crate::outside::recording("")
}

/// Root mean square errors, horizontal and vertical, m, and the share of epochs with a position.
fn errors(
    data: &Path,
    recording: &Recording,
    navigation_files: &[&str],
    systems: &[System],
) -> [f64; 3] {
    let mut navigation = NavigationData::default();
    for file in navigation_files {
        navigation::read(&mut Source::open(data.join(file)).unwrap(), &mut navigation).unwrap();
    }
    let mut source = ObservationSource::open(data.join(recording.observations)).unwrap();
    for (number, channel) in source.glonass_channels() {
        navigation.ephemerides.insert_glonass_channel(*number, *channel);
    }
    let noise = NoiseModel {
        code_zenith_m: 0.3,
        phase_zenith_m: 0.002,
        full_cn0_dbhz: 45.0,
        channel_sd_m: 0.0,
    };
    let settings = PointSettings { elevation_mask_rad: 10f64.to_radians(), noise };
    let [x, y, z] = recording.place_m;
    let place_m: Vector<Ecef> = Vector::new(x, y, z);
    let ned_from_ecef = Geodetic::from_ecef(place_m).ned_from_ecef();

    let (mut epoch, mut tracked, mut squares) = (AntennaEpoch::default(), Vec::new(), [0.0; 2]);
    let (mut epochs, mut solved) = (0.0, 0.0);
    let mut index = 0;
    while source.next_epoch(&mut epoch).unwrap() {
        index += 1;
        if index % recording.stride != 0 {
            continue;
        }
        epochs += 1.0;
        point::track(&epoch, &navigation, |system| systems.contains(&system), &mut tracked);
        let Ok(point) = point::solve(&tracked, &navigation, epoch.time, &settings) else {
            continue;
        };
        let error = (ned_from_ecef * (point.position_m - place_m)).xyz();
        squares[0] += error.x.powi(2) + error.y.powi(2);
        squares[1] += error.z.powi(2);
        solved += 1.0;
    }
    let [horizontal_m, vertical_m] = squares.map(|sum| f64::sqrt(sum / solved));
    [horizontal_m, vertical_m, solved / epochs]
}

#[test]
fn each_system_alone() {
    use System::{BeiDou, Galileo, Glonass, Gps, Qzss};
    let Some(data) = data() else { return };
    let both = [BROADCAST, PRECISE];
    let own: &[&str] = &["matrtklib_static/base.nav"];
    let all = [Gps, Galileo, BeiDou, Glonass, Qzss];
    // Bounds for the horizontal and the vertical error, m.
    for (recording, orbits, systems, bounds) in [
        (&MOSAIC, own, &[Gps][..], [2.5, 4.0]),
        (&MOSAIC, own, &[Galileo], [2.5, 4.0]),
        (&MOSAIC, own, &[BeiDou], [2.5, 4.0]),
        (&MOSAIC, own, &[Glonass], [5.0, 8.0]),
        (&MOSAIC, own, &[Qzss, Gps], [2.5, 4.0]),
        (&MOSAIC, own, &all, [1.5, 3.0]),
        (&ESBC, &both[..1], &[Gps], [2.5, 4.0]),
        (&ESBC, &both[..1], &[Galileo], [2.5, 4.0]),
        (&ESBC, &both[..1], &[BeiDou], [4.0, 8.0]),
        (&ESBC, &both[..1], &[Glonass], [5.0, 8.0]),
        (&ESBC, &both[..1], &all, [2.0, 3.0]),
        (&ESBC, &both[1..], &[Gps], [2.5, 4.0]),
        (&ESBC, &both[1..], &[Galileo], [2.5, 4.0]),
        (&ESBC, &both[1..], &[Glonass], [8.0, 15.0]),
        (&ESBC, &both[1..], &all, [2.0, 3.0]),
        (&ESBC, &both, &all, [2.0, 3.0]),
    ] {
        let [horizontal_m, vertical_m, share] = errors(&data, recording, orbits, systems);
        let names: Vec<String> = systems.iter().map(System::to_string).collect();
        let what =
            format!("{}, {}, {}", recording.observations, orbits.join(" + "), names.join(" "));
        println!("{what}: {horizontal_m:.2} m, {vertical_m:.2} m, {:.1} %", 100.0 * share);
        assert!(horizontal_m <= bounds[0] && vertical_m <= bounds[1], "{what}");
        assert!(share > 0.95, "{what}: {share}");
    }
}
