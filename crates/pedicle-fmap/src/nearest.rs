//! Nearest rows: for every row q of one matrix the nearest row r of another, again and again.
//!
//! ```text
//! |q - r| ≥ |q - centre| - radius       for r in a ball
//! |q' - r| ≥ |q - r| - |q' - q|         for a query that has moved a little
//! ```
//!
//! A refinement asks the same question in every step, with queries that move little and rows that
//! gain coordinates, which only adds to distances. So every query keeps a short list of leaves
//! with a lower bound on its distance to each, and one bound for all others. In a step the bounds
//! shrink by how far the query has moved; the leaf of its last answer is measured, and of the
//! others those whose bound lies below the best distance so far: three to six of thousands. When
//! the bound for all others is used up, the tree of balls makes a new list. (Hamerly 2010 and Ding
//! et al. 2015 speed up k-means in this way.)
//!
//! The answer is that of an exhaustive search: distances are sums of squares, among equals the
//! lowest index wins, and it depends neither on what was known before nor on the number of threads.

use std::ops::Range;

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::{
    lanes::{LANES, smallest_of, squared_distance},
    row_tree::{Balls, RowTree, neighbours_side_by_side},
};

/// Queries that are searched for together.
pub(crate) const QUERIES_PER_BATCH: usize = 32;
/// Leaves on a list at most.
const LEAVES_PER_LIST: usize = 48;
/// A list reaches this many times the distance to the nearest row.
const LIST_REACH: f64 = 3.0;
/// Relative room for rounding in bounds; far above d ε, far below what the bounds gain.
const BOUND_SLACK: f64 = 1e-10;

/// For every row of `queries` the index of the nearest row of `references`.
///
/// Both matrices are finite and have the same number of columns; there is a reference.
pub(crate) fn nearest_rows(queries: MatRef<'_, f64>, references: MatRef<'_, f64>) -> Vec<u32> {
    debug_assert_eq!(queries.ncols(), references.ncols(), "same dimension");
    debug_assert!(references.nrows() > 0, "something to choose from");
    let mut tree = RowTree::new(references);
    tree.grow_to(queries.ncols());
    let order = neighbours_side_by_side(queries);
    // Points as columns: contiguous.
    let queries = Mat::from_fn(queries.ncols(), order.len(), |j, i| {
        queries[(order[i] as usize, j)]
    });
    let arch = pulp::Arch::new();
    let mut found = vec![0; order.len()];
    found
        .par_chunks_mut(QUERIES_PER_BATCH)
        .enumerate()
        .for_each_init(Scratch::default, |scratch, (batch, found)| {
            let first = batch * QUERIES_PER_BATCH;
            let queries = queries.subcols(first, found.len());
            arch.dispatch(OneSearch {
                tree: &tree,
                queries,
                found,
                scratch,
            });
        });
    let mut rows = vec![0; order.len()];
    for (&query, found) in order.iter().zip(found) {
        rows[query as usize] = found;
    }
    rows
}

/// A search without a past.
struct OneSearch<'a> {
    tree: &'a RowTree,
    /// One a column.
    queries: MatRef<'a, f64>,
    found: &'a mut [u32],
    scratch: &'a mut Scratch,
}

impl pulp::WithSimd for OneSearch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        for (i, slot) in self.found.iter_mut().enumerate() {
            let column = self.queries.col(i).try_as_col_major();
            let query = column.map_or(&[][..], |column| column.as_slice());
            let best = nearest_by_balls(self.tree, query, None, self.scratch);
            *slot = self.tree.order[best.position as usize];
        }
    }
}

/// What is known of one query.
#[derive(Debug, Clone, Default)]
pub(crate) struct Known {
    /// Position of the nearest row.
    pub(crate) image: Option<u32>,
    /// Coordinates when the list was made; none without a list.
    n_coordinates: usize,
    /// Leaves in the order of their bounds.
    leaves: Vec<u32>,
    /// For each a lower bound on the distance of its rows.
    bounds: Vec<f64>,
    /// A lower bound on the distance of the rows of all other leaves.
    rest: f64,
}

