//! Cubic cells around a surface, by their places and numbers. Lengths in mm, source frame.

use nalgebra::{Point3, Vector3};

/// The grid reaches this far beyond the vertices, mm: most gates of a search; farther points are asked of a tree.
pub(crate) const MARGIN_MM: f64 = 16.0;

/// Where the cells are.
#[derive(Debug)]
pub(crate) struct CellGrid {
    low: Point3<f64>,
    cell_mm: f64,
    /// Cells along each axis.
    pub(crate) n: [usize; 3],
}

impl CellGrid {
    /// Around some vertices, at least one, with edges of `edge_mm`, or longer where there would be more than `max_cells`.
    pub(crate) fn around(vertices: &[Point3<f64>], edge_mm: f64, max_cells: f64) -> Self {
        let (mut low, mut high) = (vertices[0].coords, vertices[0].coords);
        for p in vertices {
            (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
        }
        let margin = Vector3::repeat(MARGIN_MM);
        let low = Point3::from(low - margin);
        let size = Point3::from(high + margin) - low;
        let least = (size.product() / max_cells).cbrt();
        let cell_mm = if least > edge_mm { least } else { edge_mm };
        Self {
            low,
            cell_mm,
            n: [0, 1, 2].map(|k| (size[k] / cell_mm) as usize + 1),
        }
    }

    pub(crate) fn n_cells(&self) -> usize {
        self.n.iter().product()
    }

    /// Number of a cell, along the first axis first.
    pub(crate) fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.n[1] + j) * self.n[0] + i
    }

    /// The cell of a point; none outside.
    pub(crate) fn cell_of(&self, point: &Point3<f64>) -> Option<[usize; 3]> {
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

    /// The place that lies so many cells from the corner of the grid.
    pub(crate) fn place(&self, cells: &Vector3<f64>) -> Point3<f64> {
        self.low + cells * self.cell_mm
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A bumpy shell of about 20 mm.
    pub(crate) fn shell(n: u32) -> Vec<Point3<f64>> {
        (0..n)
            .map(|i| {
                let t = f64::from(i) * 2.399_963;
                let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(n);
                let r = 20.0 + 3.0 * (5.0 * t).sin() * z;
                let w = (1.0 - z * z).sqrt();
                Point3::new(r * w * t.cos(), r * w * t.sin(), r * z)
            })
            .collect()
    }

    /// Places within `reach_mm` of the middle along each axis.
    pub(crate) fn places(n: u32, reach_mm: f64) -> impl Iterator<Item = Point3<f64>> {
        (0..n).map(move |i| {
            let t = f64::from(i) * 0.37;
            Point3::new(t.sin(), (1.7 * t).cos(), (0.6 * t).sin()) * reach_mm
        })
    }

    #[test]
    fn cells_hold_their_points_and_nothing_lies_outside() {
        let grid = CellGrid::around(&shell(500), 1.5, 1e6);
        for p in places(1000, 33.0) {
            let cell = grid.cell_of(&p).unwrap();
            let low = grid.place(&Vector3::from_fn(|k, _| cell[k] as f64));
            let offset = (p - low) / grid.cell_mm;
            assert!(offset.min() >= -1e-9 && offset.max() <= 1.0 + 1e-9, "{p}");
            assert!(grid.index(cell) < grid.n_cells());
        }
        assert_eq!(grid.cell_of(&Point3::new(90.0, 0.0, 0.0)), None, "outside");
        assert_eq!(
            grid.cell_of(&Point3::new(f64::NAN, 0.0, 0.0)),
            None,
            "nowhere"
        );
        let few = CellGrid::around(&shell(500), 1.5, 100.0);
        assert!(few.n_cells() <= 1000, "{} cells", few.n_cells());
    }
}
