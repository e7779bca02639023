//! The commands and their arguments.

mod anatomy;
mod check;
mod completions;
mod console;
mod convert;
mod demo;
mod import;
mod map;
mod plan;
mod progress;
mod spectrum;
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

/// Carry a pedicle-screw plan from a CT spine to an intra-operative surface; map any shape to
/// another; compute spectra.
///
/// Research software, not a medical device.
#[derive(Debug, Parser)]
#[command(name = "pedicle", version, after_help = EXAMPLES)]
pub struct Cli {
    #[command(flatten)]
    console: console::Console,
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  pedicle demo
  pedicle import labels.nii.gz -o spine
  pedicle convert plan.ron plan.mrk.json
  pedicle transfer --source fixtures/phantom --plan fixtures/phantom/plan.ron \\
      --source-landmarks fixtures/phantom/landmarks.ron \\
      --target target.ply --target-landmarks target-landmarks.json --json result.json
  pedicle anatomy fixtures/phantom
  pedicle plan fixtures/phantom -o plan.ron
  pedicle check fixtures/phantom plan.ron
  pedicle map cat-a.off cat-b.off --landmarks pairs.txt --json map.json --glb map.glb
  pedicle spectrum bone.stl -k 200 --json spectrum.json

`pedicle COMMAND --help` has more. --json - prints the result on standard output and nothing else.
Nothing is written over without --force. NO_COLOR is respected.

Exit codes: 0 everything done, accepted or certified, 3 something not, 2 wrong usage or input.";

#[derive(Debug, Subcommand)]
enum Command {
    Import(import::Arguments),
    Convert(convert::Arguments),
    Transfer(transfer::Arguments),
    Demo(demo::Arguments),
    Anatomy(anatomy::Arguments),
    Plan(plan::Arguments),
    Check(check::Arguments),
    Map(map::Arguments),
    Spectrum(spectrum::Arguments),
    Completions(completions::Arguments),
}

impl Cli {
    /// Runs the command. Results go to standard output; an error is for the caller to show.
    ///
    /// # Errors
    /// [`Error`] if an input is wrong or a result cannot be written.
    pub fn run(self) -> Result<ExitCode, Error> {
        let console = self.console;
        match self.command {
            Command::Import(arguments) => arguments.run(console),
            Command::Convert(arguments) => arguments.run(console),
            Command::Transfer(arguments) => arguments.run(console),
            Command::Demo(arguments) => arguments.run(console),
            Command::Anatomy(arguments) => arguments.run(console),
            Command::Plan(arguments) => arguments.run(console),
            Command::Check(arguments) => arguments.run(console),
            Command::Map(arguments) => arguments.run(console),
            Command::Spectrum(arguments) => arguments.run(console),
            Command::Completions(arguments) => arguments.run(),
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

/// A count that must not be 0.
fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) => Err("at least 1 is needed".to_owned()),
        Ok(count) => Ok(count),
        Err(error) => Err(format!("{error}")),
    }
}

/// Prints to standard output. A closed pipe is not an error.
fn say(text: &str) {
    use std::io::Write;
    let _closed = writeln!(std::io::stdout(), "{text}");
}
