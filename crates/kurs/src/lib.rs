//! Kurs: how a body is oriented, from the raw signals of several GNSS antennas fixed on it.
//!
//! This crate holds the types and all algorithms; it does no input or output, reads no clock and
//! starts no thread. The modules stand in the order in which data flow through them, and each uses
//! only modules above it.
#![forbid(unsafe_code)]

// The words.
pub mod time;

pub mod frames;

pub mod signal;

pub mod array;

pub mod antenna_calibration;

pub mod solution;

pub mod turn_rate;

pub mod chi_square;

// The inputs.
pub mod observation;

pub mod ephemeris;

// The chain.
pub mod sky;

pub mod atmosphere;

pub mod point;

pub mod cycle_slip;

pub mod difference;

mod glonass_ifb;

pub mod link_noise;

pub mod float_solution;

pub mod signal_residuals;

pub mod attitude;

pub mod ambiguity;

pub mod baseline;

pub mod selection;

pub mod engine;

pub mod differential;

pub mod both_directions;

// Beside the chain.
pub mod orientation;

pub mod prediction;

pub mod fusion;

pub mod calibration;

pub mod trajectory;
