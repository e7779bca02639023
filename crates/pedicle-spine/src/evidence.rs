//! The figures that a verdict rests on.

use crate::margin::Spread;
use crate::misfit::Misfit;

/// The figures that the verdict on one vertebra rests on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Evidence {
    pub(crate) n_points: usize,
    pub(crate) posterior_coverage: f64,
    pub(crate) explained_share: f64,
    pub(crate) noise_mm: f64,
    /// Median noise of all vertebrae.
    pub(crate) others_noise_mm: f64,
    /// The same of a whole target; of a frame the vertebra's own, for those that are lost fit to anything.
    pub(crate) target_noise_mm: f64,
    /// Noise of the second quietest of the other vertebrae.
    pub(crate) quiet_noise_mm: f64,
    /// Whether a camera is known that saw the points.
    pub(crate) is_from_camera: bool,
    /// Whether its points are weighed by what they probably are. Those of a tracker are not.
    pub(crate) tells_tissue: bool,
    /// Standard deviations; none if there is no fit.
    pub(crate) deviations: Option<Deviations>,
    pub(crate) unexplained_share: f64,
    pub(crate) level_margin: f64,
    /// Whether the names of the landmarks agree with the levels found.
    pub(crate) landmarks_support_levels: bool,
    pub(crate) alternative_margin: f64,
    /// None without a landmark.
    pub(crate) landmark_distance_mm: Option<f64>,
    /// Whether its landmark lies where another vertebra has its own, and names may have changed places or moved on.
    pub(crate) landmark_is_of_another: bool,
    pub(crate) misfit: Misfit,
    /// Share of the bone that the camera saw through.
    pub(crate) seen_through: f64,
    /// Of the points close to it the share in front of it.
    pub(crate) hidden_share: f64,
    /// So many pixels of a camera tell as much as one, for they err alike; 1 where they do not.
    pub(crate) n_alike: f64,
    /// Noise of the target estimated from it alone.
    pub(crate) sensor_noise_mm: Option<f64>,
    /// Area of the bare bone that a camera saw, mm²; none without a camera, and where its points lie too far apart.
    pub(crate) bare_area_mm2: Option<f64>,
    /// Of the points on or behind the bone the share behind it; none where the area is.
    pub(crate) behind_share: Option<f64>,
}

/// Standard deviations of a pose: of the vertebra's centroid and its orientation along their axes, and of the worst end of a planned screw in its worst
/// direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Deviations {
    pub(crate) position_mm: Spread,
    pub(crate) orientation_rad: Spread,
    pub(crate) screw_mm: f64,
    /// Largest probability that a screw breaches the cortex.
    pub(crate) breach_probability: f64,
}
