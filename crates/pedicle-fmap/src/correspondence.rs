//! A point map under refinement: each target vertex's nearest source vertex, and the C of it.
//!
//! ```text
//! T(y) = argmin_x | (Φ_target C)(y, ·) - Φ_source(x, ·) |²,     C' = Φ_targetᵀ M_target Π_T Φ_source
//! ```
//!
//! From step to step few images change: those of the step before bound the search, and C' is
//! kept in all functions of both bases and corrected by the vertices whose image has changed,
//!
//! ```text
//! C' += Σ_y M(y) Φ_target(y, ·)ᵀ (Φ_source(T_new(y), ·) - Φ_source(T_old(y), ·))
//! ```
//!
//! Vertices are kept in the order of a [`RowTree`] on either side.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use pedicle_spectral::LaplaceBasis;
use rayon::prelude::*;

use crate::{
    PointMap,
    convert::functions,
    nearest::{Known, QUERIES_PER_BATCH, Scratch},
    row_tree::{RowTree, neighbours_side_by_side},
};

/// Changed vertices a product takes: two matrices of this many columns stay inside a cache.
const CHANGES_PER_PRODUCT: usize = 256;

/// See the module.
pub(crate) struct Correspondence {
    source: RowTree,
    /// The target vertex at every position: neighbours side by side.
    order: Vec<u32>,
    /// Φ_targetᵀ by position.
    functions: Mat<f64>,
    /// Areas by position.
    mass: Vec<f64>,
    /// Runs of positions.
    batches: Vec<Batch>,
    /// Position of every image; empty as long as there are none.
    images: Vec<u32>,
    /// C' of the images in all functions, n_target × n_source.
    pulled_back: Mat<f64>,
}

/// A run of target vertices that are searched for together.
struct Batch {
    first: usize,
    known: Vec<Known>,
    /// Their rows of Φ_target C when their lists were made, as columns.
    origins: Mat<f64>,
}

impl Correspondence {
    /// Between the first `n_target` and `n_source` functions of two bases; no point map yet.
    pub(crate) fn new(
        source: &LaplaceBasis,
        target: &LaplaceBasis,
        (n_target, n_source): (usize, usize),
    ) -> Self {
        let rows = functions(target, n_target);
        let (source, order) = rayon::join(
            || RowTree::new(functions(source, n_source)),
            || neighbours_side_by_side(rows),
        );
        let mut by_position = Mat::zeros(n_target, order.len());
        for j in 0..n_target {
            for (p, &vertex) in order.iter().enumerate() {
                by_position[(j, p)] = rows[(vertex as usize, j)];
            }
        }
        let batches = (0..order.len()).step_by(QUERIES_PER_BATCH).map(|first| {
            let count = QUERIES_PER_BATCH.min(order.len() - first);
            Batch {
                first,
                known: vec![Known::default(); count],
                origins: batch_matrix(n_source),
            }
        });
        Self {
            batches: batches.collect(),
            mass: order.iter().map(|&v| target.mass[v as usize]).collect(),
            functions: by_position,
            images: Vec::new(),
            pulled_back: Mat::zeros(n_target, n_source),
            order,
            source,
        }
    }

    /// Starts from a point map between the shapes instead of a functional one.
    pub(crate) fn start_from(&mut self, point_map: &PointMap) {
        let vertices = self.order.iter();
        let images = vertices.map(|&v| point_map.source_of_target[v as usize]);
        let images: Vec<u32> = images
            .map(|image| self.source.position[image as usize])
            .collect();
        for batch in &mut self.batches {
            for (known, &image) in batch.known.iter_mut().zip(&images[batch.first..]) {
                *known = Known::at(image);
            }
        }
        self.replace(images);
    }

