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
        let column = as_slice(columns, lane);
        for (row, &i) in rows.iter_mut().zip(order) {
            row[lane] = column[i as usize];
        }
    }
}

/// One column as a slice.
///
/// # Panics
/// If the columns are not contiguous; all matrices of this crate are stored by columns.
pub(crate) fn as_slice(columns: MatRef<'_, f64>, j: usize) -> &[f64] {
    let column = columns.col(j).try_as_col_major();
    column.expect("columns are contiguous").as_slice()
}

/// One column as a mutable slice.
///
/// # Panics
/// If the columns are not contiguous.
pub(crate) fn as_slice_mut(columns: MatMut<'_, f64>, j: usize) -> &mut [f64] {
    let column = columns.col_mut(j).try_as_col_major_mut();
    column.expect("columns are contiguous").as_slice_mut()
}

/// The way back.
pub(crate) fn scatter(rows: &[Row], order: &[u32], mut columns: MatMut<'_, f64>) {
    for lane in 0..columns.ncols() {
        let column = as_slice_mut(columns.as_mut(), lane);
        for (row, &i) in rows.iter().zip(order) {
            column[i as usize] = row[lane];
        }
    }
}

/// a + s b, by value: in memory the compiler would have to go entry by entry.
#[inline(always)]
pub(crate) fn plus_scaled(a: Row, s: f64, b: Row) -> Row {
    let mut sum = a;
    for lane in 0..LANES {
        sum[lane] += s * b[lane];
    }
    sum
}
