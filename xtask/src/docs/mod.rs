//! `cargo xtask check-docs` and `draw-pictures`: the book, the READMEs and their pictures.

mod commands;
mod links;
mod pictures;

use std::path::{Path, PathBuf};

use clap::Args;

use crate::{XtaskError, complain, say, workspace_root};

pub(crate) use pictures::Arguments as PictureArguments;

/// Check every link of the READMEs and the book, that every chapter is in the summary, that the pictures
/// are those of today, and run their commands: blocks marked `sh`, those marked `sh shorter: EXPRESSION`
/// after sed made them shorter, but not those marked `sh norun: REASON`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Check links only.
    #[arg(long)]
    links_only: bool,
}

/// A document with its text.
pub(crate) struct Document {
    /// Relative to the root of the workspace.
    pub(crate) path: PathBuf,
    pub(crate) text: String,
}

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let documents = documents()?;
        let mut wrong = links::broken(&documents);
        wrong.extend(links::not_in_summary(&documents));
        for sentence in &wrong {
            complain(sentence);
        }
        say(&format!(
            "{} documents, {} wrong links",
            documents.len(),
            wrong.len()
        ));
        if !wrong.is_empty() || self.links_only {
            return Ok(wrong.is_empty());
        }
        let stale = pictures::out_of_date()?;
        for sentence in &stale {
            complain(sentence);
        }
        Ok(commands::run_all(&documents)? && stale.is_empty())
    }
}

/// READMEs, the book, and what stands beside the README.
fn documents() -> Result<Vec<Document>, XtaskError> {
    let root = workspace_root();
    let mut folders = vec![PathBuf::new(), "docs".into(), "fixtures".into()];
    let crates = entries(&root.join("crates"))?;
    folders.extend(
        crates
            .into_iter()
            .map(|name| Path::new("crates").join(name)),
    );
    let mut documents = Vec::new();
    for folder in folders {
        for name in entries(&root.join(&folder))? {
            let path = folder.join(&name);
            if path.extension().is_some_and(|e| e == "md") {
                let text = std::fs::read_to_string(root.join(&path)).map_err(|source| {
                    XtaskError::File {
                        path: path.clone(),
                        source,
                    }
                })?;
                documents.push(Document { path, text });
            }
        }
    }
    Ok(documents)
}

/// Names in a folder, in order.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, XtaskError> {
    let failed = |source| XtaskError::File {
        path: folder.to_owned(),
        source,
    };
    let mut names = std::fs::read_dir(folder)
        .map_err(failed)?
        .map(|entry| entry.map(|e| PathBuf::from(e.file_name())))
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    names.sort();
    Ok(names)
}

/// The lines of a document with whether each is inside a fenced block.
pub(crate) fn lines_outside_fences(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut inside = false;
    text.lines().enumerate().filter(move |(_, line)| {
        if line.trim_start().starts_with("```") {
            inside = !inside;
            return false;
        }
        !inside
    })
}
