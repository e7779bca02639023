//! Wave kernel signatures.
//!
//! ```text
//! WKS(x, e)    = Σ_i g_i(e) φ_i(x)²
//! WK(x, l, e)  = Σ_i g_i(e) φ_i(x) φ_i(l)               seen from a landmark l
//! g_i(e)       = exp(-(e - ln λ_i)² / (2 s²)) / Σ_j exp(-(e - ln λ_j)² / (2 s²))
//! ```
//!
//! n × p, one column an energy, 1/mm². The sums run over the modes above the null space.
//! Σ_x m_x WKS(x, e) = 1.
//!
//! Aubry, Schlickewei & Cremers 2011, eq. (5).

use faer::Mat;
use pedicle_spectral::LaplaceBasis;

use crate::{DescriptorError, WaveEnergies, landmark::landmark_row};

/// Probability of a particle of every energy at every vertex, n × energies.
#[must_use]
pub fn wave_kernel_signature(basis: &LaplaceBasis, energies: &WaveEnergies) -> Mat<f64> {
    let phi = &basis.eigenfunctions;
    let squared = Mat::from_fn(phi.nrows(), phi.ncols(), |x, i| phi[(x, i)] * phi[(x, i)]);
    squared * band_pass(basis, energies)
}

/// The band-passed kernel between every vertex and one landmark vertex, n × energies.
///
/// # Errors
/// [`DescriptorError::LandmarkOutOfRange`] if there is no such vertex.
pub fn wave_kernel_from_landmark(
    basis: &LaplaceBasis,
    vertex: usize,
    energies: &WaveEnergies,
) -> Result<Mat<f64>, DescriptorError> {
    wave_kernel_from_patch(basis, &[(vertex, 1.0)], energies)
}

/// The band-passed kernel between every vertex and a patch of (vertex, weight) pairs.
///
/// The weights are divided by their sum.
///
/// # Errors
/// [`DescriptorError`] if a vertex does not exist, a weight is negative or the sum is zero.
pub fn wave_kernel_from_patch(
    basis: &LaplaceBasis,
    patch: &[(usize, f64)],
    energies: &WaveEnergies,
) -> Result<Mat<f64>, DescriptorError> {
    let row = landmark_row(basis, patch)?;
    let mut spectrum = band_pass(basis, energies);
    for j in 0..spectrum.ncols() {
        for (i, &value) in row.iter().enumerate() {
            spectrum[(i, j)] *= value;
        }
    }
    Ok(&basis.eigenfunctions * spectrum)
}

/// g_i(e_j), k × energies; the rows of the null space are zero, every column adds up to one.
fn band_pass(basis: &LaplaceBasis, energies: &WaveEnergies) -> Mat<f64> {
    let above = basis.null_dimension.min(basis.n_functions());
    let mut weights = Mat::zeros(basis.n_functions(), energies.as_slice().len());
    for (j, &energy) in energies.as_slice().iter().enumerate() {
        let exponents: Vec<f64> = basis.eigenvalues[above..]
            .iter()
            .map(|lambda| -0.5 * ((energy - lambda.ln()) / energies.spread()).powi(2))
            .collect();
        // Only ratios matter: without the largest exponent a far energy would be 0/0.
        let largest = exponents
            .iter()
            .fold(f64::NEG_INFINITY, |a, &b| if b > a { b } else { a });
        let total: f64 = exponents.iter().map(|e| (e - largest).exp()).sum();
        for (i, exponent) in exponents.iter().enumerate() {
            weights[(above + i, j)] = (exponent - largest).exp() / total;
        }
    }
    weights
}