/// Room for a search, kept from query to query.
#[derive(Default)]
pub(crate) struct Scratch {
    /// Lower bound and number of the leaves looked at.
    leaves: Vec<(f64, u32)>,
    /// Lower bounds of the groups.
    groups: Vec<f64>,
    /// Lower bounds of the leaves of one group.
    members: Vec<f64>,
}

impl Known {
    /// Takes an image, as if nothing else were known.
    pub(crate) fn at(image: u32) -> Self {
        Self {
            image: Some(image),
            ..Self::default()
        }
    }

    /// Finds the nearest row to a query; `origin` is where it stood when its list was made.
    #[inline(always)]
    pub(crate) fn update(
        &mut self,
        tree: &RowTree,
        query: &[f64],
        origin: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let own = self.image.map(|image| image as usize / LANES);
        if let Some(own) = own
            && self.n_coordinates > 0
        {
            let (now, then) = (&query[..self.n_coordinates], &origin[..self.n_coordinates]);
            let movement = squared_distance(now, then).sqrt();
            let mut best = Best::new(tree, query);
            best.measure(tree, own, query, f64::INFINITY);
            if self.rest > best.reach + movement {
                for (&leaf, &bound) in self.leaves.iter().zip(&self.bounds) {
                    if bound > best.reach + movement {
                        break;
                    }
                    if leaf as usize != own {
                        best.measure(tree, leaf as usize, query, best.reach);
                    }
                }
                self.image = Some(best.position);
                return;
            }
        }
        let best = nearest_by_balls(tree, query, own, scratch);
        self.image = Some(best.position);
        self.make_list(tree, query, best.reach, scratch);
        self.n_coordinates = query.len();
        origin[..query.len()].copy_from_slice(query);
    }

    /// Makes a list of the leaves up to some distance beyond the nearest row.
    #[inline(always)]
    fn make_list(&mut self, tree: &RowTree, query: &[f64], reach: f64, scratch: &mut Scratch) {
        let wanted = LIST_REACH * reach;
        self.rest = wanted;
        for group in 0..tree.groups.radii.len() {
            let bound = scratch.groups[group];
            // What lies within reach has been looked at.
            if bound > reach && bound <= wanted {
                let range = tree.leaves_of(group);
                lower_bounds(
                    &tree.leaves,
                    range.clone(),
                    (query, wanted),
                    &mut scratch.members,
                );
                for (leaf, &bound) in range.zip(&scratch.members) {
                    scratch.leaves.push((bound, leaf as u32));
                }
            }
        }
        let listed = &mut scratch.leaves;
        listed.retain(|&(bound, _)| bound <= wanted);
        for (bound, leaf) in listed.iter_mut() {
            if *bound > reach {
                let squared = tree
                    .rows
                    .squared_distances(*leaf as usize, query, wanted * wanted);
                *bound = smallest_of(&squared).sqrt();
            }
        }
        listed.retain(|&(bound, _)| bound <= wanted);
        let before = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if listed.len() > LEAVES_PER_LIST {
            listed.select_nth_unstable_by(LEAVES_PER_LIST, before);
            self.rest = listed[LEAVES_PER_LIST].0;
            listed.truncate(LEAVES_PER_LIST);
        }
        listed.sort_unstable_by(before);
        self.leaves.clear();
        self.bounds.clear();
        self.leaves.extend(listed.iter().map(|&(_, leaf)| leaf));
        self.bounds.extend(listed.iter().map(|&(bound, _)| bound));
    }
}

