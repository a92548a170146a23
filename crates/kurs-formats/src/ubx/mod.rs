//! u-blox messages (UBX): raw observations and navigation subframes.
//!
//! Source: u-blox F9 HPG 1.32 interface description, UBX-22008968, sections 3.2 (frames), 3.17.5
//! (RXM-RAWX), 3.17.8 (RXM-SFRBX).
//!
//! The messages are decoded here and not by the crate `ublox`, which keeps the signal of a
//! measurement (`sigId`) among its reserved bytes, gives no byte offset of what it skips, and knows
//! no other protocol between the messages.

mod antenna_line;
mod conversation;
mod navigation;
pub(crate) mod rawx;
pub(crate) mod sfrbx;
mod signal;
mod write;

pub use antenna_line::AntennaLine;
pub use conversation::Conversation;
pub(crate) use navigation::SPEED_SD_MPS;
pub use navigation::navigation;
pub use signal::has_number;
pub use write::UbxWriter;

use crate::logs::checksum::fletcher;

/// A message of this class and number with its framing. Payloads have less than 65536 bytes.
#[must_use]
pub fn frame(id: [u8; 2], payload: &[u8]) -> Vec<u8> {
    let [low, high, ..] = payload.len().to_le_bytes();
    let mut message = vec![0xb5, 0x62, id[0], id[1], low, high];
    message.extend(payload);
    let checksum = fletcher(&message[2..]);
    message.extend(checksum);
    message
}
