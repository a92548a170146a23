//! Mean sea level: the height of the geoid above the WGS 84 ellipsoid, by the model EGM96.
//!
//! `data/egm96.gz` holds it every 20 minutes of arc in units of 25 cm, within half a metre of the
//! model's own 5 minutes everywhere; the model itself is good to a metre or so. EGM96 is a work of
//! the government of the United States (NIMA, NASA Goddard, Ohio State University, 1996) in the
//! public domain. `tests-referees/geoid_grid.py` makes the file and compares it with another one.

use std::io::Read as _;
use std::sync::LazyLock;

use kurs::frames::Geodetic;

/// From the south pole to the north pole.
const ROWS: usize = 541;
/// From 180° west eastwards.
const COLUMNS: usize = 1080;
const NODES_PER_DEGREE: f64 = 3.0;
const UNIT_M: f64 = 0.25;

static PACKED: &[u8] = include_bytes!("../data/egm96.gz");

/// Row after row, in [`UNIT_M`].
static NODES: LazyLock<Vec<i16>> = LazyLock::new(unpacked);

/// Height of the geoid above the ellipsoid, m: the height above the ellipsoid less this is that
/// above mean sea level.
///
/// Cubic convolution of 16 nodes (Keys 1981).
#[must_use]
pub fn geoid_height_m(place: &Geodetic) -> f64 {
    let longitude_deg = (place.longitude_rad.to_degrees() + 180.0).rem_euclid(360.0);
    let (row, up) = split((place.latitude_rad.to_degrees() + 90.0) * NODES_PER_DEGREE);
    let (column, right) = split(longitude_deg * NODES_PER_DEGREE);
    let (by_row, by_column) = (weights(up), weights(right));
    (0..4)
        .flat_map(|i| (0..4).map(move |j| (i, j)))
        .map(|(i, j)| by_row[i] * by_column[j] * node(row + i as i64 - 1, column + j as i64 - 1))
        .sum()
}

/// Whole and broken part of a place among the nodes.
fn split(place: f64) -> (i64, f64) {
    let whole = place.floor();
    #[allow(clippy::cast_possible_truncation)] // at most 1080 nodes
    let index = whole as i64;
    (index, place - whole)
}

/// Height at a node, m; beyond a pole the meridian goes on at the other side of it.
fn node(row: i64, column: i64) -> f64 {
    let last = ROWS as i64 - 1;
    let (row, turn) = match row {
        ..0 => (-row, COLUMNS as i64 / 2),
        _ if row > last => (2 * last - row, COLUMNS as i64 / 2),
        _ => (row, 0),
    };
    let column = (column + turn).rem_euclid(COLUMNS as i64);
    let index = usize::try_from(row.clamp(0, last) * COLUMNS as i64 + column).unwrap_or_default();
    f64::from(NODES[index]) * UNIT_M
}

/// Weights of the nodes at −1, 0, 1 and 2 for a place between 0 and 1.
fn weights(t: f64) -> [f64; 4] {
    [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (-2.5 + 1.5 * t),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (-0.5 + 0.5 * t),
    ]
}

/// The bytes are differences along the row, and of those up the column.
fn unpacked() -> Vec<i16> {
    let mut differences = Vec::with_capacity(ROWS * COLUMNS);
    let read = flate2::read::GzDecoder::new(PACKED).read_to_end(&mut differences);
    assert!(
        read.is_ok_and(|bytes| bytes == ROWS * COLUMNS),
        "egm96.gz is not the file of the project"
    );
    let mut nodes = Vec::with_capacity(ROWS * COLUMNS);
    let mut along = [0i16; COLUMNS];
    for row in differences.chunks(COLUMNS) {
        let mut height = 0;
        for (difference, along) in row.iter().zip(&mut along) {
            *along += i16::from(difference.cast_signed());
            height += *along;
            nodes.push(height);
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn height_m(latitude_deg: f64, longitude_deg: f64) -> f64 {
        geoid_height_m(&Geodetic::from_degrees(latitude_deg, longitude_deg, 0.0))
    }

    /// Heights of the program F477 of NIMA at its own test places, m.
    #[test]
    fn published_heights() {
        for (latitude, longitude, expected) in [
            (38.628_155, 269.779_155, -31.629),
            (-14.621_217, 305.021_114, -2.966),
            (46.874_319, 102.448_729, -43.572),
            (-23.617_446, 133.874_712, 15.868),
            (38.625_473, 359.999_5, 50.065),
            (-0.466_744, 0.002_3, 17.330),
        ] {
            let found = height_m(latitude, longitude);
            assert!((found - expected).abs() < 0.5, "{latitude} {longitude}: {found} {expected}");
        }
    }

    /// Neither the date line nor the poles are an edge.
    #[test]
    fn no_edges() {
        assert!((height_m(12.3, 180.0) - height_m(12.3, -180.0)).abs() < 1e-9);
        assert!((height_m(12.3, 179.999_999) - height_m(12.3, -179.999_999)).abs() < 1e-3);
        for pole in [-90.0, 90.0] {
            let heights = [0.0, 77.0, 181.0, -33.3].map(|longitude| height_m(pole, longitude));
            assert!(heights.iter().all(|h| (h - heights[0]).abs() < 1e-9), "{heights:?}");
            let over = height_m(pole * (1.0 - 1e-9), 45.0) - height_m(pole * (1.0 - 1e-9), -135.0);
            assert!(over.abs() < 1e-3);
        }
    }
}
