//! `cargo xtask ci`: everything that must hold before a change lands.

use std::process::Command;

use clap::Args;

use crate::{XtaskError, complain, fixture, say, workspace_root};

/// Run what .ci/run runs: format, lints, tests, documentation, other people's readers on our files, a
/// reduced benchmark of the published suite on the phantom and, where they are, on the real spines, one
/// of every suite on the phantom, the links and commands of the book, and the reports in a browser.
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
        // Everything in the profile that the benchmark needs anyway, so that nothing is compiled twice.
        let mut steps: Vec<(&str, Vec<String>, Option<&str>)> = vec![
            ("format", words("cargo fmt --all -- --check"), None),
            (
                "lints",
                words("cargo clippy --workspace --all-targets --release --locked -- -D warnings"),
                None,
            ),
            (
                "tests",
                words("cargo test --workspace --release --locked"),
                None,
            ),
            (
                "documentation",
                words("cargo doc --workspace --no-deps --release --locked"),
                Some("-D warnings"),
            ),
            ("exchange", words("cargo xtask check-exchange"), None),
        ];
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
        for spine in &spines {
            let mut command = words("cargo xtask bench-scenarios --draws");
            command.extend([DRAWS.to_owned(), "--spine".to_owned(), spine.clone()]);
            steps.push(("benchmark", command, None));
        }
        steps.push((
            "benchmark",
            words("cargo xtask bench-scenarios --suite all --draws 1"),
            None,
        ));
        steps.push(("book and READMEs", words("cargo xtask check-docs"), None));
        steps.push(("reports", words("cargo xtask check-reports"), None));
        for (what, command, rustdocflags) in steps {
            if !step(what, &command, rustdocflags)? {
                complain(&format!("{what} failed: {}", command.join(" ")));
                return Ok(false);
            }
        }
        say("everything holds");
        Ok(true)
    }
}

fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(String::from).collect()
}

fn step(what: &str, words: &[String], rustdocflags: Option<&str>) -> Result<bool, XtaskError> {
    say(&format!("--- {what}: {}", words.join(" ")));
    let mut command = Command::new(&words[0]);
    command.args(&words[1..]).current_dir(workspace_root());
    if let Some(flags) = rustdocflags {
        command.env("RUSTDOCFLAGS", flags);
    }
    let start = std::time::Instant::now();
    let status = command.status().map_err(|source| XtaskError::Command {
        command: words.join(" "),
        source,
    })?;
    say(&format!(
        "--- {what}: {:.0} s",
        start.elapsed().as_secs_f64()
    ));
    Ok(status.success())
}
