//! Starts from what is known already: the same answer, less work, no trust.

use faer::{Mat, MatRef};
use nalgebra::Point3;
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_spectral::{
    EigenOptions, EigenPairs, SpectralError, laplace_basis, laplace_basis_from,
    smallest_eigenpairs, smallest_eigenpairs_from,
};
use sprs::CsMat;

use crate::shapes::{icosphere, operators, potato};

fn cold(stiffness: &CsMat<f64>, mass: &[f64], n_pairs: usize) -> EigenPairs {
    smallest_eigenpairs(stiffness, mass, n_pairs, &EigenOptions::default()).unwrap()
}

fn warm(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_pairs: usize,
    known: MatRef<'_, f64>,
) -> EigenPairs {
    let options = EigenOptions::default();
    smallest_eigenpairs_from(stiffness, mass, n_pairs, known, &options).unwrap()
}

fn assert_same_spectrum(found: &EigenPairs, expected: &EigenPairs) {
    assert!(found.certificate.complete, "complete");
    assert_eq!(found.null_dimension, expected.null_dimension, "null space");
    let last = expected.eigenvalues[expected.eigenvalues.len() - 1];
    for (i, (a, b)) in found
        .eigenvalues
        .iter()
        .zip(&expected.eigenvalues)
        .enumerate()
    {
        assert!((a - b).abs() <= 1e-11 * last, "eigenvalue {i}: {a}, {b}");
    }
    let worst = found.residuals.iter().fold(0.0_f64, |m, &r| m.max(r));
    assert!(worst <= 1e-9 * last, "residual {worst} of {last}");
}

fn assert_orthonormal(pairs: &EigenPairs, mass: &[f64]) {
    let x = &pairs.eigenvectors;
    let weighted = Mat::from_fn(x.nrows(), x.ncols(), |i, j| mass[i] * x[(i, j)]);
    let gram = x.transpose() * &weighted;
    let difference = &gram - &Mat::<f64>::identity(x.ncols(), x.ncols());
    assert!(difference.norm_max() < 1e-11, "XᵀMX - I");
}

#[test]
fn the_next_pairs_from_the_last() {
    let (stiffness, mass) = operators(&potato(4));
    let expected = cold(&stiffness, &mass, 80);
    let half = cold(&stiffness, &mass, 40);
    let found = warm(&stiffness, &mass, 80, half.eigenvectors.as_ref());
    assert_eq!(found.work.n_locked, 39, "all but the constant");
    assert!(
        found.work.n_solves < 4 * expected.work.n_solves / 5,
        "{} solves instead of {}",
        found.work.n_solves,
        expected.work.n_solves
    );
    assert_same_spectrum(&found, &expected);
    assert_orthonormal(&found, &mass);
}

#[test]
fn more_known_than_wanted() {
    let (stiffness, mass) = operators(&potato(4));
    let expected = cold(&stiffness, &mass, 40);
    let found = warm(&stiffness, &mass, 30, expected.eigenvectors.as_ref());
    assert!(found.work.n_locked >= 29, "locked {}", found.work.n_locked);
    assert_orthonormal(&found, &mass);
    let mut shorter = expected;
    shorter.eigenvalues.truncate(30);
    assert_same_spectrum(&found, &shorter);
}

#[test]
fn clusters_cut_in_the_middle_are_completed() {
    // Twelve pairs of a sphere end inside the multiplet of seven.
    let (stiffness, mass) = operators(&icosphere(3));
    let twelve = cold(&stiffness, &mass, 12);
    let found = warm(&stiffness, &mass, 49, twelve.eigenvectors.as_ref());
    assert_same_spectrum(&found, &cold(&stiffness, &mass, 49));
    assert_orthonormal(&found, &mass);
}

#[test]
fn several_components_go_on_each_for_itself() {
    let (a, b) = (potato(3), icosphere(3));
    let (stiffness, mass) = operators(&concatenate(&[&a, &b, &a]).unwrap());
    let half = cold(&stiffness, &mass, 30);
    let found = warm(&stiffness, &mass, 60, half.eigenvectors.as_ref());
    assert!(found.work.n_locked > 20, "locked {}", found.work.n_locked);
    assert_same_spectrum(&found, &cold(&stiffness, &mass, 60));
    assert_orthonormal(&found, &mass);
}

