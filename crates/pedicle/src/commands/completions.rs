//! `pedicle completions`: what a shell needs to complete commands and options.

use std::io::Write;
use std::process::ExitCode;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{Cli, exit_code};
use crate::Error;

/// Print the completions of a shell.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    /// The shell.
    #[arg(value_enum, value_name = "SHELL")]
    shell: Shell,
}

const EXAMPLES: &str = "\
Examples:
  pedicle completions bash > ~/.local/share/bash-completion/completions/pedicle
  pedicle completions zsh > ~/.zfunc/_pedicle";

impl Arguments {
    pub(super) fn run(self) -> Result<ExitCode, Error> {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "pedicle", &mut text);
        // A closed pipe is not an error.
        let _closed = std::io::stdout().write_all(&text);
        Ok(exit_code(true))
    }
}
