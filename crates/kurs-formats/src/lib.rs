//! GNSS file formats, to and from the types of `kurs`: bytes in, observations and ephemerides out.
#![forbid(unsafe_code)]

pub mod antex;
mod compress;
pub mod content;
pub mod damage;
mod dilution;
mod epoch_order;
mod fields;
pub mod fingerprint;
pub mod geoid;
mod json;
pub mod logs;
pub mod mavlink;
pub mod navigation;
mod navigation_frames;
pub mod nmea;
pub mod nmea2000;
pub mod observations;
mod pending_slips;
pub mod positions;
mod read_summary;
pub mod rinex;
pub mod ros;
pub mod rtcm;
pub mod sbf;
pub mod session;
pub mod signal_k;
pub mod source;
mod sp3;
pub mod tdm;
pub mod ubx;
mod unix_time;
mod whole;
