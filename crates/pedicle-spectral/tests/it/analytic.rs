//! Spectra that are known exactly.

use std::f64::consts::PI;

use pedicle_mesh::concatenate;
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs};
use sprs::CsMat;

use crate::shapes::{graph_laplacian, icosphere, operators, rectangle};

fn solve(stiffness: &CsMat<f64>, mass: &[f64], n_pairs: usize) -> EigenPairs {
    smallest_eigenpairs(stiffness, mass, n_pairs, &EigenOptions::default()).unwrap()
}

/// Every eigenvalue within a relative tolerance, zeros within that of the last.
fn assert_spectrum(pairs: &EigenPairs, expected: &[f64], tolerance: f64) {
    assert!(pairs.certificate.complete, "complete");
    let last = expected[expected.len() - 1];
    for (i, (found, expected)) in pairs.eigenvalues.iter().zip(expected).enumerate() {
        let scale = [last, *expected][usize::from(*expected > 0.0)].max(f64::MIN_POSITIVE);
        let error = (found - expected).abs() / scale;
        assert!(
            error <= tolerance,
            "eigenvalue {i}: {found} against {expected}"
        );
    }
}

fn path_edges(n: usize) -> Vec<(usize, usize, f64)> {
    (1..n).map(|i| (i - 1, i, 1.0)).collect()
}

#[test]
fn path_dense_and_by_iteration() {
    for (n, k) in [
        (2, 2),
        (3, 3),
        (50, 50),
        (120, 7),
        (500, 1),
        (500, 40),
        (3000, 25),
    ] {
        let stiffness = graph_laplacian(n, &path_edges(n));
        let pairs = solve(&stiffness, &vec![1.0; n], k);
        let expected: Vec<f64> = (0..k)
            .map(|i| 4.0 * (PI * i as f64 / (2 * n) as f64).sin().powi(2))
            .collect();
        assert_spectrum(&pairs, &expected, 1e-11);
        assert_eq!(pairs.null_dimension, 1, "one component");
    }
}

#[test]
fn path_with_fixed_ends_has_no_null_space() {
    let n = 400;
    let mut edges = path_edges(n);
    edges.push((0, n, 1.0));
    edges.push((n - 1, n + 1, 1.0));
    let whole = graph_laplacian(n + 2, &edges);
    let mut fixed = sprs::TriMat::new((n, n));
    for (&w, (i, j)) in whole.iter().filter(|&(_, (i, j))| i < n && j < n) {
        fixed.add_triplet(i, j, w);
    }
    let pairs = solve(&fixed.to_csr(), &vec![1.0; n], 30);
    let expected: Vec<f64> = (1..=30)
        .map(|i| 4.0 * (PI * i as f64 / (2 * (n + 1)) as f64).sin().powi(2))
        .collect();
    assert_spectrum(&pairs, &expected, 1e-11);
    assert_eq!(pairs.null_dimension, 0, "no null space");
}

#[test]
fn square_torus_with_its_multiplicities() {
    // Eigenvalues of the five-point stencil come four and eight at a time.
    let n = 26;
    let mut edges = Vec::new();
    for y in 0..n {
        for x in 0..n {
            edges.push((y * n + x, y * n + (x + 1) % n, 1.0));
            edges.push((y * n + x, (y + 1) % n * n + x, 1.0));
        }
    }
    let one = |i: usize| 4.0 * (PI * i as f64 / n as f64).sin().powi(2);
    let mut expected: Vec<f64> = (0..n * n).map(|i| one(i % n) + one(i / n)).collect();
    expected.sort_by(f64::total_cmp);
    let stiffness = graph_laplacian(n * n, &edges);
    for k in [3, 60, 75] {
        let pairs = solve(&stiffness, &vec![1.0; n * n], k);
        assert!(pairs.work.n_solves > 0, "by iteration");
        assert_spectrum(&pairs, &expected[..k], 1e-11);
    }
}

