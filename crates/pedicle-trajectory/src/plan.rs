//! Named trajectories and landmarks.
//!
//! Millimetres in whatever frame the vertebrae are in. The serde form of these types is the
//! file format: a level is its name (`L4`), a side `left` or `right`, a point three numbers.

use std::str::FromStr;

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::names::{UnknownName, deserialize_name};

/// Largest screw diameter taken for real, mm.
pub const MAX_DIAMETER_MM: f64 = 20.0;

/// A lumbar level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
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
    pub(crate) const NAMES: [&'static str; 5] = ["L1", "L2", "L3", "L4", "L5"];

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
            .find(|level| level.name().eq_ignore_ascii_case(name.trim()))
    }

    /// The name: "L1" to "L5".
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self.index()]
    }
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Level {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name).ok_or_else(|| UnknownName::new("level", name, &Self::NAMES))
    }
}

impl<'de> Deserialize<'de> for Level {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserialize_name(deserializer, "Level", &Self::NAMES)
    }
}

/// The patient's side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs, reason = "the names of the sides are their meaning")]
pub enum Side {
    Left,
    Right,
}

impl Side {
    /// Both sides, left first.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];
    pub(crate) const NAMES: [&'static str; 2] = ["left", "right"];

    /// The side called `name` ("left" or "right", any case).
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|side| side.name().eq_ignore_ascii_case(name.trim()))
    }

    /// The name: "left" or "right".
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// +1 on the left and -1 on the right: the sign of the coordinate along `left`.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    /// The other side.
    #[must_use]
    pub fn opposite(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
        }
    }
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Side {
    type Err = UnknownName;

    fn from_str(name: &str) -> Result<Self, UnknownName> {
        Self::from_name(name).ok_or_else(|| UnknownName::new("side", name, &Self::NAMES))
    }
}

impl<'de> Deserialize<'de> for Side {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserialize_name(deserializer, "Side", &Self::NAMES)
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
    #[serde(with = "crate::names::point")]
    pub entry_mm: Point3<f64>,
    /// Where the screw ends, mm.
    #[serde(with = "crate::names::point")]
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

    /// Checks that the numbers describe a screw.
    ///
    /// # Errors
    /// [`TrajectoryDefect`] for a number that is not finite, an entry that is the tip or a
    /// diameter outside (0, 20] mm.
    pub fn validate(&self) -> Result<(), TrajectoryDefect> {
        let ends = [("entry_mm", self.entry_mm), ("tip_mm", self.tip_mm)];
        for (what, p) in ends {
            if !p.coords.iter().all(|c| c.is_finite()) {
                let (x, y, z) = (p.x, p.y, p.z);
                return Err(TrajectoryDefect::NonFinite { what, x, y, z });
            }
        }
        // NaN is not inside the range either.
        if !(self.diameter_mm > 0.0 && self.diameter_mm <= MAX_DIAMETER_MM) {
            return Err(TrajectoryDefect::Diameter {
                diameter_mm: self.diameter_mm,
                max_mm: MAX_DIAMETER_MM,
            });
        }
        if self.length_mm() < MIN_LENGTH_MM {
            return Err(TrajectoryDefect::TooShort {
                length_mm: self.length_mm(),
                min_mm: MIN_LENGTH_MM,
            });
        }
        Ok(())
    }
}

/// Shortest distance from entry to tip for which a direction means anything, mm.
const MIN_LENGTH_MM: f64 = 1e-3;

/// What is wrong with the numbers of one trajectory.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrajectoryDefect {
    /// A coordinate is NaN or infinite.
    #[error("its {what} is not finite: ({x}, {y}, {z})")]
    NonFinite {
        /// Name of the field.
        what: &'static str,
        /// Its coordinates, mm.
        x: f64,
        /// Its coordinates, mm.
        y: f64,
        /// Its coordinates, mm.
        z: f64,
    },
    /// The diameter is not that of a screw.
    #[error("its diameter_mm is {diameter_mm}, but it must be above 0 and at most {max_mm}")]
    Diameter {
        /// Diameter given, mm.
        diameter_mm: f64,
        /// Largest diameter allowed, mm.
        max_mm: f64,
    },
    /// Entry and tip are the same point.
    #[error(
        "its entry_mm and tip_mm are only {length_mm} mm apart, but a screw needs at least {min_mm}"
    )]
    TooShort {
        /// Distance from entry to tip, mm.
        length_mm: f64,
        /// Least distance allowed, mm.
        min_mm: f64,
    },
}

