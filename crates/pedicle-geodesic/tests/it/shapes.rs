//! Surfaces whose distances are known.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{TriMesh, concatenate};

/// The unit square cut into n × n squares, each into two triangles with alternating diagonals;
/// inner vertices moved by up to `jitter` of a cell.
pub(crate) fn square(n: usize, jitter: f64) -> TriMesh {
    let mut state = 7_u64;
    let mut number = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    let inner = |i: usize| i > 0 && i < n;
    let mut vertices = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            let (dx, dy) = (jitter * number(), jitter * number());
            let x = i as f64 + if inner(i) { dx } else { 0.0 };
            let y = j as f64 + if inner(j) { dy } else { 0.0 };
            vertices.push(Point3::new(x / n as f64, y / n as f64, 0.0));
        }
    }
    let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    let mut faces = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            if (i + j) % 2 == 0 {
                faces.extend([[a, b, c], [a, c, d]]);
            } else {
                faces.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A closed grid of n × m vertices, placed by `point(u, v)` with u, v in [0, 1).
pub(crate) fn periodic(n: usize, m: usize, point: impl Fn(f64, f64) -> Point3<f64>) -> TriMesh {
    let at = |i: usize, j: usize| ((i % n) * m + j % m) as u32;
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for i in 0..n {
        for j in 0..m {
            vertices.push(point(i as f64 / n as f64, j as f64 / m as f64));
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A torus about z with the given radii.
pub(crate) fn torus(n: usize, big: f64, small: f64) -> TriMesh {
    let m = (n as f64 * small / big).round() as usize;
    periodic(n, m, |u, v| {
        let (u, v) = (TAU * u, TAU * v);
        let r = big + small * v.cos();
        Point3::new(r * u.cos(), r * u.sin(), small * v.sin())
    })
}

/// A unit sphere of 10 · 4^level + 2 vertices.
pub(crate) fn sphere(level: usize) -> TriMesh {
    let mut points: Vec<Vector3<f64>> = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
    ]
    .map(Vector3::from)
    .to_vec();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for (x, y, z) in (0..8).map(|i| (i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2 & 1))) {
        let out = (x + y + z) % 2 == 0;
        faces.push(if out { [x, y, z] } else { [x, z, y] });
    }
    for _ in 0..level {
        let mut middles = std::collections::BTreeMap::new();
        let mut next = Vec::new();
        for [a, b, c] in faces {
            let mut middle = |x: u32, y: u32| {
                *middles.entry((x.min(y), x.max(y))).or_insert_with(|| {
                    points.push((points[x as usize] + points[y as usize]).normalize());
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            next.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = next;
    }
    TriMesh::new(points.into_iter().map(Point3::from).collect(), faces).unwrap()
}

pub(crate) fn scaled(mesh: &TriMesh, scale: f64) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|p| p * scale).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

/// Two copies, the second far away.
pub(crate) fn twice(mesh: &TriMesh) -> TriMesh {
    let far = mesh
        .vertices()
        .iter()
        .map(|p| p + Vector3::x() * 9.0)
        .collect();
    let copy = TriMesh::new(far, mesh.faces().to_vec()).unwrap();
    concatenate(&[mesh, &copy]).unwrap()
}
