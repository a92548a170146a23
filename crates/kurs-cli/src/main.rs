//! The program `kurs`; everything is in the library, so that other programs can call it too.

fn main() -> std::process::ExitCode {
    // A reader that has seen enough, as in `kurs … | head`, ends the program like any other.
    sigpipe::reset();
    kurs_cli::run(std::env::args_os()).into()
}
