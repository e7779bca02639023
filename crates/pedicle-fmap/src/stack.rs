//! Square matrices of one size, one after the other in memory.
//!
//! Side by side they are a k × (k count) matrix, written down column by column a k² × count one:
//! both views of the same numbers.

use faer::{Mat, MatRef};

use crate::linear::product_without_gaps;

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct Stack {
    /// Rows and columns of a matrix.
    pub(crate) size: usize,
    /// Number of matrices.
    pub(crate) count: usize,
    values: Vec<f64>,
}

impl Stack {
    /// The matrices, all k × k.
    pub(crate) fn new<'a>(size: usize, matrices: impl Iterator<Item = &'a Mat<f64>>) -> Self {
        let mut values = Vec::new();
        for matrix in matrices {
            (0..size).for_each(|j| values.extend_from_slice(matrix.col_as_slice(j)));
        }
        Self {
            size,
            count: values.len() / (size * size),
            values,
        }
    }

    /// One matrix, k × k.
    pub(crate) fn matrix(&self, i: usize) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(self.values_of(i), self.size, self.size)
    }

    /// The numbers of one matrix, column after column.
    pub(crate) fn values_of(&self, i: usize) -> &[f64] {
        let numbers = self.size * self.size;
        &self.values[i * numbers..(i + 1) * numbers]
    }

    /// All matrices side by side, k × (k count).
    pub(crate) fn side_by_side(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.size, self.size * self.count)
    }

    /// One matrix a column, k² × count.
    pub(crate) fn columns(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.size * self.size, self.count)
    }

    /// Matrix j of the result is Σ_i mixture(i, j) matrix i.
    pub(crate) fn mixed(&self, mixture: MatRef<'_, f64>) -> Self {
        Self {
            size: self.size,
            count: mixture.ncols(),
            values: product_without_gaps(self.columns(), mixture),
        }
    }

    /// Every matrix A replaced by (A ± Aᵀ) / 2.
    pub(crate) fn parts(&self, sign: f64) -> Self {
        let parts: Vec<Mat<f64>> = (0..self.count)
            .map(|i| {
                let a = self.matrix(i);
                Mat::from_fn(self.size, self.size, |r, c| {
                    0.5 * (a[(r, c)] + sign * a[(c, r)])
                })
            })
            .collect();
        Self::new(self.size, parts.iter())
    }
}
