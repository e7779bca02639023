//! A growing set of long columns V, stored 32 at a time by rows.
//!
//! ```text
//! U ← U - V VᵀU,   V S
//! ```
//!
//! V is n × m. A panel is the transpose of 32 columns, so that the entries of one row are side by
//! side: the matrix products read memory in one stream, blocks of rows fit the cache, and a panel
//! is only made when it is needed. A block U of b columns is a b × n matrix in the same way.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use crate::parallel::{CHUNK_ROWS, chunks, chunks_mut, map};

/// Columns of a panel.
const WIDTH: usize = 32;
/// Numbers of V that are worked on at a time: 4 MB.
const NUMBERS_IN_CACHE: usize = 1 << 19;

/// Columns in panels.
pub(crate) struct Panels {
    n_rows: usize,
    n_columns: usize,
    panels: Vec<Mat<f64>>,
}

/// The part of one panel that belongs to a range of columns.
struct Part<'a> {
    /// Its first column, counted from the start of the range.
    first: usize,
    /// Columns × rows.
    rows: MatRef<'a, f64>,
}

impl Panels {
    /// No columns yet, of `n_rows` rows.
    pub(crate) fn new(n_rows: usize) -> Self {
        Self {
            n_rows,
            n_columns: 0,
            panels: Vec::new(),
        }
    }

    /// Number of columns m.
    pub(crate) fn len(&self) -> usize {
        self.n_columns
    }

    /// Number of rows n.
    pub(crate) fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// The columns from `start` on, n × count.
    pub(crate) fn columns(&self, start: usize) -> Mat<f64> {
        let mut columns = Mat::<f64>::zeros(self.n_rows, self.n_columns - start);
        for part in self.parts(start) {
            let target = columns.as_mut().subcols_mut(part.first, part.rows.nrows());
            target.transpose_mut().copy_from(part.rows);
        }
        columns
    }

    /// Forgets all columns but the first ones.
    pub(crate) fn truncate(&mut self, n_columns: usize) {
        self.n_columns = n_columns.min(self.n_columns);
        self.panels.truncate(self.n_columns.div_ceil(WIDTH));
    }

    /// Appends the columns of a block (b × n).
    pub(crate) fn append(&mut self, block: MatRef<'_, f64>) {
        let mut done = 0;
        while done < block.nrows() {
            let used = self.n_columns % WIDTH;
            if used == 0 {
                self.panels.push(Mat::zeros(WIDTH, self.n_rows));
            }
            let count = (WIDTH - used).min(block.nrows() - done);
            if let Some(panel) = self.panels.last_mut() {
                let target = panel.as_mut().subrows_mut(used, count);
                copy(block.subrows(done, count), target);
            }
            done += count;
            self.n_columns += count;
        }
    }

    /// Appends one column.
    pub(crate) fn append_column(&mut self, column: &[f64]) {
        let row = Mat::from_fn(1, column.len(), |_, i| column[i]);
        self.append(row.as_ref());
    }

