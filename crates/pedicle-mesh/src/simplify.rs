//! Fewer faces for the same surface, out of the original vertices.
//!
//!     f_i ≈ F · A_i / Σ A_j       (faces of component i out of F, by its area A_i)
//!
//! Each connected component is simplified on its own by meshopt's quadric edge collapse (Garland
//! & Heckbert 1997) with its regularity term, so that no component starves and none is welded to
//! another where they touch. meshopt works on f32: positions are centred and scaled for it, and
//! its answer is only used as indices, so the vertices that remain are original bit by bit.
//! Afterwards slivers are flipped or collapsed away, and where meshopt pinched a manifold surface
//! the place is held and the component is done again.

use meshopt::{SimplifyOptions as MeshoptOptions, SimplifyVertex, simplify_with_locks_decoder};

use crate::edit::{Change, EditMesh, Effect, compacted};
use crate::measures::{smallest_angle_rad, smallest_corner_angle};
use crate::topology::{
    by_edge, connected_components, edge_uses, is_proper, vertex_adjacency, vertices_of_several_fans,
};
use crate::{MeshError, TriMesh};

/// No closed surface has fewer faces than a tetrahedron.
const MIN_TARGET: usize = 4;

/// How often a component is done again with pinched places held.
const MAX_RETRIES: usize = 12;

/// Passes over the slivers of a component.
const MAX_SLIVER_PASSES: usize = 12;

/// Cosine of the angle (about 25°) by which removing a sliver may turn a face.
const MIN_COS_OF_TURN: f64 = 0.9;

/// How the faces of the target are dealt out to the components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FaceShare {
    /// By area: edges become equally long everywhere.
    #[default]
    Area,
    /// By number of faces: every component shrinks by the same factor.
    FaceCount,
}

/// How to simplify.
#[derive(Debug, Clone, PartialEq)]
pub struct SimplifyOptions {
    /// How the faces of the target are dealt out to the components. Default: by area.
    pub share: FaceShare,
    /// No component is taken below this many faces; smaller ones stay as they are. Default: 24.
    pub min_faces_per_component: usize,
    /// Faces with a smaller corner angle, radians, are flipped or collapsed away where the
    /// surface allows it. Default: 0.14 (8°). 0 leaves all as they are.
    pub sliver_angle_rad: f64,
    /// Collapses stop at this distance from the surface as meshopt estimates it, mm. Default:
    /// none, the number of faces alone decides.
    pub max_error_mm: Option<f64>,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self {
            share: FaceShare::Area,
            min_faces_per_component: 24,
            sliver_angle_rad: 0.14,
            max_error_mm: None,
        }
    }
}

/// A simplified mesh and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh. Its vertices are vertices of the input, in their order.
    pub mesh: TriMesh,
    /// For every vertex, its index in the input.
    pub source_vertex: Vec<u32>,
    /// Faces of the input.
    pub n_faces_before: usize,
    /// Faces of the result; more than asked for where the topology or `min_faces_per_component`
    /// forbids to go further.
    pub n_faces: usize,
    /// Faces that were asked for.
    pub target_faces: usize,
    /// Connected components, in the input and in the result.
    pub n_components: usize,
    /// Largest distance between the two surfaces as meshopt estimates it, mm.
    pub estimated_error_mm: f64,
    /// Smallest corner angle of the result, radians.
    pub smallest_angle_rad: f64,
    /// Edges flipped or collapsed to remove slivers.
    pub n_sliver_changes: usize,
    /// Closed or open manifold components that are pinched somewhere in the result although they
    /// were not before; 0 unless holding the places did not help.
    pub n_pinched_components: usize,
}

/// Simplifies a mesh to about `target_faces` faces.
///
/// A manifold component stays manifold, a closed one closed; components never merge. Vertices
/// that no face uses and faces that name a vertex twice are dropped. A mesh that has no more
/// faces than asked for comes back unchanged, but for those.
///
/// # Errors
/// [`MeshError::TargetTooSmall`] for a target below 4, [`MeshError::NothingLeft`] if every face
/// names a vertex twice.
pub fn simplify(
    mesh: &TriMesh,
    target_faces: usize,
    options: &SimplifyOptions,
) -> Result<Simplified, MeshError> {
    if target_faces < MIN_TARGET {
        return Err(MeshError::TargetTooSmall {
            target_faces,
            min: MIN_TARGET,
        });
    }
    let proper: Vec<u32> = (0..mesh.n_faces() as u32)
        .filter(|&face| is_proper(&mesh.faces()[face as usize]))
        .collect();
    if proper.is_empty() {
        return Err(MeshError::NothingLeft {
            n_faces: mesh.n_faces(),
        });
    }
    let whole = mesh.submesh_of_faces(&proper)?;
    let components = connected_components(&whole.mesh).faces();
    let targets = deal_out(&whole.mesh, &components, target_faces, options);
    let mut faces = Vec::new();
    let mut summary = Summary::default();
    for (component, target) in components.iter().zip(targets) {
        let part = whole.mesh.submesh_of_faces(component)?;
        let kept = simplify_component(&part.mesh, target, options, &mut summary);
        // From the part's vertices to the whole's, from there to the input's.
        let source = |v: u32| whole.source_vertex[part.source_vertex[v as usize] as usize];
        faces.extend(kept.iter().map(|corners| corners.map(source)));
    }
    let (simplified, source_vertex) = compacted(mesh.vertices(), &faces)?;
    Ok(Simplified {
        n_faces_before: mesh.n_faces(),
        n_faces: simplified.n_faces(),
        target_faces,
        n_components: components.len(),
        estimated_error_mm: summary.estimated_error_mm,
        smallest_angle_rad: smallest_angle_rad(&simplified),
        n_sliver_changes: summary.n_sliver_changes,
        n_pinched_components: summary.n_pinched_components,
        mesh: simplified,
        source_vertex,
    })
}

