//! A point map under refinement: each target vertex's nearest source vertex, and the C of it.
//!
//! ```text
//! T(y) = argmin_x | Φ_target(y, ·) - (Φ_source Cᵀ)(x, ·) |²,    C' = Φ_targetᵀ M_target Π_T Φ_source
//! ```
//!
//! This is the form of Melzi et al. 2019: C carries the rows of the source. Where C loses
//! norm, as it does under noise at high frequencies, it takes those frequencies less seriously;
//! carrying the rows of the target instead pulls images towards the few source rows that are
//! short. On bent, noisy vertebrae it halves the error of the refined map.
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

use crate::{
    PointMap,
    ball_tree::{BallTree, CarryBalls, neighbours_side_by_side},
    convert::functions,
    nearest::{Known, Search, search},
    progress::{RefinementStep, lost_share},
};

/// Changed vertices a product takes: two matrices of this many columns stay inside a cache.
const CHANGES_PER_PRODUCT: usize = 256;

/// A whole search is due when the number of functions has grown by one part in so many.
const WHOLE_SEARCH_GROWTH: usize = 3;

/// See the module.
pub(crate) struct Correspondence {
    source: BallTree,
    /// The target vertex at every position: neighbours side by side.
    order: Vec<u32>,
    /// Φ_targetᵀ by position.
    functions: Mat<f64>,
    /// Areas by position.
    mass: Vec<f64>,
    /// What is known of every vertex, by position.
    known: Vec<Known>,
    /// Position of every image, if there is one.
    images: Vec<Option<u32>>,
    /// Functions of the target in the last whole search.
    searched_at: usize,
    /// C' of the images in all functions, n_target × n_source.
    pulled_back: Mat<f64>,
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
            || BallTree::new(functions(source, n_source), n_target),
            || neighbours_side_by_side(rows),
        );
        let mut by_position = Mat::zeros(n_target, order.len());
        for j in 0..n_target {
            for (p, &vertex) in order.iter().enumerate() {
                by_position[(j, p)] = rows[(vertex as usize, j)];
            }
        }
        Self {
            mass: order.iter().map(|&v| target.mass[v as usize]).collect(),
            functions: by_position,
            known: vec![Known::default(); order.len()],
            images: vec![None; order.len()],
            searched_at: 0,
            pulled_back: Mat::zeros(n_target, n_source),
            order,
            source,
        }
    }

    /// Nearest rows for a map of any size within the bases; the number of images it changed.
    pub(crate) fn assign(&mut self, map: MatRef<'_, f64>) -> usize {
        self.searched_at = map.nrows();
        self.search(map, Search::Whole)
    }

    /// The same for one of many small steps: searches everywhere only when the number of functions
    /// has grown by a sixth since that was last done, and among what came near then in between.
    pub(crate) fn assign_step(&mut self, map: MatRef<'_, f64>) -> usize {
        let n_target = map.nrows();
        if n_target < self.searched_at + self.searched_at.div_ceil(WHOLE_SEARCH_GROWTH) {
            return self.search(map, Search::Remembered);
        }
        self.searched_at = n_target;
        self.search(map, Search::WholeRemembering)
    }

    fn search(&mut self, map: MatRef<'_, f64>, how: Search) -> usize {
        let balls = match how {
            Search::Remembered => CarryBalls::No,
            _ => CarryBalls::Yes,
        };
        self.source.carry(map, balls);
        let queries = self.functions.subrows(0, map.nrows());
        search(&self.source, queries, &mut self.known, how);
        let images = self.known.iter().map(|known| known.image).collect();
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
            let image = image.unwrap_or_default() as usize;
            source_of_target[vertex as usize] = self.source.order[image];
        }
        PointMap {
            source_of_target,
            n_source_vertices: self.source.n_rows(),
        }
    }

    /// Share of the source vertices that are some target vertex's image.
    pub(crate) fn coverage(&self) -> f64 {
        let mut hit = vec![false; self.source.n_rows()];
        for image in self.images.iter().flatten() {
            hit[*image as usize] = true;
        }
        hit.iter().filter(|&&hit| hit).count() as f64 / hit.len() as f64
    }

    /// The state of the map after a step with a C of that size which changed so many images.
    pub(crate) fn step(
        &self,
        (n_target, n_source): (usize, usize),
        n_changed: usize,
    ) -> RefinementStep {
        let mut hits = vec![0.0; self.source.n_rows()];
        for (image, mass) in self.images.iter().zip(&self.mass) {
            hits[image.unwrap_or_default() as usize] += mass;
        }
        let mut carried = 0.0;
        for (p, mass) in hits.iter().enumerate().filter(|(_, mass)| **mass > 0.0) {
            let row = (0..n_source).map(|j| self.source.functions.get(p, j));
            carried += mass * row.map(|x| x * x).sum::<f64>();
        }
        let kept = self.pulled_back.submatrix(0, 0, n_target, n_source);
        RefinementStep {
            n_source,
            n_target,
            coverage: self.coverage(),
            changed: n_changed as f64 / self.images.len() as f64,
            energy: lost_share(carried, carried - kept.squared_norm_l2()),
            quality: None,
        }
    }

    /// Takes new images, corrects C' and says how many have changed.
    fn replace(&mut self, images: Vec<Option<u32>>) -> usize {
        let changed: Vec<usize> = (0..images.len())
            .filter(|&y| self.images[y] != images[y])
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
                let (before, after) = (self.images[y], images[y]);
                for (i, d) in to.iter_mut().enumerate() {
                    let value = |image: Option<u32>| {
                        image.map_or(0.0, |p| self.source.functions.get(p as usize, i))
                    };
                    *d = value(after) - value(before);
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
