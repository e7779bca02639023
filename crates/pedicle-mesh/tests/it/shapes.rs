//! Meshes that several tests use.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{TriMesh, read_mesh};

/// A unit sphere from an icosahedron whose faces are split in four, `n_splits` times.
pub(crate) fn icosphere(n_splits: usize) -> TriMesh {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut vertices: Vec<Point3<f64>> = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(|p| Point3::from(Vector3::from(p).normalize()))
    .to_vec();
    let mut faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..n_splits {
        let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut split = Vec::with_capacity(4 * faces.len());
        for [a, b, c] in faces {
            let mut middle = |p: u32, q: u32| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    let sum = vertices[p as usize].coords + vertices[q as usize].coords;
                    vertices.push(Point3::from(sum.normalize()));
                    vertices.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            split.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = split;
    }
    TriMesh::new(vertices, faces).expect("an icosphere is a mesh")
}

/// A torus about the z axis with radii 3 and 1.
pub(crate) fn torus(n_around: usize, n_tube: usize) -> TriMesh {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for i in 0..n_around {
        for j in 0..n_tube {
            let u = TAU * i as f64 / n_around as f64;
            let v = TAU * j as f64 / n_tube as f64;
            let r = 3.0 + v.cos();
            vertices.push(Point3::new(r * u.cos(), r * u.sin(), v.sin()));
            let at = |i: usize, j: usize| ((i % n_around) * n_tube + j % n_tube) as u32;
            let (a, b) = (at(i, j), at(i + 1, j));
            let (c, d) = (at(i + 1, j + 1), at(i, j + 1));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(vertices, faces).expect("a torus is a mesh")
}

/// A flat grid of `n` × `n` squares of side 1 in z = 0, facing up.
pub(crate) fn grid(n: usize) -> TriMesh {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            vertices.push(Point3::new(i as f64, j as f64, 0.0));
        }
    }
    let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    for i in 0..n {
        for j in 0..n {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(vertices, faces).expect("a grid is a mesh")
}

/// A closed axis-aligned box from the origin to (1, 1, 1), 12 faces.
pub(crate) fn cube() -> TriMesh {
    let vertices = (0..8)
        .map(|i| Point3::new((i & 1) as f64, ((i >> 1) & 1) as f64, (i >> 2) as f64))
        .collect();
    let faces = [
        [0, 2, 3],
        [0, 3, 1],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 6, 7],
        [2, 7, 3],
        [0, 4, 6],
        [0, 6, 2],
        [1, 3, 7],
        [1, 7, 5],
    ];
    TriMesh::new(vertices, faces.to_vec()).expect("a cube is a mesh")
}

/// The mesh with every coordinate multiplied by `factor`.
pub(crate) fn scaled(mesh: &TriMesh, factor: f64) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|p| p * factor).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).expect("scaling keeps a mesh")
}

/// L1 to L5 of a spine of the shared data, or `None` and one line where they are absent.
#[allow(
    clippy::print_stdout,
    reason = "a test that leaves something out says so"
)]
pub(crate) fn spine(subject: &str) -> Option<Vec<TriMesh>> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    let folder = folder.join(subject);
    if !folder.join("L1.ply").exists() {
        println!("the spine {subject} is not here; this part of the test is left out");
        return None;
    }
    let read = |level| {
        let file = read_mesh(folder.join(format!("L{level}.ply")));
        file.expect("a shared spine can be read").mesh
    };
    Some((1..=5).map(read).collect())
}
