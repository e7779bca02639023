//! Small meshes for the tests.

use nalgebra::Point3;
use pedicle_laplacian::{
    Construction, LaplaceOperators, LaplaceOptions, Surface, laplace_operators,
};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, smallest_eigenpairs};

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

/// A rectangle of nx × ny cells with inner vertices moved by up to `jitter` of a cell, and the diagonal
/// of every cell chosen by `seed`.
pub(crate) fn jittered(size: [f64; 2], cells: [usize; 2], jitter: f64, seed: u64) -> TriMesh {
    let [nx, ny] = cells;
    let flat = rectangle(size[0], size[1], nx, ny);
    let mut vertices = flat.vertices().to_vec();
    for j in 1..ny {
        for i in 1..nx {
            let v = j * (nx + 1) + i;
            vertices[v].x += jitter * size[0] / nx as f64 * (2.0 * scattered(2 * v as u64) - 1.0);
            vertices[v].y +=
                jitter * size[1] / ny as f64 * (2.0 * scattered(2 * v as u64 + 1) - 1.0);
        }
    }
    let at = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let mut faces = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if scattered(seed + 7919 * u64::from(a)) < 0.5 {
                faces.extend([[a, b, c], [a, c, d]]);
            } else {
                faces.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A number from 0 to 1 without a pattern.
pub(crate) fn scattered(index: u64) -> f64 {
    let mut x = (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    for _ in 0..3 {
        x ^= x >> 29;
        x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
        x ^= x >> 32;
    }
    (x >> 11) as f64 / (1_u64 << 53) as f64
}

/// The sphere of radius 1: an octahedron whose faces are cut in four `n_cuts` times.
pub(crate) fn sphere(n_cuts: usize) -> TriMesh {
    let mut vertices: Vec<Point3<f64>> = Vec::new();
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut p = [0.0; 3];
            p[axis] = sign;
            vertices.push(Point3::from(p));
        }
    }
    let mut faces = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5],
    ];
    for _ in 0..n_cuts {
        let mut middles = std::collections::BTreeMap::new();
        let mut finer = Vec::new();
        for &[a, b, c] in &faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j): (u32, u32)| {
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

/// A torus with radii 2 and 1; every row of cells is turned on by `shear` cells.
pub(crate) fn torus(around: usize, across: usize, shear: f64) -> TriMesh {
    let mut vertices = Vec::new();
    for i in 0..around {
        for j in 0..across {
            let v = std::f64::consts::TAU * j as f64 / across as f64;
            let u = std::f64::consts::TAU * (i as f64 + shear * v.sin()) / around as f64;
            let r = 2.0 + v.cos();
            vertices.push(Point3::new(r * u.cos(), r * u.sin(), v.sin()));
        }
    }
    let at = |i: usize, j: usize| ((i % around) * across + j % across) as u32;
    let mut faces = Vec::new();
    for i in 0..around {
        for j in 0..across {
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// The same surface with everything a scan may bring along: needles and caps well below a degree, faces
/// without area, faces that occur twice, faces that name a vertex twice, vertices of no face.
pub(crate) fn spoiled(mesh: &TriMesh) -> TriMesh {
    let mut vertices = mesh.vertices().to_vec();
    let mut faces = Vec::new();
    for (f, &[a, b, c]) in mesh.faces().iter().enumerate() {
        let [p, q, r] = mesh.triangle(f).map(|p| p.coords);
        let m = vertices.len() as u32;
        match f % 11 {
            // A cap: a vertex inside the face, nearly on an edge.
            0 => {
                vertices.push(Point3::from(0.4999 * p + 0.4999 * q + 0.0002 * r));
                faces.extend([[a, b, m], [b, c, m], [c, a, m]]);
            }
            // A needle: a vertex inside the face, next to a corner.
            4 => {
                vertices.push(Point3::from(0.9998 * p + 0.0001 * q + 0.0001 * r));
                faces.extend([[a, b, m], [b, c, m], [c, a, m]]);
            }
            // A crack closed by a face without area.
            7 => {
                vertices.push(Point3::from(0.5 * (p + q)));
                faces.extend([[a, m, c], [m, b, c], [a, b, m]]);
            }
            9 => faces.extend([[a, b, c], [b, a, c], [b, b, c]]),
            _ => faces.push([a, b, c]),
        }
    }
    vertices.push(Point3::new(50.0, 0.0, 0.0));
    TriMesh::new(vertices, faces).unwrap()
}

/// Vertices and faces in another order.
pub(crate) fn shuffled(mesh: &TriMesh) -> TriMesh {
    let order = shuffle(mesh.n_vertices());
    let mut new_index = vec![0; order.len()];
    for (new, &old) in order.iter().enumerate() {
        new_index[old] = new as u32;
    }
    let vertices = order.iter().map(|&v| mesh.vertices()[v]).collect();
    let faces = shuffle(mesh.n_faces());
    let faces = faces.iter().map(|&f| {
        let [a, b, c] = mesh.faces()[f].map(|v| new_index[v as usize]);
        [b, c, a]
    });
    TriMesh::new(vertices, faces.collect()).unwrap()
}

/// The numbers below n without an order.
pub(crate) fn shuffle(n: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| scattered(a as u64).total_cmp(&scattered(b as u64)));
    order
}

/// Points without a pattern on the sphere of radius 1.
pub(crate) fn sphere_points(n: usize) -> Vec<Point3<f64>> {
    (0..n as u64)
        .map(|i| {
            let z = 2.0 * scattered(2 * i) - 1.0;
            let (sin, cos) = (std::f64::consts::TAU * scattered(2 * i + 1)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Point3::new(r * cos, r * sin, z)
        })
        .collect()
}

/// The operators of a mesh by one construction, everything else by default.
pub(crate) fn operators_by(mesh: &TriMesh, construction: Construction) -> LaplaceOperators {
    let options = LaplaceOptions {
        construction,
        ..LaplaceOptions::default()
    };
    laplace_operators(Surface::Mesh(mesh), &options).unwrap()
}

/// The k smallest eigenvalues.
pub(crate) fn spectrum(operators: &LaplaceOperators, k: usize) -> Vec<f64> {
    let options = EigenOptions::default();
    let pairs = smallest_eigenpairs(&operators.stiffness, &operators.mass, k, &options).unwrap();
    pairs.eigenvalues
}

/// Largest relative difference of two spectra, beside the first eigenvalue above 0 for the zeros.
pub(crate) fn spectral_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "number of eigenvalues");
    let floor = b
        .iter()
        .copied()
        .find(|&x| x > 1e-6 * b[b.len() - 1])
        .unwrap();
    let pairs = a.iter().zip(b);
    pairs
        .map(|(x, y)| (x - y).abs() / y.max(floor))
        .fold(0.0, f64::max)
}
