//! `cargo xtask draw-pictures`: the figures of the book, from the phantom.

use std::path::PathBuf;

use clap::Args;
use pedicle::report::{TransferReport, transfer_page};
use pedicle_report::chart::standalone;
use pedicle_report::{Block, Figure, Page};
use pedicle_simulation::{Deformation, Scenario, simulate};
use pedicle_spine::{Target, TransferOptions, transfer};

use crate::bench::case;
use crate::{XtaskError, fixture, say, workspace_root};

/// Draw the figures of the book anew: one transfer on the phantom, a partial target with 1 mm of noise.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Where they go; docs/pictures by default.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// Titles of the figures of a report, and the files that they become.
const PICTURES: [(&str, &str); 4] = [
    ("L4 left clearance", "clearance.svg"),
    ("L4 left isthmus", "isthmus.svg"),
    ("Functional map C", "functional-map.svg"),
    ("Eigenvalues", "eigenvalues.svg"),
];

impl Arguments {
    pub(crate) fn run(self) -> Result<bool, XtaskError> {
        let folder = self
            .folder
            .unwrap_or_else(|| workspace_root().join("docs").join("pictures"));
        std::fs::create_dir_all(&folder).map_err(|source| XtaskError::File {
            path: folder.clone(),
            source,
        })?;
        for (name, svg) in drawn()? {
            let path = folder.join(name);
            pedicle::write_text(&path, &svg)?;
            say(&format!("{}", path.display()));
        }
        Ok(true)
    }
}

/// Sentences about pictures of the book that reports no longer draw like this.
///
/// Words, colours and parts are compared, not lengths: another processor may round the last digit the
/// other way.
pub(super) fn out_of_date() -> Result<Vec<String>, XtaskError> {
    let mut wrong = Vec::new();
    for (name, svg) in drawn()? {
        let path = workspace_root().join("docs").join("pictures").join(name);
        let there = std::fs::read_to_string(&path).map_err(|source| XtaskError::File {
            path: path.clone(),
            source,
        })?;
        if without_numbers(&there) != without_numbers(&svg) {
            wrong.push(format!(
                "docs/pictures/{name} is not what is drawn today: cargo xtask draw-pictures"
            ));
        }
    }
    Ok(wrong)
}

/// File name and text of every picture.
fn drawn() -> Result<Vec<(&'static str, String)>, XtaskError> {
    let page = page()?;
    let draw = |(title, name)| {
        let figure = figures(&page).find(|figure| figure.title == title);
        let figure = figure.ok_or_else(|| XtaskError::Stage {
            stage: "pictures".to_owned(),
            reason: format!("the report has no figure '{title}'"),
        })?;
        Ok((name, standalone(&figure.svg)))
    };
    PICTURES.into_iter().map(draw).collect()
}

/// A drawing without its numbers and its paths.
fn without_numbers(svg: &str) -> String {
    let mut pieces = svg.split(" d=\"");
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        text.push_str(piece.split_once('"').map_or("", |(_, rest)| rest));
    }
    text.retain(|c| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '−')));
    text
}

fn page() -> Result<Page, XtaskError> {
    let case = case::load(&fixture("phantom"), &case::Given::default())?;
    let model = case.model()?;
    let scenario = Scenario {
        deformation: Deformation::Partial,
        noise_mm: 1.0,
        draw: 0,
        seed: 1,
    };
    let simulated = simulate(&case.spine, &scenario)?;
    let target = Target::mesh(simulated.mesh.clone(), simulated.target_landmarks.clone());
    let result =
        transfer(&model, &case.plan, &target, &TransferOptions::default()).map_err(|error| {
            XtaskError::Model {
                spine: case.name.clone(),
                error: Box::new(error),
            }
        })?;
    let truth: Vec<_> = simulated
        .truth
        .iter()
        .map(|t| t.target_from_source)
        .collect();
    Ok(transfer_page(&TransferReport {
        subtitle: "",
        source: &case.vertebrae,
        model: &model,
        plan: &case.plan,
        target: &target,
        transfer: &result,
        truth: Some(&truth),
    }))
}

fn figures(page: &Page) -> impl Iterator<Item = &Figure> {
    let blocks = page.sections.iter().flat_map(|section| &section.blocks);
    blocks.flat_map(|block| match block {
        Block::Figures(figures) => figures.iter().collect(),
        Block::Cards(cards) => cards.iter().flat_map(|card| &card.figures).collect(),
        _ => Vec::new(),
    })
}

#[cfg(test)]
mod tests {
    use super::without_numbers;

    #[test]
    fn numbers_are_nothing_and_words_are_something() {
        let one = "<path class=\"a\" d=\"M1 2L3 4\"/><text x=\"-1.5\">left</text>";
        let other = "<path class=\"a\" d=\"M9\"/><text x=\"7\">left</text>";
        assert_eq!(without_numbers(one), without_numbers(other));
        let renamed = one.replace("left", "right");
        assert_ne!(without_numbers(one), without_numbers(&renamed));
    }
}
