//! `cargo xtask ci`: everything that must hold before a change lands.
//!
//! Two lanes beside each other: what holds cargo's lock on the build folder, and what waits for the network
//! and for a browser. After a failure no lane begins another step.

use std::io::{Read, Seek};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Args;

use crate::{XtaskError, complain, fixture, say, workspace_root};

/// Run what .ci/run runs: format, lints, tests, documentation, and the links and commands of the book;
/// beside them, other people's readers on our files, the reports in a browser, a reduced benchmark of the
/// published suite on the phantom and, where they are, on the real spines, and one of every suite on the
/// phantom.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder with the real spines, ../shared/data beside the checkout by default; skipped, with
    /// a word, if it is not there.
    #[arg(long, value_name = "DIR")]
    data: Option<std::path::PathBuf>,
}

/// Draws a cell of the reduced benchmark.
const DRAWS: &str = "3";

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        // The steps run in the root of the workspace, wherever this one was called from.
        let data = match self.data {
            Some(data) => std::path::absolute(&data)
                .map_err(|source| XtaskError::File { path: data, source })?,
            None => workspace_root().join("../shared/data"),
        };
        let mut spines = vec![fixture("phantom").display().to_string()];
        for spine in ["vhp-male-remus", "verse010"] {
            let path = data.join(spine);
            if path.is_dir() {
                spines.push(path.display().to_string());
            } else {
                say(&format!(
                    "{}: not there, its benchmark is skipped",
                    path.display()
                ));
            }
        }
        let first = [
            Step::new("format", "cargo fmt --all -- --check"),
            // Both lanes need it.
            Step::new("program", "cargo build --release --locked --bin pedicle"),
        ];
        let held =
            beside_each_other(&first, &[])? && beside_each_other(&builds(), &programs(&spines)?)?;
        if held {
            say("everything holds");
        }
        Ok(held)
    }
}

/// What builds: in the profile that the benchmark needs anyway, so that nothing is compiled twice.
fn builds() -> Vec<Step> {
    vec![
        Step::new(
            "lints",
            "cargo clippy --workspace --all-targets --release --locked -- -D warnings",
        ),
        Step::new("tests", "cargo test --workspace --release --locked"),
        Step {
            rustdocflags: Some("-D warnings"),
            ..Step::new(
                "documentation",
                "cargo doc --workspace --no-deps --release --locked",
            )
        },
        Step::new("book and READMEs", "cargo xtask check-docs"),
    ]
}

/// What only runs: by this program itself, for cargo would wait for the other lane.
fn programs(spines: &[String]) -> Result<Vec<Step>, XtaskError> {
    let this = std::env::current_exe().map_err(|source| XtaskError::Command {
        command: "this program".to_owned(),
        source,
    })?;
    let pedicle = this.with_file_name(format!("pedicle{}", std::env::consts::EXE_SUFFIX));
    let this = this.display().to_string();
    let step = |what, arguments: &str| {
        let mut step = Step::new(what, arguments);
        step.words.insert(0, this.clone());
        step
    };
    // What is installed in .venv comes first: the book installs there as well.
    let mut exchange = step("exchange", "check-exchange --program");
    exchange.words.push(pedicle.display().to_string());
    let mut steps = vec![exchange, step("reports", "check-reports")];
    for spine in spines {
        let mut benchmark = step("benchmark", "bench-scenarios --draws");
        let more = [DRAWS.to_owned(), "--spine".to_owned(), spine.clone()];
        benchmark.words.extend(more);
        steps.push(benchmark);
    }
    steps.push(step("benchmark", "bench-scenarios --suite all --draws 1"));
    Ok(steps)
}

/// A command with a name.
struct Step {
    what: &'static str,
    words: Vec<String>,
    rustdocflags: Option<&'static str>,
}

impl Step {
    fn new(what: &'static str, line: &str) -> Self {
        Self {
            what,
            words: line.split_whitespace().map(String::from).collect(),
            rustdocflags: None,
        }
    }
}

/// When the output of a step is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Output {
    AtOnce,
    /// Whole, when the step has ended.
    AtItsEnd,
}