#[test]
fn complete_graph_has_one_eigenvalue_many_times() {
    // No shift separates few of them: the block is solved densely after all.
    let n = 150;
    let mut edges = Vec::new();
    for i in 0..n {
        edges.extend((0..i).map(|j| (i, j, 1.0)));
    }
    let pairs = solve(&graph_laplacian(n, &edges), &vec![1.0; n], 4);
    assert_spectrum(&pairs, &[0.0, 150.0, 150.0, 150.0], 1e-13);
}

#[test]
fn sphere_converges_with_order_two() {
    let n_pairs = 49;
    let errors: Vec<f64> = [3, 4]
        .map(|cuts| {
            let (stiffness, mass) = operators(&icosphere(cuts));
            let pairs = solve(&stiffness, &mass, n_pairs);
            let mut worst = 0.0_f64;
            let mut index = 0;
            for l in 0..7_u32 {
                for _ in 0..=2 * l {
                    let exact = f64::from(l * (l + 1));
                    worst = worst.max((pairs.eigenvalues[index] - exact).abs() / exact.max(1.0));
                    index += 1;
                }
            }
            worst
        })
        .to_vec();
    let order = (errors[0] / errors[1]).log2();
    assert!(errors[1] < 0.02, "errors {errors:?}");
    assert!(
        (1.7..2.3).contains(&order),
        "order {order}, errors {errors:?}"
    );
}

#[test]
fn rectangle_with_natural_boundary() {
    let (stiffness, mass) = operators(&rectangle(PI, PI / 2.0_f64.sqrt(), 64, 45));
    let pairs = solve(&stiffness, &mass, 9);
    let expected = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 9.0, 9.0];
    assert_spectrum(&pairs, &expected, 5e-3);
}

#[test]
fn copies_repeat_every_eigenvalue() {
    let sphere = icosphere(3);
    let (stiffness, mass) = operators(&sphere);
    let single = solve(&stiffness, &mass, 20);
    let copies = [&sphere; 4];
    let (stiffness, mass) = operators(&concatenate(&copies).unwrap());
    let pairs = solve(&stiffness, &mass, 80);
    assert_eq!(pairs.null_dimension, 4, "null space");
    assert_eq!(pairs.work.n_components, 4, "components");
    let expected: Vec<f64> = single.eigenvalues.iter().flat_map(|&l| [l; 4]).collect();
    assert_spectrum(&pairs, &expected, 1e-11);
    for null in &pairs.eigenvalues[..4] {
        assert!(*null == 0.0, "exactly zero, not {null}");
    }
}

#[test]
fn small_and_large_components_together() {
    // A path of 3, one of 700 and single vertices: dense, by iteration and trivial.
    let mut edges = path_edges(3);
    edges.extend((1..700).map(|i| (i + 4, i + 5, 1.0)));
    let n = 706;
    let pairs = solve(&graph_laplacian(n, &edges), &vec![1.0; n], 60);
    assert_eq!(pairs.null_dimension, 5, "a path, a path and three vertices");
    let long = (1..700).map(|i| 4.0 * (PI * f64::from(i) / 1400.0).sin().powi(2));
    let mut expected = vec![0.0; 5];
    expected.extend([1.0, 3.0]);
    expected.extend(long);
    expected.sort_by(f64::total_cmp);
    assert_spectrum(&pairs, &expected[..60], 1e-11);
}

#[test]
fn restarts_give_the_same() {
    let (stiffness, mass) = operators(&icosphere(3));
    let free = solve(&stiffness, &mass, 40);
    let options = EigenOptions {
        max_basis_size: Some(1),
        ..EigenOptions::default()
    };
    let pairs = smallest_eigenpairs(&stiffness, &mass, 40, &options).unwrap();
    assert!(pairs.work.n_restarts > 0, "it had to restart");
    assert_spectrum(&pairs, &free.eigenvalues, 1e-11);
}
