//! C' of a point map that changes a little at a time, and that is asked for in more and more functions.
//!
//! ```text
//! C'          = Φ_targetᵀ M_target Π_T Φ_source
//! changes     C' += Σ_y M(y) Φ_target(y, ·)ᵀ (Φ_source(T_new(y), ·) - Φ_source(T_old(y), ·))
//! new rows    C'_i = h_iᵀ Φ_source,   h_i(x) = Σ_{T(y) = x} M(y) Φ_target(y, i)
//! new columns C'_j = Φ_targetᵀ (M Φ_source(T(·), j))
//! ```
//!
//! Sums are over runs of vertices of fixed length and added in their order: the same bits for any
//! number of threads.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use rayon::prelude::*;

use crate::lanes::{Batches, LANES, ROWS_PER_BATCH};

/// Vertices in a run: two matrices of this many columns stay inside a cache.
const VERTICES_PER_RUN: usize = 128;
/// Runs of the same length in batches of source rows, with as much work in each.
const BATCHES_PER_RUN: usize = 16;

/// The two shapes and the areas between which C' goes.
#[derive(Clone, Copy)]
pub(crate) struct Between<'a> {
    /// Φ_source by position.
    pub(crate) source: &'a Batches<f64>,
    /// Φ_targetᵀ by position.
    pub(crate) target: MatRef<'a, f64>,
    /// Areas of the target by position.
    pub(crate) mass: &'a [f64],
}

/// C' in the functions asked for so far, n_target × n_source.
#[derive(Debug)]
pub(crate) struct PulledBack {
    matrix: Mat<f64>,
}

impl PulledBack {
    /// In no function yet.
    pub(crate) fn new() -> Self {
        Self { matrix: Mat::new() }
    }

    /// C' in the first functions, n_target × n_source.
    pub(crate) fn part(
        &mut self,
        between: Between<'_>,
        images: &[Option<u32>],
        (n_target, n_source): (usize, usize),
    ) -> MatRef<'_, f64> {
        self.grow(between, images, (n_target, n_source));
        self.matrix.submatrix(0, 0, n_target, n_source)
    }

    /// Takes note of the vertices whose image has changed.
    pub(crate) fn correct(
        &mut self,
        between: Between<'_>,
        changed: &[usize],
        old: &[Option<u32>],
        new: &[Option<u32>],
    ) {
        let (n_target, n_source) = self.matrix.shape();
        if n_target == 0 || n_source == 0 {
            return;
        }
        let product = |run: &[usize]| -> Mat<f64> {
            let mut weighted = Mat::zeros(n_target, run.len());
            let mut difference = Mat::zeros(n_source, run.len());
            for (j, &y) in run.iter().enumerate() {
                let to = weighted.col_as_slice_mut(j).iter_mut();
                for (w, phi) in to.zip(between.target.col(y).iter()) {
                    *w = between.mass[y] * phi;
                }
                let to = difference.col_as_slice_mut(j);
                for (image, sign) in [(new[y], 1.0), (old[y], -1.0)] {
                    let Some(p) = image.map(|p| p as usize) else {
                        continue;
                    };
                    let row = between.source.leaf(p / LANES, n_source);
                    for (d, phi) in to.iter_mut().zip(row) {
                        *d += sign * phi[p % LANES];
                    }
                }
            }
            times(weighted.as_ref(), difference.transpose())
        };
        let runs = changed.par_chunks(VERTICES_PER_RUN).map(product).collect();
        add_all(&mut self.matrix, runs);
    }

    fn grow(
        &mut self,
        between: Between<'_>,
        images: &[Option<u32>],
        (n_target, n_source): (usize, usize),
    ) {
        let (had_target, had_source) = self.matrix.shape();
        if n_target <= had_target && n_source <= had_source {
            return;
        }
        let size = (n_target.max(had_target), n_source.max(had_source));
        let rows = new_rows(between, images, had_target..size.0, size.1);
        let columns = new_columns(between, images, had_target, had_source..size.1);
        self.matrix = Mat::from_fn(size.0, size.1, |i, j| {
            if i >= had_target {
                rows[(i - had_target, j)]
            } else if j >= had_source {
                columns[(i, j - had_source)]
            } else {
                self.matrix[(i, j)]
            }
        });
    }
}

/// C' of some functions of the target and the first ones of the source.
fn new_rows(
    between: Between<'_>,
    images: &[Option<u32>],
    of_target: std::ops::Range<usize>,
    n_source: usize,
) -> Mat<f64> {
    let Between {
        source,
        target,
        mass,
    } = between;
    let mut rows = Mat::zeros(of_target.len(), n_source);
    if of_target.is_empty() {
        return rows;
    }
    let n_batches = source.n_rows().div_ceil(ROWS_PER_BATCH);
    let mut hits = Mat::<f64>::zeros(of_target.len(), n_batches * ROWS_PER_BATCH);
    for (y, image) in images.iter().enumerate() {
        if let Some(x) = image {
            let to = hits.col_as_slice_mut(*x as usize).iter_mut();
            let phi = target.col(y).subrows(of_target.start, of_target.len());
            for (h, phi) in to.zip(phi.iter()) {
                *h += mass[y] * phi;
            }
        }
    }
    let product = |run: usize| -> Mat<f64> {
        let batches = run * BATCHES_PER_RUN..((run + 1) * BATCHES_PER_RUN).min(n_batches);
        let mut sum = Mat::zeros(of_target.len(), n_source);
        for batch in batches {
            let hits = hits.subcols(batch * ROWS_PER_BATCH, ROWS_PER_BATCH);
            let phi = source.batch(batch).subcols(0, n_source);
            matmul(sum.as_mut(), Accum::Add, hits, phi, 1.0, Par::Seq);
        }
        sum
    };
    let runs = (0..n_batches.div_ceil(BATCHES_PER_RUN)).into_par_iter();
    add_all(&mut rows, runs.map(product).collect());
    rows
}

/// C' of the first functions of the target and some of the source.
fn new_columns(
    between: Between<'_>,
    images: &[Option<u32>],
    n_target: usize,
    of_source: std::ops::Range<usize>,
) -> Mat<f64> {
    let mut columns = Mat::zeros(n_target, of_source.len());
    if n_target == 0 || of_source.is_empty() {
        return columns;
    }
    let product = |run: usize| -> Mat<f64> {
        let first = run * VERTICES_PER_RUN;
        let vertices = first..(first + VERTICES_PER_RUN).min(images.len());
        let carried = Mat::from_fn(vertices.len(), of_source.len(), |i, j| {
            let y = first + i;
            images[y].map_or(0.0, |x| {
                between.mass[y] * between.source.get(x as usize, of_source.start + j)
            })
        });
        let phi = between.target.subcols(first, vertices.len());
        times(phi.subrows(0, n_target), carried.as_ref())
    };
    let runs = (0..images.len().div_ceil(VERTICES_PER_RUN)).into_par_iter();
    add_all(&mut columns, runs.map(product).collect());
    columns
}

fn times(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut product = Mat::zeros(a.nrows(), b.ncols());
    matmul(product.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    product
}

/// Adds matrices in their order.
fn add_all(sum: &mut Mat<f64>, terms: Vec<Mat<f64>>) {
    for term in terms {
        *sum += term;
    }
}
