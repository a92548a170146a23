//! u-blox messages (UBX): raw observations and navigation subframes.
//!
//! Source: u-blox F9 HPG 1.32 interface description, UBX-22008968, sections 3.2 (frames), 3.17.5
//! (RXM-RAWX), 3.17.8 (RXM-SFRBX).
//!
//! The messages are decoded here and not by the crate `ublox`, which keeps the signal of a
//! measurement (`sigId`) among its reserved bytes, gives no byte offset of what it skips, and knows
//! no other protocol between the messages.

pub(crate) mod rawx;
pub(crate) mod sfrbx;
mod signal;
mod write;

pub use signal::has_number;
pub use write::UbxWriter;
