//! Work on fixed chunks of rows, on as many threads as the current pool has.
//!
//! The partition depends on the number of rows alone, and partial results are added in its order:
//! every bit of the result is the same for any number of threads.

use faer::MatMut;
use rayon::prelude::*;

/// Rows of a chunk: 32 columns of it are half a megabyte.
pub(crate) const CHUNK_ROWS: usize = 2048;

/// Start and length of every chunk of `n` rows.
pub(crate) fn chunks(n: usize) -> Vec<(usize, usize)> {
    let starts = (0..n).step_by(CHUNK_ROWS);
    starts.map(|s| (s, CHUNK_ROWS.min(n - s))).collect()
}

/// The chunks of a matrix that has one column per row of the basis.
pub(crate) fn chunks_mut(mut matrix: MatMut<'_, f64>) -> Vec<MatMut<'_, f64>> {
    let mut result = Vec::with_capacity(matrix.ncols().div_ceil(CHUNK_ROWS));
    while matrix.ncols() > CHUNK_ROWS {
        let (first, rest) = matrix.split_at_col_mut(CHUNK_ROWS);
        result.push(first);
        matrix = rest;
    }
    result.push(matrix);
    result
}

/// The results for all items, in their order.
pub(crate) fn map<T: Send, R: Send>(items: Vec<T>, work: impl Fn(usize, T) -> R + Sync) -> Vec<R> {
    let tasks = items.into_iter().enumerate();
    if tasks.len() > 1 && rayon::current_num_threads() > 1 {
        let tasks: Vec<_> = tasks.collect();
        return tasks.into_par_iter().map(|(i, t)| work(i, t)).collect();
    }
    tasks.map(|(i, t)| work(i, t)).collect()
}
