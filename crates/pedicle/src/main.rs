//! The `pedicle` command.

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use pedicle::commands::{Cli, EXIT_BAD_INPUT};

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(code) => code,
        Err(error) => {
            let _closed = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::from(EXIT_BAD_INPUT)
        }
    }
}
