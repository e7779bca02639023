//! Gates: the worst figures that a cell may show before the benchmark fails.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::cell::Cell;
use super::published;
use super::suite_gates::{self, SuiteGate};
use crate::XtaskError;

/// Name of the gates that hold for a spine without gates of its own.
const ANY_SPINE: &str = "any";
/// New gates leave this factor above what was measured: fewer draws scatter more.
const SLACK: f64 = 1.5;
/// Share of the vertebrae that every spine must have accepted, and what new gates leave below the
/// measured share: noise alone rejects one now and then.
const MIN_ACCEPTED: f64 = 0.98;
const ACCEPTED_SLACK: f64 = 0.01;
/// Largest error allowed in cells without noise: (mm, degrees) of whole and of partial targets.
const CLEAN_LIMIT: [f64; 2] = [0.01, 0.05];

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Gates {
    cells: Vec<Gate>,
    /// Of the suites beyond the published one; written by hand.
    #[serde(default)]
    suites: Vec<SuiteGate>,
}

/// The gate of one cell of one spine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Gate {
    spine: String,
    deformation: String,
    noise_mm: f64,
    /// Mean over the vertebrae.
    max_translation_rmse_mm: f64,
    max_rotation_rmse_deg: f64,
    /// Shares of the trajectories, 1 for all of them.
    min_valid_by_margin: f64,
    min_valid_by_geometry: f64,
    /// Share of the vertebrae, 1 for all of them.
    min_vertebrae_accepted: f64,
    max_false_accepts: usize,
}

impl Gates {
    /// Reads the file.
    pub(super) fn read(path: &Path) -> Result<Self, XtaskError> {
        let text = std::fs::read_to_string(path).map_err(|source| XtaskError::File {
            path: path.to_owned(),
            source,
        })?;
        ron::from_str(&text).map_err(|error| XtaskError::Gates {
            path: path.to_owned(),
            message: error.to_string(),
        })
    }

    /// Writes the file.
    pub(super) fn write(&self, path: &Path) -> Result<(), XtaskError> {
        let failed = |message: String| XtaskError::Gates {
            path: path.to_owned(),
            message,
        };
        let body = ron::ser::to_string_pretty(self, ron::ser::PrettyConfig::default())
            .map_err(|error| failed(error.to_string()))?;
        let text = format!(
            "// Worst figures allowed by `cargo xtask bench-scenarios`; exit code 1 beyond them.\n\
             // Written by hand with --update-gates, never by CI. Spine \"any\" holds for a spine\n\
             // without gates of its own: the published figures.\n{body}\n"
        );
        Ok(pedicle::write_text(path, &text)?)
    }

    /// Sentences for every gate that is missed.
    pub(super) fn missed(&self, spine: &str, cells: &[Cell]) -> Vec<String> {
        let mut missed = Vec::new();
        for cell in cells {
            let place = format!("{} at {} mm", cell.deformation, cell.noise_mm);
            let Some(gate) = self.gate(spine, cell) else {
                missed.push(format!("{place}: there is no gate for this cell"));
                continue;
            };
            let (mm, degrees) = cell.mean_rmse();
            let mut check = |what: &str, found: f64, limit: f64, holds: bool| {
                if !holds {
                    missed.push(format!("{place}: {what} is {found:.4}, allowed {limit:.4}"));
                }
            };
            let limit = gate.max_translation_rmse_mm;
            check("mean translation RMSE (mm)", mm, limit, mm <= limit);
            let limit = gate.max_rotation_rmse_deg;
            check("mean rotation RMSE (°)", degrees, limit, degrees <= limit);
            let total = cell.trajectories as f64;
            let margin = cell.valid_by_margin as f64 / total;
            let limit = gate.min_valid_by_margin;
            check("share valid by margin", margin, limit, margin >= limit);
            let geometry = cell.valid_by_geometry as f64 / total;
            let limit = gate.min_valid_by_geometry;
            check(
                "share valid by geometry",
                geometry,
                limit,
                geometry >= limit,
            );
            let accepted = cell.share_accepted();
            let limit = gate.min_vertebrae_accepted;
            check(
                "share of vertebrae accepted",
                accepted,
                limit,
                accepted >= limit,
            );
            let (found, limit) = (cell.false_accepts as f64, gate.max_false_accepts as f64);
            check("number of false accepts", found, limit, found <= limit);
        }
        missed
    }

    /// The same for a suite beyond the published one.
    pub(super) fn missed_of_suite(&self, suite: &str, cells: &[Cell]) -> Vec<String> {
        suite_gates::missed(&self.suites, suite, cells)
    }

    fn gate(&self, spine: &str, cell: &Cell) -> Option<&Gate> {
        [spine, ANY_SPINE].into_iter().find_map(|name| {
            self.cells.iter().find(|gate| {
                gate.spine == name
                    && gate.deformation == cell.deformation
                    && (gate.noise_mm - cell.noise_mm).abs() < 1e-9
            })
        })
    }

    /// Replaces the gates of one spine by what was measured, with slack, never looser than what
    /// every spine must reach.
    pub(super) fn update(&mut self, spine: &str, cells: &[Cell]) {
        self.cells
            .retain(|gate| gate.spine != spine && gate.spine != ANY_SPINE);
        for cell in cells {
            let (mm, degrees) = cell.mean_rmse();
            let any = requirement(cell);
            self.cells.push(Gate {
                spine: spine.to_owned(),
                max_translation_rmse_mm: rounded_up(SLACK * mm, any.max_translation_rmse_mm),
                max_rotation_rmse_deg: rounded_up(SLACK * degrees, any.max_rotation_rmse_deg),
                min_vertebrae_accepted: rounded_down(
                    cell.share_accepted() - ACCEPTED_SLACK,
                    any.min_vertebrae_accepted,
                ),
                ..any.clone()
            });
            self.cells.push(any);
        }
        self.cells.sort_by(|a, b| a.spine.cmp(&b.spine));
    }

