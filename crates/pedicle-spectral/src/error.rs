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
    #[error(
        "the factorisation of the block of row {first_row} shifted by {shift} failed: {reason}"
    )]
    Factorization {
        /// First row of the connected block.
        first_row: usize,
        /// The shift μ.
        shift: f64,
        /// What went wrong.
        reason: String,
    },
    /// The dense eigensolver failed.
    #[error(
        "the dense eigensolver failed on a matrix of {n_rows} rows in the block of row {first_row}"
    )]
    Dense {
        /// First row of the connected block.
        first_row: usize,
        /// Rows of the dense matrix.
        n_rows: usize,
    },
    /// The iteration ended before every pair was found.
    #[error(
        "only {n_converged} of {requested} eigenpairs below the shift {shift} converged in the \
         block of row {first_row}; the largest relative residual is {worst_residual}"
    )]
    NotConverged {
        /// First row of the connected block.
        first_row: usize,
        /// Number of pairs that converged.
        n_converged: usize,
        /// Number of pairs that inertia says there are.
        requested: usize,
        /// The shift μ.
        shift: f64,
        /// Largest residual among the wanted pairs, relative to the shift.
        worst_residual: f64,
        /// Residuals of the wanted pairs that were found, the smallest eigenvalue first, relative
        /// to the shift.
        residuals: Vec<f64>,
    },
    /// The guess of a warm start does not fit the matrix.
    #[error("the known vectors have {n_known} rows, but the matrix has {n_rows}")]
    KnownSizeDiffers {
        /// Rows of the known vectors.
        n_known: usize,
        /// Rows of the matrix.
        n_rows: usize,
    },
    /// A known vector has an entry that is NaN or infinite.
    #[error("entry {row} of known vector {column} is {value}, which is not finite")]
    KnownNotFinite {
        /// Row of the entry.
        row: usize,
        /// The vector.
        column: usize,
        /// The value.
        value: f64,
    },
}

impl SpectralError {
    /// The same error, with the connected block where it happened.
    pub(crate) fn in_block(mut self, row: usize) -> Self {
        match &mut self {
            Self::Factorization { first_row, .. }
            | Self::Dense { first_row, .. }
            | Self::NotConverged { first_row, .. } => *first_row = row,
            _ => {}
        }
        self
    }
}
