//! `cargo xtask check-reports`: every kind of report, opened in a real browser.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::{Args, Parser as _};
use pedicle::commands::Cli;

use crate::peers::venv;
use crate::{XtaskError, complain, fixture, say, workspace_root};

/// Make every kind of report and check it in headless Chromium: console, colours, switches, keyboard,
/// touch, saved files, accessibility, bytes.
///
/// Needs chromium and chromium-driver (Debian's names), python3 with venv, and the network once.
/// Screenshots are left beside the reports.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Where reports and screenshots go; target/reports by default.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Python with selenium and pillow; without it an environment is made in .venv.
    #[arg(long, value_name = "PATH")]
    python: Option<PathBuf>,
    /// Fail also where a page opens in more than 2 seconds or turns at less than 5 pictures a second; for
    /// a machine with nothing else to do.
    #[arg(long)]
    times: bool,
    /// Check nothing, but draw the picture of the README into this .png.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// Largest picture of the README, bytes.
const MAX_PICTURE: u64 = 300_000;

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let folder = self
            .folder
            .clone()
            .unwrap_or_else(|| workspace_root().join("target").join("reports"));
        empty(&folder)?;
        let python = venv::interpreter(self.python.as_deref(), "requirements-reports.txt")?;
        venv::add_alone(&python, "requirements-axe.txt")?;
        let mut browser = Command::new(&python);
        browser.arg(venv::driver("reports.py")).arg(&folder);
        if let Some(picture) = &self.picture {
            pedicle(&demo(&folder.join("demo.html")))?;
            browser.arg(picture);
            return Ok(run(&mut browser)? && is_small(picture)?);
        }
        if self.times {
            browser.arg("--times");
        }
        let same = make(&folder)?;
        if !same {
            complain("the same seed gave another page");
        }
        Ok(run(&mut browser)? && same)
    }
}

/// An empty folder.
fn empty(folder: &Path) -> Result<(), XtaskError> {
    let failed = |source| XtaskError::File {
        path: folder.to_owned(),
        source,
    };
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(failed)?;
    }
    std::fs::create_dir_all(folder).map_err(failed)
}

fn is_small(picture: &Path) -> Result<bool, XtaskError> {
    let size = std::fs::metadata(picture)
        .map_err(|source| XtaskError::File {
            path: picture.to_owned(),
            source,
        })?
        .len();
    say(&format!("{}: {size} bytes", picture.display()));
    Ok(size <= MAX_PICTURE)
}

fn demo(page: &Path) -> Vec<String> {
    words(&["demo", "--report", &page.display().to_string()])
}

fn words(line: &[&str]) -> Vec<String> {
    line.iter().map(|&word| word.to_owned()).collect()
}

/// Every kind of page; whether the same seed gives the same bytes.
fn make(folder: &Path) -> Result<bool, XtaskError> {
    let at = |name: &str| folder.join(name).display().to_string();
    let again = folder.join("again").join("demo.html");
    empty(&folder.join("again"))?;
    let mut first = demo(&folder.join("demo.html"));
    first.extend(words(&["--save", &at("files")]));
    pedicle(&first)?;
    pedicle(&demo(&again))?;
    let page = |path: &Path| {
        std::fs::read(path).map_err(|source| XtaskError::File {
            path: path.to_owned(),
            source,
        })
    };
    let same = page(&folder.join("demo.html"))? == page(&again)?;
    pedicle(&words(&[
        "transfer",
        "--source",
        &at("files/source"),
        "--plan",
        &at("files/plan.ron"),
        "--source-landmarks",
        &at("files/source-landmarks.ron"),
        "--target",
        &at("files/target.ply"),
        "--target-landmarks",
        &at("files/target-landmarks.ron"),
        "--report",
        &at("transfer.html"),
    ]))?;
    // So noisy that nothing may be accepted.
    pedicle(&words(&[
        "demo",
        "--noise-mm",
        "3",
        "--report",
        &at("rejected.html"),
    ]))?;
    let bone = |level: &str| fixture("phantom").join(level).display().to_string();
    pedicle(&words(&[
        "map",
        &bone("L3.ply"),
        &bone("L4.ply"),
        "--functions",
        "60",
        "--report",
        &at("map.html"),
    ]))?;
    let phantom = fixture("phantom");
    pedicle(&words(&[
        "check",
        &phantom.display().to_string(),
        &phantom.join("plan.ron").display().to_string(),
        "--report",
        &at("check.html"),
    ]))?;
    let program = std::env::current_exe().map_err(|source| XtaskError::Command {
        command: "this program".to_owned(),
        source,
    })?;
    run(Command::new(program)
        .args([
            "bench-scenarios",
            "--draws",
            "1",
            "--report-times",
            "--report",
        ])
        .arg(folder.join("bench.html")))?;
    Ok(same)
}

/// Runs a command of the program in this process; its exit code is a verdict, not an error.
fn pedicle(arguments: &[String]) -> Result<(), XtaskError> {
    let line = std::iter::once("pedicle").chain(arguments.iter().map(String::as_str));
    say(&format!("--- pedicle {}", arguments.join(" ")));
    let cli = Cli::try_parse_from(line).map_err(|error| XtaskError::Stage {
        stage: arguments.join(" "),
        reason: error.to_string(),
    })?;
    cli.run()?;
    Ok(())
}

fn run(command: &mut Command) -> Result<bool, XtaskError> {
    let status = command.status().map_err(|source| XtaskError::Command {
        command: format!("{command:?}"),
        source,
    })?;
    Ok(status.success())
}
