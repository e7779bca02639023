//! Block Lanczos with thick restarts and locking for the eigenpairs below a shift.
//!
//! ```text
//! A = K(μ)⁻¹,   A V = V T + Q R Eᵀ,   T s = θ s,   λ = μ + 1/θ
//! ‖K x - x/θ‖ = ‖R s_last‖ / θ²   for   x = V s + Q R s_last / θ
//! ```
//!
//! V is n × m orthonormal, T = VᵀAV symmetric, Q the next block, s_last the last block of s. The
//! eigenvalues below μ are exactly those with θ < 0, and inertia tells how many there are: the
//! iteration ends when it has that many, so none can be missed. μ lies just above the wanted part
//! of the spectrum, where both of its ends are well separated from the rest (θ > 0).
//!
//! Golub & Underwood 1977 (blocks); Grimes, Lewis & Simon 1994 (shifts and inertia); Wu & Simon
//! 2000 (thick restart); Ericsson & Ruhe 1980 (the step from V s to x).

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::factor::ShiftedFactor;
use crate::orthogonalize::{fill_gaussian, orthonormalize};
use crate::{EigenOptions, SpectralError};

/// Eigenvectors of K(μ) below 0, in no particular order.
pub(crate) struct RitzVectors {
    /// n × count, of unit length.
    pub(crate) vectors: Mat<f64>,
    /// Number of columns multiplied by K(μ)⁻¹.
    pub(crate) n_solves: usize,
    /// Number of restarts.
    pub(crate) n_restarts: usize,
}

/// What is looked for in one connected block.
pub(crate) struct LanczosProblem<'a> {
    /// The shift μ.
    pub(crate) shift: f64,
    /// Number of eigenpairs below the shift, the known vector not counted.
    pub(crate) n_wanted: usize,
    /// An eigenvector that is known exactly, of unit length.
    pub(crate) known: Option<&'a [f64]>,
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

struct Lanczos<'a, 'f> {
    problem: &'a LanczosProblem<'a>,
    factor: &'a mut ShiftedFactor<'f>,
    rng: ChaCha8Rng,
    /// Orthonormal columns: the known vector, the m - `n_known` of V, the next block Q.
    basis: Mat<f64>,
    /// T = VᵀAV, with unused rows and columns for the known vector.
    projected: Mat<f64>,
    /// R.
    next_coupling: Mat<f64>,
    n_known: usize,
    /// Columns before the next block.
    m: usize,
    /// First column that A times the next block may fail to be orthogonal to.
    recent: usize,
    n_solves: usize,
}

/// Finds all eigenpairs below the shift.
pub(crate) fn eigenvectors_below(
    factor: &mut ShiftedFactor<'_>,
    n: usize,
    problem: &LanczosProblem<'_>,
) -> Result<RitzVectors, SpectralError> {
    let b = problem.options.block_size;
    let tolerance = problem.options.tolerance;
    let capacity = basis_capacity(n, problem);
    let mut lanczos = Lanczos::start(factor, n, capacity, problem)?;
    let mut n_restarts = 0;
    let mut next_check = problem.n_wanted + problem.n_wanted / 4 + 3 * b;
    loop {
        lanczos.expand();
        let is_full = lanczos.m + b > capacity;
        if lanczos.m < next_check && !is_full {
            continue;
        }
        let ritz = lanczos.ritz()?;
        let wanted: Vec<usize> = (0..ritz.theta.len())
            .filter(|&i| is_below(ritz.theta[i], problem.shift))
            .collect();
        let residuals: Vec<f64> = wanted
            .iter()
            .map(|&i| ritz.residual(i) / problem.shift)
            .collect();
        let n_converged = residuals.iter().filter(|&&r| r <= tolerance).count();
        if n_converged == problem.n_wanted && wanted.len() == problem.n_wanted {
            return Ok(RitzVectors {
                vectors: lanczos.finish(&ritz, &wanted),
                n_solves: lanczos.n_solves,
                n_restarts,
            });
        }
        if is_full {
            if n_restarts == problem.options.max_restarts {
                return Err(SpectralError::NotConverged {
                    n_converged,
                    requested: problem.n_wanted,
                    shift: problem.shift,
                    worst_residual: residuals.iter().copied().fold(0.0, f64::max),
                });
            }
            n_restarts += 1;
            // If all that is in reach has converged, something orthogonal to the whole Krylov
            // space is missing: only a new direction can find it.
            if n_converged == wanted.len() {
                lanczos.restart(&ritz, &wanted);
                lanczos.renew_next_block();
            } else {
                lanczos.restart(&ritz, &kept_on_restart(&ritz, wanted.len(), b));
            }
        }
        next_check = lanczos.m + 2 * b;
    }
}

