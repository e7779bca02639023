//! Plane sections of a mesh, for measuring it independently of how it was made.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::TriMesh;

/// The segments in which a plane cuts a mesh, joined to loops of points.
pub(crate) fn loops(
    mesh: &TriMesh,
    origin: &Point3<f64>,
    normal: &Vector3<f64>,
) -> Vec<Vec<Point3<f64>>> {
    // A vertex exactly in the plane counts as above it.
    let height = |v: u32| (mesh.vertices()[v as usize] - origin).dot(normal);
    let above = |v: u32| height(v) >= 0.0;
    let mut segments: Vec<([u32; 2], [u32; 2])> = Vec::new();
    for face in mesh.faces() {
        let mut crossed = Vec::new();
        for i in 0..3 {
            let (a, b) = (face[i], face[(i + 1) % 3]);
            if above(a) != above(b) {
                crossed.push(([a.min(b), a.max(b)], above(a)));
            }
        }
        if let [(first, down), (second, _)] = crossed[..] {
            segments.push(if down {
                (first, second)
            } else {
                (second, first)
            });
        }
    }
    segments.sort_unstable();
    let mut used = vec![false; segments.len()];
    let mut loops = Vec::new();
    for start in 0..segments.len() {
        if used[start] {
            continue;
        }
        let mut points = Vec::new();
        let mut at = start;
        while !used[at] {
            used[at] = true;
            let [a, b] = segments[at].0;
            let t = height(a) / (height(a) - height(b));
            let (pa, pb) = (mesh.vertices()[a as usize], mesh.vertices()[b as usize]);
            points.push(pa + (pb - pa) * t);
            let next = segments[at].1;
            at = segments.partition_point(|s| s.0 < next);
            if at == segments.len() || segments[at].0 != next {
                break;
            }
        }
        loops.push(points);
    }
    loops
}

/// The loop whose centre is nearest to a point.
pub(crate) fn nearest_loop(
    mesh: &TriMesh,
    origin: &Point3<f64>,
    normal: &Vector3<f64>,
) -> Vec<Point3<f64>> {
    loops(mesh, origin, normal)
        .into_iter()
        .min_by(|a, b| {
            let far = |l: &[Point3<f64>]| {
                let sum: Vector3<f64> = l.iter().map(|p| p - origin).sum();
                (sum / l.len() as f64).norm()
            };
            far(a).total_cmp(&far(b))
        })
        .unwrap()
}

/// Extent of points along a direction.
pub(crate) fn extent(points: &[Point3<f64>], direction: &Vector3<f64>) -> f64 {
    let along = points.iter().map(|p| p.coords.dot(direction));
    along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
}

/// Area of a plane loop.
pub(crate) fn area(points: &[Point3<f64>]) -> f64 {
    let center = points[0];
    let mut sum = Vector3::zeros();
    for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
        sum += (a - center).cross(&(b - center));
    }
    0.5 * sum.norm()
}
