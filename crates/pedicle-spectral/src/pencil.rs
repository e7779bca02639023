//! One connected block of the pencil (W, M), in elimination order.
//!
//! ```text
//! (W x)_i = r_i x_i + Σ_j W_ij (x_j - x_i),   r_i = Σ_j W_ij
//! xᵀ W x  = Σ_i r_i x_i² - Σ_{i<j} W_ij (x_i - x_j)²
//! ```
//!
//! Differences first: smooth vectors lose no digits, and a constant has exactly no energy where
//! the rows sum to 0. Row sums of the size of rounding are taken as 0.

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

    /// Rayleigh quotient xᵀWx / xᵀMx.
    pub(crate) fn rayleigh_quotient(&self, x: &[f64]) -> f64 {
        let mut energy = 0.0;
        let mut norm = 0.0;
        for i in 0..self.n() {
            let mut row_energy = 0.0;
            for (j, w) in self.row(i) {
                if j > i {
                    let difference = x[i] - x[j];
                    row_energy -= w * difference * difference;
                }
            }
            energy += self.row_sums[i] * x[i] * x[i] + row_energy;
            norm += self.mass[i] * x[i] * x[i];
        }
        energy / norm
    }

    /// Residual ‖W x - λ M x‖ in the M⁻¹ norm, for x of unit M norm.
    pub(crate) fn residual(&self, x: &[f64], eigenvalue: f64) -> f64 {
        let mut sum = 0.0;
        for i in 0..self.n() {
            let mut product = self.row_sums[i] * x[i];
            for (j, w) in self.row(i) {
                product += w * (x[j] - x[i]);
            }
            let residual = product - eigenvalue * self.mass[i] * x[i];
            sum += residual * residual / self.mass[i];
        }
        sum.sqrt()
    }
}
