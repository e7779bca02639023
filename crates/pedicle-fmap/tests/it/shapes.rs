//! Shapes with known maps between them, and their bases and descriptors.

use faer::{Mat, Side};
use nalgebra::{Point3, Vector3};
use pedicle_descriptors::{
    HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
    normalize_columns, wave_kernel_signature,
};
use pedicle_fmap::{PointMap, Shape};
use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_spectral::LaplaceBasis;

/// A unit sphere of 10 · 4^level + 2 vertices.
pub(crate) fn icosphere(level: usize) -> TriMesh {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let mut vertices: Vec<Vector3<f64>> = Vec::new();
    for (a, b) in [
        (1.0, golden),
        (-1.0, golden),
        (1.0, -golden),
        (-1.0, -golden),
    ] {
        vertices.push(Vector3::new(0.0, a, b));
        vertices.push(Vector3::new(a, b, 0.0));
        vertices.push(Vector3::new(b, 0.0, a));
    }
    let edge = vertices
        .iter()
        .skip(1)
        .map(|v| (v - vertices[0]).norm())
        .fold(f64::INFINITY, f64::min);
    let mut faces: Vec<[u32; 3]> = Vec::new();
    let near = |a: usize, b: usize| ((vertices[a] - vertices[b]).norm() - edge).abs() < 1e-9;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let out = vertices[a].dot(&vertices[b].cross(&vertices[c]));
                    let (b, c) = if out > 0.0 { (b, c) } else { (c, b) };
                    faces.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    for _ in 0..level {
        let mut middles = std::collections::BTreeMap::new();
        let mut next = Vec::new();
        for [a, b, c] in faces {
            let mut middle = |x: u32, y: u32| {
                *middles.entry((x.min(y), x.max(y))).or_insert_with(|| {
                    vertices.push((vertices[x as usize] + vertices[y as usize]) / 2.0);
                    vertices.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            next.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = next;
    }
    let vertices = vertices
        .iter()
        .map(|v| Point3::from(v.normalize()))
        .collect();
    TriMesh::new(vertices, faces).unwrap()
}

/// A lump without any symmetry, some 100 mm across; `variant` changes its shape.
pub(crate) fn lump(level: usize, variant: f64) -> TriMesh {
    deformed(&icosphere(level), |p| {
        let bump = |x: f64, y: f64, z: f64, height: f64, width: f64| {
            let d2 = (p - Point3::new(x, y, z)).norm_squared();
            height * (-d2 / (2.0 * width * width)).exp()
        };
        let radius = 1.0
            + bump(1.0, 0.0, 0.0, 0.9, 0.35)
            + bump(-0.4, 0.9, 0.1, 0.6, 0.3)
            + bump(-0.3, -0.5, 0.8, 0.45 + 0.2 * variant, 0.4)
            - bump(0.2, -0.7, -0.7, 0.35 + 0.3 * variant, 0.3);
        let v = p.coords * radius;
        Point3::new(40.0 * v.x, 34.0 * v.y, 28.0 * v.z)
    })
}

/// A lump with a mirror plane y = 0, except for a slight bump on the left (y > 0).
pub(crate) fn nearly_symmetric(level: usize) -> TriMesh {
    deformed(&icosphere(level), |p| {
        let bump = |x: f64, y: f64, z: f64, height: f64, width: f64| {
            let d2 = (p - Point3::new(x, y, z)).norm_squared();
            height * (-d2 / (2.0 * width * width)).exp()
        };
        let radius = 1.0
            + bump(1.0, 0.0, 0.0, 0.9, 0.35)
            + bump(-0.5, 0.8, 0.2, 0.7, 0.3)
            + bump(-0.5, -0.8, 0.2, 0.7, 0.3)
            + bump(0.1, 0.3, 0.95, 0.03, 0.3);
        let v = p.coords * radius;
        Point3::new(40.0 * v.x, 34.0 * v.y, 28.0 * v.z)
    })
}

pub(crate) fn deformed(mesh: &TriMesh, f: impl Fn(&Point3<f64>) -> Point3<f64>) -> TriMesh {
    TriMesh::new(
        mesh.vertices().iter().map(f).collect(),
        mesh.faces().to_vec(),
    )
    .unwrap()
}

/// Five different lumps in a row.
pub(crate) fn five_lumps(level: usize) -> TriMesh {
    let parts: Vec<TriMesh> = (0..5)
        .map(|i| {
            let size = 1.0 + 0.12 * f64::from(i);
            deformed(&lump(level, 0.25 * f64::from(i)), |p| {
                Point3::from(p.coords * size + Vector3::new(0.0, 0.0, 200.0 * f64::from(i)))
            })
        })
        .collect();
    concatenate(&parts.iter().collect::<Vec<_>>()).unwrap()
}

/// Numbers in [0, 1) that are the same everywhere.
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.next()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.next()).cos()
    }
}

/// The mesh with its vertices and faces in another order, and for every new vertex the old one.
pub(crate) fn shuffled(mesh: &TriMesh, seed: u64) -> (TriMesh, PointMap) {
    let mut numbers = Numbers(seed);
    let n = mesh.n_vertices();
    let mut old_of_new: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        old_of_new.swap(i, (numbers.next() * (i + 1) as f64) as usize);
    }
    let mut new_of_old = vec![0_u32; n];
    for (new, &old) in old_of_new.iter().enumerate() {
        new_of_old[old as usize] = new as u32;
    }
    let vertices = old_of_new
        .iter()
        .map(|&v| mesh.vertices()[v as usize])
        .collect();
    let mut faces: Vec<[u32; 3]> = mesh
        .faces()
        .iter()
        .map(|f| f.map(|v| new_of_old[v as usize]))
        .collect();
    for i in (1..faces.len()).rev() {
        faces.swap(i, (numbers.next() * (i + 1) as f64) as usize);
    }
    let map = PointMap::new(old_of_new, n).unwrap();
    (TriMesh::new(vertices, faces).unwrap(), map)
}

