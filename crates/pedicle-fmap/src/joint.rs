//! The joint embedding of two shapes under one orthonormal C, and nearest rows in both directions.
//!
//! ```text
//! |Φ_t C - Φ_s|² + |Φ_t - Φ_s Cᵀ|² = 2 |Φ_t C - Φ_s|² + |Φ_t|² - |Φ_t C|²      (k_source ≤ k_target)
//! ```
//!
//! The two halves differ by what C leaves out of Φ_t alone: min(k_source, k_target) + 1 columns
//! measure the same as k_source + k_target, at half of the cost.

use faer::{Mat, MatRef};

use crate::{PointMap, PointMapPair, linear::product, nearest::nearest_rows_both_ways};

/// Rows whose squared distances are half of |Φ_t C - Φ_s|² + |Φ_t - Φ_s Cᵀ|².
pub(crate) fn joint_embedding(
    phi_s: MatRef<'_, f64>,
    phi_t: MatRef<'_, f64>,
    c: &Mat<f64>,
) -> (Mat<f64>, Mat<f64>) {
    if c.ncols() <= c.nrows() {
        let carried = product(phi_t, c.as_ref());
        let outside = norms_outside(phi_t, carried.as_ref());
        (
            with_column(phi_s, None),
            with_column(carried.as_ref(), Some(&outside)),
        )
    } else {
        let carried = product(phi_s, c.transpose());
        let outside = norms_outside(phi_s, carried.as_ref());
        (
            with_column(carried.as_ref(), Some(&outside)),
            with_column(phi_t, None),
        )
    }
}

/// √(½ (|row|² - |projected row|²)) of every row.
fn norms_outside(rows: MatRef<'_, f64>, projected: MatRef<'_, f64>) -> Vec<f64> {
    let squared_norms = |m: MatRef<'_, f64>| {
        let mut sums = vec![0.0; m.nrows()];
        for j in 0..m.ncols() {
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum += m[(i, j)] * m[(i, j)];
            }
        }
        sums
    };
    let pairs = squared_norms(rows)
        .into_iter()
        .zip(squared_norms(projected));
    pairs
        .map(|(all, kept)| {
            if all > kept {
                (0.5 * (all - kept)).sqrt()
            } else {
                0.0
            }
        })
        .collect()
}

fn with_column(rows: MatRef<'_, f64>, column: Option<&[f64]>) -> Mat<f64> {
    let k = rows.ncols();
    Mat::from_fn(rows.nrows(), k + 1, |i, j| {
        if j < k {
            rows[(i, j)]
        } else {
            column.map_or(0.0, |c| c[i])
        }
    })
}

/// The nearest rows in both directions.
pub(crate) fn nearest_pair(source_rows: &Mat<f64>, target_rows: &Mat<f64>) -> PointMapPair {
    let (there, back) = nearest_rows_both_ways(target_rows.as_ref(), source_rows.as_ref());
    PointMapPair {
        target_to_source: PointMap {
            source_of_target: there,
            n_source_vertices: source_rows.nrows(),
        },
        source_to_target: PointMap {
            source_of_target: back,
            n_source_vertices: target_rows.nrows(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::nearest_orthogonal;

    fn numbers(n_rows: usize, n_columns: usize, phase: f64) -> Mat<f64> {
        Mat::from_fn(n_rows, n_columns, |i, j| {
            (phase + 1.7 * i as f64 + 0.6 * (i * j) as f64 + j as f64).sin()
        })
    }

    #[test]
    fn distances_are_half_of_those_of_both_embeddings_side_by_side() {
        for (k_source, k_target) in [(4, 4), (3, 6), (6, 3)] {
            let (phi_s, phi_t) = (numbers(5, k_source, 0.1), numbers(7, k_target, 0.4));
            let c = nearest_orthogonal(&numbers(k_target, k_source, 0.9)).unwrap();
            let there = product(phi_t.as_ref(), c.as_ref());
            let back = product(phi_s.as_ref(), c.transpose());
            let (rows_s, rows_t) = joint_embedding(phi_s.as_ref(), phi_t.as_ref(), &c);
            let squared = |a: &Mat<f64>, i: usize, b: &Mat<f64>, j: usize| -> f64 {
                (0..a.ncols())
                    .map(|k| (a[(i, k)] - b[(j, k)]).powi(2))
                    .sum()
            };
            for x in 0..5 {
                for y in 0..7 {
                    let both = squared(&there, y, &phi_s, x) + squared(&phi_t, y, &back, x);
                    let joint = squared(&rows_t, y, &rows_s, x);
                    assert!((joint - 0.5 * both).abs() < 1e-12 * both, "{joint} {both}");
                }
            }
        }
    }
}