/// Columns of the basis, the known vector included.
fn basis_capacity(n: usize, problem: &LanczosProblem<'_>) -> usize {
    let b = problem.options.block_size;
    let n_known = usize::from(problem.known.is_some());
    let automatic = 2 * problem.n_wanted + 12 * b;
    let smallest = problem.n_wanted + 5 * b;
    let asked = problem.options.max_basis_size.unwrap_or(automatic);
    (n_known + asked.max(smallest)).min(n - b)
}

/// Whether a Ritz value belongs to an eigenvalue below the shift; the margin is for rounding.
fn is_below(theta: f64, shift: f64) -> bool {
    theta * shift < -1e-6
}

/// The wanted pairs, which come first, and as many of the largest θ > 0 as two blocks hold: they
/// are next to the shift and would only have to be found again.
fn kept_on_restart(ritz: &Ritz, n_wanted: usize, block_size: usize) -> Vec<usize> {
    let n = ritz.theta.len();
    let first_above = (n - (2 * block_size).min(n)).max(n_wanted);
    (0..n_wanted).chain(first_above..n).collect()
}

impl Ritz {
    /// ‖K x - x/θ‖ of one pair after the final step.
    fn residual(&self, i: usize) -> f64 {
        self.coupling[i] / (self.theta[i] * self.theta[i])
    }
}

impl<'a, 'f> Lanczos<'a, 'f> {
    fn start(
        factor: &'a mut ShiftedFactor<'f>,
        n: usize,
        capacity: usize,
        problem: &'a LanczosProblem<'a>,
    ) -> Result<Self, SpectralError> {
        let b = problem.options.block_size;
        factor.reserve(b)?;
        let n_known = usize::from(problem.known.is_some());
        let mut basis = Mat::<f64>::zeros(n, capacity + b);
        if let Some(known) = problem.known {
            for (i, &x) in known.iter().enumerate() {
                basis[(i, 0)] = x;
            }
        }
        let mut lanczos = Self {
            problem,
            factor,
            rng: ChaCha8Rng::seed_from_u64(problem.options.seed),
            basis,
            projected: Mat::zeros(capacity, capacity),
            next_coupling: Mat::zeros(b, b),
            n_known,
            m: n_known,
            recent: 0,
            n_solves: 0,
        };
        lanczos.renew_next_block();
        Ok(lanczos)
    }

    /// Replaces the next block by random columns orthogonal to the basis.
    fn renew_next_block(&mut self) {
        let b = self.problem.options.block_size;
        let (done, rest) = self.basis.as_mut().split_at_col_mut(self.m);
        let mut block = rest.subcols_mut(0, b);
        fill_gaussian(block.as_mut(), &mut self.rng);
        orthonormalize(done.as_ref(), 0, block, &mut self.rng);
    }