    fn parts(&self, start: usize) -> Vec<Part<'_>> {
        let mut parts = Vec::with_capacity(self.panels.len());
        let mut column = start;
        while column < self.n_columns {
            let used = column % WIDTH;
            let count = (WIDTH - used).min(self.n_columns - column);
            parts.push(Part {
                first: column - start,
                rows: self.panels[column / WIDTH].as_ref().subrows(used, count),
            });
            column += count;
        }
        parts
    }

    /// U ← U - V VᵀU with the columns of V from `start` on, for a block U (b × n).
    ///
    /// Returns VᵀU and, of the result, UᵀU. A few panels at a time, so that they are still in the
    /// cache when they are read for the second time.
    pub(crate) fn project_off(
        &self,
        start: usize,
        mut block: MatMut<'_, f64>,
    ) -> (Mat<f64>, Mat<f64>) {
        let b = block.nrows();
        let mut coefficients = Mat::<f64>::zeros(self.n_columns - start, b);
        let parts = self.parts(start);
        let panel_numbers = WIDTH * self.n_rows.max(1);
        let at_once = match NUMBERS_IN_CACHE / panel_numbers {
            // Not even one fits.
            0 if panel_numbers > 2 * NUMBERS_IN_CACHE => usize::MAX,
            count => count.max(1),
        };
        for group in parts.chunks(at_once.min(parts.len().max(1))) {
            self.multiply(group, block.as_ref(), coefficients.as_mut());
            subtract(group, coefficients.as_ref(), block.as_mut());
        }
        let gram = self.gram(block.as_ref());
        (coefficients, gram)
    }

    /// VᵀU for some of the panels.
    fn multiply(&self, group: &[Part<'_>], block: MatRef<'_, f64>, mut result: MatMut<'_, f64>) {
        let b = block.nrows();
        let first_column = group.first().map_or(0, |part| part.first);
        let m = group.iter().map(|part| part.rows.nrows()).sum();
        let partial = map(chunks(self.n_rows), |_, (first, count)| {
            let mut sums = Mat::<f64>::zeros(m, b);
            let some = block.subcols(first, count).transpose();
            for part in group {
                let row = part.first - first_column;
                let target = sums.as_mut().subrows_mut(row, part.rows.nrows());
                let rows = part.rows.subcols(first, count);
                matmul(target, Accum::Replace, rows, some, 1.0, Par::Seq);
            }
            sums
        });
        let mut target = result.as_mut().subrows_mut(first_column, m);
        target.copy_from(sum(partial, m, b));
    }

    /// UᵀU.
    fn gram(&self, block: MatRef<'_, f64>) -> Mat<f64> {
        let b = block.nrows();
        let partial = map(chunks(self.n_rows), |_, (first, count)| {
            let some = block.subcols(first, count);
            let mut gram = Mat::<f64>::zeros(b, b);
            let target = gram.as_mut();
            matmul(
                target,
                Accum::Replace,
                some,
                some.transpose(),
                1.0,
                Par::Seq,
            );
            gram
        });
        sum(partial, b, b)
    }

    /// V S with the columns of V from `start` on, added to the result (k × n).
    pub(crate) fn add_combinations(
        &self,
        start: usize,
        coefficients: MatRef<'_, f64>,
        result: MatMut<'_, f64>,
    ) {
        let parts = self.parts(start);
        map(chunks_mut(result), |i, mut some| {
            let (first, count) = (i * CHUNK_ROWS, some.ncols());
            for part in &parts {
                let c = coefficients.subrows(part.first, part.rows.nrows());
                let rows = part.rows.subcols(first, count);
                matmul(
                    some.as_mut(),
                    Accum::Add,
                    c.transpose(),
                    rows,
                    1.0,
                    Par::Seq,
                );
            }
        });
    }
}

/// U ← U - V C for some of the panels.
fn subtract(group: &[Part<'_>], coefficients: MatRef<'_, f64>, block: MatMut<'_, f64>) {
    map(chunks_mut(block), |i, mut some| {
        let (first, count) = (i * CHUNK_ROWS, some.ncols());
        for part in group {
            let c = coefficients.subrows(part.first, part.rows.nrows());
            let rows = part.rows.subcols(first, count);
            let target = some.as_mut();
            matmul(target, Accum::Add, c.transpose(), rows, -1.0, Par::Seq);
        }
    });
}

/// The partial results in their order.
fn sum(partial: Vec<Mat<f64>>, n_rows: usize, n_columns: usize) -> Mat<f64> {
    let mut partial = partial.into_iter();
    let first = partial.next();
    let mut sum = first.unwrap_or_else(|| Mat::zeros(n_rows, n_columns));
    for more in partial {
        sum += &more;
    }
    sum
}

/// Copies rows that are side by side in memory.
fn copy(source: MatRef<'_, f64>, mut target: MatMut<'_, f64>) {
    for i in 0..source.ncols() {
        let from = crate::lanes::as_slice(source, i);
        crate::lanes::as_slice_mut(target.as_mut(), i).copy_from_slice(from);
    }
}
