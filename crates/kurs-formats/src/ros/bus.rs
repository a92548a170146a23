//! How topics of ROS 2 travel over Zenoh, as its middleware `rmw_zenoh` has it: the key of a topic,
//! what goes with every message, and the tokens by which other nodes know who publishes.

use core::fmt;

/// A topic that Kurs publishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topic {
    /// Such as `/kurs/imu`.
    pub name: &'static str,
    /// Such as `sensor_msgs/msg/Imu`.
    pub kind: &'static str,
    /// Hash of the type's definition (REP 2011): nodes with another one do not see the topic.
    pub type_hash: &'static str,
}

/// All of them.
pub const TOPICS: [Topic; 3] = [super::IMU, super::HEADING, super::FIX];

/// Numbers of domains that every platform allows.
pub const MAX_DOMAIN: u32 = 101;

/// Who publishes a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Publisher {
    /// Nodes of other domains are not seen.
    pub domain: u32,
    /// What it publishes.
    pub topic: Topic,
}

impl Publisher {
    /// `<domain>/<topic>/<type>/<hash>`
    #[must_use]
    pub fn key(&self) -> String {
        let Self { domain, topic } = self;
        format!("{domain}{}/{}/{}", topic.name, topic.type_of_bus(), topic.type_hash)
    }

    /// The tokens of its node and of itself, in a session of this name: they make the topic appear
    /// in lists.
    #[must_use]
    pub fn tokens(&self, session: impl fmt::Display) -> [String; 2] {
        /// The usual quality of service, of which the last ten messages are kept.
        const QUALITY: &str = "::,10:,:,:,,";
        let Self { domain, topic } = self;
        // Names have no slashes there, and an empty namespace is a sign.
        let name = topic.name.replace('/', "%");
        let node = topic.name[1..].replace('/', "_");
        let of = |number: u8, kind: &str| {
            format!("@ros2_lv/{domain}/{session}/0/{number}/{kind}/%/%/{node}")
        };
        let (kind, hash) = (topic.type_of_bus(), topic.type_hash);
        [of(0, "NN"), format!("{}/{name}/{kind}/{hash}/{QUALITY}", of(1, "MP"))]
    }
}

impl Topic {
    /// `sensor_msgs::msg::dds_::Imu_` of `sensor_msgs/msg/Imu`.
    fn type_of_bus(&self) -> String {
        let (package, name) = self.kind.rsplit_once('/').unwrap_or(("", self.kind));
        format!("{}::dds_::{name}_", package.replace('/', "::"))
    }
}

/// What goes with a message: its number, when it was sent (ns of Unix time), and who sent it.
#[must_use]
pub fn attachment(number: i64, sent_unix_ns: i64, sender: [u8; 16]) -> [u8; 33] {
    let mut bytes = [0; 33];
    bytes[..8].copy_from_slice(&number.to_le_bytes());
    bytes[8..16].copy_from_slice(&sent_unix_ns.to_le_bytes());
    // The length of what follows.
    bytes[16] = 16;
    bytes[17..].copy_from_slice(&sender);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The forms are those of `rmw_zenoh/docs/design.md` (Jazzy).
    #[test]
    fn a_topic_has_its_key_and_its_tokens() {
        let publisher = Publisher { domain: 7, topic: super::super::IMU };
        let of_type = "sensor_msgs::msg::dds_::Imu_/RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b";
        assert_eq!(publisher.key(), format!("7/kurs/imu/{of_type}"));
        let [node, own] = publisher.tokens("aac3");
        assert_eq!(node, "@ros2_lv/7/aac3/0/0/NN/%/%/kurs_imu");
        let wanted =
            format!("@ros2_lv/7/aac3/0/1/MP/%/%/kurs_imu/%kurs%imu/{of_type}/::,10:,:,:,,");
        assert_eq!(own, wanted);
    }

    #[test]
    fn an_attachment_has_number_time_and_sender() {
        let bytes = attachment(3, 258, [9; 16]);
        assert_eq!(bytes[..17], [3, 0, 0, 0, 0, 0, 0, 0, 2, 1, 0, 0, 0, 0, 0, 0, 16]);
        assert_eq!(bytes[17..], [9; 16]);
    }
}
