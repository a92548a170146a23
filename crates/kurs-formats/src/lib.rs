//! GNSS file formats, to and from the types of `kurs`: bytes in, observations and ephemerides out.
#![forbid(unsafe_code)]

pub mod antex;
mod compress;
pub mod content;
pub mod damage;
mod epoch_order;
mod fields;
pub mod geoid;
pub mod logs;
pub mod navigation;
mod navigation_frames;
pub mod nmea;
pub mod observations;
mod pending_slips;
pub mod positions;
mod read_summary;
pub mod rinex;
pub mod rtcm;
pub mod sbf;
pub mod session;
pub mod source;
mod sp3;
pub mod tdm;
pub mod ubx;
