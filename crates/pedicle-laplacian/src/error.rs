//! Why operators could not be made.

/// What is wrong with the mesh or the options, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OperatorError {
    /// A face has (nearly) no area, so its cotangents do not exist.
    #[error(
        "face {face} is degenerate: its area is {area_mm2} mm² and its longest edge {longest_edge_mm} mm; \
         repair the mesh or ask for mollification"
    )]
    DegenerateFace {
        /// Index of the face.
        face: usize,
        /// Its area, mm².
        area_mm2: f64,
        /// Its longest edge, mm.
        longest_edge_mm: f64,
    },
    /// A face names one vertex twice.
    #[error("face {face} names vertex {vertex} more than once; repair the mesh")]
    RepeatedVertex {
        /// Index of the face.
        face: usize,
        /// The vertex it repeats.
        vertex: u32,
    },
    /// No face uses a vertex, so its mass would be zero.
    #[error("vertex {vertex} belongs to no face; repair the mesh to remove it")]
    UnreferencedVertex {
        /// Index of the vertex.
        vertex: usize,
    },
    /// An option is outside its range.
    #[error("option {option} is {value}, but must be a number between 0 and 1")]
    InvalidOption {
        /// Name of the option.
        option: &'static str,
        /// Value given.
        value: f64,
    },
}
