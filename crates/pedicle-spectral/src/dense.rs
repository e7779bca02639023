//! All eigenpairs of a small block by the dense solver.
//!
//! ```text
//! M^(-1/2) W M^(-1/2) y = λ y,   x = M^(-1/2) y
//! ```

use faer::Mat;

use crate::SpectralError;
use crate::lanczos::symmetric_eigen;
use crate::pencil::Pencil;

/// Eigenvalues in ascending order and unit eigenvectors of M^(-1/2) W M^(-1/2).
pub(crate) fn all_eigenpairs(pencil: &Pencil) -> Result<(Vec<f64>, Mat<f64>), SpectralError> {
    let n = pencil.n();
    let scale: Vec<f64> = pencil.mass.iter().map(|m| 1.0 / m.sqrt()).collect();
    let mut matrix = Mat::<f64>::zeros(n, n);
    for i in 0..n {
        matrix[(i, i)] = pencil.diagonal[i] / pencil.mass[i];
        for (j, w) in pencil.row(i).filter(|&(j, _)| j < i) {
            matrix[(i, j)] = w * scale[i] * scale[j];
            matrix[(j, i)] = matrix[(i, j)];
        }
    }
    symmetric_eigen(matrix.as_ref())
}
