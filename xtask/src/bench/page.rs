//! The figures of a run as a page.

use pedicle_report::{Block, Page, Section, Table, Tone};
use pedicle_simulation::Suite;

use super::cell::Cell;
use super::page_figures::times;
use super::published;
use super::report::share;
use super::score::ScenarioScore;

/// One suite of a run.
pub(super) struct SuitePage<'a> {
    pub(super) suite: Suite,
    pub(super) scores: &'a [ScenarioScore],
    pub(super) cells: &'a [Cell],
}

/// What is on the page besides the figures.
pub(super) struct Heading<'a> {
    pub(super) spine: &'a str,
    pub(super) seed: u64,
    pub(super) draws: u32,
    /// Times differ from run to run, so they are only there where they were asked for.
    pub(super) has_times: bool,
}

pub(super) fn page(heading: &Heading<'_>, suites: &[SuitePage<'_>]) -> Page {
    let mut page = Page::new("Benchmark of plan transfers");
    page.subtitle = format!(
        "{}, {} draws a cell, seed {}",
        heading.spine, heading.draws, heading.seed
    );
    let cells = || suites.iter().flat_map(|s| s.cells);
    let sum = |f: fn(&Cell) -> usize| cells().map(f).sum::<usize>();
    let (all, valid) = (sum(|c| c.trajectories), sum(|c| c.valid_by_geometry));
    page.fact("trajectories", all.to_string(), None);
    page.fact("valid by geometry", share(valid, all), None);
    let vertebrae = sum(|c| c.vertebrae_total);
    page.fact(
        "vertebrae accepted",
        share(sum(|c| c.vertebrae_accepted), vertebrae),
        None,
    );
    let wrong = sum(|c| c.false_accepts);
    let tone = if wrong == 0 { Tone::Good } else { Tone::Bad };
    page.fact("false accepts", wrong.to_string(), Some(tone));
    for suite in suites {
        page.sections.extend(suite.sections());
    }
    if heading.has_times {
        let scores = suites.iter().flat_map(|s| s.scores).collect::<Vec<_>>();
        page.sections.push(times(&scores));
    }
    page
}

impl SuitePage<'_> {
    fn sections(&self) -> Vec<Section> {
        let mut sections = Vec::new();
        let id = |what: &str| format!("{}-{what}", self.suite);
        let title = |what: &str| format!("Suite {}: {what}", self.suite);
        if self.suite == Suite::Paper {
            sections.push(
                Section::new(&id("table"), &title("beside the published table"))
                    .with(Block::Text(
                        "Root mean square errors over the draws, in mm and degrees: ours, the published \
                         ones, and the Cramér-Rao bound, below which no unbiased method can be."
                            .to_owned(),
                    ))
                    .with(Block::Figures(vec![
                        self.cell_by_cell("mm", |c| c.0),
                        self.cell_by_cell("degrees", |c| c.1),
                    ]))
                    .with(Block::Table(self.published_table())),
            );
        }
        sections.push(
            Section::new(&id("errors"), &title("errors"))
                .with(Block::Figures(vec![
                    self.against_bound(),
                    self.target_errors(),
                ]))
                .with(Block::Table(self.error_table())),
        );
        sections.push(
            Section::new(&id("verdicts"), &title("verdicts"))
                .with(Block::Figures(vec![self.verdicts(), self.difficulty()])),
        );
        sections
    }

    /// Rows of a target, a noise level and a vertebra: ours, published, bound, (mm, degrees).
    pub(super) fn rows(&self) -> Vec<(String, [(f64, f64); 3])> {
        let missing = (f64::NAN, f64::NAN);
        self.cells
            .iter()
            .flat_map(|cell| {
                cell.vertebrae.iter().map(move |v| {
                    let name = format!("{} {} mm, {}", cell.deformation, cell.noise_mm, v.level);
                    let published =
                        published::figure(&cell.deformation, cell.noise_mm, v.level.index());
                    (
                        name,
                        [
                            (v.translation_rmse_mm, v.rotation_rmse_deg),
                            published.unwrap_or(missing),
                            (v.translation_bound_mm, v.rotation_bound_deg),
                        ],
                    )
                })
            })
            .collect()
    }

    fn published_table(&self) -> Table {
        let mut table = Table::new(
            "Every cell: ours / published / bound",
            &[
                "cell",
                "ours mm",
                "published mm",
                "bound mm",
                "ours °",
                "published °",
                "bound °",
            ],
        );
        for (name, figures) in self.rows() {
            let mut row = vec![name];
            row.extend(figures.map(|f| short(f.0)));
            row.extend(figures.map(|f| short(f.1)));
            table.push(row);
        }
        table
    }

    fn error_table(&self) -> Table {
        let mut table = Table::new(
            "Validity and acceptance",
            &[
                "cell",
                "trajectories",
                "by margin",
                "by geometry",
                "vertebrae",
                "accepted",
                "false accepts",
                "refused",
            ],
        );
        for cell in self.cells {
            table.push([
                format!("{} {} mm", cell.deformation, cell.noise_mm),
                cell.trajectories.to_string(),
                share(cell.valid_by_margin, cell.trajectories),
                share(cell.valid_by_geometry, cell.trajectories),
                cell.vertebrae_total.to_string(),
                share(cell.vertebrae_accepted, cell.vertebrae_total),
                cell.false_accepts.to_string(),
                cell.refused.to_string(),
            ]);
        }
        table
    }
}

/// Three digits, or a power of ten.
fn short(x: f64) -> String {
    if !x.is_finite() {
        "–".to_owned()
    } else if x < 0.001 && x > 0.0 {
        format!("{x:.0e}")
    } else {
        format!("{x:.3}")
    }
}
