//! What is refused, and how it is named.

use pedicle_spectral::{EigenOptions, SpectralError, smallest_eigenpairs};
use sprs::{CsMat, TriMat};

use crate::shapes::graph_laplacian;

fn path(n: usize) -> CsMat<f64> {
    graph_laplacian(n, &(1..n).map(|i| (i - 1, i, 1.0)).collect::<Vec<_>>())
}

fn refused(stiffness: &CsMat<f64>, mass: &[f64], n_pairs: usize) -> SpectralError {
    smallest_eigenpairs(stiffness, mass, n_pairs, &EigenOptions::default()).unwrap_err()
}

fn with_entry(i: usize, j: usize, value: f64) -> CsMat<f64> {
    let mut triplets = TriMat::new((5, 5));
    for (&w, place) in path(5).iter().filter(|&(_, place)| place != (i, j)) {
        triplets.add_triplet(place.0, place.1, w);
    }
    triplets.add_triplet(i, j, value);
    triplets.to_csr()
}

#[test]
fn sizes_are_named() {
    let wide = TriMat::<f64>::new((3, 4)).to_csr();
    let (rows, columns) = (3, 4);
    assert_eq!(
        refused(&wide, &[1.0; 3], 1),
        SpectralError::NotSquare { rows, columns }
    );
    let (n_rows, n_masses) = (5, 4);
    let error = refused(&path(5), &[1.0; 4], 1);
    assert_eq!(error, SpectralError::SizesDiffer { n_rows, n_masses });
    let (requested, available) = (6, 5);
    let error = refused(&path(5), &[1.0; 5], 6);
    assert_eq!(
        error,
        SpectralError::TooManyPairs {
            requested,
            available
        }
    );
    assert_eq!(refused(&path(5), &[1.0; 5], 0), SpectralError::NoPairs);
}

#[test]
fn an_empty_matrix_has_no_pairs() {
    let error = refused(&TriMat::<f64>::new((0, 0)).to_csr(), &[], 1);
    let (requested, available) = (1, 0);
    assert_eq!(
        error,
        SpectralError::TooManyPairs {
            requested,
            available
        }
    );
}

#[test]
fn bad_masses_are_named() {
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let mut mass = [1.0; 5];
        mass[3] = value;
        let error = refused(&path(5), &mass, 2);
        assert!(
            matches!(error, SpectralError::NonPositiveMass { row: 3, .. }),
            "{error}"
        );
    }
}

#[test]
fn bad_entries_are_named() {
    let error = refused(&with_entry(2, 3, f64::NAN), &[1.0; 5], 2);
    let named = matches!(
        error,
        SpectralError::NotFinite {
            row: 2,
            column: 3,
            ..
        }
    );
    assert!(named, "{error}");
    let error = refused(&with_entry(2, 3, -1.5), &[1.0; 5], 2);
    let SpectralError::NotSymmetric {
        row,
        column,
        value,
        mirrored,
    } = error
    else {
        panic!("wrong error: {error}");
    };
    assert_eq!((row, column), (2, 3), "place");
    assert!(
        (value + 1.5).abs() + (mirrored + 1.0).abs() < 1e-15,
        "values"
    );
    // An entry without a mirror image.
    let error = refused(&with_entry(0, 4, 0.5), &[1.0; 5], 2);
    let named = matches!(
        error,
        SpectralError::NotSymmetric {
            row: 0,
            column: 4,
            ..
        }
    );
    assert!(named, "{error}");
}

#[test]
fn bad_options_are_named() {
    for (options, name) in [
        (
            EigenOptions {
                tolerance: 0.0,
                ..Default::default()
            },
            "tolerance",
        ),
        (
            EigenOptions {
                tolerance: f64::NAN,
                ..Default::default()
            },
            "tolerance",
        ),
        (
            EigenOptions {
                block_size: 0,
                ..Default::default()
            },
            "block_size",
        ),
        (
            EigenOptions {
                block_size: 1000,
                ..Default::default()
            },
            "block_size",
        ),
    ] {
        let error = smallest_eigenpairs(&path(5), &[1.0; 5], 2, &options).unwrap_err();
        let SpectralError::InvalidOption { option, .. } = error else {
            panic!("wrong error: {error}");
        };
        assert_eq!(option, name, "name of the option");
    }
}

#[test]
fn too_few_restarts_are_an_error_with_numbers() {
    let options = EigenOptions {
        max_restarts: 0,
        max_basis_size: Some(1),
        ..EigenOptions::default()
    };
    let error = smallest_eigenpairs(&path(900), &[1.0; 900], 30, &options).unwrap_err();
    let SpectralError::NotConverged {
        n_converged,
        requested,
        residuals,
        first_row: 0,
        worst_residual,
        ..
    } = error
    else {
        panic!("wrong error: {error}");
    };
    assert!(n_converged < requested, "{n_converged} of {requested}");
    assert!(!residuals.is_empty(), "residuals of the wanted pairs");
    let largest = residuals.iter().fold(0.0_f64, |m, &r| m.max(r));
    assert!((largest - worst_residual).abs() == 0.0, "the worst of them");
}

#[test]
fn no_convergence_names_the_block() {
    // A single vertex, and then a path that starts at row 1.
    let edges: Vec<_> = (2..900).map(|i| (i - 1, i, 1.0)).collect();
    let options = EigenOptions {
        max_restarts: 0,
        max_basis_size: Some(1),
        ..EigenOptions::default()
    };
    let stiffness = graph_laplacian(900, &edges);
    let error = smallest_eigenpairs(&stiffness, &[1.0; 900], 30, &options).unwrap_err();
    assert!(error.to_string().contains("block of row 1;"), "{error}");
}
