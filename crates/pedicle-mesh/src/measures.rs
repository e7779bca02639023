//! Lengths, volumes, angles and normals of a mesh.
//!
//! ```text
//! V = Σ_f a·(b × c) / 6,   n_v ∝ Σ_f angle_f(v) n_f
//! ```
//!
//! Volumes are signed (positive where faces turn counter-clockwise seen from outside); lengths in
//! millimetres, angles in radians. Angle-weighted normals: Thürmer & Wüthrich 1998.

use nalgebra::{Point3, Vector3};

use crate::TriMesh;

/// A face counts as having no area when its height over its longest edge is less than this
/// fraction of that edge: the normal then consists of rounding alone.
pub(crate) const DEGENERATE_HEIGHT: f64 = 1e-10;

/// Lengths of the edges of a mesh, each edge counted once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeLengths {
    /// Number of edges.
    pub n_edges: usize,
    /// Shortest edge, mm.
    pub min_mm: f64,
    /// Mean length, mm.
    pub mean_mm: f64,
    /// Longest edge, mm.
    pub max_mm: f64,
}

/// Lengths of all edges; edges from a vertex to itself are left out.
#[must_use]
pub fn edge_lengths(mesh: &TriMesh) -> EdgeLengths {
    let mut edges: Vec<[u32; 2]> = mesh
        .faces()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .filter(|[a, b]| a != b)
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let (mut min_mm, mut sum, mut max_mm) = (f64::INFINITY, 0.0, 0.0_f64);
    for &[a, b] in &edges {
        let length = (mesh.vertices()[a as usize] - mesh.vertices()[b as usize]).norm();
        min_mm = min_mm.min(length);
        max_mm = max_mm.max(length);
        sum += length;
    }
    if edges.is_empty() {
        min_mm = 0.0;
    }
    EdgeLengths {
        n_edges: edges.len(),
        min_mm,
        mean_mm: sum / edges.len().max(1) as f64,
        max_mm,
    }
}

/// Signed volume enclosed by the mesh, mm³; meaningful for closed, consistently oriented meshes.
#[must_use]
pub fn volume(mesh: &TriMesh) -> f64 {
    // Coordinates relative to one vertex: far from the origin the terms would cancel badly.
    let origin = mesh.vertices()[0];
    let six_volumes: f64 = (0..mesh.n_faces())
        .map(|face| {
            let [a, b, c] = mesh.triangle(face).map(|p| p - origin);
            a.dot(&b.cross(&c))
        })
        .sum();
    six_volumes / 6.0
}

/// Unit normals at the vertices, every face weighted by its angle there; zero where no face has
/// area. Unlike area weights these do not depend on how a flat region is cut into triangles.
#[must_use]
pub fn angle_weighted_normals(mesh: &TriMesh) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); mesh.n_vertices()];
    for (face, corners) in mesh.faces().iter().enumerate() {
        let points = mesh.triangle(face);
        if is_degenerate(&points) {
            continue;
        }
        let normal = mesh.face_normal_scaled(face).normalize();
        for (&vertex, angle) in corners.iter().zip(corner_angles(&points)) {
            normals[vertex as usize] += normal * angle;
        }
    }
    normals
        .into_iter()
        .map(|n| {
            n.try_normalize(f64::MIN_POSITIVE)
                .unwrap_or_else(Vector3::zeros)
        })
        .collect()
}

/// Smallest corner angle of all faces, radians; 0 if a face has no area.
#[must_use]
pub fn smallest_angle_rad(mesh: &TriMesh) -> f64 {
    (0..mesh.n_faces())
        .map(|face| smallest_corner_angle(&mesh.triangle(face)))
        .fold(std::f64::consts::FRAC_PI_3, f64::min)
}

/// The three corner angles, radians; 0 at a corner that coincides with another.
pub(crate) fn corner_angles(corners: &[Point3<f64>; 3]) -> [f64; 3] {
    let [a, b, c] = *corners;
    let angle = |at: Point3<f64>, p: Point3<f64>, q: Point3<f64>| {
        let (u, v) = (p - at, q - at);
        // atan2 keeps its precision at angles near 0 and π, where acos loses half the digits.
        u.cross(&v).norm().atan2(u.dot(&v))
    };
    [angle(a, b, c), angle(b, c, a), angle(c, a, b)]
}

/// Smallest of the three corner angles, radians.
pub(crate) fn smallest_corner_angle(corners: &[Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corner_angles(corners);
    a.min(b).min(c)
}

/// Whether a triangle has no area to speak of, whatever its size.
pub(crate) fn is_degenerate(corners: &[Point3<f64>; 3]) -> bool {
    let [a, b, c] = *corners;
    let longest = (b - a).amax().max((c - a).amax()).max((c - b).amax());
    if longest <= 0.0 {
        return true;
    }
    let (u, v, w) = ((b - a) / longest, (c - a) / longest, (c - b) / longest);
    let squared = u.norm_squared().max(v.norm_squared()).max(w.norm_squared());
    u.cross(&v).norm() <= DEGENERATE_HEIGHT * squared
}
