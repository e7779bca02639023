//! Farthest point sampling of a mesh.
//!
//! ```text
//! v_0 = the vertex farthest from the mean of all,   v_{i+1} = argmax_v min_{j ≤ i} d(v, v_j)
//! ```
//!
//! The lowest index wins among equals, so the samples are the same everywhere. d is Euclidean, in
//! O(n p), or the length of the shortest path along edges, kept by one Dijkstra that only ever
//! visits what gets nearer. Vertices without a face are never sampled.
//!
//! Eldar, Lindenbaum, Porat & Zeevi 1997.

use std::{cmp::Reverse, collections::BinaryHeap};

use nalgebra::Vector3;
use pedicle_mesh::TriMesh;

use crate::{
    FmapError,
    adjacency::{Adjacency, Ordered},
    growth::at_least_one,
    quality::{distance, vertex_areas},
};

/// Distances by which samples are spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SampleDistance {
    /// Straight through space.
    Euclidean,
    /// Along the edges of the mesh: sheets that lie close together are told apart, and every
    /// component gets a sample before any gets a second one.
    #[default]
    Graph,
}

/// Vertices spread evenly over a mesh, and the cells of vertices nearest to them.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// Indices of the sampled vertices, in the order of sampling.
    pub vertices: Vec<u32>,
    /// Area of the cell of every sample: of the vertices nearer to it than to any other, mm².
    pub areas: Vec<f64>,
    /// Largest distance of a vertex from its nearest sample, mm; infinite under graph distances if
    /// a component has none.
    pub radius_mm: f64,
}

/// Samples `n_samples` vertices of a mesh, each as far as possible from all before it.
///
/// # Errors
/// [`FmapError::InvalidOption`] if `n_samples` is 0 or above the number of vertices with a face.
pub fn farthest_point_samples(
    mesh: &TriMesh,
    n_samples: usize,
    measure: SampleDistance,
) -> Result<Samples, FmapError> {
    at_least_one("n_samples", n_samples)?;
    let mut used = vec![false; mesh.n_vertices()];
    for &v in mesh.faces().iter().flatten() {
        used[v as usize] = true;
    }
    if n_samples > used.iter().filter(|&&u| u).count() {
        return Err(FmapError::InvalidOption {
            option: "n_samples",
            value: n_samples as f64,
            requirement: "it must not exceed the number of vertices that have a face",
        });
    }
    let mut spread = Spread::new(used);
    let adjacency = match measure {
        SampleDistance::Euclidean => None,
        SampleDistance::Graph => Some(Adjacency::new(mesh)),
    };
    let mut next = farthest_from_mean(mesh, &spread.used);
    let mut vertices = Vec::with_capacity(n_samples);
    for sample in 0..n_samples {
        vertices.push(next as u32);
        match &adjacency {
            None => spread.take_straight(mesh, next, sample as u32),
            Some(adjacency) => spread.take_along(adjacency, next, sample as u32),
        }
        next = spread.farthest();
    }
    let mut areas = vec![0.0; n_samples];
    for (v, area) in vertex_areas(mesh).into_iter().enumerate() {
        if let Some(cell) = areas.get_mut(spread.nearest[v] as usize) {
            *cell += area;
        }
    }
    Ok(Samples {
        vertices,
        areas,
        radius_mm: spread.distance[next].max(0.0),
    })
}

/// Distance of every vertex from its nearest sample.
struct Spread {
    used: Vec<bool>,
    distance: Vec<f64>,
    /// Number of that sample; `u32::MAX` where none can be reached.
    nearest: Vec<u32>,
}

impl Spread {
    fn new(used: Vec<bool>) -> Self {
        let n = used.len();
        // A vertex without a face is never the farthest.
        let distance = used
            .iter()
            .map(|&u| if u { f64::INFINITY } else { -1.0 })
            .collect();
        Self {
            used,
            distance,
            nearest: vec![u32::MAX; n],
        }
    }

    fn take_straight(&mut self, mesh: &TriMesh, vertex: usize, sample: u32) {
        for v in 0..self.distance.len() {
            let d = distance(mesh, v, vertex);
            if d < self.distance[v] {
                self.distance[v] = d;
                self.nearest[v] = sample;
            }
        }
    }

    fn take_along(&mut self, adjacency: &Adjacency, vertex: usize, sample: u32) {
        let mut queue = BinaryHeap::new();
        self.distance[vertex] = 0.0;
        self.nearest[vertex] = sample;
        queue.push(Reverse((Ordered(0.0), vertex)));
        while let Some(Reverse((Ordered(so_far), v))) = queue.pop() {
            if so_far > self.distance[v] {
                continue;
            }
            for (next, length) in adjacency.edges_of(v) {
                let through = so_far + length;
                if through < self.distance[next] {
                    self.distance[next] = through;
                    self.nearest[next] = sample;
                    queue.push(Reverse((Ordered(through), next)));
                }
            }
        }
    }

    /// The vertex farthest from all samples, the lowest among equals.
    fn farthest(&self) -> usize {
        first_largest(self.distance.iter().copied())
    }
}

fn farthest_from_mean(mesh: &TriMesh, used: &[bool]) -> usize {
    let sum: Vector3<f64> = mesh.vertices().iter().map(|p| p.coords).sum();
    let mean = sum / mesh.n_vertices() as f64;
    let pairs = mesh.vertices().iter().zip(used);
    first_largest(pairs.map(|(p, &u)| if u { (p.coords - mean).norm() } else { -1.0 }))
}

fn first_largest(values: impl Iterator<Item = f64>) -> usize {
    let mut largest = (f64::NEG_INFINITY, 0);
    for (v, value) in values.enumerate() {
        if value > largest.0 {
            largest = (value, v);
        }
    }
    largest.1
}
