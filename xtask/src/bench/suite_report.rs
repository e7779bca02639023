//! The figures of the suites beyond the published one, and what all of them come to.

use comfy_table::presets::{ASCII_MARKDOWN, UTF8_FULL_CONDENSED};
use comfy_table::{Table, TableStyle};
use pedicle_simulation::Suite;

use super::cell::{self, Cell, Spread};
use super::limit::upper_limit;
use super::report::{new_table, share};
use super::score::{ScenarioScore, VertebraScore};
use super::screws;

/// All that is reported of one suite.
pub(super) struct SuiteSummary<'a> {
    pub(super) suite: Suite,
    pub(super) spine: &'a str,
    pub(super) seed: u64,
    pub(super) draws: u32,
    pub(super) scores: &'a [ScenarioScore],
    pub(super) cells: &'a [Cell],
    pub(super) times: String,
}

impl SuiteSummary<'_> {
    /// Everything, for a terminal.
    pub(super) fn text(&self) -> String {
        format!(
            "{}\n{}\n{}{}\n{}",
            self.heading(),
            self.table(UTF8_FULL_CONDENSED),
            self.seen(),
            screws::origins(self.scores),
            self.times
        )
    }

    /// Everything, for a document.
    pub(super) fn markdown(&self) -> String {
        format!(
            "# Suite `{}` on {}\n\n{}\n\n{}\n\n{}\n{}\n\n{}\n",
            self.suite,
            self.spine,
            self.heading(),
            self.table(ASCII_MARKDOWN),
            self.seen(),
            screws::origins(self.scores),
            self.times
        )
    }

    fn heading(&self) -> String {
        format!(
            "{}, suite {}: {} scenarios ({} draws a cell), seed {}. Target errors are those of the \
             trajectories, in mm: median and 95 %, nothing left out.",
            self.spine,
            self.suite,
            self.scores.len(),
            self.draws,
            self.seed
        )
    }

    /// Of the suite `sensor`: vertebrae of which enough is seen, over all cells.
    fn seen(&self) -> String {
        if self.suite != Suite::Sensor {
            return String::new();
        }
        let all: Vec<&VertebraScore> = self.scores.iter().flat_map(|s| &s.vertebrae).collect();
        let seen = cell::seen(&all);
        format!(
            "a third of the back seen: {} vertebrae, valid and accepted {}, median target error at the \
             isthmus {} mm\na third of what faces backwards seen: {} vertebrae, valid and accepted {}, \
             median target error at the isthmus {} mm\nof what is valid and accepted: {}\n",
            seen.vertebrae,
            share(seen.valid_accepted, seen.vertebrae),
            millimetres(seen.isthmus_median_mm),
            seen.facing_vertebrae,
            share(seen.facing_valid_accepted, seen.facing_vertebrae),
            millimetres(seen.facing_isthmus_median_mm),
            over_bound(&all),
        )
    }

    fn table(&self, style: TableStyle) -> Table {
        let mut header = vec![
            "target",
            "noise",
            "trajectories",
            "by margin",
            "by geometry",
            "vertebrae",
            "valid",
            "accepted",
            "valid and accepted",
            "false accepts",
            "refused",
            "entry",
            "isthmus",
            "tip",
        ];
        if self.suite == Suite::Sensor {
            header.extend([
                "a third of the back seen",
                "valid and accepted",
                "isthmus",
                "a third of what faces backwards seen",
                "valid and accepted",
                "isthmus",
            ]);
        }
        let mut table = new_table(style, header.into_iter().map(String::from).collect());
        for cell in self.cells {
            table.add_row(row(cell));
        }
        table
    }
}

