//! What can be wrong with a mesh, a query or an option.

/// Why distances could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeodesicError {
    /// A query names a vertex that does not exist.
    #[error("vertex {vertex} is asked for, but there are only {n_vertices}")]
    VertexOutOfRange {
        /// The vertex asked for.
        vertex: u32,
        /// Number of vertices there are.
        n_vertices: usize,
    },
    /// Distances from no vertex at all.
    #[error("no vertex to measure from is given, at least one is needed")]
    NoSource,
    /// A number of a query or an option makes no sense.
    #[error("{what} is {value}; {requirement}")]
    InvalidValue {
        /// What was given.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        requirement: &'static str,
    },
    /// The operators do not belong to the mesh.
    #[error("{what}: {found} where {expected} were expected")]
    SizeMismatch {
        /// What was counted.
        what: &'static str,
        /// The number found.
        found: usize,
        /// The number expected.
        expected: usize,
    },
    /// The mesh has no Laplacian.
    #[error("the mesh has no Laplacian: {0}")]
    Operators(#[from] pedicle_laplacian::OperatorError),
    /// A matrix of the heat method is not positive definite.
    #[error("the {matrix} matrix of {n} rows could not be factorised: {reason}")]
    Factorization {
        /// Which matrix.
        matrix: &'static str,
        /// Its rows.
        n: usize,
        /// What the solver says.
        reason: String,
    },
}

/// Checks that every vertex exists.
pub(crate) fn check_vertices(
    vertices: impl IntoIterator<Item = u32>,
    n_vertices: usize,
) -> Result<(), GeodesicError> {
    match vertices.into_iter().find(|&v| v as usize >= n_vertices) {
        Some(vertex) => Err(GeodesicError::VertexOutOfRange { vertex, n_vertices }),
        None => Ok(()),
    }
}
