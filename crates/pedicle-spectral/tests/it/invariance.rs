//! What must not change the result, and small problems against the dense solver.

use faer::Mat;
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{
    EigenOptions, EigenPairs, laplace_basis, smallest_eigenpairs, smallest_eigenpairs_from,
};
use proptest::prelude::*;

use crate::shapes::{graph_laplacian, icosphere, operators, potato, rectangle};

const N_PAIRS: usize = 30;

fn solve(mesh: &TriMesh) -> EigenPairs {
    let (stiffness, mass) = operators(mesh);
    smallest_eigenpairs(&stiffness, &mass, N_PAIRS, &EigenOptions::default()).unwrap()
}

/// Same eigenvalues times `factor` and same vectors over √factor, rows taken by `row`.
fn assert_same(
    found: &EigenPairs,
    expected: &EigenPairs,
    factor: f64,
    row: impl Fn(usize) -> usize,
) {
    for j in 0..N_PAIRS {
        let (a, b) = (found.eigenvalues[j], factor * expected.eigenvalues[j]);
        assert!(
            (a - b).abs() <= 1e-11 * b,
            "eigenvalue {j}: {a} against {b}"
        );
        let n = expected.eigenvectors.nrows();
        let largest = expected.eigenvectors.col(j).norm_max();
        for i in 0..n {
            let (a, b) = (
                found.eigenvectors[(row(i), j)],
                expected.eigenvectors[(i, j)],
            );
            let error = (a / factor.sqrt() - b).abs() / largest;
            assert!(error < 1e-7, "vector {j}, row {i}: {a} against {b}");
        }
    }
}

#[test]
fn scale_and_motion() {
    let mesh = potato(3);
    let expected = solve(&mesh);
    for scale in [1e-3, 1e3] {
        let vertices = mesh.vertices().iter().map(|p| p * scale).collect();
        let scaled = TriMesh::new(vertices, mesh.faces().to_vec()).unwrap();
        assert_same(&solve(&scaled), &expected, 1.0 / (scale * scale), |i| i);
    }
    let motion = Isometry3::new(Vector3::new(5.0, -9.0, 14.0), Vector3::new(0.4, -1.0, 2.0));
    assert_same(&solve(&mesh.transformed(&motion)), &expected, 1.0, |i| i);
}

#[test]
fn unit_of_the_stiffness_does_not_matter() {
    let (stiffness, mass) = operators(&potato(3));
    let options = EigenOptions::default();
    let expected = smallest_eigenpairs(&stiffness, &mass, N_PAIRS, &options).unwrap();
    for factor in [1e-6, 1e6] {
        let scaled = stiffness.map(|w| w * factor);
        let pairs = smallest_eigenpairs(&scaled, &mass, N_PAIRS, &options).unwrap();
        for (a, b) in pairs.eigenvalues.iter().zip(&expected.eigenvalues) {
            assert!(
                (a - b * factor).abs() <= 1e-11 * b * factor,
                "{a} against {b}"
            );
        }
    }
}

#[test]
fn order_of_the_vertices_does_not_matter() {
    let mesh = potato(3);
    let n = mesh.n_vertices();
    // 7 and the number of vertices have no common divisor.
    let position = |i: usize| (7 * i + 3) % n;
    let mut vertices = vec![Point3::origin(); n];
    for (i, p) in mesh.vertices().iter().enumerate() {
        vertices[position(i)] = *p;
    }
    let faces = mesh
        .faces()
        .iter()
        .map(|f| f.map(|v| position(v as usize) as u32));
    let permuted = TriMesh::new(vertices, faces.collect()).unwrap();
    assert_same(&solve(&permuted), &solve(&mesh), 1.0, position);
}

