//! Sides of faces, grouped by the edge they lie on.
//!
//! Side k of face f has the number 3 f + k and runs from corner k to corner k + 1. A side is
//! forward if it runs from the lower vertex to the higher.

/// One side of one face on its edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct EdgeSide {
    /// The edge, lower vertex first.
    pub(crate) edge: [u32; 2],
    /// Number of the side.
    pub(crate) side: u32,
}

impl EdgeSide {
    /// The face the side belongs to.
    pub(crate) fn face(&self) -> usize {
        self.side as usize / 3
    }

    /// Corner of the face at which the side begins.
    pub(crate) fn corner(&self) -> usize {
        self.side as usize % 3
    }

    /// Whether the side runs from the lower vertex to the higher.
    pub(crate) fn is_forward(&self, faces: &[[u32; 3]]) -> bool {
        faces[self.face()][self.corner()] == self.edge[0]
    }
}

/// All sides of all faces, sorted by edge, then by number.
pub(crate) fn sides_by_edge(faces: &[[u32; 3]]) -> Vec<EdgeSide> {
    let mut sides = Vec::with_capacity(3 * faces.len());
    for (face, corners) in faces.iter().enumerate() {
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            sides.push(EdgeSide {
                edge: [from.min(to), from.max(to)],
                side: (3 * face + k) as u32,
            });
        }
    }
    sides.sort_unstable();
    sides
}

/// The sides of one edge after another.
pub(crate) fn edges(sides: &[EdgeSide]) -> impl Iterator<Item = &[EdgeSide]> {
    sides.chunk_by(|a, b| a.edge == b.edge)
}