#[test]
fn a_wrong_guess_never_gives_a_wrong_answer() {
    let (stiffness, mass) = operators(&potato(3));
    let (n, k) = (mass.len(), 30);
    let expected = cold(&stiffness, &mass, k);
    let pairs = &expected.eigenvectors;
    let gapped: Vec<usize> = (0..k).filter(|i| i % 3 != 1).collect();
    let guesses = [
        Mat::zeros(n, 0),
        Mat::zeros(n, 3),
        Mat::from_fn(n, 7, |_, _| 1.0),
        Mat::from_fn(n, 25, |i, j| ((i * 37 + j * 101) % 71) as f64 - 35.0),
        // The same vector many times, in wild scales.
        Mat::from_fn(n, 12, |i, j| {
            10.0_f64.powi(4 * j as i32 - 20) * pairs[(i, 5)]
        }),
        // Some are missing in the middle, backwards.
        Mat::from_fn(n, gapped.len(), |i, j| {
            pairs[(i, gapped[gapped.len() - 1 - j])]
        }),
        // Only the last ones.
        pairs.subcols(20, 10).to_owned(),
        // Sums of two.
        Mat::from_fn(n, 14, |i, j| pairs[(i, 2 * j)] + pairs[(i, 2 * j + 1)]),
        // Rows in the wrong order.
        Mat::from_fn(n, k, |i, j| pairs[((7 * i + 3) % n, j)]),
        // More vectors than rows.
        Mat::from_fn(n, n + 5, |i, j| f64::from(u8::from(i == j % n))),
    ];
    for (case, guess) in guesses.iter().enumerate() {
        println!("guess {case}");
        let found = warm(&stiffness, &mass, k, guess.as_ref());
        assert_same_spectrum(&found, &expected);
        assert_orthonormal(&found, &mass);
    }
    // Rows instead of columns in memory.
    let rows = pairs.transpose().to_owned();
    assert_same_spectrum(&warm(&stiffness, &mass, k, rows.transpose()), &expected);
}

#[test]
fn a_bent_shape_from_the_straight_one() {
    let mesh = potato(4);
    let bent = mesh.vertices().iter();
    let bent = bent.map(|p| Point3::new(p.x + 0.002 * p.y * p.y, p.y, p.z));
    let bent = TriMesh::new(bent.collect(), mesh.faces().to_vec()).unwrap();
    let options = EigenOptions::default();
    let (stiffness, mass) = operators(&mesh);
    let straight = laplace_basis(&stiffness, &mass, 40, &options).unwrap();
    let (stiffness, mass) = operators(&bent);
    let expected = laplace_basis(&stiffness, &mass, 40, &options).unwrap();
    let found = laplace_basis_from(&stiffness, &mass, 40, &straight, &options).unwrap();
    for (a, b) in found.eigenvalues.iter().zip(&expected.eigenvalues) {
        assert!((a - b).abs() <= 1e-11 * b, "{a} against {b}");
    }
    let gram = found.project(expected.eigenfunctions.as_ref());
    let difference = &gram - &Mat::<f64>::identity(40, 40);
    assert!(difference.norm_max() < 1e-7, "same functions and signs");
}

#[test]
fn known_vectors_that_do_not_fit_are_named() {
    let (stiffness, mass) = operators(&potato(2));
    let options = EigenOptions::default();
    let n_rows = mass.len();
    let refused = |known: &Mat<f64>| {
        smallest_eigenpairs_from(&stiffness, &mass, 5, known.as_ref(), &options).unwrap_err()
    };
    let n_known = n_rows - 1;
    assert_eq!(
        refused(&Mat::zeros(n_known, 2)),
        SpectralError::KnownSizeDiffers { n_known, n_rows }
    );
    let mut known = Mat::zeros(n_rows, 2);
    known[(4, 1)] = f64::INFINITY;
    let (row, column, value) = (4, 1, f64::INFINITY);
    assert_eq!(
        refused(&known),
        SpectralError::KnownNotFinite { row, column, value }
    );
}
