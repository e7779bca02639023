//! Nearest rows: for every row q of one matrix the nearest row r of another.
//!
//! ```text
//! |q - r| ≥ |q - centre| - radius       for every r in a ball
//! ```
//!
//! A guess, such as the answer of the step before, bounds the distance from above; balls around
//! neighbouring rows bound it from below, first for 32 neighbouring queries at once, then for each
//! alone. What is left is measured eight rows at a time, and given up as soon as a part of the
//! coordinates is too far: of thousands of rows a few dozen are measured to the end. Leaf by leaf,
//! so that a leaf stays in the cache for all queries of a batch.
//!
//! The answer of a whole search is that of an exhaustive one: distances are sums of squares, among
//! equals the lowest index wins, and it depends neither on the guess nor on the number of threads.
//! A refinement by small steps moves images little, so it can search whole only now and then and
//! in between try only the few leaves that came nearest to each query in the last whole
//! search.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::{
    ball_tree::{BallTree, Balls, neighbours_side_by_side},
    lanes::{LANES, smallest_of},
    scalar::Scalar,
};

/// Queries that are searched for together.
const QUERIES_PER_BATCH: usize = 32;
/// Leaves that a query remembers from a whole search.
const LEAVES_PER_QUERY: usize = 4;
/// They lie within this many times the distance of the nearest row.
const REMEMBERED_REACH: f64 = 1.5;

/// For every row of `queries` the index of the nearest row of `references`.
///
/// Both matrices are finite and have the same number of columns; there is a reference.
pub(crate) fn nearest_rows(queries: MatRef<'_, f64>, references: MatRef<'_, f64>) -> Vec<u32> {
    let (order, others) = orders(queries, references);
    nearest_in_order((queries, &order), (references, &others))
}

/// The nearest row of `b` to every row of `a`, and of `a` to every row of `b`, as [`nearest_rows`].
pub(crate) fn nearest_rows_both_ways(
    a: MatRef<'_, f64>,
    b: MatRef<'_, f64>,
) -> (Vec<u32>, Vec<u32>) {
    let (of_a, of_b) = orders(a, b);
    let there = nearest_in_order((a, &of_a), (b, &of_b));
    (there, nearest_in_order((b, &of_b), (a, &of_a)))
}

fn orders(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> (Vec<u32>, Vec<u32>) {
    rayon::join(|| neighbours_side_by_side(a), || neighbours_side_by_side(b))
}

/// The same for rows whose orders are known.
fn nearest_in_order(
    (queries, order): (MatRef<'_, f64>, &[u32]),
    (references, of_references): (MatRef<'_, f64>, &[u32]),
) -> Vec<u32> {
    debug_assert_eq!(queries.ncols(), references.ncols(), "same dimension");
    debug_assert!(references.nrows() > 0, "something to choose from");
    let tree = BallTree::<f64>::at_rest(references, of_references.to_vec());
    // Points as columns: contiguous.
    let queries = Mat::from_fn(queries.ncols(), order.len(), |j, i| {
        queries[(order[i] as usize, j)]
    });
    let mut known = vec![Known::default(); order.len()];
    search(&tree, queries.as_ref(), &mut known, Search::Whole);
    let mut rows = vec![0; order.len()];
    for (&query, known) in order.iter().zip(known) {
        rows[query as usize] = tree.order[known.image.unwrap_or_default() as usize];
    }
    rows
}

/// What is known of a query.
#[derive(Debug, Clone, Default)]
pub(crate) struct Known {
    /// Position of the nearest row, or a guess of it.
    pub(crate) image: Option<u32>,
    /// Leaves that came near in the last whole search that remembered them.
    near: Vec<u32>,
}

/// Where to search, and what for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Search {
    /// Everywhere.
    Whole,
    /// Everywhere, remembering what came near.
    WholeRemembering,
    /// Everywhere, remembering all leaves that may hold the nearest row, given that both the rows
    /// and the queries have been rounded to this precision.
    Candidates,
    /// In what came near.
    Remembered,
}

/// Finds the nearest rows of a tree to the queries, one a column, neighbours side by side.
pub(crate) fn search<T: Scalar>(
    tree: &BallTree<T>,
    queries: MatRef<'_, T>,
    known: &mut [Known],
    search: Search,
) {
    let arch = pulp::Arch::new();
    known
        .par_chunks_mut(QUERIES_PER_BATCH)
        .enumerate()
        .for_each(|(i, known)| {
            let queries = queries.subcols(i * QUERIES_PER_BATCH, known.len());
            arch.dispatch(Batch {
                tree,
                queries,
                known,
                search,
            });
        });
}

/// The search for some queries, compiled for wide registers where the processor has them.
struct Batch<'a, T> {
    tree: &'a BallTree<T>,
    /// One a column.
    queries: MatRef<'a, T>,
    known: &'a mut [Known],
    search: Search,
}

impl<T: Scalar> pulp::WithSimd for Batch<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self {
            tree,
            queries,
            known,
            search,
        } = self;
        let mut best = [Best::default(); QUERIES_PER_BATCH];
        let best = &mut best[..known.len()];
        for (i, best) in best.iter_mut().enumerate() {
            let query = column(queries, i);
            *best = Best::new(tree, query, search);
            let leaf = match known[i].image {
                Some(position) => position as usize / LANES,
                None => leaf_with_nearest_centre(tree, query),
            };
            best.measure(tree, leaf, query, 1.0);
            // In a whole search they only help to see sooner what need not be measured.
            for near in &known[i].near {
                if *near as usize != leaf {
                    best.measure(tree, *near as usize, query, 1.0);
                }
            }
        }
        match search {
            Search::Whole => search_everywhere(tree, queries, best, None),
            Search::WholeRemembering => {
                let mut near = vec![Vec::new(); best.len()];
                search_everywhere(tree, queries, best, Some((REMEMBERED_REACH, &mut near)));
                for (known, near) in known.iter_mut().zip(&mut near) {
                    known.remember(near, LEAVES_PER_QUERY);
                }
            }
            Search::Candidates => {
                let mut near = vec![Vec::new(); best.len()];
                search_everywhere(tree, queries, best, Some((1.0, &mut near)));
                for ((known, near), best) in known.iter_mut().zip(&mut near).zip(&*best) {
                    near.retain(|&(distance, _)| distance <= best.reach);
                    known.remember(near, usize::MAX);
                }
            }
            Search::Remembered => {}
        }
        for (known, best) in known.iter_mut().zip(best) {
            known.image = Some(best.position);
        }
    }
}

