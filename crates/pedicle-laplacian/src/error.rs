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
    /// All faces are without area or name a vertex twice, so there is no surface.
    #[error("none of the {n_faces} faces has an area, so there is no surface to work on")]
    NoArea {
        /// Number of faces given.
        n_faces: usize,
    },
    /// Three or more faces share an edge, which one sheet cannot have.
    #[error(
        "the edge between vertices {} and {} has {n_faces} faces; at most 2 make one sheet, \
         use the robust construction instead",
        edge[0], edge[1]
    )]
    NonManifoldEdge {
        /// The edge, lower vertex first.
        edge: [u32; 2],
        /// Number of its faces.
        n_faces: usize,
    },
    /// The surface has one side only, which one sheet of turned faces cannot have.
    #[error(
        "the surface is not orientable: face {face} would have to turn both ways; \
         use the robust construction instead"
    )]
    NotOrientable {
        /// A face on a way around the surface that comes back reversed.
        face: usize,
    },
    /// A point of a cloud is not finite.
    #[error("point {point} of the cloud is ({x}, {y}, {z}), which is not finite")]
    NonFinitePoint {
        /// Index of the point.
        point: usize,
        /// Its x, mm.
        x: f64,
        /// Its y, mm.
        y: f64,
        /// Its z, mm.
        z: f64,
    },
    /// A cloud has too few different points for a surface.
    #[error("the cloud has {n_points} different points, but a surface needs at least {min}")]
    TooFewPoints {
        /// Number of different points.
        n_points: usize,
        /// Smallest number that will do.
        min: usize,
    },
    /// Too few neighbours were asked for.
    #[error(
        "{n_neighbors} neighbours a point were asked for, but local triangles need at least {min}"
    )]
    TooFewNeighbors {
        /// Number asked for.
        n_neighbors: usize,
        /// Smallest number that will do.
        min: usize,
    },
    /// The points do not make triangles, for instance because they lie on a line.
    #[error("the {n_points} points of the cloud make no triangle: they lie on a line")]
    NoTriangles {
        /// Number of different points.
        n_points: usize,
    },
    /// The cloud is too large or too small for its squared distances.
    #[error("the cloud is {extent_mm} mm large, whose square cannot be computed with")]
    Extent {
        /// Diagonal of the bounding box, mm.
        extent_mm: f64,
    },
    /// The neighbours of the points could not be searched for.
    #[error("the search for neighbours in the cloud failed: {reason}")]
    NeighborSearch {
        /// What the search said.
        reason: String,
    },
    /// A construction that needs faces was asked for on a cloud.
    #[error("construction {construction} needs faces, but a cloud of points has none")]
    CloudHasNoFaces {
        /// Name of the construction.
        construction: &'static str,
    },
    /// The boundary of a cloud was asked for.
    #[error("a cloud of points has no boundary edges; name the fixed points with Boundary::Fixed")]
    CloudHasNoBoundary,
    /// A fixed vertex does not exist.
    #[error("vertex {vertex} is to be fixed, but there are only {n_vertices} vertices")]
    VertexOutOfRange {
        /// The vertex.
        vertex: u32,
        /// Number of vertices.
        n_vertices: usize,
    },
    /// Every vertex is fixed or left out, so the operators would be empty.
    #[error("none of the {n_vertices} vertices is free: all are fixed or belong to no face")]
    NoFreeVertex {
        /// Number of vertices.
        n_vertices: usize,
    },
    /// A mass came out as zero or not finite: the surface is too small or too large for f64.
    #[error("the mass of vertex {vertex} is {mass_mm2} mm², but must be positive and finite")]
    NotMeasurable {
        /// Index of the vertex.
        vertex: u32,
        /// Its mass, mm².
        mass_mm2: f64,
    },
}
