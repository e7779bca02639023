//! Links of Markdown files: do the files and the headings exist?

use std::path::{Component, Path, PathBuf};

use super::{Document, lines_outside_fences};
use crate::workspace_root;

/// The table of contents of the book.
const SUMMARY: &str = "docs/SUMMARY.md";

/// A sentence for every link that leads nowhere.
pub(super) fn broken(documents: &[Document]) -> Vec<String> {
    let mut wrong = Vec::new();
    for document in documents {
        for (line, text) in lines_outside_fences(&document.text) {
            for target in targets(text) {
                if let Some(reason) = reason_against(document, target, documents) {
                    wrong.push(format!(
                        "{}:{}: {target}: {reason}",
                        document.path.display(),
                        line + 1
                    ));
                }
            }
        }
    }
    wrong
}

/// A sentence for every chapter that the summary does not name.
pub(super) fn not_in_summary(documents: &[Document]) -> Vec<String> {
    let summary = documents.iter().find(|d| d.path == Path::new(SUMMARY));
    let Some(summary) = summary else {
        return vec![format!("{SUMMARY} is not there")];
    };
    let named: Vec<&str> = summary.text.lines().flat_map(targets).collect();
    documents
        .iter()
        .filter(|d| d.path.starts_with("docs") && d.path != Path::new(SUMMARY))
        .filter_map(|d| d.path.file_name()?.to_str())
        .filter(|name| !named.contains(name))
        .map(|name| format!("{SUMMARY} does not name {name}"))
        .collect()
}

/// What stands in the parentheses of `[words](target)`.
fn targets(line: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = line;
    while let Some(at) = rest.find("](") {
        rest = &rest[at + 2..];
        let Some(end) = rest.find(')') else { break };
        found.push(&rest[..end]);
        rest = &rest[end..];
    }
    found
}

fn reason_against(document: &Document, target: &str, documents: &[Document]) -> Option<String> {
    if target.contains("://") || target.starts_with("mailto:") || target.starts_with('<') {
        return None;
    }
    let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
    let folder = document.path.parent().unwrap_or(Path::new(""));
    let path = if file.is_empty() {
        document.path.clone()
    } else {
        normalized(&folder.join(file))
    };
    let is_there =
        documents.iter().any(|d| d.path == path) || workspace_root().join(&path).exists();
    if path.is_absolute() || !is_there {
        return Some("there is no such file".to_owned());
    }
    if anchor.is_empty() {
        return None;
    }
    let other = documents.iter().find(|d| d.path == path)?;
    let has_heading = lines_outside_fences(&other.text)
        .filter(|(_, line)| line.starts_with('#'))
        .any(|(_, line)| heading_anchor(line) == anchor);
    (!has_heading).then(|| "there is no such heading".to_owned())
}

/// Without `..` where a folder goes before it.
fn normalized(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                out.pop();
            }
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

/// The anchor that renderers give a heading.
fn heading_anchor(line: &str) -> String {
    line.trim_start_matches('#')
        .trim()
        .chars()
        .filter_map(|c| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => c.to_lowercase().next(),
            _ => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(path: &str, text: &str) -> Document {
        Document {
            path: path.into(),
            text: text.to_owned(),
        }
    }

    #[test]
    fn links_that_lead_nowhere_are_named() {
        let page = document(
            "docs/page.md",
            "# A page, of links\n[a](../README.md) [b](nowhere.md) [c](#a-page-of-links) [d](#no)\n\
             [e](https://example.org/x)\n```\n[f](in-a-block.md)\n```\n",
        );
        let wrong = broken(&[page]);
        assert_eq!(wrong.len(), 2, "{wrong:?}");
        assert!(wrong[0].contains("docs/page.md:2: nowhere.md"), "{wrong:?}");
        assert!(wrong[1].contains("no such heading"), "{wrong:?}");
    }

    #[test]
    fn a_chapter_that_is_not_in_the_summary_is_named() {
        let summary = document(SUMMARY, "- [One](one.md)\n");
        let documents = [
            summary,
            document("docs/one.md", ""),
            document("docs/two.md", ""),
        ];
        let wrong = not_in_summary(&documents);
        assert_eq!(
            wrong,
            ["docs/SUMMARY.md does not name two.md"],
            "one of two"
        );
    }
}
