//! Vertices onto the exact surface.
//!
//! The grid gives single precision and steps; the vertices are moved along the gradient in f64,
//!
//! ```text
//! p ← p - f(p) ∇f / |∇f|²,
//! ```
//!
//! alternating with a few smoothing steps within the surface for better triangles. A face that
//! turned over where the surface is sharply creased is opened again by moving its corners to the
//! middle of their neighbours.

use nalgebra::{Point3, Vector3};
use pedicle_trajectory::Level;

use crate::spine::SpineShape;

/// Smoothing steps within the surface.
const N_SMOOTHING: usize = 4;
/// Newton steps after the last smoothing, at most.
const N_NEWTON: usize = 12;
/// A vertex is on the surface if the field is smaller than this, mm.
const SURFACE_TOLERANCE_MM: f64 = 1e-10;
/// A gradient shorter than this has no direction.
const SHORTEST_GRADIENT: f64 = 1e-3;
/// Rounds in which corners of turned faces are moved to the middle of their neighbours.
const N_OPENING: usize = 12;
/// In the last of these rounds they stay there, a fraction of a cell off the surface.
const N_OPENING_OFF_SURFACE: usize = 4;

/// Moves the vertices of one vertebra.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placing<'a> {
    spine: &'a SpineShape,
    level: Level,
    /// Longest single step, mm.
    longest_mm: f64,
}

impl<'a> Placing<'a> {
    pub(crate) fn new(spine: &'a SpineShape, level: Level, cell_mm: f64) -> Self {
        Self {
            spine,
            level,
            longest_mm: 0.5 * cell_mm,
        }
    }

    /// Places the vertices; how many faces look inwards in the end.
    pub(crate) fn place(&self, points: &mut [Point3<f64>], faces: &[[u32; 3]]) -> usize {
        for _ in 0..N_SMOOTHING {
            let normals: Vec<_> = points.iter_mut().map(|p| self.step(p)).collect();
            let middles = neighbour_means(points, faces);
            for ((p, normal), middle) in points.iter_mut().zip(&normals).zip(&middles) {
                if let Some(normal) = normal {
                    let pull = middle - *p;
                    *p += (pull - normal * pull.dot(normal)) * 0.5;
                }
            }
        }
        for p in points.iter_mut() {
            self.settle(p);
        }
        for round in 0..N_OPENING {
            let inverted = self.inverted(points, faces);
            if inverted.is_empty() {
                break;
            }
            let middles = neighbour_means(points, faces);
            for &v in inverted.iter().flatten() {
                let p = &mut points[v as usize];
                *p = middles[v as usize];
                if round + N_OPENING_OFF_SURFACE < N_OPENING {
                    self.settle(p);
                }
            }
        }
        self.inverted(points, faces).len()
    }

    /// One Newton step; the unit normal it went along, `None` on the surface.
    fn step(&self, p: &mut Point3<f64>) -> Option<Vector3<f64>> {
        let f = self.spine.distance(self.level, p);
        let gradient = self.spine.gradient(self.level, p, f);
        let norm = gradient.norm();
        if f.abs() < SURFACE_TOLERANCE_MM || norm < SHORTEST_GRADIENT {
            return None;
        }
        let normal = gradient / norm;
        *p -= normal * (f / norm).clamp(-self.longest_mm, self.longest_mm);
        Some(normal)
    }

    fn settle(&self, p: &mut Point3<f64>) {
        for _ in 0..N_NEWTON {
            if self.step(p).is_none() {
                break;
            }
        }
    }

    /// Faces that look against the mean normal of their corners.
    fn inverted(&self, points: &[Point3<f64>], faces: &[[u32; 3]]) -> Vec<[u32; 3]> {
        let normals: Vec<_> = points
            .iter()
            .map(|p| {
                let f = self.spine.distance(self.level, p);
                self.spine.gradient(self.level, p, f)
            })
            .collect();
        let looks_inwards = |face: &&[u32; 3]| {
            let [a, b, c] = face.map(|v| points[v as usize]);
            let outward: Vector3<f64> = face.iter().map(|&v| normals[v as usize]).sum();
            (b - a).cross(&(c - a)).dot(&outward) <= 0.0
        };
        faces.iter().filter(looks_inwards).copied().collect()
    }
}

/// For every vertex, the mean of its neighbours.
fn neighbour_means(points: &[Point3<f64>], faces: &[[u32; 3]]) -> Vec<Point3<f64>> {
    let mut sums = vec![(Vector3::zeros(), 0.0); points.len()];
    for face in faces {
        for corner in 0..3 {
            let slot = &mut sums[face[corner] as usize];
            slot.0 += points[face[(corner + 1) % 3] as usize].coords;
            slot.0 += points[face[(corner + 2) % 3] as usize].coords;
            slot.1 += 2.0;
        }
    }
    sums.into_iter()
        .zip(points)
        .map(|((sum, count), p)| {
            if count > 0.0 {
                Point3::from(sum / count)
            } else {
                *p
            }
        })
        .collect()
}
