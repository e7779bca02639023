//! Signatures against their sums, their scaling and each other.

use faer::Mat;
use pedicle_descriptors::{
    DescriptorError, HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark,
    heat_kernel_from_patch, heat_kernel_signature, normalize_columns, wave_kernel_from_landmark,
    wave_kernel_from_patch, wave_kernel_signature,
};
use pedicle_spectral::LaplaceBasis;

use crate::shapes::{largest_difference, path, two_paths};

fn integral(basis: &LaplaceBasis, functions: &Mat<f64>, column: usize) -> f64 {
    (0..basis.n_vertices())
        .map(|i| basis.mass[i] * functions[(i, column)])
        .sum()
}

#[test]
fn the_integral_of_the_heat_signature_is_the_heat_trace() {
    for basis in [path(50, 30, 2.0), two_paths(20, 10)] {
        let times = HeatTimes::joint(&basis, &basis, 6).unwrap();
        let signature = heat_kernel_signature(&basis, &times);
        for (j, t) in times.as_slice().iter().enumerate() {
            let trace: f64 = basis.eigenvalues.iter().map(|l| (-l * t).exp()).sum();
            assert!((integral(&basis, &signature, j) / trace - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn the_integral_of_the_wave_signature_is_one() {
    for basis in [path(50, 30, 2.0), two_paths(20, 10)] {
        let energies = WaveEnergies::joint(&basis, &basis, 9).unwrap();
        let signature = wave_kernel_signature(&basis, &energies);
        for j in 0..9 {
            assert!((integral(&basis, &signature, j) - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn heat_from_a_landmark_is_conserved_and_symmetric() {
    let basis = path(50, 50, 1.0);
    let times = HeatTimes::joint(&basis, &basis, 6).unwrap();
    let from_three = heat_kernel_from_landmark(&basis, 3, &times).unwrap();
    let from_thirty = heat_kernel_from_landmark(&basis, 30, &times).unwrap();
    for j in 0..6 {
        assert!((integral(&basis, &from_three, j) - 1.0).abs() < 1e-12);
        assert!((from_three[(30, j)] - from_thirty[(3, j)]).abs() < 1e-14);
    }
    let signature = heat_kernel_signature(&basis, &times);
    assert!((from_three[(3, 2)] - signature[(3, 2)]).abs() < 1e-14);
}

#[test]
fn a_landmark_does_not_reach_other_components() {
    let basis = two_paths(20, 10);
    let times = HeatTimes::joint(&basis, &basis, 5).unwrap();
    let heat = heat_kernel_from_landmark(&basis, 4, &times).unwrap();
    for j in 0..5 {
        assert!((20..60).all(|i| heat[(i, j)].abs() < 1e-15));
        assert!((integral(&basis, &heat, j) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_patch_is_the_weighted_mean_of_its_landmarks() {
    let basis = path(50, 30, 1.0);
    let times = HeatTimes::joint(&basis, &basis, 4).unwrap();
    let energies = WaveEnergies::joint(&basis, &basis, 4).unwrap();
    let patch = [(7, 3.0), (9, 1.0)];
    let mean = |a: Mat<f64>, b: Mat<f64>| {
        Mat::from_fn(a.nrows(), a.ncols(), |i, j| {
            0.75 * a[(i, j)] + 0.25 * b[(i, j)]
        })
    };
    let heat = mean(
        heat_kernel_from_landmark(&basis, 7, &times).unwrap(),
        heat_kernel_from_landmark(&basis, 9, &times).unwrap(),
    );
    let found = heat_kernel_from_patch(&basis, &patch, &times).unwrap();
    assert!(largest_difference(&heat, &found) < 1e-14);
    let wave = mean(
        wave_kernel_from_landmark(&basis, 7, &energies).unwrap(),
        wave_kernel_from_landmark(&basis, 9, &energies).unwrap(),
    );
    let found = wave_kernel_from_patch(&basis, &patch, &energies).unwrap();
    assert!(largest_difference(&wave, &found) < 1e-14);
}

#[test]
fn normalised_descriptors_do_not_depend_on_the_unit() {
    // Vectors of norm one in the mass of the shape scale with 1/s, as the mass does with s².
    let describe = |basis: &LaplaceBasis| {
        let times = HeatTimes::joint(basis, basis, 8).unwrap();
        let energies = WaveEnergies::joint(basis, basis, 8).unwrap();
        let all = concatenate_columns(&[
            heat_kernel_signature(basis, &times),
            heat_kernel_from_landmark(basis, 5, &times).unwrap(),
            wave_kernel_signature(basis, &energies),
            wave_kernel_from_landmark(basis, 5, &energies).unwrap(),
        ]);
        normalize_columns(all, &basis.mass)
    };
    let unit = describe(&path(50, 30, 1.0));
    for scale in [1e-3, 1e3] {
        let mut scaled = describe(&path(50, 30, scale));
        for j in 0..scaled.ncols() {
            for value in scaled.col_as_slice_mut(j) {
                *value *= scale;
            }
        }
        assert!(largest_difference(&unit, &scaled) < 1e-9, "scale {scale}");
    }
}

#[test]
fn identical_shapes_have_identical_descriptors_and_signs_do_not_matter() {
    let basis = path(50, 30, 1.0);
    let mut flipped = basis.clone();
    for j in (0..30).step_by(3) {
        for value in flipped.eigenfunctions.col_as_slice_mut(j) {
            *value = -*value;
        }
    }
    let times = HeatTimes::joint(&basis, &flipped, 5).unwrap();
    let a = heat_kernel_from_landmark(&basis, 11, &times).unwrap();
    let b = heat_kernel_from_landmark(&flipped, 11, &times).unwrap();
    assert!(largest_difference(&a, &b) <= 0.0);
}

#[test]
fn far_energies_stay_finite() {
    let basis = path(50, 30, 1.0);
    let energies = WaveEnergies::new(vec![-1e4, 1e4], 1e-3).unwrap();
    let signature = wave_kernel_signature(&basis, &energies);
    for j in 0..2 {
        assert!((integral(&basis, &signature, j) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn bad_landmarks_are_refused() {
    let basis = path(50, 30, 1.0);
    let times = HeatTimes::joint(&basis, &basis, 4).unwrap();
    assert_eq!(
        heat_kernel_from_landmark(&basis, 50, &times).unwrap_err(),
        DescriptorError::LandmarkOutOfRange {
            vertex: 50,
            n_vertices: 50
        }
    );
    for patch in [
        &[][..],
        &[(1, 0.0)],
        &[(1, f64::NAN)],
        &[(1, -1.0), (2, 3.0)],
    ] {
        assert!(matches!(
            heat_kernel_from_patch(&basis, patch, &times),
            Err(DescriptorError::InvalidPatch { .. })
        ));
    }
}

#[test]
fn columns_are_normalised_in_the_mass_and_zeros_stay() {
    let functions = Mat::from_fn(3, 3, |i, j| match j {
        0 => i as f64,
        1 => 0.0,
        _ => 1e-200,
    });
    let mass = [1.0, 2.0, 3.0];
    let normal = normalize_columns(functions, &mass);
    for j in [0, 2] {
        let norm: f64 = (0..3).map(|i| mass[i] * normal[(i, j)].powi(2)).sum();
        assert!((norm - 1.0).abs() < 1e-12);
    }
    assert!((0..3).all(|i| normal[(i, 1)].abs() <= 0.0));
    let nothing = concatenate_columns(&[]);
    assert_eq!((nothing.nrows(), nothing.ncols()), (0, 0));
}
