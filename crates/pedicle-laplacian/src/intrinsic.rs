//! Triangles that know only their lengths and how their sides are glued.
//!
//! ```text
//! flip:      k                     k        x = (c² + b² - a²) / 2c,  y = 2A / c
//!          / | \                 /   \      for the apex over the side of length c
//!       i ---+--- j    ──►     i ----- j    |kl| = √((x_k - x_l)² + (y_k + y_l)²)
//!          \ | /                 \   /
//!            l                     l        (the side ij becomes the side kl)
//! ```
//!
//! Side 3 f + k of face f runs from its corner k to its corner k + 1; two sides glued to each other
//! run opposite ways and have one length. A vertex is a mere label: two faces may share several
//! edges, an edge may begin and end at one vertex, and two sides of one face may be glued. Flips
//! make all of these. Fisher, Springborn, Schröder, Bobenko 2007; Sharp & Crane 2020, section 3.

use crate::triangle::TriangleShape;

/// In place of a twin: the side is part of the boundary.
pub(crate) const NO_TWIN: u32 = u32::MAX;

/// Triangles with lengths and gluing.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct IntrinsicTriangles {
    /// Vertex at which every side begins.
    pub(crate) starts: Vec<u32>,
    /// Length of every side.
    pub(crate) lengths: Vec<f64>,
    /// The side every side is glued to, or [`NO_TWIN`].
    pub(crate) twins: Vec<u32>,
}

/// The side after this one in its face.
pub(crate) fn next(side: u32) -> u32 {
    if side % 3 == 2 { side - 2 } else { side + 1 }
}

/// The side before this one in its face.
pub(crate) fn previous(side: u32) -> u32 {
    if side.is_multiple_of(3) {
        side + 2
    } else {
        side - 1
    }
}

impl IntrinsicTriangles {
    /// Number of sides, three a face.
    pub(crate) fn n_sides(&self) -> usize {
        self.starts.len()
    }

    /// Length of a side.
    pub(crate) fn length(&self, side: u32) -> f64 {
        self.lengths[side as usize]
    }

    /// Glues two sides to each other; a side glued to itself would be a fold and is not made.
    pub(crate) fn glue(&mut self, a: u32, b: u32) {
        self.twins[a as usize] = b;
        self.twins[b as usize] = a;
    }

    /// Corners of every face.
    pub(crate) fn faces(&self) -> Vec<[u32; 3]> {
        let faces = self.starts.chunks_exact(3);
        faces.map(|f| [f[0], f[1], f[2]]).collect()
    }

    /// Shape of every face.
    pub(crate) fn shapes(&self) -> Vec<TriangleShape> {
        let faces = self.lengths.chunks_exact(3);
        faces
            .map(|l| TriangleShape::from_lengths([l[1], l[2], l[0]]))
            .collect()
    }

    /// Cotangent of the angle that faces a side.
    pub(crate) fn cotangent_facing(&self, side: u32) -> f64 {
        let lengths = [side, next(side), previous(side)].map(|s| self.length(s));
        TriangleShape::from_lengths(lengths).cotangents[0]
    }

    /// Replaces the edge of a side by the other diagonal of its two faces.
    ///
    /// Refuses (false, nothing changed) at the boundary, where both sides belong to one face, and
    /// where one of the new faces would have no area in floating point.
    pub(crate) fn flip(&mut self, s: u32) -> bool {
        let t = self.twins[s as usize];
        if t == NO_TWIN || s / 3 == t / 3 {
            return false;
        }
        // s: i → j, s1: j → k, s2: k → i;   t: j → i, t1: i → l, t2: l → j.
        let (s1, s2, t1, t2) = (next(s), previous(s), next(t), previous(t));
        let [ij, jk, ki, il, lj] = [s, s1, s2, t1, t2].map(|side| self.length(side));
        let (x_k, y_k) = apex(ij, ki, jk);
        let (x_l, y_l) = apex(ij, il, lj);
        let kl = (x_k - x_l).hypot(y_k + y_l);
        let has_area = |lengths| TriangleShape::from_lengths(lengths).area > 0.0;
        if !has_area([kl, ki, il]) || !has_area([kl, lj, jk]) {
            return false;
        }
        // New faces: l → k → i → l in the place of the first, k → l → j → k in that of the second.
        let moves = [(s2, s1), (t1, s2), (t2, t1), (s1, t2)];
        let new_place = |side: u32| {
            let moved = moves.iter().find(|&&(from, _)| from == side);
            moved.map_or(side, |&(_, to)| to)
        };
        let old = moves.map(|(from, _)| {
            let from = from as usize;
            (self.starts[from], self.lengths[from], self.twins[from])
        });
        for ((_, to), (start, length, twin)) in moves.into_iter().zip(old) {
            self.starts[to as usize] = start;
            self.lengths[to as usize] = length;
            if twin == NO_TWIN {
                self.twins[to as usize] = NO_TWIN;
            } else {
                self.glue(to, new_place(twin));
            }
        }
        self.starts[s as usize] = self.starts[t1 as usize];
        self.starts[t as usize] = self.starts[s1 as usize];
        self.lengths[s as usize] = kl;
        self.lengths[t as usize] = kl;
        true
    }
}

