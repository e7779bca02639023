//! Pairs of shapes whose correspondence is known.
//!
//! ```text
//! radius(u) = 1 + Σ_b h_b exp(s_b (u·b - 1)),   x(u) = radius(u) (a u_x, b u_y, c u_z)
//! bent(x)   = ((R + x) cos θ - R, y, (R + x) sin θ),   θ = z / R
//! ```
//!
//! A generated source samples a body with five limbs and no symmetry at the directions of a
//! divided octahedron; the target samples the same body at turned directions, is bent, carries
//! noise, and has its vertices in random order. Nothing but the truth connects their vertices.
//! Both shapes have unit area before bending, so distances are in units of its root.

use std::collections::BTreeMap;

use nalgebra::{Point3, Rotation3, Vector3};
use pedicle_mesh::{MeshError, TriMesh};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Angle by which the target is bent from one end to the other, rad.
const BEND_RAD: f64 = 0.2;
/// Standard deviation of the target's noise over its mean edge length.
const NOISE_IN_EDGES: f64 = 0.03;
/// Vertices whose correspondence both programs are told.
const N_LANDMARKS: usize = 4;
/// Limbs of the body: direction, height and sharpness.
const LIMBS: [([f64; 3], f64, f64); 5] = [
    ([1.0, 0.2, 0.3], 0.9, 7.0),
    ([-0.5, 1.0, -0.2], 0.7, 9.0),
    ([0.2, -0.6, -1.0], 1.1, 8.0),
    ([-0.8, -0.7, 0.3], 0.5, 12.0),
    ([0.1, 0.3, 1.0], 0.8, 10.0),
];
/// Half axes of the body without its limbs.
const HALF_AXES: [f64; 3] = [1.3, 1.0, 0.8];

/// Two shapes and what is known of them.
#[derive(Debug)]
pub(crate) struct Pair {
    /// What they are, for the report.
    pub(crate) name: String,
    pub(crate) source: TriMesh,
    pub(crate) target: TriMesh,
    /// Where every target vertex lies on the source.
    pub(crate) truth: Vec<Point3<f64>>,
    /// Vertices of the source and of the target that correspond.
    pub(crate) landmarks: Vec<[usize; 2]>,
}

impl Pair {
    /// A generated pair of about `n_vertices` vertices each.
    pub(crate) fn generated(n_vertices: usize, seed: u64) -> Result<Self, MeshError> {
        let n_divisions = ((n_vertices.max(18) - 2) as f64 / 4.0).sqrt().round() as i32;
        let straight = body(n_divisions, &Rotation3::identity())?;
        let turn = Rotation3::from_euler_angles(0.7, -0.4, 1.1);
        let turned = body(n_divisions, &turn)?;
        let scale = 1.0 / straight.area().sqrt();
        let name = format!("generated body, {} vertices", straight.n_vertices());
        let center = straight.centroid();
        let source = scaled(&straight, &center, scale)?;
        Self::deformed(name, source, scaled(&turned, &center, scale)?, seed)
    }

    /// A mesh and a bent, noisy, shuffled copy.
    pub(crate) fn of_mesh(name: String, mesh: &TriMesh, seed: u64) -> Result<Self, MeshError> {
        let source = scaled(mesh, &mesh.centroid(), 1.0 / mesh.area().sqrt())?;
        let copy = source.clone();
        Self::deformed(name, source, copy, seed)
    }

    fn deformed(
        name: String,
        source: TriMesh,
        straight: TriMesh,
        seed: u64,
    ) -> Result<Self, MeshError> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let n = straight.n_vertices();
        let mut order: Vec<u32> = (0..n as u32).collect();
        order.shuffle(&mut random);
        let mut place = vec![0_u32; n];
        for (new, &old) in order.iter().enumerate() {
            place[old as usize] = new as u32;
        }
        let truth: Vec<Point3<f64>> = order
            .iter()
            .map(|&v| straight.vertices()[v as usize])
            .collect();
        let mean_edge = pedicle_mesh::edge_lengths(&straight).mean_mm;
        let mut noise = || -> f64 {
            let normal: f64 = StandardNormal.sample(&mut random);
            NOISE_IN_EDGES * mean_edge * normal
        };
        let (low, high) = straight.bounding_box();
        let radius = (high.z - low.z) / BEND_RAD;
        let vertices = truth
            .iter()
            .map(|p| bent(p, radius) + Vector3::from_fn(|_, _| noise()))
            .collect();
        let faces = straight
            .faces()
            .iter()
            .map(|face| face.map(|v| place[v as usize]));
        let target = TriMesh::new(vertices, faces.collect())?;
        let landmarks = landmarks(source.vertices(), &truth);
        Ok(Self {
            name,
            source,
            target,
            truth,
            landmarks,
        })
    }

    /// Mean distance of points on the source from where the target's vertices belong, by area.
    pub(crate) fn mean_error(&self, points: &[Point3<f64>]) -> f64 {
        let mut areas = vec![0.0; self.target.n_vertices()];
        for (face, corners) in self.target.faces().iter().enumerate() {
            for &v in corners {
                areas[v as usize] += self.target.face_area(face) / 3.0;
            }
        }
        let weighted = points.iter().zip(&self.truth).zip(&areas);
        let sum: f64 = weighted
            .map(|((p, truth), area)| area * (p - truth).norm())
            .sum();
        sum / areas.iter().sum::<f64>() / self.source.area().sqrt()
    }

    /// What the best map to vertices of the source has: it grows with the edges.
    pub(crate) fn smallest_error_of_map(&self) -> f64 {
        let vertices = self.source.vertices();
        let nearest = |truth: &Point3<f64>| {
            let far = vertices.iter().map(|p| -(p - truth).norm_squared());
            vertices[farthest(&far.collect::<Vec<_>>())]
        };
        self.mean_error(&self.truth.iter().map(nearest).collect::<Vec<_>>())
    }

    /// [`Self::mean_error`] of a map to vertices of the source.
    pub(crate) fn mean_error_of_map(&self, source_of_target: &[u32]) -> f64 {
        let vertices = self.source.vertices();
        let images: Vec<_> = source_of_target
            .iter()
            .map(|&v| vertices[v as usize])
            .collect();
        self.mean_error(&images)
    }
}