/// What the components add up to.
#[derive(Debug, Default)]
struct Summary {
    estimated_error_mm: f64,
    n_sliver_changes: usize,
    n_pinched_components: usize,
}

/// Faces for every component: its share, but neither below the minimum nor above what it has.
///
/// A component that hits a bound takes its bound, and the rest is dealt out again among the
/// others; at the end the largest remainders get the faces that rounding left.
fn deal_out(
    mesh: &TriMesh,
    components: &[Vec<u32>],
    target_faces: usize,
    options: &SimplifyOptions,
) -> Vec<usize> {
    let weight = |faces: &Vec<u32>| match options.share {
        FaceShare::Area => faces.iter().map(|&f| mesh.face_area(f as usize)).sum(),
        FaceShare::FaceCount => faces.len() as f64,
    };
    let weights: Vec<f64> = components.iter().map(weight).collect();
    let low = |i: usize| components[i].len().min(options.min_faces_per_component);
    let mut dealt: Vec<Option<usize>> = vec![None; components.len()];
    loop {
        let open: Vec<usize> = (0..components.len())
            .filter(|&i| dealt[i].is_none())
            .collect();
        let left = target_faces.saturating_sub(dealt.iter().flatten().sum()) as f64;
        let sum: f64 = open.iter().map(|&i| weights[i]).sum();
        // Without any area all components count the same.
        let share = |i: usize| match sum > 0.0 {
            true => left * weights[i] / sum,
            false => left / open.len() as f64,
        };
        // The minimum first: what it takes lowers the other shares, which may lift the maximum.
        let below: Vec<usize> = open
            .iter()
            .copied()
            .filter(|&i| share(i) < low(i) as f64)
            .collect();
        let above = open
            .iter()
            .copied()
            .filter(|&i| share(i) > components[i].len() as f64);
        let bound: Vec<usize> = if below.is_empty() {
            above.collect()
        } else {
            below
        };
        if bound.is_empty() {
            let shares: Vec<(usize, f64)> = open.iter().map(|&i| (i, share(i))).collect();
            round_to_sum(&shares, left as usize, &mut dealt);
            return dealt.into_iter().flatten().collect();
        }
        for i in bound {
            let is_below = share(i) < low(i) as f64;
            dealt[i] = Some(if is_below {
                low(i)
            } else {
                components[i].len()
            });
        }
    }
}

/// Largest remainders: shares become whole numbers with the right sum.
fn round_to_sum(shares: &[(usize, f64)], sum: usize, dealt: &mut [Option<usize>]) {
    let mut by_remainder = shares.to_vec();
    by_remainder.sort_by(|a, b| b.1.fract().total_cmp(&a.1.fract()).then(a.0.cmp(&b.0)));
    let floors: usize = shares.iter().map(|s| s.1 as usize).sum();
    let n_more = sum.saturating_sub(floors);
    for (rank, (i, share)) in by_remainder.into_iter().enumerate() {
        dealt[i] = Some(share as usize + usize::from(rank < n_more));
    }
}

/// Simplifies one connected component; faces are in its own indices.
fn simplify_component(
    mesh: &TriMesh,
    target: usize,
    options: &SimplifyOptions,
    summary: &mut Summary,
) -> Vec<[u32; 3]> {
    if mesh.n_faces() <= target {
        return mesh.faces().to_vec();
    }
    let scaled = ScaledForMeshopt::new(mesh);
    let before = Surface::of(mesh.faces(), mesh.n_vertices());
    let mut locks = vec![SimplifyVertex::None; mesh.n_vertices()];
    let (mut faces, mut error_mm) = scaled.simplify(mesh, &locks, target, options);
    if before.is_manifold {
        let adjacency = vertex_adjacency(mesh);
        for retry in 0.. {
            let pinched = pinched_vertices(&faces, mesh.n_vertices(), before.is_closed);
            if pinched.is_empty() {
                break;
            }
            if retry == MAX_RETRIES {
                summary.n_pinched_components += 1;
                break;
            }
            // The pinched vertices and what lies around them in the original stay.
            for v in pinched {
                locks[v as usize] = SimplifyVertex::Lock;
                for &neighbor in adjacency.of(v) {
                    locks[neighbor as usize] = SimplifyVertex::Lock;
                }
            }
            (faces, error_mm) = scaled.simplify(mesh, &locks, target, options);
        }
    }
    summary.estimated_error_mm = summary.estimated_error_mm.max(error_mm);
    let mut edit = EditMesh::new(mesh.vertices().to_vec(), &faces);
    summary.n_sliver_changes += remove_slivers(&mut edit, options);
    edit.remaining_faces()
}

