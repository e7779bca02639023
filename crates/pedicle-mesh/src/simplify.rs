//! Fewer faces for the same surface, out of the original vertices.
//!
//! ```text
//! f_i ≈ F · A_i / Σ A_j       (faces of component i out of F, by its area A_i)
//! ```
//!
//! Each connected component is simplified on its own by meshopt's quadric edge collapse (Garland
//! & Heckbert 1997) with its regularity term, so that no component starves and none is welded to
//! another where they touch. meshopt works on f32: positions are centred and scaled for it, and
//! its answer is only used as indices, so the vertices that remain are original bit by bit.
//! Afterwards slivers are flipped or collapsed away, and where meshopt pinched a manifold surface
//! the place is held and the component is done again.

use meshopt::SimplifyOptions as MeshoptOptions;

use crate::collapse::{Attempt, Collapser};
use crate::edit::{EditMesh, compacted};
use crate::measures::smallest_angle_rad;
use crate::slivers::{BAD_ANGLE_RAD, remove_slivers};
use crate::topology::{connected_components, is_proper};
use crate::{MeshError, TriMesh};

/// No closed surface has fewer faces than a tetrahedron.
const MIN_TARGET: usize = 4;

/// How often meshopt is asked again for the faces that slivers took.
const MAX_ATTEMPTS: usize = 4;

/// How the faces of the target are dealt out to the components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FaceShare {
    /// By area: edges become equally long everywhere.
    #[default]
    Area,
    /// By number of faces: every component shrinks by the same factor.
    FaceCount,
}

/// How the remaining vertices spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Spacing {
    /// Evenly, for well-shaped faces: operators and maps between surfaces like them.
    #[default]
    Even,
    /// Denser where the surface is curved: about a quarter closer to it with as many faces.
    Adaptive,
}

impl Spacing {
    pub(crate) fn for_meshopt(self) -> MeshoptOptions {
        match self {
            Self::Even => MeshoptOptions::Regularize,
            Self::Adaptive => MeshoptOptions::RegularizeLight,
        }
    }
}

/// How to simplify.
#[derive(Debug, Clone, PartialEq)]
pub struct SimplifyOptions {
    /// How the faces of the target are dealt out to the components. Default: by area.
    pub share: FaceShare,
    /// How the remaining vertices spread. Default: evenly.
    pub spacing: Spacing,
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
            spacing: Spacing::Even,
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
///
/// Collapsing slivers takes faces beyond the target, so meshopt is asked again for as many more.
fn simplify_component(
    mesh: &TriMesh,
    target: usize,
    options: &SimplifyOptions,
    summary: &mut Summary,
) -> Vec<[u32; 3]> {
    if mesh.n_faces() <= target {
        return mesh.faces().to_vec();
    }
    // Slivers of the input go first, while there is room around them: left in the narrow throat
    // of a handle they could not be removed without closing it.
    let mut edit = EditMesh::new(mesh.vertices().to_vec(), mesh.faces());
    let n_cleaned = remove_slivers(&mut edit, options.sliver_angle_rad.min(BAD_ANGLE_RAD));
    let cleaned = edit.remaining_faces();
    let collapser = Collapser::new(mesh.vertices(), &cleaned);
    let mut best: Option<Attempt> = None;
    let mut asked = target.min(cleaned.len());
    for _ in 0..MAX_ATTEMPTS {
        let attempt = collapser.attempt(asked, options);
        let n_faces = attempt.faces.len();
        let is_better = best.as_ref().is_none_or(|best| {
            let key = |a: &Attempt| (a.is_pinched, a.faces.len().abs_diff(target));
            key(&attempt) < key(best)
        });
        if is_better {
            best = Some(attempt);
        }
        // Closed surfaces have an even number of faces, so one off is as good as it gets; more
        // than the target means that the topology forbids to go further.
        if n_faces + 1 >= target {
            break;
        }
        asked = (asked + target - n_faces).min(cleaned.len());
    }
    let Some(best) = best else {
        return cleaned;
    };
    summary.estimated_error_mm = summary.estimated_error_mm.max(best.error_mm);
    summary.n_sliver_changes += n_cleaned + best.n_sliver_changes;
    summary.n_pinched_components += usize::from(best.is_pinched);
    best.faces
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    /// Components of `counts` faces each, all faces of the same area.
    fn dealt(counts: &[u32], target: usize) -> Vec<usize> {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let n_faces = counts.iter().sum::<u32>() as usize;
        let mesh = TriMesh::new(points.to_vec(), vec![[0, 1, 2]; n_faces]).unwrap();
        let mut first = 0;
        let components: Vec<Vec<u32>> = counts
            .iter()
            .map(|&n| {
                first += n;
                (first - n..first).collect()
            })
            .collect();
        deal_out(&mesh, &components, target, &SimplifyOptions::default())
    }

    #[test]
    fn shares_are_proportional_and_add_up() {
        assert_eq!(
            dealt(&[1000, 2000, 4000], 700),
            [100, 200, 400],
            "no rounding"
        );
        assert_eq!(
            dealt(&[1000, 1000, 1000], 100),
            [34, 33, 33],
            "the first gets the rest"
        );
        assert_eq!(dealt(&[500], 80), [80], "one component gets all");
    }

    #[test]
    fn small_components_keep_their_minimum_and_none_gets_more_than_it_has() {
        assert_eq!(
            dealt(&[10, 100, 10_000], 500),
            [10, 24, 466],
            "10 of 10, 24, the rest"
        );
        assert_eq!(
            dealt(&[100, 100, 100], 30),
            [24, 24, 24],
            "the minimum exceeds the target"
        );
        assert_eq!(dealt(&[50, 50], 200), [50, 50], "nothing to remove");
    }
}
