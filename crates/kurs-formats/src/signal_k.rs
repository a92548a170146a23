//! A row as a delta of Signal K: one line of JSON.
//!
//! Source: Signal K specification 1.8.2. Angles are in rad, with the signs of Kurs (heading
//! clockwise from true north, bow up, to starboard); yaw is the heading from −π to π. What is not
//! known is `null`.

use kurs::solution::{AttitudeEstimate, EpochSolution};
use kurs::turn_rate::{AngleRates, course_rad};

use crate::json::number;

/// The delta of a row whose angles change with these rates, for the vessel itself.
#[must_use]
pub fn delta(row: &EpochSolution, rates: &AngleRates) -> Vec<u8> {
    use core::f64::consts::{PI, TAU};
    let attitude = row.attitude().filter(|_| row.is_fixed());
    let [heading, pitch, roll] = attitude.map(AttitudeEstimate::angles_rad).unwrap_or_default();
    let yaw = heading.map(|heading| if heading > PI { heading - TAU } else { heading });
    let turn = rates[0].filter(|_| attitude.is_some()).map(|rate| rate.radps);
    let position = row.position.as_ref();
    let speed = position.and_then(|p| p.velocity_mps).map(|v| v.xyz().xy().norm());
    let place = position.map_or_else(
        || "null".to_owned(),
        |p| {
            let geodetic = &p.geodetic;
            format!(
                "{{\"latitude\":{},\"longitude\":{},\"altitude\":{}}}",
                number(Some(geodetic.latitude_rad.to_degrees()), 9),
                number(Some(geodetic.longitude_rad.to_degrees()), 9),
                number(Some(geodetic.height_m), 4),
            )
        },
    );
    let angles = match (roll, pitch, yaw) {
        (None, None, None) => "null".to_owned(),
        _ => format!(
            "{{\"roll\":{},\"pitch\":{},\"yaw\":{}}}",
            number(roll, 6),
            number(pitch, 6),
            number(yaw, 6)
        ),
    };
    let values = [
        ("navigation.headingTrue", number(heading, 6)),
        ("navigation.attitude", angles),
        ("navigation.rateOfTurn", number(turn, 6)),
        ("navigation.position", place),
        ("navigation.speedOverGround", number(speed, 3)),
        ("navigation.courseOverGroundTrue", number(position.and_then(course_rad), 5)),
    ]
    .map(|(path, value)| format!("{{\"path\":\"{path}\",\"value\":{value}}}"))
    .join(",");
    let time = row.time.utc().iso(3);
    format!(
        "{{\"context\":\"vessels.self\",\"updates\":[{{\"source\":{{\"label\":\"kurs\",\"type\":\"GNSS\"}},\
         \"timestamp\":\"{time}Z\",\"values\":[{values}]}}]}}\r\n"
    )
    .into_bytes()
}
