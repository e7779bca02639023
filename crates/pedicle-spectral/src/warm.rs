//! What vectors from elsewhere are worth: a Rayleigh-Ritz step and a look at the residuals.
//!
//! ```text
//! YᵀY = I,   YᵀK Y S = S Θ,   z = Y s,   ‖K z - θ z‖ ≤ tolerance  →  locked
//! ```
//!
//! Y is n × p, the guess made orthonormal. Nothing is believed but the residual: a pair is locked
//! when it solves this very pencil, whatever was said of it. All others are but a direction for the
//! start block. Locked vectors are orthonormal, so that each of them accounts for one eigenvalue.

use faer::{Mat, MatRef};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::lanczos::symmetric_eigen;
use crate::lanes::{LANES, as_slice};
use crate::orthogonalize::orthonormalize;
use crate::panels::Panels;
use crate::pencil::Pencil;
use crate::{EigenOptions, SpectralError};

/// Vectors with less than this share of their mass in a block say nothing about it.
const NOTICED_MASS: f64 = 1e-6;

/// The guess in one connected block, looked through.
pub(crate) struct WarmStart {
    /// Orthonormal vectors that are eigenvectors, n × count, of K and not of the pencil.
    pub(crate) locked: Mat<f64>,
    /// Their eigenvalues, ascending.
    pub(crate) locked_values: Vec<f64>,
    /// Ritz vectors that are not (yet) eigenvectors, count × n.
    pub(crate) rest: Mat<f64>,
}

/// Where pairs are accepted.
pub(crate) struct LockRule {
    /// End of the wanted part of the spectrum.
    pub(crate) end: f64,
    /// Largest number of pairs.
    pub(crate) n_most: usize,
    /// Largest residual.
    pub(crate) residual: f64,
}

impl WarmStart {
    /// Looks through a guess (all rows × count) for the block that has the given rows.
    pub(crate) fn new(
        pencil: &Pencil,
        rows: &[usize],
        null_vector: Option<&[f64]>,
        guess: MatRef<'_, f64>,
        rule: &LockRule,
    ) -> Result<Self, SpectralError> {
        let n = pencil.n();
        let mut basis = Panels::new(n);
        if let Some(null_vector) = null_vector {
            basis.append_column(null_vector);
        }
        let n_null = basis.len();
        let noticed = noticed_columns(rows, guess);
        // No more than fit beside the Krylov space.
        let most = (n / 2).saturating_sub(n_null);
        let noticed = &noticed[..most.min(noticed.len())];
        let roots: Vec<f64> = pencil.mass.iter().map(|m| m.sqrt()).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(EigenOptions::default().seed);
        for group in noticed.chunks(LANES) {
            let mut block = Mat::<f64>::zeros(group.len(), n);
            for (lane, &column) in group.iter().enumerate() {
                let source = as_slice(guess, column);
                for (i, (&row, root)) in rows.iter().zip(&roots).enumerate() {
                    block[(lane, i)] = root * source[row];
                }
            }
            orthonormalize(&basis, 0, block.as_mut(), &mut rng);
            basis.append(block.as_ref());
        }
        rayleigh_ritz(pencil, &basis, n_null, rule)
    }

    /// The null vector and the locked vectors, as a basis to be orthogonal to.
    pub(crate) fn known(&self, null_vector: Option<&[f64]>) -> Panels {
        let n = self.locked.nrows();
        let mut known = Panels::new(n);
        if let Some(null_vector) = null_vector {
            known.append_column(null_vector);
        }
        known.append(self.locked.transpose().to_owned().as_ref());
        known
    }
}

/// Columns that are not nearly 0 in the block.
fn noticed_columns(rows: &[usize], guess: MatRef<'_, f64>) -> Vec<usize> {
    let is_noticed = |column: &usize| {
        let source = as_slice(guess, *column);
        let square = |x: &f64| x * x;
        let inside: f64 = rows.iter().map(|&row| square(&source[row])).sum();
        let whole: f64 = source.iter().map(square).sum();
        inside > NOTICED_MASS * whole && whole.is_finite()
    };
    (0..guess.ncols()).filter(is_noticed).collect()
}

/// Ritz pairs of the basis without its first columns, locked or not.
fn rayleigh_ritz(
    pencil: &Pencil,
    basis: &Panels,
    n_null: usize,
    rule: &LockRule,
) -> Result<WarmStart, SpectralError> {
    let (n, p) = (pencil.n(), basis.len() - n_null);
    if p == 0 {
        return Ok(WarmStart {
            locked: Mat::zeros(n, 0),
            locked_values: Vec::new(),
            rest: Mat::zeros(0, n),
        });
    }
    let mut projected = Mat::<f64>::zeros(p, p);
    for first in (0..p).step_by(LANES) {
        let count = LANES.min(p - first);
        let product = pencil.scaled_product(basis, n_null + first, count);
        let part = basis.products(n_null, product.as_ref());
        projected
            .as_mut()
            .subcols_mut(first, count)
            .copy_from(&part);
    }
    let symmetric = Mat::from_fn(p, p, |i, j| 0.5 * (projected[(i, j)] + projected[(j, i)]));
    let (values, rotation) = symmetric_eigen(symmetric.as_ref())?;
    let mut vectors = Mat::<f64>::zeros(n, p);
    basis.add_combinations(n_null, rotation.as_ref(), vectors.as_mut().transpose_mut());
    let mut columns = vectors.clone();
    pencil.unscale(columns.as_mut());
    let quality = pencil.quotients_and_residuals(columns.as_ref());
    let mut locked: Vec<usize> = (0..p)
        .filter(|&i| quality[i].0 < rule.end && quality[i].1 <= rule.residual)
        .collect();
    locked.truncate(rule.n_most);
    let rest: Vec<usize> = (0..p)
        .filter(|&i| values[i] < rule.end && locked.binary_search(&i).is_err())
        .collect();
    let pick = |chosen: &[usize]| Mat::from_fn(n, chosen.len(), |i, j| vectors[(i, chosen[j])]);
    Ok(WarmStart {
        locked_values: locked.iter().map(|&i| quality[i].0).collect(),
        locked: pick(&locked),
        rest: pick(&rest).transpose().to_owned(),
    })
}
