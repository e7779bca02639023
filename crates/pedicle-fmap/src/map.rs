//! Functional maps, point maps and the shapes between which they run.
//!
//! ```text
//! b = C a              C: k_target × k_source, functions from the source to the target
//! x = T(y)             one source vertex x for every target vertex y
//! (Π f)(y) = f(T(y))   the function that the point map carries over
//! ```
//!
//! Ovsjanikov, Ben-Chen, Solomon, Butscher & Guibas 2012.

use faer::Mat;
use pedicle_mesh::TriMesh;
use pedicle_spectral::LaplaceBasis;

use crate::FmapError;

/// A linear map of functions on the source to functions on the target, in their Laplace bases.
#[derive(Debug, Clone, PartialEq)]
pub struct FunctionalMap {
    /// C, k_target × k_source: coefficients b = C a.
    pub matrix: Mat<f64>,
}

/// One source vertex for every target vertex.
///
/// A map in the other direction is the same type with the two shapes exchanged: what is called
/// source here is then the target of the functional map.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointMap {
    /// For every target vertex the index of a source vertex.
    pub source_of_target: Vec<u32>,
    /// Number of vertices of the source.
    pub n_source_vertices: usize,
}

/// Point maps in both directions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointMapPair {
    /// One source vertex for every target vertex.
    pub target_to_source: PointMap,
    /// One target vertex for every source vertex.
    pub source_to_target: PointMap,
}

/// A shape as the fit and the refinements see it.
#[derive(Debug, Clone, Copy)]
pub struct Shape<'a> {
    /// Its surface; the vertices in the order of the rows of the basis.
    pub mesh: &'a TriMesh,
    /// Its Laplace basis.
    pub basis: &'a LaplaceBasis,
    /// Functions that mean the same on both shapes, one a column, n_vertices × p.
    pub descriptors: &'a Mat<f64>,
}

impl FunctionalMap {
    /// Number of functions of the source, k_source.
    #[must_use]
    pub fn n_source(&self) -> usize {
        self.matrix.ncols()
    }

    /// Number of functions of the target, k_target.
    #[must_use]
    pub fn n_target(&self) -> usize {
        self.matrix.nrows()
    }

    /// The adjoint Cᵀ: the map back, if C preserves areas.
    #[must_use]
    pub fn adjoint(&self) -> Self {
        Self {
            matrix: self.matrix.transpose().to_owned(),
        }
    }
}

impl PointMap {
    /// Checks and takes a map.
    ///
    /// # Errors
    /// [`FmapError`] if there is no vertex or an image is out of range.
    pub fn new(source_of_target: Vec<u32>, n_source_vertices: usize) -> Result<Self, FmapError> {
        let map = Self {
            source_of_target,
            n_source_vertices,
        };
        map.check()?;
        Ok(map)
    }

    /// Every vertex to itself.
    ///
    /// # Errors
    /// [`FmapError::Empty`] if there is no vertex.
    pub fn identity(n_vertices: usize) -> Result<Self, FmapError> {
        Self::new((0..n_vertices as u32).collect(), n_vertices)
    }

    /// Number of vertices of the target.
    #[must_use]
    pub fn n_target_vertices(&self) -> usize {
        self.source_of_target.len()
    }

    /// The source vertex of one target vertex.
    ///
    /// # Panics
    /// If there is no such target vertex.
    #[must_use]
    pub fn image(&self, target_vertex: usize) -> usize {
        self.source_of_target[target_vertex] as usize
    }

    /// Checks that there is a vertex and that every image exists.
    pub(crate) fn check(&self) -> Result<(), FmapError> {
        if self.source_of_target.is_empty() {
            return Err(FmapError::Empty {
                what: "vertices of the point map",
            });
        }
        let n_vertices = self.n_source_vertices;
        match self
            .source_of_target
            .iter()
            .position(|&image| image as usize >= n_vertices)
        {
            Some(vertex) => Err(FmapError::ImageOutOfRange {
                vertex,
                image: self.source_of_target[vertex],
                n_vertices,
            }),
            None => Ok(()),
        }
    }

    /// Checks the map itself and that it fits the two numbers of vertices.
    pub(crate) fn check_between(&self, n_source: usize, n_target: usize) -> Result<(), FmapError> {
        check_size(
            "source vertices of the point map",
            self.n_source_vertices,
            n_source,
        )?;
        check_size(
            "target vertices of the point map",
            self.n_target_vertices(),
            n_target,
        )?;
        self.check()
    }
}

pub(crate) fn check_size(
    what: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), FmapError> {
    if found == expected {
        Ok(())
    } else {
        Err(FmapError::SizeMismatch {
            what,
            found,
            expected,
        })
    }
}

pub(crate) fn check_finite(what: &'static str, matrix: &Mat<f64>) -> Result<(), FmapError> {
    for column in 0..matrix.ncols() {
        for (row, &value) in matrix.col_as_slice(column).iter().enumerate() {
            if !value.is_finite() {
                return Err(FmapError::NonFinite {
                    what,
                    row,
                    column,
                    value,
                });
            }
        }
    }
    Ok(())
}
