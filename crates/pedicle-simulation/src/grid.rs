//! Samples of a solid on a regular grid that surface nets can mesh without pinching.
//!
//! Surface nets put one vertex in a cell. Where two opposite corners of a cell's side lie inside
//! and the other two outside, or only two opposite corners of the cell differ from the rest, two
//! sheets would share that vertex or an edge: the surface would not be a manifold. This happens
//! along ridges that run obliquely through the grid. The corner nearest to the surface then
//! changes its sign, which moves the surface by a fraction of a cell until the vertices are placed.

/// Passes over the grid before giving up.
const MAX_PASSES: usize = 40;
/// What a corner that changes its sign is set to, mm.
const FLIPPED_MM: f32 = 1e-3;
/// The corners of the six sides of a cell, around each side; corner bits are x, y, z.
const SIDES: [[usize; 4]; 6] = [
    [0, 1, 3, 2],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 3, 7, 6],
    [0, 2, 6, 4],
    [1, 3, 7, 5],
];

/// Samples with x running fastest.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    pub(crate) size: [u32; 3],
    pub(crate) samples: Vec<f32>,
}

impl Grid {
    /// Changes signs until no cell is ambiguous; the number of passes with a change.
    pub(crate) fn disambiguate(&mut self) -> usize {
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
                            *sample = if *sample < 0.0 {
                                FLIPPED_MM
                            } else {
                                -FLIPPED_MM
                            };
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
                    .filter(|&s| self.samples[corners[s]].abs() > FLIPPED_MM)
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
        let mut grid = Grid {
            size: [2, 2, 2],
            samples,
        };
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
        let mut grid = Grid {
            size: [2, 2, 2],
            samples: vec![-1.0, 1.0, -1.0, 1.0, -2.0, 2.0, -2.0, 2.0],
        };
        let before = grid.samples.clone();
        assert_eq!(grid.disambiguate(), 0, "nothing to change");
        assert_eq!(grid.samples, before, "the samples stay");
    }
}
