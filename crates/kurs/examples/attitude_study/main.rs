//! How sure is the attitude? Two studies of random problems.
//!
//! `cargo run --release -p kurs --example attitude_study -- minima`: does Newton's method from
//! Wahba's solution reach the global minimum, and what does the search for a second one add? The
//! referee starts Newton's method from 60 random attitudes as well.
//!
//! `cargo run --release -p kurs --example attitude_study -- continuation`: errors of the published
//! continuation against Newton's method (table of `docs/theory/attitude.md`).
#![allow(clippy::print_stdout)]

mod continuation;
mod minima;
mod scene;

fn main() {
    match std::env::args().nth(1).as_deref() {
        Some("minima") => minima::print_study(10_000),
        Some("continuation") => continuation::print_table(200),
        _ => println!("usage: attitude_study minima | continuation"),
    }
}
