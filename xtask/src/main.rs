//! Benchmarks, gates and chores of the workspace: `cargo xtask COMMAND`.

mod anatomy;
mod baselines;
mod bench;
mod ci;
mod docs;
mod error;
mod exchange;
mod import;
mod measure;
mod pairs;
mod peers;
mod phantom;
mod registration;
mod reports;
mod scaling;
mod tracking;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub(crate) use error::XtaskError;

/// Benchmarks, gates and chores of the pedicle workspace.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    BenchScenarios(bench::Arguments),
    BenchTotal(bench::total::Arguments),
    BenchPeers(peers::Arguments),
    BenchRegistration(registration::Arguments),
    BenchAnatomy(anatomy::Arguments),
    BenchImport(import::Arguments),
    BenchTracking(tracking::Arguments),
    Scaling(scaling::Arguments),
    CheckExchange(exchange::Arguments),
    MakePhantom(phantom::Arguments),
    CheckReports(reports::Arguments),
    CheckDocs(docs::Arguments),
    DrawPictures(docs::PictureArguments),
    Ci(ci::Arguments),
    /// One run of our side of `bench-peers`, in a process of its own.
    #[command(hide = true)]
    MeasurePair(peers::ChildArguments),
    /// One stage of `scaling`, in a process of its own.
    #[command(hide = true)]
    MeasureStage(scaling::ChildArguments),
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::BenchScenarios(arguments) => arguments.run(),
        Command::BenchTotal(arguments) => arguments.run(),
        Command::BenchPeers(arguments) => arguments.run(),
        Command::BenchRegistration(arguments) => arguments.run(),
        Command::BenchAnatomy(arguments) => arguments.run(),
        Command::BenchImport(arguments) => arguments.run(),
        Command::BenchTracking(arguments) => arguments.run(),
        Command::Scaling(arguments) => arguments.run(),
        Command::MeasurePair(arguments) => arguments.run(),
        Command::MeasureStage(arguments) => arguments.run(),
        Command::CheckExchange(arguments) => arguments.run(),
        Command::MakePhantom(arguments) => arguments.run(),
        Command::CheckReports(arguments) => arguments.run(),
        Command::CheckDocs(arguments) => arguments.run(),
        Command::DrawPictures(arguments) => arguments.run(),
        Command::Ci(arguments) => arguments.run(),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            complain(&format!("error: {error}"));
            ExitCode::from(2)
        }
    }
}

/// The root of the workspace, wherever the command is called from.
pub(crate) fn workspace_root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap_or(Path::new("."))
}

/// A file or folder of `fixtures/`.
pub(crate) fn fixture(name: &str) -> PathBuf {
    workspace_root().join("fixtures").join(name)
}

/// Prints to standard output. A closed pipe is not an error.
pub(crate) fn say(text: &str) {
    let _closed = writeln!(std::io::stdout(), "{text}");
}

/// Prints to standard error.
pub(crate) fn complain(text: &str) {
    let _closed = writeln!(std::io::stderr(), "{text}");
}
