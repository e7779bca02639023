//! Many commutators at once.
//!
//! ```text
//! E(C) = ½ w Σ_i ‖C S_i - σ T_i C‖²
//! ∇E   = w (C Σ S_i S_iᵀ + Σ T_iᵀ T_i C) - w σ Σ_i (T_iᵀ C S_i + T_i C S_iᵀ)
//! ```
//!
//! The sums of squares are taken once. With T = T⁺ + T⁻ and S = S⁺ + S⁻, symmetric and
//! antisymmetric, the rest is
//!
//! ```text
//! Tᵀ C S + T C Sᵀ = 2 (T⁺ C S⁺ - T⁻ C S⁻)
//! ```
//!
//! so that all of it is Σ_j X_j C Y_j with matrices X_j, Y_j that are one or the other: two products
//! of C with all of them side by side.

use faer::{Mat, MatMut, MatRef};
use rayon::prelude::*;

use crate::linear::{add_product, add_scaled, dot, product, set_product};

/// Pairs X_j, Y_j whose products are summed in one go: their number is fixed, so that no bit depends
/// on the number of threads.
const PAIRS_PER_PRODUCT: usize = 32;
/// A symmetric or antisymmetric part below this share of its matrix is rounding.
const ROUNDING: f64 = 1e-14;

/// ½ w Σ_i ‖C S_i - σ T_i C‖².
#[derive(Debug, Clone)]
pub(crate) struct Commutators {
    /// w.
    pub(crate) weight: f64,
    /// σ.
    pub(crate) sign: f64,
    /// S_i, one a column, k_source² × count.
    pub(crate) source: Mat<f64>,
    /// T_i, one a column, k_target² × count.
    pub(crate) target: Mat<f64>,
}

impl Commutators {
    /// All pairs (S_i, T_i).
    fn pairs(&self) -> impl Iterator<Item = (MatRef<'_, f64>, MatRef<'_, f64>)> {
        (0..self.source.ncols()).map(|i| (square(&self.source, i), square(&self.target, i)))
    }

    /// The energy at C.
    pub(crate) fn energy(&self, c: &Mat<f64>) -> f64 {
        let energies = self.pairs().map(|(s, t)| {
            let mut rest = product(c.as_ref(), s);
            add_product(&mut rest, -self.sign, t, c.as_ref());
            dot(&rest, &rest)
        });
        0.5 * self.weight * energies.sum::<f64>()
    }
}

/// Column i as a square matrix.
fn square(columns: &Mat<f64>, i: usize) -> MatRef<'_, f64> {
    let k = columns.nrows().isqrt();
    MatRef::from_column_major_slice(columns.col_as_slice(i), k, k)
}

/// The Hessian of the sum of several [`Commutators`].
#[derive(Debug, Clone)]
pub(crate) struct CommutatorHessian {
    /// Σ w S Sᵀ.
    pub(crate) source_squares: Mat<f64>,
    /// Σ w Tᵀ T.
    pub(crate) target_squares: Mat<f64>,
    cross_terms: Vec<CrossTerms>,
}

/// C ↦ Σ_j X_j C Y_j.
#[derive(Debug, Clone)]
struct CrossTerms {
    /// Number of pairs.
    count: usize,
    /// X_jᵀ side by side, k_target × (k_target count).
    x_transposed: Vec<f64>,
    /// Row b of Y_j is row j + count b, (count k_source) × k_source.
    y: Vec<f64>,
}

impl CommutatorHessian {
    pub(crate) fn new(commutators: &[&Commutators], (k_target, k_source): (usize, usize)) -> Self {
        let mut source_squares = Mat::zeros(k_source, k_source);
        let mut target_squares = Mat::zeros(k_target, k_target);
        let mut parts = Vec::new();
        for some in commutators {
            for (s, t) in some.pairs() {
                add_product(&mut source_squares, some.weight, s, s.transpose());
                add_product(&mut target_squares, some.weight, t.transpose(), t);
                let factor = -2.0 * some.weight * some.sign;
                let smallest = ROUNDING * s.norm_l2() * t.norm_l2();
                for kind in [1.0, -1.0] {
                    let (x, y) = (part(t, kind), part(s, kind));
                    if x.norm_l2() * y.norm_l2() > smallest {
                        parts.push((x, y, kind * factor));
                    }
                }
            }
        }
        let cross_terms = parts.chunks(PAIRS_PER_PRODUCT).map(CrossTerms::new);
        Self {
            source_squares,
            target_squares,
            cross_terms: cross_terms.collect(),
        }
    }

    /// Adds the Hessian times C.
    pub(crate) fn add_times(&self, c: &Mat<f64>, out: &mut Mat<f64>) {
        add_product(out, 1.0, c.as_ref(), self.source_squares.as_ref());
        add_product(out, 1.0, self.target_squares.as_ref(), c.as_ref());
        let times = |terms: &CrossTerms| terms.times(c);
        let sums: Vec<Mat<f64>> = self.cross_terms.par_iter().map(times).collect();
        for part in sums {
            add_scaled(out, 1.0, &part);
        }
    }

    /// Σ_j X_j(i, i) Y_j, the block of row i less the squares, as row i of k_target × k_source².
    pub(crate) fn row_blocks(&self) -> Mat<f64> {
        let (k_target, k_source) = (self.target_squares.nrows(), self.source_squares.nrows());
        let mut blocks = Mat::zeros(k_target, k_source * k_source);
        for terms in &self.cross_terms {
            let columns = k_source * k_source;
            let y = MatRef::from_column_major_slice(&terms.y, terms.count, columns);
            let diagonals = Mat::from_fn(k_target, terms.count, |i, j| {
                terms.x_transposed[(j * k_target + i) * k_target + i]
            });
            add_product(&mut blocks, 1.0, diagonals.as_ref(), y);
        }
        blocks
    }
}

impl CrossTerms {
    fn new(parts: &[(Mat<f64>, Mat<f64>, f64)]) -> Self {
        let count = parts.len();
        let k_source = parts.first().map_or(0, |(_, y, _)| y.nrows());
        let mut y_rows = vec![0.0; count * k_source * k_source];
        let mut x_transposed = Vec::new();
        for (j, (x, y, factor)) in parts.iter().enumerate() {
            for i in 0..x.nrows() {
                x_transposed.extend(x.row(i).iter());
            }
            for column in 0..k_source {
                for row in 0..k_source {
                    y_rows[j + count * (row + k_source * column)] = factor * y[(row, column)];
                }
            }
        }
        Self {
            count,
            x_transposed,
            y: y_rows,
        }
    }

    /// Σ_j X_j C Y_j.
    fn times(&self, c: &Mat<f64>) -> Mat<f64> {
        let (k_target, k_source) = c.shape();
        let rows = k_target * self.count;
        let x = MatRef::from_column_major_slice(&self.x_transposed, k_target, rows);
        let mut carried = vec![0.0; rows * k_source];
        let out = MatMut::from_column_major_slice_mut(&mut carried, rows, k_source);
        set_product(out, x.transpose(), c.as_ref());
        // (X_j C)(a, b) lies at a + k_target (j + count b): X_j C side by side, in the order of the
        // rows of Y.
        let columns = self.count * k_source;
        let carried = MatRef::from_column_major_slice(&carried, k_target, columns);
        let y = MatRef::from_column_major_slice(&self.y, columns, k_source);
        product(carried, y)
    }
}

/// (A ± Aᵀ) / 2.
fn part(a: MatRef<'_, f64>, sign: f64) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| {
        0.5 * (a[(i, j)] + sign * a[(j, i)])
    })
}
