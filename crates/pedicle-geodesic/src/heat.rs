//! Distances by the heat method.
//!
//! ```text
//! (M + t W) u = δ,   X = -∇u / |∇u|,   W φ = ∇·X,   (∇·X)_i = Σ_{triangles at i} area ⟨X, ∇ψ_i⟩
//! ```
//!
//! W is the cotangent stiffness, M the lumped mass, ψ_i the hat function at vertex i, δ one at the
//! vertices measured from. Heat that has flowed for a short time t falls off along the shortest
//! ways; its normalised gradient is that of the distance φ. t is the square of the mean edge
//! length. Natural boundary conditions.
//!
//! Crane, Weischedel & Wardetzky 2013. Both matrices are factorised once (sparse Cholesky); every
//! query is two pairs of triangular solves. W has a null vector on every connected component: one
//! vertex of each is held at zero, and the distances of the component are shifted afterwards so
//! that they are zero on average where they are measured from. Lengths are in the unit of the mesh
//! and scale with it.
//!
//! The error falls with the edge length down to about 1 % of the distance, where the directions of
//! the edges show in the decay of the heat. Meshes as regular as a subdivided octahedron need a
//! `time_factor` that grows as the edges shrink to get below; distances are then smoother at the
//! cut locus and on narrow tubes.
//!
//! Heat falls by a factor e over an edge length, so double precision carries the gradient over
//! some 700 edges; beyond, the field X is zero and distances stop growing.

use faer::prelude::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Side};
use nalgebra::Vector3;
use pedicle_laplacian::{Mollification, OperatorOptions, cotangent_operators};
use pedicle_mesh::{TriMesh, connected_components, edge_lengths};
use rayon::prelude::*;
use sprs::CsMat;

use crate::GeodesicError;
use crate::error::check_vertices;
use crate::pairs::{grouped_by_source, in_order_of_pairs};

/// Queries that share a pass over the factors.
const QUERIES_PER_BLOCK: usize = 8;

/// How heat flows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeatOptions {
    /// Time t over the square of the mean edge length, 1; positive. More smooths the distances.
    pub time_factor: f64,
}

impl Default for HeatOptions {
    fn default() -> Self {
        Self { time_factor: 1.0 }
    }
}

/// The factors of the heat method for one mesh, ready for any number of queries.
#[derive(Debug, Clone)]
pub struct HeatGeodesics {
    flow: Llt<usize, f64>,
    poisson: Llt<usize, f64>,
    faces: Vec<FaceField>,
    /// Connected component of every vertex; a vertex that no face uses is one by itself.
    component: Vec<u32>,
    n_components: usize,
    /// The vertex of every component at which φ is held.
    held: Vec<u32>,
    time_mm2: f64,
}

/// One face: its corners and area ∇ψ at each of them.
#[derive(Debug, Clone)]
struct FaceField {
    corners: [u32; 3],
    area_gradients: [Vector3<f64>; 3],
}

impl HeatGeodesics {
    /// Prepares a mesh with its cotangent Laplacian; nearly degenerate faces are mollified.
    ///
    /// # Errors
    /// [`GeodesicError`] if the mesh has no Laplacian, such as with a vertex that no face uses, or
    /// an option makes no sense.
    pub fn new(mesh: &TriMesh, options: &HeatOptions) -> Result<Self, GeodesicError> {
        let operators = cotangent_operators(
            mesh,
            &OperatorOptions {
                mollification: Mollification::intrinsic(),
                ..OperatorOptions::default()
            },
        )?;
        Self::with_operators(mesh, &operators.stiffness, &operators.mass, options)
    }

