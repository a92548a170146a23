//! Files of every format: what is in them, ways to break them, others' readers beside ours.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests, with measured figures and what was skipped

#[path = "../../../../tests/outside.rs"]
mod outside;

mod autopilot_gates;
mod checks;
mod compact_files;
mod leaving_messages;
mod leaving_rows;
mod low_orbit;
mod mutated_files;
mod navigation_files;
mod navigation_logs;
mod navigation_recordings;
mod observation_files;
mod observation_recordings;
mod position_recordings;
mod receiver_logs;
mod rtcm_kinds;
mod sessions;
