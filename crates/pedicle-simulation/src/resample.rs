//! A triangulation of its own for a surface, with every vertex on that surface.
//!
//! ```text
//! v' = w v + (1 - w) ((1 - s) a + s b),   w uniform in [0.55, 0.8], s uniform in [0.05, 0.95]
//! ```
//!
//! Every vertex v of the full-resolution surface moves into the inside of one of its triangles
//! (v, a, b), drawn at random, and the surface with those vertices is then simplified. Simplifying
//! keeps vertices, so all that remain lie on the surface to rounding, none is a vertex of the
//! source, and which remain follows from other shapes and another number of faces than the
//! source's. Lengths in mm.

use nalgebra::Vector3;
use pedicle_mesh::{SimplifyOptions, TriMesh, simplify};
use rand::{Rng, RngExt};

use crate::SimulationError;

/// Share of the way that a vertex keeps of itself: little enough to be somewhere else, enough to
/// turn no face over.
const OWN_WEIGHT: [f64; 2] = [0.55, 0.8];
/// Where on the opposite edge it moves to.
const EDGE_SHARE: [f64; 2] = [0.05, 0.95];
/// Faces of the result over those of the simplified source.
const FACE_RATIO: [f64; 2] = [0.7, 1.6];

/// A surface with vertices of its own.
#[derive(Debug, Clone)]
pub(crate) struct Resampled {
    pub(crate) mesh: TriMesh,
    /// Unit normals of the full-resolution surface at the vertices.
    pub(crate) normals: Vec<Vector3<f64>>,
}

/// How many faces a target has for each face of the simplified source.
pub(crate) fn face_ratio(rng: &mut impl Rng) -> f64 {
    rng.random_range(FACE_RATIO[0]..=FACE_RATIO[1])
}

/// Triangulates `surface` anew with about `n_faces` faces.
pub(crate) fn resampled(
    surface: &TriMesh,
    n_faces: usize,
    rng: &mut impl Rng,
) -> Result<Resampled, SimulationError> {
    let moved = moved_inside_faces(surface, rng)?;
    let normals = moved.vertex_normals();
    let simple = simplify(&moved, n_faces, &SimplifyOptions::default())?;
    let normals = simple
        .source_vertex
        .iter()
        .map(|&v| normals[v as usize])
        .collect();
    Ok(Resampled {
        mesh: simple.mesh,
        normals,
    })
}

fn moved_inside_faces(surface: &TriMesh, rng: &mut impl Rng) -> Result<TriMesh, SimulationError> {
    // One face a vertex, each of its faces with the same chance: the k-th one replaces the choice
    // with probability 1 / k.
    let mut chosen: Vec<Option<usize>> = vec![None; surface.n_vertices()];
    let mut n_seen = vec![0u32; surface.n_vertices()];
    for (face, corners) in surface.faces().iter().enumerate() {
        for &v in corners {
            let v = v as usize;
            n_seen[v] += 1;
            if rng.random_range(0..n_seen[v]) == 0 {
                chosen[v] = Some(face);
            }
        }
    }
    let mut vertices = surface.vertices().to_vec();
    for (v, face) in chosen.into_iter().enumerate() {
        let own = rng.random_range(OWN_WEIGHT[0]..=OWN_WEIGHT[1]);
        let along = rng.random_range(EDGE_SHARE[0]..=EDGE_SHARE[1]);
        let Some(face) = face else {
            continue;
        };
        let corners = surface.faces()[face];
        let mut others = corners.into_iter().filter(|&c| c as usize != v);
        let (Some(a), Some(b)) = (others.next(), others.next()) else {
            continue;
        };
        let [a, b] = [a, b].map(|c| surface.vertices()[c as usize].coords);
        let opposite = a * (1.0 - along) + b * along;
        vertices[v] = (surface.vertices()[v].coords * own + opposite * (1.0 - own)).into();
    }
    Ok(TriMesh::new(vertices, surface.faces().to_vec())?)
}
