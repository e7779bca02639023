//! Solves with the factors of K(μ), eight right-hand sides at a time, and their inertia.
//!
//! ```text
//! P K(μ) Pᵀ = L B Lᵀ,   x = Pᵀ L⁻ᵀ B⁻¹ L⁻¹ P b
//! ```
//!
//! L is unit lower triangular, stored by columns without its zeros; B⁻¹ is stored as a diagonal and
//! the entries beside it. By Sylvester's law of inertia K(μ) has as many eigenvalues below 0, and
//! W x = λ M x as many below μ, as B has.

use faer::MatMut;
use faer::MatRef;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

use crate::lanes::{LANES, as_slice, gather, plus_scaled, scatter};
use crate::parallel::map;

/// Fewest rows at which two threads are faster than one.
const ROWS_WORTH_SHARING: usize = 8192;

/// The numbers that the supernodal factorisation leaves behind.
pub(crate) struct PivotedFactor {
    /// Columns of the supernodes, diagonal blocks on top.
    pub(crate) values: Vec<f64>,
    /// Entry below the diagonal of B; 0 in blocks of one row.
    pub(crate) subdiagonal: Vec<f64>,
    /// Pivot order: position → row.
    pub(crate) forward: Vec<usize>,
    /// Row → position.
    pub(crate) inverse: Vec<usize>,
}

impl PivotedFactor {
    /// Room for a factorisation of n rows in their own order.
    pub(crate) fn unpivoted(n: usize, n_values: usize) -> Self {
        Self {
            values: vec![0.0; n_values],
            subdiagonal: vec![0.0; n],
            forward: (0..n).collect(),
            inverse: (0..n).collect(),
        }
    }

    /// Largest diagonal entry of |L| |B| |L|ᵀ, for B diagonal.
    pub(crate) fn growth(&self, symbolic: &SymbolicSupernodalCholesky<usize>) -> f64 {
        let mut sizes = vec![0.0; self.forward.len()];
        for s in 0..symbolic.n_supernodes() {
            let begin = symbolic.supernode_begin()[s];
            let (columns, pattern) = supernode(symbolic, &self.values, s);
            for j in 0..columns.ncols() {
                let column = as_slice(columns, j);
                let pivot = column[j].abs();
                sizes[begin + j] += pivot;
                let (top, bottom) = column.split_at(columns.ncols());
                for (i, l) in top.iter().enumerate().skip(j + 1) {
                    sizes[begin + i] += l * l * pivot;
                }
                for (&i, l) in pattern.iter().zip(bottom) {
                    sizes[i] += l * l * pivot;
                }
            }
        }
        // Not `max`, which would lose NaN.
        sizes.into_iter().fold(
            0.0,
            |largest, size| if size <= largest { largest } else { size },
        )
    }
}

/// B⁻¹ and its inertia.
pub(crate) struct Pivots {
    /// Diagonal of B⁻¹.
    inverse_diagonal: Vec<f64>,
    /// Entries (i, i + 1) of B⁻¹; 0 in blocks of one row.
    inverse_beside: Vec<f64>,
    /// Number of negative eigenvalues of B.
    pub(crate) n_negative: usize,
}

/// L, B⁻¹ and P.
pub(crate) struct TriangularFactor {
    order: Vec<u32>,
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<f64>,
    pivots: Pivots,
}

/// Columns of one supernode, and the rows below its diagonal block.
fn supernode<'a>(
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    values: &'a [f64],
    s: usize,
) -> (MatRef<'a, f64>, &'a [usize]) {
    let n_columns = symbolic.supernode_end()[s] - symbolic.supernode_begin()[s];
    let start = symbolic.col_ptr_for_row_idx()[s];
    let pattern = &symbolic.row_idx()[start..start + symbolic.nnz_per_super()[s]];
    let range = symbolic.col_ptr_for_val()[s]..symbolic.col_ptr_for_val()[s + 1];
    let n_rows = n_columns + pattern.len();
    let columns = MatRef::from_column_major_slice(&values[range], n_rows, n_columns);
    (columns, pattern)
}

impl Pivots {
    /// Inverts B and counts its negative eigenvalues; `None` if one is zero or not finite.
    pub(crate) fn new(
        symbolic: &SymbolicSupernodalCholesky<usize>,
        factor: &PivotedFactor,
    ) -> Option<Self> {
        let n = factor.forward.len();
        let mut pivots = Self {
            inverse_diagonal: vec![0.0; n],
            inverse_beside: vec![0.0; n],
            n_negative: 0,
        };
        for s in 0..symbolic.n_supernodes() {
            let (begin, end) = (symbolic.supernode_begin()[s], symbolic.supernode_end()[s]);
            let (columns, _) = supernode(symbolic, &factor.values, s);
            pivots.append(begin, columns, &factor.subdiagonal[begin..end])?;
        }
        Some(pivots)
    }

