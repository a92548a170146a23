//! The program `kurs`; everything is in the library, so that other programs can call it too.

/// An epoch makes some hundred small matrices that live for microseconds. With the allocator of the
/// C library one of four antennas takes a tenth longer (`epoch_cost` without these lines, which it
/// has too).
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    // A reader that has seen enough, as in `kurs … | head`, ends the program like any other.
    sigpipe::reset();
    kurs_cli::run(std::env::args_os()).into()
}
