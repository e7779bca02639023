//! Errors of measured pedicles.

use comfy_table::{Table, TableStyle};
use pedicle_simulation::PedicleTruth;
use pedicle_trajectory::PedicleAnatomy;

use crate::bench::new_table;

/// Errors of one measured pedicle.
pub(super) struct MeasureError {
    name: String,
    center_mm: f64,
    width_mm: f64,
    height_mm: f64,
    axis_deg: f64,
}

/// What is compared, with its limit.
type Column = (&'static str, f64, fn(&MeasureError) -> f64);

const COLUMNS: [Column; 4] = [
    ("isthmus centre mm", 0.5, |e| e.center_mm),
    ("width mm", 0.4, |e| e.width_mm.abs()),
    ("height mm", 0.4, |e| e.height_mm.abs()),
    ("axis °", 2.0, |e| e.axis_deg),
];

impl MeasureError {
    pub(super) fn new(name: String, found: &PedicleAnatomy, truth: &PedicleTruth) -> Self {
        let p = &found.pedicle;
        Self {
            name,
            center_mm: (p.isthmus_center_mm - truth.isthmus_center).norm(),
            width_mm: p.width_mm - truth.width_mm,
            height_mm: p.height_mm - truth.height_mm,
            axis_deg: p.axis.angle(&truth.axis).to_degrees(),
        }
    }
}

impl std::fmt::Display for MeasureError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}: centre {:.2}, width {:+.2}, height {:+.2} mm, axis {:.2}°",
            self.name, self.center_mm, self.width_mm, self.height_mm, self.axis_deg
        )
    }
}

/// One row a measure, and whether every error is within its limit.
pub(super) fn table(errors: &[&MeasureError], style: TableStyle) -> (Table, bool) {
    let header = ["", "median", "95 %", "largest", "limit"];
    let mut table = new_table(style, header.map(String::from).to_vec());
    let mut within = true;
    for (name, limit, of) in COLUMNS {
        let mut values: Vec<f64> = errors.iter().map(|e| of(e)).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * values.len() as f64).ceil() as usize;
            values.get(rank.max(1) - 1).copied().unwrap_or(f64::NAN)
        };
        within &= at(1.0) <= limit;
        table.add_row([
            name.to_owned(),
            format!("{:.3}", at(0.5)),
            format!("{:.3}", at(0.95)),
            format!("{:.3}", at(1.0)),
            format!("{limit}"),
        ]);
    }
    (table, within)
}
