//! What can be wrong with shapes, maps and options.

/// Why a map could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FmapError {
    /// Two things that belong together differ in size.
    #[error("{what}: {found} where {expected} were expected")]
    SizeMismatch {
        /// What was counted.
        what: &'static str,
        /// The number found.
        found: usize,
        /// The number expected.
        expected: usize,
    },
    /// Nothing to work on.
    #[error("{what}: none given, at least one is needed")]
    Empty {
        /// What is missing.
        what: &'static str,
    },
    /// More functions are asked for than the basis has.
    #[error("{requested} functions of the {side} are asked for, but its basis has {available}")]
    BasisTooSmall {
        /// Which of the two shapes.
        side: Side,
        /// Number of functions asked for.
        requested: usize,
        /// Number of functions there are.
        available: usize,
    },
    /// A number is NaN or infinite.
    #[error("{what}: entry ({row}, {column}) is {value}")]
    NonFinite {
        /// Which matrix.
        what: &'static str,
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// A point map names a vertex that does not exist.
    #[error("vertex {vertex} is mapped to vertex {image}, but there are only {n_vertices}")]
    ImageOutOfRange {
        /// The vertex whose image is wrong.
        vertex: usize,
        /// The image it was given.
        image: u32,
        /// Number of vertices it may choose from.
        n_vertices: usize,
    },
    /// A point map names a vertex that no face uses.
    #[error("vertex {mapped_from} is mapped to vertex {vertex}, which no face uses")]
    VertexWithoutFace {
        /// The image without a face.
        vertex: u32,
        /// The vertex that is mapped to it.
        mapped_from: usize,
    },
    /// Weights in a triangle are negative or do not sum to 1.
    #[error("vertex {vertex} has the weights {barycentric:?}; they must be positive, of sum 1")]
    BadBarycentric {
        /// The vertex that is mapped.
        vertex: usize,
        /// Its weights.
        barycentric: [f64; 3],
    },
    /// Distances on a shape could not be measured.
    #[error("distances cannot be measured: {0}")]
    Geodesic(#[from] pedicle_geodesic::GeodesicError),
    /// An option has a value that makes no sense.
    #[error("option {option} is {value}; {requirement}")]
    InvalidOption {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it has to be.
        requirement: &'static str,
    },
    /// A descriptor column chosen for an operator does not exist.
    #[error("descriptor column {column} is asked for, but there are only {n_columns}")]
    ColumnOutOfRange {
        /// The column asked for.
        column: usize,
        /// Number of columns there are.
        n_columns: usize,
    },
    /// A matrix could not be decomposed.
    #[error("the {rows} x {columns} matrix of {what} could not be decomposed")]
    Decomposition {
        /// What the matrix stands for.
        what: &'static str,
        /// Its rows.
        rows: usize,
        /// Its columns.
        columns: usize,
    },
}

/// One of the two shapes of a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The shape functions come from.
    Source,
    /// The shape functions go to.
    Target,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Source => "source",
            Self::Target => "target",
        })
    }
}
