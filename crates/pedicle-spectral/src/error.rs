//! Why eigenpairs could not be computed.

/// What is wrong with the matrices or the request, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectralError {
    /// The stiffness matrix is not square.
    #[error("the stiffness matrix is not square: {rows} rows and {columns} columns")]
    NotSquare {
        /// Number of rows.
        rows: usize,
        /// Number of columns.
        columns: usize,
    },
    /// Stiffness and mass have different sizes.
    #[error("the stiffness matrix has {n_rows} rows, but there are {n_masses} masses")]
    SizesDiffer {
        /// Rows of the stiffness matrix.
        n_rows: usize,
        /// Length of the mass diagonal.
        n_masses: usize,
    },
    /// A mass is zero, negative or not a number.
    #[error("the mass of row {row} is {value}, but must be positive and finite")]
    NonPositiveMass {
        /// The row.
        row: usize,
        /// Its mass.
        value: f64,
    },
    /// An entry of the stiffness matrix is NaN or infinite.
    #[error("entry ({row}, {column}) of the stiffness matrix is {value}, which is not finite")]
    NotFinite {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// Its value.
        value: f64,
    },
    /// Two entries that mirror each other differ.
    #[error(
        "the stiffness matrix is not symmetric: entry ({row}, {column}) is {value}, \
         but its mirror image is {mirrored}"
    )]
    NotSymmetric {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// Its value.
        value: f64,
        /// Value of the entry with row and column swapped.
        mirrored: f64,
    },
    /// No pair was asked for.
    #[error("no eigenpair was asked for")]
    NoPairs,
    /// More pairs than the matrix has.
    #[error("{requested} eigenpairs were asked for, but the matrix has only {available}")]
    TooManyPairs {
        /// Number asked for.
        requested: usize,
        /// Number of rows.
        available: usize,
    },
    /// An option is outside its range.
    #[error("option {option} is {value}, which is out of range: {range}")]
    InvalidOption {
        /// Name of the option.
        option: &'static str,
        /// Value given.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// The sparse factorisation of W - μM failed.
    #[error("the factorisation of the matrix shifted by {shift} failed: {reason}")]
    Factorization {
        /// The shift μ.
        shift: f64,
        /// What went wrong.
        reason: String,
    },
    /// The dense eigensolver failed.
    #[error("the dense eigensolver failed on a matrix of {n_rows} rows")]
    Dense {
        /// Rows of the dense matrix.
        n_rows: usize,
    },
    /// The iteration ended before every pair was found.
    #[error(
        "only {n_converged} of {requested} eigenpairs below the shift {shift} converged; \
         the largest relative residual is {worst_residual}"
    )]
    NotConverged {
        /// Number of pairs that converged.
        n_converged: usize,
        /// Number of pairs that inertia says there are.
        requested: usize,
        /// The shift μ.
        shift: f64,
        /// Largest residual among the wanted pairs, relative to the shift.
        worst_residual: f64,
    },
}
