//! One part of a label as a small volume of its own.
//!
//! ```text
//! g = G_σ * m,   m = 1 inside and 0 outside
//! ```
//!
//! Closed holes inside are filled first: they are gaps of the segmentation, and their walls would be
//! surfaces that no bone has.

use crate::Part;

/// Standard deviations after which the Gaussian is cut off.
const KERNEL_REACH: f64 = 4.0;

/// A box of voxels around a part, padded so that nothing reaches its border; i runs fastest.
#[derive(Debug, Clone)]
pub(crate) struct Mask {
    /// Voxels along i, j and k.
    pub(crate) size: [usize; 3],
    /// Index in the whole volume of the first voxel; negative where the padding lies outside.
    pub(crate) origin: [i64; 3],
    /// 1 inside, 0 outside.
    pub(crate) values: Vec<f32>,
    /// Voxels inside, with the filled holes.
    pub(crate) n_inside: u64,
}

impl Mask {
    /// The part with its holes filled, and room for a Gaussian of `sigma_voxels`.
    pub(crate) fn new(part: &Part, sigma_voxels: f64) -> Self {
        let pad = kernel_radius(sigma_voxels) + 1;
        let (low, high) = part.bounds();
        let size: [usize; 3] =
            std::array::from_fn(|axis| (high[axis] - low[axis]) as usize + 1 + 2 * pad);
        let mut inside = vec![true; size.iter().product()];
        flood_outside(&mut inside, part, size, (low, pad));
        let values: Vec<f32> = inside.iter().map(|&is| f32::from(u8::from(is))).collect();
        Self {
            size,
            origin: std::array::from_fn(|axis| i64::from(low[axis]) - pad as i64),
            n_inside: inside.iter().filter(|&&is| is).count() as u64,
            values,
        }
    }

    /// Convolves with a Gaussian of so many voxels along every axis.
    pub(crate) fn blur(&mut self, sigma_voxels: f64) {
        let kernel = kernel(sigma_voxels);
        if kernel.len() == 1 {
            return;
        }
        let [ni, nj, nk] = self.size;
        let strides = [1, ni, ni * nj];
        for axis in 0..3 {
            let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
            let n = self.size[axis];
            let mut line = vec![0.0; n];
            for second in 0..[ni, nj, nk][b] {
                for first in 0..[ni, nj, nk][a] {
                    let start = first * strides[a] + second * strides[b];
                    for (t, x) in line.iter_mut().enumerate() {
                        *x = self.values[start + t * strides[axis]];
                    }
                    // Most lines do not meet the part.
                    if line.iter().all(|&x| x <= 0.0) {
                        continue;
                    }
                    for t in 0..n {
                        self.values[start + t * strides[axis]] = convolved(&line, &kernel, t);
                    }
                }
            }
        }
    }
}

impl Mask {
    /// The values at twice the resolution, linear between: sizes, then values.
    pub(crate) fn doubled(&self) -> ([usize; 3], Vec<f32>) {
        let (mut size, mut values) = (self.size, self.values.clone());
        for axis in 0..3 {
            (size, values) = doubled_along(size, &values, axis);
        }
        (size, values)
    }
}

/// Puts the mean of every two neighbours along an axis between them.
fn doubled_along(size: [usize; 3], values: &[f32], axis: usize) -> ([usize; 3], Vec<f32>) {
    let mut larger = size;
    larger[axis] = 2 * size[axis] - 1;
    let stride: usize = size[..axis].iter().product();
    let n = size[axis];
    let mut out = Vec::with_capacity(larger.iter().product());
    for block in values.chunks_exact(stride * n) {
        for t in 0..n {
            let layer = &block[t * stride..(t + 1) * stride];
            out.extend_from_slice(layer);
            if t + 1 < n {
                let next = &block[(t + 1) * stride..(t + 2) * stride];
                out.extend(layer.iter().zip(next).map(|(a, b)| 0.5 * (a + b)));
            }
        }
    }
    (larger, out)
}

/// Marks as outside all that the padding reaches over faces without entering the part.
fn flood_outside(
    inside: &mut [bool],
    part: &Part,
    size: [usize; 3],
    (low, pad): ([u32; 3], usize),
) {
    let [ni, nj, _] = size;
    let at = |i: usize, j: usize, k: usize| i + ni * (j + nj * k);
    let mut is_part = vec![false; inside.len()];
    for run in &part.runs {
        let i = (run.first - low[0]) as usize + pad;
        let (j, k) = (
            (run.j - low[1]) as usize + pad,
            (run.k - low[2]) as usize + pad,
        );
        let start = at(i, j, k);
        is_part[start..start + run.n_voxels() as usize].fill(true);
    }
    inside[0] = false;
    let mut open = vec![0_usize];
    while let Some(voxel) = open.pop() {
        let place = [voxel % ni, voxel / ni % nj, voxel / (ni * nj)];
        let strides = [1, ni, ni * nj];
        for axis in 0..3 {
            let below = (place[axis] > 0).then(|| voxel - strides[axis]);
            let above = (place[axis] + 1 < size[axis]).then(|| voxel + strides[axis]);
            for next in [below, above].into_iter().flatten() {
                if inside[next] && !is_part[next] {
                    inside[next] = false;
                    open.push(next);
                }
            }
        }
    }
}

fn kernel_radius(sigma_voxels: f64) -> usize {
    (KERNEL_REACH * sigma_voxels).ceil() as usize
}

/// Weights at -radius to radius, with the sum 1.
fn kernel(sigma_voxels: f64) -> Vec<f32> {
    let radius = kernel_radius(sigma_voxels) as i32;
    if radius == 0 {
        return vec![1.0];
    }
    let weights: Vec<f64> = (-radius..=radius)
        .map(|t| (-0.5 * (f64::from(t) / sigma_voxels).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

fn convolved(line: &[f32], kernel: &[f32], t: usize) -> f32 {
    let radius = kernel.len() / 2;
    let from = t.saturating_sub(radius);
    let to = (t + radius + 1).min(line.len());
    line[from..to]
        .iter()
        .zip(&kernel[from + radius - t..])
        .map(|(x, w)| x * w)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Run;

    /// A hollow cube of 5 voxels with one voxel missing in its middle.
    fn hollow() -> Part {
        let mut runs = Vec::new();
        for k in 10..15 {
            for j in 10..15 {
                if (j, k) == (12, 12) {
                    runs.push(Run {
                        first: 10,
                        last: 11,
                        j,
                        k,
                    });
                    runs.push(Run {
                        first: 13,
                        last: 14,
                        j,
                        k,
                    });
                } else {
                    runs.push(Run {
                        first: 10,
                        last: 14,
                        j,
                        k,
                    });
                }
            }
        }
        Part {
            n_voxels: 124,
            runs,
        }
    }

    #[test]
    fn closed_holes_are_filled() {
        let mask = Mask::new(&hollow(), 0.7);
        assert_eq!(mask.n_inside, 125, "the hole is filled");
        assert_eq!(mask.origin, [6; 3], "padded by the kernel and one more");
        assert_eq!(mask.size, [13; 3], "on either side");
    }

    #[test]
    fn the_gaussian_keeps_the_sum() {
        let mut mask = Mask::new(&hollow(), 0.7);
        mask.blur(0.7);
        let sum: f32 = mask.values.iter().sum();
        assert!((sum - 125.0).abs() < 1e-3, "sum {sum}");
        let border = mask.values[0];
        assert!(border.abs() < 1e-12, "nothing reaches the border: {border}");
    }
}
