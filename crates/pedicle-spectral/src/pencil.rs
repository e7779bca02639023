//! One connected block of the pencil (W, M), in elimination order.
//!
//! ```text
//! (W x)_i = r_i x_i + Σ_j W_ij (x_j - x_i),   r_i = Σ_j W_ij
//! xᵀ W x  = Σ_i r_i x_i² - Σ_{i<j} W_ij (x_i - x_j)²
//! ```
//!
//! Differences first: smooth vectors lose no digits, and a constant has exactly no energy where
//! the rows sum to 0. Row sums of the size of rounding are taken as 0.

use faer::{MatMut, MatRef};

use crate::lanes::{LANES, as_slice, as_slice_mut};
use crate::parallel::map;

/// One entry of eight vectors.
pub(crate) type Row = [f64; LANES];

/// Symmetric sparse rows with their masses.
#[derive(Debug, Clone)]
pub(crate) struct Pencil {
    /// Start of every row in `columns` and `values`.
    pub(crate) starts: Vec<usize>,
    /// Columns of the off-diagonal entries.
    pub(crate) columns: Vec<usize>,
    /// Off-diagonal entries.
    pub(crate) values: Vec<f64>,
    /// Diagonal entries W_ii.
    pub(crate) diagonal: Vec<f64>,
    /// Row sums r_i, exactly 0 where they are of the size of rounding.
    pub(crate) row_sums: Vec<f64>,
    /// Diagonal of M.
    pub(crate) mass: Vec<f64>,
}

impl Pencil {
    /// Number of rows.
    pub(crate) fn n(&self) -> usize {
        self.mass.len()
    }

    /// Off-diagonal entries of a row as (column, value).
    pub(crate) fn row(&self, i: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.starts[i]..self.starts[i + 1];
        let columns = self.columns[range.clone()].iter().copied();
        columns.zip(self.values[range].iter().copied())
    }

    /// Whether constants are in the null space: all rows sum to 0.
    pub(crate) fn annihilates_constants(&self) -> bool {
        self.row_sums.iter().all(|&r| r == 0.0)
    }

    /// The rows taken in another order: row i of the result is row `order[i]` of this one.
    pub(crate) fn reordered(&self, order: &[usize]) -> Self {
        let mut position = vec![0; self.n()];
        for (new, &old) in order.iter().enumerate() {
            position[old] = new;
        }
        let mut starts = Vec::with_capacity(self.n() + 1);
        let mut columns = Vec::with_capacity(self.columns.len());
        let mut values = Vec::with_capacity(self.values.len());
        let mut row = Vec::new();
        starts.push(0);
        for &old in order {
            row.clear();
            row.extend(self.row(old).map(|(j, w)| (position[j], w)));
            row.sort_unstable_by_key(|&(j, _)| j);
            columns.extend(row.iter().map(|&(j, _)| j));
            values.extend(row.iter().map(|&(_, w)| w));
            starts.push(columns.len());
        }
        let pick = |source: &[f64]| order.iter().map(|&old| source[old]).collect();
        Self {
            starts,
            columns,
            values,
            diagonal: pick(&self.diagonal),
            row_sums: pick(&self.row_sums),
            mass: pick(&self.mass),
        }
    }

    /// Rayleigh quotient λ = xᵀWx / xᵀMx and residual ‖W x - λ M x‖ in the M⁻¹ norm of every
    /// column.
    pub(crate) fn quotients_and_residuals(&self, columns: MatRef<'_, f64>) -> Vec<(f64, f64)> {
        let groups: Vec<_> = (0..columns.ncols()).step_by(LANES).collect();
        let results = map(groups, |_, first| {
            let count = LANES.min(columns.ncols() - first);
            let mut x = vec![[0.0; LANES]; self.n()];
            for lane in 0..count {
                for (row, &value) in x.iter_mut().zip(as_slice(columns, first + lane)) {
                    row[lane] = value;
                }
            }
            let (product, quotients) = self.multiply(&x);
            let residuals = self.residuals(&x, &product, &quotients);
            (0..count).map(move |lane| (quotients[lane], residuals[lane]))
        });
        results.into_iter().flatten().collect()
    }

    /// x = M^(-1/2) y for all columns.
    pub(crate) fn unscale(&self, mut columns: MatMut<'_, f64>) {
        for j in 0..columns.ncols() {
            let column = as_slice_mut(columns.as_mut(), j);
            for (x, m) in column.iter_mut().zip(&self.mass) {
                *x /= m.sqrt();
            }
        }
    }

    /// Products W x and Rayleigh quotients.
    fn multiply(&self, x: &[Row]) -> (Vec<Row>, Row) {
        let mut product = vec![[0.0; LANES]; self.n()];
        let mut energy = [0.0; LANES];
        let mut norm = [0.0; LANES];
        for i in 0..self.n() {
            let own = x[i];
            let mut sum = [0.0; LANES];
            let mut row_energy = [0.0; LANES];
            for (j, w) in self.row(i) {
                let other = &x[j];
                for lane in 0..LANES {
                    let difference = other[lane] - own[lane];
                    let flow = w * difference;
                    sum[lane] += flow;
                    row_energy[lane] -= flow * difference;
                }
            }
            for lane in 0..LANES {
                let along = self.row_sums[i] * own[lane];
                product[i][lane] = along + sum[lane];
                // Every edge is met from both of its ends.
                energy[lane] += along * own[lane] + 0.5 * row_energy[lane];
                norm[lane] += self.mass[i] * own[lane] * own[lane];
            }
        }
        let quotients = std::array::from_fn(|lane| energy[lane] / norm[lane]);
        (product, quotients)
    }

    fn residuals(&self, x: &[Row], product: &[Row], quotients: &Row) -> Row {
        let mut sum = [0.0; LANES];
        for ((x, product), &mass) in x.iter().zip(product).zip(&self.mass) {
            for lane in 0..LANES {
                let residual = product[lane] - quotients[lane] * mass * x[lane];
                sum[lane] += residual * residual / mass;
            }
        }
        sum.map(f64::sqrt)
    }
}
