//! The eigenpairs of one connected block, dense or by Lanczos.

use faer::{ColRef, Mat, MatRef};

use crate::components::Component;
use crate::dense::all_eigenpairs;
use crate::factor::{Factorizer, elimination_order};
use crate::lanczos::{LanczosProblem, smallest_eigenvectors};
use crate::lanes::as_slice_mut;
use crate::orthogonalize::dot;
use crate::panels::Panels;
use crate::pencil::Pencil;
use crate::warm::{LockRule, Locked};
use crate::{EigenOptions, SpectralError};

/// Blocks up to this size are always solved densely: it takes less than a millisecond.
const DENSE_ROWS: usize = 120;
/// Where the shift of the iteration lies in the wanted part of the spectrum. Measured on generated
/// bodies and tori with 50 to 200 pairs: 0.6 to 0.68 need the fewest columns. The later ones are for
/// when an eigenvalue is hit.
const SHIFTS_INSIDE: [f64; 3] = [0.66, 0.62, 0.7];
/// The same in the counted part of the spectrum, where all of that must converge. Measured on five tori
/// with 20 to 200 pairs: 0.55 and 0.6 need the fewest columns, 0.66 a twenty-fifth more.
const SHIFTS_OF_ALL: [f64; 3] = [0.55, 0.53, 0.58];
/// How far above the last locked eigenvalue they are counted, relative to it.
const JUST_ABOVE: f64 = 1e-6;
/// Share of the eigenvalues below the last locked one that must be locked for the shift to lie
/// above it.
const NEARLY_ALL: f64 = 0.9;

/// One connected block, prepared for counting and solving.
pub(crate) struct Block {
    /// First row of the whole matrix, by which errors name the block.
    first_row: usize,
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
    /// Vectors from elsewhere, all rows of the matrix × count.
    pub(crate) guess: Option<MatRef<'a, f64>>,
    /// Options of the caller.
    pub(crate) options: &'a EigenOptions,
}

impl Part<'_> {
    /// The shift of an attempt.
    fn shift(&self, attempt: usize) -> f64 {
        if self.n_wanted == self.n_below {
            SHIFTS_OF_ALL[attempt] * self.end
        } else {
            SHIFTS_INSIDE[attempt] * self.wanted_end()
        }
    }

    /// Where the wanted pairs end by Weyl's law: they are a share of those below μ.
    fn wanted_end(&self) -> f64 {
        self.end * self.n_wanted as f64 / self.n_below as f64
    }
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
    pub(crate) n_locked: usize,
    pub(crate) n_solves: usize,
    pub(crate) n_restarts: usize,
}

impl Block {
    /// Analyses one block, of which about `n_pairs` eigenpairs will be wanted.
    pub(crate) fn new(component: Component, n_pairs: usize) -> Result<Self, SpectralError> {
        let first_row = component.rows[0];
        let block = if component.pencil.n() <= DENSE_ROWS || n_pairs >= component.pencil.n() / 3 {
            Self::dense(component.rows, component.pencil)
        } else {
            Self::sparse(component)
        };
        block.map_err(|error| error.in_block(first_row))
    }

    fn sparse(component: Component) -> Result<Self, SpectralError> {
        let order = elimination_order(&component.pencil)?;
        let pencil = component.pencil.reordered(&order);
        Ok(Self {
            first_row: component.rows[0],
            rows: order.iter().map(|&i| component.rows[i]).collect(),
            solver: Solver::Sparse(Box::new(Factorizer::new(&pencil)?)),
            null_vector: null_vector(&pencil),
            pencil,
        })
    }