    /// Prepares a mesh with a stiffness matrix W and a lumped mass of the caller.
    ///
    /// # Errors
    /// [`GeodesicError`] if they do not fit the mesh, are not positive (semi)definite, or an option
    /// makes no sense.
    pub fn with_operators(
        mesh: &TriMesh,
        stiffness: &CsMat<f64>,
        mass: &[f64],
        options: &HeatOptions,
    ) -> Result<Self, GeodesicError> {
        let n = mesh.n_vertices();
        for (what, found) in [
            ("rows of the stiffness", stiffness.rows()),
            ("columns of the stiffness", stiffness.cols()),
            ("masses", mass.len()),
        ] {
            if found != n {
                return Err(GeodesicError::SizeMismatch {
                    what,
                    found,
                    expected: n,
                });
            }
        }
        if !(options.time_factor.is_finite() && options.time_factor > 0.0) {
            return Err(GeodesicError::InvalidValue {
                what: "time_factor",
                value: options.time_factor,
                requirement: "it must be finite and positive",
            });
        }
        let mean_edge_mm = edge_lengths(mesh).mean_mm;
        let time_mm2 = options.time_factor * mean_edge_mm * mean_edge_mm;
        let (component, held) = components(mesh);
        let mut is_held = vec![false; n];
        for &vertex in &held {
            is_held[vertex as usize] = true;
        }
        let (mut flow, mut poisson) = (Vec::new(), Vec::new());
        for (&value, (i, j)) in stiffness {
            // The lower triangle alone is read.
            if i < j {
                continue;
            }
            flow.push(Triplet::new(i, j, time_mm2 * value));
            if !(is_held[i] || is_held[j]) {
                poisson.push(Triplet::new(i, j, value));
            }
        }
        let largest = stiffness.iter().map(|(&v, _)| v.abs()).fold(0.0, f64::max);
        for (i, &area) in mass.iter().enumerate() {
            flow.push(Triplet::new(i, i, area));
            if is_held[i] {
                poisson.push(Triplet::new(
                    i,
                    i,
                    if largest > 0.0 { largest } else { 1.0 },
                ));
            }
        }
        Ok(Self {
            flow: factorize("heat flow", n, &flow)?,
            poisson: factorize("Poisson", n, &poisson)?,
            faces: face_fields(mesh),
            component,
            n_components: held.len(),
            held,
            time_mm2,
        })
    }

