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
//! kept in the functions asked for so far, corrected by the vertices whose image has changed,
//!
//! ```text
//! C' += Σ_y M(y) Φ_target(y, ·)ᵀ (Φ_source(T_new(y), ·) - Φ_source(T_old(y), ·))
//! ```
//!
//! and given new rows and columns when more functions are asked for.
//!
//! Searches between steps run in single precision on rows scaled by powers of two. Where a result
//! comes from a search it finds the few leaves that can hold the nearest row, which are then measured
//! in double. Vertices are kept in an order in which neighbours stand side by side.

use faer::{Mat, MatRef};
use pedicle_spectral::LaplaceBasis;

use crate::{
    PointMap,
    ball_tree::{BallTree, CarryBalls, neighbours_side_by_side},
    convert::functions,
    nearest::{Known, Search, search},
    progress::{RefinementStep, lost_share},
    pulled_back::{Between, PulledBack},
};

/// Rows of this length, where those of the target are about 1, still have squares in single precision.
const LONGEST_ROUNDED_ROW: f64 = 1e15;

/// A whole search is due when the number of functions has grown by one part in so many.
const WHOLE_SEARCH_GROWTH: usize = 2;

/// See the module.
pub(crate) struct Correspondence {
    source: BallTree<f64>,
    /// For most of the searching.
    rounded: Rounded,
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
    /// Squared norms of the source's rows over so many functions, by position.
    squared_norms: (Vec<f64>, usize),
    /// Functions of the target and of the source in the last search that remembered.
    searched_at: (usize, usize),
    /// C' of the images in the functions asked for so far, n_target × n_source.
    pulled_back: PulledBack,
}

/// Both shapes in single precision.
struct Rounded {
    source: BallTree<f32>,
    /// Φ_targetᵀ by position, times `factors.0`.
    functions: Mat<f32>,
    /// Powers of two that bring the functions of the target and of the source to about 1.
    factors: (f64, f64),
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
            || {
                let rows = functions(source, n_source);
                BallTree::new(rows, neighbours_side_by_side(rows), 1.0, n_target)
            },
            || neighbours_side_by_side(rows),
        );
        let mut by_position = Mat::zeros(n_target, order.len());
        for j in 0..n_target {
            for (p, &vertex) in order.iter().enumerate() {
                by_position[(j, p)] = rows[(vertex as usize, j)];
            }
        }
        Self {
            rounded: Rounded::new(&source, &by_position),
            mass: order.iter().map(|&v| target.mass[v as usize]).collect(),
            functions: by_position,
            known: vec![Known::default(); order.len()],
            images: vec![None; order.len()],
            squared_norms: (vec![0.0; source.n_rows()], 0),
            searched_at: (0, 0),
            pulled_back: PulledBack::new(),
            order,
            source,
        }
    }

    /// Nearest rows for a map of any size within the bases; the number of images it changed.
    pub(crate) fn assign(&mut self, map: MatRef<'_, f64>) -> usize {
        self.source.carry(map, CarryBalls::No);
        let queries = self.functions.subrows(0, map.nrows());
        let rounded = &mut self.rounded;
        let how = if rounded.find_candidates(&self.source, map.nrows(), &mut self.known) {
            Search::Remembered
        } else {
            self.source.lay_balls(map.nrows());
            Search::Whole
        };
        search(&self.source, queries, &mut self.known, how);
        // What came near has given way to what can be nearest.
        self.searched_at = (0, 0);
        self.replace()
    }

    /// The same for one of many small steps, to single precision: searches everywhere only when the
    /// number of functions has grown by a half since that was last done, and among what came near
    /// then in between.
    pub(crate) fn assign_step(&mut self, map: MatRef<'_, f64>) -> usize {
        let due = |n: usize, searched_at: usize| {
            n >= searched_at + searched_at.div_ceil(WHOLE_SEARCH_GROWTH)
        };
        let (n_target, n_source) = map.shape();
        let how = if due(n_target, self.searched_at.0) || due(n_source, self.searched_at.1) {
            self.searched_at = (n_target, n_source);
            Search::WholeRemembering
        } else {
            Search::Remembered
        };
        self.rounded.search_step(map, &mut self.known, how);
        self.replace()
    }

    /// C' of the present point map in the first functions, n_target × n_source.
    pub(crate) fn pulled_back(&mut self, size: (usize, usize)) -> Mat<f64> {
        self.kept(size).to_owned()
    }

    fn kept(&mut self, size: (usize, usize)) -> MatRef<'_, f64> {
        let between = Between {
            source: &self.source.functions,
            target: self.functions.as_ref(),
            mass: &self.mass,
        };
        self.pulled_back.part(between, &self.images, size)
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
        &mut self,
        (n_target, n_source): (usize, usize),
        n_changed: usize,
    ) -> RefinementStep {
        let mut hits = vec![0.0; self.source.n_rows()];
        for (image, mass) in self.images.iter().zip(&self.mass) {
            hits[image.unwrap_or_default() as usize] += mass;
        }
        let (norms, n_counted) = &mut self.squared_norms;
        if *n_counted > n_source {
            norms.fill(0.0);
            *n_counted = 0;
        }
        for (p, norm) in norms.iter_mut().enumerate() {
            for j in *n_counted..n_source {
                *norm += self.source.functions.get(p, j).powi(2);
            }
        }
        *n_counted = n_source;
        let pairs = hits.iter().zip(&*norms);
        let carried: f64 = pairs.map(|(mass, norm)| mass * norm).sum();
        let kept = self.kept((n_target, n_source)).squared_norm_l2();
        RefinementStep {
            n_source,
            n_target,
            coverage: self.coverage(),
            changed: n_changed as f64 / self.images.len() as f64,
            energy: lost_share(carried, carried - kept),
            quality: None,
        }
    }

    /// Takes the images that are known now, corrects C' and says how many have changed.
    fn replace(&mut self) -> usize {
        let images: Vec<Option<u32>> = self.known.iter().map(|known| known.image).collect();
        let changed: Vec<usize> = (0..images.len())
            .filter(|&y| self.images[y] != images[y])
            .collect();
        let between = Between {
            source: &self.source.functions,
            target: self.functions.as_ref(),
            mass: &self.mass,
        };
        let pulled_back = &mut self.pulled_back;
        pulled_back.correct(between, &changed, &self.images, &images);
        self.images = images;
        changed.len()
    }
}

