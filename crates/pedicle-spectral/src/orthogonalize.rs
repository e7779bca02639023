//! Orthonormal blocks of vectors.
//!
//! ```text
//! U ← U - V VᵀU,   UᵀU = RᵀR,   U ← U R⁻¹,   all of it twice
//! ```
//!
//! Everything is a matrix product, on fixed chunks of rows. The second pass starts from nearly orthonormal columns, so that
//! what is left is orthogonal to rounding (Giraud, Langou & Rozložník 2005; Yamamoto et al. 2015).
//! Where UᵀU is too near to singular for its Cholesky factor, that pass goes column by column, and
//! a direction that vanishes is replaced by a random one with a zero coefficient: a block never
//! gets narrower.

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, ColRef, Mat, MatMut, MatRef, Par};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::lanes::as_slice;
use crate::panels::Panels;
use crate::parallel::{chunks, chunks_mut, map};

/// A column that loses more than this share of its length is projected again.
const LOSS_THAT_ASKS_FOR_ANOTHER_PASS: f64 = 0.5;
/// A column whose length falls below this share of the largest has vanished.
const VANISHED: f64 = 1e-14;
/// Smallest pivot of UᵀU, relative to its diagonal, at which the Cholesky factor is used.
const SMALLEST_PIVOT: f64 = 1e-10;
/// Number of passes; two are enough unless a random column happens to need more.
const MAX_PASSES: usize = 6;

/// Scalar product of two columns.
pub(crate) fn dot(a: ColRef<'_, f64>, b: ColRef<'_, f64>) -> f64 {
    a.transpose() * b
}

