//! Simulations: that each effect is what its key says, and what the library makes of them against the truth.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests, with measured figures

mod coasting;
mod consistency;
mod effects;
mod faults;
mod links;
mod predicted_integers;
mod predicting;
mod rotating_arm;
mod scenarios;
mod solved;
mod solving;
mod station;

#[path = "solving/bound.rs"]
mod bound;
