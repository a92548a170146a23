//! The full Monte Carlo comparison of the rotating-arm filters: 100 seeds a row, as recorded in
//! `docs/experiments/fusion.md`.
//!
//! `cargo run --release -p kurs-sim --example rotating_arm [SEEDS]`
#![allow(clippy::print_stdout, clippy::unwrap_used, clippy::cast_possible_truncation)]
#![allow(clippy::cast_sign_loss)]

#[path = "../tests/rotating_arm/campaign.rs"]
mod campaign;

use campaign::{ACCELERATED, COARSE, Campaign, Candidate, InitialErrors, STEADY, USUAL, corrected};
use kurs::fusion::attitude_form::AttitudeForm::{Euler, Quaternion};
use kurs::fusion::kalman::Gate;
use kurs_sim::rotating_arm::Course;

fn main() {
    let seeds = std::env::args().nth(1).map_or(100, |count| count.parse().expect("seeds"));
    let uniform = Course::Uniform { speed_mps: 20.0 };
    let along = Course::AlongHeading { speed_mps: 20.0 };
    let standing = Course::Standing;
    let published_gate = Gate::NoiseOnly { sigmas: 3.0 };
    let with_phase = |candidate| match candidate {
        Candidate::Corrected(mut settings) => {
            settings.ambiguity_slots = 12;
            Candidate::Corrected(settings)
        }
        other => other,
    };
    let rows: Vec<(&str, Candidate, Course, InitialErrors)> = vec![
        ("C17 U", corrected(30.0, 0.03, false, Euler), uniform, USUAL),
        ("C17 T", corrected(30.0, 0.03, false, Euler), along, USUAL),
        ("C17 S", corrected(30.0, 0.03, false, Euler), standing, USUAL),
        ("C17 U from 30°", corrected(30.0, 0.03, false, Euler), uniform, COARSE),
        ("C17r U (manoeuvring)", corrected(30.0, 0.1, false, Euler), uniform, USUAL),
        ("C17r T (manoeuvring)", corrected(30.0, 0.1, false, Euler), along, USUAL),
        ("C17r U from 30°", corrected(30.0, 0.1, false, Euler), uniform, COARSE),
        ("tuned U (balanced)", corrected(1.0, 0.003, false, Euler), uniform, USUAL),
        ("tuned T (balanced)", corrected(1.0, 0.003, false, Euler), along, USUAL),
        ("tuned U from 30°", corrected(1.0, 0.003, false, Euler), uniform, COARSE),
        ("calm U", corrected(0.01, 0.1, false, Euler), uniform, USUAL),
        ("C20 U", corrected(30.0, 1.0, true, Euler), uniform, USUAL),
        ("C20 T", corrected(30.0, 1.0, true, Euler), along, USUAL),
        ("C20 U from 30°", corrected(30.0, 1.0, true, Euler), uniform, COARSE),
        ("Q17 U", corrected(30.0, 0.03, false, Quaternion), uniform, USUAL),
        ("Q17 T", corrected(30.0, 0.03, false, Quaternion), along, USUAL),
        ("Q20 U", corrected(30.0, 1.0, true, Quaternion), uniform, USUAL),
        ("Q20 T", corrected(30.0, 1.0, true, Quaternion), along, USUAL),
        ("Q20 T with phase", with_phase(corrected(30.0, 1.0, true, Quaternion)), along, USUAL),
        ("published U, own world", Candidate::PublishedOwnWorld(published_gate), uniform, USUAL),
        ("published U, own, open", Candidate::PublishedOwnWorld(Gate::Open), uniform, USUAL),
        ("published A5, own, open", Candidate::PublishedOwnWorld(Gate::Open), ACCELERATED, STEADY),
        (
            "published A5, own world",
            Candidate::PublishedOwnWorld(published_gate),
            ACCELERATED,
            STEADY,
        ),
        ("published U, real world", Candidate::PublishedRealWorld(published_gate), uniform, USUAL),
        ("published U, real, open", Candidate::PublishedRealWorld(Gate::Open), uniform, USUAL),
    ];
    println!(
        "| filter and course | lost % | heading steady | tilt steady | manoeuvre | peak p95 | lag s \
         | <2° p95 s | position m | velocity m/s | rejected % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for (name, candidate, course, initial) in rows {
        let campaign = Campaign { initial, ..Campaign::new(candidate, course) };
        let s = campaign.run(0..seeds);
        println!(
            "| {name} | {:.0} | {:.3} | {:.3} | {:.2} | {:.1} | {:.3} | {:.1} | {:.3} | {:.3} | \
             {:.4} |",
            s.lost_percent,
            s.heading_steady,
            s.tilt_steady,
            s.heading_manoeuvre,
            s.peak_p95,
            s.lag_s,
            s.convergence_p95_s,
            s.position_m,
            s.velocity_mps,
            s.rejected_percent
        );
    }
}
