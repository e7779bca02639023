//! Meshes and matrices for the tests.

use std::path::Path;

use nalgebra::Point3;
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::TriMesh;
use sprs::CsMat;

/// Cotangent stiffness and lumped mass.
pub(crate) fn operators(mesh: &TriMesh) -> (CsMat<f64>, Vec<f64>) {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    (operators.stiffness, operators.mass)
}

/// Reads the binary PLY files of the data folder: float or double x y z first, other scalars ignored.
pub(crate) fn read_binary_ply(path: &Path) -> TriMesh {
    let bytes = std::fs::read(path).unwrap();
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let header = std::str::from_utf8(&bytes[..body]).unwrap();
    let (mut n_vertices, mut n_faces, mut sizes) = (0, 0, Vec::new());
    for line in header.lines() {
        match line.split(' ').collect::<Vec<_>>()[..] {
            ["element", "vertex", n] => n_vertices = n.parse().unwrap(),
            ["element", "face", n] => n_faces = n.parse().unwrap(),
            ["property", "float", _] => sizes.push(4),
            ["property", "double", _] => sizes.push(8),
            ["property", "uchar", _] => sizes.push(1),
            _ => {}
        }
    }
    let stride: usize = sizes.iter().sum();
    let number = |at: usize| match sizes[0] {
        4 => f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())),
        _ => f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()),
    };
    let vertices = (0..n_vertices)
        .map(|i| {
            let at = body + i * stride;
            Point3::new(number(at), number(at + sizes[0]), number(at + 2 * sizes[0]))
        })
        .collect();
    let index = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let faces = (0..n_faces)
        .map(|i| {
            let at = body + n_vertices * stride + i * 13;
            [index(at + 1), index(at + 5), index(at + 9)]
        })
        .collect();
    TriMesh::new(vertices, faces).unwrap()
}
