//! Block Lanczos with thick restarts for the smallest eigenpairs.
//!
//! ```text
//! A = K(σ)⁻¹,   A V = V T + Q R Eᵀ,   T s = θ s,   λ = σ + 1/θ
//! ‖K x - x/θ‖ = ‖R s_last‖ / θ²   for   x = V s + Q R s_last / θ
//! ```
//!
//! V is n × m orthonormal, T = VᵀAV symmetric, Q the next block, s_last the last block of s.
//!
//! The shift σ lies inside the wanted part of the spectrum: its two ends are then equally far from
//! σ, and the basis needs a third fewer columns than with a shift below the spectrum. A second
//! shift μ at the end of the wanted part is only for counting: inertia tells how many eigenvalues
//! are below it. A Ritz value with λ < μ can only exist for an eigenvalue with λ < μ (Cauchy's
//! interlacing theorem), so when there are as many as were counted, none is missing.
//!
//! Golub & Underwood 1977 (blocks); Grimes, Lewis & Simon 1994 (shifts and inertia); Wu & Simon
//! 2000 (thick restart); Ericsson & Ruhe 1980 (the step from V s to x).

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::orthogonalize::{fill_gaussian, orthonormalize, product};
use crate::panels::Panels;
use crate::parallel::{CHUNK_ROWS, chunks_mut, map};
use crate::triangular::TriangularFactor;
use crate::{EigenOptions, SpectralError};

/// Columns per wanted pair, and blocks besides, before convergence is looked at for the first time.
/// Measured on vertebrae, bodies and tori with 50 to 200 pairs: most are done then, the others one or
/// two blocks later.
const FIRST_CHECK: (usize, usize) = (2, 7);
/// Below this many rows per column a look costs more than a few blocks: the next one is put off.
const ROWS_OF_CHEAP_CHECK: usize = 8;

/// The wanted eigenvectors, in no particular order.
pub(crate) struct RitzVectors {
    /// n × count, of length 1 but for the last step.
    pub(crate) vectors: Mat<f64>,
    /// Number of Ritz values below μ, wanted or not.
    pub(crate) n_below: usize,
    /// Number of columns multiplied by K(σ)⁻¹.
    pub(crate) n_solves: usize,
    /// Number of restarts.
    pub(crate) n_restarts: usize,
}

/// What is looked for in one connected block.
pub(crate) struct LanczosProblem<'a> {
    /// The shift σ of the factorisation, positive and inside the wanted part of the spectrum.
    pub(crate) shift: f64,
    /// The end μ > σ of the part of the spectrum in which eigenvalues were counted.
    pub(crate) end: f64,
    /// Number of eigenvalues below μ, the known vectors not counted.
    pub(crate) n_below: usize,
    /// Number of eigenpairs that must converge, the smallest; the others must only be found.
    pub(crate) n_wanted: usize,
    /// Options of the caller.
    pub(crate) options: &'a EigenOptions,
}

/// Eigenpairs of the projected matrix.
struct Ritz {
    theta: Vec<f64>,
    vectors: Mat<f64>,
    /// R s_last, one column a pair.
    ends: Mat<f64>,
    /// ‖R s_last‖.
    coupling: Vec<f64>,
}

struct Lanczos<'a> {
    problem: &'a LanczosProblem<'a>,
    factor: &'a TriangularFactor,
    rng: ChaCha8Rng,
    /// Orthonormal columns: the known vectors and V.
    basis: Panels,
    /// The next block Q, b × n.
    next: Mat<f64>,
    /// T = VᵀAV, with room for as many columns as the basis may get.
    projected: Mat<f64>,
    /// R.
    next_coupling: Mat<f64>,
    n_known: usize,
    /// First column that A times the next block may fail to be orthogonal to.
    recent: usize,
    n_solves: usize,
}

/// Finds the smallest eigenpairs orthogonal to the known ones, which are orthonormal.
pub(crate) fn smallest_eigenvectors(
    factor: &TriangularFactor,
    known: Panels,
    problem: &LanczosProblem<'_>,
) -> Result<RitzVectors, SpectralError> {
    let b = problem.options.block_size;
    let n_known = known.len();
    let capacity = basis_capacity(factor.n(), n_known, problem);
    let mut lanczos = Lanczos::start(factor, known, capacity, problem);
    let mut n_restarts = 0;
    let patience = |m: usize| usize::from(factor.n() < ROWS_OF_CHEAP_CHECK * m);
    let mut next_check = n_known + FIRST_CHECK.0 * problem.n_wanted + FIRST_CHECK.1 * b;
    loop {
        lanczos.expand();
        let m = lanczos.basis.len();
        let is_full = m + b > capacity;
        if m < next_check && !is_full {
            continue;
        }
        let ritz = lanczos.ritz()?;
        let status = Status::of(&ritz, problem);
        if status.is_complete {
            return Ok(RitzVectors {
                vectors: lanczos.finish(&ritz, &status.below[..problem.n_wanted]),
                n_below: status.below.len(),
                n_solves: lanczos.n_solves,
                n_restarts,
            });
        }
        if is_full {
            if n_restarts == problem.options.max_restarts {
                return Err(status.not_converged(problem));
            }
            n_restarts += 1;
            // If all that is in reach has converged, something orthogonal to the whole Krylov
            // space is missing: only a new direction can find it.
            if status.n_converged == status.below.len() {
                lanczos.restart(&ritz, &status.below);
                lanczos.renew_next_block();
            } else {
                lanczos.restart(&ritz, &kept_on_restart(&ritz, &status.below, b));
            }
        }
        next_check = lanczos.basis.len() + b * (patience(m) + status.blocks_to_go(problem));
    }
}

