//! Smallest eigenpairs of W x = λ M x.
//!
//! ```text
//! W x_i = λ_i M x_i,   x_iᵀ M x_j = δ_ij,   λ_1 ≤ λ_2 ≤ … ≤ λ_k
//! ```
//!
//! W is n × n, sparse, symmetric and positive semidefinite, M diagonal and positive. The matrix is
//! split into its connected blocks; one shift μ with at least k eigenvalues below it is found by
//! counting them; each block gives all its eigenpairs below μ; the k smallest of them are kept.

use faer::{Mat, MatRef};
use sprs::CsMat;

use crate::block::{Block, BlockPairs, Part};
use crate::components::{check_pencil, connected_components};
use crate::lanes::{as_slice, as_slice_mut};
use crate::parallel::map;
use crate::shift::{aimed_count, find_shift};
use crate::{EigenOptions, LaplaceBasis, SpectralError};

/// Entries within this share of the largest one count as equally large when the sign is fixed.
const SIGN_TIE: f64 = 1e-6;

/// Eigenpairs with what is known of their quality.
#[derive(Debug, Clone)]
pub struct EigenPairs {
    /// Eigenvalues in ascending order (for a Laplacian in mm: 1/mm²).
    pub eigenvalues: Vec<f64>,
    /// Eigenvectors, one a column, n × k, M-orthonormal.
    ///
    /// Signs: among the entries within 1e-6 of the largest magnitude, the first is positive. So a
    /// simple eigenvector does not depend on seed, block size, unit or threads, and not on the order
    /// of the rows either unless entries so near to the largest differ in sign. Vectors of a
    /// repeated eigenvalue are some orthonormal basis of their space, each with its sign fixed in
    /// the same way; only the space is determined, and with eigenvalues that differ by a share δ
    /// the vectors only to about `tolerance` / δ.
    pub eigenvectors: Mat<f64>,
    /// ‖W x - λ M x‖ in the M⁻¹ norm, one a pair, in the unit of the eigenvalues.
    pub residuals: Vec<f64>,
    /// Number of leading eigenvalues that are exactly zero: connected blocks whose rows sum to 0.
    pub null_dimension: usize,
    /// The proof that no smaller eigenvalue is missing.
    pub certificate: Certificate,
    /// What it took.
    pub work: Work,
}

/// Proof by inertia that the pairs are the smallest ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    /// A shift μ above the last eigenvalue; infinite where all eigenvalues were computed.
    pub shift: f64,
    /// Number of eigenvalues below μ, from the signs of the pivots of W - μM.
    pub n_below: usize,
    /// Number of eigenvalues below μ that the solver has seen; the returned ones are the smallest.
    pub n_found: usize,
    /// Whether the two agree, so that nothing is missing.
    pub complete: bool,
}

/// What the computation took.
#[derive(Debug, Clone, PartialEq)]
pub struct Work {
    /// Number of connected blocks.
    pub n_components: usize,
    /// Number of shifts at which the eigenvalues were counted (one factorisation each).
    pub n_shifts: usize,
    /// Number of given vectors that solve the pencil and were kept, null vectors not counted.
    pub n_locked: usize,
    /// Number of vectors multiplied by the inverse, in all blocks.
    pub n_solves: usize,
    /// Number of restarts, in all blocks.
    pub n_restarts: usize,
}

/// The `n_pairs` smallest eigenpairs of W x = λ M x.
///
/// # Errors
/// [`SpectralError`] for matrices that are not square, finite, symmetric and of the same size,
/// masses that are not positive, more pairs than rows, options out of range, or no convergence.
///
/// ```
/// use pedicle_spectral::{EigenOptions, smallest_eigenpairs};
/// use sprs::TriMat;
///
/// // The path of three vertices has the eigenvalues 0, 1 and 3.
/// let mut path = TriMat::new((3, 3));
/// for (i, j, w) in [(0, 0, 1.0), (1, 1, 2.0), (2, 2, 1.0), (0, 1, -1.0), (1, 2, -1.0)] {
///     path.add_triplet(i, j, w);
///     if i != j {
///         path.add_triplet(j, i, w);
///     }
/// }
/// let pairs = smallest_eigenpairs(&path.to_csr(), &[1.0; 3], 2, &EigenOptions::default())?;
/// assert!((pairs.eigenvalues[1] - 1.0).abs() < 1e-14);
/// assert!(pairs.certificate.complete);
/// # Ok::<(), pedicle_spectral::SpectralError>(())
/// ```
pub fn smallest_eigenpairs(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_pairs: usize,
    options: &EigenOptions,
) -> Result<EigenPairs, SpectralError> {
    solve(stiffness, mass, n_pairs, None, options)
}

