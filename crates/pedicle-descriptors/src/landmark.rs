//! A landmark in the basis: the row Σ_v w_v φ_i(v), weights adding up to one.

use pedicle_spectral::LaplaceBasis;

use crate::DescriptorError;

/// The mean row of the basis over a patch of (vertex, weight) pairs.
pub(crate) fn landmark_row(
    basis: &LaplaceBasis,
    patch: &[(usize, f64)],
) -> Result<Vec<f64>, DescriptorError> {
    let n_vertices = basis.n_vertices();
    if let Some(&(vertex, _)) = patch.iter().find(|&&(vertex, _)| vertex >= n_vertices) {
        return Err(DescriptorError::LandmarkOutOfRange { vertex, n_vertices });
    }
    let sum: f64 = patch.iter().map(|&(_, weight)| weight).sum();
    let all_usable = patch.iter().all(|&(_, weight)| weight >= 0.0);
    if !(all_usable && sum.is_finite() && sum > 0.0) {
        return Err(DescriptorError::InvalidPatch {
            n_vertices: patch.len(),
            sum,
        });
    }
    let row = (0..basis.n_functions())
        .map(|i| {
            patch
                .iter()
                .map(|&(vertex, weight)| weight / sum * basis.eigenfunctions[(vertex, i)])
                .sum()
        })
        .collect();
    Ok(row)
}
