//! The last ten minutes, thinned to what a chart can show.

use std::collections::VecDeque;

use kurs::solution::EpochSolution;
use kurs::time::{GpsTime, WEEK_S};
use serde_json::{Value, json};

/// How much is kept, s.
const SPAN_S: f64 = 600.0;
/// One point for so long, s: 1200 of them are as many as a wide screen has columns for. The script
/// of the page thins by the same rule.
const STEP_S: f64 = 0.5;

/// Seconds of GPS time.
pub(super) fn seconds(time: GpsTime) -> f64 {
    time.week() as f64 * WEEK_S + time.tow_s()
}

/// One row as a chart needs it.
#[derive(Debug, Clone, Copy)]
struct Point {
    time_s: f64,
    is_fixed: bool,
    /// Heading, pitch, roll and the standard deviation of each, degrees; only of fixed rows.
    angles_deg: [Option<(f64, f64)>; 3],
    /// Latitude and longitude, degrees.
    place_deg: Option<(f64, f64)>,
}

impl Point {
    fn of(row: &EpochSolution) -> Self {
        let attitude = row.attitude().filter(|_| row.is_fixed());
        let angle_deg = |number: usize| {
            let attitude = attitude?;
            let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
            let sd_rad = attitude.covariance_rad2[(number, number)].sqrt();
            Some((angles[number]?.to_degrees(), sd_rad.to_degrees()))
        };
        let place_deg = row.position.as_ref().map(|position| {
            let place = position.geodetic;
            (place.latitude_rad.to_degrees(), place.longitude_rad.to_degrees())
        });
        Self {
            time_s: seconds(row.time),
            is_fixed: row.is_fixed(),
            angles_deg: [0, 1, 2].map(angle_deg),
            place_deg,
        }
    }

    fn step(&self) -> f64 {
        (self.time_s / STEP_S).floor()
    }

    /// `[time, heading, sd, pitch, sd, roll, sd, latitude, longitude]`, null where there is none.
    fn values(&self) -> Value {
        let rounded = |value: f64, unit: f64| (value * unit).round() / unit;
        let mut values = vec![json!(rounded(self.time_s, 1e3))];
        for angle in self.angles_deg {
            values.push(json!(angle.map(|(angle_deg, _)| rounded(angle_deg, 1e4))));
            values.push(json!(angle.map(|(_, sd_deg)| rounded(sd_deg, 1e4))));
        }
        values.push(json!(self.place_deg.map(|(latitude_deg, _)| rounded(latitude_deg, 1e9))));
        values.push(json!(self.place_deg.map(|(_, longitude_deg)| rounded(longitude_deg, 1e9))));
        values.into()
    }
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    points: VecDeque<Point>,
}

impl History {
    /// Takes a row: the last one of its step counts, but one without heading stays, so that a gap
    /// is seen however short it is.
    pub(super) fn push(&mut self, row: &EpochSolution) {
        let point = Point::of(row);
        match self.points.back_mut() {
            Some(last) if last.step() == point.step() => {
                if last.is_fixed {
                    *last = point;
                }
            }
            _ => self.points.push_back(point),
        }
        let oldest_s = point.time_s - SPAN_S;
        while self.points.pop_front_if(|first| first.time_s < oldest_s).is_some() {}
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "span_s": SPAN_S,
            "step_s": STEP_S,
            "points": self.points.iter().map(Point::values).collect::<Vec<_>>(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::{AttitudeEstimate, Outcome, Reason};
    use nalgebra::Matrix3;

    fn row(second: f64, heading_deg: Option<f64>) -> EpochSolution {
        let time = GpsTime::from_week_tow(2300, 1000.0 + second).unwrap();
        let mut row = EpochSolution::lost(time, Reason::Slip);
        if let Some(heading_deg) = heading_deg {
            let attitude = AttitudeEstimate {
                heading_rad: Some(heading_deg.to_radians()),
                pitch_rad: None,
                roll_rad: None,
                covariance_rad2: Matrix3::identity() * 0.5_f64.to_radians().powi(2),
                installation_rad2: Matrix3::zeros(),
                ned_from_body: None,
                line_elevation_rad: None,
            };
            row.outcome = Outcome::Fixed { attitude };
        }
        row
    }

    /// 20 Hz for eleven minutes with one row lost.
    #[test]
    fn ten_minutes_stay_with_every_gap() {
        let mut history = History::default();
        for number in 0..13_200_u32 {
            let lost = number == 13_003;
            history.push(&row(f64::from(number) * 0.05, (!lost).then_some(90.0)));
        }
        assert_eq!(history.points.len(), 1201, "both ends");
        let json = history.json();
        let points = json["points"].as_array().unwrap();
        let lost: Vec<&Value> = points.iter().filter(|point| point[1].is_null()).collect();
        assert_eq!(lost.len(), 1);
        assert_eq!(
            *lost[0],
            json!([2300.0 * WEEK_S + 1650.15, null, null, null, null, null, null, null, null])
        );
        let first = points[0].as_array().unwrap();
        assert_eq!(first[1..4], [json!(90.0), json!(0.5), Value::Null]);
    }
}