/// The `n_pairs` smallest eigenpairs of W x = λ M x, from vectors some of which are known.
///
/// `known` is n × any number: the vectors of an earlier run of which more are wanted, in any order
/// and of any length. Nothing is taken on trust: vectors that solve this pencil to the tolerance are
/// kept, all others are found anew, and the certificate covers the union. A wrong guess costs a few
/// products with W, but never changes the answer beyond the tolerance.
///
/// Vectors of nearly the same matrix (a shape bent a little) are such others. All that they save is
/// the search for the shift, which starts at the Rayleigh quotient of the last of them.
///
/// # Errors
/// Those of [`smallest_eigenpairs`]; [`SpectralError::KnownSizeDiffers`] and
/// [`SpectralError::KnownNotFinite`] for vectors that do not fit.
///
/// ```
/// use pedicle_spectral::{EigenOptions, smallest_eigenpairs, smallest_eigenpairs_from};
/// use sprs::TriMat;
///
/// let n = 400;
/// let mut path = TriMat::new((n, n));
/// for i in 1..n {
///     for (a, b, w) in [(i, i, 1.0), (i - 1, i - 1, 1.0), (i, i - 1, -1.0), (i - 1, i, -1.0)] {
///         path.add_triplet(a, b, w);
///     }
/// }
/// let (stiffness, mass) = (path.to_csr(), vec![1.0; n]);
/// let options = EigenOptions::default();
/// let ten = smallest_eigenpairs(&stiffness, &mass, 10, &options)?;
/// let known = ten.eigenvectors.as_ref();
/// let twenty = smallest_eigenpairs_from(&stiffness, &mass, 20, known, &options)?;
/// assert_eq!(twenty.work.n_locked, 9); // all but the constant, which needs no looking for
/// assert!(twenty.certificate.complete);
/// # Ok::<(), pedicle_spectral::SpectralError>(())
/// ```
pub fn smallest_eigenpairs_from(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_pairs: usize,
    known: MatRef<'_, f64>,
    options: &EigenOptions,
) -> Result<EigenPairs, SpectralError> {
    check_known(known, mass.len())?;
    // A transposed view has no contiguous columns.
    let owned = match known.try_as_col_major() {
        Some(_) => None,
        None => Some(known.to_owned()),
    };
    let known = owned.as_ref().map_or(known, Mat::as_ref);
    solve(stiffness, mass, n_pairs, Some(known), options)
}

fn check_known(known: MatRef<'_, f64>, n_rows: usize) -> Result<(), SpectralError> {
    if known.nrows() != n_rows {
        return Err(SpectralError::KnownSizeDiffers {
            n_known: known.nrows(),
            n_rows,
        });
    }
    for column in 0..known.ncols() {
        for (row, &value) in known.col(column).iter().enumerate() {
            if !value.is_finite() {
                return Err(SpectralError::KnownNotFinite { row, column, value });
            }
        }
    }
    Ok(())
}

fn solve(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_pairs: usize,
    known: Option<MatRef<'_, f64>>,
    options: &EigenOptions,
) -> Result<EigenPairs, SpectralError> {
    options.check()?;
    check_pencil(stiffness, mass)?;
    if n_pairs == 0 {
        return Err(SpectralError::NoPairs);
    }
    if n_pairs > mass.len() {
        return Err(SpectralError::TooManyPairs {
            requested: n_pairs,
            available: mass.len(),
        });
    }
    let total_mass: f64 = mass.iter().sum();
    let components = connected_components(stiffness, mass);
    let blocks = map(components, |_, component| {
        // By Weyl's law a block has as large a share of the eigenvalues as of the mass.
        let share = component.pencil.mass.iter().sum::<f64>() / total_mass;
        Block::new(component, (share * n_pairs as f64).ceil() as usize)
    });
    let blocks = blocks.into_iter().collect::<Result<Vec<_>, _>>()?;
    let mut work = Work {
        n_components: blocks.len(),
        n_shifts: 0,
        n_locked: 0,
        n_solves: 0,
        n_restarts: 0,
    };
    let (end, n_below, counts) = if blocks.iter().all(Block::is_dense) {
        let counts = blocks.iter().map(|b| b.pencil().n()).collect();
        (f64::INFINITY, mass.len(), counts)
    } else {
        let guess = known.and_then(|known| guessed_shift(stiffness, mass, n_pairs, known));
        let found = find_shift(&blocks, n_pairs, guess)?;
        work.n_shifts = found.n_tried;
        (found.shift, found.n_below, found.counts)
    };
    let tasks: Vec<_> = blocks.iter().zip(counts).collect();
    let parts = map(tasks, |_, (block, n_below)| {
        block.solve(&Part {
            end,
            n_below,
            // A single block has all the wanted pairs; of several nobody knows before the merge.
            n_wanted: if blocks.len() == 1 { n_pairs } else { n_below },
            guess: known,
            options,
        })
    });
    let parts = parts.into_iter().collect::<Result<Vec<_>, _>>()?;
    for part in &parts {
        work.n_locked += part.n_locked;
        work.n_solves += part.n_solves;
        work.n_restarts += part.n_restarts;
    }
    let n_found = parts.iter().map(|part| part.n_found).sum();
    let order = smallest_of_all(&parts, n_pairs);
    let null_blocks = blocks.iter().filter(|b| b.pencil().annihilates_constants());
    Ok(EigenPairs {
        eigenvalues: order
            .iter()
            .map(|&(p, c)| parts[p].eigenvalues[c])
            .collect(),
        eigenvectors: assemble(&parts, &order, mass.len()),
        residuals: order.iter().map(|&(p, c)| parts[p].residuals[c]).collect(),
        null_dimension: null_blocks.count().min(n_pairs),
        certificate: Certificate {
            shift: end,
            n_below,
            n_found,
            complete: n_below == n_found,
        },
        work,
    })
}

