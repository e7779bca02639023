//! A mesh under the knife: edge flips and edge collapses that keep its topology.
//!
//! Vertices never move and none is made, so every result is a subset of the original vertices.
//! A collapse is admitted by the link condition (Dey, Edelsbrunner, Guha & Nekhayev 1999): the
//! two ends may share no neighbours but those across the faces of their edge.

use nalgebra::{Point3, Vector3};

use crate::TriMesh;
use crate::measures::smallest_corner_angle;
use crate::topology::is_proper;

/// Below this corner angle (about 3°) the direction of a face says little about the surface.
const SLIVER_ANGLE_RAD: f64 = 0.05;

/// One local change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Moves all faces of `from` to `to`.
    Collapse { from: u32, to: u32 },
    /// Exchanges the edge of two faces for the other diagonal of their quadrilateral.
    Flip { a: u32, b: u32 },
}

/// What a change takes away and what it puts there.
#[derive(Debug, Clone, Default)]
pub(crate) struct Effect {
    /// Faces that change or disappear.
    pub(crate) before: Vec<u32>,
    /// The new faces: as many as `before` for a flip, fewer for a collapse.
    pub(crate) after: Vec<[u32; 3]>,
}

/// A mesh with removable faces and the faces of every vertex.
#[derive(Debug, Clone)]
pub(crate) struct EditMesh {
    vertices: Vec<Point3<f64>>,
    faces: Vec<Option<[u32; 3]>>,
    faces_of_vertex: Vec<Vec<u32>>,
}

impl EditMesh {
    /// Takes vertices and faces; faces that name a vertex twice are left out.
    pub(crate) fn new(vertices: Vec<Point3<f64>>, faces: &[[u32; 3]]) -> Self {
        let mut faces_of_vertex = vec![Vec::new(); vertices.len()];
        let mut kept = Vec::with_capacity(faces.len());
        for (face, corners) in faces.iter().enumerate() {
            let proper = is_proper(corners);
            kept.push(proper.then_some(*corners));
            if proper {
                for &v in corners {
                    faces_of_vertex[v as usize].push(face as u32);
                }
            }
        }
        Self {
            vertices,
            faces: kept,
            faces_of_vertex,
        }
    }

    pub(crate) fn n_face_slots(&self) -> usize {
        self.faces.len()
    }

    /// The corners of a face, or `None` if it is gone.
    pub(crate) fn face(&self, face: u32) -> Option<[u32; 3]> {
        self.faces[face as usize]
    }

    pub(crate) fn remaining_faces(&self) -> Vec<[u32; 3]> {
        self.faces.iter().flatten().copied().collect()
    }

    pub(crate) fn points(&self, corners: &[u32; 3]) -> [Point3<f64>; 3] {
        corners.map(|v| self.vertices[v as usize])
    }

    /// Length of the edge between two vertices.
    pub(crate) fn distance(&self, a: u32, b: u32) -> f64 {
        (self.vertices[a as usize] - self.vertices[b as usize]).norm()
    }

    pub(crate) fn remove_face(&mut self, face: u32) {
        if let Some(corners) = self.faces[face as usize].take() {
            for v in corners {
                self.faces_of_vertex[v as usize].retain(|&f| f != face);
            }
        }
    }

    /// Smallest corner angle of the faces that a change touches, before and after, radians.
    pub(crate) fn angles(&self, effect: &Effect) -> (f64, f64) {
        let of = |corners: &[u32; 3]| smallest_corner_angle(&self.points(corners));
        let before = effect.before.iter().filter_map(|&f| self.face(f));
        let before = before
            .map(|corners| of(&corners))
            .fold(f64::INFINITY, f64::min);
        let after = effect.after.iter().map(of).fold(f64::INFINITY, f64::min);
        (before, after)
    }

