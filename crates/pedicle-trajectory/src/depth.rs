//! Depth of a point below the surface.

use nalgebra::Point3;
use pedicle_mesh::SurfaceIndex;

/// Sine of the angle between the way to the closest point and its face below which the face
/// alone cannot tell inside from outside.
const AMBIGUOUS: f64 = 0.3;

/// Distance to the surface, mm: positive inside, negative outside.
///
/// The normal of the closest face tells the side at the price of no ray, except beside sharp
/// edges, where rays decide.
pub(crate) fn depth_mm(index: &SurfaceIndex, p: &Point3<f64>) -> f64 {
    let closest = index.closest_point(p);
    let outward = (p - closest.point).dot(&closest.normal);
    let inside = if outward.abs() > AMBIGUOUS * closest.distance_mm {
        outward < 0.0
    } else {
        index.contains(p)
    };
    if inside {
        closest.distance_mm
    } else {
        -closest.distance_mm
    }
}