/// The smallest `n_functions` eigenfunctions as a basis.
///
/// # Errors
/// Those of [`smallest_eigenpairs`].
pub fn laplace_basis(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_functions: usize,
    options: &EigenOptions,
) -> Result<LaplaceBasis, SpectralError> {
    let pairs = smallest_eigenpairs(stiffness, mass, n_functions, options)?;
    Ok(as_basis(pairs, mass))
}

/// The smallest `n_functions` eigenfunctions, from a basis of the same shape with fewer of them.
///
/// # Errors
/// Those of [`smallest_eigenpairs_from`].
pub fn laplace_basis_from(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_functions: usize,
    known: &LaplaceBasis,
    options: &EigenOptions,
) -> Result<LaplaceBasis, SpectralError> {
    let known = known.eigenfunctions.as_ref();
    let pairs = smallest_eigenpairs_from(stiffness, mass, n_functions, known, options)?;
    Ok(as_basis(pairs, mass))
}

fn as_basis(pairs: EigenPairs, mass: &[f64]) -> LaplaceBasis {
    LaplaceBasis {
        eigenvalues: pairs.eigenvalues,
        eigenfunctions: pairs.eigenvectors,
        mass: mass.to_vec(),
        null_dimension: pairs.null_dimension,
    }
}

/// Where the wanted part of the spectrum should end, if the last vector is what it should be.
fn guessed_shift(
    stiffness: &CsMat<f64>,
    mass: &[f64],
    n_pairs: usize,
    known: MatRef<'_, f64>,
) -> Option<f64> {
    let x = as_slice(known, known.ncols().checked_sub(1)?);
    let energy: f64 = stiffness.iter().map(|(w, (i, j))| w * x[i] * x[j]).sum();
    let norm: f64 = x.iter().zip(mass).map(|(x, m)| m * x * x).sum();
    // By Weyl's law eigenvalues grow like their index.
    let guess = energy / norm * aimed_count(n_pairs) / known.ncols() as f64;
    (guess > 0.0 && guess.is_finite()).then_some(guess)
}

/// The smallest pairs of all blocks as (block, pair); equal ones in the order of the blocks.
fn smallest_of_all(parts: &[BlockPairs], n_pairs: usize) -> Vec<(usize, usize)> {
    let mut order = Vec::new();
    for (part, pairs) in parts.iter().enumerate() {
        order.extend((0..pairs.eigenvalues.len()).map(|pair| (part, pair)));
    }
    order.sort_by(|a, b| parts[a.0].eigenvalues[a.1].total_cmp(&parts[b.0].eigenvalues[b.1]));
    order.truncate(n_pairs);
    order
}

/// The chosen vectors, extended by zero to all rows.
fn assemble(parts: &[BlockPairs], order: &[(usize, usize)], n: usize) -> Mat<f64> {
    let mut vectors = Mat::zeros(n, order.len());
    for (j, &(part, pair)) in order.iter().enumerate() {
        let part = &parts[part];
        let target = as_slice_mut(vectors.as_mut(), j);
        let source = as_slice(part.columns.as_ref(), part.order[pair]);
        for (&row, &x) in part.rows.iter().zip(source) {
            target[row] = x;
        }
    }
    fix_signs(&mut vectors);
    vectors
}

/// Makes the first entry of nearly the largest magnitude positive in every column.
fn fix_signs(vectors: &mut Mat<f64>) {
    for j in 0..vectors.ncols() {
        let column = as_slice_mut(vectors.as_mut(), j);
        let largest = column.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let limit = (1.0 - SIGN_TIE) * largest;
        if column
            .iter()
            .find(|x| x.abs() >= limit)
            .is_some_and(|&x| x < 0.0)
        {
            for x in column {
                *x = -*x;
            }
        }
    }
}
