//! Eight vectors side by side.
//!
//! Sparse loops spend their time on fetching indices and rows. Kept next to each other, eight
//! vectors share each fetch, and one row of them is one cache line.

use faer::{MatMut, MatRef};

/// Number of vectors.
pub(crate) const LANES: usize = 8;

/// One entry of eight vectors.
pub(crate) type Row = [f64; LANES];

/// Copies up to eight columns side by side in the given order of rows; missing columns are 0.
pub(crate) fn gather(columns: MatRef<'_, f64>, order: &[u32], rows: &mut [Row]) {
    if columns.ncols() < LANES {
        rows.fill([0.0; LANES]);
    }
    for lane in 0..columns.ncols() {
        let column = columns.col(lane);
        for (row, &i) in rows.iter_mut().zip(order) {
            row[lane] = column[i as usize];
        }
    }
}

/// The way back.
pub(crate) fn scatter(rows: &[Row], order: &[u32], mut columns: MatMut<'_, f64>) {
    for lane in 0..columns.ncols() {
        let mut column = columns.as_mut().col_mut(lane);
        for (row, &i) in rows.iter().zip(order) {
            column[i as usize] = row[lane];
        }
    }
}

/// a ← a + s b
#[inline(always)]
pub(crate) fn add_scaled(a: &mut Row, s: f64, b: &Row) {
    for lane in 0..LANES {
        a[lane] += s * b[lane];
    }
}
