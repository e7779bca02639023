//! Depth of a point below the surface.

use nalgebra::Point3;
use pedicle_mesh::{SurfaceIndex, SurfacePoint};

/// Sine of the angle between the way to the closest point and its face below which the face
/// alone cannot tell inside from outside.
const AMBIGUOUS: f64 = 0.3;

/// Distance to the surface, mm: positive inside, negative outside.
///
/// The normal of the closest face tells the side at the price of no ray, except beside sharp
/// edges, where rays decide.
pub(crate) fn depth_mm(index: &SurfaceIndex, p: &Point3<f64>) -> f64 {
    depth_of(index, p, &index.closest_point(p))
}

/// The same where a point of the surface is known that cannot be far from the closest one: that of
/// a query nearby. It is replaced by the closest one.
pub(crate) fn depth_near_mm(
    index: &SurfaceIndex,
    p: &Point3<f64>,
    on_surface: &mut Option<Point3<f64>>,
) -> f64 {
    let closest = on_surface
        .and_then(|q| index.closest_point_within(p, (p - q).norm()))
        .unwrap_or_else(|| index.closest_point(p));
    *on_surface = Some(closest.point);
    depth_of(index, p, &closest)
}

fn depth_of(index: &SurfaceIndex, p: &Point3<f64>, closest: &SurfacePoint) -> f64 {
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
