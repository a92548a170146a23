//! Every key of a scenario against what it does: a run with the effect beside one without, seeded
//! alike, so that their difference is the effect alone, with its sign and size.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

mod clocks;
mod motions;
mod noise;
mod obstacles;
mod path;
mod scene;
mod sky;
mod tracking;
