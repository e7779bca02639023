//! Vertices moved onto a level of the blurred mask.
//!
//! ```text
//! x ← x + (c - g(x)) ∇g / |∇g|²
//! ```
//!
//! Surface nets leave a vertex at the mean of the crossings in its cell: inside of every ridge. A few
//! Newton steps on the trilinear interpolant of g bring it to the level c, and as c may differ from
//! the level that was meshed, the volume can be set without a change of the connectivity.

use nalgebra::{Point3, Vector3};

use crate::mask::Mask;

/// Newton steps.
const N_STEPS: usize = 4;
/// Longest step and longest way in all, voxels.
const MAX_STEP: f64 = 0.25;
const MAX_WAY: f64 = 0.6;
/// Slope of g, per voxel, below which its direction means nothing.
const MIN_SLOPE: f64 = 0.02;
/// Rounds of taking back vertices whose faces turned over.
const MAX_ROUNDS: usize = 8;
/// Cosine between the normals of a face before and after below which it turned over.
const MIN_COSINE: f64 = 0.1;

/// The points moved to where g is `level`, and back as far as it takes for no face to turn over.
pub(crate) fn place(
    mask: &Mask,
    points: &[Point3<f64>],
    faces: &[[u32; 3]],
    level: f64,
) -> Vec<Point3<f64>> {
    let ways: Vec<Vector3<f64>> = points.iter().map(|p| way(mask, p, level)).collect();
    let mut share = vec![1.0; points.len()];
    let mut moved: Vec<Point3<f64>> = points.iter().zip(&ways).map(|(p, w)| p + w).collect();
    for round in 0..MAX_ROUNDS {
        let bad: Vec<&[u32; 3]> = faces
            .iter()
            .filter(|face| turned_over(&normal(points, face), &normal(&moved, face)))
            .collect();
        if bad.is_empty() {
            break;
        }
        for &v in bad.into_iter().flatten() {
            let v = v as usize;
            share[v] = if round + 2 < MAX_ROUNDS {
                0.5 * share[v]
            } else {
                0.0
            };
            moved[v] = points[v] + ways[v] * share[v];
        }
    }
    moved
}

fn turned_over(before: &Vector3<f64>, after: &Vector3<f64>) -> bool {
    before.dot(after) <= MIN_COSINE * before.norm() * after.norm()
}

fn normal(points: &[Point3<f64>], face: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = face.map(|v| points[v as usize]);
    (b - a).cross(&(c - a))
}

fn way(mask: &Mask, start: &Point3<f64>, level: f64) -> Vector3<f64> {
    let mut way = Vector3::zeros();
    for _ in 0..N_STEPS {
        let Some((value, slope)) = value_and_slope(mask, &(start + way)) else {
            break;
        };
        let steepness = slope.norm();
        if steepness < MIN_SLOPE {
            break;
        }
        let step = ((level - value) / steepness).clamp(-MAX_STEP, MAX_STEP);
        let next = way + slope * (step / steepness);
        if next.norm() > MAX_WAY {
            break;
        }
        way = next;
    }
    way
}

/// The trilinear interpolant of g and its gradient per voxel; `None` outside the grid.
fn value_and_slope(mask: &Mask, p: &Point3<f64>) -> Option<(f64, Vector3<f64>)> {
    let [ni, nj, _] = mask.size;
    let mut cell = [0; 3];
    let mut t = [0.0; 3];
    for axis in 0..3 {
        let floor = p[axis].floor();
        if floor < 0.0 || floor as usize + 1 >= mask.size[axis] {
            return None;
        }
        cell[axis] = floor as usize;
        t[axis] = p[axis] - floor;
    }
    let base = cell[0] + ni * (cell[1] + nj * cell[2]);
    let at = |corner: usize| {
        let index = base + (corner & 1) + ni * ((corner >> 1 & 1) + nj * (corner >> 2));
        f64::from(mask.values[index])
    };
    let mut value = 0.0;
    let mut slope = Vector3::zeros();
    for corner in 0..8 {
        let g = at(corner);
        let is_upper: [bool; 3] = std::array::from_fn(|axis| corner >> axis & 1 == 1);
        let w: [f64; 3] = std::array::from_fn(|axis| {
            if is_upper[axis] {
                t[axis]
            } else {
                1.0 - t[axis]
            }
        });
        value += g * w[0] * w[1] * w[2];
        for axis in 0..3 {
            let others = w[(axis + 1) % 3] * w[(axis + 2) % 3];
            slope[axis] += if is_upper[axis] {
                g * others
            } else {
                -g * others
            };
        }
    }
    Some((value, slope))
}
