//! What leaves by an output: one word for everything that a kind of reader wants, and wants left
//! out.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use kurs::frames::{Body, Vector};
use kurs::solution::{EpochSolution, Reason};
use kurs_formats::nmea2000::Form;
use kurs_formats::ubx::{AntennaLine, Conversation};
use kurs_formats::{mavlink, nmea, nmea2000, ros, signal_k, ubx};

use crate::address::BAUD;
use crate::output::{Encode, Partner};

/// Kinds of readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Profile {
    /// Chart plotters and marine autopilots: NMEA 0183.
    Marine,
    /// gpsd: NMEA 0183 with PTNTHTM.
    Gpsd,
    /// Survey software: NMEA 0183 with PASHR and PTNL,AVR.
    Survey,
    /// AgOpenGPS: PAOGI.
    AgOpen,
    /// ArduPilot: KSXT.
    ArduPilot,
    /// ArduPilot: an emulated u-blox receiver.
    ArduPilotUbx,
    /// ArduPilot: GPS_INPUT of MAVLink.
    ArduPilotMavlink,
    /// PX4: an emulated u-blox receiver.
    Px4,
    /// Signal K: deltas.
    SignalK,
    /// NMEA 2000 as a gateway hears it.
    Nmea2000,
    /// NMEA 2000 as a gateway puts it on the bus.
    Nmea2000ToBus,
    /// NMEA 2000 in the text of canboat.
    Nmea2000Canboat,
    /// ROS 2: JSON for rosbridge.
    Ros2,
}

/// PX4 refuses longer vectors between antennas, m.
const PX4_MAX_LINE_M: f64 = 10.0;
/// ArduPilot refuses shorter ones, m.
const MIN_LINE_M: f64 = 0.05;

/// Every profile and its word.
const WORDS: [(Profile, &str); 13] = [
    (Profile::Marine, "marine"),
    (Profile::Gpsd, "gpsd"),
    (Profile::Survey, "survey"),
    (Profile::AgOpen, "agopen"),
    (Profile::ArduPilot, "ardupilot"),
    (Profile::ArduPilotUbx, "ardupilot:ubx"),
    (Profile::ArduPilotMavlink, "ardupilot:mavlink"),
    (Profile::Px4, "px4"),
    (Profile::SignalK, "signalk"),
    (Profile::Nmea2000, "nmea2000"),
    (Profile::Nmea2000ToBus, "nmea2000:bus"),
    (Profile::Nmea2000Canboat, "nmea2000:canboat"),
    (Profile::Ros2, "ros2"),
];