impl Rounded {
    fn new(source: &BallTree<f64>, target_functions: &Mat<f64>) -> Self {
        let order: Vec<u32> = (0..source.n_rows() as u32).collect();
        let (n_source, n_target) = (source.functions.dimension(), target_functions.nrows());
        let rows = Mat::from_fn(order.len(), n_source, |p, j| source.functions.get(p, j));
        let factors = (
            scaling_power_of_two(target_functions.norm_max()),
            scaling_power_of_two(rows.norm_max()),
        );
        Self {
            functions: Mat::from_fn(n_target, target_functions.ncols(), |j, p| {
                (factors.0 * target_functions[(j, p)]) as f32
            }),
            source: BallTree::new(rows.as_ref(), order, factors.1, n_target),
            factors,
        }
    }

    /// Remembers all leaves that may hold nearest rows of a source in double precision; false if
    /// its rows are too long beside the target's for single precision.
    fn find_candidates(
        &mut self,
        source: &BallTree<f64>,
        n_target: usize,
        known: &mut [Known],
    ) -> bool {
        self.source.round(source, self.factors.0, n_target);
        // Written so that what is not a number does not fit either.
        let fits = self.source.largest_norm < LONGEST_ROUNDED_ROW;
        if fits {
            let queries = self.functions.subrows(0, n_target);
            search(&self.source, queries, known, Search::Candidates);
        }
        fits
    }

    /// Carries the source and searches it, in single precision.
    fn search_step(&mut self, map: MatRef<'_, f64>, known: &mut [Known], how: Search) {
        let balls = if how == Search::Remembered {
            CarryBalls::No
        } else {
            CarryBalls::Yes
        };
        let factor = self.factors.0 / self.factors.1;
        let (n_target, n_source) = map.shape();
        let map = Mat::from_fn(n_target, n_source, |i, j| (factor * map[(i, j)]) as f32);
        self.source.carry(map.as_ref(), balls);
        let queries = self.functions.subrows(0, n_target);
        search(&self.source, queries, known, how);
    }
}

