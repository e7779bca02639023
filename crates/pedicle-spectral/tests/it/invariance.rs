//! What must not change the result, and small problems against the dense solver.

use faer::Mat;
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, EigenPairs, laplace_basis, smallest_eigenpairs};
use proptest::prelude::*;

use crate::shapes::{operators, potato, rectangle};

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
}