    fn dense(rows: Vec<usize>, pencil: Pencil) -> Result<Self, SpectralError> {
        let (eigenvalues, vectors) = all_eigenpairs(&pencil)?;
        Ok(Self {
            first_row: rows[0],
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
            Solver::Sparse(factorizer) => factorizer
                .count_below(shift)
                .map_err(|error| error.in_block(self.first_row)),
        }
    }

    /// The wanted eigenpairs.
    pub(crate) fn solve(&self, part: &Part<'_>) -> Result<BlockPairs, SpectralError> {
        let solved = match &self.solver {
            Solver::Dense {
                eigenvalues,
                vectors,
            } => Ok(self.dense_part(eigenvalues, vectors, part)),
            Solver::Sparse(factorizer) => self.solve_sparse(factorizer, part),
        };
        solved.map_err(|error| error.in_block(self.first_row))
    }

    fn solve_sparse(
        &self,
        factorizer: &Factorizer,
        part: &Part<'_>,
    ) -> Result<BlockPairs, SpectralError> {
        let n_null = self.n_null(part);
        if part.n_below == n_null {
            let none = Mat::zeros(self.pencil.n(), n_null);
            return Ok(BlockPairs {
                n_found: n_null,
                ..self.finish(none, n_null)
            });
        }
        // So many eigenvalues can be below the shift when they are nearly all the same.
        if part.n_below + 8 * part.options.block_size >= self.pencil.n() {
            let (eigenvalues, vectors) = all_eigenpairs(&self.pencil)?;
            return Ok(self.dense_part(&eigenvalues, &vectors, part));
        }
        let accepted = 100.0 * part.options.tolerance * part.end + self.rounding();
        let is_good = |pairs: &BlockPairs| pairs.residuals.iter().all(|&r| r <= accepted);
        if let Some(guess) = part.guess {
            // Whatever goes wrong with a guess, there is still the way without it.
            if let Some(pairs) = self
                .continue_from(factorizer, part, guess)
                .ok()
                .filter(is_good)
            {
                return Ok(pairs);
            }
        }
        let mut result = self.iterate(factorizer, part, 0);
        for attempt in 1..SHIFTS_INSIDE.len() {
            // An eigenvalue right at the shift spoils the factorisation or the digits of the others.
            let stop = match &result {
                Ok(pairs) => is_good(pairs),
                Err(SpectralError::Factorization { .. }) => false,
                Err(_) => true,
            };
            if stop {
                break;
            }
            result = self.iterate(factorizer, part, attempt);
        }
        result
    }

    /// Number of null vectors that are written down.
    fn n_null(&self, part: &Part<'_>) -> usize {
        usize::from(self.null_vector.is_some()).min(part.n_below)
    }

    /// From a random block.
    fn iterate(
        &self,
        factorizer: &Factorizer,
        part: &Part<'_>,
        attempt: usize,
    ) -> Result<BlockPairs, SpectralError> {
        let n_null = self.n_null(part);
        let problem = LanczosProblem {
            shift: part.shift(attempt),
            end: part.end,
            n_below: part.n_below - n_null,
            n_wanted: part.n_wanted.saturating_sub(n_null),
            options: part.options,
        };
        let mut known = Panels::new(self.pencil.n());
        if let Some(null_vector) = &self.null_vector {
            known.append_column(null_vector);
        }
        let factor = factorizer.factorize(problem.shift)?;
        let found = smallest_eigenvectors(&factor, known, &problem)?;
        Ok(BlockPairs {
            n_found: n_null + found.n_below,
            n_solves: found.n_solves,
            n_restarts: found.n_restarts,
            ..self.finish(with_room(n_null, &[found.vectors.as_ref()]), n_null)
        })
    }

    /// From vectors some of which may be eigenvectors.
    fn continue_from(
        &self,
        factorizer: &Factorizer,
        part: &Part<'_>,
        guess: MatRef<'_, f64>,
    ) -> Result<BlockPairs, SpectralError> {
        let n_null = self.n_null(part);
        let n_unknown = part.n_below - n_null;
        let rule = LockRule {
            end: part.end,
            residual: 2.0 * part.options.tolerance * part.end + self.rounding() / 16.0,
            n_most: n_unknown,
        };
        let null_vector = self.null_vector.as_deref();
        let locked = Locked::new(&self.pencil, &self.rows, null_vector, guess, &rule);
        let n_locked = locked.values.len();
        let n_below = n_unknown - n_locked;
        let mut problem = LanczosProblem {
            shift: SHIFTS_INSIDE[0] * part.end,
            end: part.end,
            n_below,
            n_wanted: n_below,
            options: part.options,
        };
        if n_locked == 0 {
            return self.iterate(factorizer, part, 0);
        }
        let last = locked.values.iter().copied().fold(0.0, f64::max);
        let count = factorizer.count_below(last * (1.0 + JUST_ABOVE))?;
        // Nothing is missing below the last of them, or only little.
        if (n_null + n_locked) as f64 >= NEARLY_ALL * count as f64 {
            let is_short = part.wanted_end() <= last * (1.0 + JUST_ABOVE);
            let end = if is_short {
                part.end
            } else {
                part.wanted_end()
            };
            problem.shift = last + SHIFTS_INSIDE[0] * (end - last);
        }
        if count == n_null + n_locked {
            problem.n_wanted = part.n_wanted.saturating_sub(count).min(n_below);
        }
        if n_below == 0 {
            let columns = with_room(n_null, &[locked.vectors.as_ref()]);
            return Ok(BlockPairs {
                n_found: part.n_below,
                n_locked,
                ..self.finish(columns, n_null)
            });
        }
        let factor = factorizer.factorize(problem.shift)?;
        let found = smallest_eigenvectors(&factor, locked.known, &problem)?;
        let columns = with_room(n_null, &[locked.vectors.as_ref(), found.vectors.as_ref()]);
        Ok(BlockPairs {
            n_found: n_null + n_locked + found.n_below,
            n_locked,
            n_solves: found.n_solves,
            n_restarts: found.n_restarts,
            ..self.finish(columns, n_null)
        })
    }

    /// What rounding alone may leave as a residual.
    fn rounding(&self) -> f64 {
        let ratios = self.pencil.diagonal.iter().zip(&self.pencil.mass);
        let largest = ratios.map(|(w, m)| w.abs() / m).fold(0.0, f64::max);
        64.0 * f64::EPSILON * largest
    }

    fn dense_part(&self, eigenvalues: &[f64], vectors: &Mat<f64>, part: &Part<'_>) -> BlockPairs {
        // The dense solver has found the null vector as well, as its first.
        let n_null = usize::from(self.null_vector.is_some()).min(part.n_wanted);
        let others = vectors.subcols(n_null, part.n_wanted - n_null);
        BlockPairs {
            n_found: eigenvalues.iter().filter(|&&l| l < part.end).count(),
            ..self.finish(with_room(n_null, &[others]), n_null)
        }
    }

    /// Pairs of the columns x = M^(-1/2) y, of which the first are the null vectors, in ascending
    /// order.
    fn finish(&self, mut columns: Mat<f64>, n_null: usize) -> BlockPairs {
        for j in n_null..columns.ncols() {
            let column = as_slice_mut(columns.as_mut(), j);
            if let Some(null_vector) = &self.null_vector {
                project_off(column, null_vector);
            }
            normalize(column);
        }
        self.pencil.unscale(columns.as_mut());
        if n_null > 0 {
            // The scaled null vector is constant; written down so, it has exactly no energy.
            let total: f64 = self.pencil.mass.iter().sum();
            as_slice_mut(columns.as_mut(), 0).fill(1.0 / total.sqrt());
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
            n_locked: 0,
            n_solves: 0,
            n_restarts: 0,
        }
    }
}

/// The columns one after the other, behind room for the null vectors.
fn with_room(n_null: usize, groups: &[MatRef<'_, f64>]) -> Mat<f64> {
    let n = groups.first().map_or(0, |group| group.nrows());
    let count: usize = groups.iter().map(|group| group.ncols()).sum();
    let mut columns = Mat::<f64>::zeros(n, n_null + count);
    let mut first = n_null;
    for group in groups {
        let mut target = columns.as_mut().subcols_mut(first, group.ncols());
        target.copy_from(group);
        first += group.ncols();
    }
    columns
}

/// M^(1/2) 1 / √(Σ m) if constants are in the null space.
fn null_vector(pencil: &Pencil) -> Option<Vec<f64>> {
    if !pencil.annihilates_constants() {
        return None;
    }
    let total: f64 = pencil.mass.iter().sum();
    Some(pencil.mass.iter().map(|m| (m / total).sqrt()).collect())
}

/// Makes a vector orthogonal to a unit vector.
fn project_off(column: &mut [f64], unit: &[f64]) {
    let along = dot(ColRef::from_slice(column), ColRef::from_slice(unit));
    for (x, u) in column.iter_mut().zip(unit) {
        *x -= along * u;
    }
}

/// Makes a vector of length 1.
fn normalize(column: &mut [f64]) {
    let whole = ColRef::from_slice(column);
    let factor = 1.0 / dot(whole, whole).sqrt();
    for x in column {
        *x *= factor;
    }
}
