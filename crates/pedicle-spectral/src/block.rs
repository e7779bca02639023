//! The eigenpairs of one connected block, dense or by Lanczos.

use faer::{ColRef, Mat, MatRef};

use crate::components::Component;
use crate::dense::all_eigenpairs;
use crate::factor::{Factorizer, elimination_order};
use crate::lanczos::{LanczosProblem, smallest_eigenvectors};
use crate::lanes::{as_slice, as_slice_mut};
use crate::orthogonalize::dot;
use crate::pencil::Pencil;
use crate::{EigenOptions, SpectralError};

/// Blocks up to this size are always solved densely: it takes less than a millisecond.
const DENSE_ROWS: usize = 120;
/// Where the shift of the iteration lies in the wanted part of the spectrum. Measured on a uniform
/// spectrum: 0.5 to 0.7 need the fewest columns. The later ones are for when an eigenvalue is hit.
const SHIFTS_INSIDE: [f64; 3] = [0.55, 0.53, 0.58];

/// One connected block, prepared for counting and solving.
pub(crate) struct Block {
    rows: Vec<usize>,
    pencil: Pencil,
    /// M^(1/2) 1, of unit length, where it is in the null space.
    null_vector: Option<Vec<f64>>,
    solver: Solver,
}

enum Solver {
    Dense {
        eigenvalues: Vec<f64>,
        vectors: Mat<f64>,
    },
    Sparse(Box<Factorizer>),
}

/// The part of the spectrum of a block that is wanted.
pub(crate) struct Part<'a> {
    /// Its end μ.
    pub(crate) end: f64,
    /// Number of eigenvalues below μ.
    pub(crate) n_below: usize,
    /// Number of them that are wanted, the smallest.
    pub(crate) n_wanted: usize,
    /// Options of the caller.
    pub(crate) options: &'a EigenOptions,
}

/// Eigenpairs of one block, ascending, and how they were found.
pub(crate) struct BlockPairs {
    /// Rows of the whole matrix, in the order of the rows of `columns`.
    pub(crate) rows: Vec<usize>,
    pub(crate) eigenvalues: Vec<f64>,
    pub(crate) residuals: Vec<f64>,
    /// M-orthonormal columns.
    pub(crate) columns: Mat<f64>,
    /// The column of every pair.
    pub(crate) order: Vec<usize>,
    /// Number of eigenvalues below the end of the part that were seen.
    pub(crate) n_found: usize,
    pub(crate) n_solves: usize,
    pub(crate) n_restarts: usize,
}

impl Block {
    /// Analyses one block, of which about `n_pairs` eigenpairs will be wanted.
    pub(crate) fn new(component: Component, n_pairs: usize) -> Result<Self, SpectralError> {
        let n = component.pencil.n();
        if n <= DENSE_ROWS || n_pairs >= n / 3 {
            return Self::dense(component.rows, component.pencil);
        }
        let order = elimination_order(&component.pencil)?;
        let pencil = component.pencil.reordered(&order);
        Ok(Self {
            rows: order.iter().map(|&i| component.rows[i]).collect(),
            solver: Solver::Sparse(Box::new(Factorizer::new(&pencil)?)),
            null_vector: null_vector(&pencil),
            pencil,
        })
    }

    fn dense(rows: Vec<usize>, pencil: Pencil) -> Result<Self, SpectralError> {
        let (eigenvalues, vectors) = all_eigenpairs(&pencil)?;
        Ok(Self {
            rows,
            solver: Solver::Dense {
                eigenvalues,
                vectors,
            },
            null_vector: null_vector(&pencil),
            pencil,
        })
    }

    /// The pencil of the block.
    pub(crate) fn pencil(&self) -> &Pencil {
        &self.pencil
    }

    /// Whether all eigenpairs are known already.
    pub(crate) fn is_dense(&self) -> bool {
        matches!(self.solver, Solver::Dense { .. })
    }

    /// Number of eigenvalues below a shift.
    pub(crate) fn count_below(&self, shift: f64) -> Result<usize, SpectralError> {
        match &self.solver {
            Solver::Dense { eigenvalues, .. } => {
                Ok(eigenvalues.iter().filter(|&&l| l < shift).count())
            }
            Solver::Sparse(factorizer) => factorizer.count_below(shift),
        }
    }

