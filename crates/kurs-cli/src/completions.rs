//! `kurs completions` and `kurs man`: what shells and the manual know of the command line, from the
//! command line itself.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::CommandFactory;

use crate::Cli;
use crate::failure::ExitCode;
use crate::output::{self, OutputFolder};

/// Prints the completions of a shell.
///
/// Of bash: kurs completions bash > ~/.local/share/bash-completion/completions/kurs
#[derive(Debug, clap::Args)]
pub(crate) struct CompletionsArgs {
    /// The shell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

/// Writes the manual pages: kurs.1, and one for every command.
#[derive(Debug, clap::Args)]
pub(crate) struct ManArgs {
    /// Folder for the pages.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/man")]
    out: PathBuf,
    /// No closing line.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs `kurs completions`.
pub(crate) fn completions(args: &CompletionsArgs) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "kurs", &mut script);
    output::print(String::from_utf8_lossy(&script))?;
    Ok(ExitCode::SUCCESS)
}

/// Runs `kurs man`.
pub(crate) fn man(args: &ManArgs) -> anyhow::Result<ExitCode> {
    let folder = OutputFolder::begin(&args.out, &["kurs.1", "kurs-*.1"], &[])?;
    let program = Cli::command().disable_help_subcommand(true);
    clap_mangen::generate_to(program, folder.path())
        .with_context(|| format!("{}: cannot be written", args.out.display()))?;
    let pages = std::fs::read_dir(folder.path())?.count();
    folder.publish()?;
    if !args.quiet {
        output::print(format_args!("{pages} pages written to {}\n", args.out.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}
