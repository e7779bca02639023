//! A transfer as tables for people.

use comfy_table::presets::UTF8_FULL_CONDENSED;
use comfy_table::{CellAlignment, Table};
use pedicle_spine::Transfer;

use crate::TargetChangesEntry;

/// One row a vertebra, then the reasons for every rejection, then one row a trajectory.
pub(crate) fn transfer_tables(transfer: &Transfer) -> String {
    let mut vertebrae = table(&[
        "level",
        "verdict",
        "residual mm",
        "noise mm",
        "± mm",
        "± °",
        "seen %",
        "points",
        "pose from",
    ]);
    for v in &transfer.vertebrae {
        let (mm, degrees) = v.covariance.map_or((f64::NAN, f64::NAN), |c| {
            (c.translation_mm(), c.rotation_rad().to_degrees())
        });
        vertebrae.add_row([
            v.level.to_string(),
            verdict(v.accepted).to_owned(),
            format!("{:.3}", v.residual_mm),
            format!("{:.3}", v.noise_mm),
            format!("{mm:.3}"),
            format!("{degrees:.3}"),
            format!("{:.0}", 100.0 * v.coverage),
            v.n_points.to_string(),
            v.origin.to_string(),
        ]);
    }
    let mut trajectories = table(&[
        "level",
        "side",
        "verdict",
        "entry mm",
        "tip mm",
        "diameter mm",
        "± mm",
        "clear mm",
        "breach %",
    ]);
    for t in &transfer.trajectories {
        let [deviation, clearance, breach] = t.uncertainty.map_or([f64::NAN; 3], |u| {
            [
                u.isthmus_mm,
                u.planned_clearance_mm,
                100.0 * u.breach_probability,
            ]
        });
        trajectories.add_row([
            t.trajectory.level.to_string(),
            t.trajectory.side.to_string(),
            verdict(t.accepted).to_owned(),
            point(&t.trajectory.entry_mm),
            point(&t.trajectory.tip_mm),
            format!("{:.1}", t.trajectory.diameter_mm),
            format!("{deviation:.2}"),
            format!("{clearance:.2}"),
            format!("{breach:.2}"),
        ]);
    }
    let reasons: String = transfer
        .vertebrae
        .iter()
        .flat_map(|v| {
            let reasons = v.reasons.iter().map(ToString::to_string);
            reasons
                .chain(v.notice())
                .map(move |words| format!("{}: {words}\n", v.level))
        })
        .collect();
    format!(
        "{vertebrae}\n{reasons}{}\n{trajectories}",
        changes(transfer)
    )
}

/// A line on what was wrong with the target, if anything was.
fn changes(transfer: &Transfer) -> String {
    let c = TargetChangesEntry::from(&transfer.target_changes);
    if c.n_faces_mended + c.n_vertices_removed + c.n_faces_not_in_map + c.n_points_alone == 0 {
        return String::new();
    }
    format!(
        "Target: {} bad faces mended, {} vertices without a face removed, {} faces of loose crumbs \
         left out of the map, {} points that float alone removed.\n",
        c.n_faces_mended, c.n_vertices_removed, c.n_faces_not_in_map, c.n_points_alone
    )
}

pub(super) fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table
        .load_style(UTF8_FULL_CONDENSED)
        .set_header(header.iter().copied());
    for column in table.column_iter_mut().skip(2) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

fn verdict(accepted: bool) -> &'static str {
    if accepted { "accepted" } else { "REJECTED" }
}

fn point(p: &nalgebra::Point3<f64>) -> String {
    format!("{:.2} {:.2} {:.2}", p.x, p.y, p.z)
}