fn row(cell: &Cell) -> Vec<String> {
    let there = cell.vertebrae_total - cell.vertebrae_absent;
    let mut row = vec![
        cell.deformation.clone(),
        format!("{}", cell.noise_mm),
        cell.trajectories.to_string(),
        share(cell.valid_by_margin, cell.trajectories),
        share(cell.valid_by_geometry, cell.trajectories),
        cell.vertebrae_total.to_string(),
        share(cell.valid_vertebrae, there),
        share(cell.vertebrae_accepted, cell.vertebrae_total),
        share(cell.valid_accepted, there),
        cell.false_accepts.to_string(),
        cell.refused.to_string(),
        pair(&cell.entry),
        pair(&cell.isthmus),
        pair(&cell.tip),
    ];
    if let Some(seen) = &cell.seen {
        row.extend([
            seen.vertebrae.to_string(),
            share(seen.valid_accepted, seen.vertebrae),
            millimetres(seen.isthmus_median_mm),
            seen.facing_vertebrae.to_string(),
            share(seen.facing_valid_accepted, seen.facing_vertebrae),
            millimetres(seen.facing_isthmus_median_mm),
        ]);
    }
    row
}

/// Errors of valid and accepted vertebrae over their Cramér-Rao bounds, root mean squares: 1 is an efficient method.
fn over_bound(all: &[&VertebraScore]) -> String {
    let bounded = |v: &&VertebraScore| {
        let (mm2, rad2) = v.bound_squared;
        v.valid && v.accepted && mm2 > 0.0 && mm2.is_finite() && rad2.is_finite()
    };
    let ratio = |squares: &dyn Fn(&VertebraScore) -> f64| {
        let found: Vec<f64> = all.iter().copied().filter(bounded).map(squares).collect();
        (found.iter().sum::<f64>() / found.len() as f64).sqrt()
    };
    if !all.iter().any(bounded) {
        return "none".to_owned();
    }
    let position = ratio(&|v| v.translation_mm.powi(2) / v.bound_squared.0);
    let orientation = ratio(&|v| v.rotation_rad.powi(2) / v.bound_squared.1);
    format!(
        "position {position:.2} times, orientation {orientation:.2} times the Cramér-Rao bound of the points on bone \
         (root mean square)"
    )
}

fn pair(spread: &Spread) -> String {
    format!(
        "{}/{}",
        millimetres(spread.median_mm),
        millimetres(spread.p95_mm)
    )
}

fn millimetres(x: f64) -> String {
    if x.is_finite() {
        format!("{x:.2}")
    } else {
        "-".to_owned()
    }
}

/// Every scenario that was refused, every vertebra that is not both valid and accepted or, where
/// it is not there, accepted.
pub(super) fn explanations(scores: &[ScenarioScore], all: bool) -> String {
    let mut lines = Vec::new();
    for score in scores {
        if let Some(reason) = &score.refusal {
            lines.push(format!("{}: refused: {reason}", score.name()));
            continue;
        }
        for v in &score.vertebrae {
            let right = if v.present {
                v.valid && v.accepted
            } else {
                !v.accepted
            };
            if all || !right {
                let word = if v.false_accept { "FALSE ACCEPT " } else { "" };
                let [seen, facing] = [v.posterior_seen, v.facing_seen].map(|x| 100.0 * x);
                lines.push(format!(
                    "{}: {word}{} ({seen:.0} % of the back, {facing:.0} % of what faces backwards seen)",
                    score.name(),
                    v.detail
                ));
            }
        }
    }
    lines.join("\n")
}

/// Transfers and false accepts of everything that was run.
pub(super) fn conclusion<'a>(cells: impl Iterator<Item = &'a Cell>) -> String {
    let (mut transfers, mut accepted, mut wrong) = (0, 0, 0);
    let (mut valid, mut valid_accepted) = (0, 0);
    for cell in cells {
        transfers += cell.vertebrae_total;
        accepted += cell.vertebrae_accepted;
        wrong += cell.false_accepts;
        valid += cell.valid_vertebrae;
        valid_accepted += cell.valid_accepted;
    }
    format!(
        "{transfers} vertebra transfers, {accepted} accepted, {wrong} false accepts: at most {:.4} % \
         of the transfers with 95 % confidence (Clopper-Pearson). Valid: {valid}; accepted of them: {}",
        100.0 * upper_limit(wrong, transfers),
        share(valid_accepted, valid)
    )
}