/// The nearest row, by balls alone; `scratch` keeps the bounds of what was looked at.
#[inline(always)]
fn nearest_by_balls(
    tree: &RowTree,
    query: &[f64],
    guess: Option<usize>,
    scratch: &mut Scratch,
) -> Best {
    let n_groups = tree.groups.radii.len();
    lower_bounds(
        &tree.groups,
        0..n_groups,
        (query, f64::INFINITY),
        &mut scratch.groups,
    );
    let first = guess.unwrap_or_else(|| {
        let group = lowest(&scratch.groups);
        let range = tree.leaves_of(group);
        lower_bounds(
            &tree.leaves,
            range.clone(),
            (query, f64::INFINITY),
            &mut scratch.members,
        );
        range.start + lowest(&scratch.members)
    });
    let mut best = Best::new(tree, query);
    let own_bound = best.measure(tree, first, query, f64::INFINITY);
    scratch.leaves.clear();
    for group in 0..n_groups {
        let bound = scratch.groups[group];
        if bound > best.reach {
            continue;
        }
        let range = tree.leaves_of(group);
        let enough = LIST_REACH * best.reach;
        lower_bounds(
            &tree.leaves,
            range.clone(),
            (query, enough),
            &mut scratch.members,
        );
        for (leaf, &bound) in range.zip(&scratch.members) {
            let bound = if leaf == first {
                own_bound
            } else if bound <= best.reach {
                best.measure(tree, leaf, query, LIST_REACH * best.reach)
            } else {
                bound
            };
            scratch.leaves.push((bound, leaf as u32));
        }
        // Looked at, so not to be looked at again when the list is made.
        scratch.groups[group] = f64::NEG_INFINITY;
    }
    best
}

/// Bounds |q - centre| - radius for a run of balls that begins with a block of centres; above
/// `enough` they may be lower than that.
#[inline(always)]
fn lower_bounds(
    balls: &Balls,
    run: Range<usize>,
    (query, enough): (&[f64], f64),
    out: &mut Vec<f64>,
) {
    out.clear();
    for first in run.clone().step_by(LANES) {
        let radii = &balls.radii[first..(first + LANES).min(run.end)];
        let largest = radii.iter().fold(0.0, |a, &b| if b > a { b } else { a });
        let enough = (enough + largest) * (enough + largest);
        let squared = balls
            .centres
            .squared_distances(first / LANES, query, enough);
        let pairs = squared.iter().zip(radii);
        out.extend(pairs.map(|(squared, radius)| squared.sqrt() - radius));
    }
}

#[inline(always)]
fn lowest(values: &[f64]) -> usize {
    let mut lowest = 0;
    for (i, value) in values.iter().enumerate() {
        if *value < values[lowest] {
            lowest = i;
        }
    }
    lowest
}

/// The nearest row so far.
#[derive(Clone, Copy)]
struct Best {
    squared_distance: f64,
    position: u32,
    /// The distance with room for rounding: what is known to lie beyond cannot matter.
    reach: f64,
    slack: f64,
}

impl Best {
    #[inline(always)]
    fn new(tree: &RowTree, query: &[f64]) -> Self {
        let norm = query.iter().map(|x| x * x).sum::<f64>().sqrt();
        Self {
            squared_distance: f64::INFINITY,
            position: 0,
            reach: f64::INFINITY,
            slack: BOUND_SLACK * (norm + tree.largest_norm),
        }
    }

    /// Measures the rows of a leaf: a lower bound on the distance of each of them.
    ///
    /// Leaves beyond `enough` are not measured to the end; within it the bound is the distance.
    #[inline(always)]
    fn measure(&mut self, tree: &RowTree, leaf: usize, query: &[f64], enough: f64) -> f64 {
        let squared = tree.rows.squared_distances(leaf, query, enough * enough);
        let smallest = smallest_of(&squared);
        if smallest <= self.squared_distance {
            for (lane, &value) in squared.iter().enumerate() {
                let position = leaf * LANES + lane;
                let tie = value <= self.squared_distance
                    && position < tree.n_rows()
                    && tree.order[position] < tree.order[self.position as usize];
                if value < self.squared_distance || tie {
                    self.squared_distance = value;
                    self.position = position as u32;
                }
            }
            self.reach = self.squared_distance.sqrt() + self.slack;
        }
        smallest.sqrt()
    }
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