    /// Nearest rows for a map of any size within the bases; the number of images it changed.
    ///
    /// The number of functions of the source must not shrink from call to call.
    pub(crate) fn assign(&mut self, map: MatRef<'_, f64>) -> usize {
        self.source.grow_to(map.ncols());
        let (source, functions) = (&self.source, &self.functions);
        let (carry, n_functions) = (map.transpose().to_owned(), source.rows.dimension());
        let arch = pulp::Arch::new();
        self.batches.par_iter_mut().for_each_init(
            || (Scratch::default(), batch_matrix(n_functions)),
            |(scratch, carried), batch| {
                let count = batch.known.len();
                let rows = functions.subrows(0, map.nrows());
                matmul(
                    carried.submatrix_mut(0, 0, map.ncols(), count),
                    Accum::Replace,
                    carry.as_ref(),
                    rows.subcols(batch.first, count),
                    1.0,
                    Par::Seq,
                );
                arch.dispatch(Search {
                    batch,
                    source,
                    carried,
                    scratch,
                });
            },
        );
        let known = self.batches.iter().flat_map(|batch| &batch.known);
        let images = known.map(|known| known.image.unwrap_or_default()).collect();
        self.replace(images)
    }

    /// C' of the present point map in the first functions, n_target × n_source.
    pub(crate) fn pulled_back(&self, (n_target, n_source): (usize, usize)) -> Mat<f64> {
        let part = self.pulled_back.submatrix(0, 0, n_target, n_source);
        part.to_owned()
    }

    /// The present point map.
    pub(crate) fn point_map(&self) -> PointMap {
        let mut source_of_target = vec![0; self.order.len()];
        for (&vertex, &image) in self.order.iter().zip(&self.images) {
            source_of_target[vertex as usize] = self.source.order[image as usize];
        }
        PointMap {
            source_of_target,
            n_source_vertices: self.source.n_rows(),
        }
    }

    /// Number of target vertices.
    pub(crate) fn n_target_vertices(&self) -> usize {
        self.order.len()
    }

    /// Share of the source vertices that are some target vertex's image.
    pub(crate) fn coverage(&self) -> f64 {
        let mut hit = vec![false; self.source.n_rows()];
        for &image in &self.images {
            hit[image as usize] = true;
        }
        hit.iter().filter(|&&hit| hit).count() as f64 / hit.len() as f64
    }

    /// Takes new images, corrects C' and says how many have changed.
    fn replace(&mut self, images: Vec<u32>) -> usize {
        let changed: Vec<usize> = (0..images.len())
            .filter(|&y| self.images.get(y) != Some(&images[y]))
            .collect();
        let (n_target, n_source) = self.pulled_back.shape();
        let size = CHANGES_PER_PRODUCT.min(changed.len());
        let mut weighted = Mat::zeros(n_target, size);
        let mut difference = Mat::zeros(n_source, size);
        for chunk in changed.chunks(CHANGES_PER_PRODUCT) {
            for (j, &y) in chunk.iter().enumerate() {
                let to = weighted.col_as_slice_mut(j).iter_mut();
                for (w, phi) in to.zip(self.functions.col_as_slice(y)) {
                    *w = self.mass[y] * phi;
                }
                let to = difference.col_as_slice_mut(j);
                let before = self.images.get(y).map(|&image| image as usize);
                for (i, d) in to.iter_mut().enumerate() {
                    let before = before.map_or(0.0, |image| self.source.rows.get(image, i));
                    *d = self.source.rows.get(images[y] as usize, i) - before;
                }
            }
            matmul(
                self.pulled_back.as_mut(),
                Accum::Add,
                weighted.subcols(0, chunk.len()),
                difference.subcols(0, chunk.len()).transpose(),
                1.0,
                Par::Seq,
            );
        }
        self.images = images;
        changed.len()
    }
}

/// Nearest rows for the carried rows of a batch, in the widest registers there are.
struct Search<'a> {
    batch: &'a mut Batch,
    source: &'a RowTree,
    carried: &'a Mat<f64>,
    scratch: &'a mut Scratch,
}

impl pulp::WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self {
            batch,
            source,
            carried,
            scratch,
        } = self;
        for (i, known) in batch.known.iter_mut().enumerate() {
            let query = &carried.col_as_slice(i)[..source.dimension];
            let origin = batch.origins.col_as_slice_mut(i);
            known.update(source, query, origin, scratch);
        }
    }
}

fn batch_matrix(n_functions: usize) -> Mat<f64> {
    Mat::zeros(n_functions, QUERIES_PER_BATCH)
}
