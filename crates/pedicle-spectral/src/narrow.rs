//! Products of a panel with a block of eight vectors.
//!
//! ```text
//! sums ← sums + V U,   U ← U - Cᵀ V        V: columns × rows,  U: 8 × rows,  C: columns × 8
//! ```
//!
//! A general product packs both factors first, which costs as much as a product with only eight
//! columns. Here the sums stay in registers, and a few rows of a panel stay in the nearest cache
//! while all of its columns are worked on. Every sum is formed in the order of the rows, whatever
//! the processor.

use crate::lanes::LANES;
use crate::panels::WIDTH;

/// One number of each vector of a block.
pub(crate) type Row = [f64; LANES];

/// Sums that are formed side by side: with eight vectors each, all that the registers hold.
const TILE: usize = 4;
/// Rows of a panel that fit the nearest cache: 16 kB.
const ROWS_IN_CACHE: usize = 64;

/// V U of some rows, added to one row of eight a column.
pub(crate) struct AddProducts<'a> {
    /// Rows of V; the columns from `first_column` on are meant.
    pub(crate) panel: &'a [[f64; WIDTH]],
    pub(crate) first_column: usize,
    /// U.
    pub(crate) block: &'a [Row],
    /// One entry a column.
    pub(crate) sums: &'a mut [Row],
}

impl pulp::WithSimd for AddProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let rows = self.panel.chunks(ROWS_IN_CACHE);
        for (panel, block) in rows.zip(self.block.chunks(ROWS_IN_CACHE)) {
            let mut column = self.first_column;
            let mut tiles = self.sums.chunks_exact_mut(TILE);
            for tile in &mut tiles {
                let [mut a, mut b, mut c, mut d] = [tile[0], tile[1], tile[2], tile[3]];
                for (v, u) in panel.iter().zip(block) {
                    let v = &v[column..column + TILE];
                    a = plus_scaled(a, v[0], *u);
                    b = plus_scaled(b, v[1], *u);
                    c = plus_scaled(c, v[2], *u);
                    d = plus_scaled(d, v[3], *u);
                }
                tile.copy_from_slice(&[a, b, c, d]);
                column += TILE;
            }
            for sum in tiles.into_remainder() {
                let mut a = *sum;
                for (v, u) in panel.iter().zip(block) {
                    a = plus_scaled(a, v[column], *u);
                }
                *sum = a;
                column += 1;
            }
        }
    }
}

/// Cᵀ V of some rows, taken off the block.
pub(crate) struct SubtractCombinations<'a> {
    /// Rows of V; the columns from `first_column` on are meant.
    pub(crate) panel: &'a [[f64; WIDTH]],
    pub(crate) first_column: usize,
    /// C, one entry a column.
    pub(crate) coefficients: &'a [Row],
    /// U.
    pub(crate) block: &'a mut [Row],
}

impl pulp::WithSimd for SubtractCombinations<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let columns = self.first_column..self.first_column + self.coefficients.len();
        let mut tiles = self.block.chunks_exact_mut(TILE);
        let mut panels = self.panel.chunks_exact(TILE);
        for (u, v) in (&mut tiles).zip(&mut panels) {
            let v: [&[f64]; TILE] = std::array::from_fn(|i| &v[i][columns.clone()]);
            let [mut a, mut b, mut c, mut d] = [u[0], u[1], u[2], u[3]];
            for (j, row) in self.coefficients.iter().enumerate() {
                a = plus_scaled(a, -v[0][j], *row);
                b = plus_scaled(b, -v[1][j], *row);
                c = plus_scaled(c, -v[2][j], *row);
                d = plus_scaled(d, -v[3][j], *row);
            }
            u.copy_from_slice(&[a, b, c, d]);
        }
        for (u, v) in tiles.into_remainder().iter_mut().zip(panels.remainder()) {
            for (v, c) in v[columns.clone()].iter().zip(self.coefficients) {
                *u = plus_scaled(*u, -v, *c);
            }
        }
    }
}

/// a + s b, each entry rounded once.
#[inline(always)]
fn plus_scaled(a: Row, s: f64, b: Row) -> Row {
    let mut sum = a;
    for lane in 0..LANES {
        sum[lane] = s.mul_add(b[lane], sum[lane]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers<const N: usize>(n_rows: usize, scale: f64) -> Vec<[f64; N]> {
        let number = |i: usize, j: usize| (scale * (i * 31 + j * 17 + 1) as f64).sin();
        (0..n_rows)
            .map(|i| std::array::from_fn(|j| number(i, j)))
            .collect()
    }

    #[test]
    fn both_products_are_those_of_the_definition() {
        // Numbers of columns and rows that are and are not multiples of the tiles.
        for (first, n_columns, n_rows) in [(0, 32, 64), (0, 32, 131), (5, 7, 66), (31, 1, 3)] {
            let panel = numbers::<WIDTH>(n_rows, 0.7);
            let block = numbers::<LANES>(n_rows, 0.3);
            let mut sums = vec![[0.5; LANES]; n_columns];
            pulp::Arch::new().dispatch(AddProducts {
                panel: &panel,
                first_column: first,
                block: &block,
                sums: &mut sums,
            });
            for (i, row) in sums.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    let terms = panel.iter().zip(&block).map(|(v, u)| v[first + i] * u[j]);
                    let expected = 0.5 + terms.sum::<f64>();
                    assert!((value - expected).abs() < 1e-13, "{value} {expected}");
                }
            }
            let mut rest = block.clone();
            pulp::Arch::new().dispatch(SubtractCombinations {
                panel: &panel,
                first_column: first,
                coefficients: &sums,
                block: &mut rest,
            });
            for (r, row) in rest.iter().enumerate() {
                for (j, value) in row.iter().enumerate() {
                    let terms = sums.iter().enumerate();
                    let taken: f64 = terms.map(|(i, c)| c[j] * panel[r][first + i]).sum();
                    let expected = block[r][j] - taken;
                    assert!((value - expected).abs() < 1e-11, "{value} {expected}");
                }
            }
        }
    }
}
