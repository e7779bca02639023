//! Bases that are known in closed form.

use std::f64::consts::PI;

use faer::Mat;
use pedicle_spectral::LaplaceBasis;

/// The first `k` modes of a path of `n` vertices scaled by `scale`: λ = (2 - 2cos(πj/n)) / s².
pub(crate) fn path(n: usize, k: usize, scale: f64) -> LaplaceBasis {
    let mass = scale * scale;
    LaplaceBasis {
        eigenvalues: (0..k)
            .map(|j| (2.0 - 2.0 * (PI * j as f64 / n as f64).cos()) / mass)
            .collect(),
        eigenfunctions: Mat::from_fn(n, k, |i, j| {
            let norm = if j == 0 { 1.0 } else { 2.0 };
            (norm / (n as f64 * mass)).sqrt() * (PI * j as f64 * (i as f64 + 0.5) / n as f64).cos()
        }),
        mass: vec![mass; n],
        null_dimension: 1,
    }
}

/// Two paths side by side: `n` and `2 n` vertices, a null space of two.
pub(crate) fn two_paths(n: usize, k: usize) -> LaplaceBasis {
    let parts = [path(n, k, 1.0), path(2 * n, k, 1.0)];
    let mut modes: Vec<(f64, usize, usize)> = Vec::new();
    for (part, basis) in parts.iter().enumerate() {
        modes.extend((0..k).map(|j| (basis.eigenvalues[j], part, j)));
    }
    modes.sort_by(|a, b| a.0.total_cmp(&b.0));
    LaplaceBasis {
        eigenvalues: modes.iter().map(|m| m.0).collect(),
        eigenfunctions: Mat::from_fn(3 * n, modes.len(), |i, j| {
            let (_, part, mode) = modes[j];
            match part {
                0 if i < n => parts[0].eigenfunctions[(i, mode)],
                1 if i >= n => parts[1].eigenfunctions[(i - n, mode)],
                _ => 0.0,
            }
        }),
        mass: vec![1.0; 3 * n],
        null_dimension: 2,
    }
}

pub(crate) fn largest_difference(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    assert_eq!((a.nrows(), a.ncols()), (b.nrows(), b.ncols()), "same shape");
    (0..a.ncols())
        .flat_map(|j| (0..a.nrows()).map(move |i| (i, j)))
        .map(|at| (a[at] - b[at]).abs())
        .fold(0.0, f64::max)
}
