//! `--explain PROFILE`: what to set at the other end, for the array and outputs in force.

use std::fmt::Write as _;

use kurs::array::{AntennaArray, Shape};
use kurs::frames::{Body, Vector};
use kurs_formats::ubx::AntennaLine;
use kurs_live::{Address, Profile};

use super::setup;
use crate::failure::UsageError;
use crate::solve::config::{Loaded, OutputProfile};

/// The text for a profile; the error says why it does not suit this array.
pub(super) fn explain(word: &str, loaded: &Loaded) -> Result<String, UsageError> {
    let profile = OutputProfile::try_from(word.to_owned()).map_err(UsageError)?;
    let array = Array { positions_m: setup::positions_m(loaded), names: names(loaded) };
    let mut text = where_it_goes(profile, loaded);
    let OutputProfile::Of(profile) = profile else {
        let table = if profile == OutputProfile::Relative { "relative" } else { "attitude" };
        let _ = writeln!(text, "Nothing is to be set: the columns are those of {table}.csv.");
        return Ok(text);
    };
    let unsuitable =
        |what| UsageError(format!("profile `{word}` does not suit this array: {what}"));
    let line = profile.line(&array.positions_m).map_err(unsuitable)?;
    text.push_str(&array.what_it_sees(profile).map_err(unsuitable)?);
    text.push_str(&match (profile, line) {
        (Profile::Px4, Some(line)) => array.px4(&line),
        (Profile::ArduPilotUbx, Some(line)) => array.ardupilot_ubx(&line),
        (Profile::ArduPilot, _) => ardupilot("GPS1_TYPE = 5 (NMEA)", GPS_PORT),
        (Profile::ArduPilotMavlink, _) => ardupilot("GPS1_TYPE = 14 (MAVLink)", "2 (MAVLink 2)"),
        (profile, _) => reader(profile).to_owned(),
    });
    text.push_str(&array.where_the_position_is());
    Ok(text)
}

/// The antennas of the body.
struct Array {
    /// Empty if they are not known.
    positions_m: Vec<Vector<Body>>,
    names: Vec<String>,
}

fn names(loaded: &Loaded) -> Vec<String> {
    loaded.config.antenna.iter().map(|antenna| antenna.name.clone()).collect()
}

/// The outputs that have this profile.
fn where_it_goes(profile: OutputProfile, loaded: &Loaded) -> String {
    let mut text = String::new();
    for output in loaded.config.output.iter().filter(|output| output.profile == profile) {
        let rate = output.rate_hz.or(match profile {
            OutputProfile::Of(profile) => profile.rate_hz(),
            _ => None,
        });
        let rate = rate.map_or_else(|| "every row".to_owned(), |hz| format!("at most {hz} Hz"));
        let _ = write!(text, "{}: {rate}", output.to);
        match output.to.parse::<Address>() {
            Ok(Address::Serial { baud, .. }) => {
                let _ = writeln!(text, ", {baud} baud, 8 bits, no parity, one stop bit");
            }
            _ => text.push('\n'),
        }
    }
    if text.is_empty() {
        let word = String::from(profile);
        let _ = writeln!(text, "No [[output]] has `profile = \"{word}\"` yet.");
    }
    text
}

impl Array {
    /// Which angles there are; a line of antennas across the body has none for a heading sensor
    /// that is one.
    fn what_it_sees(&self, profile: Profile) -> Result<String, String> {
        let array = match self.positions_m.as_slice() {
            [] => None,
            positions => Some(AntennaArray::new(positions.to_vec()).map_err(|e| e.to_string())?),
        };
        let sees = match array.as_ref().map(AntennaArray::shape) {
            None => "heading and pitch of the vector from the first antenna to the second",
            Some(Shape::Collinear) => {
                "heading, and pitch or roll, whichever the line of the antennas shows; the other is empty"
            }
            Some(Shape::Planar | Shape::Spatial) => "heading, pitch and roll",
        };
        let mut text = format!("The array sees {sees}.\n");
        if profile == Profile::AgOpen && array.is_none_or(|array| array.shape() == Shape::Collinear)
        {
            text.push_str(
                "AgOpenGPS gets a roll (PAOGI) from antennas across the tractor or from three; without one HDT, VTG \
                 and GGA leave.\n",
            );
        }
        Ok(text)
    }

    /// Which point the coordinates are of.
    fn where_the_position_is(&self) -> String {
        let first_m = self.positions_m.first().map_or(0.0, Vector::norm);
        let name = self.names.first().map_or("", String::as_str);
        if first_m < 0.005 {
            return format!("Positions are those of antenna {name}, the origin of the body.\n");
        }
        format!(
            "Positions are those of the body's origin, and without an attitude those of antenna {name}, {first_m:.2} m \
             away from it: put the origin there (position_m = [0, 0, 0]) if such a step disturbs.\n"
        )
    }

    fn named(&self, line: &AntennaLine) -> (&str, &str) {
        let name = |k: usize| self.names.get(k).map_or("", String::as_str);
        (name(0), name(line.rover))
    }

