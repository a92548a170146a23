//! RINEX, the exchange format of receivers: fixed columns, a label in columns 61 to 80 of every
//! header line.
//!
//! Sources: RINEX 2.11 (W. Gurtner, L. Estey, 2007), RINEX 3.05 (IGS/RTCM, 2020), RINEX 4.02
//! (IGS/RTCM, 2024).

pub(crate) mod codes;
pub(crate) mod fields;
pub(crate) mod navigation;
pub mod observation;
mod write_compact;
mod write_navigation;
mod write_observation;

pub use write_compact::CompactWriter;
pub use write_navigation::write_navigation;
pub use write_observation::{ObservationFileHeader, ObservationWriter};
