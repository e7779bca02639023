//! Several vectors side by side.
//!
//! Sparse loops spend their time on fetching indices and rows. Kept next to each other, eight
//! vectors share each fetch, and one row of them is one cache line.

use faer::{MatMut, MatRef};

/// Number of vectors where nothing else is said.
pub(crate) const LANES: usize = 8;

/// Copies up to N rows of a block (b × n) side by side, in the given order; missing ones are 0.
pub(crate) fn gather<const N: usize>(block: MatRef<'_, f64>, order: &[u32]) -> Vec<[f64; N]> {
    let all = order.iter().map(|&i| {
        let source = as_slice(block, i as usize);
        match source.try_into() {
            Ok(row) => row,
            Err(_) => std::array::from_fn(|lane| source.get(lane).copied().unwrap_or(0.0)),
        }
    });
    all.collect()
}

/// The way back.
pub(crate) fn scatter<const N: usize>(
    rows: &[[f64; N]],
    order: &[u32],
    mut block: MatMut<'_, f64>,
) {
    let count = block.nrows();
    for (row, &i) in rows.iter().zip(order) {
        as_slice_mut(block.as_mut(), i as usize).copy_from_slice(&row[..count]);
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

/// a + s b, by value: in memory the compiler would have to go entry by entry.
#[inline(always)]
pub(crate) fn plus_scaled<const N: usize>(a: [f64; N], s: f64, b: [f64; N]) -> [f64; N] {
    let mut sum = a;
    for lane in 0..N {
        sum[lane] += s * b[lane];
    }
    sum
}
