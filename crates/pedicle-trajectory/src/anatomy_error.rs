//! Why anatomy could not be found in a shape.

use crate::{Level, Side};

/// Why anatomy could not be found in a shape.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AnatomyError {
    /// One vertebra has no chain of centroids.
    #[error("directions need at least {min} vertebrae, but {n_vertebrae} were given")]
    TooFewVertebrae {
        /// Number given.
        n_vertebrae: usize,
        /// Number needed.
        min: usize,
    },
    /// A level is given twice.
    #[error("{level} is given twice")]
    DuplicateLevel {
        /// The level.
        level: Level,
    },
    /// Something has no direction.
    #[error("{what} give no direction: zero, parallel or not finite")]
    NoDirection {
        /// What has no direction.
        what: &'static str,
    },
    /// No vertex near the mirror plane.
    #[error("no vertex lies within {band_mm} mm of the mirror plane, so no spinous process")]
    NoSpinousProcess {
        /// Half width of the band, mm.
        band_mm: f64,
    },
    /// No section of the mirror plane looks like a body with a canal behind it.
    #[error("the section in the mirror plane shows no vertebral body with a canal behind it")]
    NoCanal,
    /// No section looks like a pedicle.
    #[error("no pedicle was found on the {side} side: {reason}")]
    NoPedicle {
        /// The side.
        side: Side,
        /// What was missing.
        reason: &'static str,
    },
    /// The mesh cannot be indexed.
    #[error("the surface cannot be searched: {0}")]
    Mesh(#[from] pedicle_mesh::MeshError),
}
