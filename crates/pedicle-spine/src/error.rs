//! What can be wrong with a spine, a plan or a target.

use pedicle_trajectory::{Level, Side};

/// Which of the two shapes an error speaks of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// The pre-operative spine the plan was drawn on.
    Source,
    /// The intra-operative surface.
    Target,
}

impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Source => "source",
            Self::Target => "target",
        })
    }
}

/// Why a transfer could not be attempted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpineError {
    /// A level of the source spine is not there.
    #[error("the source spine has no {level}: L1 to L5 are needed, each once")]
    MissingLevel {
        /// The level.
        level: Level,
    },
    /// A level of the source spine is there twice.
    #[error("the source spine has {level} more than once: L1 to L5 are needed, each once")]
    DoubledLevel {
        /// The level.
        level: Level,
    },
    /// A landmark is missing.
    #[error("the {shape} landmarks have none for {level}: one is needed for each of L1 to L5")]
    MissingLandmark {
        /// Which landmarks.
        shape: Shape,
        /// The level.
        level: Level,
    },
    /// Two landmarks for one level.
    #[error("the {shape} landmarks name {level} more than once")]
    DoubledLandmark {
        /// Which landmarks.
        shape: Shape,
        /// The level.
        level: Level,
    },
    /// A landmark that is not finite.
    #[error("the {shape} landmark of {level} is not finite")]
    NonFiniteLandmark {
        /// Which landmarks.
        shape: Shape,
        /// The level.
        level: Level,
    },
    /// A landmark that cannot belong to this surface.
    #[error(
        "the {shape} landmark of {level} is {distance_mm:.1} mm away from the {shape} surface \
         (at most {max_distance_mm:.0} mm allowed): is it given in the frame of this surface?"
    )]
    LandmarkFarFromSurface {
        /// Which landmarks.
        shape: Shape,
        /// The level.
        level: Level,
        /// Distance to the nearest vertex.
        distance_mm: f64,
        /// Largest distance allowed.
        max_distance_mm: f64,
    },
    /// A setting that makes no sense.
    #[error("the option {name} is {value}, but it must be positive and finite")]
    InvalidOption {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The source is no spine in millimetres.
    #[error(
        "the source spine is {source_mm:.3} mm long, but five lumbar vertebrae are {min_mm:.0} to \
         {max_mm:.0} mm long: are its coordinates in millimetres?"
    )]
    SourceSize {
        /// Diagonal of the source's bounding box.
        source_mm: f64,
        /// Shortest accepted.
        min_mm: f64,
        /// Longest accepted.
        max_mm: f64,
    },
    /// A plan without trajectories.
    #[error("the plan has no trajectories")]
    EmptyPlan,
    /// A trajectory that does not lie on its vertebra.
    #[error(
        "the {side} trajectory of {level} is {distance_mm:.1} mm away from {level} of the source \
         spine (at most {max_distance_mm:.0} mm allowed): is this the plan of another spine?"
    )]
    PlanOffSpine {
        /// The trajectory's level.
        level: Level,
        /// The trajectory's side.
        side: Side,
        /// Largest distance of its entry, middle and tip from the vertebra.
        distance_mm: f64,
        /// Largest distance allowed.
        max_distance_mm: f64,
    },
    /// A trajectory that lies on the other side of its vertebra.
    #[error(
        "the {side} trajectory of {level} enters {distance_mm:.1} mm to the other side of the \
         vertebra's middle: are left and right exchanged in the plan?"
    )]
    PlanSide {
        /// The trajectory's level.
        level: Level,
        /// The side it names.
        side: Side,
        /// Distance of its entry from the mirror plane, on the wrong side.
        distance_mm: f64,
    },
    /// Source and target are of different orders of magnitude.
    #[error("the target is {target_mm:.4} mm long and the source {source_mm:.4} mm: {hint}")]
    UnitMismatch {
        /// Diagonal of the target's bounding box.
        target_mm: f64,
        /// Diagonal of the source's bounding box.
        source_mm: f64,
        /// What it looks like.
        hint: &'static str,
    },
    /// The simplified surface is too coarse for the basis.
    #[error(
        "the {shape} surface has {n_vertices} vertices for the map, too few for {n_functions} \
         eigenfunctions (at least {needed} needed)"
    )]
    TooFewVertices {
        /// Which shape.
        shape: Shape,
        /// Vertices of the surface prepared for the map.
        n_vertices: usize,
        /// Eigenfunctions asked for.
        n_functions: usize,
        /// Vertices needed.
        needed: usize,
    },
    /// A mesh could not be repaired or simplified.
    #[error("the {shape} surface could not be prepared: {error}")]
    Mesh {
        /// Which shape.
        shape: Shape,
        /// Why.
        error: pedicle_mesh::MeshError,
    },
    /// The operators could not be assembled.
    #[error("the Laplacian of the {shape} surface could not be assembled: {error}")]
    Operators {
        /// Which shape.
        shape: Shape,
        /// Why.
        error: pedicle_laplacian::OperatorError,
    },
    /// The spectrum could not be computed.
    #[error("the spectrum of the {shape} surface could not be computed: {error}")]
    Spectrum {
        /// Which shape.
        shape: Shape,
        /// Why.
        error: pedicle_spectral::SpectralError,
    },
    /// The descriptors could not be computed.
    #[error("the descriptors could not be computed: {0}")]
    Descriptors(#[from] pedicle_descriptors::DescriptorError),
    /// The functional map could not be computed.
    #[error("the functional map could not be computed: {0}")]
    Map(#[from] pedicle_fmap::FmapError),
    /// The anatomy of the source could not be read from its shape.
    #[error("the anatomy of the source spine could not be read: {0}")]
    Anatomy(#[from] pedicle_trajectory::AnatomyError),
    /// A point of a cloud, or of a tracked frame, that is not finite.
    #[error("point {point} of the target has a coordinate that is not finite")]
    NonFinitePoint {
        /// Its index.
        point: usize,
    },
    /// A camera before which no point of the target lies, or that has no place.
    #[error("the camera at ({}, {}, {}) mm sees no point of the target", camera_mm.x, camera_mm.y, camera_mm.z)]
    BlindCamera {
        /// Where it stands, target frame, mm.
        camera_mm: nalgebra::Point3<f64>,
    },
    /// A cloud of too few points.
    #[error("the target has {n_points} points, too few for anything (at least {needed} needed)")]
    TooFewPoints {
        /// Points of the cloud.
        n_points: usize,
        /// Points needed.
        needed: usize,
    },
    /// A search tree could not be built.
    #[error("the surface could not be indexed: {reason}")]
    Index {
        /// Why.
        reason: String,
    },
    /// A frame without points.
    #[error("the frame has no points")]
    EmptyFrame,
    /// The tracker needs a pose for every vertebra.
    #[error("there are {n_poses} poses for {n_vertebrae} vertebrae")]
    PoseCount {
        /// Poses given.
        n_poses: usize,
        /// Vertebrae of the source.
        n_vertebrae: usize,
    },
    /// A pose to start from that is not finite.
    #[error("the pose of {level} is not finite")]
    NonFinitePose {
        /// The level.
        level: Level,
    },
    /// No vertebra to follow.
    #[error("the first result vouches for no vertebra: there is nothing to track")]
    NothingToTrack,
}
