//! What can be wrong with a request for descriptors.

/// Why descriptors could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DescriptorError {
    /// No time or energy was asked for.
    #[error("at least one time or energy is needed, but 0 were asked for")]
    NoSamples,
    /// A time or energy given by hand cannot be used.
    #[error("sample {index} is {value}; times must be positive and finite, energies finite")]
    InvalidSample {
        /// Index of the sample.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The spread of the wave kernel is not positive and finite.
    #[error("the spread of the wave kernel is {spread}; it must be positive and finite")]
    InvalidSpread {
        /// The spread given.
        spread: f64,
    },
    /// The basis holds the null space and hardly anything else.
    #[error(
        "the basis has {n_functions} functions of which {null_dimension} span the null space; \
         at least {needed} above it are needed"
    )]
    NothingAboveNullSpace {
        /// Number of functions in the basis.
        n_functions: usize,
        /// Dimension of the null space.
        null_dimension: usize,
        /// Number of functions needed above the null space.
        needed: usize,
    },
    /// An eigenvalue above the null space is not positive and finite.
    #[error("eigenvalue {index} above the null space is {value}; it must be positive and finite")]
    InvalidEigenvalue {
        /// Index of the eigenvalue.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The spectra of the two shapes have no interval in common.
    #[error(
        "the spectra above the null space have no interval in common: the larger of the two \
         lower ends is {lower}, the smaller of the two upper ends is {upper}"
    )]
    DisjointSpectra {
        /// Larger of the two lower ends, 1/mm².
        lower: f64,
        /// Smaller of the two upper ends, 1/mm².
        upper: f64,
    },
    /// A landmark names a vertex that does not exist.
    #[error("the landmark names vertex {vertex}, but there are only {n_vertices} vertices")]
    LandmarkOutOfRange {
        /// The vertex named.
        vertex: usize,
        /// Number of vertices of the shape.
        n_vertices: usize,
    },
    /// A landmark patch is empty, or its weights do not add up to something positive.
    #[error(
        "the {n_vertices} weights of the landmark patch add up to {sum}; every weight must be \
         finite and not negative, and their sum positive"
    )]
    InvalidPatch {
        /// Number of vertices in the patch.
        n_vertices: usize,
        /// Sum of the weights.
        sum: f64,
    },
}
