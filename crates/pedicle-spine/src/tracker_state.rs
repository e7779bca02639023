//! What the tracker says about every vertebra of a frame, and its settings.

use nalgebra::Isometry3;
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::Level;

use crate::{Rejection, SpineError, VerdictOptions};

/// Settings of a [`SpineTracker`](crate::SpineTracker).
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOptions {
    /// Points of a frame that find the motion, on the simplified surfaces. Default 1200.
    pub n_search_points: usize,
    /// Points of a frame near the vertebrae that the last fit uses, on the full-resolution surfaces.
    /// Default 3000.
    pub n_fine_points: usize,
    /// Gates of the rounds of the search, mm. Default 10, 6, 4.
    pub gates_mm: Vec<f64>,
    /// Farthest that a vertebra may move from one frame to the next beyond the motion of the whole
    /// spine, mm. Default 6.
    pub max_jump_mm: f64,
    /// The same for its turn, rad. Default 0.14 (8°).
    pub max_jump_rad: f64,
    /// Farthest that the whole spine may move since the last frame in which a vertebra was tracked, mm. Default 15: at half
    /// the distance of two vertebrae one could be taken for the other.
    pub max_spine_jump_mm: f64,
    /// A vertebra lost for so many frames is not looked for any more: a new transfer is needed. Default 100.
    pub max_frames_lost: usize,
    /// What a fit has to show, as in a transfer. The plan, landmarks, other poses and the shape of the bones are not asked, so that less noise is allowed
    /// than there: 1.5 mm of a camera and 2.3 mm without one, and smaller deviations: 0.6 mm and 1.5°; 6 % of the points may lie
    /// behind a bone.
    pub verdict: VerdictOptions,
    /// Seed of the choice of points.
    pub seed: u64,
}

impl Default for TrackerOptions {
    fn default() -> Self {
        Self {
            n_search_points: 1200,
            n_fine_points: 3000,
            gates_mm: vec![10.0, 6.0, 4.0],
            max_jump_mm: 6.0,
            max_jump_rad: 0.14,
            max_spine_jump_mm: 15.0,
            max_frames_lost: 100,
            // Frames are fitted to the closest places, which tell less of noisier points than their rays and their density.
            verdict: VerdictOptions {
                max_noise_mm: 2.3,
                max_noise_of_camera_mm: 1.5,
                max_behind_share: 0.06,
                max_translation_std_mm: 0.6,
                max_rotation_std_rad: 0.027,
                ..VerdictOptions::default()
            },
            seed: 0,
        }
    }
}

impl TrackerOptions {
    /// Whether the settings make sense.
    pub(crate) fn check(&self) -> Result<(), SpineError> {
        let named = [
            ("n_search_points", self.n_search_points as f64),
            ("n_fine_points", self.n_fine_points as f64),
            ("number of gates_mm", self.gates_mm.len() as f64),
            ("max_jump_mm", self.max_jump_mm),
            ("max_jump_rad", self.max_jump_rad),
            ("max_spine_jump_mm", self.max_spine_jump_mm),
            ("max_frames_lost", self.max_frames_lost as f64),
        ];
        let gates = self.gates_mm.iter().map(|&gate| ("gates_mm", gate));
        for (name, value) in named.into_iter().chain(gates) {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SpineError::InvalidOption { name, value });
            }
        }
        Ok(())
    }
}

/// Why a vertebra is lost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum LostReason {
    /// The first result did not vouch for it, and tracking cannot make up for that.
    NotAccepted,
    /// Its fit in this frame does not pass the tests of a transfer.
    Doubted {
        /// The first test that it fails.
        reason: Rejection,
    },
    /// It moved farther than a vertebra can between two frames.
    Jumped {
        /// Beyond where the whole spine or tracked neighbours have taken it, mm.
        translation_mm: f64,
        /// The same turn, rad.
        rotation_rad: f64,
    },
    /// The whole spine moved farther than can be followed, or cannot be found.
    SpineJumped,
    /// It has been lost for so long that nobody knows where to look.
    TooLong {
        /// Frames since it was seen last.
        n_frames: usize,
    },
    /// It lies or is turned against the next tracked vertebra as no spine allows.
    AgainstNeighbour {
        /// That vertebra.
        neighbour: Level,
    },
}

impl std::fmt::Display for LostReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NotAccepted => f.write_str("the first result did not vouch for it"),
            Self::Doubted { reason } => write!(f, "{reason}"),
            Self::Jumped {
                translation_mm,
                rotation_rad,
            } => write!(
                f,
                "it jumped by {translation_mm:.1} mm and {:.1}° against the spine",
                rotation_rad.to_degrees()
            ),
            Self::SpineJumped => f.write_str("the whole spine jumped or is not in view"),
            Self::TooLong { n_frames } => write!(
                f,
                "it has been lost for {n_frames} frames: a new transfer is needed"
            ),
            Self::AgainstNeighbour { neighbour } => {
                write!(f, "it lies against {neighbour} as no spine allows")
            }
        }
    }
}

/// Whether a vertebra is followed.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackState {
    /// Its pose is that of this frame.
    Tracking,
    /// It is not known where it is in this frame.
    Lost {
        /// Why.
        reason: LostReason,
    },
}

/// One vertebra in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedVertebra {
    /// Its level.
    pub level: Level,
    /// Whether the pose may be used.
    pub state: TrackState,
    /// Its rigid motion, source frame to the frame of the points. If it is lost: a fit near the
    /// last known pose that nobody vouches for, or that pose, carried along by what is tracked. Where to look
    /// for it, not where it is.
    pub target_from_source: Isometry3<f64>,
    /// Of the pose, about the vertebra's centroid in the target frame; none if it is lost.
    pub covariance: Option<PoseCovariance>,
    /// Points of the last fit on it.
    pub n_points: usize,
    /// Root mean square distance of the inliers from its surface, mm; NaN if it is lost.
    pub residual_mm: f64,
    /// Estimated noise of its points, mm; NaN without a fit.
    pub noise_mm: f64,
    /// Frames since it was seen last, 0 if it is tracked.
    pub n_frames_lost: usize,
}

impl TrackedVertebra {
    /// Whether the pose may be used.
    #[must_use]
    pub fn is_tracked(&self) -> bool {
        self.state == TrackState::Tracking
    }
}

/// All vertebrae in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedFrame {
    /// One entry a level, L1 first.
    pub vertebrae: Vec<TrackedVertebra>,
    /// Median noise of the points over the tracked vertebrae, mm; NaN if all are lost.
    pub noise_mm: f64,
}

impl TrackedFrame {
    /// Whether every vertebra is followed.
    #[must_use]
    pub fn all_tracked(&self) -> bool {
        self.vertebrae.iter().all(TrackedVertebra::is_tracked)
    }
}
