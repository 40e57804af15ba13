//! What shells and man(1) want to know of the command line.

use super::{Cli, CliError};
use clap::{Args, CommandFactory};
use std::io::{self, Write};
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: clap_complete::Shell,
}

#[derive(Args)]
pub(super) struct ManArgs {
    /// Folder for the pages; made if it is not there
    #[arg(long, value_name = "DIR", default_value = "out/man")]
    out: PathBuf,
}

/// Prints a shell's completions.
pub(super) fn completions(args: &CompletionsArgs) -> Result<(), CliError> {
    let mut text = vec![];
    clap_complete::generate(args.shell, &mut Cli::command(), "flexor", &mut text);
    io::stdout().write_all(&text).map_err(CliError::Stdout)
}

/// Writes the manual pages.
pub(super) fn man(args: &ManArgs) -> Result<(), CliError> {
    let write = || {
        std::fs::create_dir_all(&args.out)?;
        clap_mangen::generate_to(Cli::command(), &args.out)
    };
    write().map_err(|cause| CliError::Unwritable {
        file: args.out.clone(),
        cause,
    })
}
