//! One rigid ICP of the whole spine, from the landmarks.
//!
//! ```text
//! T = argmin Σ_j ρ( n_j · (T⁻¹ p_j - q_j) )
//! ```
//!
//! p_j are all target points, q_j the closest points of the full-resolution triangles of all five
//! vertebrae. Right where the spine has not bent since the CT.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{ReferenceSurface, RefineOptions, refine_on_surface};

use super::{Seen, Source, landmarks_only, thinned};

/// Most target points that take part.
const N_POINTS: usize = 4000;
/// First and last gate, mm: the landmarks leave turns of tens of degrees about their line.
const GATES_MM: (f64, f64) = (25.0, 5.0);
/// Iterations over which the gate shrinks, and most in all.
const ITERATIONS: (usize, usize) = (10, 50);

pub(super) fn pose(source: &Source, seen: &Seen<'_>) -> Result<Isometry3<f64>, String> {
    let start = landmarks_only::pose(source, seen)?;
    icp(&source.whole, seen.surface.points(), &start)
}

/// ICP of a surface to target points with this module's settings.
pub(crate) fn icp(
    surface: &impl ReferenceSurface,
    target_points: &[Point3<f64>],
    start: &Isometry3<f64>,
) -> Result<Isometry3<f64>, String> {
    let options = RefineOptions {
        start_distance_mm: Some(GATES_MM.0),
        max_distance_mm: GATES_MM.1,
        anneal_iterations: ITERATIONS.0,
        max_iterations: ITERATIONS.1,
        ..RefineOptions::default()
    };
    refine_on_surface(surface, &thinned(target_points, N_POINTS), start, &options)
        .map(|fit| fit.target_from_source)
        .map_err(|error| error.to_string())
}