    fn px4(&self, line: &AntennaLine) -> String {
        let (base, rover) = self.named(line);
        let [x, y, z]: [f64; 3] = line.body_m.xyz().into();
        let offset_deg = y.atan2(x).to_degrees().rem_euclid(360.0);
        format!(
            "PX4 reads an emulated u-blox receiver: NAV-PVT, NAV-DOP, NAV-RELPOSNED and NAV-DAHEADING with\n\
             the vector from {base} to {rover}, {:.3} m long (less than 10 m). Both wires are needed: PX4 configures\n\
             what it takes for a receiver and waits for answers. Forward, right, down in metres:\n\
             \n\
             GPS_1_CONFIG = the port             SER_..._BAUD = the baud rate above, not Auto\n\
             GPS_1_PROTOCOL = 1 (u-blox)         EKF2_GPS_CTRL = 15 (with heading)\n\
             SENS_GNSS0_HDG = 2 (two antennas of one receiver)\n\
             SENS_GNSS0_OFFX/Y/Z = where {base} is, from the autopilot\n\
             SENS_GNSS0_AUXX/Y/Z = the same + ({x:.3}, {y:.3}, {z:.3}), where {rover} is\n\
             PX4 that has no SENS_GNSS0_HDG: GPS_YAW_OFFSET = {offset_deg:.1}\n\
             \n\
             A vector that is more than 20 % longer or shorter than these positions say is refused.\n",
            line.body_m.norm()
        )
    }

    fn ardupilot_ubx(&self, line: &AntennaLine) -> String {
        let (base, rover) = self.named(line);
        let [x, y, z]: [f64; 3] = (-line.body_m.xyz()).into();
        format!(
            "{}\
             GPS1_MB_TYPE = 1                    GPS_AUTO_CONFIG = 0\n\
             GPS1_MB_OFS_X = {x:.3}\n\
             GPS1_MB_OFS_Y = {y:.3}\n\
             GPS1_MB_OFS_Z = {z:.3}\n\
             \n\
             The offset is that of {base} from {rover}: forward, right, down. A vector that is more than 20 % longer\n\
             or shorter ({:.3} m is reported), or not as tilted as the autopilot is, is refused.\n",
            ardupilot("GPS1_TYPE = 18 (u-blox, rover)", GPS_PORT),
            line.body_m.norm()
        )
    }
}

/// `SERIALn_PROTOCOL` of a port with a receiver.
const GPS_PORT: &str = "5 (GPS)";

/// What all ways to ArduPilot need.
fn ardupilot(kind: &str, protocol: &str) -> String {
    format!(
        "ArduPilot, EKF3:\n\
         \n\
         {kind:<35} SERIALn_PROTOCOL = {protocol}, SERIALn_BAUD as above\n\
         EK3_SRC1_YAW = 2 (GPS; 3 with a compass to fall back on)\n\
         GPS1_DELAY_MS: what `kurs_epoch_latency_seconds` of /metrics says, in milliseconds\n\
         GPS1_POS_X/Y/Z = where the body's origin is, from the autopilot\n"
    )
}

/// What the readers of the other profiles need.
const fn reader(profile: Profile) -> &'static str {
    match profile {
        Profile::Gpsd => {
            "gpsd: gpsd -n tcp://HOST:PORT or the serial device; gpspipe -w shows ATT (heading, pitch, roll) and TPV.\n"
        }
        Profile::Marine => {
            "Plotter: a connection of type NMEA 0183. HDT is the heading, XDR has PTCH and ROLL, ROT the turn. Switch other \
             sources of headings off.\n"
        }
        Profile::Survey => {
            "PASHR and PTNL,AVR have heading, pitch and roll, PASHR their deviations, GST those of the place.\n"
        }
        Profile::AgOpen => {
            "AgIO: serial port or UDP as a GPS; AgOpenGPS: heading source Dual, heading offset 0, roll from GPS.\n"
        }
        Profile::SignalK => {
            "Signal K server: a data connection of type Signal K, TCP or UDP, self mapping on. Heading in \
             navigation.headingTrue, tilts in navigation.attitude.\n"
        }
        Profile::Nmea2000 => {
            "The reader takes Kurs for a YDWG-02 gateway in RAW mode: a data connection NMEA 2000, YDWG RAW, TCP or UDP.\n"
        }
        Profile::Nmea2000ToBus => {
            "A YDWG-02 gateway in RAW mode puts these on the bus with its own address; Kurs makes the connection \
             (to = \"tcp://GATEWAY:1457\").\n"
        }
        Profile::Nmea2000Canboat => {
            "canboat: nc HOST PORT | analyzer -json; Signal K: NMEA 2000, canboat text.\n"
        }
        _ => {
            "rosbridge: topics /kurs/imu (sensor_msgs/Imu, ENU from FLU), /kurs/heading (QuaternionStamped) and /kurs/fix \
             (NavSatFix), frame base_link. A line is one message of rosbridge's WebSocket.\n\
             ROS 2 on Zenoh (rmw_zenoh): to = \"zenoh://ROUTER:7447/DOMAIN\", with the cargo feature `zenoh`; no bridge.\n"
        }
    }
}
