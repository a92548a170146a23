//! The program `kurs`: one file per subcommand, and what they share: configuration files
//! ([`config_file`]), outputs that are never half written ([`output`]) and exit statuses
//! ([`failure`]).

#![allow(clippy::print_stdout)] // results go to standard output, messages to standard error

mod calibrate;
mod config_file;
mod copies;
mod demo;
mod doctor;
mod failure;
mod fuse;
mod inspect;
mod orient;
mod output;
mod page;
mod plan;
mod progress;
mod report;
mod sensor_log;
mod session_span;
mod simulate;
mod solve;
mod summary;
mod survey;
mod table;
mod tables;
mod track;
mod truth;

use std::process::ExitCode;

use clap::Parser;

/// Heading, pitch and roll from the raw signals of several GNSS antennas.
#[derive(Debug, Parser)]
#[command(name = "kurs", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Solve(Box<solve::Args>),
    Simulate(simulate::Args),
    Demo(demo::Args),
    Orient(orient::Args),
    Plan(Box<plan::Args>),
    Track(track::Args),
    Calibrate(calibrate::Args),
    Fuse(fuse::Args),
    Survey(survey::Args),
    Doctor(doctor::Args),
    Inspect(inspect::Args),
}

fn main() -> ExitCode {
    // A reader that has seen enough, as in `kurs … | head`, ends the program like any other.
    sigpipe::reset();
    let cli = Cli::parse();
    let result: anyhow::Result<ExitCode> = match cli.command {
        Command::Solve(args) => solve::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Orient(args) => orient::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Track(args) => track::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Survey(args) => survey::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Fuse(args) => fuse::run(&args),
    };
    failure::exit_code(result)
}
