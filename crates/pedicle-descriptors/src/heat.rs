//! Heat kernel signatures.
//!
//! ```text
//! HKS(x, t)    = Σ_i exp(-λ_i t) φ_i(x)²
//! HK(x, l, t)  = Σ_i exp(-λ_i t) φ_i(x) φ_i(l)          seen from a landmark l
//! ```
//!
//! n × p, one column a time, 1/mm². The sums run over the whole basis with the null space: there
//! the kernel is 1/area of the component, and from a landmark it is zero on every other one.
//! Σ_x m_x HKS(x, t) = Σ_i exp(-λ_i t).
//!
//! Sun, Ovsjanikov & Guibas 2009, eq. (2) and (6).

use faer::Mat;
use pedicle_spectral::LaplaceBasis;

use crate::{DescriptorError, HeatTimes, landmark::landmark_row};

/// Heat that stays at every vertex, n × times.
#[must_use]
pub fn heat_kernel_signature(basis: &LaplaceBasis, times: &HeatTimes) -> Mat<f64> {
    let phi = &basis.eigenfunctions;
    let squared = Mat::from_fn(phi.nrows(), phi.ncols(), |x, i| phi[(x, i)] * phi[(x, i)]);
    squared * decay(basis, times)
}

/// Heat that reaches every vertex from one landmark vertex, n × times.
///
/// # Errors
/// [`DescriptorError::LandmarkOutOfRange`] if there is no such vertex.
pub fn heat_kernel_from_landmark(
    basis: &LaplaceBasis,
    vertex: usize,
    times: &HeatTimes,
) -> Result<Mat<f64>, DescriptorError> {
    heat_kernel_from_patch(basis, &[(vertex, 1.0)], times)
}

/// Heat that reaches every vertex from a patch of (vertex, weight) pairs, n × times.
///
/// The weights are divided by their sum. A patch stands for a landmark between vertices, or for
/// one that is known only roughly.
///
/// # Errors
/// [`DescriptorError`] if a vertex does not exist, a weight is negative or the sum is zero.
pub fn heat_kernel_from_patch(
    basis: &LaplaceBasis,
    patch: &[(usize, f64)],
    times: &HeatTimes,
) -> Result<Mat<f64>, DescriptorError> {
    let row = landmark_row(basis, patch)?;
    let mut spectrum = decay(basis, times);
    for j in 0..spectrum.ncols() {
        for (i, &value) in row.iter().enumerate() {
            spectrum[(i, j)] *= value;
        }
    }
    Ok(&basis.eigenfunctions * spectrum)
}

/// exp(-λ_i t_j), k × times.
fn decay(basis: &LaplaceBasis, times: &HeatTimes) -> Mat<f64> {
    let times = times.as_slice();
    Mat::from_fn(basis.n_functions(), times.len(), |i, j| {
        // Zero eigenvalues come out of a solver as ±1e-16; heat must not grow.
        if i < basis.null_dimension {
            1.0
        } else {
            (-basis.eigenvalues[i] * times[j]).exp()
        }
    })
}
