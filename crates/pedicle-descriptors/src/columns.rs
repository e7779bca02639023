//! Columns of descriptors: f / √(fᵀ M f), and side by side.

use faer::Mat;

/// Divides every column f by its norm √(Σ_i m_i f_i²); a column of zeros stays zero.
///
/// Two shapes of different size, or two kinds of descriptor, weigh the same afterwards.
///
/// # Panics
/// If `mass` does not have one entry per row.
#[must_use]
pub fn normalize_columns(mut functions: Mat<f64>, mass: &[f64]) -> Mat<f64> {
    assert_eq!(functions.nrows(), mass.len(), "one mass per row");
    for j in 0..functions.ncols() {
        let column = functions.col_as_slice_mut(j);
        // Scaled by the largest entry first: squares of heat at late times underflow.
        let largest = column.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if largest <= 0.0 || !largest.is_finite() {
            continue;
        }
        let sum: f64 = column
            .iter()
            .zip(mass)
            .map(|(f, m)| m * (f / largest).powi(2))
            .sum();
        let norm = largest * sum.sqrt();
        if norm > 0.0 {
            for value in column {
                *value /= norm;
            }
        }
    }
    functions
}

/// All columns of all matrices in order. Nothing given gives a 0 × 0 matrix.
///
/// # Panics
/// If the matrices do not all have the same number of rows.
#[must_use]
pub fn concatenate_columns(parts: &[Mat<f64>]) -> Mat<f64> {
    let n_rows = parts.first().map_or(0, Mat::nrows);
    let n_columns = parts.iter().map(Mat::ncols).sum();
    let mut all = Mat::zeros(n_rows, n_columns);
    let mut first = 0;
    for part in parts {
        assert_eq!(part.nrows(), n_rows, "the same number of rows everywhere");
        all.subcols_mut(first, part.ncols()).copy_from(part);
        first += part.ncols();
    }
    all
}
