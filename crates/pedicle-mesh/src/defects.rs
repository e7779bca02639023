//! What is wrong with a mesh, counted and named; nothing is changed.

use std::collections::BTreeMap;

use crate::TriMesh;
use crate::measures::{is_degenerate, smallest_angle_rad};
use crate::topology::{by_edge, connected_components, edge_uses, is_proper, non_manifold_vertices};

/// Everything about a mesh that a later step may stumble over. Lists are sorted.
#[derive(Debug, Clone, PartialEq)]
pub struct Defects {
    /// Vertices that no face uses.
    pub unreferenced_vertices: Vec<u32>,
    /// Faces that name a vertex twice.
    pub repeated_index_faces: Vec<u32>,
    /// Faces of three different vertices without area: their height is below 1e-10 of their
    /// longest edge.
    pub zero_area_faces: Vec<u32>,
    /// Faces with the same three vertices as an earlier one, in either orientation.
    pub duplicate_faces: Vec<u32>,
    /// Edges of three or more faces, lower vertex first.
    pub non_manifold_edges: Vec<[u32; 2]>,
    /// Vertices whose faces form more than one fan.
    pub non_manifold_vertices: Vec<u32>,
    /// Edges whose two faces run the same way: one of the two faces is turned over.
    pub inconsistent_edges: Vec<[u32; 2]>,
    /// Edges of one face; 0 for a closed surface.
    pub n_boundary_edges: usize,
    /// Smallest corner angle, radians; 0 if a face has no area.
    pub smallest_angle_rad: f64,
    /// Number of connected components.
    pub n_components: usize,
}

impl Defects {
    /// Whether nothing is left for `repair` to remove. Boundaries, non-manifold places and
    /// turned faces are no obstacle: `repair` leaves them alone.
    #[must_use]
    pub fn is_repaired(&self) -> bool {
        self.unreferenced_vertices.is_empty()
            && self.repeated_index_faces.is_empty()
            && self.zero_area_faces.is_empty()
            && self.duplicate_faces.is_empty()
    }

    /// Whether the surface is closed, manifold and consistently oriented.
    #[must_use]
    pub fn is_closed_oriented_manifold(&self) -> bool {
        self.n_boundary_edges == 0
            && self.repeated_index_faces.is_empty()
            && self.non_manifold_edges.is_empty()
            && self.non_manifold_vertices.is_empty()
            && self.inconsistent_edges.is_empty()
    }
}

/// Looks a mesh over.
#[must_use]
pub fn defects(mesh: &TriMesh) -> Defects {
    let mut is_used = vec![false; mesh.n_vertices()];
    for &v in mesh.faces().iter().flatten() {
        is_used[v as usize] = true;
    }
    let faces = || mesh.faces().iter().enumerate();
    let uses = edge_uses(mesh.faces());
    let edges_where = |wanted: &dyn Fn(&[crate::topology::EdgeUse]) -> bool| {
        by_edge(&uses)
            .filter(|uses| wanted(uses))
            .map(|uses| uses[0].edge)
            .collect::<Vec<_>>()
    };
    Defects {
        unreferenced_vertices: (0..mesh.n_vertices() as u32)
            .filter(|&v| !is_used[v as usize])
            .collect(),
        repeated_index_faces: faces()
            .filter(|(_, corners)| !is_proper(corners))
            .map(|(face, _)| face as u32)
            .collect(),
        zero_area_faces: faces()
            .filter(|&(face, corners)| is_proper(corners) && is_degenerate(&mesh.triangle(face)))
            .map(|(face, _)| face as u32)
            .collect(),
        duplicate_faces: duplicate_faces(mesh.faces()),
        non_manifold_edges: edges_where(&|uses| uses.len() > 2),
        non_manifold_vertices: non_manifold_vertices(mesh),
        inconsistent_edges: edges_where(&|uses| {
            uses.len() == 2 && uses[0].forward == uses[1].forward
        }),
        n_boundary_edges: by_edge(&uses).filter(|uses| uses.len() == 1).count(),
        smallest_angle_rad: smallest_angle_rad(mesh),
        n_components: connected_components(mesh).n_components,
    }
}

/// Proper faces whose vertices an earlier face has too.
fn duplicate_faces(faces: &[[u32; 3]]) -> Vec<u32> {
    let mut seen = BTreeMap::new();
    let mut duplicates = Vec::new();
    for (face, corners) in faces.iter().enumerate().filter(|(_, f)| is_proper(f)) {
        let mut key = *corners;
        key.sort_unstable();
        if *seen.entry(key).or_insert(face) != face {
            duplicates.push(face as u32);
        }
    }
    duplicates
}