/// Distance and number of leaves that came near to a query.
type Near = Vec<(f64, u32)>;

impl Known {
    fn remember(&mut self, near: &mut Near, at_most: usize) {
        let nearer = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if near.len() > at_most {
            near.select_nth_unstable_by(at_most, nearer);
            near.truncate(at_most);
        }
        near.sort_unstable_by(nearer);
        self.near.clear();
        self.near.extend(near.iter().map(|&(_, leaf)| leaf));
    }
}

/// Goes through all balls that come near enough to some query, and notes what comes within so many
/// times its reach.
#[inline(always)]
fn search_everywhere<T: Scalar>(
    tree: &BallTree<T>,
    queries: MatRef<'_, T>,
    best: &mut [Best],
    mut near: Option<(f64, &mut Vec<Near>)>,
) {
    let further = near.as_ref().map_or(1.0, |(further, _)| *further);
    let (centre, reach) = ball_around(queries, best, further);
    for groups in 0..tree.groups.len().div_ceil(LANES) {
        let in_reach = tree.groups.in_reach(groups, &centre, reach);
        for group in (0..LANES).filter(|&lane| in_reach[lane]) {
            for block in tree.blocks_of(groups * LANES + group) {
                let wanted = tree.leaves.in_reach(block, &centre, reach);
                if !wanted.contains(&true) {
                    continue;
                }
                for (i, best) in best.iter_mut().enumerate() {
                    let query = column(queries, i);
                    let in_reach = tree.leaves.in_reach(block, query, further * best.reach);
                    for lane in 0..LANES {
                        if !(wanted[lane] && in_reach[lane]) {
                            continue;
                        }
                        let leaf = block * LANES + lane;
                        let distance = best.measure(tree, leaf, query, further);
                        if let Some((_, near)) = &mut near
                            && distance <= further * best.reach
                        {
                            near[i].push((distance, leaf as u32));
                        }
                    }
                }
            }
        }
    }
}

/// A ball around all queries that holds their nearest rows too, and what lies that much further.
#[inline(always)]
fn ball_around<T: Scalar>(queries: MatRef<'_, T>, best: &[Best], further: f64) -> (Vec<T>, f64) {
    let mut centre = vec![0.0; queries.nrows()];
    for i in 0..queries.ncols() {
        for (c, x) in centre.iter_mut().zip(column(queries, i)) {
            *c += x.wide() / queries.ncols() as f64;
        }
    }
    let centre: Vec<T> = centre.into_iter().map(T::of).collect();
    let mut reach = 0.0;
    for (i, best) in best.iter().enumerate() {
        let pairs = centre.iter().zip(column(queries, i));
        let squares = pairs.map(|(c, x)| (c.wide() - x.wide()).powi(2));
        let own = squares.sum::<f64>().sqrt();
        let sum = (own + further * best.reach) * (1.0 + T::BOUND_SLACK);
        reach = if sum > reach { sum } else { reach };
    }
    (centre, reach)
}

