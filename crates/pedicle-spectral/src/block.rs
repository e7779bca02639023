//! The eigenpairs of one connected block, dense or by Lanczos.

use faer::{Mat, MatRef};

use crate::components::Component;
use crate::dense::all_eigenpairs;
use crate::factor::{Factorizer, ShiftedFactor, elimination_order};
use crate::lanczos::{LanczosProblem, eigenvectors_below};
use crate::pencil::Pencil;
use crate::{EigenOptions, SpectralError};

/// Blocks up to this size are always solved densely: it takes less than a millisecond.
const DENSE_ROWS: usize = 120;

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
    Sparse(Factorizer),
}

/// What counting found out about a block at one shift.
pub(crate) enum Count<'a> {
    Dense(usize),
    Sparse(ShiftedFactor<'a>),
}

impl Count<'_> {
    /// Number of eigenvalues below the shift.
    pub(crate) fn n_below(&self) -> usize {
        match self {
            Self::Dense(count) => *count,
            Self::Sparse(factor) => factor.n_below(),
        }
    }
}

/// Eigenpairs of one block, ascending, and how they were found.
pub(crate) struct BlockPairs {
    /// Rows of the whole matrix, in the order of the rows of `vectors`.
    pub(crate) rows: Vec<usize>,
    pub(crate) eigenvalues: Vec<f64>,
    pub(crate) residuals: Vec<f64>,
    /// M-orthonormal.
    pub(crate) vectors: Mat<f64>,
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
            solver: Solver::Sparse(Factorizer::new(&pencil)?),
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

    /// Counts the eigenvalues below a shift.
    pub(crate) fn count_below(&self, shift: f64) -> Result<Count<'_>, SpectralError> {
        Ok(match &self.solver {
            Solver::Dense { eigenvalues, .. } => {
                Count::Dense(eigenvalues.iter().filter(|&&l| l < shift).count())
            }
            Solver::Sparse(factorizer) => Count::Sparse(factorizer.factorize(shift)?),
        })
    }

    /// All eigenpairs below the shift that were counted.
    pub(crate) fn solve(
        &self,
        count: Count<'_>,
        shift: f64,
        options: &EigenOptions,
    ) -> Result<BlockPairs, SpectralError> {
        let n_below = count.n_below();
        let (vectors, n_solves, n_restarts) = match (&self.solver, count) {
            (Solver::Dense { vectors, .. }, _) => (vectors.subcols(0, n_below).to_owned(), 0, 0),
            (_, Count::Dense(_)) => (Mat::zeros(self.pencil.n(), 0), 0, 0),
            (Solver::Sparse(_), Count::Sparse(mut factor)) => {
                let problem = LanczosProblem {
                    shift,
                    n_wanted: n_below - usize::from(self.null_vector.is_some()).min(n_below),
                    known: self.null_vector.as_deref(),
                    options,
                };
                if problem.n_wanted == 0 {
                    (Mat::zeros(self.pencil.n(), 0), 0, 0)
                } else {
                    let found = eigenvectors_below(&mut factor, self.pencil.n(), &problem)?;
                    (found.vectors, found.n_solves, found.n_restarts)
                }
            }
        };
        let columns = self.scaled_columns(vectors.as_ref(), n_below);
        Ok(self.sorted_pairs(columns, n_solves, n_restarts))
    }

    /// Columns x = M^(-1/2) y, with the exact null vector in the place of the computed one.
    fn scaled_columns(&self, vectors: MatRef<'_, f64>, n_below: usize) -> Vec<Vec<f64>> {
        let scale: Vec<f64> = self.pencil.mass.iter().map(|m| 1.0 / m.sqrt()).collect();
        let mut columns = Vec::with_capacity(n_below);
        let mut first = 0;
        if let Some(null_vector) = &self.null_vector {
            columns.push(null_vector.clone());
            // The dense solver has found it as well, as its first.
            first = usize::from(self.is_dense()).min(vectors.ncols());
        }
        columns.extend((first..vectors.ncols()).map(|j| {
            let mut column: Vec<f64> = vectors.col(j).iter().copied().collect();
            if let Some(null_vector) = &self.null_vector {
                project_off(&mut column, null_vector);
            }
            column
        }));
        columns.truncate(n_below);
        for column in &mut columns {
            for (x, s) in column.iter_mut().zip(&scale) {
                *x *= s;
            }
        }
        columns
    }

    fn sorted_pairs(
        &self,
        columns: Vec<Vec<f64>>,
        n_solves: usize,
        n_restarts: usize,
    ) -> BlockPairs {
        let mut pairs: Vec<(f64, Vec<f64>)> = columns
            .into_iter()
            .map(|x| (self.pencil.rayleigh_quotient(&x), x))
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let residuals = pairs.iter().map(|(l, x)| self.pencil.residual(x, *l));
        BlockPairs {
            rows: self.rows.clone(),
            residuals: residuals.collect(),
            eigenvalues: pairs.iter().map(|p| p.0).collect(),
            vectors: Mat::from_fn(self.pencil.n(), pairs.len(), |i, j| pairs[j].1[i]),
            n_solves,
            n_restarts,
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
    let along: f64 = column.iter().zip(unit).map(|(x, u)| x * u).sum();
    let mut norm = 0.0;
    for (x, u) in column.iter_mut().zip(unit) {
        *x -= along * u;
        norm += *x * *x;
    }
    let factor = 1.0 / norm.sqrt();
    for x in column {
        *x *= factor;
    }
}
