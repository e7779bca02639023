//! The few dense operations that the crate needs, always on one thread.
//!
//! One thread a product: the order of summation, and with it the last bit, does not depend on
//! how many threads there are. Parallel loops run over independent products instead.

use faer::{Accum, Mat, MatMut, MatRef, Par, linalg::matmul::matmul};

use crate::FmapError;

/// A B.
pub(crate) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    set_product(out.as_mut(), a, b);
    out
}

/// out = A B.
pub(crate) fn set_product(out: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(out, Accum::Replace, a, b, 1.0, Par::Seq);
}

/// A B, column after column without gaps.
pub(crate) fn product_without_gaps(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Vec<f64> {
    let mut values = vec![0.0; a.nrows() * b.ncols()];
    let out = MatMut::from_column_major_slice_mut(&mut values, a.nrows(), b.ncols());
    set_product(out, a, b);
    values
}

/// out += factor A B.
pub(crate) fn add_product(out: &mut Mat<f64>, factor: f64, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(out.as_mut(), Accum::Add, a, b, factor, Par::Seq);
}

/// Σ_ij A_ij B_ij, column by column.
pub(crate) fn dot(a: &Mat<f64>, b: &Mat<f64>) -> f64 {
    (0..a.ncols())
        .map(|j| {
            let pairs = a.col_as_slice(j).iter().zip(b.col_as_slice(j));
            pairs.map(|(x, y)| x * y).sum::<f64>()
        })
        .sum()
}

/// out += factor A.
pub(crate) fn add_scaled(out: &mut Mat<f64>, factor: f64, a: &Mat<f64>) {
    for j in 0..a.ncols() {
        for (o, x) in out.col_as_slice_mut(j).iter_mut().zip(a.col_as_slice(j)) {
            *o += factor * x;
        }
    }
}

/// The nearest matrix with orthonormal rows or columns: U Vᵀ of the singular value decomposition.
pub(crate) fn nearest_orthogonal(a: &Mat<f64>) -> Result<Mat<f64>, FmapError> {
    let svd = a.thin_svd().map_err(|_| FmapError::Decomposition {
        what: "a functional map",
        rows: a.nrows(),
        columns: a.ncols(),
    })?;
    Ok(product(svd.U(), svd.V().transpose()))
}
