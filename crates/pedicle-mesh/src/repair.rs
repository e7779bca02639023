//! Removing what no later step can use: repeated, doubled and arealess faces, stray vertices.
//!
//! Vertices never move. A face without area goes by collapsing its shortest edge (a needle) or by
//! flipping its longest (a cap), neither of which opens a hole. Tolerances are relative to the
//! face, so the result does not depend on the unit.

use std::collections::BTreeMap;

use crate::edit::{Change, EditMesh, compacted};
use crate::measures::is_degenerate;
use crate::topology::{connected_components, edge_uses, is_proper};
use crate::{MeshError, TriMesh};

/// A face whose shortest edge is below this fraction of its longest is a needle, any other
/// without area a cap.
const NEEDLE_RATIO: f64 = 1e-6;

/// A change may not turn a neighbouring face by more than about a quarter turn.
const MIN_COS_OF_TURN: f64 = 0.0;

/// Rounds over the faces without area; one change can leave another such face behind.
const MAX_ROUNDS: usize = 8;

/// What to remove besides what is always removed.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RepairOptions {
    /// Connected components with less than this fraction (0 to 1) of the whole area go. Default:
    /// none goes.
    pub min_component_area_fraction: Option<f64>,
}

/// What `repair` changed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RepairReport {
    /// Faces removed because they named a vertex twice.
    pub n_repeated_index_faces: usize,
    /// Faces removed because others have the same vertices; of two that face opposite ways both
    /// go if they hang on other faces.
    pub n_duplicate_faces: usize,
    /// Edges collapsed to be rid of faces without area.
    pub n_collapsed_edges: usize,
    /// Edges flipped to be rid of faces without area.
    pub n_flipped_edges: usize,
    /// Faces without area that could only be removed; each may leave a slit.
    pub n_removed_zero_area_faces: usize,
    /// Components removed as too small.
    pub n_removed_components: usize,
    /// Faces removed with those components.
    pub n_faces_of_removed_components: usize,
    /// Vertices removed because no face uses them (any more).
    pub n_removed_vertices: usize,
    /// For every vertex of the result, its index in the input.
    pub source_vertex: Vec<u32>,
}

impl RepairReport {
    /// Whether anything was changed.
    #[must_use]
    pub fn changed(&self) -> bool {
        self.n_removed_vertices
            + self.n_repeated_index_faces
            + self.n_duplicate_faces
            + self.n_collapsed_edges
            + self.n_flipped_edges
            + self.n_removed_zero_area_faces
            + self.n_removed_components
            > 0
    }
}

/// Removes faces that name a vertex twice, doubled faces, faces without area, small components
/// (if asked) and vertices that no face uses.
///
/// Boundaries and non-manifold places of other origin stay: `defects` tells of them.
///
/// # Errors
/// [`MeshError::NothingLeft`] if no face survives.
pub fn repair(
    mesh: &TriMesh,
    options: &RepairOptions,
) -> Result<(TriMesh, RepairReport), MeshError> {
    let mut report = RepairReport::default();
    let mut faces: Vec<[u32; 3]> = mesh.faces().iter().copied().filter(is_proper).collect();
    report.n_repeated_index_faces = mesh.n_faces() - faces.len();
    remove_duplicates(&mut faces, &mut report);
    let mut edit = EditMesh::new(mesh.vertices().to_vec(), &faces);
    remove_zero_areas(&mut edit, &mut report);
    let mut faces = edit.remaining_faces();
    // A collapse or flip can lay one face onto another.
    remove_duplicates(&mut faces, &mut report);
    let nothing_left = MeshError::NothingLeft {
        n_faces: mesh.n_faces(),
    };
    if faces.is_empty() {
        return Err(nothing_left);
    }
    if let Some(fraction) = options.min_component_area_fraction {
        let whole = TriMesh::new(mesh.vertices().to_vec(), faces)?;
        faces = remove_small_components(&whole, fraction, &mut report);
        if faces.is_empty() {
            return Err(nothing_left);
        }
    }
    let (repaired, source_vertex) = compacted(mesh.vertices(), &faces)?;
    report.n_removed_vertices = mesh.n_vertices() - source_vertex.len();
    report.source_vertex = source_vertex;
    Ok((repaired, report))
}

