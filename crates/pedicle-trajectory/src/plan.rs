//! Named trajectories and landmarks.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A lumbar level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[allow(missing_docs, reason = "the names of the levels are their meaning")]
pub enum Level {
    L1,
    L2,
    L3,
    L4,
    L5,
}

impl Level {
    /// All levels from the top down.
    pub const ALL: [Self; 5] = [Self::L1, Self::L2, Self::L3, Self::L4, Self::L5];

    /// Position from the top: 0 for L1 to 4 for L5.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// The level called `name` ("L1" to "L5", any case).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|level| level.to_string().eq_ignore_ascii_case(name.trim()))
    }
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "L{}", self.index() + 1)
    }
}

/// The patient's side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names of the sides are their meaning")]
pub enum Side {
    Left,
    Right,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Left => "left",
            Self::Right => "right",
        })
    }
}

/// One planned screw: a straight line from the bone's surface to the tip, with a diameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Level of the vertebra.
    pub level: Level,
    /// Side of the pedicle.
    pub side: Side,
    /// Where the screw's axis enters the bone, mm.
    pub entry_mm: Point3<f64>,
    /// Where the screw ends, mm.
    pub tip_mm: Point3<f64>,
    /// Outer diameter of the screw, mm.
    pub diameter_mm: f64,
}

impl Trajectory {
    /// Distance from entry to tip, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        (self.tip_mm - self.entry_mm).norm()
    }

    /// Unit vector from entry to tip; zero if the two coincide.
    #[must_use]
    pub fn direction(&self) -> Vector3<f64> {
        (self.tip_mm - self.entry_mm)
            .try_normalize(f64::MIN_POSITIVE)
            .unwrap_or_else(Vector3::zeros)
    }

    /// The trajectory after a rigid motion.
    #[must_use]
    pub fn transformed(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            entry_mm: motion * self.entry_mm,
            tip_mm: motion * self.tip_mm,
            ..*self
        }
    }
}

/// A surgical plan: the trajectories in their order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The planned screws.
    pub trajectories: Vec<Trajectory>,
}

/// One rough landmark: the top of the spinous process of a vertebra.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Landmark {
    /// Level of the vertebra.
    pub level: Level,
    /// Position, mm.
    pub position_mm: Point3<f64>,
}

/// The landmarks of a spine.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Landmarks {
    /// At most one landmark a level.
    pub landmarks: Vec<Landmark>,
}
