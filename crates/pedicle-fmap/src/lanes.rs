//! Eight rows side by side: distances to all of them in one pass over the coordinates.
//!
//! ```text
//! leaf l, coordinate j:   (r_8l(j), …, r_8l+7(j))           what is measured lies in one piece
//! batch b, coordinate j:  (r_32b(j), …, r_32b+31(j))        what is multiplied: four leaves
//! ```
//!
//! Σ (q_j - r_j)² is summed as it stands: unlike |q|² - 2 q·r + |r|² it loses no digits where rows
//! nearly coincide, and it is the same number wherever it is computed.

use faer::{MatMut, MatRef};

use crate::scalar::Scalar;

/// Rows in a leaf.
pub(crate) const LANES: usize = 8;
/// Rows in a batch, for products to be worth their while.
pub(crate) const ROWS_PER_BATCH: usize = 32;
/// Leaves in a batch.
pub(crate) const LEAVES_PER_BATCH: usize = ROWS_PER_BATCH / LANES;
/// Coordinates between two looks at whether the sums are enough; a multiple of `CHAINS`.
const CHECK_EVERY: usize = 16;
/// Sums that grow side by side.
const CHAINS: usize = 4;

/// One number of each of eight rows.
pub(crate) type Row<T> = [T; LANES];

/// Rows in blocks of some leaves, each a matrix of that many rows × dimension stored by columns.
///
/// Places beyond the last row hold the last row once more, if they hold anything.
#[derive(Debug, Clone)]
pub(crate) struct Lanes<T, const LEAVES: usize> {
    values: Vec<Row<T>>,
    n_rows: usize,
    dimension: usize,
}

/// Rows to be measured.
pub(crate) type Leaves<T> = Lanes<T, 1>;
/// Rows to be multiplied.
pub(crate) type Batches<T> = Lanes<T, LEAVES_PER_BATCH>;

impl<T: Scalar, const LEAVES: usize> Lanes<T, LEAVES> {
    pub(crate) fn zeros(n_rows: usize, dimension: usize) -> Self {
        let n_batches = n_rows.div_ceil(ROWS_PER_BATCH);
        Self {
            // Whole batches in any case.
            values: vec![[T::ZERO; LANES]; n_batches * LEAVES_PER_BATCH * dimension],
            n_rows,
            dimension,
        }
    }

    /// The rows of a matrix in an order, times a factor.
    pub(crate) fn from_rows(matrix: MatRef<'_, f64>, order: &[u32], factor: f64) -> Self {
        let mut lanes = Self::zeros(order.len(), matrix.ncols());
        let last = order.len().saturating_sub(1);
        for place in 0..lanes.n_batches() * ROWS_PER_BATCH {
            let row = order[place.min(last)] as usize;
            for j in 0..matrix.ncols() {
                lanes.set(place, j, T::of(factor * matrix[(row, j)]));
            }
        }
        lanes
    }

    /// Number of coordinates.
    pub(crate) fn dimension(&self) -> usize {
        self.dimension
    }

    pub(crate) fn n_rows(&self) -> usize {
        self.n_rows
    }

    fn n_batches(&self) -> usize {
        self.n_rows.div_ceil(ROWS_PER_BATCH)
    }

    /// Place of one coordinate of a leaf.
    fn place(&self, leaf: usize, coordinate: usize) -> usize {
        let column = leaf / LEAVES * self.dimension + coordinate;
        column * LEAVES + leaf % LEAVES
    }

    pub(crate) fn set(&mut self, row: usize, coordinate: usize, value: T) {
        let place = self.place(row / LANES, coordinate);
        self.values[place][row % LANES] = value;
    }

    pub(crate) fn get(&self, row: usize, coordinate: usize) -> T {
        self.values[self.place(row / LANES, coordinate)][row % LANES]
    }

    /// Takes the numbers of rows of the same size, times a factor.
    pub(crate) fn round(&mut self, exact: &Lanes<f64, LEAVES>, factor: f64) {
        use rayon::prelude::*;
        debug_assert_eq!(self.values.len(), exact.values.len(), "same size");
        let pairs = self.values.par_iter_mut().zip(&exact.values);
        pairs.with_min_len(1024).for_each(|(to, from)| {
            for (to, from) in to.iter_mut().zip(from) {
                *to = T::of(factor * from);
            }
        });
    }

