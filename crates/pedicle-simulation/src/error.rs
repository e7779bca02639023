use pedicle_mesh::MeshError;
use pedicle_trajectory::Level;
use thiserror::Error;

/// Why a phantom or a scenario could not be made.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SimulationError {
    /// A dimension of the phantom is not a number or outside what the shape can hold.
    #[error(
        "{name} of {level} is {value}, which is outside the range from {min} to {max} the \
         phantom can be built with"
    )]
    ParameterOutOfRange {
        /// The level the dimension belongs to (the upper one for a disc).
        level: Level,
        /// Which dimension.
        name: &'static str,
        /// The value found.
        value: f64,
        /// Smallest accepted value.
        min: f64,
        /// Largest accepted value.
        max: f64,
    },
    /// An option of the mesher is outside its range.
    #[error("the meshing option {name} is {value}, but it must lie between {min} and {max}")]
    MeshingOptionOutOfRange {
        /// Which option.
        name: &'static str,
        /// The value found.
        value: f64,
        /// Smallest accepted value.
        min: f64,
        /// Largest accepted value.
        max: f64,
    },
    /// No grid of the ones tried gave one closed manifold surface.
    #[error(
        "the surface of {level} could not be meshed as one closed manifold: the last of {n_tried} \
         grids, with cells of {cell_mm} mm, left {n_bad_edges} open or branching edges, {n_pinched} \
         pinched vertices, {n_inverted} turned faces and {n_components} components"
    )]
    NotManifold {
        /// The level being meshed.
        level: Level,
        /// How many grids were tried.
        n_tried: usize,
        /// Cell size of the last grid, mm.
        cell_mm: f64,
        /// Edges that do not have exactly two faces.
        n_bad_edges: usize,
        /// Vertices whose faces form more than one fan.
        n_pinched: usize,
        /// Faces that look against the surface normal.
        n_inverted: usize,
        /// Connected components.
        n_components: usize,
    },
    /// The pedicle's axis does not meet the surface where a screw would enter or end.
    #[error(
        "the axis of the {side} pedicle of {level} does not leave the bone within {reach_mm} mm \
         of the isthmus"
    )]
    AxisMissesSurface {
        /// The level.
        level: Level,
        /// The side.
        side: pedicle_trajectory::Side,
        /// Distance searched, mm.
        reach_mm: f64,
    },
    /// There is no surface behind the end of the spinous process.
    #[error(
        "the spinous process of {level} has no surface within {reach_mm} mm behind its end: the \
         dimensions do not fit together"
    )]
    LandmarkMissesSurface {
        /// The level.
        level: Level,
        /// Distance searched, mm.
        reach_mm: f64,
    },
    /// A simulated case needs at least two vertebrae to have an axis.
    #[error("the spine case has {n_vertebrae} vertebrae, but at least {min} are needed")]
    TooFewVertebrae {
        /// Vertebrae given.
        n_vertebrae: usize,
        /// Vertebrae needed.
        min: usize,
    },
    /// The vertebrae are not given from the top down, each level once.
    #[error(
        "vertebra {index} is {level}, but the vertebrae must be given from the top down, each \
         level once"
    )]
    LevelsOutOfOrder {
        /// Position in the list.
        index: usize,
        /// The level found there.
        level: Level,
    },
    /// A vertebra has no landmark, or more than one.
    #[error("{level} has {n_landmarks} landmarks, but a simulated case needs exactly one")]
    LandmarkCount {
        /// The level.
        level: Level,
        /// Landmarks found for it.
        n_landmarks: usize,
    },
    /// A landmark is not finite.
    #[error("the landmark of {level} at ({x}, {y}, {z}) is not finite")]
    NonFiniteLandmark {
        /// The level.
        level: Level,
        /// First coordinate, mm.
        x: f64,
        /// Second coordinate, mm.
        y: f64,
        /// Third coordinate, mm.
        z: f64,
    },
    /// The direction that the spine and its landmarks should give has no length.
    #[error(
        "the {direction} direction of the spine cannot be derived: the points that give it are \
         {distance_mm} mm apart"
    )]
    DegenerateDirection {
        /// Which direction.
        direction: &'static str,
        /// Length of the vector that should give it, mm.
        distance_mm: f64,
    },
    /// The noise level of a scenario is negative or not a number.
    #[error("the noise of the scenario is {noise_mm} mm, but it must be finite and not negative")]
    NoiseOutOfRange {
        /// The value found, mm.
        noise_mm: f64,
    },
    /// The cut of a partial scenario leaves nothing of a vertebra.
    #[error("the cut leaves {n_faces_left} of the {n_faces} faces of {level}")]
    NothingLeft {
        /// The level.
        level: Level,
        /// Faces before the cut.
        n_faces: usize,
        /// Faces after the cut.
        n_faces_left: usize,
    },
    /// The camera sees nothing through the window of the wound.
    #[error("the camera sees nothing of the spine through the window of the wound")]
    NothingSeen,
    /// A cell without a camera was to be seen by one.
    #[error("the suite {suite} has no camera")]
    NoSensor {
        /// The suite of the cell.
        suite: crate::Suite,
    },
    /// A mesh could not be made.
    #[error("the simulated surface is not a valid mesh: {0}")]
    Mesh(#[from] MeshError),
}