    /// Whether no new face turns from the surface before by more than the angle with cosine
    /// `min_cos`.
    ///
    /// After a flip, and for a face that was a sliver and had hardly a direction of its own, the
    /// surface before is the mean of all faces concerned by area; otherwise it is the face that
    /// the new one comes from.
    pub(crate) fn keeps_normals(&self, change: Change, effect: &Effect, min_cos: f64) -> bool {
        let scaled_normal = |corners: &[u32; 3]| {
            let [a, b, c] = self.points(corners);
            (b - a).cross(&(c - a))
        };
        let before: Vec<[u32; 3]> = effect.before.iter().filter_map(|&f| self.face(f)).collect();
        let mean: Vector3<f64> = before.iter().map(scaled_normal).sum();
        let agree = |old: Vector3<f64>, new: &[u32; 3]| {
            let new = scaled_normal(new);
            // A direction of zero length agrees with every other.
            old.dot(&new) >= min_cos * old.norm() * new.norm()
        };
        match change {
            Change::Flip { .. } => effect.after.iter().all(|new| agree(mean, new)),
            Change::Collapse { to, .. } => {
                let moved = before.iter().filter(|old| !old.contains(&to));
                moved.zip(&effect.after).all(|(old, new)| {
                    let is_sliver = smallest_corner_angle(&self.points(old)) < SLIVER_ANGLE_RAD;
                    agree(if is_sliver { mean } else { scaled_normal(old) }, new)
                })
            }
        }
    }

    /// What a change would do; `None` if it would damage the topology.
    pub(crate) fn effect(&self, change: Change) -> Option<Effect> {
        match change {
            Change::Collapse { from, to } => self.collapse_effect(from, to),
            Change::Flip { a, b } => self.flip_effect(a, b),
        }
    }

    pub(crate) fn apply(&mut self, effect: &Effect) {
        let slots = &effect.before;
        for &face in slots {
            self.remove_face(face);
        }
        // New faces take the lowest slots, so the order of faces does not depend on history.
        for (&face, &corners) in slots.iter().zip(&effect.after) {
            self.faces[face as usize] = Some(corners);
            for v in corners {
                self.faces_of_vertex[v as usize].push(face);
            }
        }
    }

    fn collapse_effect(&self, from: u32, to: u32) -> Option<Effect> {
        let on_edge = self.faces_of_edge(from, to);
        if !matches!(on_edge.len(), 1 | 2) {
            return None;
        }
        let mut across: Vec<u32> = on_edge
            .iter()
            .filter_map(|&face| self.face(face))
            .flat_map(|corners| corners.into_iter().filter(|&v| v != from && v != to))
            .collect();
        across.sort_unstable();
        let of_from = self.neighbors(from);
        let of_to = self.neighbors(to);
        let common: Vec<u32> = of_from.into_iter().filter(|v| of_to.contains(v)).collect();
        if common != across {
            return None;
        }
        // An inner edge between two boundary vertices would pinch the surface.
        if on_edge.len() == 2 && self.is_on_boundary(from) && self.is_on_boundary(to) {
            return None;
        }
        let mut effect = Effect::default();
        for &face in &self.faces_of_vertex[from as usize] {
            let corners = self.face(face)?;
            effect.before.push(face);
            if corners.contains(&to) {
                continue;
            }
            let moved = corners.map(|v| if v == from { to } else { v });
            // The last faces of a tetrahedron would fold onto each other.
            if self.has_face(&moved) {
                return None;
            }
            effect.after.push(moved);
        }
        Some(effect)
    }

    fn flip_effect(&self, a: u32, b: u32) -> Option<Effect> {
        let [f, g] = self.faces_of_edge(a, b)[..] else {
            return None;
        };
        let opposite = |face: u32, from: u32, to: u32| {
            let corners = self.face(face)?;
            let i = corners.iter().position(|&v| v == from)?;
            (corners[(i + 1) % 3] == to).then(|| corners[(i + 2) % 3])
        };
        // One face runs from a to b, the other back; otherwise one of them is turned over.
        let (c, d) = match (opposite(f, a, b), opposite(g, b, a)) {
            (Some(c), Some(d)) => (c, d),
            _ => (opposite(g, a, b)?, opposite(f, b, a)?),
        };
        if c == d || !self.faces_of_edge(c, d).is_empty() {
            return None;
        }
        Some(Effect {
            before: vec![f, g],
            after: vec![[c, a, d], [d, b, c]],
        })
    }

    /// Faces on an edge, increasing.
    fn faces_of_edge(&self, a: u32, b: u32) -> Vec<u32> {
        let of_a = &self.faces_of_vertex[a as usize];
        let on_edge = |&&face: &&u32| self.face(face).is_some_and(|corners| corners.contains(&b));
        let mut faces: Vec<u32> = of_a.iter().filter(on_edge).copied().collect();
        faces.sort_unstable();
        faces
    }

