//! Precise maps: for every target vertex a point inside a triangle of the source.
//!
//! ```text
//! P(y) = argmin_p | q(y) - p |,  p = Σ_c β_c e(c),  over the triangles of the source
//! forward   q = rows of Φ_target C,   e = rows of Φ_source           k_source dimensions
//! adjoint   q = rows of Φ_target,     e = rows of Φ_source Cᵀ        k_target dimensions
//! (Π f)(y) = Σ_c β_c f(c),   C = Φ_targetᵀ M_target Π Φ_source
//! ```
//!
//! Ezuz & Ben-Chen 2017. Barycentric coordinates β carry functions, points and embeddings alike.
//! The search is exact and keeps no more than the two embeddings in memory.

use faer::{Mat, MatRef};
use nalgebra::Point3;
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_spectral::LaplaceBasis;

use crate::{
    FmapError, FunctionalMap, PointMap, Side,
    convert::{check_basis, check_map, functions, nearest_adjoint_point_map},
    linear::product,
    map::check_size,
    nearest_triangle::{Triangles, nearest_in_space},
};

/// Largest deviation of a sum of barycentric coordinates from 1.
const SUM_TOLERANCE: f64 = 1e-6;

/// A point in a triangle of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointInFace {
    /// Index of the face.
    pub face: u32,
    /// The corners of the face.
    pub corners: [u32; 3],
    /// Weights of the corners: not negative, of sum 1.
    pub barycentric: [f64; 3],
}

/// A point in a triangle of the source for every target vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct PreciseMap {
    /// For every target vertex a point of the source.
    pub source_of_target: Vec<PointInFace>,
    /// Number of vertices of the source.
    pub n_source_vertices: usize,
}

/// In which space rows are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Embedding {
    /// Rows of Φ_target C against rows of Φ_source: k_source dimensions.
    #[default]
    Forward,
    /// Rows of Φ_target against rows of Φ_source Cᵀ: k_target dimensions. The two agree where C is
    /// orthogonal; for a part on a whole, k_target < k_source, this is the smaller space.
    Adjoint,
}

impl PointInFace {
    /// A vertex of the face: the corner with the largest weight, the first of equal ones.
    #[must_use]
    pub fn nearest_corner(&self) -> u32 {
        let mut best = 0;
        for i in 1..3 {
            if self.barycentric[i] > self.barycentric[best] {
                best = i;
            }
        }
        self.corners[best]
    }

    /// Where it lies in a mesh.
    ///
    /// # Panics
    /// If the mesh does not have the corners.
    #[must_use]
    pub fn position(&self, mesh: &TriMesh) -> Point3<f64> {
        let corners = self.corners.map(|v| mesh.vertices()[v as usize].coords);
        let [a, b, c] = self.barycentric;
        Point3::from(corners[0] * a + corners[1] * b + corners[2] * c)
    }
}

impl PreciseMap {
    /// Checks and takes a map.
    ///
    /// # Errors
    /// [`FmapError`] if there is no point, a corner is out of range or weights are no barycentric
    /// coordinates.
    pub fn new(
        source_of_target: Vec<PointInFace>,
        n_source_vertices: usize,
    ) -> Result<Self, FmapError> {
        let map = Self {
            source_of_target,
            n_source_vertices,
        };
        map.check()?;
        Ok(map)
    }

    /// The map whose points are the vertices of a point map.
    ///
    /// # Errors
    /// [`FmapError`] if the map does not belong to the mesh or an image has no face.
    pub fn from_point_map(source: &TriMesh, map: &PointMap) -> Result<Self, FmapError> {
        map.check_between(source.n_vertices(), map.n_target_vertices())?;
        let mut place = vec![None; source.n_vertices()];
        for (face, corners) in source.faces().iter().enumerate() {
            for (i, &v) in corners.iter().enumerate() {
                let slot: &mut Option<PointInFace> = &mut place[v as usize];
                slot.get_or_insert_with(|| {
                    let mut barycentric = [0.0; 3];
                    barycentric[i] = 1.0;
                    PointInFace {
                        face: face as u32,
                        corners: *corners,
                        barycentric,
                    }
                });
            }
        }
        let points = map.source_of_target.iter().enumerate().map(|(vertex, &v)| {
            place[v as usize].ok_or(FmapError::VertexWithoutFace {
                vertex: v,
                mapped_from: vertex,
            })
        });
        Ok(Self {
            source_of_target: points.collect::<Result<_, _>>()?,
            n_source_vertices: source.n_vertices(),
        })
    }

    /// The map that takes every given position to the nearest point of the source.
    ///
    /// # Errors
    /// [`FmapError`] if there is no position, one is not finite, or the source has no face with an
    /// area.
    pub fn from_positions(source: &TriMesh, positions: &[Point3<f64>]) -> Result<Self, FmapError> {
        for (row, p) in positions.iter().enumerate() {
            if let Some(column) = (0..3).find(|&i| !p[i].is_finite()) {
                return Err(FmapError::NonFinite {
                    what: "positions",
                    row,
                    column,
                    value: p[column],
                });
            }
        }
        let index = SurfaceIndex::new(source).map_err(|_| FmapError::Empty {
            what: "faces of the source with an area",
        })?;
        let points = positions.iter().map(|p| {
            let face = index.closest_point(p).face;
            let corners = source.triangle(face as usize).map(|c| c.coords.into());
            PointInFace {
                face,
                corners: source.faces()[face as usize],
                barycentric: nearest_in_space(&corners, &p.coords.into()),
            }
        });
        Self::new(points.collect(), source.n_vertices())
    }

