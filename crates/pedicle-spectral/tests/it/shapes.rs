//! Meshes and matrices for the tests.

use nalgebra::Point3;
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::TriMesh;
use sprs::{CsMat, TriMat};

/// Cotangent stiffness and lumped mass.
pub(crate) fn operators(mesh: &TriMesh) -> (CsMat<f64>, Vec<f64>) {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    (operators.stiffness, operators.mass)
}

/// The sphere of radius 1: an icosahedron whose faces are cut in four `n_cuts` times.
pub(crate) fn icosphere(n_cuts: usize) -> TriMesh {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut vertices = Vec::new();
    for (a, b) in [(-1.0, -g), (-1.0, g), (1.0, -g), (1.0, g)] {
        for axis in 0..3 {
            let mut p = [0.0; 3];
            (p[axis], p[(axis + 1) % 3]) = (a, b);
            vertices.push(Point3::from(nalgebra::Vector3::from(p).normalize()));
        }
    }
    // Faces are the triples of vertices at the distance of an edge.
    let edge = 4.0 / (1.0 + g * g) + 1e-9;
    let near = |a: usize, b: usize, v: &[Point3<f64>]| (v[a] - v[b]).norm_squared() < edge;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b, &vertices) && near(b, c, &vertices) && near(a, c, &vertices) {
                    faces.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    for _ in 0..n_cuts {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for &[a, b, c] in &faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    let sum = vertices[i as usize].coords + vertices[j as usize].coords;
                    vertices.push(Point3::from(sum.normalize()));
                    vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = finer;
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A rectangle of nx × ny cells, each cut along one diagonal.
pub(crate) fn rectangle(width: f64, height: f64, nx: usize, ny: usize) -> TriMesh {
    let mut vertices = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let (x, y) = (i as f64 / nx as f64, j as f64 / ny as f64);
            vertices.push(Point3::new(width * x, height * y, 0.0));
        }
    }
    let at = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let mut faces = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// An ellipsoid with bumps that leave no symmetry, so that no eigenvalue is repeated.
pub(crate) fn potato(n_cuts: usize) -> TriMesh {
    let sphere = icosphere(n_cuts);
    let vertices = sphere.vertices().iter();
    let vertices = vertices.map(|p| {
        let bump = 1.0 + 0.15 * (3.0 * p.x + 1.0).sin() + 0.1 * (2.0 * p.y - p.z + 0.6).cos();
        Point3::new(30.0 * p.x * bump, 22.0 * p.y * bump, 17.0 * p.z * bump)
    });
    TriMesh::new(vertices.collect(), sphere.faces().to_vec()).unwrap()
}

/// Laplacian of a weighted graph.
pub(crate) fn graph_laplacian(n: usize, edges: &[(usize, usize, f64)]) -> CsMat<f64> {
    let mut triplets = TriMat::new((n, n));
    for &(a, b, w) in edges {
        for (i, j, w) in [(a, a, w), (b, b, w), (a, b, -w), (b, a, -w)] {
            triplets.add_triplet(i, j, w);
        }
    }
    triplets.to_csr()
}
