//! `cargo xtask check-reports`: every kind of report, opened in a real browser.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use clap::{Args, Parser as _};
use pedicle::commands::Cli;

use crate::measure::median;
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
    /// Fail also where a page opens in more than 2 seconds, turns at less than 5 pictures a second or adds
    /// more than half a second to a run; for a machine with nothing else to do.
    #[arg(long)]
    times: bool,
    /// Check nothing, but draw the picture of the README into this .png.
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// Longest that a report may add to a run, s, and the runs of either kind that are compared.
const MAX_REPORT_SECONDS: f64 = 0.5;
const RUNS: usize = 5;

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
        let is_quick = !self.times || {
            let seconds = report_seconds(&folder)?;
            say(&format!("a report adds {seconds:.2} s to a demo"));
            seconds < MAX_REPORT_SECONDS
        };
        Ok(run(&mut browser)? && same && is_quick)
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

/// Every kind of page, and the command that makes it but for `--report`.
fn commands(folder: &Path) -> Vec<(&'static str, Vec<String>)> {
    let at = |name: &str| folder.join(name).display().to_string();
    let bone = |level: &str| fixture("phantom").join(level).display().to_string();
    let phantom = fixture("phantom");
    let plan = phantom.join("plan.ron").display().to_string();
    let phantom = phantom.display().to_string();
    vec![
        ("demo.html", words(&["demo"])),
        (
            "transfer.html",
            words(&[
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
            ]),
        ),
        // So noisy that nothing may be accepted.
        ("rejected.html", words(&["demo", "--noise-mm", "3"])),
        (
            "map.html",
            words(&["map", &bone("L3.ply"), &bone("L4.ply"), "--functions", "60"]),
        ),
        (
            "plan.html",
            words(&["plan", &phantom, "--force", "-o", &at("plan.ron")]),
        ),
        ("check.html", words(&["check", &phantom, &plan])),
    ]
}

/// Makes every page, and all of them again on one thread; whether the bytes are the same.
fn make(folder: &Path) -> Result<bool, XtaskError> {
    let again = folder.join("again");
    empty(&again)?;
    let files = folder.join("files").display().to_string();
    pedicle(&words(&["demo", "--save", &files]))?;
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut all_same = true;
    for (name, command) in commands(folder) {
        let with_report = |page: PathBuf| {
            let mut command = command.clone();
            command.extend(words(&["--report", &page.display().to_string()]));
            command
        };
        pedicle(&with_report(folder.join(name)))?;
        one_thread.install(|| pedicle(&with_report(again.join(name))))?;
        all_same &= are_same(&folder.join(name), &again.join(name))?;
    }
    // Two that are compared, and one with times, which are never the same, to look at.
    let page = folder.join("bench.html");
    for (page, more) in [
        (again.join("bench-2.html"), ["--threads", "2"].as_slice()),
        (again.join("bench-1.html"), &["--threads", "1"]),
        (page, &["--report-times"]),
    ] {
        let program = std::env::current_exe().map_err(|source| XtaskError::Command {
            command: "this program".to_owned(),
            source,
        })?;
        run(Command::new(program)
            .args(["bench-scenarios", "--draws", "1"])
            .args(more)
            .arg("--report")
            .arg(page))?;
    }
    all_same &= are_same(&again.join("bench-1.html"), &again.join("bench-2.html"))?;
    Ok(all_same)
}

fn are_same(one: &Path, other: &Path) -> Result<bool, XtaskError> {
    let page = |path: &Path| {
        std::fs::read(path).map_err(|source| XtaskError::File {
            path: path.to_owned(),
            source,
        })
    };
    let are_same = page(one)? == page(other)?;
    if !are_same {
        let (one, other) = (one.display(), other.display());
        complain(&format!("{one} and {other}: the same seed, other bytes"));
    }
    Ok(are_same)
}

/// What the page adds to a demo: the medians of some runs with it and without.
fn report_seconds(folder: &Path) -> Result<f64, XtaskError> {
    let page = folder.join("timed.html");
    let mut with_page = demo(&page);
    with_page.push("--force".to_owned());
    let commands = [words(&["demo"]), with_page];
    let mut seconds = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        for (command, seconds) in commands.iter().zip(&mut seconds) {
            let start = Instant::now();
            pedicle(command)?;
            seconds.push(start.elapsed().as_secs_f64());
        }
    }
    let [without, with] = seconds.map(|seconds| median(&seconds));
    std::fs::remove_file(&page).map_err(|source| XtaskError::File { path: page, source })?;
    Ok(with - without)
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
