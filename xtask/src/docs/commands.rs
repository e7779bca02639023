//! Commands of Markdown files, run as a reader would.

use std::process::{Command, Stdio};

use super::Document;
use crate::{XtaskError, complain, say, workspace_root};

/// Longest that one block may take, in the words of `timeout`.
const TIME_LIMIT: &str = "900";

/// A fenced block of shell commands.
struct Block<'a> {
    line: usize,
    /// Why it is not run; none if it is.
    norun: Option<&'a str>,
    script: String,
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
    let (mut n_run, mut n_left, mut all_well) = (0, 0, true);
    for document in documents {
        let blocks = blocks(&document.text);
        if blocks.iter().all(|block| block.norun.is_some()) {
            n_left += blocks.len();
            continue;
        }
        let folder = folder_of(document)?;
        for block in blocks {
            let place = format!("{}:{}", document.path.display(), block.line);
            if let Some(reason) = block.norun {
                say(&format!("{place}: not run: {reason}"));
                n_left += 1;
                continue;
            }
            say(&format!("--- {place}\n{}", block.script.trim_end()));
            let start = std::time::Instant::now();
            let output = Command::new("timeout")
                .args([TIME_LIMIT, "bash", "-euo", "pipefail", "-c", &block.script])
                .current_dir(&folder)
                .env("PATH", &path)
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
    say(&format!(
        "{n_run} blocks of commands run, {n_left} marked as not to be run"
    ));
    Ok(all_well)
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
                _ if info == "sh" => open = Some(block(number, None)),
                Some(("sh", rest)) => {
                    let reason = rest.strip_prefix("norun:").map_or(rest, str::trim);
                    open = Some(block(number, Some(reason)));
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

fn block(number: usize, norun: Option<&str>) -> Block<'_> {
    Block {
        line: number + 1,
        norun,
        script: String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_shell_blocks_are_commands() {
        let text = "```sh\ntrue\n```\n```rust\nfn main() {}\n```\n```sh norun: needs a network\ncurl\n```\n";
        let found = blocks(text);
        assert_eq!(found.len(), 2, "two of three");
        assert_eq!(
            (found[0].script.as_str(), found[0].norun),
            ("true\n", None),
            "run"
        );
        assert_eq!(found[1].norun, Some("needs a network"), "and why");
        assert_eq!(found[1].line, 7, "where");
    }
}
