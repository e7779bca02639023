//! Cubic cells that know every vertex that may be the nearest to a point of theirs.
//!
//! ```text
//! w is nowhere in the cell nearer than v   if   |m - w|² - |m - v|² > Σ_k e_k |w_k - v_k|
//! ```
//!
//! m is the middle of the cell, e its edges, v the vertex nearest to m: the left side is what the squared
//! distances differ by at m, the right side the most that this changes within the cell. Far from the surface
//! as near it only the few vertices are left whose foot points lie beside each other. The grid is halved
//! again and again, and every part hands on to its halves what is left in it, until that is little. Lengths in
//! mm, source frame.

use nalgebra::{Point3, Vector3};

use crate::cell_grid::CellGrid;

/// Smallest edge of a cell, mm.
const LEAST_CELL_MM: f64 = 1.5;
/// Most cells; a larger grid has larger cells.
const MAX_CELLS: f64 = 1e6;
/// So few vertices are looked through rather than told apart by smaller cells.
const FEW: usize = 6;
/// What rounding may do to squared distances, relative and mm².
const ROUNDING: f64 = 1e-9;

/// The grid around one surface.
#[derive(Debug)]
pub(crate) struct NearestVertices {
    grid: CellGrid,
    /// Begin and end of the vertices of every cell.
    ranges: Vec<[u32; 2]>,
    candidates: Vec<u32>,
}

impl NearestVertices {
    /// Fills the grid with cells of about the distance between vertices. There must be a vertex.
    pub(crate) fn new(vertices: &[Point3<f64>], spacing_mm: f64) -> Self {
        let edge_mm = if spacing_mm > LEAST_CELL_MM {
            spacing_mm
        } else {
            LEAST_CELL_MM
        };
        let grid = CellGrid::around(vertices, edge_mm, MAX_CELLS);
        let n = grid.n;
        let mut cells = Self {
            ranges: vec![[0; 2]; grid.n_cells()],
            grid,
            candidates: Vec::new(),
        };
        let all: Vec<u32> = (0..vertices.len() as u32).collect();
        cells.fill(vertices, [[0; 3], n], &all);
        cells
    }

    /// The vertex nearest to a point, the first of several, and its squared distance; none outside the grid.
    pub(crate) fn nearest(
        &self,
        point: &Point3<f64>,
        vertices: &[Point3<f64>],
    ) -> Option<(u32, f64)> {
        let [begin, end] = self.ranges[self.grid.index(self.grid.cell_of(point)?)];
        let mut best = (u32::MAX, f64::INFINITY);
        for &v in &self.candidates[begin as usize..end as usize] {
            let squared = (vertices[v as usize] - point).norm_squared();
            if squared < best.1 {
                best = (v, squared);
            }
        }
        Some(best)
    }

    /// Hands the vertices that matter within a box of cells on to its halves.
    fn fill(&mut self, vertices: &[Point3<f64>], [from, to]: [[usize; 3]; 2], given: &[u32]) {
        let left = self.left_in(vertices, [from, to], given);
        let length = |axis: usize| to[axis] - from[axis];
        let longest = if length(1) > length(0) { 1 } else { 0 };
        let longest = if length(2) > length(longest) {
            2
        } else {
            longest
        };
        if length(longest) == 1 || left.len() <= FEW {
            let begin = self.candidates.len() as u32;
            self.candidates.extend(left);
            let range = [begin, self.candidates.len() as u32];
            for k in from[2]..to[2] {
                for j in from[1]..to[1] {
                    let row = |i: usize| self.grid.index([i, j, k]);
                    let (first, last) = (row(from[0]), row(to[0]));
                    self.ranges[first..last].fill(range);
                }
            }
            return;
        }
        let middle = from[longest] + length(longest) / 2;
        let (mut end_of_first, mut begin_of_second) = (to, from);
        end_of_first[longest] = middle;
        begin_of_second[longest] = middle;
        self.fill(vertices, [from, end_of_first], &left);
        self.fill(vertices, [begin_of_second, to], &left);
    }

    /// Those of some vertices that may be the nearest to a point of a box of cells.
    fn left_in(
        &self,
        vertices: &[Point3<f64>],
        [from, to]: [[usize; 3]; 2],
        given: &[u32],
    ) -> Vec<u32> {
        let place = |cell: [usize; 3]| self.grid.place(&Vector3::from_fn(|k, _| cell[k] as f64));
        let (low, high) = (place(from), place(to));
        let middle = nalgebra::center(&low, &high);
        let edges = (high - low) * (1.0 + ROUNDING);
        let squared = |v: u32| (vertices[v as usize] - middle).norm_squared();
        let nearest = given.iter().fold((0, f64::INFINITY), |best, &v| {
            let own = squared(v);
            if own < best.1 { (v, own) } else { best }
        });
        let position = vertices[nearest.0 as usize];
        given
            .iter()
            .copied()
            .filter(|&w| {
                let farther = squared(w) - nearest.1;
                let changes = (vertices[w as usize] - position).abs().dot(&edges);
                farther <= changes + ROUNDING * (1.0 + nearest.1)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell_grid::tests::{places, shell};

    #[test]
    fn the_vertex_is_the_nearest_of_all() {
        let vertices = shell(1500);
        let cells = NearestVertices::new(&vertices, 2.0);
        for p in places(4000, 33.0) {
            let (_, found) = cells.nearest(&p, &vertices).unwrap();
            let least = vertices
                .iter()
                .map(|v| (v - p).norm_squared())
                .fold(f64::INFINITY, f64::min);
            assert!(found <= least, "{p}: {found} instead of {least}");
        }
        let far = Point3::new(90.0, 0.0, 0.0);
        assert_eq!(cells.nearest(&far, &vertices), None, "outside the grid");
        let most = cells
            .ranges
            .iter()
            .map(|[begin, end]| end - begin)
            .sum::<u32>();
        let per_cell = f64::from(most) / cells.ranges.len() as f64;
        assert!(per_cell < 20.0, "{per_cell} vertices a cell");
    }
}