#[test]
fn repeated_runs_are_identical() {
    let mesh = potato(3);
    let (a, b) = (solve(&mesh), solve(&mesh));
    assert_eq!(bits(&a.eigenvalues), bits(&b.eigenvalues), "eigenvalues");
    for j in 0..N_PAIRS {
        let column = |pairs: &EigenPairs| bits(pairs.eigenvectors.col_as_slice(j));
        assert_eq!(column(&a), column(&b), "vector {j}");
    }
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn seed_and_block_size_do_not_matter() {
    let mesh = potato(3);
    let expected = solve(&mesh);
    let (stiffness, mass) = operators(&mesh);
    for (seed, block_size) in [(1, 8), (2, 1), (3, 3), (4, 13)] {
        let options = EigenOptions {
            seed,
            block_size,
            ..EigenOptions::default()
        };
        let pairs = smallest_eigenpairs(&stiffness, &mass, N_PAIRS, &options).unwrap();
        assert_same(&pairs, &expected, 1.0, |i| i);
    }
}

/// The first entry within 1e-6 of the largest magnitude.
fn first_of_the_largest(column: &[f64]) -> f64 {
    let largest = column.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let near = column.iter().find(|x| x.abs() >= (1.0 - 1e-6) * largest);
    near.copied().unwrap_or(0.0)
}

#[test]
fn signs_are_canonical() {
    for mesh in [potato(3), icosphere(3)] {
        let pairs = solve(&mesh);
        for j in 0..N_PAIRS {
            let first = first_of_the_largest(pairs.eigenvectors.col_as_slice(j));
            assert!(first > 0.0, "vector {j}: {first}");
        }
    }
}

#[test]
fn spaces_of_repeated_eigenvalues_do_not_depend_on_the_seed() {
    // On a sphere only the spaces of 1, 3, 5, 7 and 9 vectors are determined.
    let (stiffness, mass) = operators(&icosphere(3));
    let with_seed = |seed| {
        let options = EigenOptions {
            seed,
            ..EigenOptions::default()
        };
        laplace_basis(&stiffness, &mass, 25, &options).unwrap()
    };
    let (a, b) = (with_seed(1), with_seed(2));
    let angles = a.project(b.eigenfunctions.as_ref());
    let mut first = 0;
    for l in 0..5 {
        let count = 2 * l + 1;
        let part = angles.submatrix(first, first, count, count);
        let gram = part.transpose() * part;
        let difference = &gram - &Mat::<f64>::identity(count, count);
        assert!(difference.norm_max() < 1e-9, "space of degree {l}");
        first += count;
    }
}

#[test]
fn basis_is_orthonormal_in_the_mass() {
    let mesh = potato(3);
    let (stiffness, mass) = operators(&mesh);
    let basis = laplace_basis(&stiffness, &mass, N_PAIRS, &EigenOptions::default()).unwrap();
    let gram = basis.project(basis.eigenfunctions.as_ref());
    let difference = &gram - &Mat::<f64>::identity(N_PAIRS, N_PAIRS);
    assert!(
        difference.norm_max() < 1e-13,
        "ΦᵀMΦ - I: {}",
        difference.norm_max()
    );
    let constant = 1.0 / basis.area().sqrt();
    let first = basis.eigenfunctions.col(0);
    assert!(
        first
            .iter()
            .all(|x| (x - constant).abs() < 1e-14 * constant),
        "constant"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn iteration_agrees_with_the_dense_solver(
        heights in proptest::collection::vec(-1.5_f64..1.5, 13 * 14),
        n_pairs in 1_usize..40,
    ) {
        let flat = rectangle(12.0, 13.0, 12, 13);
        let vertices = flat.vertices().iter().zip(&heights);
        let vertices = vertices.map(|(p, &z)| Point3::new(p.x, p.y, z)).collect();
        let mesh = TriMesh::new(vertices, flat.faces().to_vec()).unwrap();
        let (stiffness, mass) = operators(&mesh);
        let options = EigenOptions::default();
        let dense = smallest_eigenpairs(&stiffness, &mass, 150, &options).unwrap();
        prop_assert_eq!(dense.work.n_solves, 0);
        let pairs = smallest_eigenpairs(&stiffness, &mass, n_pairs, &options).unwrap();
        prop_assert!(pairs.work.n_solves > 0 || n_pairs == 1);
        for (a, b) in pairs.eigenvalues.iter().zip(&dense.eigenvalues) {
            prop_assert!((a - b).abs() <= 1e-10 * dense.eigenvalues[n_pairs], "{} {}", a, b);
        }
    }

    #[test]
    fn random_graphs_agree_with_another_dense_solver(
        ends in proptest::collection::vec((0_usize..180, 0_usize..180, -6.0_f64..2.0), 150..500),
        logs in proptest::collection::vec(-2.0_f64..2.0, 180),
        fixed in 0.0_f64..2.0,
        n_pairs in 1_usize..50,
    ) {
        // Loose ends, several components, weights over eight decades; some rows are held.
        let n = logs.len();
        let edges: Vec<_> = ends
            .iter()
            .filter(|(a, b, _)| a != b)
            .map(|&(a, b, log)| (a, b, 10.0_f64.powf(log)))
            .collect();
        let mass: Vec<f64> = logs.iter().map(|log| log.exp()).collect();
        let mut triplets = sprs::TriMat::new((n, n));
        for (&w, (i, j)) in &graph_laplacian(n, &edges) {
            triplets.add_triplet(i, j, w);
        }
        if fixed > 1.0 {
            triplets.add_triplet(7, 7, fixed);
        }
        let stiffness: sprs::CsMat<f64> = triplets.to_csr();
        let mut dense = nalgebra::DMatrix::<f64>::zeros(n, n);
        for (&w, (i, j)) in &stiffness {
            dense[(i, j)] = w / (mass[i] * mass[j]).sqrt();
        }
        let mut expected: Vec<f64> = dense.symmetric_eigenvalues().iter().copied().collect();
        expected.sort_by(f64::total_cmp);
        let options = EigenOptions::default();
        let pairs = smallest_eigenpairs(&stiffness, &mass, n_pairs, &options).unwrap();
        prop_assert!(pairs.certificate.complete);
        for (a, b) in pairs.eigenvalues.iter().zip(&expected) {
            prop_assert!((a - b).abs() <= 1e-12 * expected[n - 1], "{} {}", a, b);
        }
        let known = pairs.eigenvectors.as_ref();
        let more = smallest_eigenpairs_from(&stiffness, &mass, n_pairs + 9, known, &options);
        let more = more.unwrap();
        prop_assert!(more.certificate.complete);
        for (a, b) in more.eigenvalues.iter().zip(&expected) {
            prop_assert!((a - b).abs() <= 1e-12 * expected[n - 1], "{} {}", a, b);
        }
    }
}