    /// Takes the next block into the basis and makes the one after it.
    fn expand(&mut self) {
        let (b, m) = (self.problem.options.block_size, self.m);
        let (done, rest) = self.basis.as_mut().split_at_col_mut(m + b);
        let done = done.as_ref();
        let mut block = rest.subcols_mut(0, b);
        block.copy_from(done.subcols(m, b));
        self.factor.solve_in_place(block.as_mut());
        self.n_solves += b;
        let projection = orthonormalize(done, self.recent, block, &mut self.rng);
        for j in 0..b {
            for i in 0..m + b {
                let value = match i.checked_sub(m) {
                    Some(i) => 0.5 * (projection.along[(m + i, j)] + projection.along[(m + j, i)]),
                    None => projection.along[(i, j)],
                };
                self.projected[(i, m + j)] = value;
                self.projected[(m + j, i)] = value;
            }
        }
        self.next_coupling = projection.inner;
        self.recent = m;
        self.m += b;
    }

    /// Eigenpairs of T, θ ascending.
    fn ritz(&self) -> Result<Ritz, SpectralError> {
        let (n_known, b) = (self.n_known, self.problem.options.block_size);
        let n = self.m - n_known;
        let projected = self.projected.as_ref().submatrix(n_known, n_known, n, n);
        let (theta, vectors) = symmetric_eigen(projected)?;
        let mut ends = Mat::<f64>::zeros(b, n);
        matmul(
            &mut ends,
            Accum::Replace,
            &self.next_coupling,
            vectors.as_ref().subrows(n - b, b),
            1.0,
            Par::Seq,
        );
        let coupling = (0..n).map(|i| ends.col(i).norm_l2()).collect();
        Ok(Ritz {
            theta,
            vectors,
            coupling,
            ends,
        })
    }

    /// V s for some of the pairs.
    fn ritz_vectors(&self, ritz: &Ritz, chosen: &[usize]) -> Mat<f64> {
        let n = ritz.theta.len();
        let s = Mat::from_fn(n, chosen.len(), |i, j| ritz.vectors[(i, chosen[j])]);
        let mut vectors = Mat::zeros(self.basis.nrows(), chosen.len());
        let active = self.basis.as_ref().subcols(self.n_known, n);
        matmul(&mut vectors, Accum::Replace, active, &s, 1.0, Par::Seq);
        vectors
    }

    /// Replaces V by some of its Ritz vectors; the next block stays.
    fn restart(&mut self, ritz: &Ritz, kept: &[usize]) {
        let b = self.problem.options.block_size;
        let vectors = self.ritz_vectors(ritz, kept);
        let next = self.basis.as_ref().subcols(self.m, b).to_owned();
        let m = self.n_known + kept.len();
        let mut basis = self.basis.as_mut();
        basis
            .as_mut()
            .subcols_mut(self.n_known, kept.len())
            .copy_from(&vectors);
        basis.subcols_mut(m, b).copy_from(&next);
        for j in self.n_known..m {
            for i in self.n_known..m {
                self.projected[(i, j)] = 0.0;
            }
            self.projected[(j, j)] = ritz.theta[kept[j - self.n_known]];
        }
        self.m = m;
        // A times the next block couples to every kept vector.
        self.recent = 0;
    }

    /// Eigenvectors x = V s + Q R s_last / θ of unit length.
    fn finish(&self, ritz: &Ritz, wanted: &[usize]) -> Mat<f64> {
        let b = self.problem.options.block_size;
        let mut vectors = self.ritz_vectors(ritz, wanted);
        let ends = Mat::from_fn(b, wanted.len(), |i, j| {
            ritz.ends[(i, wanted[j])] / ritz.theta[wanted[j]]
        });
        let next = self.basis.as_ref().subcols(self.m, b);
        matmul(&mut vectors, Accum::Add, next, &ends, 1.0, Par::Seq);
        for mut column in vectors.col_iter_mut() {
            let length = column.norm_l2();
            column /= length;
        }
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
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| SpectralError::Dense { n_rows: n })?;
    self_adjoint_evd(
        matrix,
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    )
    .map_err(|_| SpectralError::Dense { n_rows: n })?;
    let values = values.column_vector().iter().copied().collect();
    Ok((values, vectors))
}
