//! The `flexor` program; everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(flexor_sim::cli::main())
}