/// The mesh with Gaussian noise on every coordinate.
pub(crate) fn noisy(mesh: &TriMesh, sigma_mm: f64, seed: u64) -> TriMesh {
    let mut numbers = Numbers(seed);
    let vertices = mesh
        .vertices()
        .iter()
        .map(|p| {
            let [x, y, z] = std::array::from_fn(|_| sigma_mm * numbers.normal());
            p + Vector3::new(x, y, z)
        })
        .collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

/// The first k eigenfunctions by a dense decomposition of M^-1/2 W M^-1/2.
pub(crate) fn basis(mesh: &TriMesh, k: usize) -> LaplaceBasis {
    let operators = cotangent_operators(mesh, &OperatorOptions::default()).unwrap();
    let n = mesh.n_vertices();
    let mut dense = Mat::<f64>::zeros(n, n);
    for (&value, (i, j)) in &operators.stiffness {
        dense[(i, j)] = value / (operators.mass[i] * operators.mass[j]).sqrt();
    }
    let decomposed = dense.self_adjoint_eigen(Side::Lower).unwrap();
    let eigenvalues: Vec<f64> = (0..k).map(|i| decomposed.S().column_vector()[i]).collect();
    let largest = eigenvalues[k - 1];
    LaplaceBasis {
        null_dimension: eigenvalues.iter().filter(|&&l| l < 1e-9 * largest).count(),
        eigenfunctions: Mat::from_fn(n, k, |i, j| {
            decomposed.U()[(i, j)] / operators.mass[i].sqrt()
        }),
        eigenvalues,
        mass: operators.mass,
    }
}

/// A shape that owns what [`Shape`] borrows.
pub(crate) struct Owned {
    pub(crate) mesh: TriMesh,
    pub(crate) basis: LaplaceBasis,
    pub(crate) descriptors: Mat<f64>,
}

impl Owned {
    pub(crate) fn shape(&self) -> Shape<'_> {
        Shape {
            mesh: &self.mesh,
            basis: &self.basis,
            descriptors: &self.descriptors,
        }
    }
}

/// Both shapes with k functions and descriptors; landmarks are (source vertex, target vertex).
pub(crate) fn pair(
    source: TriMesh,
    target: TriMesh,
    k: usize,
    landmarks: &[(usize, usize)],
) -> (Owned, Owned) {
    let (source_basis, target_basis) = (basis(&source, k), basis(&target, k));
    let times = HeatTimes::joint(&source_basis, &target_basis, 12).unwrap();
    let energies = WaveEnergies::joint(&source_basis, &target_basis, 30).unwrap();
    let describe = |basis: &LaplaceBasis, landmarks: Vec<usize>| {
        let mut parts = vec![
            heat_kernel_signature(basis, &times),
            wave_kernel_signature(basis, &energies),
        ];
        for landmark in landmarks {
            parts.push(heat_kernel_from_landmark(basis, landmark, &times).unwrap());
        }
        normalize_columns(concatenate_columns(&parts), &basis.mass)
    };
    let a = describe(&source_basis, landmarks.iter().map(|l| l.0).collect());
    let b = describe(&target_basis, landmarks.iter().map(|l| l.1).collect());
    (
        Owned {
            mesh: source,
            basis: source_basis,
            descriptors: a,
        },
        Owned {
            mesh: target,
            basis: target_basis,
            descriptors: b,
        },
    )
}

/// For every source vertex the target vertex whose image it is; the map must be a permutation.
pub(crate) fn inverse(map: &PointMap) -> Vec<usize> {
    let mut inverse = vec![0; map.n_source_vertices];
    for (new, &old) in map.source_of_target.iter().enumerate() {
        inverse[old as usize] = new;
    }
    inverse
}

/// The vertex furthest along a direction.
pub(crate) fn furthest(mesh: &TriMesh, direction: [f64; 3]) -> usize {
    let direction = Vector3::from(direction);
    (0..mesh.n_vertices())
        .max_by(|&a, &b| {
            let height = |v: usize| mesh.vertices()[v].coords.dot(&direction);
            height(a).total_cmp(&height(b))
        })
        .unwrap()
}