/// Place of the apex over a base from (0, 0) to (base, 0), given its distances from the two ends.
fn apex(base: f64, from_start: f64, from_end: f64) -> (f64, f64) {
    let area = TriangleShape::from_lengths([base, from_start, from_end]).area;
    let x = 0.5 * (base + (from_start - from_end) * (from_start + from_end) / base);
    (x, 2.0 * area / base)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two faces over the unit square, cut along the diagonal 0 → 2.
    fn square() -> IntrinsicTriangles {
        let d = 2.0_f64.sqrt();
        IntrinsicTriangles {
            starts: vec![0, 1, 2, 2, 3, 0],
            lengths: vec![1.0, 1.0, d, 1.0, 1.0, d],
            twins: vec![NO_TWIN, NO_TWIN, 5, NO_TWIN, NO_TWIN, 2],
        }
    }

    fn is_glued_well(triangles: &IntrinsicTriangles) -> bool {
        (0..triangles.n_sides() as u32).all(|s| {
            let t = triangles.twins[s as usize];
            t == NO_TWIN
                || (triangles.twins[t as usize] == s
                    && triangles.length(s).to_bits() == triangles.length(t).to_bits()
                    && triangles.starts[s as usize] == triangles.starts[next(t) as usize]
                    && triangles.starts[t as usize] == triangles.starts[next(s) as usize])
        })
    }

    #[test]
    fn flip_takes_the_other_diagonal() {
        let mut triangles = square();
        triangles.lengths[0] = 2.0;
        triangles.lengths[3] = 2.0;
        triangles.lengths[2] = 5.0_f64.sqrt();
        triangles.lengths[5] = 5.0_f64.sqrt();
        assert!(
            triangles.flip(2),
            "the diagonal of a rectangle can be flipped"
        );
        assert!(is_glued_well(&triangles), "gluing after the flip");
        let ends = [triangles.starts[2], triangles.starts[5]];
        assert_eq!(
            [ends[0].min(ends[1]), ends[0].max(ends[1])],
            [1, 3],
            "diagonal"
        );
        assert!(
            (triangles.lengths[2] - 5.0_f64.sqrt()).abs() < 1e-15,
            "length"
        );
    }

    #[test]
    fn four_flips_are_none() {
        let mut triangles = square();
        for _ in 0..4 {
            assert!(triangles.flip(2), "flip");
            assert!(is_glued_well(&triangles), "gluing after the flip");
        }
        assert_eq!(triangles.starts, square().starts, "corners");
        for (a, b) in triangles.lengths.iter().zip(square().lengths) {
            assert!((a - b).abs() < 1e-15, "length {a} against {b}");
        }
    }

    #[test]
    fn pillow_of_an_obtuse_triangle_gets_an_edge_from_its_apex_to_itself() {
        // Both sides of one triangle with lengths 01 = 3, 12 = 2, 20 = 2.
        let mut pillow = IntrinsicTriangles {
            starts: vec![0, 1, 2, 0, 2, 1],
            lengths: vec![3.0, 2.0, 2.0, 2.0, 2.0, 3.0],
            twins: vec![5, 4, 3, 2, 1, 0],
        };
        assert!(is_glued_well(&pillow), "gluing");
        assert!(pillow.flip(0), "flip");
        assert!(is_glued_well(&pillow), "gluing after the flip");
        assert_eq!([pillow.starts[0], pillow.starts[5]], [2, 2], "a loop");
        let height = (4.0_f64 - 2.25).sqrt();
        assert!(
            (pillow.lengths[0] - 2.0 * height).abs() < 1e-15,
            "its length"
        );
        // The two sides of equal length in a face are glued to each other: no flip there.
        let before = pillow.clone();
        assert!(!pillow.flip(next(0)), "refused");
        assert_eq!(pillow, before, "unchanged");
    }

    #[test]
    fn boundary_is_not_flipped() {
        assert!(!square().flip(0), "boundary");
    }
}
