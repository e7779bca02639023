//! What can be wrong with the input of a registration, and when there is no answer.

/// Why a registration was refused or found no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegistrationError {
    /// Fewer points than the computation needs.
    #[error("there are {n_points} points, but at least {n_needed} are needed")]
    TooFewPoints {
        /// Number of points given.
        n_points: usize,
        /// Smallest number that works.
        n_needed: usize,
    },
    /// More points than the search tree can number.
    #[error("there are {n_points} points, but at most {max} can be indexed")]
    TooManyPoints {
        /// Number of points given.
        n_points: usize,
        /// Largest number that works.
        max: usize,
    },
    /// Point pairs need as many source points as target points.
    #[error("there are {n_source} source points but {n_target} target points")]
    PointCountsDiffer {
        /// Number of source points.
        n_source: usize,
        /// Number of target points.
        n_target: usize,
    },
    /// Every point pair needs its weight.
    #[error("there are {n_points} point pairs but {n_weights} weights")]
    WeightCountDiffers {
        /// Number of point pairs.
        n_points: usize,
        /// Number of weights.
        n_weights: usize,
    },
    /// Every surface point needs its normal.
    #[error("there are {n_points} points but {n_normals} normals")]
    NormalCountDiffers {
        /// Number of points.
        n_points: usize,
        /// Number of normals.
        n_normals: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("{set} point {index} is not finite: ({x}, {y}, {z})")]
    NonFinitePoint {
        /// Which set of points: source, target, surface or center.
        set: &'static str,
        /// Index of the point in its set.
        index: usize,
        /// Its coordinates.
        x: f64,
        /// Its coordinates.
        y: f64,
        /// Its coordinates.
        z: f64,
    },
    /// The initial pose has a NaN or infinite entry.
    #[error("the initial pose is not finite")]
    NonFinitePose,
    /// A weight is zero, negative, NaN or infinite.
    #[error("weight {index} is {weight}, but weights must be positive and finite")]
    BadWeight {
        /// Index of the weight.
        index: usize,
        /// Its value.
        weight: f64,
    },
    /// A normal is zero, NaN or infinite and so has no direction.
    #[error("normal {index} has length {length} and so no direction")]
    BadNormal {
        /// Index of the normal.
        index: usize,
        /// Its length.
        length: f64,
    },
    /// The point pairs are coincident or collinear, or several rotations fit them equally well.
    #[error(
        "{n_points} point pairs do not determine the rotation: \
         its relative stiffness is {stiffness:e}, at least {needed:e} is needed"
    )]
    RotationUndetermined {
        /// Number of point pairs.
        n_points: usize,
        /// Gap between the best and the second best rotation, relative to the spread; 0..1.
        stiffness: f64,
        /// Smallest gap accepted.
        needed: f64,
    },
    /// The surface can slide or turn without being noticed (a plane, a sphere, a cylinder).
    #[error(
        "the surface does not determine the pose: the smallest eigenvalue of the information is \
         {smallest_eigenvalue:e}, the largest {largest_eigenvalue:e}"
    )]
    Degenerate {
        /// Smallest eigenvalue of the information, per point, rotations scaled by the radius.
        smallest_eigenvalue: f64,
        /// Largest eigenvalue of the same matrix.
        largest_eigenvalue: f64,
    },
    /// An option or parameter lies outside its range.
    #[error("{option} is {value}, but it must be {expected}")]
    OptionOutOfRange {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// No sample found a pose that enough pairs agree on.
    #[error("after {n_trials} trials the best pose has {n_inliers} inliers, {n_needed} are needed")]
    NoConsensus {
        /// Inliers of the best pose, 0 if every sample was degenerate.
        n_inliers: usize,
        /// Smallest number accepted.
        n_needed: usize,
        /// Samples tried.
        n_trials: usize,
    },
    /// Too few target points lie near the surface to refine a pose.
    #[error(
        "only {n_within} of {n_points} target points lie within {max_distance_mm} mm of the \
         surface, {n_needed} are needed"
    )]
    TooFewWithinReach {
        /// Points within the gate.
        n_within: usize,
        /// Points given.
        n_points: usize,
        /// Smallest number accepted.
        n_needed: usize,
        /// The gate at that iteration, mm.
        max_distance_mm: f64,
    },
}
