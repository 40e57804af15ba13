//! The `host-sim` program; everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(host_sim::cli::main())
}
