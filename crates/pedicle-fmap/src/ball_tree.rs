//! A ball tree over rows that are carried from step to step.
//!
//! ```text
//! r(x) = C Φ(x, ·)             k_target coordinates, one row a source vertex
//! leaf = 8 rows,  group = 16 leaves,     every row of a run lies within `radius` of its centre
//! ```
//!
//! The rows are halved along the line between two rows far apart until a leaf is left; of the
//! tree only the two lowest levels are kept. Which rows are neighbours is decided once, by the
//! first columns of Φ; the balls are laid anew in every step.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use rayon::prelude::*;

use crate::{
    lanes::{Batches, LANES, Leaves},
    scalar::Scalar,
};

/// Leaves in a group, a whole number of lanes.
const LEAVES_PER_GROUP: usize = 16;
/// Columns that decide the order: low frequencies already tell places apart.
const ORDERING_COLUMNS: usize = 32;
/// Below this many rows a half is not worth a task of its own.
const ROWS_PER_TASK: usize = 2048;

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct BallTree<T> {
    /// The row at every position.
    pub(crate) order: Vec<u32>,
    /// Φ by position.
    pub(crate) functions: Batches<T>,
    /// The rows as they are now, by position.
    pub(crate) rows: Leaves<T>,
    /// Norm of the longest row.
    pub(crate) largest_norm: f64,
    /// Around leaves.
    pub(crate) leaves: Balls<T>,
    /// Around groups.
    pub(crate) groups: Balls<T>,
}

/// Whether the balls are laid anew around carried rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CarryBalls {
    /// They are.
    Yes,
    /// They are out of date until the next time.
    No,
}

/// Balls around runs of positions.
#[derive(Debug, Clone)]
pub(crate) struct Balls<T> {
    /// Means of the rows.
    pub(crate) centres: Leaves<T>,
    /// Farthest row from the centre.
    pub(crate) radii: Vec<f64>,
}

impl<T: Scalar> BallTree<T> {
    /// The rows of an n × k matrix in an order in which neighbours stand side by side, times a
    /// factor, to be carried to at most `n_coordinates`.
    pub(crate) fn new(
        matrix: MatRef<'_, f64>,
        order: Vec<u32>,
        factor: f64,
        n_coordinates: usize,
    ) -> Self {
        let n = order.len();
        let n_leaves = n.div_ceil(LANES);
        Self {
            functions: Batches::from_rows(matrix, &order, factor),
            rows: Leaves::zeros(n, n_coordinates),
            largest_norm: 0.0,
            leaves: Balls::new(n_leaves, n_coordinates),
            groups: Balls::new(n_leaves.div_ceil(LEAVES_PER_GROUP), n_coordinates),
            order,
        }
    }

    /// Rows that stay where they are, in an order in which neighbours stand side by side.
    pub(crate) fn at_rest(matrix: MatRef<'_, f64>, order: Vec<u32>) -> Self {
        let rows = Leaves::from_rows(matrix, &order, 1.0);
        let mut tree = Self::new(matrix.subcols(0, 0), order, 1.0, matrix.ncols());
        tree.rows = rows;
        tree.lay_balls(matrix.ncols());
        tree
    }

    /// Number of rows.
    pub(crate) fn n_rows(&self) -> usize {
        self.order.len()
    }

    /// The leaves of a group, in blocks of eight.
    pub(crate) fn blocks_of(&self, group: usize) -> std::ops::Range<usize> {
        let blocks = LEAVES_PER_GROUP / LANES;
        let n_blocks = self.leaves.len().div_ceil(LANES);
        group * blocks..((group + 1) * blocks).min(n_blocks)
    }

    /// Carries all rows by C, n_target × n_source. Balls that nobody will ask for stay where they
    /// were.
    pub(crate) fn carry(&mut self, map: MatRef<'_, T>, with: CarryBalls) {
        let (n_target, n_source) = map.shape();
        let functions = &self.functions;
        self.rows.fill_batches(n_target, |batch, out| {
            let phi = functions.batch(batch).subcols(0, n_source);
            let map = map.transpose();
            matmul(out, Accum::Replace, phi, map, T::of(1.0), Par::Seq);
        });
        if with == CarryBalls::Yes {
            self.lay_balls(n_target);
        }
    }

    /// Takes the rows of a tree of the same order and size, times a factor.
    pub(crate) fn round(&mut self, exact: &BallTree<f64>, factor: f64, n_coordinates: usize) {
        self.rows.round(&exact.rows, factor);
        self.lay_balls(n_coordinates);
    }

