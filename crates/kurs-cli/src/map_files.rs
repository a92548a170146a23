//! A way over the Earth for maps: GeoJSON and KML.

use std::io::Write as _;
use std::path::Path;

use kurs::frames::Geodetic;
use serde_json::json;

use crate::output::OutputFile;

/// What heights mean on a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Heights {
    /// The way of something that flies.
    Absolute,
    /// The way of something on land or water.
    OnGround,
}

/// A way in pieces between gaps.
#[derive(Debug, Default)]
pub(crate) struct Way {
    pieces: Vec<Vec<Geodetic>>,
    has_gap: bool,
}

impl Way {
    /// The next place.
    pub(crate) fn push(&mut self, place: Geodetic) {
        match self.pieces.last_mut() {
            Some(piece) if !self.has_gap => piece.push(place),
            _ => self.pieces.push(vec![place]),
        }
        self.has_gap = false;
    }

    /// Nothing is known until the next place.
    pub(crate) fn gap(&mut self) {
        self.has_gap = true;
    }

    /// Writes `stem.kml` and `stem.geojson`; neither of a way without any place.
    pub(crate) fn write(
        &self,
        directory: &Path,
        stem: &str,
        heights: Heights,
    ) -> anyhow::Result<()> {
        if self.pieces.is_empty() {
            return Ok(());
        }
        self.write_kml(directory, stem, heights)?;
        let mut file = OutputFile::create(directory, &format!("{stem}.geojson"))?;
        writeln!(file, "{}", self.geojson(stem))?;
        file.finish()
    }

    fn write_kml(&self, directory: &Path, stem: &str, heights: Heights) -> anyhow::Result<()> {
        let mode = match heights {
            Heights::Absolute => "absolute",
            Heights::OnGround => "clampToGround",
        };
        let mut kml = OutputFile::create(directory, &format!("{stem}.kml"))?;
        writeln!(
            kml,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\
             <Document><name>{stem}</name><Placemark><name>{stem}</name><MultiGeometry>"
        )?;
        for piece in self.lines() {
            writeln!(kml, "<LineString><altitudeMode>{mode}</altitudeMode><coordinates>")?;
            for [longitude, latitude, height] in piece {
                writeln!(kml, "{longitude:.9},{latitude:.9},{height:.3}")?;
            }
            writeln!(kml, "</coordinates></LineString>")?;
        }
        writeln!(kml, "</MultiGeometry></Placemark></Document></kml>")?;
        kml.finish()
    }

    fn geojson(&self, name: &str) -> serde_json::Value {
        let mut lines: Vec<Vec<[f64; 3]>> = self.lines().collect();
        let geometry = match lines.len() {
            1 => json!({ "type": "LineString", "coordinates": lines.remove(0) }),
            _ => json!({ "type": "MultiLineString", "coordinates": lines }),
        };
        json!({
            "type": "FeatureCollection",
            "features": [{ "type": "Feature", "properties": { "name": name }, "geometry": geometry }],
        })
    }

    /// Longitude, latitude, height of every piece; a single place stands twice, as a line.
    fn lines(&self) -> impl Iterator<Item = Vec<[f64; 3]>> {
        self.pieces.iter().flat_map(|piece| cut_at_date_line(piece)).map(|mut line| {
            if let [alone] = line[..] {
                line.push(alone);
            }
            line
        })
    }
}

/// A line that crosses the meridian of 180° ends there, and another one begins on its other side (RFC 7946,
/// section 3.1.9): maps would draw one around the world.
fn cut_at_date_line(piece: &[Geodetic]) -> Vec<Vec<[f64; 3]>> {
    let (mut lines, mut line) = (Vec::new(), Vec::<[f64; 3]>::with_capacity(piece.len()));
    for place in piece.iter().map(coordinates) {
        if let Some(last) = line.last().copied()
            && (place[0] - last[0]).abs() > 180.0
        {
            let side = 180f64.copysign(last[0]);
            // Of the way from the last place to this one; zero where both are the meridian itself.
            let (before, after) = ((side - last[0]).abs(), (place[0] + side).abs());
            let share = if before > 0.0 { before / (before + after) } else { 0.0 };
            let between = |k: usize| last[k] + share * (place[k] - last[k]);
            let at = |longitude| [longitude, rounded(between(1), 1e9), rounded(between(2), 1e4)];
            line.push(at(side));
            lines.push(std::mem::replace(&mut line, vec![at(-side)]));
        }
        line.push(place);
    }
    lines.push(line);
    lines
}

/// To a tenth of a millimetre.
fn coordinates(place: &Geodetic) -> [f64; 3] {
    [
        rounded(place.longitude_rad.to_degrees(), 1e9),
        rounded(place.latitude_rad.to_degrees(), 1e9),
        rounded(place.height_m, 1e4),
    ]
}

fn rounded(value: f64, scale: f64) -> f64 {
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_gaps_on_the_map() {
        let mut way = Way::default();
        way.gap();
        for (latitude, has_gap) in [(50.0, false), (50.1, true), (50.2, false)] {
            if has_gap {
                way.gap();
            }
            way.push(Geodetic::from_degrees(latitude, -8.5, 12.0));
        }
        let geometry = &way.geojson("track")["features"][0]["geometry"];
        assert_eq!(geometry["type"], "MultiLineString");
        let expected = json!([
            [[-8.5, 50.0, 12.0], [-8.5, 50.0, 12.0]],
            [[-8.5, 50.1, 12.0], [-8.5, 50.2, 12.0]]
        ]);
        assert_eq!(geometry["coordinates"], expected);
        let folder = tempfile::tempdir().unwrap();
        way.write(folder.path(), "track", Heights::OnGround).unwrap();
        let kml = std::fs::read_to_string(folder.path().join("track.kml")).unwrap();
        assert_eq!(kml.matches("<LineString>").count(), 2);
        assert!(kml.contains("-8.500000000,50.100000000,12.000"), "{kml}");
        Way::default().write(folder.path(), "nothing", Heights::Absolute).unwrap();
        assert!(!folder.path().join("nothing.kml").exists());
    }

    #[test]
    fn a_way_across_the_date_line_is_cut_there() {
        let mut way = Way::default();
        for (latitude, longitude) in [(10.0, 179.0), (11.0, -178.0), (11.0, -180.0), (12.0, 180.0)]
        {
            way.push(Geodetic::from_degrees(latitude, longitude, 6.0));
        }
        let geometry = &way.geojson("track")["features"][0]["geometry"];
        assert_eq!(geometry["type"], "MultiLineString");
        let at = 10.333_333_333;
        let expected = json!([
            [[179.0, 10.0, 6.0], [180.0, at, 6.0]],
            [[-180.0, at, 6.0], [-178.0, 11.0, 6.0], [-180.0, 11.0, 6.0], [-180.0, 11.0, 6.0]],
            [[180.0, 11.0, 6.0], [180.0, 12.0, 6.0]]
        ]);
        assert_eq!(geometry["coordinates"], expected);
    }
}
