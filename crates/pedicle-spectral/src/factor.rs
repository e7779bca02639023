//! Sparse factorisation of the shifted matrix, its solves and its inertia.
//!
//! ```text
//! K(μ) = M^(-1/2) W M^(-1/2) - μ I = L B Lᵀ
//! ```
//!
//! B is diagonal as long as the elimination without pivoting is stable: the rounding error is that
//! of a change of K by ε |L| |B| |L|ᵀ (Higham 2002, section 11.1), which is looked at. Otherwise B
//! has blocks of one or two rows (Bunch & Kaufman 1977, pivoting inside a supernode).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SymbolicSupernodalCholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side};

use crate::SpectralError;
use crate::pencil::Pencil;
use crate::triangular::{PivotedFactor, Pivots, TriangularFactor};

/// Largest entry of |L| |B| |L|ᵀ, relative to the largest diagonal entry of K, with which solves
/// are made without pivoting.
const GROWTH_OF_SOLVES: f64 = 1e2;
/// The same for counts: they only err if an eigenvalue is this close to the shift.
const GROWTH_OF_COUNTS: f64 = 1e4;

fn failure(shift: f64, reason: impl std::fmt::Display) -> SpectralError {
    SpectralError::Factorization {
        first_row: 0,
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

    /// Number of eigenvalues below μ.
    pub(crate) fn count_below(&self, shift: f64) -> Result<usize, SpectralError> {
        let factor = self.pivoted(shift, GROWTH_OF_COUNTS)?;
        Ok(self.pivots(shift, &factor)?.n_negative)
    }

    /// Factorises K(μ) for solves.
    pub(crate) fn factorize(&self, shift: f64) -> Result<TriangularFactor, SpectralError> {
        let factor = self.pivoted(shift, GROWTH_OF_SOLVES)?;
        let pivots = self.pivots(shift, &factor)?;
        Ok(TriangularFactor::new(
            self.supernodes(shift)?,
            &factor,
            pivots,
        ))
    }

    fn supernodes(&self, shift: f64) -> Result<&SymbolicSupernodalCholesky<usize>, SpectralError> {
        match self.symbolic.raw() {
            SymbolicCholeskyRaw::Supernodal(symbolic) => Ok(symbolic),
            SymbolicCholeskyRaw::Simplicial(_) => Err(failure(shift, "it has no supernodes")),
        }
    }

    fn pivots(&self, shift: f64, factor: &PivotedFactor) -> Result<Pivots, SpectralError> {
        Pivots::new(self.supernodes(shift)?, factor)
            .ok_or_else(|| failure(shift, "a pivot is zero or not finite"))
    }

    /// Plain L D Lᵀ where that is stable, else with pivoting.
    fn pivoted(&self, shift: f64, largest_growth: f64) -> Result<PivotedFactor, SpectralError> {
        let n = self.symbolic.nrows();
        let mut shifted = self.values.clone();
        let mut size = 0.0_f64;
        for &end in &self.starts[1..] {
            shifted[end - 1] -= shift;
            size = size.max(shifted[end - 1].abs());
        }
        let matrix = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows),
            &shifted,
        );
        let mut factor = PivotedFactor::unpivoted(n, self.symbolic.len_val());
        if self.factorize_unpivoted(matrix, &mut factor, shift)? {
            let growth = factor.growth(self.supernodes(shift)?);
            if growth <= largest_growth * size {
                return Ok(factor);
            }
        }
        self.factorize_pivoted(matrix, &mut factor, shift)?;
        Ok(factor)
    }

    /// Returns whether the elimination came to its end.
    fn factorize_unpivoted(
        &self,
        matrix: SparseColMatRef<'_, usize, f64>,
        factor: &mut PivotedFactor,
        shift: f64,
    ) -> Result<bool, SpectralError> {
        let scratch = self
            .symbolic
            .factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory =
            MemBuffer::try_new(scratch).map_err(|_| failure(shift, "out of memory"))?;
        let result = self.symbolic.factorize_numeric_ldlt(
            &mut factor.values,
            matrix,
            Side::Upper,
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        Ok(result.is_ok())
    }

    fn factorize_pivoted(
        &self,
        matrix: SparseColMatRef<'_, usize, f64>,
        factor: &mut PivotedFactor,
        shift: f64,
    ) -> Result<(), SpectralError> {
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
        Ok(())
    }
}
