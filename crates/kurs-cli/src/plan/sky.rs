//! The satellites to plan with: from navigation files, or nominal constellations.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{anyhow, bail};
use kurs::ephemeris::NavigationData;
use kurs::frames::{Body, Ecef, Ned, Rotation, Vector};
use kurs::prediction::Sight;
use kurs::signal::{Band, Satellite, System};
use kurs::time::GpsTime;
use kurs_formats::navigation;
use kurs_formats::source::Source;
use kurs_sim::walker::Walker;

use super::config::ArrayFile;
use crate::failure::UsageError;

/// Where satellites are.
#[derive(Debug)]
pub(super) enum Sky {
    /// Circular orbits as the systems were designed.
    Nominal,
    /// Broadcast ephemerides and precise orbits.
    OfFiles(Box<NavigationData>),
}

impl Sky {
    /// Reads the navigation files; without any the nominal sky.
    pub(super) fn read(files: &[PathBuf]) -> anyhow::Result<Self> {
        if files.is_empty() {
            return Ok(Self::Nominal);
        }
        let mut data = NavigationData::default();
        for file in files {
            navigation::read(&mut Source::open(file)?, &mut data)?;
        }
        if data.ephemerides.is_empty() {
            bail!("the navigation files hold no ephemeris that can be used");
        }
        Ok(Self::OfFiles(Box::new(data)))
    }

    /// What the sky is, for the report.
    pub(super) fn description(&self) -> String {
        match self {
            Self::Nominal => "nominal constellations (Walker 24 satellites per system: GPS six \
                              planes 55°, Galileo three planes 56°, BeiDou MEO three planes 55°, \
                              GLONASS three planes 64.8°)"
                .to_owned(),
            Self::OfFiles(data) => {
                let (broadcast, precise) = (data.ephemerides.len(), data.ephemerides.precise());
                let counts = [
                    (broadcast, "broadcast ephemerides"),
                    (precise.iter().count(), "satellites with precise orbits"),
                ];
                let told = counts.iter().filter(|(count, _)| *count > 0);
                told.map(|(count, of)| format!("{count} {of}")).collect::<Vec<_>>().join(", ")
            }
        }
    }

    /// Refuses bands of which it has no satellite.
    pub(super) fn check(&self, bands: &[Band]) -> Result<(), UsageError> {
        let is_nominal = matches!(self, Self::Nominal);
        if !is_nominal || bands.iter().any(|band| nominal(band.system).is_some()) {
            return Ok(());
        }
        let bands: Vec<String> = bands.iter().map(Band::to_string).collect();
        Err(UsageError(format!(
            "plan.bands: the nominal sky has GPS, Galileo, BeiDou and GLONASS, and none of {}: give navigation \
             files with --nav",
            bands.join(", ")
        )))
    }

    /// The instant to begin with if none is given: the first reference time or node of the files.
    pub(super) fn start(&self) -> GpsTime {
        match self {
            Self::Nominal => GpsTime::default(),
            Self::OfFiles(data) => {
                let broadcast = data.ephemerides.iter().map(|ephemeris| ephemeris.reference_time());
                let nodes =
                    data.ephemerides.precise().iter().filter_map(|(_, nodes)| nodes.first());
                broadcast.chain(nodes.map(|node| node.time)).min().unwrap_or_default()
            }
        }
    }

    /// ECEF position of every satellite.
    ///
    /// The travel time of the signal is left out: it moves a satellite by 300 m, 0.001° here.
    fn positions(
        &self,
        time: GpsTime,
        systems: &BTreeSet<System>,
    ) -> Vec<(Satellite, Vector<Ecef>)> {
        match self {
            Self::Nominal => systems
                .iter()
                .filter_map(|system| Some((*system, nominal(*system)?)))
                .flat_map(|(system, walker)| {
                    let satellites = walker.at(time - GpsTime::default());
                    (first_number(system)..).zip(satellites).map(move |(number, satellite)| {
                        let position_m = Vector::from_xyz(satellite.position_m);
                        (Satellite { system, number }, position_m)
                    })
                })
                .collect(),
            Self::OfFiles(data) => {
                let broadcast = data.ephemerides.iter().map(|ephemeris| ephemeris.satellite());
                let precise = data.ephemerides.precise().iter().map(|(satellite, _)| satellite);
                let satellites: BTreeSet<Satellite> = broadcast.chain(precise).collect();
                satellites
                    .into_iter()
                    .filter(|satellite| systems.contains(&satellite.system))
                    .filter_map(|satellite| {
                        let state = data.ephemerides.state(satellite, time).ok()?;
                        Some((satellite, state.position_m))
                    })
                    .collect()
            }
        }
    }