    /// The first coordinates of the rows of a leaf.
    #[inline(always)]
    pub(crate) fn leaf(&self, leaf: usize, count: usize) -> impl Iterator<Item = &Row<T>> {
        let rows = &self.values[self.place(leaf, 0)..];
        rows.iter().step_by(LEAVES).take(count)
    }
}

impl<T: Scalar> Batches<T> {
    /// A batch, 32 × dimension.
    pub(crate) fn batch(&self, batch: usize) -> MatRef<'_, T> {
        let size = LEAVES_PER_BATCH * self.dimension;
        let values = self.values[batch * size..(batch + 1) * size].as_flattened();
        MatRef::from_column_major_slice(values, ROWS_PER_BATCH, self.dimension)
    }
}

impl<T: Scalar> Leaves<T> {
    /// Fills the first `count` coordinates batch by batch: the function is given the number of a
    /// batch and a 32 × count matrix to write to.
    pub(crate) fn fill_batches(
        &mut self,
        count: usize,
        batch_of: impl Fn(usize, MatMut<'_, T>) + Sync,
    ) {
        use rayon::prelude::*;
        let dimension = self.dimension;
        let batches = self.values.par_chunks_mut(LEAVES_PER_BATCH * dimension);
        let scratch = || vec![[T::ZERO; LANES]; LEAVES_PER_BATCH * count];
        batches
            .enumerate()
            .for_each_init(scratch, |scratch, (batch, leaves)| {
                let columns = scratch.as_flattened_mut();
                let columns = MatMut::from_column_major_slice_mut(columns, ROWS_PER_BATCH, count);
                batch_of(batch, columns);
                for (i, leaf) in leaves.chunks_mut(dimension).enumerate() {
                    let from = scratch[i..].iter().step_by(LEAVES_PER_BATCH);
                    for (to, from) in leaf.iter_mut().zip(from) {
                        *to = *from;
                    }
                }
            });
    }

    /// Squared distances of the rows of a leaf to a query over the query's coordinates.
    ///
    /// Once all are above `enough`, the sums so far are returned: lower bounds.
    #[inline(always)]
    pub(crate) fn squared_distances(&self, leaf: usize, query: &[T], enough: f64) -> Row<T> {
        let first = self.place(leaf, 0);
        let rows = &self.values[first..first + query.len()];
        // Four sums, so that one addition need not wait for the others.
        let mut sums = [[T::ZERO; LANES]; CHAINS];
        let rows = rows.chunks(CHECK_EVERY);
        for (rows, query) in rows.zip(query.chunks(CHECK_EVERY)) {
            let [mut a, mut b, mut c, mut d] = sums;
            let mut quads = query.chunks_exact(CHAINS);
            let mut place = 0;
            for q in &mut quads {
                let row = &rows[place..place + CHAINS];
                a = plus_squares(a, row[0], q[0]);
                b = plus_squares(b, row[1], q[1]);
                c = plus_squares(c, row[2], q[2]);
                d = plus_squares(d, row[3], q[3]);
                place += CHAINS;
            }
            for q in quads.remainder() {
                a = plus_squares(a, rows[place], *q);
                place += 1;
            }
            sums = [a, b, c, d];
            if smallest_of(&sum_of(&sums)).wide() > enough {
                break;
            }
        }
        sum_of(&sums)
    }
}

#[inline(always)]
fn sum_of<T: Scalar>(sums: &[Row<T>; CHAINS]) -> Row<T> {
    plus(plus(sums[0], sums[1]), plus(sums[2], sums[3]))
}

#[inline(always)]
fn plus<T: Scalar>(a: Row<T>, b: Row<T>) -> Row<T> {
    let mut sum = a;
    for lane in 0..LANES {
        sum[lane] += b[lane];
    }
    sum
}

/// sum + (row - q)², by value: in memory the compiler would have to go entry by entry.
#[inline(always)]
fn plus_squares<T: Scalar>(sum: Row<T>, row: Row<T>, q: T) -> Row<T> {
    let mut out = sum;
    for lane in 0..LANES {
        let difference = row[lane] - q;
        out[lane] = difference.fused(difference, out[lane]);
    }
    out
}

/// The smallest of eight.
#[inline(always)]
pub(crate) fn smallest_of<T: Scalar>(row: &Row<T>) -> T {
    let less = |a: T, b: T| if a < b { a } else { b };
    let mut half = [T::ZERO; LANES / 2];
    for lane in 0..LANES / 2 {
        half[lane] = less(row[lane], row[lane + LANES / 2]);
    }
    less(less(half[0], half[2]), less(half[1], half[3]))
}