/// The body sampled at the turned directions of an octahedron divided `n` times.
fn body(n: i32, turn: &Rotation3<f64>) -> Result<TriMesh, MeshError> {
    let mut index: BTreeMap<[i32; 3], u32> = BTreeMap::new();
    let mut vertices = Vec::new();
    let mut vertex = |corner: [i32; 3]| {
        *index.entry(corner).or_insert_with(|| {
            let direction = turn * Vector3::from(corner.map(f64::from)).normalize();
            vertices.push(point_of(&direction));
            vertices.len() as u32 - 1
        })
    };
    let mut faces = Vec::with_capacity(8 * (n * n) as usize);
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|axis| 1 - 2 * ((octant >> axis) & 1));
        let turned_over = sign.iter().product::<i32>() < 0;
        let mut face = |corners: [[i32; 3]; 3]| {
            let [a, b, c] = corners.map(|[x, y, z]| [sign[0] * x, sign[1] * y, sign[2] * z]);
            let (b, c) = if turned_over { (c, b) } else { (b, c) };
            faces.push([a, b, c].map(&mut vertex));
        };
        for a in 0..n {
            for b in 0..n - a {
                let c = n - 1 - a - b;
                face([[a + 1, b, c], [a, b + 1, c], [a, b, c + 1]]);
                if c > 0 {
                    face([[a, b + 1, c], [a + 1, b, c], [a + 1, b + 1, c - 1]]);
                }
            }
        }
    }
    TriMesh::new(vertices, faces)
}

fn point_of(direction: &Vector3<f64>) -> Point3<f64> {
    let limbs = LIMBS.iter().map(|&(at, height, sharpness)| {
        height * (sharpness * (direction.dot(&Vector3::from(at).normalize()) - 1.0)).exp()
    });
    let radius = 1.0 + limbs.sum::<f64>();
    Point3::from(direction.component_mul(&Vector3::from(HALF_AXES)) * radius)
}

fn bent(p: &Point3<f64>, radius: f64) -> Point3<f64> {
    let (sin, cos) = (p.z / radius).sin_cos();
    Point3::new((radius + p.x) * cos - radius, p.y, (radius + p.x) * sin)
}

/// The mesh with a point of it at the origin, times a factor.
fn scaled(mesh: &TriMesh, center: &Point3<f64>, factor: f64) -> Result<TriMesh, MeshError> {
    let vertices = mesh
        .vertices()
        .iter()
        .map(|p| Point3::from((p - center) * factor));
    TriMesh::new(vertices.collect(), mesh.faces().to_vec())
}

/// Source vertices far from each other, each with the target vertex that belongs nearest to it.
fn landmarks(source: &[Point3<f64>], truth: &[Point3<f64>]) -> Vec<[usize; 2]> {
    let mut distance = vec![f64::INFINITY; source.len()];
    let mut chosen = Vec::new();
    let mut next = farthest(&source.iter().map(|p| p.coords.norm()).collect::<Vec<_>>());
    while chosen.len() < N_LANDMARKS.min(source.len()) {
        let to_next: Vec<f64> = truth.iter().map(|p| -(p - source[next]).norm()).collect();
        chosen.push([next, farthest(&to_next)]);
        for (d, p) in distance.iter_mut().zip(source) {
            *d = d.min((p - source[next]).norm());
        }
        next = farthest(&distance);
    }
    chosen
}

fn farthest(values: &[f64]) -> usize {
    let best = values.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    best.map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_generated_pair_is_closed_and_its_truth_is_right() {
        let pair = Pair::generated(1750, 3).unwrap();
        assert_eq!(pair.source.n_vertices(), 1766, "4 · 21² + 2");
        for mesh in [&pair.source, &pair.target] {
            assert_eq!(pedicle_mesh::genus(mesh), Some(0), "a sphere");
            assert!(pedicle_mesh::volume(mesh) > 0.0, "faces turn outwards");
        }
        assert!((pair.source.area() - 1.0).abs() < 1e-12, "unit area");
        assert!(
            pair.mean_error(&pair.truth) <= 0.0,
            "the truth has no error"
        );
        let error = pair.smallest_error_of_map();
        assert!(error > 0.0 && error < 0.02, "nearest vertices: {error}");
        for [s, t] in &pair.landmarks {
            let apart = (pair.source.vertices()[*s] - pair.truth[*t]).norm();
            assert!(apart < 0.05, "landmark {s} {t}: {apart}");
        }
    }

    #[test]
    fn a_copy_of_a_mesh_is_shuffled_and_bent() {
        let mesh = Pair::generated(200, 1).unwrap().source;
        let pair = Pair::of_mesh("copy".to_owned(), &mesh, 5).unwrap();
        assert_ne!(pair.target.faces(), mesh.faces(), "shuffled");
        let [s, t] = pair.landmarks[2];
        let apart = (pair.source.vertices()[s] - pair.truth[t]).norm();
        assert!(apart < 1e-12, "the same vertex: {apart}");
    }
}