    /// The signals that every antenna sees at `time`, with the noise that `kurs solve` expects
    /// of them, and the number of satellites.
    pub(super) fn sights(
        &self,
        time: GpsTime,
        file: &ArrayFile,
        bands: &[Band],
    ) -> (Vec<Sight>, usize) {
        let place = file.plan.place();
        let noise = file.plan.noise();
        let (receiver_m, ned_from_ecef) = (place.to_ecef(), place.ned_from_ecef());
        let systems: BTreeSet<System> = bands.iter().map(|band| band.system).collect();
        let mut sights = Vec::new();
        let mut satellites = 0;
        let body_from_ned = file.plan.attitude().ned_from_body().inverse();
        for (satellite, position_m) in self.positions(time, &systems) {
            let direction = (ned_from_ecef * (position_m - receiver_m)).direction();
            if is_hidden(&direction, &body_from_ned, file) {
                continue;
            }
            satellites += 1;
            let sin_elevation = -direction.xyz().z;
            for band in bands.iter().filter(|band| band.system == satellite.system) {
                // GLONASS channels differ by 0.5 % at most: the middle one stands for all.
                if let Some(wavelength_m) = band.wavelength_m(Some(0)) {
                    let variances = noise.variances(*band, sin_elevation, None);
                    sights.push(Sight {
                        satellite,
                        direction,
                        band: *band,
                        wavelength_m,
                        code_sd_m: variances.code_m2.sqrt(),
                        phase_sd_m: variances.phase_m2.sqrt(),
                    });
                }
            }
        }
        (sights, satellites)
    }
}

/// Whether the elevation mask or the body hides a direction.
fn is_hidden(
    direction: &Vector<Ned>,
    body_from_ned: &Rotation<Body, Ned>,
    file: &ArrayFile,
) -> bool {
    let elevation_deg = |down: f64| (-down).asin().to_degrees();
    let on_body = (*body_from_ned * *direction).xyz();
    let from_nose_deg = on_body.y.atan2(on_body.x).to_degrees();
    elevation_deg(direction.xyz().z) < file.plan.elevation_mask_deg
        || file.mask.iter().any(|mask| {
            let span_deg = mask.to_deg - mask.from_deg;
            // From 0 to 360 is all around.
            let is_turn = span_deg != 0.0 && span_deg % 360.0 == 0.0;
            let width_deg = if is_turn { 360.0 } else { span_deg.rem_euclid(360.0) };
            let inside = (from_nose_deg - mask.from_deg).rem_euclid(360.0) <= width_deg;
            inside && elevation_deg(on_body.z) < mask.elevation_deg
        })
}

/// The satellite of a nominal sky that is counted first: of BeiDou those before it stand over the equator.
fn first_number(system: System) -> u8 {
    if system == System::BeiDou { 19 } else { 1 }
}

/// The design constellation of a system; `None` where the satellites are not a Walker pattern.
///
/// Sources: IS-GPS-200 and the interface documents of Galileo (24/3/1), BeiDou (24/3/1) and GLONASS
/// (24/3/1) for planes, inclination and orbit radius.
fn nominal(system: System) -> Option<Walker> {
    let (radius_m, inclination_deg, planes, first_node_deg) = match system {
        System::Gps => (26.56e6, 55.0, 6_u16, 0.0),
        System::Galileo => (29.60e6, 56.0, 3, 25.0),
        System::BeiDou => (27.91e6, 55.0, 3, 50.0),
        System::Glonass => (25.51e6, 64.8, 3, 75.0),
        System::Qzss | System::NavIc | System::Sbas => return None,
    };
    Some(Walker {
        radius_m,
        inclination_rad: f64::to_radians(inclination_deg),
        planes,
        per_plane: 24 / planes,
        phasing: 1,
        first_node_rad: f64::to_radians(first_node_deg),
        first_latitude_argument_rad: 0.0,
    })
}

