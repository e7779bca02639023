//! Eight rows side by side: distances to all of them in one pass over the coordinates.
//!
//! ```text
//! block b, coordinate j:  (r_8b(j), …, r_8b+7(j))          missing rows are infinitely far
//! ```
//!
//! Σ (q_j - r_j)² is summed as it stands: unlike |q|² - 2 q·r + |r|² it loses no digits where rows
//! nearly coincide, and it is the same number wherever it is computed.

/// Rows in a block.
pub(crate) const LANES: usize = 8;

/// Coordinates between two looks at whether the sums are enough; even.
const CHECK_EVERY: usize = 16;

/// One number of each of eight rows.
pub(crate) type Row = [f64; LANES];

/// Rows in blocks of eight.
#[derive(Debug, Clone)]
pub(crate) struct Lanes {
    blocks: Vec<Row>,
    n_rows: usize,
    dimension: usize,
}

impl Lanes {
    /// Rows at infinity.
    pub(crate) fn infinite(n_rows: usize, dimension: usize) -> Self {
        let blocks = vec![[f64::INFINITY; LANES]; n_rows.div_ceil(LANES) * dimension];
        Self {
            blocks,
            n_rows,
            dimension,
        }
    }

    pub(crate) fn n_rows(&self) -> usize {
        self.n_rows
    }

    pub(crate) fn dimension(&self) -> usize {
        self.dimension
    }

    pub(crate) fn set(&mut self, row: usize, coordinate: usize, value: f64) {
        self.blocks[row / LANES * self.dimension + coordinate][row % LANES] = value;
    }

    pub(crate) fn get(&self, row: usize, coordinate: usize) -> f64 {
        self.blocks[row / LANES * self.dimension + coordinate][row % LANES]
    }

    /// Squared distances of the rows of a block to a query over the query's coordinates.
    ///
    /// Once all are above `enough`, the sums so far are returned: lower bounds.
    #[inline(always)]
    pub(crate) fn squared_distances(&self, block: usize, query: &[f64], enough: f64) -> Row {
        let start = block * self.dimension;
        let rows = &self.blocks[start..start + query.len()];
        // Two sums, so that one addition need not wait for the other.
        let (mut even, mut odd) = ([0.0; LANES], [0.0; LANES]);
        for (rows, query) in rows.chunks(CHECK_EVERY).zip(query.chunks(CHECK_EVERY)) {
            for (row, q) in rows.chunks_exact(2).zip(query.chunks_exact(2)) {
                even = plus_squares(even, row[0], q[0]);
                odd = plus_squares(odd, row[1], q[1]);
            }
            if query.len() % 2 == 1 {
                even = plus_squares(even, rows[query.len() - 1], query[query.len() - 1]);
            }
            if smallest_of(&plus(even, odd)) > enough {
                break;
            }
        }
        plus(even, odd)
    }
}

#[inline(always)]
fn plus(a: Row, b: Row) -> Row {
    let mut sum = a;
    for lane in 0..LANES {
        sum[lane] += b[lane];
    }
    sum
}

/// The smallest of eight.
#[inline(always)]
pub(crate) fn smallest_of(row: &Row) -> f64 {
    let less = |a: f64, b: f64| if a < b { a } else { b };
    let mut half = [0.0; LANES / 2];
    for lane in 0..LANES / 2 {
        half[lane] = less(row[lane], row[lane + LANES / 2]);
    }
    less(less(half[0], half[2]), less(half[1], half[3]))
}

/// sum + (row - q)², by value: in memory the compiler would have to go entry by entry.
#[inline(always)]
fn plus_squares(sum: Row, row: Row, q: f64) -> Row {
    let mut out = sum;
    for lane in 0..LANES {
        let difference = row[lane] - q;
        out[lane] = difference.mul_add(difference, out[lane]);
    }
    out
}

/// Σ (a_i - b_i)².
#[inline(always)]
pub(crate) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest = a_chunks.remainder().iter().zip(b_chunks.remainder());
    let rest: f64 = rest.map(|(x, y)| (x - y) * (x - y)).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for lane in 0..LANES {
            let difference = x[lane] - y[lane];
            lanes[lane] = difference.mul_add(difference, lanes[lane]);
        }
    }
    lanes.iter().sum::<f64>() + rest
}