    /// No gates yet.
    pub(super) fn empty() -> Self {
        Self {
            cells: Vec::new(),
            suites: Vec::new(),
        }
    }
}

fn rounded_up(value: f64, limit: f64) -> f64 {
    let rounded = (value * 1e4).ceil() / 1e4;
    if rounded < limit { rounded } else { limit }
}

fn rounded_down(value: f64, limit: f64) -> f64 {
    let rounded = (value * 1e4).floor() / 1e4;
    if rounded > limit { rounded } else { limit }
}

/// What every spine must reach: all valid, nearly all accepted, nothing falsely accepted, noisy cells no worse than
/// published, clean cells exact.
fn requirement(cell: &Cell) -> Gate {
    let clean = CLEAN_LIMIT[usize::from(cell.deformation == "partial")];
    let (mm, degrees) = if cell.noise_mm > 0.0 {
        published::mean(&cell.deformation, cell.noise_mm).unwrap_or((clean, clean))
    } else {
        (clean, clean)
    };
    Gate {
        spine: ANY_SPINE.to_owned(),
        deformation: cell.deformation.clone(),
        noise_mm: cell.noise_mm,
        max_translation_rmse_mm: mm,
        max_rotation_rmse_deg: degrees,
        min_valid_by_margin: 1.0,
        min_valid_by_geometry: 1.0,
        min_vertebrae_accepted: MIN_ACCEPTED,
        max_false_accepts: 0,
    }
}

#[cfg(test)]
mod tests {
    use pedicle_trajectory::Level;

    use super::super::cell::CellVertebra;
    use super::*;

    fn cell(translation_rmse_mm: f64) -> Cell {
        let vertebrae = Level::ALL
            .map(|level| CellVertebra {
                level,
                translation_rmse_mm,
                rotation_rmse_deg: 0.2,
                translation_bound_mm: 0.1,
                rotation_bound_deg: 0.1,
            })
            .to_vec();
        Cell {
            deformation: "rigid".to_owned(),
            noise_mm: 0.5,
            vertebrae,
            trajectories: 100,
            valid_by_margin: 100,
            valid_by_geometry: 100,
            vertebrae_total: 50,
            vertebrae_accepted: 50,
            false_accepts: 0,
            ..Cell::default()
        }
    }

    fn gates() -> Gates {
        let mut gates = Gates::empty();
        gates.update("spine", &[cell(0.1)]);
        gates
    }

    #[test]
    fn the_measured_cell_passes_and_every_worse_figure_is_named() {
        assert_eq!(gates().missed("spine", &[cell(0.1)]), Vec::<String>::new());
        let worse: [(&str, Cell); 6] = [
            ("translation", cell(0.2)),
            ("rotation", {
                let mut c = cell(0.1);
                c.vertebrae
                    .iter_mut()
                    .for_each(|v| v.rotation_rmse_deg = 1.0);
                c
            }),
            (
                "margin",
                Cell {
                    valid_by_margin: 99,
                    ..cell(0.1)
                },
            ),
            (
                "geometry",
                Cell {
                    valid_by_geometry: 99,
                    ..cell(0.1)
                },
            ),
            (
                "vertebrae accepted",
                Cell {
                    vertebrae_accepted: 48,
                    ..cell(0.1)
                },
            ),
            (
                "false accepts",
                Cell {
                    false_accepts: 1,
                    ..cell(0.1)
                },
            ),
        ];
        for (word, cell) in worse {
            let missed = gates().missed("spine", &[cell]);
            assert_eq!(missed.len(), 1, "{word}: {missed:?}");
            assert!(
                missed[0].contains(word),
                "{} does not name {word}",
                missed[0]
            );
        }
    }

    #[test]
    fn new_gates_leave_little_room_below_the_share_accepted() {
        let with = |vertebrae_accepted: usize| Cell {
            vertebrae_accepted,
            vertebrae_total: 1000,
            ..cell(0.1)
        };
        for (measured, least) in [(1000, 990), (995, 985), (985, 980)] {
            let mut gates = Gates::empty();
            gates.update("spine", &[with(measured)]);
            assert_eq!(
                gates.missed("spine", &[with(least)]),
                Vec::<String>::new(),
                "{measured} measured, {least} found"
            );
            assert_eq!(
                gates.missed("spine", &[with(least - 1)]).len(),
                1,
                "{measured} measured, one less than {least} found"
            );
        }
        let mut gates = Gates::empty();
        gates.update("spine", &[with(900)]);
        assert_eq!(
            gates.missed("spine", &[with(900)]).len(),
            1,
            "0.9 is no share to accept"
        );
    }

    #[test]
    fn an_unknown_spine_is_held_to_the_published_figures() {
        assert_eq!(gates().missed("other", &[cell(0.29)]), Vec::<String>::new());
        assert_eq!(
            gates().missed("other", &[cell(0.31)]).len(),
            1,
            "published: 0.304 mm"
        );
    }

    #[test]
    fn a_figure_that_is_not_a_number_misses_its_gate() {
        assert_eq!(
            gates().missed("spine", &[cell(f64::NAN)]).len(),
            1,
            "NaN must not pass"
        );
    }

    #[test]
    fn updating_never_loosens_what_every_spine_must_reach() {
        let mut gates = Gates::empty();
        gates.update("spine", &[cell(5.0)]);
        assert_eq!(
            gates.missed("spine", &[cell(5.0)]).len(),
            1,
            "5 mm is no figure to accept"
        );
    }
}