/// `24h`, `90m` or `600s`, in seconds.
pub(super) fn parse_duration_s(text: &str) -> anyhow::Result<f64> {
    let unit = text.chars().last().map_or(String::new(), String::from);
    let number = text.trim_end_matches(['h', 'm', 's']);
    let unit_s = match unit.as_str() {
        "h" => Some(3600.0),
        "m" => Some(60.0),
        "s" => Some(1.0),
        _ => None,
    };
    let duration_s = number.parse::<f64>().ok().zip(unit_s).map(|(number, unit_s)| number * unit_s);
    duration_s.filter(|duration_s| (0.0..=31.0 * 86_400.0).contains(duration_s)).ok_or_else(|| {
        anyhow!(UsageError(format!("--for {text}: expected a time such as 24h, 90m or 600s")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::ephemeris::PreciseNode;

    #[test]
    fn times_and_durations() {
        assert_eq!(parse_duration_s("24h").unwrap(), 86_400.0);
        assert_eq!(parse_duration_s("90m").unwrap(), 5400.0);
        assert_eq!(parse_duration_s("1.5s").unwrap(), 1.5);
        for wrong in ["", "h", "24", "-1h", "NaNs", "1e9h", "5 apples", "5é"] {
            assert!(parse_duration_s(wrong).is_err(), "{wrong}");
        }
    }

    /// Two dozen satellites of a system: six to twelve above 10° at middle latitudes, all day.
    #[test]
    fn the_nominal_sky_is_as_full_as_the_real_one() {
        let file: ArrayFile = crate::config_file::parse("", "test").unwrap();
        let bands = [Band::new(System::Gps, 1), Band::new(System::Galileo, 1)];
        for hour in 0..24 {
            let time = GpsTime::default() + 3600.0 * f64::from(hour);
            for band in bands {
                let (sights, satellites) = Sky::Nominal.sights(time, &file, &[band]);
                assert!((4..=13).contains(&satellites), "{band} at {hour} h: {satellites}");
                assert_eq!(sights.len(), satellites);
            }
        }
    }

    /// Precise orbits alone, an hour and three quarters of them: the plan begins with them, and sees what the sky of
    /// their nodes shows.
    #[test]
    fn precise_orbits_are_a_sky() {
        let file: ArrayFile = crate::config_file::parse("", "test").unwrap();
        let band = Band::new(System::Galileo, 1);
        let begin = GpsTime::default() + 86_400.0;
        let mut data = NavigationData::default();
        for node in 0..22 {
            let time = begin + 300.0 * f64::from(node);
            for (satellite, position_m) in
                Sky::Nominal.positions(time, &BTreeSet::from([System::Galileo]))
            {
                let node = PreciseNode {
                    time,
                    position_m,
                    clock_s: Some(0.0),
                    clock_event: false,
                    sigma_m: 0.0,
                };
                data.ephemerides.insert_precise(satellite, node);
            }
        }
        let sky = Sky::OfFiles(Box::new(data));
        assert_eq!(sky.start(), begin);
        assert_eq!(sky.description(), "24 satellites with precise orbits");
        let satellites = |sky: &Sky| sky.sights(begin + 3000.0, &file, &[band]).1;
        assert_eq!(satellites(&sky), satellites(&Sky::Nominal));
        assert!(satellites(&sky) >= 4);
    }

    #[test]
    fn the_body_hides_a_sector() {
        let text = "[plan]\nheading_deg = 90.0\n\
                    [[mask]]\nfrom_deg = 350.0\nto_deg = 10.0\nelevation_deg = 45.0\n";
        let file: ArrayFile = crate::config_file::parse(text, "test").unwrap();
        let is_hidden = |direction: &Vector<Ned>, file: &ArrayFile| {
            super::is_hidden(direction, &file.plan.attitude().ned_from_body().inverse(), file)
        };
        let towards = |azimuth_deg: f64, elevation_deg: f64| {
            let (a, e) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
            Vector::new(e.cos() * a.cos(), e.cos() * a.sin(), -e.sin())
        };
        assert!(is_hidden(&towards(90.0, 40.0), &file), "ahead, below the mask");
        assert!(!is_hidden(&towards(90.0, 50.0), &file), "ahead, above it");
        assert!(!is_hidden(&towards(105.0, 40.0), &file), "beside it");
        assert!(is_hidden(&towards(180.0, 5.0), &file), "below the elevation mask");
        for (from, to) in [("0.0", "360.0"), ("-180.0", "180.0"), ("90.0", "-270.0")] {
            let text = text.replace("350.0", from).replace("10.0", to);
            let file: ArrayFile = crate::config_file::parse(&text, "test").unwrap();
            let is_all_around =
                (0..36).all(|k| is_hidden(&towards(10.0 * f64::from(k), 40.0), &file));
            assert!(is_all_around, "from {from} to {to}");
        }
    }
}
