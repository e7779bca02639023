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
//! so that all of it is Σ_j f_j X_j C Y_j with matrices X_j, Y_j that are one or the other: two
//! products of C with all of them side by side.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::{
    linear::{add_product, add_scaled, dot, product, product_without_gaps},
    stack::Stack,
};

/// What is known of the operators of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Symmetry {
    /// S = Sᵀ, T = Tᵀ.
    Symmetric,
    /// S = -Sᵀ, T = -Tᵀ.
    Antisymmetric,
    /// Neither.
    None,
}

/// ½ w Σ_i ‖C S_i - σ T_i C‖².
#[derive(Debug, Clone)]
pub(crate) struct Commutators {
    /// w.
    pub(crate) weight: f64,
    /// σ.
    pub(crate) sign: f64,
    /// S_i, k_source × k_source.
    pub(crate) source: Stack,
    /// T_i, k_target × k_target.
    pub(crate) target: Stack,
    /// Of all of them.
    pub(crate) symmetry: Symmetry,
}

impl Commutators {
    /// The energy at C.
    pub(crate) fn energy(&self, c: &Mat<f64>) -> f64 {
        let energies = (0..self.source.count).map(|i| {
            let mut rest = product(c.as_ref(), self.source.matrix(i));
            add_product(&mut rest, -self.sign, self.target.matrix(i), c.as_ref());
            dot(&rest, &rest)
        });
        0.5 * self.weight * energies.sum::<f64>()
    }

    /// -w σ Σ_i (T_iᵀ C S_i + T_i C S_iᵀ).
    fn cross_terms(&self) -> Vec<CrossTerms> {
        let factor = -2.0 * self.weight * self.sign;
        let term = |sign: f64, x: &Stack, y: &Stack| CrossTerms::new(sign * factor, sign, x, y);
        match self.symmetry {
            Symmetry::Symmetric => vec![term(1.0, &self.target, &self.source)],
            Symmetry::Antisymmetric => vec![term(-1.0, &self.target, &self.source)],
            Symmetry::None => [1.0, -1.0]
                .map(|sign| term(sign, &self.target.parts(sign), &self.source.parts(sign)))
                .into(),
        }
    }
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

/// C ↦ Σ_j f X_j C Y_j.
#[derive(Debug, Clone)]
struct CrossTerms {
    /// X_j = ± X_jᵀ.
    x: Stack,
    /// Row b of f Y_j, with the sign of X, is row j + count b, (count k_source) × k_source.
    y: Vec<f64>,
}

impl CommutatorHessian {
    pub(crate) fn new(commutators: &[&Commutators], (k_target, k_source): (usize, usize)) -> Self {
        let mut source_squares = Mat::zeros(k_source, k_source);
        let mut target_squares = Mat::zeros(k_target, k_target);
        for some in commutators {
            let s = some.source.side_by_side();
            add_product(&mut source_squares, some.weight, s, s.transpose());
            if some.symmetry == Symmetry::None {
                for i in 0..some.target.count {
                    let t = some.target.matrix(i);
                    add_product(&mut target_squares, some.weight, t.transpose(), t);
                }
            } else {
                let t = some.target.side_by_side();
                add_product(&mut target_squares, some.weight, t, t.transpose());
            }
        }
        let cross_terms = commutators.iter().flat_map(|some| some.cross_terms());
        Self {
            source_squares,
            target_squares,
            cross_terms: cross_terms.collect(),
        }
    }

    /// Adds the Hessian times C, but for C Σ w S Sᵀ.
    pub(crate) fn add_times(&self, c: &Mat<f64>, out: &mut Mat<f64>) {
        add_product(out, 1.0, self.target_squares.as_ref(), c.as_ref());
        let terms = self.cross_terms.par_iter();
        let sums: Vec<Mat<f64>> = terms.map(|terms| terms.times(c)).collect();
        for sum in &sums {
            add_scaled(out, 1.0, sum);
        }
    }

    /// Σ_j f X_j(i, i) Y_j, the block of row i less the squares, as row i of k_target × k_source².
    pub(crate) fn row_blocks(&self) -> Mat<f64> {
        let (k_target, k_source) = (self.target_squares.nrows(), self.source_squares.nrows());
        let mut blocks = Mat::zeros(k_target, k_source * k_source);
        for terms in &self.cross_terms {
            let count = terms.x.count;
            let y = MatRef::from_column_major_slice(&terms.y, count, k_source * k_source);
            let diagonals = Mat::from_fn(k_target, count, |i, j| terms.x.matrix(j)[(i, i)]);
            add_product(&mut blocks, 1.0, diagonals.as_ref(), y);
        }
        blocks
    }
}

impl CrossTerms {
    /// `sign` is that of X_jᵀ = ± X_j.
    fn new(factor: f64, sign: f64, x: &Stack, y: &Stack) -> Self {
        let columns = y.columns();
        let mut rows = vec![0.0; columns.nrows() * columns.ncols()];
        for (i, row) in rows.chunks_exact_mut(y.count.max(1)).enumerate() {
            for (value, j) in row.iter_mut().zip(0..) {
                *value = sign * factor * columns[(i, j)];
            }
        }
        Self {
            x: x.clone(),
            y: rows,
        }
    }

    /// Σ_j f X_j C Y_j.
    fn times(&self, c: &Mat<f64>) -> Mat<f64> {
        let (k_target, k_source) = c.shape();
        // Their transpose has the X_jᵀ = ± X_j below each other.
        let x = self.x.side_by_side();
        let carried = product_without_gaps(x.transpose(), c.as_ref());
        // (X_jᵀ C)(a, b) lies at a + k_target (j + count b): the X_jᵀ C side by side, in the order
        // of the rows of Y.
        let columns = self.x.count * k_source;
        let carried = MatRef::from_column_major_slice(&carried, k_target, columns);
        let y = MatRef::from_column_major_slice(&self.y, columns, k_source);
        product(carried, y)
    }
}