/// Of every group of faces with the same vertices keeps the first that faces the way most do.
fn remove_duplicates(faces: &mut Vec<[u32; 3]>, report: &mut RepairReport) {
    let mut groups: BTreeMap<[u32; 3], Vec<usize>> = BTreeMap::new();
    for (face, corners) in faces.iter().enumerate() {
        let mut key = *corners;
        key.sort_unstable();
        groups.entry(key).or_default().push(face);
    }
    groups.retain(|_, group| group.len() > 1);
    if groups.is_empty() {
        return;
    }
    let is_even = |face: usize| {
        let [a, b, c] = faces[face];
        (a < b) as u8 + (b < c) as u8 + (c < a) as u8 == 2
    };
    let balance = |group: &[usize]| {
        let n_even = group.iter().filter(|&&f| is_even(f)).count();
        n_even as i64 - (group.len() - n_even) as i64
    };
    // Edges of faces that do not cancel: a cancelling pair that hangs on one goes altogether.
    let mut cancels = vec![false; faces.len()];
    for group in groups.values().filter(|group| balance(group) == 0) {
        for &face in group {
            cancels[face] = true;
        }
    }
    let mut held_edges: Vec<[u32; 2]> = edge_uses(faces)
        .into_iter()
        .filter(|u| !cancels[u.face as usize])
        .map(|u| u.edge)
        .collect();
    held_edges.dedup();
    let is_held = |[a, b, c]: &[u32; 3]| {
        [[*a, *b], [*b, *c], [*a, *c]]
            .iter()
            .any(|edge| held_edges.binary_search(edge).is_ok())
    };
    let mut keep = vec![true; faces.len()];
    for (key, group) in &groups {
        for &face in group {
            keep[face] = false;
        }
        let kept = match balance(group) {
            0 if is_held(key) => None,
            0 => group.first(),
            n => group.iter().find(|&&face| is_even(face) == (n > 0)),
        };
        if let Some(&face) = kept {
            keep[face] = true;
        }
    }
    let n_before = faces.len();
    let mut keep = keep.into_iter();
    faces.retain(|_| keep.next().unwrap_or(true));
    report.n_duplicate_faces += n_before - faces.len();
}

fn remove_zero_areas(edit: &mut EditMesh, report: &mut RepairReport) {
    let mut may_dissolve = true;
    for round in 0.. {
        let degenerate: Vec<u32> = (0..edit.n_face_slots() as u32)
            .filter(|&face| lacks_area(edit, face))
            .collect();
        if degenerate.is_empty() {
            return;
        }
        // A face that resists now may yield once its neighbours have changed; only when none
        // yields any more are they cut out.
        let mut has_changed = false;
        for face in degenerate {
            // An earlier change may have dealt with it.
            if !lacks_area(edit, face) {
                continue;
            }
            if !may_dissolve {
                edit.remove_face(face);
                report.n_removed_zero_area_faces += 1;
            } else if dissolve(edit, face, report) {
                has_changed = true;
            }
        }
        may_dissolve = has_changed && round < MAX_ROUNDS;
    }
}

fn lacks_area(edit: &EditMesh, face: u32) -> bool {
    let corners = edit.face(face);
    corners.is_some_and(|corners| is_degenerate(&edit.points(&corners)))
}

/// Makes a face without area disappear by one collapse or flip.
fn dissolve(edit: &mut EditMesh, face: u32, report: &mut RepairReport) -> bool {
    let Some([a, b, c]) = edit.face(face) else {
        return false;
    };
    let mut edges = [[a, b], [b, c], [c, a]];
    edges.sort_by(|p, q| {
        let length = |e: &[u32; 2]| edit.distance(e[0], e[1]);
        length(p).total_cmp(&length(q))
    });
    let [shortest, _, longest] = edges;
    let is_needle = edit.distance(shortest[0], shortest[1])
        <= NEEDLE_RATIO * edit.distance(longest[0], longest[1]);
    // The lower vertex stays where both may, so that the result does not depend on the order.
    let [low, high] = [shortest[0].min(shortest[1]), shortest[0].max(shortest[1])];
    let collapses = [
        Change::Collapse {
            from: high,
            to: low,
        },
        Change::Collapse {
            from: low,
            to: high,
        },
    ];
    let flip = Change::Flip {
        a: longest[0],
        b: longest[1],
    };
    let order = if is_needle {
        [collapses[0], collapses[1], flip]
    } else {
        [flip, collapses[0], collapses[1]]
    };
    for change in order {
        let Some(effect) = edit.effect(change) else {
            continue;
        };
        let n_flat = |faces: &[[u32; 3]]| {
            let flat = |f: &&[u32; 3]| is_degenerate(&edit.points(f));
            faces.iter().filter(flat).count()
        };
        let before: Vec<[u32; 3]> = effect.before.iter().filter_map(|&f| edit.face(f)).collect();
        let improves = n_flat(&effect.after) < n_flat(&before);
        if improves && edit.keeps_normals(change, &effect, MIN_COS_OF_TURN) {
            edit.apply(&effect);
            match change {
                Change::Collapse { .. } => report.n_collapsed_edges += 1,
                Change::Flip { .. } => report.n_flipped_edges += 1,
            }
            return true;
        }
    }
    false
}

fn remove_small_components(
    mesh: &TriMesh,
    fraction: f64,
    report: &mut RepairReport,
) -> Vec<[u32; 3]> {
    let components = connected_components(mesh);
    let mut areas = vec![0.0; components.n_components];
    for (face, &component) in components.of_face.iter().enumerate() {
        areas[component as usize] += mesh.face_area(face);
    }
    let smallest = fraction * areas.iter().sum::<f64>();
    let is_small: Vec<bool> = areas.iter().map(|&area| area < smallest).collect();
    let kept: Vec<[u32; 3]> = mesh
        .faces()
        .iter()
        .zip(&components.of_face)
        .filter(|&(_, &component)| !is_small[component as usize])
        .map(|(corners, _)| *corners)
        .collect();
    report.n_removed_components = is_small.iter().filter(|&&small| small).count();
    report.n_faces_of_removed_components = mesh.n_faces() - kept.len();
    kept
}