impl Profile {
    /// The words of all profiles.
    pub fn words() -> impl Iterator<Item = &'static str> {
        WORDS.iter().map(|(_, word)| *word)
    }

    /// The profile of a word.
    #[must_use]
    pub fn of_word(word: &str) -> Option<Self> {
        WORDS.iter().find(|(_, known)| *known == word).map(|(profile, _)| *profile)
    }

    /// The word in configurations.
    #[must_use]
    pub fn word(self) -> &'static str {
        WORDS.iter().find(|(known, _)| *known == self).map_or("", |(_, word)| word)
    }

    /// Whether it says the direction of a line between two antennas, and not that of the body.
    #[must_use]
    pub const fn is_receiver(self) -> bool {
        matches!(self, Self::ArduPilotUbx | Self::Px4)
    }

    /// Whether its messages say how certain angles are, so that those of float rows may leave.
    #[must_use]
    pub const fn takes_float(self) -> bool {
        matches!(self, Self::Ros2)
    }

    /// Messages a second that its readers can use; `None`: every row.
    #[must_use]
    pub const fn rate_hz(self) -> Option<f64> {
        match self {
            // ArduPilot keeps time in steps of 50 ms.
            Self::ArduPilot | Self::ArduPilotUbx | Self::ArduPilotMavlink => Some(20.0),
            // The bus is for many: 10 Hz is what autopilots want.
            Self::Nmea2000 | Self::Nmea2000ToBus | Self::Nmea2000Canboat => Some(10.0),
            _ => None,
        }
    }

    /// The vector that an emulated receiver measures: from the first antenna to the one farthest
    /// from it, seen from above, that the autopilot accepts. `None` for profiles that say the
    /// direction of the body.
    ///
    /// # Errors
    ///
    /// Why no vector of this array will do.
    pub fn line(self, positions_m: &[Vector<Body>]) -> Result<Option<AntennaLine>, String> {
        if !self.is_receiver() {
            return Ok(None);
        }
        let [first, others @ ..] = positions_m else {
            return Err("the antennas need `position_m`: the autopilot compares with them".into());
        };
        let max_m = if self == Self::Px4 { PX4_MAX_LINE_M } else { f64::INFINITY };
        let seen_from_above_m = |line: &AntennaLine| line.body_m.xyz().xy().norm();
        let lines = others
            .iter()
            .enumerate()
            .map(|(k, position)| AntennaLine { rover: k + 1, body_m: *position - *first });
        let accepted = lines
            .filter(|line| line.body_m.norm() < max_m && seen_from_above_m(line) >= MIN_LINE_M)
            .max_by(|a, b| seen_from_above_m(a).total_cmp(&seen_from_above_m(b)));
        let limits = match self {
            Self::Px4 => format!("{MIN_LINE_M} m to less than {max_m} m"),
            _ => format!("{MIN_LINE_M} m or more"),
        };
        accepted.map(Some).ok_or_else(|| {
            format!("no antenna is {limits} away from the first one, which the autopilot wants")
        })
    }

    /// The encoder. `line` is the one that an emulated receiver measures; without it such a
    /// receiver is silent.
    #[must_use]
    pub fn encode(self, line: Option<AntennaLine>, float: bool, predicted: bool) -> Encode {
        match self {
            Self::Marine => sentences(nmea::Profile::Marine),
            Self::Gpsd => sentences(nmea::Profile::Gpsd),
            Self::Survey => sentences(nmea::Profile::Survey),
            Self::AgOpen => sentences(nmea::Profile::AgOpen),
            Self::ArduPilot => sentences(nmea::Profile::ArduPilot),
            Self::ArduPilotUbx | Self::Px4 => {
                let has_two_antennas = self == Self::Px4;
                Arc::new(move |row, _, _| Some(ubx::navigation(row, &line?, has_two_antennas)))
            }
            Self::ArduPilotMavlink => {
                let count = AtomicU8::new(0);
                Arc::new(move |row, _, _| {
                    Some(mavlink::gps_input(row, count.fetch_add(1, Relaxed)))
                })
            }
            Self::SignalK => Arc::new(|row, rates, _| Some(signal_k::delta(row, rates))),
            Self::Nmea2000 => bus(Form::YdwgRaw),
            Self::Nmea2000ToBus => bus(Form::YdwgToBus),
            Self::Nmea2000Canboat => bus(Form::Canboat),
            Self::Ros2 => Arc::new(move |row, _, _| {
                let lines = ros_messages(row, float, predicted);
                Some(lines.iter().map(ros::Message::rosbridge).collect::<String>().into_bytes())
            }),
        }
    }

    /// What is said to everyone who connects over a line of this rate, and how they are answered.
    #[must_use]
    pub fn partner(self, baud: Option<u32>) -> Partner {
        Partner {
            greeting: if self == Self::Ros2 { ros::advertisement() } else { Vec::new() },
            conversation: self.is_receiver().then(|| Conversation::new(baud.unwrap_or(BAUD))),
            publisher: None,
        }
    }
}

/// The messages of a topic of ROS 2 on its own bus.
pub fn on_the_bus_of_ros(topic: ros::bus::Topic, float: bool, predicted: bool) -> Encode {
    Arc::new(move |row, _, _| {
        let messages = ros_messages(row, float, predicted);
        messages.iter().find(|message| message.topic == topic).map(ros::Message::cdr)
    })
}

fn ros_messages(row: &EpochSolution, float: bool, predicted: bool) -> Vec<ros::Message> {
    let is_predicted = row.reason() == Some(Reason::Predicted);
    ros::messages(row, if is_predicted { predicted } else { float })
}

fn sentences(profile: nmea::Profile) -> Encode {
    Arc::new(move |row, rates, _| {
        let mut text = String::new();
        nmea::encode(profile, row, *rates, &mut text);
        Some(text.into_bytes())
    })
}

fn bus(form: Form) -> Encode {
    Arc::new(move |row, rates, _| Some(nmea2000::lines(row, rates, form)))
}
