//! Rows in an order in which neighbours stand side by side, with balls around runs of them.
//!
//! ```text
//! leaf  = 8 rows,  group = 16 leaves,    |q - r| ≥ |q - centre| - radius  for every r of a run
//! ```
//!
//! The rows are halved along the line between two rows far apart, until a leaf is left (a balanced
//! ball tree, of which only the two lowest levels are kept). The first few columns decide the
//! order, and columns can be added later: centres are means, so those of fewer columns are parts
//! of those of more, and squared radii grow column by column.

use faer::{Mat, MatRef};

use crate::lanes::{LANES, Lanes};

/// Leaves in a group, a whole number of lanes.
const LEAVES_PER_GROUP: usize = 16;
/// Columns that decide the order: low frequencies already tell places apart.
const ORDERING_COLUMNS: usize = 32;
/// Below this many rows a half is not worth a task of its own.
const ROWS_PER_TASK: usize = 2048;

/// Rows of which the first `dimension` coordinates count.
#[derive(Debug, Clone)]
pub(crate) struct RowTree {
    /// The rows by position, a block a leaf.
    pub(crate) rows: Lanes,
    /// The row at every position.
    pub(crate) order: Vec<u32>,
    /// The position of every row.
    pub(crate) position: Vec<u32>,
    /// Coordinates in use.
    pub(crate) dimension: usize,
    /// Balls around the leaves.
    pub(crate) leaves: Balls,
    /// Balls around the groups of leaves.
    pub(crate) groups: Balls,
    /// Norm of the longest row over the coordinates in use.
    pub(crate) largest_norm: f64,
    squared_norms: Vec<f64>,
}

/// Balls around runs of equally many positions (the last run may be shorter).
#[derive(Debug, Clone)]
pub(crate) struct Balls {
    /// Positions in a run.
    run: usize,
    /// Means, one a row.
    pub(crate) centres: Lanes,
    /// Radius over the coordinates in use.
    pub(crate) radii: Vec<f64>,
    /// Squared distance of every position to the centre of its run.
    squared_distances: Vec<f64>,
}

impl RowTree {
    /// Orders the rows of an n × d matrix; no coordinate counts yet.
    pub(crate) fn new(matrix: MatRef<'_, f64>) -> Self {
        let (n, d) = matrix.shape();
        let order = neighbours_side_by_side(matrix);
        let mut position = vec![0; n];
        for (p, &row) in order.iter().enumerate() {
            position[row as usize] = p as u32;
        }
        let mut rows = Lanes::infinite(n, d);
        for j in 0..d {
            let column = matrix.col(j);
            for (p, &row) in order.iter().enumerate() {
                rows.set(p, j, column[row as usize]);
            }
        }
        let leaves = Balls::new(&rows, LANES);
        let groups = Balls::new(&rows, LANES * LEAVES_PER_GROUP);
        Self {
            rows,
            order,
            position,
            dimension: 0,
            leaves,
            groups,
            largest_norm: 0.0,
            squared_norms: vec![0.0; n],
        }
    }

    /// Number of rows.
    pub(crate) fn n_rows(&self) -> usize {
        self.order.len()
    }

    /// The leaves of a group, a whole number of blocks of their centres.
    pub(crate) fn leaves_of(&self, group: usize) -> std::ops::Range<usize> {
        let first = group * LEAVES_PER_GROUP;
        first..(first + LEAVES_PER_GROUP).min(self.leaves.radii.len())
    }

    /// Lets the first `dimension` coordinates count, at least as many as before.
    pub(crate) fn grow_to(&mut self, dimension: usize) {
        let (from, to) = (self.dimension, dimension);
        debug_assert!(from <= to && to <= self.rows.dimension(), "it grows");
        for (p, norm) in self.squared_norms.iter_mut().enumerate() {
            for j in from..to {
                *norm += self.rows.get(p, j).powi(2);
            }
            self.largest_norm = self.largest_norm.max(norm.sqrt());
        }
        self.leaves.grow(&self.rows, from..to);
        self.groups.grow(&self.rows, from..to);
        self.dimension = to;
    }
}

impl Balls {
    fn new(rows: &Lanes, run: usize) -> Self {
        let n = rows.n_rows();
        let n_runs = n.div_ceil(run);
        let mut centres = Lanes::infinite(n_runs, rows.dimension());
        for i in 0..n_runs {
            let positions = i * run..((i + 1) * run).min(n);
            for j in 0..rows.dimension() {
                let sum: f64 = positions.clone().map(|p| rows.get(p, j)).sum();
                centres.set(i, j, sum / positions.len() as f64);
            }
        }
        Self {
            run,
            centres,
            radii: vec![0.0; n_runs],
            squared_distances: vec![0.0; n],
        }
    }

    fn grow(&mut self, rows: &Lanes, columns: std::ops::Range<usize>) {
        for (i, distances) in self.squared_distances.chunks_mut(self.run).enumerate() {
            let mut largest = 0.0_f64;
            for (offset, distance) in distances.iter_mut().enumerate() {
                for j in columns.clone() {
                    let row = rows.get(i * self.run + offset, j);
                    *distance += (row - self.centres.get(i, j)).powi(2);
                }
                largest = largest.max(*distance);
            }
            self.radii[i] = largest.sqrt();
        }
    }
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