/// Steps one after the other.
struct Lane<'a> {
    output: Output,
    /// Whether a step of any lane has failed.
    has_failed: &'a AtomicBool,
}

fn beside_each_other(builds: &[Step], programs: &[Step]) -> Result<bool, XtaskError> {
    let has_failed = AtomicBool::new(false);
    let lane = |output| Lane {
        output,
        has_failed: &has_failed,
    };
    let (one, other) = std::thread::scope(|scope| {
        let other = scope.spawn(|| lane(Output::AtItsEnd).run(programs));
        let one = lane(Output::AtOnce).run(builds);
        (one, other.join())
    });
    let other = other.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    Ok(one? & other?)
}

impl Lane<'_> {
    /// Whether all steps held; false also where another lane's failure ended this one.
    fn run(&self, steps: &[Step]) -> Result<bool, XtaskError> {
        for step in steps {
            if self.has_failed.load(Ordering::Relaxed) {
                return Ok(false);
            }
            let held = step.run(self.output);
            if !matches!(held, Ok(true)) {
                self.has_failed.store(true, Ordering::Relaxed);
                complain(&format!("{} failed: {}", step.what, step.words.join(" ")));
                return held;
            }
        }
        Ok(true)
    }
}

impl Step {
    fn run(&self, output: Output) -> Result<bool, XtaskError> {
        let line = self.words.join(" ");
        let failed = |source| XtaskError::Command {
            command: line.clone(),
            source,
        };
        let mut command = Command::new(&self.words[0]);
        command.args(&self.words[1..]).current_dir(workspace_root());
        if let Some(flags) = self.rustdocflags {
            command.env("RUSTDOCFLAGS", flags);
        }
        let start = Instant::now();
        let (is_well, text) = match output {
            Output::AtOnce => {
                say(&format!("--- {}: {line}", self.what));
                (command.status().map_err(failed)?.success(), String::new())
            }
            Output::AtItsEnd => {
                // One file for both, so that lines stay in their order.
                let mut file = tempfile::tempfile().map_err(failed)?;
                command
                    .stdout(file.try_clone().map_err(failed)?)
                    .stderr(file.try_clone().map_err(failed)?);
                let is_well = command.status().map_err(failed)?.success();
                let mut bytes = Vec::new();
                file.rewind().map_err(failed)?;
                file.read_to_end(&mut bytes).map_err(failed)?;
                let text = String::from_utf8_lossy(&bytes);
                (
                    is_well,
                    format!("--- {}: {line}\n{}\n", self.what, text.trim_end()),
                )
            }
        };
        let seconds = start.elapsed().as_secs_f64();
        say(&format!("{text}--- {}: {seconds:.0} s", self.what));
        Ok(is_well)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lanes(builds: &[&str], programs: &[&str]) -> Result<bool, XtaskError> {
        let steps = |lines: &[&str]| -> Vec<Step> {
            lines
                .iter()
                .map(|line| Step::new("a step of a test", line))
                .collect()
        };
        beside_each_other(&steps(builds), &steps(programs))
    }

    #[test]
    fn a_failure_in_either_lane_is_one_of_the_run() {
        assert!(lanes(&["true"], &["true", "true"]).unwrap(), "all well");
        assert!(!lanes(&["true", "false"], &["true"]).unwrap(), "the first");
        assert!(!lanes(&["true"], &["true", "false"]).unwrap(), "the second");
        assert!(lanes(&["true"], &["no-such-program"]).is_err(), "neither");
    }

    #[test]
    fn nothing_begins_after_a_failure() {
        let folder = tempfile::tempdir().unwrap();
        let mark = folder.path().join("mark");
        let touch = format!("touch {}", mark.display());
        assert!(!lanes(&["false", &touch], &[]).unwrap(), "failed");
        assert!(!mark.exists(), "a step after it");
        // The other lane is still asleep when the first fails.
        assert!(!lanes(&["false"], &["sleep 1", &touch]).unwrap(), "failed");
        assert!(!mark.exists(), "a step beside it");
    }
}
