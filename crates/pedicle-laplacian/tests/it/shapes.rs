//! Small meshes for the tests.

use nalgebra::Point3;
use pedicle_mesh::TriMesh;

/// A rectangle of nx × ny cells, each cut along one diagonal.
pub(crate) fn rectangle(width: f64, height: f64, nx: usize, ny: usize) -> TriMesh {
    let mut vertices = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let x = width * i as f64 / nx as f64;
            let y = height * j as f64 / ny as f64;
            vertices.push(Point3::new(x, y, 0.0));
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

/// Every coordinate multiplied by a number.
pub(crate) fn scaled(mesh: &TriMesh, scale: f64) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|p| p * scale).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

/// The regular tetrahedron with edges of length 2√2.
pub(crate) fn tetrahedron() -> TriMesh {
    let corners = [
        [1.0, 1.0, 1.0],
        [1.0, -1.0, -1.0],
        [-1.0, 1.0, -1.0],
        [-1.0, -1.0, 1.0],
    ];
    let vertices = corners.map(Point3::from).to_vec();
    let faces = vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];
    TriMesh::new(vertices, faces).unwrap()
}