/// A surgical plan: the trajectories in their order.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The planned screws.
    pub trajectories: Vec<Trajectory>,
}

impl Plan {
    /// The trajectory of one pedicle.
    #[must_use]
    pub fn trajectory(&self, level: Level, side: Side) -> Option<&Trajectory> {
        self.trajectories
            .iter()
            .find(|t| t.level == level && t.side == side)
    }

    /// Checks every trajectory, and that there is at least one and at most one a pedicle.
    ///
    /// # Errors
    /// [`PlanError`] naming the first trajectory that is wrong, with its level and side.
    pub fn validate(&self) -> Result<(), PlanError> {
        if self.trajectories.is_empty() {
            return Err(PlanError::Empty);
        }
        for (index, t) in self.trajectories.iter().enumerate() {
            let (level, side) = (t.level, t.side);
            t.validate().map_err(|defect| PlanError::Trajectory {
                index,
                level,
                side,
                defect,
            })?;
            let same = |other: &Trajectory| other.level == level && other.side == side;
            if let Some(first) = self.trajectories[..index].iter().position(same) {
                return Err(PlanError::Duplicate {
                    first,
                    second: index,
                    level,
                    side,
                });
            }
        }
        Ok(())
    }
}

/// Why a plan is no plan.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// There is no trajectory.
    #[error("the plan has no trajectory")]
    Empty,
    /// One trajectory has wrong numbers.
    #[error("trajectory {index} ({level} {side}) is wrong: {defect}")]
    Trajectory {
        /// Index of the trajectory, from 0.
        index: usize,
        /// Its level.
        level: Level,
        /// Its side.
        side: Side,
        /// What is wrong with it.
        defect: TrajectoryDefect,
    },
    /// Two trajectories for one pedicle.
    #[error("trajectories {first} and {second} are both for {level} {side}")]
    Duplicate {
        /// Index of the first of the two.
        first: usize,
        /// Index of the second.
        second: usize,
        /// Their level.
        level: Level,
        /// Their side.
        side: Side,
    },
}

/// One rough landmark: the top of the spinous process of a vertebra.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Landmark {
    /// Level of the vertebra.
    pub level: Level,
    /// Position, mm.
    #[serde(with = "crate::names::point")]
    pub position_mm: Point3<f64>,
}

/// The landmarks of a spine.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Landmarks {
    /// At most one landmark a level.
    pub landmarks: Vec<Landmark>,
}

impl Landmarks {
    /// The landmark of one level.
    #[must_use]
    pub fn landmark(&self, level: Level) -> Option<&Landmark> {
        self.landmarks.iter().find(|l| l.level == level)
    }

    /// Checks that positions are finite and that no level has two; no landmark at all is fine.
    ///
    /// # Errors
    /// [`LandmarkError`] naming the first landmark that is wrong.
    pub fn validate(&self) -> Result<(), LandmarkError> {
        for (index, landmark) in self.landmarks.iter().enumerate() {
            let (level, p) = (landmark.level, landmark.position_mm);
            if !p.coords.iter().all(|c| c.is_finite()) {
                let (x, y, z) = (p.x, p.y, p.z);
                return Err(LandmarkError::NonFinite {
                    index,
                    level,
                    x,
                    y,
                    z,
                });
            }
            let same = |other: &Landmark| other.level == level;
            if let Some(first) = self.landmarks[..index].iter().position(same) {
                return Err(LandmarkError::Duplicate {
                    first,
                    second: index,
                    level,
                });
            }
        }
        Ok(())
    }
}

/// Why landmarks cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LandmarkError {
    /// A coordinate is NaN or infinite.
    #[error("landmark {index} ({level}) is not finite: ({x}, {y}, {z})")]
    NonFinite {
        /// Index of the landmark, from 0.
        index: usize,
        /// Its level.
        level: Level,
        /// Its coordinates, mm.
        x: f64,
        /// Its coordinates, mm.
        y: f64,
        /// Its coordinates, mm.
        z: f64,
    },
    /// Two landmarks for one level.
    #[error("landmarks {first} and {second} are both for {level}")]
    Duplicate {
        /// Index of the first of the two.
        first: usize,
        /// Index of the second.
        second: usize,
        /// Their level.
        level: Level,
    },
}