/// Fills a block (b × n) with independent standard normal numbers, vector by vector.
pub(crate) fn fill_gaussian(mut block: MatMut<'_, f64>, rng: &mut ChaCha8Rng) {
    for j in 0..block.nrows() {
        for i in 0..block.ncols() {
            block[(j, i)] = StandardNormal.sample(rng);
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

/// Makes the block (b × n) orthonormal and orthogonal to the basis.
///
/// The first projection uses only the basis columns from `first_pass_start` on: the caller knows
/// the block to be nearly orthogonal to those before it.
pub(crate) fn orthonormalize(
    basis: &Panels,
    first_pass_start: usize,
    mut block: MatMut<'_, f64>,
    rng: &mut ChaCha8Rng,
) -> Projection {
    let (m, b) = (basis.len(), block.nrows());
    let mut along = Mat::<f64>::zeros(m, b);
    let mut inner = Mat::<f64>::identity(b, b);
    let mut vanished = VANISHED * largest_length(block.as_ref());
    let mut start = first_pass_start;
    for pass in 0..MAX_PASSES {
        // U ← U - V VᵀU
        let (coefficients, gram) = basis.project_off(start, block.as_mut());
        let (triangle, kept) = match cholesky(&gram, vanished) {
            Some((lower, kept)) => {
                // U ← U R⁻¹, or Uᵀ ← L⁻¹ Uᵀ.
                map(chunks_mut(block.as_mut()), |_, some| {
                    solve_lower_triangular_in_place(lower.as_ref(), some, Par::Seq);
                });
                (lower.transpose().to_owned(), kept)
            }
            None => {
                let mut columns = block.as_ref().transpose().to_owned();
                let done = orthonormalize_columns(columns.as_mut(), vanished, rng);
                block.copy_from(columns.transpose());
                done
            }
        };
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
        vanished = VANISHED;
        start = 0;
        if pass > 0 && kept > LOSS_THAT_ASKS_FOR_ANOTHER_PASS {
            break;
        }
    }
    Projection { along, inner }
}

/// The largest length of a vector of the block (b × n).
fn largest_length(block: MatRef<'_, f64>) -> f64 {
    let partial = map(chunks(block.ncols()), |_, (first, count)| {
        let mut squares = vec![0.0; block.nrows()];
        for i in first..first + count {
            for (sum, x) in squares.iter_mut().zip(as_slice(block, i)) {
                *sum += x * x;
            }
        }
        squares
    });
    let mut squares = vec![0.0; block.nrows()];
    for part in partial {
        for (sum, x) in squares.iter_mut().zip(part) {
            *sum += x;
        }
    }
    squares.into_iter().fold(0.0_f64, |m, s| m.max(s.sqrt()))
}

/// a · b on one thread.
pub(crate) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut c = Mat::zeros(a.nrows(), b.ncols());
    matmul(&mut c, Accum::Replace, a, b, 1.0, Par::Seq);
    c
}

/// L with L Lᵀ = UᵀU and its smallest diagonal entry; `None` if UᵀU is nearly singular,
/// or a column has vanished.
fn cholesky(gram: &Mat<f64>, vanished: f64) -> Option<(Mat<f64>, f64)> {
    let b = gram.nrows();
    let mut lower = Mat::<f64>::zeros(b, b);
    let mut kept = f64::INFINITY;
    for i in 0..b {
        for j in 0..=i {
            let done: f64 = (0..j).map(|l| lower[(i, l)] * lower[(j, l)]).sum();
            let rest = gram[(i, j)] - done;
            if i > j {
                lower[(i, j)] = rest / lower[(j, j)];
                continue;
            }
            // Asked this way round so that NaN is refused as well.
            let is_sound = rest > SMALLEST_PIVOT * gram[(i, i)] && rest.sqrt() > vanished;
            if !(is_sound && rest.is_finite()) {
                return None;
            }
            lower[(i, i)] = rest.sqrt();
            kept = kept.min(lower[(i, i)]);
        }
    }
    Some((lower, kept))
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
            fill_gaussian(column.as_mut().transpose_mut(), rng);
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
    for x in column.as_mut().col_mut(0).iter_mut() {
        *x *= factor;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    /// Largest entry of |AᵀB - expected|.
    fn worst(a: MatRef<'_, f64>, b: MatRef<'_, f64>, diagonal: f64) -> f64 {
        let gram = product(a.transpose(), b);
        let mut worst = 0.0_f64;
        for j in 0..gram.ncols() {
            for i in 0..gram.nrows() {
                let expected = if i == j { diagonal } else { 0.0 };
                worst = worst.max((gram[(i, j)] - expected).abs());
            }
        }
        worst
    }

    #[test]
    fn block_is_the_basis_and_the_result_times_the_coefficients() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (n, m, b) = (200, 12, 5);
        let mut basis = Mat::zeros(m, n);
        fill_gaussian(basis.as_mut(), &mut rng);
        orthonormalize(&Panels::new(n), 0, basis.as_mut(), &mut rng);
        let mut panels = Panels::new(n);
        panels.append(basis.as_ref());
        let basis = basis.transpose().to_owned();
        let mut rows = Mat::zeros(b, n);
        fill_gaussian(rows.as_mut(), &mut rng);
        let mut block = rows.transpose().to_owned();
        // The last column is a combination of the basis and the first column, and so vanishes; the
        // third is nearly the second.
        for i in 0..n {
            block[(i, 4)] = 2.0 * basis[(i, 3)] - block[(i, 0)];
            block[(i, 2)] = block[(i, 1)] + 1e-9 * block[(i, 2)];
        }
        let before = block.clone();
        rows.copy_from(block.transpose());
        let projection = orthonormalize(&panels, 0, rows.as_mut(), &mut rng);
        let block = rows.transpose().to_owned();
        let mut rebuilt = product(basis.as_ref(), projection.along.as_ref());
        let inner = projection.inner.as_ref();
        matmul(&mut rebuilt, Accum::Add, &block, inner, 1.0, Par::Seq);
        let difference = &rebuilt - &before;
        assert!(
            difference.norm_l2() < 1e-12,
            "block = basis · along + result · inner"
        );
        assert!(
            worst(block.as_ref(), block.as_ref(), 1.0) < 1e-14,
            "orthonormal"
        );
        assert!(
            worst(basis.as_ref(), block.as_ref(), 0.0) < 1e-14,
            "orthogonal to the basis"
        );
        assert!(
            projection.inner[(4, 4)].abs() < 1e-12,
            "the last column has vanished"
        );
    }
}
