//! Which links may be differenced with each other.
//!
//! A receiver's bias is common to all satellites only for one band and one tracking code. Within a
//! band every satellite is therefore used with one code at each antenna, and satellites with the
//! same codes form a group with its own receiver terms.

use std::ops::Range;

use super::link::Link;

/// Sorts `links` into groups and drops what cannot be differenced; returns the range of each group.
///
/// For each band the code that most satellites have at *all* antennas that see them comes first,
/// then the code that most of the remaining ones have, and so on. Satellites for which the antennas
/// track different codes (one receiver L2C, the other L2P) follow, grouped by the combination.
pub fn group(links: &mut Vec<Link>) -> Vec<Range<usize>> {
    let sorted = sorted(links);
    let mut grouped: Vec<Link> = Vec::with_capacity(links.len());
    let mut ranges = Vec::new();
    let mut satellites: Vec<OfSatellite> = Vec::new();
    for band in sorted.chunk_by(|a, b| a.signal.band == b.signal.band) {
        let of_satellites = band.chunk_by(|a, b| a.satellite == b.satellite);
        satellites.extend(of_satellites.map(OfSatellite::new).filter(|s| s.antennas >= 2));
        while let Some(first) = satellites.first() {
            let start = grouped.len();
            if let Some(code) = most_common_code(&satellites) {
                satellites.retain(|of_satellite| {
                    let is_common = of_satellite.common & bit(code) != 0;
                    if is_common {
                        let with_code = of_satellite.links.iter().copied();
                        grouped.extend(with_code.filter(|l| l.signal.attribute == code));
                    }
                    !is_common
                });
            } else {
                let codes = preferred_codes(first.links);
                satellites.retain(|of_satellite| {
                    let is_same = preferred_codes(of_satellite.links) == codes;
                    if is_same {
                        grouped.extend(preferred(of_satellite.links));
                    }
                    !is_same
                });
            }
            ranges.push(start..grouped.len());
        }
    }
    *links = grouped;
    ranges
}

/// The links by band, satellite, antenna and preference, the first one of each signal.
fn sorted(links: &[Link]) -> Vec<&Link> {
    // One number sorts faster than five fields.
    let key = |index: usize, link: &Link| {
        let Link { signal, satellite, antenna, .. } = *link;
        let band = u64::from(signal.band.ordinal()) << 16 | u64::from(satellite.ordinal());
        let code = u64::from(preference(signal.attribute)) << 8 | u64::from(signal.attribute);
        u128::from(band << 32 | antenna as u64) << 64 | u128::from(code << 32 | index as u64)
    };
    let mut keys: Vec<(u128, &Link)> =
        links.iter().enumerate().map(|(index, link)| (key(index, link), link)).collect();
    keys.sort_unstable_by_key(|(key, _)| *key);
    let mut sorted: Vec<&Link> = keys.iter().map(|(_, link)| *link).collect();
    sorted.dedup_by_key(|link| (link.signal, link.satellite, link.antenna));
    sorted
}

/// The links of one satellite on one band, by antenna and preference.
struct OfSatellite<'a> {
    links: &'a [&'a Link],
    antennas: usize,
    /// The codes that every antenna that sees the satellite tracks, each a [`bit`].
    common: u32,
}

impl<'a> OfSatellite<'a> {
    fn new(links: &'a [&'a Link]) -> Self {
        let (mut antennas, mut common) = (0, u32::MAX);
        for of_antenna in links.chunk_by(|a, b| a.antenna == b.antenna) {
            antennas += 1;
            common &= of_antenna.iter().fold(0, |codes, l| codes | bit(l.signal.attribute));
        }
        Self { links, antennas, common }
    }
}

/// Order of preference among tracking codes of one band: civil data and pilot components before
/// combined ones before the codes that a civil receiver tracks without their key.
fn preference(attribute: u8) -> u8 {
    const ORDER: &[u8] = b"CQLIXDPSZBAWYMN";
    (0..).zip(ORDER).find(|(_, code)| **code == attribute).map_or(u8::MAX, |(place, _)| place)
}

/// The place of a code, a capital letter, in a set of codes.
fn bit(code: u8) -> u32 {
    if code.is_ascii_uppercase() { 1 << (code - b'A') } else { 0 }
}