/// The power of two nearest to 1 / size; 1 for a size of nothing.
fn scaling_power_of_two(size: f64) -> f64 {
    if size > 0.0 {
        (-size.log2()).round().exp2()
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        FunctionalMap,
        convert::{nearest_adjoint_point_map, pulled_back},
    };

    /// A small congruential generator: the tests need numbers, not randomness.
    fn numbers(n_rows: usize, n_columns: usize, mut state: u64) -> Mat<f64> {
        Mat::from_fn(n_rows, n_columns, |_, _| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        })
    }

    /// Waves on a strip: neighbours have like rows, as eigenfunctions do.
    fn basis(n_vertices: usize, phase: f64) -> LaplaceBasis {
        let noise = numbers(n_vertices, 40, n_vertices as u64);
        LaplaceBasis {
            eigenvalues: (0..40).map(f64::from).collect(),
            eigenfunctions: Mat::from_fn(n_vertices, 40, |v, j| {
                let x = v as f64 / n_vertices as f64 + phase;
                (j as f64 * 2.0 * x).cos() + 0.1 * noise[(v, j)]
            }),
            mass: (0..n_vertices).map(|v| 1.0 + (v % 7) as f64).collect(),
            null_dimension: 1,
        }
    }

    fn map(size: usize, seed: u64) -> FunctionalMap {
        let noise = numbers(size, size, seed);
        FunctionalMap {
            matrix: Mat::from_fn(size, size, |i, j| {
                f64::from(u8::from(i == j)) + 0.1 * noise[(i, j)]
            }),
        }
    }

    #[test]
    fn a_whole_search_is_exhaustive_whatever_came_before() {
        // Neither number is a multiple of the sizes of leaves, batches and groups.
        let (source, target) = (basis(1301, 0.0), basis(1111, 0.01));
        let mut correspondence = Correspondence::new(&source, &target, (40, 40));
        for (i, size) in [9, 10, 11, 12, 20, 23, 40].into_iter().enumerate() {
            let map = map(size, i as u64);
            correspondence.assign_step(map.matrix.as_ref());
            let exhaustive = nearest_adjoint_point_map(&source, &target, &map);
            let found = correspondence.point_map();
            let pairs = found.source_of_target.iter();
            let n_other = pairs
                .zip(&exhaustive.source_of_target)
                .filter(|(a, b)| a != b)
                .count();
            // Between whole searches a few may be missed, even though these maps are unrelated.
            assert!(n_other < 1111 / 10, "step {i}: {n_other}");
            correspondence.assign(map.matrix.as_ref());
            assert_eq!(correspondence.point_map(), exhaustive, "step {i}");
        }
    }

    #[test]
    fn rows_too_long_for_single_precision_are_searched_in_double() {
        let (source, target) = (basis(700, 0.0), basis(600, 0.01));
        for factor in [1.0, 1e14, 1e17, 1e30] {
            let mut map = map(30, 5);
            map.matrix *= faer::Scale(factor);
            let mut correspondence = Correspondence::new(&source, &target, (40, 40));
            correspondence.assign(map.matrix.as_ref());
            let exhaustive = nearest_adjoint_point_map(&source, &target, &map);
            assert_eq!(correspondence.point_map(), exhaustive, "times {factor}");
        }
    }

    #[test]
    fn corrections_add_up_to_the_map_of_the_present_images() {
        let (source, target) = (basis(300, 0.0), basis(257, 0.02));
        let mut correspondence = Correspondence::new(&source, &target, (40, 30));
        for seed in 0..20 {
            correspondence.assign_step(map(25, seed).matrix.as_ref());
            // Rows alone, columns alone, both, neither.
            let size = (12 + seed as usize / 2, 10 + seed as usize / 3);
            let now = correspondence.point_map();
            let direct = pulled_back(&source, &target, &now, size).matrix;
            let kept = correspondence.pulled_back(size);
            assert!((&direct - &kept).norm_l2() < 1e-11 * direct.norm_l2());
        }
    }

    #[test]
    fn the_number_of_threads_does_not_matter() {
        let (source, target) = (basis(900, 0.0), basis(800, 0.01));
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.unwrap().install(|| {
                let mut correspondence = Correspondence::new(&source, &target, (40, 40));
                for size in 9..30 {
                    correspondence.assign_step(map(size, size as u64).matrix.as_ref());
                }
                (
                    correspondence.point_map(),
                    correspondence.pulled_back((40, 40)),
                )
            })
        };
        let (one, three) = (with(1), with(3));
        assert_eq!(one.0, three.0);
        assert!(one.1 == three.1, "the same bits");
    }
}
