//! Faces with a small angle, removed by flips and collapses that keep the topology.

use crate::edit::{Change, EditMesh, Effect};
use crate::measures::smallest_corner_angle;

/// Passes over the slivers.
const MAX_SLIVER_PASSES: usize = 12;

/// Cosine of the angle (about 45°) by which removing a sliver may turn the surface there.
const MIN_COS_OF_TURN: f64 = 0.7;

/// Below this angle (about 5°) a sliver is bad enough to turn the surface by up to about 85°.
pub(crate) const BAD_ANGLE_RAD: f64 = 0.09;

/// Cosine of that larger turn.
const MIN_COS_OF_BAD_TURN: f64 = 0.1;

/// Flips and collapses edges of slivers while that makes the worst angle around them better.
pub(crate) fn remove_slivers(edit: &mut EditMesh, limit_rad: f64) -> usize {
    let mut n_changes = 0;
    for _ in 0..MAX_SLIVER_PASSES {
        let angle = |edit: &EditMesh, face: u32| {
            let corners = edit.face(face)?;
            let angle = smallest_corner_angle(&edit.points(&corners));
            (angle < limit_rad).then_some(angle)
        };
        let mut slivers: Vec<(f64, u32)> = (0..edit.n_face_slots() as u32)
            .filter_map(|face| Some((angle(edit, face)?, face)))
            .collect();
        slivers.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut n_in_pass = 0;
        for (_, face) in slivers {
            // An earlier change may have dealt with it.
            if let Some(angle) = angle(edit, face)
                && let Some(effect) = best_change(edit, face, angle)
            {
                edit.apply(&effect);
                n_in_pass += 1;
            }
        }
        n_changes += n_in_pass;
        if n_in_pass == 0 {
            break;
        }
    }
    n_changes
}

/// The change around a face that most improves the worst angle, from the gentlest kind that helps
/// at all.
fn best_change(edit: &EditMesh, face: u32, angle: f64) -> Option<Effect> {
    let corners = edit.face(face)?;
    let [a, b, c] = corners;
    let edges = [[a, b], [b, c], [c, a]];
    // Flips keep the number of faces, so they come first.
    let flips = edges.map(|[a, b]| Change::Flip { a, b });
    let along = edges.map(|[from, to]| Change::Collapse { from, to });
    let back = edges.map(|[to, from]| Change::Collapse { from, to });
    let own = [along, back].concat();
    let away: Vec<Change> = corners
        .iter()
        .flat_map(|&from| edit.neighbors(from).into_iter().map(move |to| (from, to)))
        .filter(|(_, to)| !corners.contains(to))
        .map(|(from, to)| Change::Collapse { from, to })
        .collect();
    let kinds: [&[Change]; 3] = [&flips, &own, &away];
    let gentle = kinds
        .iter()
        .find_map(|kind| best_of(edit, kind, MIN_COS_OF_TURN));
    if gentle.is_some() || angle > BAD_ANGLE_RAD {
        return gentle;
    }
    kinds
        .iter()
        .find_map(|kind| best_of(edit, kind, MIN_COS_OF_BAD_TURN))
}

fn best_of(edit: &EditMesh, changes: &[Change], min_cos: f64) -> Option<Effect> {
    let mut best: Option<(f64, Effect)> = None;
    for &change in changes {
        let Some(effect) = edit.effect(change) else {
            continue;
        };
        let (before, after) = edit.angles(&effect);
        let is_better = after > before && best.as_ref().is_none_or(|(angle, _)| after > *angle);
        if is_better && edit.keeps_normals(change, &effect, min_cos) {
            best = Some((after, effect));
        }
    }
    best.map(|(_, effect)| effect)
}