/// Columns of the basis, the known vectors included.
fn basis_capacity(n: usize, n_known: usize, problem: &LanczosProblem<'_>) -> usize {
    let b = problem.options.block_size;
    let automatic = 3 * problem.n_below + 12 * b;
    let smallest = problem.n_below + 5 * b;
    let asked = problem.options.max_basis_size.unwrap_or(automatic);
    (n_known + asked.max(smallest)).min(n - b)
}

/// How far the iteration has come.
struct Status {
    /// Pairs with λ < μ, λ ascending.
    below: Vec<usize>,
    n_converged: usize,
    /// Relative to μ.
    worst_residual: f64,
    /// Of the wanted pairs, relative to μ.
    residuals: Vec<f64>,
    is_complete: bool,
}

impl Status {
    fn of(ritz: &Ritz, problem: &LanczosProblem<'_>) -> Self {
        let lambda = |theta: f64| problem.shift + 1.0 / theta;
        // θ between 0 and the first bound belongs to λ > μ. Below 0 it belongs to λ < σ; the second
        // bound, of λ far below 0, is for rounding.
        let first_above = 1.0 / (problem.end - problem.shift);
        let mut below: Vec<usize> = (0..ritz.theta.len())
            .filter(|&i| ritz.theta[i] > first_above || ritz.theta[i] * problem.shift < -1e-6)
            .collect();
        below.sort_by(|&i, &j| lambda(ritz.theta[i]).total_cmp(&lambda(ritz.theta[j])));
        let limit = problem.options.tolerance * problem.end;
        let is_converged = |i: usize| ritz.residual(i) <= limit;
        let wanted = &below[..problem.n_wanted.min(below.len())];
        let last = wanted
            .last()
            .map_or(f64::NEG_INFINITY, |&i| lambda(ritz.theta[i]));
        // A pair that has not converged may still move, but not further than its residual; it must
        // not get among the wanted ones.
        let stays_above = |i: usize| {
            let theta = ritz.theta[i];
            is_converged(i) || (theta > 0.0 && lambda(theta + ritz.coupling[i]) > last)
        };
        let residuals = wanted.iter().map(|&i| ritz.residual(i) / problem.end);
        let residuals: Vec<f64> = residuals.collect();
        Self {
            n_converged: below.iter().filter(|&&i| is_converged(i)).count(),
            worst_residual: residuals.iter().copied().fold(0.0, f64::max),
            is_complete: below.len() == problem.n_below
                && wanted.iter().all(|&i| is_converged(i))
                && below[wanted.len()..].iter().all(|&i| stays_above(i)),
            residuals,
            below,
        }
    }

    fn not_converged(self, problem: &LanczosProblem<'_>) -> SpectralError {
        SpectralError::NotConverged {
            n_converged: self.n_converged,
            requested: problem.n_below,
            shift: problem.end,
            worst_residual: self.worst_residual,
            residuals: self.residuals,
            first_row: 0,
        }
    }

    /// How many blocks to add before looking again; looking costs as much as a few blocks.
    fn blocks_to_go(&self, problem: &LanczosProblem<'_>) -> usize {
        if self.below.len() < problem.n_below {
            return 3;
        }
        // Near the end every block wins about one digit of the worst residual.
        let digits = (self.worst_residual / problem.options.tolerance).log10();
        digits.ceil().clamp(1.0, 6.0) as usize
    }
}

/// All pairs below μ and as many of the next ones above it as two blocks hold.
fn kept_on_restart(ritz: &Ritz, below: &[usize], block_size: usize) -> Vec<usize> {
    let mut kept = below.to_vec();
    kept.sort_unstable();
    let above = (0..ritz.theta.len()).filter(|i| ritz.theta[*i] > 0.0);
    let above: Vec<usize> = above.filter(|i| kept.binary_search(i).is_err()).collect();
    let first = above.len().saturating_sub(2 * block_size);
    kept.extend(&above[first..]);
    kept
}

impl Ritz {
    /// ‖K x - x/θ‖ of one pair after the final step.
    fn residual(&self, i: usize) -> f64 {
        self.coupling[i] / (self.theta[i] * self.theta[i])
    }
}

impl<'a> Lanczos<'a> {
    fn start(
        factor: &'a TriangularFactor,
        known: Panels,
        capacity: usize,
        problem: &'a LanczosProblem<'a>,
    ) -> Self {
        let b = problem.options.block_size;
        let room = capacity - known.len();
        let mut lanczos = Self {
            problem,
            factor,
            rng: ChaCha8Rng::seed_from_u64(problem.options.seed),
            next: Mat::zeros(b, factor.n()),
            projected: Mat::zeros(room, room),
            next_coupling: Mat::zeros(b, b),
            n_known: known.len(),
            basis: known,
            recent: 0,
            n_solves: 0,
        };
        lanczos.renew_next_block();
        lanczos
    }