/// The leaf with the nearest centre in the group with the nearest centre.
#[inline(always)]
fn leaf_with_nearest_centre<T: Scalar>(tree: &BallTree<T>, query: &[T]) -> usize {
    let mut group = (f64::INFINITY, 0);
    for block in 0..tree.groups.len().div_ceil(LANES) {
        let found = tree.groups.nearest_centre(block, query);
        group = if found.0 < group.0 { found } else { group };
    }
    let mut leaf = (f64::INFINITY, 0);
    for block in tree.blocks_of(group.1) {
        let found = tree.leaves.nearest_centre(block, query);
        leaf = if found.0 < leaf.0 { found } else { leaf };
    }
    leaf.1
}

impl<T: Scalar> Balls<T> {
    /// Which of eight balls come within `reach` of a point.
    #[inline(always)]
    fn in_reach(&self, block: usize, point: &[T], reach: f64) -> [bool; LANES] {
        let first = block * LANES;
        let radii = &self.radii[first..(first + LANES).min(self.len())];
        let mut largest = 0.0;
        for radius in radii {
            largest = if *radius > largest { *radius } else { largest };
        }
        let enough = (reach + largest) * (reach + largest);
        let squared = self.centres.squared_distances(block, point, enough);
        let mut in_reach = [false; LANES];
        for (lane, radius) in radii.iter().enumerate() {
            in_reach[lane] = squared[lane].wide() <= (reach + radius) * (reach + radius);
        }
        in_reach
    }

    /// The nearest of eight centres: squared distance and number.
    #[inline(always)]
    fn nearest_centre(&self, block: usize, point: &[T]) -> (f64, usize) {
        let squared = self.centres.squared_distances(block, point, f64::INFINITY);
        let mut nearest = (f64::INFINITY, block * LANES);
        for (lane, distance) in squared.map(T::wide).into_iter().enumerate() {
            if distance < nearest.0 && block * LANES + lane < self.len() {
                nearest = (distance, block * LANES + lane);
            }
        }
        nearest
    }
}

/// The nearest row so far.
#[derive(Clone, Copy, Default)]
struct Best {
    squared_distance: f64,
    position: u32,
    /// The distance with room for rounding: what is known to lie beyond cannot matter.
    reach: f64,
    slack: f64,
}

impl Best {
    #[inline(always)]
    fn new<T: Scalar>(tree: &BallTree<T>, query: &[T], search: Search) -> Self {
        // Bounds are only needed where something is left out.
        let is_whole = search != Search::Remembered;
        let query = if is_whole { query } else { &[] };
        let norm = query.iter().map(|x| x.wide().powi(2)).sum::<f64>().sqrt();
        // Two distances and a bound are rounded where candidates are asked for, else the bound.
        let times = if search == Search::Candidates {
            3.0
        } else {
            1.0
        };
        Self {
            squared_distance: f64::INFINITY,
            position: 0,
            reach: f64::INFINITY,
            slack: times * T::BOUND_SLACK * (norm + tree.largest_norm),
        }
    }

    /// Measures the rows of a leaf, to the end only if one of them is within `further` times the
    /// reach; returns a lower bound on their distance, up to there the distance itself.
    #[inline(always)]
    fn measure<T: Scalar>(
        &mut self,
        tree: &BallTree<T>,
        leaf: usize,
        query: &[T],
        further: f64,
    ) -> f64 {
        let enough = further * self.reach;
        let squared = tree.rows.squared_distances(leaf, query, enough * enough);
        let smallest = smallest_of(&squared).wide();
        if smallest > self.squared_distance {
            return smallest.sqrt();
        }
        for (lane, value) in squared.map(T::wide).into_iter().enumerate() {
            let position = leaf * LANES + lane;
            if position >= tree.n_rows() {
                break;
            }
            let tie = value <= self.squared_distance
                && tree.order[position] < tree.order[self.position as usize];
            if value < self.squared_distance || tie {
                self.squared_distance = value;
                self.position = position as u32;
            }
        }
        self.reach = self.squared_distance.sqrt() + self.slack;
        smallest.sqrt()
    }
}

/// A column as a slice; all matrices here are stored by columns.
#[inline(always)]
fn column<T>(columns: MatRef<'_, T>, j: usize) -> &[T] {
    let column = columns.col(j).try_as_col_major();
    debug_assert!(column.is_some(), "matrices are stored by columns");
    column.map_or(&[], |column| column.as_slice())
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
        // Differences of 1e-3 at 1e6: |q|² - 2 q·r + |r|² would have lost them.
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
