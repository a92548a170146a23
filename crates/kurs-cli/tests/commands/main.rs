//! The program as a user runs it, command by command.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests, with measured figures and what was skipped

#[path = "../../../../tests/outside.rs"]
mod outside;

mod bad_input;
mod calibrate;
mod command_line;
mod doctor;
mod fuse;
mod fuse_antennas;
mod inspect;
mod orient;
mod phase_centers;
mod plan;
mod precise_orbits;
mod program;
mod receiver_logs;
mod recordings;
mod simulate;
mod track;
