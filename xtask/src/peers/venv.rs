//! The Python environment in which the peers run.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{XtaskError, say, workspace_root};

/// The interpreter to use: the one given, or that of `.venv` in the workspace, made if it is not
/// there yet and filled with what a file of requirements in `xtask/peers` asks for.
pub(crate) fn interpreter(given: Option<&Path>, requirements: &str) -> Result<PathBuf, XtaskError> {
    if let Some(path) = given {
        return Ok(path.to_owned());
    }
    let folder = workspace_root().join(".venv");
    let python = folder.join("bin").join("python");
    let requirements = peers_folder().join(requirements);
    if !python.is_file() {
        say("making a Python environment in .venv");
        run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    }
    // Fast where everything is there already.
    run(Command::new(&python)
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "-r",
        ])
        .arg(requirements))?;
    Ok(python)
}

/// Adds packages of which only the files are wanted: what they would pull in is not installed.
pub(crate) fn add_alone(python: &Path, requirements: &str) -> Result<(), XtaskError> {
    let options = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "-r",
    ];
    run(Command::new(python)
        .args(options)
        .arg(peers_folder().join(requirements)))
}

/// A script that runs peers.
pub(crate) fn driver(name: &str) -> PathBuf {
    peers_folder().join(name)
}

/// The package and its version, from the requirements.
pub(super) fn requirement() -> &'static str {
    include_str!("../../peers/requirements.txt").trim_ascii()
}

fn peers_folder() -> PathBuf {
    workspace_root().join("xtask").join("peers")
}

fn run(command: &mut Command) -> Result<(), XtaskError> {
    let line = format!("{command:?}");
    let output = command.output().map_err(|source| XtaskError::Command {
        command: line.clone(),
        source,
    })?;
    if output.status.success() {
        return Ok(());
    }
    Err(XtaskError::Child {
        command: line,
        status: output.status,
        message: String::from_utf8_lossy(&output.stderr).trim().to_owned(),
    })
}