    fn append(
        &mut self,
        begin: usize,
        columns: MatRef<'_, f64>,
        subdiagonal: &[f64],
    ) -> Option<()> {
        let mut i = 0;
        while i < subdiagonal.len() {
            let (a, b) = (columns[(i, i)], subdiagonal[i]);
            if b == 0.0 {
                if a == 0.0 || !a.is_finite() {
                    return None;
                }
                self.inverse_diagonal[begin + i] = 1.0 / a;
                self.n_negative += usize::from(a < 0.0);
                i += 1;
                continue;
            }
            let c = columns[(i + 1, i + 1)];
            // Divided by b, so that the determinant neither overflows nor cancels needlessly.
            let (p, q) = (a / b, c / b);
            let determinant = p * q - 1.0;
            if determinant == 0.0 || !determinant.is_finite() {
                return None;
            }
            self.inverse_diagonal[begin + i] = q / (b * determinant);
            self.inverse_diagonal[begin + i + 1] = p / (b * determinant);
            self.inverse_beside[begin + i] = -1.0 / (b * determinant);
            // Signs differ where the determinant is negative; else both are that of a.
            self.n_negative += match (determinant < 0.0, a < 0.0) {
                (true, _) => 1,
                (false, true) => 2,
                (false, false) => 0,
            };
            i += 2;
        }
        Some(())
    }
}

impl TriangularFactor {
    /// Unpacks a supernodal factorisation.
    pub(crate) fn new(
        symbolic: &SymbolicSupernodalCholesky<usize>,
        factor: &PivotedFactor,
        pivots: Pivots,
    ) -> Self {
        let n = factor.forward.len();
        let mut result = Self {
            order: factor.forward.iter().map(|&i| i as u32).collect(),
            starts: Vec::with_capacity(n + 1),
            rows: Vec::with_capacity(factor.values.len()),
            values: Vec::with_capacity(factor.values.len()),
            pivots,
        };
        result.starts.push(0);
        for s in 0..symbolic.n_supernodes() {
            let (columns, pattern) = supernode(symbolic, &factor.values, s);
            let begin = symbolic.supernode_begin()[s];
            result.append_columns(begin, columns, pattern, &factor.inverse);
        }
        result
    }

    fn append_columns(
        &mut self,
        begin: usize,
        columns: MatRef<'_, f64>,
        pattern: &[usize],
        position: &[usize],
    ) {
        let n_columns = columns.ncols();
        for j in 0..n_columns {
            let column = as_slice(columns, j);
            for (i, &value) in column.iter().enumerate().skip(j + 1) {
                if value == 0.0 {
                    continue;
                }
                let row = match i.checked_sub(n_columns) {
                    Some(below) => position[pattern[below]],
                    None => begin + i,
                };
                self.rows.push(row as u32);
                self.values.push(value);
            }
            self.starts.push(self.rows.len());
        }
    }

    /// Number of rows.
    pub(crate) fn n(&self) -> usize {
        self.order.len()
    }

    /// Replaces right-hand sides (b × n, one a row) by K(μ)⁻¹ times them.
    ///
    /// Every right-hand side is solved for itself, so that no bit depends on how they are dealt
    /// out: eight at a time on one thread, four on each of several.
    pub(crate) fn solve_in_place(&self, mut right_hand_sides: MatMut<'_, f64>) {
        let n = self.order.len();
        if n >= ROWS_WORTH_SHARING && rayon::current_num_threads() > 1 {
            const HALF: usize = LANES / 2;
            let solved = map(lane_groups(right_hand_sides.nrows(), HALF), |_, lanes| {
                self.solve_lanes::<HALF>(right_hand_sides.as_ref().subrows(lanes.0, lanes.1))
            });
            for (first, count) in lane_groups(right_hand_sides.nrows(), HALF) {
                let rows = right_hand_sides.as_mut().subrows_mut(first, count);
                scatter(&solved[first / HALF], &self.order, rows);
            }
            return;
        }
        for (first, count) in lane_groups(right_hand_sides.nrows(), LANES) {
            let mut rows = right_hand_sides.as_mut().subrows_mut(first, count);
            let solved = self.solve_lanes::<LANES>(rows.as_ref());
            scatter(&solved, &self.order, rows.as_mut());
        }
    }

    /// K(μ)⁻¹ times up to N right-hand sides, in pivot order.
    fn solve_lanes<const N: usize>(&self, right_hand_sides: MatRef<'_, f64>) -> Vec<[f64; N]> {
        let mut work = gather::<N>(right_hand_sides, &self.order);
        pulp::Arch::new().dispatch(Substitution {
            factor: self,
            x: &mut work,
        });
        work
    }
}