    /// Number of vertices of the target.
    #[must_use]
    pub fn n_target_vertices(&self) -> usize {
        self.source_of_target.len()
    }

    /// The vertices nearest in barycentric coordinates.
    #[must_use]
    pub fn to_point_map(&self) -> PointMap {
        let points = self.source_of_target.iter();
        PointMap {
            source_of_target: points.map(PointInFace::nearest_corner).collect(),
            n_source_vertices: self.n_source_vertices,
        }
    }

    /// Where every target vertex lies on the source.
    ///
    /// # Errors
    /// [`FmapError`] if the mesh does not have as many vertices as the source.
    pub fn positions(&self, source: &TriMesh) -> Result<Vec<Point3<f64>>, FmapError> {
        self.check_between(source.n_vertices(), self.n_target_vertices())?;
        let points = self.source_of_target.iter();
        Ok(points.map(|p| p.position(source)).collect())
    }

    /// Checks the map itself and that it fits the two numbers of vertices.
    pub(crate) fn check_between(&self, n_source: usize, n_target: usize) -> Result<(), FmapError> {
        check_size(
            "source vertices of the precise map",
            self.n_source_vertices,
            n_source,
        )?;
        check_size(
            "target vertices of the precise map",
            self.n_target_vertices(),
            n_target,
        )?;
        self.check()
    }

    fn check(&self) -> Result<(), FmapError> {
        if self.source_of_target.is_empty() {
            return Err(FmapError::Empty {
                what: "points of the precise map",
            });
        }
        let n_vertices = self.n_source_vertices;
        for (vertex, point) in self.source_of_target.iter().enumerate() {
            if let Some(&image) = point.corners.iter().find(|&&v| v as usize >= n_vertices) {
                return Err(FmapError::ImageOutOfRange {
                    vertex,
                    image,
                    n_vertices,
                });
            }
            let sum: f64 = point.barycentric.iter().sum();
            let is_negative = point.barycentric.iter().any(|&b| b < -SUM_TOLERANCE);
            if is_negative || (sum - 1.0).abs() > SUM_TOLERANCE || sum.is_nan() {
                return Err(FmapError::BadBarycentric {
                    vertex,
                    barycentric: point.barycentric,
                });
            }
        }
        Ok(())
    }
}

/// The precise map nearest to a functional map.
///
/// `source_mesh` gives the triangles; its vertices are the rows of the basis of the source.
///
/// # Errors
/// [`FmapError`] if the mesh does not fit the basis, a basis has fewer functions than the map, or
/// a number is not finite.
pub fn precise_map_from_functional(
    source_mesh: &TriMesh,
    (source, target): (&LaplaceBasis, &LaplaceBasis),
    map: &FunctionalMap,
    embedding: Embedding,
) -> Result<PreciseMap, FmapError> {
    check_map(source, target, map)?;
    check_size(
        "vertices of the source mesh",
        source_mesh.n_vertices(),
        source.n_vertices(),
    )?;
    let faces = source_mesh.faces();
    let search = |embedded: MatRef<'_, f64>, queries: MatRef<'_, f64>| {
        Triangles::new(faces, embedded).nearest(queries)
    };
    let found = match embedding {
        Embedding::Forward => {
            let carried = product(functions(target, map.n_target()), map.matrix.as_ref());
            search(functions(source, map.n_source()), carried.as_ref())
        }
        Embedding::Adjoint => {
            let carried = carried_by_adjoint(source, map);
            search(carried.as_ref(), functions(target, map.n_target()))
        }
    };
    let points = found.iter().map(|nearest| PointInFace {
        face: nearest.face,
        corners: faces[nearest.face as usize],
        barycentric: nearest.barycentric,
    });
    PreciseMap::new(points.collect(), source.n_vertices())
}

/// The point map nearest to the adjoint of a functional map: the nearest row of Φ_source Cᵀ to
/// every row of Φ_target, in k_target dimensions.
///
/// # Errors
/// [`FmapError`] if a basis has fewer functions than the map, or a number is not finite.
pub fn point_map_from_adjoint(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &FunctionalMap,
) -> Result<PointMap, FmapError> {
    check_map(source, target, map)?;
    Ok(nearest_adjoint_point_map(source, target, map))
}

/// The functional map of a precise map in the first `n_source` and `n_target` functions.
///
/// # Errors
/// [`FmapError`] if the sizes do not fit or a basis has too few functions.
pub fn functional_from_precise_map(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    map: &PreciseMap,
    (n_target, n_source): (usize, usize),
) -> Result<FunctionalMap, FmapError> {
    check_basis(source, Side::Source, n_source)?;
    check_basis(target, Side::Target, n_target)?;
    map.check_between(source.n_vertices(), target.n_vertices())?;
    let mut weighted = map.pull_back(functions(source, n_source))?;
    for j in 0..n_source {
        let column = weighted.col_as_slice_mut(j);
        for (value, mass) in column.iter_mut().zip(&target.mass) {
            *value *= mass;
        }
    }
    Ok(FunctionalMap {
        matrix: product(functions(target, n_target).transpose(), weighted.as_ref()),
    })
}

/// Φ_source Cᵀ, n_source × k_target.
fn carried_by_adjoint(source: &LaplaceBasis, map: &FunctionalMap) -> Mat<f64> {
    product(functions(source, map.n_source()), map.matrix.transpose())
}