    /// Lays balls around the rows as they are.
    pub(crate) fn lay_balls(&mut self, n_coordinates: usize) {
        let rows = &self.rows;
        let balls = |run: usize, count: usize| -> Vec<Ball> {
            let balls = (0..count).into_par_iter();
            let range = |i: usize| i * run..((i + 1) * run).min(rows.n_rows());
            balls.map(|i| ball(rows, n_coordinates, range(i))).collect()
        };
        let of_leaves = balls(LANES, self.leaves.len());
        let of_groups = balls(LANES * LEAVES_PER_GROUP, self.groups.len());
        let norms = of_leaves.iter().map(|ball| ball.largest_norm);
        self.largest_norm = norms.fold(0.0, more);
        self.leaves.set(&of_leaves);
        self.groups.set(&of_groups);
    }
}

impl<T: Scalar> Balls<T> {
    fn new(count: usize, n_coordinates: usize) -> Self {
        Self {
            centres: Leaves::zeros(count, n_coordinates),
            radii: vec![0.0; count],
        }
    }

    /// Number of balls.
    pub(crate) fn len(&self) -> usize {
        self.radii.len()
    }

    fn set(&mut self, balls: &[Ball]) {
        for (i, ball) in balls.iter().enumerate() {
            for (j, c) in ball.centre.iter().enumerate() {
                self.centres.set(i, j, T::of(*c));
            }
            self.radii[i] = ball.radius;
        }
    }
}

struct Ball {
    centre: Vec<f64>,
    radius: f64,
    largest_norm: f64,
}

/// The ball around a run of rows that begins with a leaf, with room for the rounding of its centre.
fn ball<T: Scalar>(rows: &Leaves<T>, n_coordinates: usize, run: std::ops::Range<usize>) -> Ball {
    let share = 1.0 / run.len() as f64;
    let leaves = run.start / LANES..run.end.div_ceil(LANES);
    let mut centre = vec![0.0; n_coordinates];
    let mut largest_norm = 0.0;
    for leaf in leaves.clone() {
        let used = LANES.min(run.end - leaf * LANES);
        let mut norms = [0.0; LANES];
        for (c, row) in centre.iter_mut().zip(rows.leaf(leaf, n_coordinates)) {
            let row = row.map(T::wide);
            *c += share * row[..used].iter().sum::<f64>();
            for lane in 0..LANES {
                norms[lane] += row[lane] * row[lane];
            }
        }
        largest_norm = norms.into_iter().fold(largest_norm, more);
    }
    centre.iter_mut().for_each(|c| *c = T::of(*c).wide());
    let mut radius = 0.0;
    for leaf in leaves {
        let mut squared = [0.0; LANES];
        for (c, row) in centre.iter().zip(rows.leaf(leaf, n_coordinates)) {
            let row = row.map(T::wide);
            for lane in 0..LANES {
                squared[lane] += (row[lane] - c) * (row[lane] - c);
            }
        }
        radius = squared.into_iter().fold(radius, more);
    }
    Ball {
        centre,
        radius: radius.sqrt(),
        largest_norm: largest_norm.sqrt(),
    }
}

fn more(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// An order of the rows in which every run of a leaf, and of a group, is compact.
pub(crate) fn neighbours_side_by_side(matrix: MatRef<'_, f64>) -> Vec<u32> {
    let (n, d) = matrix.shape();
    let deciding = matrix.subcols(0, d.min(ORDERING_COLUMNS));
    let points = deciding.transpose().to_owned();
    let mut order: Vec<u32> = (0..n as u32).collect();
    halve(&points, &mut order);
    order
}

/// Halves columns until a leaf is left, groups first, so that leaves never straddle groups.
fn halve(points: &Mat<f64>, order: &mut [u32]) {
    let n = order.len();
    let group = LANES * LEAVES_PER_GROUP;
    let unit = if n > group { group } else { LANES };
    let middle = n.div_ceil(unit) / 2 * unit;
    if middle == 0 {
        return;
    }
    let column = |p: u32| points.col_as_slice(p as usize);
    let far_from = |anchor: u32| -> u32 {
        let mut farthest = (anchor, -1.0);
        for &p in order.iter() {
            let pairs = column(p).iter().zip(column(anchor));
            let distance = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
            if distance > farthest.1 {
                farthest = (p, distance);
            }
        }
        farthest.0
    };
    let one = far_from(order[0]);
    let other = far_from(one);
    let line = column(one).iter().zip(column(other));
    let direction: Vec<f64> = line.map(|(a, b)| a - b).collect();
    let mut keyed: Vec<(f64, u32)> = order
        .iter()
        .map(|&p| {
            let pairs = column(p).iter().zip(&direction);
            (pairs.map(|(x, d)| x * d).sum(), p)
        })
        .collect();
    keyed.select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (slot, (_, p)) in order.iter_mut().zip(keyed) {
        *slot = p;
    }
    let (left, right) = order.split_at_mut(middle);
    if n > ROWS_PER_TASK {
        rayon::join(|| halve(points, left), || halve(points, right));
    } else {
        halve(points, left);
        halve(points, right);
    }
}