    /// Replaces the next block by random columns orthogonal to the basis.
    ///
    /// They are multiplied by A first: rough columns would leave their rounding errors behind in
    /// the eigenvectors, where the stiffest rows of W make large residuals of them.
    fn renew_next_block(&mut self) {
        fill_gaussian(self.next.as_mut(), &mut self.rng);
        self.factor.solve_in_place(self.next.as_mut());
        self.n_solves += self.next.nrows();
        orthonormalize(&self.basis, 0, self.next.as_mut(), &mut self.rng);
    }

    /// Takes the next block into the basis and makes the one after it.
    fn expand(&mut self) {
        let (b, m) = (self.problem.options.block_size, self.basis.len());
        self.basis.append(self.next.as_ref());
        self.factor.solve_in_place(self.next.as_mut());
        self.n_solves += b;
        let projection =
            orthonormalize(&self.basis, self.recent, self.next.as_mut(), &mut self.rng);
        let (along, first) = (&projection.along, m - self.n_known);
        for j in 0..b {
            for i in self.n_known..m + b {
                let value = match i.checked_sub(m) {
                    Some(i) => 0.5 * (along[(m + i, j)] + along[(m + j, i)]),
                    None => along[(i, j)],
                };
                self.projected[(i - self.n_known, first + j)] = value;
                self.projected[(first + j, i - self.n_known)] = value;
            }
        }
        self.next_coupling = projection.inner;
        self.recent = m;
    }

    /// Eigenpairs of T, θ ascending.
    fn ritz(&self) -> Result<Ritz, SpectralError> {
        let b = self.problem.options.block_size;
        let n = self.basis.len() - self.n_known;
        let (theta, vectors) = symmetric_eigen(self.projected.as_ref().submatrix(0, 0, n, n))?;
        let ends = product(
            self.next_coupling.as_ref(),
            vectors.as_ref().subrows(n - b, b),
        );
        let coupling = (0..n).map(|i| ends.col(i).norm_l2()).collect();
        Ok(Ritz {
            theta,
            vectors,
            coupling,
            ends,
        })
    }

    /// Adds V s of some of the pairs to the result, count × n.
    fn add_ritz_vectors(&self, ritz: &Ritz, chosen: &[usize], result: MatMut<'_, f64>) {
        let n = ritz.theta.len();
        let s = Mat::from_fn(n, chosen.len(), |i, j| ritz.vectors[(i, chosen[j])]);
        self.basis
            .add_combinations(self.n_known, s.as_ref(), result);
    }

    /// Replaces V by some of its Ritz vectors; the next block stays.
    fn restart(&mut self, ritz: &Ritz, kept: &[usize]) {
        let mut vectors = Mat::zeros(kept.len(), self.basis.n_rows());
        self.add_ritz_vectors(ritz, kept, vectors.as_mut());
        self.basis.truncate(self.n_known);
        self.basis.append(vectors.as_ref());
        let n = kept.len();
        self.projected.as_mut().submatrix_mut(0, 0, n, n).fill(0.0);
        for (j, &pair) in kept.iter().enumerate() {
            self.projected[(j, j)] = ritz.theta[pair];
        }
        // A times the next block couples to every kept vector.
        self.recent = 0;
    }

    /// Eigenvectors x = V s + Q R s_last / θ, n × count.
    fn finish(&self, ritz: &Ritz, wanted: &[usize]) -> Mat<f64> {
        let b = self.problem.options.block_size;
        let mut vectors = Mat::zeros(self.basis.n_rows(), wanted.len());
        self.add_ritz_vectors(ritz, wanted, vectors.as_mut().transpose_mut());
        let ends = Mat::from_fn(b, wanted.len(), |i, j| {
            ritz.ends[(i, wanted[j])] / ritz.theta[wanted[j]]
        });
        map(chunks_mut(vectors.as_mut().transpose_mut()), |i, some| {
            let next = self.next.as_ref().subcols(i * CHUNK_ROWS, some.ncols());
            matmul(some, Accum::Add, ends.transpose(), next, 1.0, Par::Seq);
        });
        vectors
    }
}

/// Eigenvalues in ascending order and eigenvectors of a dense symmetric matrix, one thread.
pub(crate) fn symmetric_eigen(
    matrix: MatRef<'_, f64>,
) -> Result<(Vec<f64>, Mat<f64>), SpectralError> {
    let n = matrix.nrows();
    let mut values = Diag::<f64>::zeros(n);
    let mut vectors = Mat::<f64>::zeros(n, n);
    let scratch =
        self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| SpectralError::Dense {
        first_row: 0,
        n_rows: n,
    })?;
    self_adjoint_evd(
        matrix,
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    )
    .map_err(|_| SpectralError::Dense {
        first_row: 0,
        n_rows: n,
    })?;
    let values = values.column_vector().iter().copied().collect();
    Ok((values, vectors))
}
