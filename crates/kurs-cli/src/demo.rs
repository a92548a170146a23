//! `kurs demo`: a car with four antennas is simulated, solved and laid against the truth.

use std::fs;
use std::net::TcpListener;
use std::path::PathBuf;
use std::thread;

use anyhow::Context;

use crate::failure::ExitCode;
use crate::simulate::LiveScenario;
use crate::{live, output, simulate, solve};

/// Simulates a car with four antennas, solves it, compares with the truth and writes the report.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the files.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/demo")]
    out: PathBuf,
    /// The car as live streams: heading while it drives (150 s), JSON lines and metrics at ports of
    /// the loopback.
    #[arg(long)]
    live: bool,
    /// Prints summary.json in place of the closing summary.
    #[arg(long)]
    json: bool,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command: what a user would do by hand.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if args.live {
        return run_live(args);
    }
    let Args { out, json, quiet, .. } = args;
    // The other command says what to run next.
    let simulated = simulate::run(&simulate::Args::built_in("car", out.clone(), true))?;
    if simulated != ExitCode::SUCCESS {
        return Ok(simulated);
    }
    let (configuration, truth) = (out.join("kurs.toml"), out.join("truth.csv"));
    let code =
        solve::run(&solve::Args::of_simulation(configuration, truth, out.clone(), *json, *quiet))?;
    if !quiet && !json {
        output::print(format_args!("\nopen {}\n", out.join("report.html").display()))?;
    }
    Ok(code)
}

/// Simulated receivers in one thread, the service in the other.
fn run_live(args: &Args) -> anyhow::Result<ExitCode> {
    let (streams, [lines, page]) = (free_ports(4)?, [free_ports(1)?, free_ports(1)?]);
    let scenario = LiveScenario::built_in("car", streams)?;
    let text = format!(
        "{}[live]\nbody = \"car\"\npage = \"127.0.0.1:{page}\"\n\n[[output]]\n\
         to = \"tcp-listen://127.0.0.1:{lines}\"\nprofile = \"jsonl\"\n",
        scenario.configuration()
    );
    let file = args.out.join("live.toml");
    fs::create_dir_all(&args.out)
        .and_then(|()| fs::write(&file, text))
        .with_context(|| format!("{}: cannot be written", file.display()))?;
    if !args.quiet {
        output::print(format_args!(
            "JSON lines at 127.0.0.1:{lines}, page at http://127.0.0.1:{page}/\n"
        ))?;
    }
    let sending = thread::spawn(move || scenario.send());
    let live = live::Args::of_demonstration(file, args.out.join("live"), args.quiet);
    let code = live::run(&live)?;
    match sending.join() {
        Ok(sent) => sent.map(|()| code),
        Err(_) => anyhow::bail!("the simulated receivers ended early"),
    }
}

/// The first of `count` ports in a row that are free now.
fn free_ports(count: u16) -> anyhow::Result<u16> {
    const TRIES: usize = 100;
    for _ in 0..TRIES {
        let first = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
        let last = first.saturating_add(count - 1);
        if (first..=last).all(|port| TcpListener::bind(("127.0.0.1", port)).is_ok()) {
            return Ok(first);
        }
    }
    anyhow::bail!("no {count} free ports in a row")
}
