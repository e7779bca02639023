//! Commands of Markdown files, run as a reader would.
//!
//! A block marked `sh shorter: EXPRESSION` goes through `sed` first: what takes long gets smaller numbers,
//! what the reader has gets a stand-in. `$ROOT` is the root of the workspace, `$DATA` the folder of the real
//! spines, without which blocks that name it are not run.

use std::io::Write;
use std::process::{Command, Stdio};

use super::Document;
use crate::{XtaskError, complain, say, workspace_root};

/// Longest that one block may take, in the words of `timeout`.
const TIME_LIMIT: &str = "900";

/// A fenced block of shell commands.
struct Block<'a> {
    line: usize,
    way: Way<'a>,
    script: String,
}

/// How a block is run.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way<'a> {
    AsItIs,
    /// What `sed` makes of it.
    Shorter(&'a str),
    /// Not at all, and why.
    Norun(&'a str),
}

/// Runs every block of every document, each document in a folder of its own inside `target`, so that
/// cargo finds the workspace and nothing is left beside the sources.
pub(super) fn run_all(documents: &[Document]) -> Result<bool, XtaskError> {
    let build = ["build", "--release", "--locked", "--bin", "pedicle"];
    let built = Command::new("cargo")
        .args(build)
        .current_dir(workspace_root())
        .status();
    let failed = |command: &str| {
        let command = command.to_owned();
        move |source| XtaskError::Command { command, source }
    };
    if !built.map_err(failed("cargo build"))?.success() {
        return Ok(false);
    }
    let release = workspace_root().join("target").join("release");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::iter::once(release).chain(std::env::split_paths(&path));
    let path = std::env::join_paths(paths).unwrap_or(path);
    let data = workspace_root().join("../shared/data");
    let (mut n_run, mut n_left, mut all_well) = (0, 0, true);
    for document in documents {
        let blocks = blocks(&document.text);
        if blocks.is_empty() {
            continue;
        }
        let folder = folder_of(document)?;
        for block in blocks {
            let place = format!("{}:{}", document.path.display(), block.line);
            let (script, missing) = match block.way {
                Way::AsItIs => (block.script, None),
                Way::Shorter(expression) => (edited(&block.script, expression)?, None),
                Way::Norun(reason) => (block.script, Some(reason)),
            };
            let no_data = script.contains("$DATA") && !data.is_dir();
            if let Some(reason) = missing.or(no_data.then_some("the real spines are not there")) {
                say(&format!("{place}: not run: {reason}"));
                n_left += 1;
                continue;
            }
            say(&format!("--- {place}\n{}", script.trim_end()));
            let start = std::time::Instant::now();
            let output = Command::new("timeout")
                .args([TIME_LIMIT, "bash", "-euo", "pipefail", "-c", &script])
                .current_dir(&folder)
                .env("PATH", &path)
                .env("ROOT", workspace_root())
                .env("DATA", &data)
                .stdin(Stdio::null())
                .output()
                .map_err(failed("bash"))?;
            n_run += 1;
            say(&format!("{:.0} s", start.elapsed().as_secs_f64()));
            if !output.status.success() {
                let said = String::from_utf8_lossy(&output.stderr);
                complain(&format!("{place}: {}\n{}", output.status, said.trim_end()));
                all_well = false;
            }
        }
    }
    say(&format!("{n_run} blocks of commands run, {n_left} not"));
    Ok(all_well)
}

/// A script after `sed`; an expression that changes nothing is out of date.
fn edited(script: &str, expression: &str) -> Result<String, XtaskError> {
    let failed = |source| XtaskError::Command {
        command: format!("sed '{expression}'"),
        source,
    };
    let mut sed = Command::new("sed")
        .args(["-E", expression])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    if let Some(mut input) = sed.stdin.take() {
        input.write_all(script.as_bytes()).map_err(failed)?;
    }
    let output = sed.wait_with_output().map_err(failed)?;
    let edited = String::from_utf8_lossy(&output.stdout).into_owned();
    if !output.status.success() || edited == script {
        let reason = format!("sed '{expression}' leaves it as it is:\n{script}");
        let stage = "commands of the documents".to_owned();
        return Err(XtaskError::Stage { stage, reason });
    }
    Ok(edited)
}

fn folder_of(document: &Document) -> Result<std::path::PathBuf, XtaskError> {
    let name = document.path.display().to_string().replace(['/', '.'], "-");
    let folder = workspace_root()
        .join("target")
        .join("docs-commands")
        .join(name);
    let failed = |source| XtaskError::File {
        path: folder.clone(),
        source,
    };
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(failed)?;
    }
    std::fs::create_dir_all(&folder).map_err(failed)?;
    // What the commands name relative to the root of the workspace.
    #[cfg(unix)]
    std::os::unix::fs::symlink(workspace_root().join("fixtures"), folder.join("fixtures"))
        .map_err(failed)?;
    Ok(folder)
}

fn blocks(text: &str) -> Vec<Block<'_>> {
    let mut found = Vec::new();
    let mut open: Option<Block<'_>> = None;
    let mut is_other = false;
    for (number, line) in text.lines().enumerate() {
        let fence = line.trim_start().strip_prefix("```");
        match (fence, &mut open) {
            (Some(_), Some(_)) => found.extend(open.take()),
            (Some(info), None) if !is_other => match info.split_once(' ') {
                _ if info == "sh" => open = Some(block(number, Way::AsItIs)),
                Some(("sh", rest)) => {
                    let way = match rest.split_once(':') {
                        Some(("shorter", expression)) => Way::Shorter(expression.trim()),
                        Some(("norun", reason)) => Way::Norun(reason.trim()),
                        _ => Way::Norun(rest),
                    };
                    open = Some(block(number, way));
                }
                _ => is_other = true,
            },
            (Some(_), None) => is_other = false,
            (None, Some(block)) => {
                block.script.push_str(line);
                block.script.push('\n');
            }
            (None, None) => {}
        }
    }
    found
}

fn block(number: usize, way: Way<'_>) -> Block<'_> {
    Block {
        line: number + 1,
        way,
        script: String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_shell_blocks_are_commands() {
        let text = "```sh\ntrue\n```\n```rust\nfn main() {}\n```\n```sh norun: no network\ncurl\n```\n\
                    ```sh shorter: s/9/1/\nsleep 9\n```\n";
        let found = blocks(text);
        assert_eq!(found.len(), 3, "three of four");
        assert_eq!(
            (found[0].script.as_str(), found[0].way),
            ("true\n", Way::AsItIs),
            "run"
        );
        assert_eq!(found[1].way, Way::Norun("no network"), "and why");
        assert_eq!(found[1].line, 7, "where");
        assert_eq!(found[2].way, Way::Shorter("s/9/1/"), "what sed is given");
        assert_eq!(edited(&found[2].script, "s/9/1/").unwrap(), "sleep 1\n");
        assert!(edited(&found[2].script, "s/8/1/").is_err(), "out of date");
    }
}