    /// The wanted eigenpairs.
    pub(crate) fn solve(&self, part: &Part<'_>) -> Result<BlockPairs, SpectralError> {
        let n_known = usize::from(self.null_vector.is_some()).min(part.n_below);
        let factorizer = match &self.solver {
            Solver::Dense {
                eigenvalues,
                vectors,
            } => return Ok(self.dense_part(eigenvalues, vectors, part)),
            Solver::Sparse(factorizer) => factorizer,
        };
        if part.n_below == n_known {
            let none = Mat::zeros(self.pencil.n(), 0);
            return Ok(BlockPairs {
                n_found: n_known,
                ..self.finish(none.as_ref(), n_known)
            });
        }
        // So many eigenvalues can be below the shift when they are nearly all the same.
        if part.n_below + 8 * part.options.block_size >= self.pencil.n() {
            let (eigenvalues, vectors) = all_eigenpairs(&self.pencil)?;
            return Ok(self.dense_part(&eigenvalues, &vectors, part));
        }
        let accepted = 100.0 * part.options.tolerance * part.end + self.rounding();
        let mut result = self.iterate(factorizer, part, SHIFTS_INSIDE[0]);
        for &share in &SHIFTS_INSIDE[1..] {
            // An eigenvalue right at the shift spoils the factorisation or the digits of the others.
            let is_good = match &result {
                Ok(pairs) => pairs.residuals.iter().all(|&r| r <= accepted),
                Err(SpectralError::Factorization { .. }) => false,
                Err(_) => true,
            };
            if is_good {
                break;
            }
            result = self.iterate(factorizer, part, share);
        }
        result
    }

    fn iterate(
        &self,
        factorizer: &Factorizer,
        part: &Part<'_>,
        share: f64,
    ) -> Result<BlockPairs, SpectralError> {
        let n_known = usize::from(self.null_vector.is_some()).min(part.n_below);
        let problem = LanczosProblem {
            shift: share * part.end,
            end: part.end,
            n_below: part.n_below - n_known,
            n_wanted: part.n_wanted.saturating_sub(n_known),
            known: self.null_vector.as_deref(),
            options: part.options,
        };
        let mut factor = factorizer.factorize(problem.shift)?;
        let found = smallest_eigenvectors(&mut factor, self.pencil.n(), &problem)?;
        Ok(BlockPairs {
            n_found: n_known + found.n_below,
            n_solves: found.n_solves,
            n_restarts: found.n_restarts,
            ..self.finish(found.vectors.as_ref(), n_known)
        })
    }

    /// What rounding alone may leave as a residual.
    fn rounding(&self) -> f64 {
        let ratios = self.pencil.diagonal.iter().zip(&self.pencil.mass);
        let largest = ratios.map(|(w, m)| w.abs() / m).fold(0.0, f64::max);
        64.0 * f64::EPSILON * largest
    }

    fn dense_part(&self, eigenvalues: &[f64], vectors: &Mat<f64>, part: &Part<'_>) -> BlockPairs {
        // The dense solver has found the known vector as well, as its first.
        let n_known = usize::from(self.null_vector.is_some()).min(part.n_wanted);
        let others = vectors.subcols(n_known, part.n_wanted - n_known);
        BlockPairs {
            n_found: eigenvalues.iter().filter(|&&l| l < part.end).count(),
            ..self.finish(others, n_known)
        }
    }

    /// Pairs of the columns x = M^(-1/2) y and the exact null vector, in ascending order.
    fn finish(&self, vectors: MatRef<'_, f64>, n_known: usize) -> BlockPairs {
        let n = self.pencil.n();
        let scale: Vec<f64> = self.pencil.mass.iter().map(|m| 1.0 / m.sqrt()).collect();
        let mut columns = Mat::<f64>::zeros(n, n_known + vectors.ncols());
        if n_known > 0 {
            // The scaled null vector is constant; written down so, it has exactly no energy.
            let total: f64 = self.pencil.mass.iter().sum();
            as_slice_mut(columns.as_mut(), 0).fill(1.0 / total.sqrt());
        }
        for found in 0..vectors.ncols() {
            let column = as_slice_mut(columns.as_mut(), n_known + found);
            column.copy_from_slice(as_slice(vectors, found));
            if let Some(null_vector) = &self.null_vector {
                project_off(column, null_vector);
            }
            for (x, s) in column.iter_mut().zip(&scale) {
                *x *= s;
            }
        }
        let quality = self.pencil.quotients_and_residuals(columns.as_ref());
        let mut order: Vec<usize> = (0..columns.ncols()).collect();
        order.sort_by(|&a, &b| quality[a].0.total_cmp(&quality[b].0));
        BlockPairs {
            rows: self.rows.clone(),
            eigenvalues: order.iter().map(|&j| quality[j].0).collect(),
            residuals: order.iter().map(|&j| quality[j].1).collect(),
            order,
            columns,
            n_found: 0,
            n_solves: 0,
            n_restarts: 0,
        }
    }
}

/// M^(1/2) 1 / √(Σ m) if constants are in the null space.
fn null_vector(pencil: &Pencil) -> Option<Vec<f64>> {
    if !pencil.annihilates_constants() {
        return None;
    }
    let total: f64 = pencil.mass.iter().sum();
    Some(pencil.mass.iter().map(|m| (m / total).sqrt()).collect())
}

/// Makes a unit vector orthogonal to another, and of unit length again.
fn project_off(column: &mut [f64], unit: &[f64]) {
    let along = dot(ColRef::from_slice(column), ColRef::from_slice(unit));
    for (x, u) in column.iter_mut().zip(unit) {
        *x -= along * u;
    }
    let whole = ColRef::from_slice(column);
    let factor = 1.0 / dot(whole, whole).sqrt();
    for x in column {
        *x *= factor;
    }
}
