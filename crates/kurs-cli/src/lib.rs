//! The program `kurs` as a library: [`run`] is the program, [`embedded`] what other programs call.
//! One file per subcommand, and what they share: configuration files (`config_file`), outputs that
//! are never half written (`output`) and exit statuses (`failure`).

mod batch;
mod calibrate;
mod chart;
mod completions;
mod config_file;
mod copies;
mod demo;
mod doctor;
pub mod embedded;
mod failure;
mod fuse;
mod init;
mod inspect;
mod integers;
mod interrupt;
mod live;
mod map_files;
mod orient;
mod output;
mod page;
mod parquet_files;
mod pipe;
mod plan;
mod progress;
mod quality;
mod report;
mod sensor_log;
mod session_span;
mod simulate;
mod solve;
mod stated_interference;
mod summary;
mod survey;
mod table;
mod tables;
mod text_file;
mod track;
mod truth;
mod unobserved_bands;
mod window;

use std::ffi::OsString;

use anyhow::Context as _;
use clap::{CommandFactory as _, FromArgMatches as _, Parser};

use failure::ExitCode;

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
    Live(live::Args),
    Batch(batch::Args),
    Init(init::Args),
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
    Completions(completions::CompletionsArgs),
    Man(completions::ManArgs),
}

/// Runs the program with these arguments, of which the first is the program's name, and gives its
/// exit status: 0 done; 1 the input could not be used; 2 wrong usage or configuration.
///
/// Results go to standard output and to files, messages to standard error.
pub fn run(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> u8 {
    interrupt::catch();
    let cli = match Cli::read(arguments) {
        Ok(cli) => cli,
        Err(wrong) if wrong.use_stderr() => {
            let _ = wrong.print();
            return u8::try_from(wrong.exit_code()).unwrap_or(2);
        }
        // `--help` and `--version`, which are not failures.
        Err(help) => {
            let printed = help.print().context(output::UNPRINTED);
            return failure::exit_code(printed.map(|()| ExitCode::SUCCESS)).number();
        }
    };
    failure::exit_code(cli.command.run()).number()
}

impl Cli {
    /// Reads a command line, of which the first word is the program's name.
    fn read(
        arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    ) -> clap::error::Result<Self> {
        let command = with_negative_numbers(Self::command());
        Self::from_arg_matches(&command.try_get_matches_from(arguments)?)
    }
}

/// The command line, with values of options that begin with a minus: what is wrong with such a
/// number is told by the option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let takes_value =
        |option: &clap::Arg| option.get_action().takes_values() && !option.is_positional();
    command
        .mut_args(|option| {
            let takes_value = takes_value(&option);
            option.allow_negative_numbers(takes_value)
        })
        .mut_subcommands(with_negative_numbers)
}

impl Command {
    fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Solve(args) => solve::run(&args),
            Self::Live(args) => live::run(&args),
            Self::Batch(args) => batch::run(&args),
            Self::Init(args) => init::run(&args),
            Self::Simulate(args) => simulate::run(&args),
            Self::Demo(args) => demo::run(&args),
            Self::Orient(args) => orient::run(&args),
            Self::Plan(args) => plan::run(&args),
            Self::Track(args) => track::run(&args),
            Self::Calibrate(args) => calibrate::run(&args),
            Self::Survey(args) => survey::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Inspect(args) => inspect::run(&args),
            Self::Fuse(args) => fuse::run(&args),
            Self::Completions(args) => completions::completions(&args),
            Self::Man(args) => completions::man(&args),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn callers_get_the_exit_status_as_a_number() {
        assert_eq!(super::run(["kurs", "--version"]), 0);
        assert_eq!(super::run(["kurs", "solve"]), 2);
        assert_eq!(super::run(["kurs", "inspect", "/no/such/file"]), 1);
    }
}