    /// Number of vertices.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.component.len()
    }

    /// The time t for which heat flows, in the squared unit of the mesh.
    #[must_use]
    pub fn time_mm2(&self) -> f64 {
        self.time_mm2
    }

    /// Distances of all vertices from the nearest of the given ones; infinite on components that
    /// have none of them.
    ///
    /// # Errors
    /// [`GeodesicError`] if no vertex is given or one does not exist.
    pub fn distances_from(&self, sources: &[u32]) -> Result<Vec<f64>, GeodesicError> {
        if sources.is_empty() {
            return Err(GeodesicError::NoSource);
        }
        check_vertices(sources.iter().copied(), self.n_vertices())?;
        let distances = self.solve(&[sources]);
        Ok(distances.col_as_slice(0).to_vec())
    }

    /// The distance of every pair, measured from its first vertex; infinite between components.
    ///
    /// One query for every different first vertex, several side by side. The distance from a to b
    /// differs from that from b to a by as much as the error of the method.
    ///
    /// # Errors
    /// [`GeodesicError`] if a vertex does not exist.
    pub fn distances_between(&self, pairs: &[(u32, u32)]) -> Result<Vec<f64>, GeodesicError> {
        check_vertices(pairs.iter().flat_map(|&(a, b)| [a, b]), self.n_vertices())?;
        let groups = grouped_by_source(pairs);
        let answers: Vec<Vec<f64>> = groups
            .par_chunks(QUERIES_PER_BLOCK)
            .map(|block| {
                let sources: Vec<[u32; 1]> =
                    block.iter().map(|g| [pairs[g[0] as usize].0]).collect();
                let sources: Vec<&[u32]> = sources.iter().map(|s| &s[..]).collect();
                let distances = self.solve(&sources);
                let mut answer = Vec::new();
                for (column, group) in block.iter().enumerate() {
                    let column = distances.col_as_slice(column);
                    answer.extend(group.iter().map(|&i| column[pairs[i as usize].1 as usize]));
                }
                answer
            })
            .collect();
        Ok(in_order_of_pairs(&groups, answers.into_iter().flatten()))
    }

    /// One column of distances for every set of sources.
    fn solve(&self, queries: &[&[u32]]) -> Mat<f64> {
        let n = self.n_vertices();
        let mut heat = Mat::zeros(n, queries.len());
        for (column, sources) in queries.iter().enumerate() {
            for &source in *sources {
                heat[(source as usize, column)] = 1.0;
            }
        }
        self.flow.solve_in_place(heat.as_mut());
        let mut distances = Mat::zeros(n, queries.len());
        for column in 0..queries.len() {
            let divergence = distances.col_as_slice_mut(column);
            self.add_divergence(heat.col_as_slice(column), divergence);
            for &vertex in &self.held {
                divergence[vertex as usize] = 0.0;
            }
        }
        self.poisson.solve_in_place(distances.as_mut());
        for (column, sources) in queries.iter().enumerate() {
            self.shift(sources, distances.col_as_slice_mut(column));
        }
        distances
    }

    /// Adds ∇·X of the normalised gradient of `heat`.
    fn add_divergence(&self, heat: &[f64], divergence: &mut [f64]) {
        for FaceField {
            corners,
            area_gradients,
        } in &self.faces
        {
            let values = corners.map(|v| heat[v as usize]);
            // Divided by the largest, or its square would underflow far from the source.
            let largest = values.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
            if largest <= 0.0 {
                continue;
            }
            let gradient = area_gradients
                .iter()
                .zip(values)
                .fold(Vector3::zeros(), |sum, (g, value)| {
                    sum + g * (value / largest)
                });
            let length = gradient.norm();
            if length <= 0.0 {
                continue;
            }
            let field = gradient / -length;
            for (&v, area_gradient) in corners.iter().zip(area_gradients) {
                divergence[v as usize] += field.dot(area_gradient);
            }
        }
    }

    /// Makes the distances zero at the sources and infinite where there is none.
    fn shift(&self, sources: &[u32], distances: &mut [f64]) {
        let mut sums = vec![(0.0, 0_usize); self.n_components];
        for &source in sources {
            let (sum, count) = &mut sums[self.component[source as usize] as usize];
            *sum += distances[source as usize];
            *count += 1;
        }
        for (distance, &component) in distances.iter_mut().zip(&self.component) {
            let (sum, count) = sums[component as usize];
            *distance = if count == 0 {
                f64::INFINITY
            } else {
                (*distance - sum / count as f64).max(0.0)
            };
        }
        for &source in sources {
            distances[source as usize] = 0.0;
        }
    }
}

fn factorize(
    matrix: &'static str,
    n: usize,
    triplets: &[Triplet<usize, usize, f64>],
) -> Result<Llt<usize, f64>, GeodesicError> {
    let failure = |reason: String| GeodesicError::Factorization { matrix, n, reason };
    SparseColMat::<usize, f64>::try_new_from_triplets(n, n, triplets)
        .map_err(|e| failure(format!("{e:?}")))?
        .sp_cholesky(Side::Lower)
        .map_err(|e| failure(format!("{e:?}")))
}

/// Component of every vertex, and the first vertex of every component.
fn components(mesh: &TriMesh) -> (Vec<u32>, Vec<u32>) {
    let found = connected_components(mesh);
    let mut first = vec![None; found.n_components];
    let mut held = Vec::new();
    let mut component = Vec::with_capacity(mesh.n_vertices());
    for (vertex, of_vertex) in found.of_vertex.iter().enumerate() {
        let mut add = || {
            held.push(vertex as u32);
            held.len() as u32 - 1
        };
        component.push(match of_vertex {
            Some(c) => *first[*c as usize].get_or_insert_with(add),
            None => add(),
        });
    }
    (component, held)
}

/// Faces without area are left out: nothing flows through them.
fn face_fields(mesh: &TriMesh) -> Vec<FaceField> {
    let fields = (0..mesh.n_faces()).filter_map(|face| {
        let normal = mesh.face_normal_scaled(face);
        let length = normal.norm();
        if length <= 0.0 {
            return None;
        }
        let normal = normal / length;
        let [a, b, c] = mesh.triangle(face);
        Some(FaceField {
            corners: mesh.faces()[face],
            area_gradients: [c - b, a - c, b - a].map(|edge| normal.cross(&edge) * 0.5),
        })
    });
    fields.collect()
}
