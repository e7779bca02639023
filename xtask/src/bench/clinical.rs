//! What a transfer does to the screws, in the terms of clinical studies: deviation at the entry
//! (tail), at the tip and of the angle; grades of Gertzbein and Robbins beside those of the plan
//! itself; where the screws break out.

use comfy_table::presets::{ASCII_MARKDOWN, UTF8_FULL_CONDENSED};
use comfy_table::{Table, TableStyle};
use pedicle_trajectory::{BreachDirection, Grade, Pedicle, Trajectory, TrajectoryCheck};
use serde::Serialize;

use super::cell::Cell;
use super::report::new_table;
use super::score::VertebraScore;

/// One transferred screw in the bone it was planned in.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScrewScore {
    tail_mm: f64,
    tip_mm: f64,
    angle_rad: f64,
    grade: Grade,
    /// Of the plan itself.
    planned_grade: Grade,
    direction: Option<BreachDirection>,
}

impl ScrewScore {
    /// `back` is the transferred screw, brought back by the true motion, and `check` its check.
    pub(super) fn new(
        (planned, planned_grade): (&Trajectory, Grade),
        back: &Trajectory,
        check: &TrajectoryCheck,
        pedicle: &Pedicle,
    ) -> Self {
        Self {
            tail_mm: (back.entry_mm - planned.entry_mm).norm(),
            tip_mm: (back.tip_mm - planned.tip_mm).norm(),
            angle_rad: back.direction().angle(&planned.direction()),
            grade: Grade::of_screw(back, check, pedicle),
            planned_grade,
            direction: check.breach_direction,
        }
    }
}

/// The screws of one cell.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct ClinicalCell {
    tail_median_mm: f64,
    tail_p95_mm: f64,
    tip_median_mm: f64,
    tip_p95_mm: f64,
    angle_median_deg: f64,
    angle_p95_deg: f64,
    /// Screws of grade A, B, C, D and E.
    grades: [usize; 5],
    /// The same screws as planned, before any transfer.
    planned_grades: [usize; 5],
    /// Breaches medially, laterally, cranially, caudally and anteriorly.
    breaches: [usize; 5],
    /// Screws of refused scenarios: they were not placed at all.
    not_placed: usize,
}

const DIRECTIONS: [BreachDirection; 5] = [
    BreachDirection::Medial,
    BreachDirection::Lateral,
    BreachDirection::Cranial,
    BreachDirection::Caudal,
    BreachDirection::Anterior,
];

/// Sums the screws of some vertebrae up.
pub(super) fn summed_up(vertebrae: &[&VertebraScore]) -> ClinicalCell {
    let screws: Vec<&ScrewScore> = vertebrae.iter().flat_map(|v| &v.screws).collect();
    let n_planned: usize = vertebrae.iter().map(|v| v.n_trajectories).sum();
    let quantiles = |f: &dyn Fn(&ScrewScore) -> f64| {
        let mut values: Vec<f64> = screws.iter().map(|s| f(s)).collect();
        values.sort_by(f64::total_cmp);
        [0.5, 0.95].map(|share| {
            let rank = (share * values.len() as f64).ceil() as usize;
            values.get(rank.max(1) - 1).copied().unwrap_or(f64::NAN)
        })
    };
    let [tail_median_mm, tail_p95_mm] = quantiles(&|s| s.tail_mm);
    let [tip_median_mm, tip_p95_mm] = quantiles(&|s| s.tip_mm);
    let [angle_median_deg, angle_p95_deg] = quantiles(&|s| s.angle_rad.to_degrees());
    let count = |f: &dyn Fn(&ScrewScore) -> bool| screws.iter().filter(|s| f(s)).count();
    ClinicalCell {
        tail_median_mm,
        tail_p95_mm,
        tip_median_mm,
        tip_p95_mm,
        angle_median_deg,
        angle_p95_deg,
        grades: Grade::ALL.map(|grade| count(&|s| s.grade == grade)),
        planned_grades: Grade::ALL.map(|grade| count(&|s| s.planned_grade == grade)),
        breaches: DIRECTIONS.map(|d| count(&|s| s.direction == Some(d))),
        not_placed: n_planned.saturating_sub(screws.len()),
    }
}

const HEADING: &str = "Screws as clinical studies report them: deviation at the tail, at the tip \
    and of the angle (median/95 %), grades of Gertzbein and Robbins with those of the plan itself \
    beside, and where screws break out. Every screw counts, whether its vertebra was accepted or \
    not.";

/// The table, for a terminal.
pub(super) fn text(cells: &[Cell]) -> String {
    format!("{HEADING}\n{}", table(cells, UTF8_FULL_CONDENSED))
}

/// The table, for a document.
pub(super) fn markdown(cells: &[Cell]) -> String {
    format!("\n{HEADING}\n\n{}\n", table(cells, ASCII_MARKDOWN))
}

fn table(cells: &[Cell], style: TableStyle) -> Table {
    let header = [
        "target",
        "noise",
        "tail mm",
        "tip mm",
        "angle °",
        "A/B/C/D/E",
        "as planned",
        "med/lat/cra/cau/ant",
        "not placed",
    ];
    let mut table = new_table(style, header.map(String::from).to_vec());
    let slashed = |counts: &[usize; 5]| counts.map(|n| n.to_string()).join("/");
    let pair = |median: f64, p95: f64| {
        if median.is_finite() {
            format!("{median:.2}/{p95:.2}")
        } else {
            "-".to_owned()
        }
    };
    for cell in cells {
        let c = &cell.clinical;
        table.add_row([
            cell.deformation.clone(),
            format!("{}", cell.noise_mm),
            pair(c.tail_median_mm, c.tail_p95_mm),
            pair(c.tip_median_mm, c.tip_p95_mm),
            pair(c.angle_median_deg, c.angle_p95_deg),
            slashed(&c.grades),
            slashed(&c.planned_grades),
            slashed(&c.breaches),
            c.not_placed.to_string(),
        ]);
    }
    table
}
