//! The commands and their arguments.

mod demo;
mod table;
mod transfer;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::Error;

/// Everything was vouched for.
pub const EXIT_ACCEPTED: u8 = 0;
/// Wrong usage or input.
pub const EXIT_BAD_INPUT: u8 = 2;
/// The work was done, but something is not vouched for.
pub const EXIT_REJECTED: u8 = 3;

/// Carry a pedicle-screw plan from a CT spine to an intra-operative surface.
///
/// Research software, not a medical device.
#[derive(Debug, Parser)]
#[command(name = "pedicle", version, after_help = EXAMPLES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  pedicle demo
  pedicle transfer --source fixtures/phantom --plan fixtures/phantom/plan.ron \\
      --source-landmarks fixtures/phantom/landmarks.ron \\
      --target target.ply --target-landmarks target-landmarks.json --json result.json

Exit codes: 0 everything accepted, 3 something rejected, 2 wrong usage or input.";

#[derive(Debug, Subcommand)]
enum Command {
    Transfer(transfer::Arguments),
    Demo(demo::Arguments),
}

impl Cli {
    /// Runs the command. Results go to standard output; an error is for the caller to show.
    ///
    /// # Errors
    /// [`Error`] if an input is wrong or a result cannot be written.
    pub fn run(self) -> Result<ExitCode, Error> {
        match self.command {
            Command::Transfer(arguments) => arguments.run(),
            Command::Demo(arguments) => arguments.run(),
        }
    }
}

fn exit_code(all_accepted: bool) -> ExitCode {
    ExitCode::from(if all_accepted {
        EXIT_ACCEPTED
    } else {
        EXIT_REJECTED
    })
}

/// Prints to standard output. A closed pipe is not an error.
fn say(text: &str) {
    use std::io::Write;
    let _closed = writeln!(std::io::stdout(), "{text}");
}
