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

use crate::lanes::{LANES, as_slice, as_slice_mut};
use crate::narrow::{AddProducts, Row, SubtractCombinations};
use crate::parallel::{CHUNK_ROWS, chunks, chunks_mut, map};

/// Columns of a panel.
pub(crate) const WIDTH: usize = 32;
/// Numbers of V that are worked on at a time: 4 MB.
const NUMBERS_IN_CACHE: usize = 1 << 19;

/// Columns in panels.
pub(crate) struct Panels {
    n_rows: usize,
    n_columns: usize,
    /// One entry a row.
    panels: Vec<Vec<[f64; WIDTH]>>,
}

/// The part of one panel that belongs to a range of columns.
struct Part<'a> {
    /// Its first column, counted from the start of the range.
    first: usize,
    /// Columns × rows.
    rows: MatRef<'a, f64>,
    /// The whole panel, and the first of its columns that is meant.
    panel: (&'a [[f64; WIDTH]], usize),
}

impl Part<'_> {
    fn len(&self) -> usize {
        self.rows.nrows()
    }
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
            let target = columns.as_mut().subcols_mut(part.first, part.len());
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
                self.panels.push(vec![[0.0; WIDTH]; self.n_rows]);
            }
            let count = (WIDTH - used).min(block.nrows() - done);
            if let Some(panel) = self.panels.last_mut() {
                for (i, row) in panel.iter_mut().enumerate() {
                    let from = &as_slice(block, i)[done..done + count];
                    row[used..used + count].copy_from_slice(from);
                }
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
            let panel = &self.panels[column / WIDTH];
            let values = panel.as_flattened();
            let rows = MatRef::from_column_major_slice(values, WIDTH, self.n_rows);
            parts.push(Part {
                first: column - start,
                rows: rows.subrows(used, count),
                panel: (panel, used),
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
        let groups = parts.chunks(at_once.min(parts.len().max(1)));
        if b == LANES {
            let rows = 0..self.n_rows;
            let mut eight: Vec<Row> = rows.clone().map(|i| eight(block.as_ref(), i)).collect();
            for group in groups {
                multiply_eight(group, &eight, coefficients.as_mut());
                subtract_eight(group, coefficients.as_ref(), &mut eight);
            }
            for (i, row) in rows.zip(&eight) {
                as_slice_mut(block.as_mut(), i).copy_from_slice(row);
            }
        } else {
            for group in groups {
                self.multiply(group, block.as_ref(), coefficients.as_mut());
                subtract(group, coefficients.as_ref(), block.as_mut());
            }
        }
        let gram = self.gram(block.as_ref());
        (coefficients, gram)
    }

    /// VᵀU for some of the panels.
    fn multiply(&self, group: &[Part<'_>], block: MatRef<'_, f64>, mut result: MatMut<'_, f64>) {
        let b = block.nrows();
        let first_column = group.first().map_or(0, |part| part.first);
        let m = group.iter().map(|part| part.len()).sum();
        let partial = map(chunks(self.n_rows), |_, (first, count)| {
            let mut sums = Mat::<f64>::zeros(m, b);
            let some = block.subcols(first, count).transpose();
            for part in group {
                let row = part.first - first_column;
                let target = sums.as_mut().subrows_mut(row, part.len());
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
                let c = coefficients.subrows(part.first, part.len());
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
            let c = coefficients.subrows(part.first, part.len());
            let rows = part.rows.subcols(first, count);
            let target = some.as_mut();
            matmul(target, Accum::Add, c.transpose(), rows, -1.0, Par::Seq);
        }
    });
}

/// VᵀU for some of the panels and eight vectors.
fn multiply_eight(group: &[Part<'_>], block: &[Row], mut result: MatMut<'_, f64>) {
    let arch = pulp::Arch::new();
    let first_column = group.first().map_or(0, |part| part.first);
    let m = group.iter().map(Part::len).sum();
    let partial = map(chunks(block.len()), |_, (first, count)| {
        let rows = first..first + count;
        let mut sums = vec![[0.0; LANES]; m];
        for part in group {
            let begin = part.first - first_column;
            arch.dispatch(AddProducts {
                panel: &part.panel.0[rows.clone()],
                first_column: part.panel.1,
                block: &block[rows.clone()],
                sums: &mut sums[begin..begin + part.len()],
            });
        }
        Mat::from_fn(m, LANES, |i, j| sums[i][j])
    });
    let mut target = result.as_mut().subrows_mut(first_column, m);
    target.copy_from(sum(partial, m, LANES));
}

/// U ← U - V C for some of the panels and eight vectors.
fn subtract_eight(group: &[Part<'_>], coefficients: MatRef<'_, f64>, block: &mut [Row]) {
    let arch = pulp::Arch::new();
    let first_column = group.first().map_or(0, |part| part.first);
    let m: usize = group.iter().map(Part::len).sum();
    let coefficients: Vec<Row> = (first_column..first_column + m)
        .map(|i| std::array::from_fn(|j| coefficients[(i, j)]))
        .collect();
    let tasks: Vec<&mut [Row]> = block.chunks_mut(CHUNK_ROWS).collect();
    map(tasks, |i, block| {
        let rows = i * CHUNK_ROWS..i * CHUNK_ROWS + block.len();
        for part in group {
            let begin = part.first - first_column;
            arch.dispatch(SubtractCombinations {
                panel: &part.panel.0[rows.clone()],
                first_column: part.panel.1,
                coefficients: &coefficients[begin..begin + part.len()],
                block,
            });
        }
    });
}

/// Column `i` of a block of eight.
fn eight(block: MatRef<'_, f64>, i: usize) -> Row {
    let column = &as_slice(block, i)[..LANES];
    std::array::from_fn(|lane| column[lane])
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
