//! meshopt's edge collapse on one connected component, kept manifold.
//!
//! meshopt minimises quadric errors, but does not watch the topology: it may close the throat of a
//! narrow handle and leave edges with four faces. Where that happens to a manifold surface, the
//! vertices concerned are locked and the component is done again.

use meshopt::{SimplifyVertex, simplify_with_locks_decoder};
use nalgebra::Point3;

use crate::SimplifyOptions;
use crate::edit::EditMesh;
use crate::slivers::remove_slivers;
use crate::topology::{by_edge, edge_uses, vertices_of_several_fans};

/// How often a component is done again with pinched places held.
const MAX_RETRIES: usize = 12;

/// One way to simplify a component.
pub(crate) struct Attempt {
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) error_mm: f64,
    pub(crate) n_sliver_changes: usize,
    pub(crate) is_pinched: bool,
}

/// A component prepared for meshopt: f32 positions, centred, largest extent 1.
pub(crate) struct Collapser<'a> {
    vertices: &'a [Point3<f64>],
    faces: &'a [[u32; 3]],
    positions: Vec<[f32; 3]>,
    extent: f64,
    is_manifold: bool,
    is_closed: bool,
}

impl<'a> Collapser<'a> {
    pub(crate) fn new(vertices: &'a [Point3<f64>], faces: &'a [[u32; 3]]) -> Self {
        let first = vertices[0].coords;
        let low = vertices.iter().fold(first, |low, p| low.inf(&p.coords));
        let high = vertices.iter().fold(first, |high, p| high.sup(&p.coords));
        let extent = (high - low).amax();
        // A component whose vertices all coincide has no extent; any scale will do.
        let scale = if extent > 0.0 { 1.0 / extent } else { 1.0 };
        let positions = vertices.iter().map(|p| {
            let q = (p.coords - (low + (high - low) * 0.5)) * scale;
            [q.x as f32, q.y as f32, q.z as f32]
        });
        let uses = edge_uses(faces);
        Self {
            vertices,
            faces,
            positions: positions.collect(),
            extent,
            is_manifold: pinched_vertices(faces, vertices.len(), false).is_empty(),
            is_closed: by_edge(&uses).all(|uses| uses.len() > 1),
        }
    }

    pub(crate) fn attempt(&self, target: usize, options: &SimplifyOptions) -> Attempt {
        let n_vertices = self.vertices.len();
        let mut locks = vec![SimplifyVertex::None; n_vertices];
        let (mut faces, mut error_mm) = self.collapse(&locks, target, options);
        let mut is_pinched = false;
        if self.is_manifold {
            for retry in 0.. {
                let pinched = pinched_vertices(&faces, n_vertices, self.is_closed);
                is_pinched = !pinched.is_empty();
                if !is_pinched || retry == MAX_RETRIES {
                    break;
                }
                // The pinched vertices stay; if that is not enough, what lies around them in the
                // original too.
                for &v in &pinched {
                    locks[v as usize] = SimplifyVertex::Lock;
                }
                if retry >= MAX_RETRIES / 2 {
                    let is_near = |f: &&[u32; 3]| f.iter().any(|v| pinched.contains(v));
                    for &v in self.faces.iter().filter(is_near).flatten() {
                        locks[v as usize] = SimplifyVertex::Lock;
                    }
                }
                (faces, error_mm) = self.collapse(&locks, target, options);
            }
        }
        let mut edit = EditMesh::new(self.vertices.to_vec(), &faces);
        let n_sliver_changes = remove_slivers(&mut edit, options.sliver_angle_rad);
        Attempt {
            faces: edit.remaining_faces(),
            error_mm,
            n_sliver_changes,
            is_pinched,
        }
    }

    /// meshopt's faces and its estimate of their distance from the surface, mm.
    fn collapse(
        &self,
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
            self.faces.as_flattened(),
            &self.positions,
            locks,
            3 * target,
            max_error.clamp(0.0, 1e6) as f32,
            options.spacing.for_meshopt(),
            Some(&mut error),
        );
        let faces = indices.as_chunks::<3>().0.to_vec();
        (faces, f64::from(error) * self.extent)
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
