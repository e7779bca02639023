//! What vectors from elsewhere are worth, told by their residuals.
//!
//! ```text
//! ‖K y - θ y‖ ≤ tolerance,   θ = yᵀK y,   YᵀY = I,   y orthogonal to the null vector
//! ```
//!
//! Nothing is believed but the residual: a vector is locked when, made orthogonal to all that were
//! locked before it, it still solves this very pencil. Locked vectors are orthonormal, so that each
//! of them accounts for one eigenvalue.
//!
//! Vectors that are merely near to eigenvectors are left alone. As a start block, random
//! combinations of them were measured to need an eighth more columns than random vectors do, because
//! they hold so little of what lies just outside the wanted part of the spectrum.

use faer::{Mat, MatRef};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::lanes::{LANES, as_slice, as_slice_mut};
use crate::orthogonalize::orthonormalize;
use crate::panels::Panels;
use crate::pencil::Pencil;

/// Vectors with less than this share of their squared length in a block say nothing about it.
const NOTICED: f64 = 1e-6;
/// How much larger the residual may be before vectors are made orthogonal to each other.
const FIRST_LOOK: f64 = 10.0;

/// Which vectors are locked.
pub(crate) struct LockRule {
    /// End of the wanted part of the spectrum.
    pub(crate) end: f64,
    /// Largest residual.
    pub(crate) residual: f64,
    /// Largest number of vectors.
    pub(crate) n_most: usize,
}

/// Vectors that are eigenvectors of one connected block.
pub(crate) struct Locked {
    /// Orthonormal: the null vector, if there is one, and the locked vectors.
    pub(crate) known: Panels,
    /// The locked vectors, n × count.
    pub(crate) vectors: Mat<f64>,
    /// Their eigenvalues.
    pub(crate) values: Vec<f64>,
}

impl Locked {
    /// Looks through a guess (all rows × count) for the block that has the given rows.
    pub(crate) fn new(
        pencil: &Pencil,
        rows: &[usize],
        null_vector: Option<&[f64]>,
        guess: MatRef<'_, f64>,
        rule: &LockRule,
    ) -> Self {
        let mut known = Panels::new(pencil.n());
        if let Some(null_vector) = null_vector {
            known.append_column(null_vector);
        }
        let n_null = known.len();
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut values = Vec::new();
        let noticed = noticed_columns(rows, guess);
        for group in noticed.chunks(LANES) {
            let mut block = restricted(pencil, rows, guess, group);
            let mut good = good_rows(pencil, block.as_ref(), FIRST_LOOK, rule);
            if let Some(null_vector) = null_vector {
                // The null vector itself is known already.
                good.retain(|&(lane, _)| !is_along(block.as_ref(), lane, null_vector));
            }
            if good.is_empty() {
                continue;
            }
            block = chosen_rows(block.as_ref(), &good);
            orthonormalize(&known, 0, block.as_mut(), &mut rng);
            let mut good = good_rows(pencil, block.as_ref(), 1.0, rule);
            good.truncate(rule.n_most - values.len());
            known.append(chosen_rows(block.as_ref(), &good).as_ref());
            values.extend(good.iter().map(|&(_, value)| value));
        }
        Self {
            vectors: known.columns(n_null),
            known,
            values,
        }
    }
}

/// Columns that are not nearly 0 in the block.
fn noticed_columns(rows: &[usize], guess: MatRef<'_, f64>) -> Vec<usize> {
    let is_noticed = |column: &usize| {
        let source = as_slice(guess, *column);
        let square = |x: &f64| x * x;
        let inside: f64 = rows.iter().map(|&row| square(&source[row])).sum();
        let whole: f64 = source.iter().map(square).sum();
        inside > NOTICED * whole && whole.is_finite()
    };
    (0..guess.ncols()).filter(is_noticed).collect()
}

/// y = M^(1/2) x of some columns in the rows of the block, of length 1, count × n.
fn restricted(
    pencil: &Pencil,
    rows: &[usize],
    guess: MatRef<'_, f64>,
    group: &[usize],
) -> Mat<f64> {
    let mut block = Mat::<f64>::zeros(group.len(), rows.len());
    for (lane, &column) in group.iter().enumerate() {
        let source = as_slice(guess, column);
        let entry = |(&row, m): (&usize, &f64)| m.sqrt() * source[row];
        let scaled: Vec<f64> = rows.iter().zip(&pencil.mass).map(entry).collect();
        let length = scaled.iter().map(|y| y * y).sum::<f64>().sqrt();
        for (i, y) in scaled.iter().enumerate() {
            as_slice_mut(block.as_mut(), i)[lane] = y / length;
        }
    }
    block
}

/// Rows of a block (count × n) that are eigenvectors below the end, with their eigenvalues.
fn good_rows(
    pencil: &Pencil,
    block: MatRef<'_, f64>,
    slack: f64,
    rule: &LockRule,
) -> Vec<(usize, f64)> {
    let mut columns = block.transpose().to_owned();
    pencil.unscale(columns.as_mut());
    let quality = pencil.quotients_and_residuals(columns.as_ref());
    let quality = quality.into_iter().enumerate();
    let good = quality.filter(|&(_, (value, residual))| {
        // NaN is no good.
        value < rule.end && residual <= slack * rule.residual
    });
    good.map(|(lane, (value, _))| (lane, value)).collect()
}

/// Whether most of a unit vector lies along another one.
fn is_along(block: MatRef<'_, f64>, lane: usize, unit: &[f64]) -> bool {
    let along: f64 = block.row(lane).iter().zip(unit).map(|(y, u)| y * u).sum();
    along * along > 0.5
}

fn chosen_rows(block: MatRef<'_, f64>, chosen: &[(usize, f64)]) -> Mat<f64> {
    let mut result = Mat::<f64>::zeros(chosen.len(), block.ncols());
    for i in 0..block.ncols() {
        let source = as_slice(block, i);
        let target = as_slice_mut(result.as_mut(), i);
        for (to, &(lane, _)) in target.iter_mut().zip(chosen) {
            *to = source[lane];
        }
    }
    result
}