/// x ← L⁻ᵀ B⁻¹ L⁻¹ x, compiled for wide registers where the processor has them.
struct Substitution<'a, const N: usize> {
    factor: &'a TriangularFactor,
    x: &'a mut [[f64; N]],
}

impl<const N: usize> pulp::WithSimd for Substitution<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { factor, x } = self;
        let n = x.len();
        for j in 0..n {
            let range = factor.starts[j]..factor.starts[j + 1];
            let xj = x[j];
            for (&i, &l) in factor.rows[range.clone()].iter().zip(&factor.values[range]) {
                let i = i as usize;
                x[i] = plus_scaled(x[i], -l, xj);
            }
        }
        let pivots = &factor.pivots;
        for j in 0..n {
            let beside = pivots.inverse_beside[j];
            // The second row of a block was finished together with the first.
            if j > 0 && pivots.inverse_beside[j - 1] != 0.0 {
                continue;
            }
            let xj = x[j];
            let zero = [0.0; N];
            x[j] = plus_scaled(zero, pivots.inverse_diagonal[j], xj);
            if beside != 0.0 {
                let next = x[j + 1];
                x[j] = plus_scaled(x[j], beside, next);
                let own = plus_scaled(zero, pivots.inverse_diagonal[j + 1], next);
                x[j + 1] = plus_scaled(own, beside, xj);
            }
        }
        for j in (0..n).rev() {
            let range = factor.starts[j]..factor.starts[j + 1];
            let mut xj = x[j];
            for (&i, &l) in factor.rows[range.clone()].iter().zip(&factor.values[range]) {
                xj = plus_scaled(xj, -l, x[i as usize]);
            }
            x[j] = xj;
        }
    }
}

/// Start and length of every group of up to `width` of `n` right-hand sides.
fn lane_groups(n: usize, width: usize) -> Vec<(usize, usize)> {
    let starts = (0..n).step_by(width);
    starts.map(|s| (s, width.min(n - s))).collect()
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use sprs::TriMat;

    use crate::components::connected_components;
    use crate::factor::{Factorizer, elimination_order};

    #[test]
    fn indefinite_solve_and_inertia_of_a_grid() {
        // Five-point stencil of a 12 × 9 grid; eigenvalues 4 - 2cos(πi/12) - 2cos(πj/9).
        let (nx, ny) = (12_usize, 9_usize);
        let n = nx * ny;
        let mut triplets = TriMat::new((n, n));
        let mut join = |a: usize, b: usize| {
            for (i, j, w) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                triplets.add_triplet(i, j, w);
            }
        };
        for y in 0..ny {
            for x in 0..nx {
                if x + 1 < nx {
                    join(y * nx + x, y * nx + x + 1);
                }
                if y + 1 < ny {
                    join(y * nx + x, (y + 1) * nx + x);
                }
            }
        }
        let matrix = triplets.to_csr::<usize>();
        let pencil = connected_components(&matrix, &vec![1.0; n])
            .remove(0)
            .pencil;
        let pencil = pencil.reordered(&elimination_order(&pencil).unwrap());
        let factorizer = Factorizer::new(&pencil).unwrap();
        let angle = |i: usize, n: usize| std::f64::consts::PI * i as f64 / n as f64;
        for shift in [-0.3, 0.41, 1.3, 2.05, 3.3, 4.4, 5.9, 8.5] {
            let factor = factorizer.factorize(shift).unwrap();
            let below = (0..n)
                .filter(|&i| {
                    let (a, b) = (angle(i % nx, nx), angle(i / nx, ny));
                    4.0 - 2.0 * a.cos() - 2.0 * b.cos() < shift
                })
                .count();
            assert_eq!(
                factorizer.count_below(shift).unwrap(),
                below,
                "eigenvalues below {shift}"
            );
            // Eleven columns: one full set of lanes and a part of another.
            let right = Mat::from_fn(n, 11, |i, j| ((i * 7 + j * 13) % 29) as f64 - 14.0);
            let mut rows = right.transpose().to_owned();
            factor.solve_in_place(rows.as_mut());
            let x = rows.transpose();
            for j in 0..11 {
                for i in 0..n {
                    let off: f64 = pencil.row(i).map(|(k, w)| w * x[(k, j)]).sum();
                    let product = off + (pencil.diagonal[i] - shift) * x[(i, j)];
                    let error = (product - right[(i, j)]).abs();
                    assert!(error < 1e-10, "row {i}, column {j}, shift {shift}: {error}");
                }
            }
        }
    }
}
