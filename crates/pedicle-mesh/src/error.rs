//! What can be wrong with a mesh.

/// Why a mesh was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No vertex or no face.
    #[error("the mesh is empty: {n_vertices} vertices and {n_faces} faces")]
    Empty {
        /// Number of vertices given.
        n_vertices: usize,
        /// Number of faces given.
        n_faces: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite: ({x}, {y}, {z})")]
    NonFiniteVertex {
        /// Index of the vertex.
        vertex: usize,
        /// Its coordinates.
        x: f64,
        /// Its coordinates.
        y: f64,
        /// Its coordinates.
        z: f64,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are only {n_vertices} vertices")]
    FaceIndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// The index it names.
        vertex: u32,
        /// Number of vertices of the mesh.
        n_vertices: usize,
    },
    /// More vertices than 32-bit indices can name.
    #[error("the mesh has {n_vertices} vertices, more than the {max} that face indices can name")]
    TooManyVertices {
        /// Number of vertices given.
        n_vertices: usize,
        /// Largest number allowed.
        max: usize,
    },
    /// No face has an area, so the mesh is no surface.
    #[error("none of the {n_faces} faces has an area")]
    NoArea {
        /// Number of faces.
        n_faces: usize,
    },
    /// Products of the coordinates would overflow.
    #[error("vertex {vertex} has the coordinate {coordinate:e}, larger than the {max:e} allowed")]
    CoordinateTooLarge {
        /// Index of the vertex.
        vertex: usize,
        /// Its largest coordinate in magnitude.
        coordinate: f64,
        /// Largest magnitude allowed.
        max: f64,
    },
    /// Nothing is left after repair.
    #[error("repair leaves nothing of the {n_faces} faces")]
    NothingLeft {
        /// Number of faces before.
        n_faces: usize,
    },
    /// A mesh cannot be simplified to no faces.
    #[error("{target_faces} faces cannot make a surface; at least {min} are needed")]
    TargetTooSmall {
        /// Number of faces asked for.
        target_faces: usize,
        /// Smallest number allowed.
        min: usize,
    },
}
