//! Sparse factorisation of the shifted matrix, its solves and its inertia.
//!
//!     K(μ) = M^(-1/2) W M^(-1/2) - μ I = L B Lᵀ
//!
//! B has blocks of one or two rows (Bunch & Kaufman 1977, pivoting inside a supernode). By
//! Sylvester's law K(μ) has as many eigenvalues below 0, and W x = λ M x as many below μ, as B.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, IntranodeLbltRef, SymbolicCholesky, SymbolicCholeskyRaw,
    SymmetricOrdering, factorize_symbolic_cholesky, supernodal::SupernodalIntranodeLbltRef,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use crate::SpectralError;
use crate::pencil::Pencil;

fn failure(shift: f64, reason: impl std::fmt::Display) -> SpectralError {
    SpectralError::Factorization {
        shift,
        reason: reason.to_string(),
    }
}

/// A fill-reducing elimination order of the rows: approximate minimum degree.
pub(crate) fn elimination_order(pencil: &Pencil) -> Result<Vec<usize>, SpectralError> {
    let n = pencil.n();
    let pattern = SymbolicSparseColMatRef::new_checked(n, n, &pencil.starts, None, &pencil.columns);
    let scratch = amd::order_scratch::<usize>(n, pencil.columns.len());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| failure(0.0, "out of memory"))?;
    let (mut forward, mut inverse) = (vec![0; n], vec![0; n]);
    amd::order(
        &mut forward,
        &mut inverse,
        pattern,
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|e| failure(0.0, e))?;
    Ok(forward)
}

/// The part of the factorisation that does not depend on the shift.
pub(crate) struct Factorizer {
    symbolic: SymbolicCholesky<usize>,
    starts: Vec<usize>,
    rows: Vec<usize>,
    /// Upper triangle of M^(-1/2) W M^(-1/2) by columns; the diagonal comes last in each.
    values: Vec<f64>,
}

impl Factorizer {
    /// Analyses a pencil whose rows are in elimination order.
    pub(crate) fn new(pencil: &Pencil) -> Result<Self, SpectralError> {
        let n = pencil.n();
        let scale: Vec<f64> = pencil.mass.iter().map(|m| 1.0 / m.sqrt()).collect();
        let mut starts = vec![0];
        let mut rows = Vec::new();
        let mut values = Vec::new();
        for j in 0..n {
            for (i, w) in pencil.row(j).filter(|&(i, _)| i < j) {
                rows.push(i);
                values.push(w * scale[i] * scale[j]);
            }
            rows.push(j);
            values.push(pencil.diagonal[j] / pencil.mass[j]);
            starts.push(rows.len());
        }
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &rows);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Upper, SymmetricOrdering::Identity, params)
                .map_err(|e| failure(0.0, e))?;
        Ok(Self {
            symbolic,
            starts,
            rows,
            values,
        })
    }

    /// Factorises K(μ).
    pub(crate) fn factorize(&self, shift: f64) -> Result<ShiftedFactor<'_>, SpectralError> {
        let n = self.symbolic.nrows();
        let mut shifted = self.values.clone();
        for &end in &self.starts[1..] {
            shifted[end - 1] -= shift;
        }
        let matrix = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows),
            &shifted,
        );
        let mut factor = ShiftedFactor {
            symbolic: &self.symbolic,
            values: vec![0.0; self.symbolic.len_val()],
            subdiagonal: vec![0.0; n],
            forward: vec![0; n],
            inverse: vec![0; n],
            n_below: 0,
            memory: MemBuffer::new(faer::dyn_stack::StackReq::EMPTY),
        };
        let scratch = self
            .symbolic
            .factorize_numeric_intranode_lblt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory =
            MemBuffer::try_new(scratch).map_err(|_| failure(shift, "out of memory"))?;
        self.symbolic.factorize_numeric_intranode_lblt(
            &mut factor.values,
            &mut factor.subdiagonal,
            &mut factor.forward,
            &mut factor.inverse,
            matrix,
            Side::Upper,
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        factor.n_below = factor
            .count_negative_pivots()
            .ok_or_else(|| failure(shift, "a pivot is zero or not finite"))?;
        Ok(factor)
    }
}

/// Factors of K(μ) for one shift.
pub(crate) struct ShiftedFactor<'a> {
    symbolic: &'a SymbolicCholesky<usize>,
    values: Vec<f64>,
    subdiagonal: Vec<f64>,
    forward: Vec<usize>,
    inverse: Vec<usize>,
    n_below: usize,
    memory: MemBuffer,
}

impl ShiftedFactor<'_> {
    /// Number of eigenvalues below the shift.
    pub(crate) fn n_below(&self) -> usize {
        self.n_below
    }

    /// Makes room for solves with that many right-hand sides.
    pub(crate) fn reserve(&mut self, n_columns: usize) -> Result<(), SpectralError> {
        let scratch = self
            .symbolic
            .solve_in_place_scratch::<f64>(n_columns, Par::Seq);
        self.memory = MemBuffer::try_new(scratch).map_err(|_| failure(0.0, "out of memory"))?;
        Ok(())
    }

    /// Replaces the right-hand sides b by K(μ)⁻¹ b. Room must be [reserved](Self::reserve) before.
    pub(crate) fn solve_in_place(&mut self, right_hand_sides: MatMut<'_, f64>) {
        let pivots = PermRef::new_checked(&self.forward, &self.inverse, self.forward.len());
        IntranodeLbltRef::new(self.symbolic, &self.values, &self.subdiagonal, pivots)
            .solve_in_place_with_conj(
                Conj::No,
                right_hand_sides,
                Par::Seq,
                MemStack::new(&mut self.memory),
            );
    }

    /// Negative eigenvalues of B; `None` if an eigenvalue is zero or not finite.
    fn count_negative_pivots(&self) -> Option<usize> {
        let SymbolicCholeskyRaw::Supernodal(symbolic) = self.symbolic.raw() else {
            return None;
        };
        let pivots = PermRef::new_checked(&self.forward, &self.inverse, self.forward.len());
        let factor =
            SupernodalIntranodeLbltRef::new(symbolic, &self.values, &self.subdiagonal, pivots);
        let mut count = 0;
        for s in 0..symbolic.n_supernodes() {
            let supernode = factor.supernode(s);
            let (block, start) = (supernode.val(), supernode.start());
            let mut i = 0;
            while i < block.ncols() {
                let below = self.subdiagonal[start + i];
                let diagonal = block[(i, i)];
                if below == 0.0 {
                    if diagonal == 0.0 || !diagonal.is_finite() {
                        return None;
                    }
                    count += usize::from(diagonal < 0.0);
                    i += 1;
                    continue;
                }
                // A block of two rows: its determinant tells whether the signs differ.
                let next = block[(i + 1, i + 1)];
                let determinant = diagonal * next - below * below;
                if determinant == 0.0 || !determinant.is_finite() {
                    return None;
                }
                count += match (determinant < 0.0, diagonal < 0.0) {
                    (true, _) => 1,
                    (false, true) => 2,
                    (false, false) => 0,
                };
                i += 2;
            }
        }
        Some(count)
    }
}
