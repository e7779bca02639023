//! Nearest rows: for every row q of one matrix the nearest row r of another.
//!
//! ```text
//! |q - r|² = |q|² - 2 q·r + |r|²
//! ```
//!
//! The products q·r come from blocked matrix products, never a full n × n. The expansion loses
//! digits where rows nearly coincide, so every candidate within rounding of the best is measured
//! again as Σ (q_i - r_i)²; among equals the lowest index wins. The result therefore depends
//! neither on the size of the blocks nor on the number of threads.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use rayon::prelude::*;

/// Rows of the query matrix a task takes.
const QUERIES_PER_BLOCK: usize = 128;
/// Rows of the reference matrix a product takes: with the queries 0.5 MB, inside a cache.
const REFERENCES_PER_BLOCK: usize = 512;
/// Independent running minima, so that the search for the minimum fills vector registers.
const LANES: usize = 8;

/// For every row of `queries` the index of the nearest row of `references`.
///
/// Both matrices are finite and have the same number of columns; there is a reference.
pub(crate) fn nearest_rows(queries: MatRef<'_, f64>, references: MatRef<'_, f64>) -> Vec<u32> {
    debug_assert_eq!(queries.ncols(), references.ncols(), "same dimension");
    debug_assert!(references.nrows() > 0, "something to choose from");
    // Points as columns: contiguous for the repeated measurement.
    let references = Points::new(references);
    let queries = Points::new(queries);
    let mut nearest = vec![0_u32; queries.squared_norms.len()];
    nearest
        .par_chunks_mut(QUERIES_PER_BLOCK)
        .enumerate()
        .for_each(|(block, out)| {
            nearest_of_block(&queries, block * QUERIES_PER_BLOCK, &references, out);
        });
    nearest
}

/// Points as columns of a d × n matrix.
struct Points {
    coordinates: Mat<f64>,
    squared_norms: Vec<f64>,
    largest_squared_norm: f64,
}

impl Points {
    fn new(rows: MatRef<'_, f64>) -> Self {
        let coordinates = rows.transpose().to_owned();
        let squared_norms: Vec<f64> = (0..coordinates.ncols())
            .map(|j| coordinates.col_as_slice(j).iter().map(|x| x * x).sum())
            .collect();
        let largest_squared_norm = squared_norms.iter().copied().fold(0.0, f64::max);
        Self {
            coordinates,
            squared_norms,
            largest_squared_norm,
        }
    }

    fn squared_distance(&self, index: usize, other: &Self, other_index: usize) -> f64 {
        let a = self.coordinates.col_as_slice(index);
        let b = other.coordinates.col_as_slice(other_index);
        a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
    }
}

/// What is known of one query so far.
#[derive(Clone, Copy)]
struct Best {
    /// Smallest |r|² - 2 q·r seen.
    score: f64,
    /// Smallest Σ (q_i - r_i)² among the candidates measured.
    squared_distance: f64,
    index: usize,
}

fn nearest_of_block(queries: &Points, first_query: usize, references: &Points, out: &mut [u32]) {
    let n_queries = out.len();
    let dimension = queries.coordinates.nrows();
    let n_references = references.squared_norms.len();
    let block = queries.coordinates.subcols(first_query, n_queries);
    let mut scores = Mat::<f64>::zeros(REFERENCES_PER_BLOCK.min(n_references), n_queries);
    let mut best = vec![
        Best {
            score: f64::INFINITY,
            squared_distance: f64::INFINITY,
            index: 0,
        };
        n_queries
    ];
    for first in (0..n_references).step_by(REFERENCES_PER_BLOCK) {
        let count = REFERENCES_PER_BLOCK.min(n_references - first);
        let part = references.coordinates.subcols(first, count);
        matmul(
            scores.as_mut().subrows_mut(0, count),
            Accum::Replace,
            part.transpose(),
            block,
            -2.0,
            Par::Seq,
        );
        let norms = &references.squared_norms[first..first + count];
        for (j, best) in best.iter_mut().enumerate() {
            let query = first_query + j;
            let column = &mut scores.col_as_slice_mut(j)[..count];
            for (score, norm) in column.iter_mut().zip(norms) {
                *score += norm;
            }
            let smallest = minimum(column);
            // The error of a product of d terms is below d ε |q||r|; with the norms twice that.
            let magnitude = queries.squared_norms[query] + references.largest_squared_norm;
            let slack = 4.0 * dimension as f64 * f64::EPSILON * magnitude;
            if smallest > best.score + slack {
                continue;
            }
            best.score = if smallest < best.score {
                smallest
            } else {
                best.score
            };
            let limit = best.score + slack;
            for (i, &score) in column.iter().enumerate() {
                if score <= limit {
                    let squared_distance = references.squared_distance(first + i, queries, query);
                    if squared_distance < best.squared_distance {
                        best.squared_distance = squared_distance;
                        best.index = first + i;
                    }
                }
            }
        }
    }
    for (slot, best) in out.iter_mut().zip(&best) {
        *slot = best.index as u32;
    }
}

fn minimum(values: &[f64]) -> f64 {
    let mut lanes = [f64::INFINITY; LANES];
    let chunks = values.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, &value) in lanes.iter_mut().zip(chunk) {
            *lane = if value < *lane { value } else { *lane };
        }
    }
    lanes
        .iter()
        .chain(rest)
        .fold(f64::INFINITY, |a, &b| if b < a { b } else { a })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small congruential generator: the tests need numbers, not randomness.
    fn numbers(n_rows: usize, n_columns: usize, mut state: u64) -> Mat<f64> {
        Mat::from_fn(n_rows, n_columns, |_, _| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        })
    }

    fn brute_force(queries: &Mat<f64>, references: &Mat<f64>) -> Vec<u32> {
        (0..queries.nrows())
            .map(|q| {
                let distance = |r: usize| -> f64 {
                    (0..queries.ncols())
                        .map(|j| (queries[(q, j)] - references[(r, j)]).powi(2))
                        .sum()
                };
                (0..references.nrows())
                    .min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
                    .unwrap() as u32
            })
            .collect()
    }

    #[test]
    fn agrees_with_brute_force_at_every_size() {
        for (n_queries, n_references, dimension) in [(1, 1, 1), (130, 513, 7), (300, 1100, 20)] {
            let queries = numbers(n_queries, dimension, 1);
            let references = numbers(n_references, dimension, 2);
            assert_eq!(
                nearest_rows(queries.as_ref(), references.as_ref()),
                brute_force(&queries, &references)
            );
        }
    }

    #[test]
    fn equal_rows_give_the_lowest_index() {
        let one = numbers(1, 33, 3);
        let references = Mat::from_fn(1200, 33, |i, j| one[(0, j)] + if i < 7 { 1.0 } else { 0.0 });
        let nearest = nearest_rows(one.as_ref(), references.as_ref());
        assert_eq!(nearest, vec![7]);
    }

    #[test]
    fn rows_far_from_the_origin_keep_their_digits() {
        // Differences of 1e-3 at 1e6: the expansion alone has lost them.
        let small = numbers(600, 5, 4);
        let far = Mat::from_fn(600, 5, |i, j| 1e6 + 1e-3 * small[(i, j)]);
        let identity: Vec<u32> = (0..600).collect();
        assert_eq!(nearest_rows(far.as_ref(), far.as_ref()), identity);
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let queries = numbers(700, 12, 5);
        let references = numbers(900, 12, 6);
        let with = |threads: usize| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| nearest_rows(queries.as_ref(), references.as_ref()))
        };
        assert_eq!(with(1), with(3));
    }
}