/// Positions as meshopt wants them: f32, centred, largest extent 1.
struct ScaledForMeshopt {
    positions: Vec<[f32; 3]>,
    extent: f64,
}

impl ScaledForMeshopt {
    fn new(mesh: &TriMesh) -> Self {
        let (low, high) = mesh.bounding_box();
        let center = nalgebra::center(&low, &high);
        let extent = (high - low).amax();
        // A component whose vertices all coincide has no extent; any scale will do.
        let scale = if extent > 0.0 { 1.0 / extent } else { 1.0 };
        let positions = mesh.vertices().iter().map(|p| {
            let q = (p - center) * scale;
            [q.x as f32, q.y as f32, q.z as f32]
        });
        Self {
            positions: positions.collect(),
            extent,
        }
    }

    fn simplify(
        &self,
        mesh: &TriMesh,
        locks: &[SimplifyVertex],
        target: usize,
        options: &SimplifyOptions,
    ) -> (Vec<[u32; 3]>, f64) {
        let max_error = match options.max_error_mm {
            Some(max_error_mm) if self.extent > 0.0 => max_error_mm / self.extent,
            // Far above any error on a mesh of extent 1, and its square is still finite in f32.
            _ => 1e6,
        };
        let mut error = 0.0;
        let indices = simplify_with_locks_decoder(
            mesh.faces().as_flattened(),
            &self.positions,
            locks,
            3 * target,
            max_error.clamp(0.0, 1e6) as f32,
            MeshoptOptions::Regularize,
            Some(&mut error),
        );
        let faces = indices.as_chunks::<3>().0.to_vec();
        (faces, f64::from(error) * self.extent)
    }
}

/// What a component was before, and should be after.
struct Surface {
    is_manifold: bool,
    is_closed: bool,
}

impl Surface {
    fn of(faces: &[[u32; 3]], n_vertices: usize) -> Self {
        let uses = edge_uses(faces);
        Self {
            is_manifold: pinched_vertices(faces, n_vertices, false).is_empty(),
            is_closed: by_edge(&uses).all(|uses| uses.len() > 1),
        }
    }
}

/// Vertices at which the faces are not a manifold, or not closed where they should be. Sorted.
fn pinched_vertices(faces: &[[u32; 3]], n_vertices: usize, is_closed: bool) -> Vec<u32> {
    let uses = edge_uses(faces);
    let mut pinched: Vec<u32> = by_edge(&uses)
        .filter(|uses| uses.len() > 2 || is_closed && uses.len() < 2)
        .flat_map(|uses| uses[0].edge)
        .chain(vertices_of_several_fans(faces, n_vertices))
        .collect();
    pinched.sort_unstable();
    pinched.dedup();
    pinched
}

/// Flips and collapses edges of slivers while that makes the worst angle around them better.
fn remove_slivers(edit: &mut EditMesh, options: &SimplifyOptions) -> usize {
    let mut n_changes = 0;
    for _ in 0..MAX_SLIVER_PASSES {
        let angle = |edit: &EditMesh, face: u32| {
            let corners = edit.face(face)?;
            let angle = smallest_corner_angle(&edit.points(&corners));
            (angle < options.sliver_angle_rad).then_some(angle)
        };
        let mut slivers: Vec<(f64, u32)> = (0..edit.n_face_slots() as u32)
            .filter_map(|face| Some((angle(edit, face)?, face)))
            .collect();
        slivers.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut n_in_pass = 0;
        for (_, face) in slivers {
            // An earlier change may have dealt with it.
            if angle(edit, face).is_some()
                && let Some(effect) = best_change(edit, face)
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

/// The flip, or else the collapse, of one edge of a face that most improves the worst angle.
fn best_change(edit: &EditMesh, face: u32) -> Option<Effect> {
    let [a, b, c] = edit.face(face)?;
    let edges = [[a, b], [b, c], [c, a]];
    let flips = edges.map(|[a, b]| Change::Flip { a, b });
    let collapses = edges.map(|[from, to]| Change::Collapse { from, to });
    let back = edges.map(|[to, from]| Change::Collapse { from, to });
    // Flips keep the number of faces, so they come first.
    best_of(edit, &flips).or_else(|| best_of(edit, &[collapses, back].concat()))
}

fn best_of(edit: &EditMesh, changes: &[Change]) -> Option<Effect> {
    let mut best: Option<(f64, Effect)> = None;
    for &change in changes {
        let Some(effect) = edit.effect(change) else {
            continue;
        };
        let (before, after) = edit.angles(&effect);
        let is_better = after > before && best.as_ref().is_none_or(|(angle, _)| after > *angle);
        if is_better && edit.keeps_normals(change, &effect, MIN_COS_OF_TURN) {
            best = Some((after, effect));
        }
    }
    best.map(|(_, effect)| effect)
}
