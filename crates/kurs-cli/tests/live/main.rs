//! `kurs live` as its users run it, on simulated logs and receivers.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

mod bodies;
mod casters;
mod equal_rows;
mod faults;
mod foreign;
mod gyro;
#[path = "../../../../tests/outside.rs"]
mod outside;
mod page;
mod service;
mod stage;
