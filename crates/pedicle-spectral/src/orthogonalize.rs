//! Orthonormal blocks of vectors.
//!
//! Columns are projected off a basis by matrix products and then off each other, twice: the
//! second time with columns of unit length, so that what is left is orthogonal to rounding
//! (Giraud, Langou, Rozložník 2005). A direction that vanishes is replaced by a random one, with
//! a zero coefficient, so a block never gets narrower.

use faer::linalg::matmul::matmul;
use faer::{Accum, ColRef, Mat, MatMut, MatRef, Par};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A column that loses more than this share of its length is projected again.
const LOSS_THAT_ASKS_FOR_ANOTHER_PASS: f64 = 0.5;
/// A column whose length falls below this share of the largest has vanished.
const VANISHED: f64 = 1e-14;
/// Number of passes after which random replacements would be a defect of this code.
const MAX_PASSES: usize = 6;

/// Scalar product of two columns.
pub(crate) fn dot(a: ColRef<'_, f64>, b: ColRef<'_, f64>) -> f64 {
    a.transpose() * b
}

/// Fills a column with independent standard normal numbers.
pub(crate) fn fill_gaussian(mut columns: MatMut<'_, f64>, rng: &mut ChaCha8Rng) {
    for j in 0..columns.ncols() {
        for i in 0..columns.nrows() {
            columns[(i, j)] = StandardNormal.sample(rng);
        }
    }
}

/// Coefficients of the block before it was orthonormalised: `block = basis · along + result · inner`.
pub(crate) struct Projection {
    /// Coefficients on the basis, basis columns × block columns.
    pub(crate) along: Mat<f64>,
    /// Upper triangular coefficients on the result, block columns × block columns.
    pub(crate) inner: Mat<f64>,
}

/// Makes the block orthonormal and orthogonal to the basis.
///
/// The first projection uses only the basis columns from `first_pass_start` on: the caller knows
/// the block to be nearly orthogonal to those before it.
pub(crate) fn orthonormalize(
    basis: MatRef<'_, f64>,
    first_pass_start: usize,
    mut block: MatMut<'_, f64>,
    rng: &mut ChaCha8Rng,
) -> Projection {
    let (m, b) = (basis.ncols(), block.ncols());
    let mut along = Mat::<f64>::zeros(m, b);
    let mut inner = Mat::<f64>::identity(b, b);
    let mut size = (0..b)
        .map(|j| dot(block.as_ref().col(j), block.as_ref().col(j)))
        .fold(0.0_f64, f64::max)
        .sqrt();
    let mut start = first_pass_start;
    for pass in 0..MAX_PASSES {
        let late = basis.subcols(start, m - start);
        let mut coefficients = Mat::<f64>::zeros(m - start, b);
        matmul(
            &mut coefficients,
            Accum::Replace,
            late.transpose(),
            block.as_ref(),
            1.0,
            Par::Seq,
        );
        matmul(
            block.as_mut(),
            Accum::Add,
            late,
            &coefficients,
            -1.0,
            Par::Seq,
        );
        let (triangle, kept) = orthonormalize_columns(block.as_mut(), VANISHED * size, rng);
        // along ← along + coefficients · inner,  inner ← triangle · inner
        matmul(
            along.as_mut().subrows_mut(start, m - start),
            Accum::Add,
            &coefficients,
            &inner,
            1.0,
            Par::Seq,
        );
        inner = product(triangle.as_ref(), inner.as_ref());
        size = 1.0;
        start = 0;
        if pass > 0 && kept > LOSS_THAT_ASKS_FOR_ANOTHER_PASS {
            break;
        }
    }
    Projection { along, inner }
}

fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    matmul(&mut c, Accum::Replace, a, b, 1.0, Par::Seq);
    c
}

/// One pass of Gram-Schmidt within the block.
///
/// Returns the triangular coefficients and the smallest share of its length that a column kept
/// (counted from length 1, which is what columns have from the second pass on); 0 if a column
/// vanished and was replaced.
fn orthonormalize_columns(
    mut block: MatMut<'_, f64>,
    vanished: f64,
    rng: &mut ChaCha8Rng,
) -> (Mat<f64>, f64) {
    let b = block.ncols();
    let mut triangle = Mat::<f64>::zeros(b, b);
    let mut kept = f64::INFINITY;
    for j in 0..b {
        let (done, rest) = block.as_mut().split_at_col_mut(j);
        let done = done.as_ref();
        let mut column = rest.subcols_mut(0, 1);
        if j > 0 {
            let mut c = Mat::<f64>::zeros(j, 1);
            matmul(
                &mut c,
                Accum::Replace,
                done.transpose(),
                column.as_ref(),
                1.0,
                Par::Seq,
            );
            matmul(column.as_mut(), Accum::Add, done, &c, -1.0, Par::Seq);
            for i in 0..j {
                triangle[(i, j)] = c[(i, 0)];
            }
        }
        let length = dot(column.as_ref().col(0), column.as_ref().col(0)).sqrt();
        if length <= vanished || !length.is_finite() {
            fill_gaussian(column.as_mut(), rng);
            let random_length = dot(column.as_ref().col(0), column.as_ref().col(0)).sqrt();
            scale(column, 1.0 / random_length);
            kept = 0.0;
            continue;
        }
        triangle[(j, j)] = length;
        kept = kept.min(length);
        scale(column, 1.0 / length);
    }
    (triangle, kept)
}

fn scale(mut column: MatMut<'_, f64>, factor: f64) {
    for i in 0..column.nrows() {
        column[(i, 0)] *= factor;
    }
}
