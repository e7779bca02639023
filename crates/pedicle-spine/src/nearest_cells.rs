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

/// Edge of a cell, mm: about the edge of a face of a surface from a CT.
const CELL_MM: f64 = 1.5;
/// The grid reaches this far beyond the surface, mm: about the widest gate of a search.
const MARGIN_MM: f64 = 16.0;
/// A cell that no vertex has reached.
const EMPTY: u32 = u32::MAX;
/// Most cells; a larger grid has larger cells.
const MAX_CELLS: f64 = 4e6;

/// The grid around one surface.
#[derive(Debug)]
pub(crate) struct NearestCells {
    low: Point3<f64>,
    cell_mm: f64,
    n: [usize; 3],
    vertex: Vec<u32>,
}

impl NearestCells {
    /// Fills the grid. There must be a vertex.
    pub(crate) fn new(vertices: &[Point3<f64>]) -> Self {
        let (mut low, mut high) = (vertices[0].coords, vertices[0].coords);
        for p in vertices {
            (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
        }
        let margin = Vector3::repeat(MARGIN_MM);
        let low = Point3::from(low - margin);
        let size = Point3::from(high + margin) - low;
        let least = (size.product() / MAX_CELLS).cbrt();
        let cell_mm = if least > CELL_MM { least } else { CELL_MM };
        let n = [0, 1, 2].map(|k| (size[k] / cell_mm) as usize + 1);
        let mut cells = Self {
            low,
            cell_mm,
            n,
            vertex: vec![EMPTY; n[0] * n[1] * n[2]],
        };
        for (v, p) in vertices.iter().enumerate() {
            if let Some(cell) = cells.cell_of(p) {
                cells.offer(cell, v as u32, vertices);
            }
        }
        cells.sweep(vertices);
        cells
    }

    /// A vertex near a point; none outside the grid.
    pub(crate) fn vertex_near(&self, point: &Point3<f64>) -> Option<u32> {
        let [i, j, k] = self.cell_of(point)?;
        Some(self.vertex[self.index(i, j, k)]).filter(|&v| v != EMPTY)
    }

    fn index(&self, i: usize, j: usize, k: usize) -> usize {
        (k * self.n[1] + j) * self.n[0] + i
    }

    fn cell_of(&self, point: &Point3<f64>) -> Option<[usize; 3]> {
        let mut cell = [0; 3];
        for (axis, place) in cell.iter_mut().enumerate() {
            let x = (point[axis] - self.low[axis]) / self.cell_mm;
            // Written so that NaN is outside.
            if !(x >= 0.0 && x < self.n[axis] as f64) {
                return None;
            }
            *place = x as usize;
        }
        Some(cell)
    }

    fn middle(&self, cell: [usize; 3]) -> Point3<f64> {
        self.low + Vector3::from_fn(|axis, _| (cell[axis] as f64 + 0.5) * self.cell_mm)
    }

    /// Gives a vertex to a cell if it is nearer to its middle than the one it has.
    fn offer(&mut self, cell: [usize; 3], vertex: u32, vertices: &[Point3<f64>]) {
        let at = self.index(cell[0], cell[1], cell[2]);
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
        let [nx, ny, nz] = self.n;
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
                            let vertex = self.vertex[self.index(a, b, c)];
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

    #[test]
    fn the_vertex_of_a_cell_is_nearly_the_nearest() {
        // A bumpy shell.
        let vertices: Vec<Point3<f64>> = (0..4000)
            .map(|i| {
                let t = f64::from(i) * 2.399_963;
                let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / 4000.0;
                let r = 20.0 + 3.0 * (5.0 * t).sin() * z;
                let w = (1.0 - z * z).sqrt();
                Point3::new(r * w * t.cos(), r * w * t.sin(), r * z)
            })
            .collect();
        let cells = NearestCells::new(&vertices);
        let mut worst = 0.0;
        for i in 0..3000 {
            let t = f64::from(i) * 0.37;
            let p = Point3::new(
                28.0 * t.sin(),
                28.0 * (1.7 * t).cos(),
                28.0 * (0.6 * t).sin(),
            );
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
        assert_eq!(
            cells.vertex_near(&Point3::new(f64::NAN, 0.0, 0.0)),
            None,
            "nowhere"
        );
    }
}