    /// Neighbours of a vertex, increasing.
    pub(crate) fn neighbors(&self, vertex: u32) -> Vec<u32> {
        let faces = &self.faces_of_vertex[vertex as usize];
        let corners = faces.iter().filter_map(|&face| self.face(face)).flatten();
        let mut neighbors: Vec<u32> = corners.filter(|&v| v != vertex).collect();
        neighbors.sort_unstable();
        neighbors.dedup();
        neighbors
    }

    fn is_on_boundary(&self, vertex: u32) -> bool {
        self.neighbors(vertex)
            .into_iter()
            .any(|neighbor| self.faces_of_edge(vertex, neighbor).len() == 1)
    }

    fn has_face(&self, corners: &[u32; 3]) -> bool {
        let of_first = &self.faces_of_vertex[corners[0] as usize];
        of_first.iter().any(|&face| {
            self.face(face)
                .is_some_and(|other| corners.iter().all(|v| other.contains(v)))
        })
    }
}

/// The faces with the vertices they use, in their original order, and where those come from.
pub(crate) fn compacted(
    vertices: &[Point3<f64>],
    faces: &[[u32; 3]],
) -> Result<(TriMesh, Vec<u32>), crate::MeshError> {
    let mut new_index = vec![u32::MAX; vertices.len()];
    for &v in faces.iter().flatten() {
        new_index[v as usize] = 0;
    }
    let mut source_vertex = Vec::new();
    for (old, slot) in new_index.iter_mut().enumerate() {
        if *slot == 0 {
            *slot = source_vertex.len() as u32;
            source_vertex.push(old as u32);
        }
    }
    let kept = source_vertex
        .iter()
        .map(|&v| vertices[v as usize])
        .collect();
    let faces = faces
        .iter()
        .map(|f| f.map(|v| new_index[v as usize]))
        .collect();
    Ok((TriMesh::new(kept, faces)?, source_vertex))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tetrahedron, or two glued together along [0, 1, 2] if there is a fifth vertex.
    fn bipyramid(n_vertices: usize) -> EditMesh {
        let points = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.3, 0.3, 1.0],
            [0.3, 0.3, -1.0],
        ];
        let mut faces = vec![[0, 1, 3], [1, 2, 3], [2, 0, 3]];
        match n_vertices {
            4 => faces.push([0, 2, 1]),
            _ => faces.extend([[1, 0, 4], [2, 1, 4], [0, 2, 4]]),
        }
        let vertices = points[..n_vertices]
            .iter()
            .copied()
            .map(Point3::from)
            .collect();
        EditMesh::new(vertices, &faces)
    }

    #[test]
    fn a_tetrahedron_cannot_be_collapsed_or_flipped() {
        let mesh = bipyramid(4);
        for from in 0..4 {
            for to in (0..4).filter(|&to| to != from) {
                assert!(
                    mesh.effect(Change::Collapse { from, to }).is_none(),
                    "{from} to {to}"
                );
                assert!(
                    mesh.effect(Change::Flip { a: from, b: to }).is_none(),
                    "{from}-{to}"
                );
            }
        }
    }

    #[test]
    fn the_link_condition_spares_the_waist_of_a_bipyramid() {
        let mut mesh = bipyramid(5);
        let waist = Change::Collapse { from: 0, to: 1 };
        assert!(
            mesh.effect(waist).is_none(),
            "vertex 2 is a third common neighbour"
        );
        let apex = Change::Collapse { from: 3, to: 0 };
        let effect = mesh.effect(apex).expect("an apex may go");
        mesh.apply(&effect);
        assert_eq!(
            mesh.remaining_faces(),
            [[1, 2, 0], [1, 0, 4], [2, 1, 4], [0, 2, 4]],
            "4 faces"
        );
    }

    #[test]
    fn a_flip_swaps_the_diagonal_and_a_second_flip_swaps_it_back() {
        let mut mesh = bipyramid(5);
        let flip = Change::Flip { a: 0, b: 1 };
        let effect = mesh
            .effect(flip)
            .expect("the edge between the two apexes is free");
        assert_eq!(effect.after, [[3, 0, 4], [4, 1, 3]], "the other diagonal");
        mesh.apply(&effect);
        let back = mesh
            .effect(Change::Flip { a: 3, b: 4 })
            .expect("the old edge is free");
        mesh.apply(&back);
        let mut faces = mesh.remaining_faces();
        faces.sort_unstable();
        assert!(
            faces.contains(&[1, 0, 4]) || faces.contains(&[0, 4, 1]) || faces.contains(&[4, 1, 0]),
            "{faces:?}"
        );
        assert_eq!(faces.len(), 6, "six faces");
    }
}