/// The code that is common for most of the satellites; among equals the preferred one.
fn most_common_code(satellites: &[OfSatellite]) -> Option<u8> {
    let any = satellites.iter().fold(0, |codes, s| codes | s.common);
    let codes = (b'A'..=b'Z').filter(|code| any & bit(*code) != 0).map(|code| {
        let count = satellites.iter().filter(|s| s.common & bit(code) != 0).count();
        (count, core::cmp::Reverse(preference(code)), code)
    });
    codes.max().map(|(_, _, code)| code)
}

/// The preferred link of each antenna (they are sorted by preference).
fn preferred<'a>(of_satellite: &'a [&Link]) -> impl Iterator<Item = &'a Link> {
    of_satellite.chunk_by(|a, b| a.antenna == b.antenna).map(|of_antenna| of_antenna[0])
}

fn preferred_codes(of_satellite: &[&Link]) -> Vec<(usize, u8)> {
    preferred(of_satellite).map(|link| (link.antenna, link.signal.attribute)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{Satellite, Signal, System};
    use crate::sky::{SkyDirection, Variances};
    use nalgebra::Vector3;

    fn link(antenna: usize, number: u8, digit: u8, attribute: u8) -> Link {
        Link {
            antenna,
            satellite: Satellite::new(System::Gps, number),
            signal: Signal::new(System::Gps, digit, attribute),
            code_m: Some(0.0),
            phase_m: Some(0.0),
            whole_cycles: 0.0,
            common_sd_cycles: 0.0,
            wavelength_m: 0.19,
            variances: Variances { code_m2: 1.0, phase_m2: 1e-4 },
            cn0_dbhz: None,
            missing_db: 0.0,
            bands: 1,
            gradient: Vector3::zeros(),
            direction: SkyDirection::from_angles(0.0, 1.0),
        }
    }

    fn codes(links: &[Link]) -> Vec<(u8, usize, char)> {
        links
            .iter()
            .map(|l| (l.satellite.number, l.antenna, char::from(l.signal.attribute)))
            .collect()
    }

    #[test]
    fn the_code_of_most_satellites_wins() {
        let mut links = Vec::new();
        for antenna in [0, 1] {
            for number in 1..=4 {
                links.push(link(antenna, number, 2, b'W'));
                if number <= 2 {
                    links.push(link(antenna, number, 2, b'L'));
                }
            }
        }
        let ranges = group(&mut links);
        assert_eq!(ranges, vec![0..8]);
        assert!(links.iter().all(|l| l.signal.attribute == b'W'));
    }

    /// Two codes of as many satellites: the pilot's, not the one that a civil receiver tracks without its key.
    #[test]
    fn the_preferred_code_wins_among_equals() {
        let both = |antenna| [link(antenna, 1, 2, b'W'), link(antenna, 1, 2, b'L')];
        let mut links = [both(0), both(1)].concat();
        group(&mut links);
        assert_eq!(codes(&links), [(1, 0, 'L'), (1, 1, 'L')]);
    }

    #[test]
    fn mixed_receivers_get_a_group_of_their_pair_of_codes() {
        let mut links = vec![
            link(0, 1, 2, b'L'),
            link(1, 1, 2, b'W'),
            link(0, 2, 2, b'L'),
            link(1, 2, 2, b'W'),
            link(0, 3, 2, b'W'),
            link(1, 3, 2, b'W'),
        ];
        let ranges = group(&mut links);
        assert_eq!(ranges, vec![0..2, 2..6]);
        assert_eq!(
            codes(&links),
            [(3, 0, 'W'), (3, 1, 'W'), (1, 0, 'L'), (1, 1, 'W'), (2, 0, 'L'), (2, 1, 'W')]
        );
    }

    #[test]
    fn bands_never_mix_and_lonely_links_go() {
        let mut links = vec![
            link(0, 1, 1, b'C'),
            link(1, 1, 1, b'C'),
            link(0, 1, 2, b'L'),
            link(0, 2, 1, b'C'),
        ];
        let ranges = group(&mut links);
        assert_eq!(ranges, vec![0..2]);
        assert_eq!(codes(&links), [(1, 0, 'C'), (1, 1, 'C')]);
    }
}
