//! The service behind `kurs live`: streams of receivers in, attitude out.
//!
//! ```text
//! connection ─► decoder ─┐   (one of each for every stream; a new decoder for every connection)
//! connection ─► decoder ─┴► matcher ─► engine ─┬► files
//!                           with a deadline    ├► outputs
//!                                              └► page
//! ```
//!
//! Lines of an inertial sensor join the epochs in front of the engine, those of other bodies the
//! rows behind it.
//!
//! Connections and outputs are tasks of one small runtime; every decoder, the engine and the files
//! have a thread of their own. Everything between them is bounded: a receiver that is ahead of the
//! others waits, a client that does not read is dropped. The rows are those of `kurs solve` with
//! `[nav] as_received = true` on the same bytes.
//!
//! What is particular to a program comes in as functions: how an engine is made, how a row is
//! written to a file or put into a message ([`Setup`]).
#![forbid(unsafe_code)]

mod access;
mod address;
mod back_off;
mod band_level;
#[cfg(any(feature = "mqtt", feature = "zenoh"))]
mod bus;
mod connection;
mod decoder;
mod files;
mod http;
mod imu;
mod input;
mod inputs;
mod intake;
mod lines;
mod lock;
#[cfg(feature = "mqtt")]
mod mqtt;
mod ntrip;
mod outlets;
mod output;
mod page;
mod peer;
mod profile;
mod record;
mod relative;
mod service;
mod setup;
mod solver;
mod state;
mod station_epochs;
mod station_place;
mod status;
mod systemd;
mod trouble;
#[cfg(feature = "zenoh")]
mod zenoh;

pub use address::{Address, BadAddress, Mqtt, Ntrip, Place, Zenoh};
pub use imu::{Imu, ReadSamples, SampleLines};
pub use input::{Input, Observer};
pub use lines::Lines;
pub use ntrip::body_of_answer;
pub use output::{Encode, Output, Partner};
pub use page::Page;
pub use peer::{EncodeRelative, PeerSetup, RelativeRow, body_state};
pub use profile::{Profile, on_the_bus_of_ros};
pub use record::gps_time;
pub use relative::{BodyState, Relative, RelativeSettings, relative};
pub use service::{ServiceError, run};
pub use setup::{Finish, Gga, MakeEngine, Reloaded, Setup, Times, WriteRelative, WriteRow};
pub use state::{Remembered, newest_reference_time, remembered};
