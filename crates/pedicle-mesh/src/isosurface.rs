//! The surface where samples on a regular grid change their sign, closed and manifold.
//!
//! ```text
//! { x : f(x) = 0 },   f < 0 inside
//! ```
//!
//! Surface nets put one vertex in a cell. Where two opposite corners of a cell's side lie inside
//! and the other two outside, or only two opposite corners of the cell differ from the rest, two
//! sheets would share that vertex or an edge: the surface would not be a manifold. This happens
//! along ridges that run obliquely through the grid, and between voxels that touch at an edge. The
//! corner nearest to the surface then changes its sign, which moves the surface by a fraction of a
//! cell. Gibson 1998, "Constrained elastic surface nets".

use fast_surface_nets::ndshape::RuntimeShape;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use nalgebra::Point3;

/// Passes over the grid before giving up.
const MAX_PASSES: usize = 40;
/// What a corner that changes its sign is set to, in the unit of the samples.
const FLIPPED: f32 = 1e-3;
/// The corners of the six sides of a cell, around each side; corner bits are x, y, z.
const SIDES: [[usize; 4]; 6] = [
    [0, 1, 3, 2],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [0, 2, 6, 4],
    [1, 3, 7, 5],
];

/// Samples on a regular grid, negative inside; x runs fastest.
#[derive(Debug, Clone)]
pub struct ScalarGrid {
    size: [u32; 3],
    samples: Vec<f32>,
}

/// Points in units of the grid's cells, sample (0, 0, 0) at the origin, and faces that look
/// outwards.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct IsoSurface {
    /// Vertices, in cells.
    pub points: Vec<Point3<f64>>,
    /// Corners of every face, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
}

impl IsoSurface {
    /// The volume inside, in cells: Σ a · (b × c) / 6.
    #[must_use]
    pub fn volume(&self) -> f64 {
        self.faces
            .iter()
            .map(|f| {
                let [a, b, c] = f.map(|v| self.points[v as usize].coords);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum()
    }
}

impl ScalarGrid {
    /// Takes the samples of a grid of `size` points.
    ///
    /// # Panics
    /// If there are not as many samples as the size says, or fewer than two along an axis.
    #[must_use]
    pub fn new(size: [u32; 3], samples: Vec<f32>) -> Self {
        let n: usize = size.iter().map(|&n| n as usize).product();
        assert_eq!(samples.len(), n, "one sample a point of the grid");
        assert!(size.iter().all(|&n| n > 1), "a grid has cells");
        Self { size, samples }
    }

    /// The surface where the samples change their sign. Where the outermost samples are all
    /// positive it is closed, and once ambiguous cells are resolved it is a manifold.
    #[must_use]
    pub fn surface(mut self) -> IsoSurface {
        self.disambiguate();
        let shape = RuntimeShape::<u32, 3>::new(self.size);
        let mut net = SurfaceNetsBuffer::default();
        let last = self.size.map(|n| n - 1);
        surface_nets(&self.samples, &shape, [0; 3], last, &mut net);
        let mut surface = IsoSurface {
            points: net
                .positions
                .iter()
                .map(|p| Point3::from(p.map(f64::from)))
                .collect(),
            faces: net.indices.as_chunks::<3>().0.to_vec(),
        };
        if surface.volume() < 0.0 {
            for face in &mut surface.faces {
                face.swap(1, 2);
            }
        }
        surface
    }

    /// Changes signs until no cell is ambiguous; the number of passes with a change.
    fn disambiguate(&mut self) -> usize {
        let [nx, ny, nz] = self.size.map(|n| n as usize);
        let offsets: [usize; 8] =
            std::array::from_fn(|c| (c & 1) + ((c >> 1) & 1) * nx + (c >> 2) * nx * ny);
        for pass in 0..MAX_PASSES {
            let mut changed = false;
            for z in 0..nz - 1 {
                for y in 0..ny - 1 {
                    for x in 0..nx - 1 {
                        let base = x + nx * (y + ny * z);
                        let corners = offsets.map(|offset| base + offset);
                        while let Some(corner) = self.ambiguous_corner(&corners) {
                            let sample = &mut self.samples[corner];
                            *sample = if *sample < 0.0 { FLIPPED } else { -FLIPPED };
                            changed = true;
                        }
                    }
                }
            }
            if !changed {
                return pass;
            }
        }
        MAX_PASSES
    }

    /// The corner to change if the cell is ambiguous: the one nearest to the surface.
    fn ambiguous_corner(&self, corners: &[usize; 8]) -> Option<usize> {
        let inside = corners.map(|c| self.samples[c] < 0.0);
        let n_inside = inside.iter().filter(|&&i| i).count();
        if n_inside == 0 || n_inside == 8 {
            return None;
        }
        let nearest = |candidates: &[usize]| {
            candidates
                .iter()
                .map(|&c| corners[c])
                .min_by(|&a, &b| self.samples[a].abs().total_cmp(&self.samples[b].abs()))
        };
        for side in &SIDES {
            let [a, b, c, d] = side.map(|corner| inside[corner]);
            if a == c && b == d && a != b {
                // A corner that was changed before stays: its value is the smallest by far.
                let fresh: Vec<usize> = side
                    .iter()
                    .copied()
                    .filter(|&s| self.samples[corners[s]].abs() > FLIPPED)
                    .collect();
                return nearest(if fresh.is_empty() { side } else { &fresh });
            }
        }
        if n_inside == 2 || n_inside == 6 {
            let odd = n_inside == 2;
            let first = inside.iter().position(|&i| i == odd)?;
            if inside[7 - first] == odd {
                return nearest(&[first, 7 - first]);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ambiguous_after(signs: u8) -> bool {
        let samples = (0..8)
            .map(|c| {
                let size = 1.0 + c as f32 * 0.1;
                if signs >> c & 1 == 1 { -size } else { size }
            })
            .collect();
        let mut grid = ScalarGrid::new([2, 2, 2], samples);
        grid.disambiguate();
        grid.ambiguous_corner(&std::array::from_fn(|c| c)).is_some()
    }

    #[test]
    fn every_pattern_of_signs_is_resolved() {
        for signs in 0..=u8::MAX {
            assert!(!ambiguous_after(signs), "signs {signs:08b}");
        }
    }

    #[test]
    fn a_plain_cell_is_left_alone() {
        let mut grid = ScalarGrid::new([2, 2, 2], vec![-1.0, 1.0, -1.0, 1.0, -2.0, 2.0, -2.0, 2.0]);
        let before = grid.samples.clone();
        assert_eq!(grid.disambiguate(), 0, "nothing to change");
        assert_eq!(grid.samples, before, "the samples stay");
    }
}
