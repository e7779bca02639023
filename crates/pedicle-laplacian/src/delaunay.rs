//! Intrinsic Delaunay triangulation by edge flips.
//!
//! ```text
//! flip every edge with cot α + cot β < 0   (α, β: the angles that face it)
//! ```
//!
//! Afterwards all weights of the cotangent matrix are non-negative, except at the boundary of a
//! surface with one, whose edges stay. The surface does not change, only its triangles. The flips
//! end after finitely many steps whatever their order (Indermitte et al. 2001); a queue makes the
//! usual work linear. Fisher, Springborn, Schröder, Bobenko 2007; Bobenko & Springborn 2007.

use std::collections::VecDeque;

use crate::intrinsic::{IntrinsicTriangles, NO_TWIN, next, previous};

/// Sums of cotangents above minus this share of their magnitudes (plus 1) count as zero: four
/// points on one circle leave only rounding behind, which must not turn in circles.
const FLIP_TOLERANCE: f64 = 1e-10;

/// Flips a side may see on average before the work is cut off. Real surfaces need less than one.
const MAX_FLIPS_PER_SIDE: usize = 64;

/// What the flips came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Flips {
    /// Number of flips.
    pub(crate) n_flips: usize,
    /// Edges that are not Delaunay at the end: 0 unless a flip would have made a face without
    /// area or the work was cut off.
    pub(crate) n_left: usize,
}

/// Flips edges until all of them are Delaunay.
pub(crate) fn flip_to_delaunay(triangles: &mut IntrinsicTriangles) -> Flips {
    let n_sides = triangles.n_sides();
    // One side stands for its edge: the lower of the two at the time of queueing.
    let mut queue: VecDeque<u32> = (0..n_sides as u32)
        .filter(|&s| s < triangles.twins[s as usize] && triangles.twins[s as usize] != NO_TWIN)
        .collect();
    let mut is_queued = vec![false; n_sides];
    for &s in &queue {
        is_queued[s as usize] = true;
    }
    let mut n_flips = 0;
    let max_flips = MAX_FLIPS_PER_SIDE * n_sides;
    while let Some(s) = queue.pop_front() {
        is_queued[s as usize] = false;
        if n_flips == max_flips || is_delaunay(triangles, s) || !triangles.flip(s) {
            continue;
        }
        n_flips += 1;
        let t = triangles.twins[s as usize];
        for side in [next(s), previous(s), next(t), previous(t)] {
            let twin = triangles.twins[side as usize];
            // A flip moves sides within their faces, so marks are of places and may be out of date:
            // an edge queued twice only costs a test.
            if twin != NO_TWIN && !is_queued[side as usize] {
                is_queued[side as usize] = true;
                queue.push_back(side);
            }
        }
    }
    let n_left = (0..n_sides as u32)
        .filter(|&s| s < triangles.twins[s as usize] && !is_delaunay(triangles, s))
        .count();
    Flips { n_flips, n_left }
}

/// Whether an edge may stay. The boundary always may, and so may an edge with one face on both
/// sides: two angles of one triangle sum to less than π.
fn is_delaunay(triangles: &IntrinsicTriangles, s: u32) -> bool {
    let t = triangles.twins[s as usize];
    if t == NO_TWIN || s / 3 == t / 3 {
        return true;
    }
    let (a, b) = (triangles.cotangent_facing(s), triangles.cotangent_facing(t));
    a + b >= -FLIP_TOLERANCE * (1.0 + a.abs() + b.abs())
}
