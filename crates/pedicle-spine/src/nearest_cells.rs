//! Cubic cells that know a vertex near their middle: where the search for the nearest vertex starts.
//!
//! ```text
//! v(cell) ≈ argmin over vertices of |vertex - middle(cell)|
//! ```
//!
//! Filled by sweeps over the grid in which a cell takes over the vertex of a neighbour if that one is
//! nearer to its own middle (the vector distance transform of Danielsson 1980). The sweeps may miss the
//! nearest vertex by a little; whoever asks walks on from there. Lengths in mm, source frame.

use nalgebra::{Point3, Vector3};

use crate::cell_grid::CellGrid;

/// Edge of a cell, mm: about the edge of a face of a surface from a CT.
const CELL_MM: f64 = 1.5;
/// A cell that no vertex has reached.
const EMPTY: u32 = u32::MAX;
/// Most cells; a larger grid has larger cells.
const MAX_CELLS: f64 = 4e6;

/// The grid around one surface.
#[derive(Debug)]
pub(crate) struct NearestCells {
    grid: CellGrid,
    vertex: Vec<u32>,
}

impl NearestCells {
    /// Fills the grid. There must be a vertex.
    pub(crate) fn new(vertices: &[Point3<f64>]) -> Self {
        let grid = CellGrid::around(vertices, CELL_MM, MAX_CELLS);
        let mut cells = Self {
            vertex: vec![EMPTY; grid.n_cells()],
            grid,
        };
        for (v, p) in vertices.iter().enumerate() {
            if let Some(cell) = cells.grid.cell_of(p) {
                cells.offer(cell, v as u32, vertices);
            }
        }
        cells.sweep(vertices);
        cells
    }

    /// A vertex near a point; none outside the grid.
    pub(crate) fn vertex_near(&self, point: &Point3<f64>) -> Option<u32> {
        let cell = self.grid.cell_of(point)?;
        Some(self.vertex[self.grid.index(cell)]).filter(|&v| v != EMPTY)
    }

    fn middle(&self, cell: [usize; 3]) -> Point3<f64> {
        let cells = Vector3::from_fn(|axis, _| cell[axis] as f64 + 0.5);
        self.grid.place(&cells)
    }

    /// Gives a vertex to a cell if it is nearer to its middle than the one it has.
    fn offer(&mut self, cell: [usize; 3], vertex: u32, vertices: &[Point3<f64>]) {
        let at = self.grid.index(cell);
        let own = self.vertex[at];
        if own == vertex {
            return;
        }
        let middle = self.middle(cell);
        let squared = |v: u32| (vertices[v as usize] - middle).norm_squared();
        if own == EMPTY || squared(vertex) < squared(own) {
            self.vertex[at] = vertex;
        }
    }

    /// Takes vertices over from the neighbours before and behind along each axis, to and fro.
    fn sweep(&mut self, vertices: &[Point3<f64>]) {
        let [nx, ny, nz] = self.grid.n;
        for is_forward in [true, false, true, false] {
            let order = |i: usize, n: usize| if is_forward { i } else { n - 1 - i };
            let before = |i: usize, n: usize| {
                if is_forward {
                    i.checked_sub(1)
                } else {
                    Some(i + 1).filter(|&next| next < n)
                }
            };
            for k in (0..nz).map(|k| order(k, nz)) {
                for j in (0..ny).map(|j| order(j, ny)) {
                    for i in (0..nx).map(|i| order(i, nx)) {
                        let others = [
                            before(i, nx).map(|i| (i, j, k)),
                            before(j, ny).map(|j| (i, j, k)),
                            before(k, nz).map(|k| (i, j, k)),
                            // Along the row also from behind: what a sweep along the other two axes
                            // brought spreads both ways.
                            if is_forward {
                                Some(i + 1)
                            } else {
                                i.checked_sub(1)
                            }
                            .filter(|&i| i < nx)
                            .map(|i| (i, j, k)),
                        ];
                        for (a, b, c) in others.into_iter().flatten() {
                            let vertex = self.vertex[self.grid.index([a, b, c])];
                            if vertex != EMPTY {
                                self.offer([i, j, k], vertex, vertices);
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell_grid::tests::{places, shell};

    #[test]
    fn the_vertex_of_a_cell_is_nearly_the_nearest() {
        let vertices = shell(4000);
        let cells = NearestCells::new(&vertices);
        let mut worst = 0.0;
        for p in places(3000, 28.0) {
            let near = cells.vertex_near(&p).unwrap();
            let least = vertices
                .iter()
                .map(|v| (v - p).norm())
                .fold(f64::INFINITY, f64::min);
            let excess = (vertices[near as usize] - p).norm() - least;
            worst = if excess > worst { excess } else { worst };
        }
        assert!(worst < 1.5 * CELL_MM, "{worst} mm farther than the nearest");
        assert_eq!(
            cells.vertex_near(&Point3::new(90.0, 0.0, 0.0)),
            None,
            "outside the grid"
        );
    }
}
