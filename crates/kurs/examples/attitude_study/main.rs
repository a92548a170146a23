//! How sure is the attitude, and what does it cost? Studies of random problems.
//!
//! `cargo run --release -p kurs --example attitude_study -- minima`: does Newton's method from
//! Wahba's solution reach the global minimum, and what does the search for a second one add? The
//! referee starts Newton's method from 60 random attitudes as well.
//!
//! `… -- continuation`: errors of the published continuation against Newton's method (table of
//! `docs/theory/attitude.md`).
//!
//! `… -- static [SKIES EPOCHS]` and `… -- cost [ROUNDS]`: the paper's static test and the cost of the
//! methods (tables of `docs/experiments/attitude.md`).
#![allow(clippy::print_stdout)]

mod continuation;
mod cost;
mod interval;
mod minima;
mod scene;
mod static_test;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, default: usize| {
        arguments.get(index).and_then(|text| text.parse().ok()).unwrap_or(default)
    };
    match arguments.first().map(String::as_str) {
        Some("minima") => minima::print_study(10_000),
        Some("continuation") => continuation::print_table(200),
        Some("static") => static_test::print_study(number(1, 240), number(2, 2400)),
        Some("cost") => cost::print_table(number(1, 400)),
        _ => println!("usage: attitude_study minima | continuation | static | cost"),
    }
}
