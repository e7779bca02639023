//! What speaks against trusting a measured shape.

use crate::{Level, Side};

/// One reason not to trust what was measured. Limits stand beside the value that broke them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Doubt {
    /// The surface has a rim: volumes and insides mean little.
    OpenSurface {
        /// Number of rims.
        n_rims: usize,
    },
    /// The heights of the body differ as they do after a collapse (Genant et al., J. Bone Miner.
    /// Res. 8(9), 1993: a loss of 20 % or more is a fracture).
    Collapsed {
        /// The lower wall over the higher, or the middle over the mean of both: the lesser ratio.
        height_ratio: f64,
        /// Least ratio of a sound body.
        min_ratio: f64,
    },
    /// The body is far higher or lower than those of the other levels.
    BodyHeight {
        /// Middle height, mm.
        height_mm: f64,
        /// Median of the spine, mm.
        median_mm: f64,
    },
    /// No disc is left towards a neighbour.
    Fused {
        /// The neighbour.
        with: Level,
        /// Least distance between the bodies, mm.
        gap_mm: f64,
    },
    /// No pedicle was found on one side.
    MissingPedicle {
        /// The side.
        side: Side,
    },
    /// Sections do not get larger on both sides of the narrowest one.
    NoNeck {
        /// The side.
        side: Side,
    },
    /// The neck is too short to tell its axis; the axis is that of the deepest line instead.
    ShortNeck {
        /// The side.
        side: Side,
        /// Length along which sections are at most 10 % larger than the isthmus, mm.
        neck_mm: f64,
        /// Length needed, mm.
        min_mm: f64,
    },
    /// A size that no lumbar pedicle has.
    PedicleSize {
        /// The side.
        side: Side,
        /// Shortest chord of the isthmus, mm.
        narrowest_mm: f64,
        /// Height, mm.
        height_mm: f64,
    },
    /// The axis points where no lumbar pedicle does.
    PedicleDirection {
        /// The side.
        side: Side,
        /// Transverse angle, degrees.
        transverse_deg: f64,
        /// Sagittal angle, degrees.
        sagittal_deg: f64,
    },
    /// The two pedicles differ by more than they do in people.
    Asymmetric {
        /// Narrowest chord on the left, mm.
        left_mm: f64,
        /// Narrowest chord on the right, mm.
        right_mm: f64,
    },
}

impl Doubt {
    /// Whether the measure is still good for a first plan: only the axis is less certain.
    #[must_use]
    pub fn is_minor(&self) -> bool {
        matches!(self, Self::ShortNeck { .. })
    }
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::OpenSurface { n_rims } => write!(f, "the surface is not closed: {n_rims} rims"),
            Self::Collapsed {
                height_ratio,
                min_ratio,
            } => write!(
                f,
                "the body may have collapsed: one of its heights is {height_ratio:.2} of another (sound: {min_ratio})"
            ),
            Self::BodyHeight {
                height_mm,
                median_mm,
            } => write!(
                f,
                "the body is {height_mm:.1} mm high, the median of the spine is {median_mm:.1}"
            ),
            Self::Fused { with, gap_mm } => {
                write!(
                    f,
                    "no disc towards {with}: the bodies are {gap_mm:.1} mm apart"
                )
            }
            Self::MissingPedicle { side } => write!(f, "no {side} pedicle"),
            Self::NoNeck { side } => write!(f, "the {side} pedicle has no narrowest section"),
            Self::ShortNeck {
                side,
                neck_mm,
                min_mm,
            } => write!(
                f,
                "{side}: axis from the deepest line, as the neck is only {neck_mm:.1} mm long ({min_mm} needed)"
            ),
            Self::PedicleSize {
                side,
                narrowest_mm,
                height_mm,
            } => write!(
                f,
                "the {side} isthmus of {narrowest_mm:.1} x {height_mm:.1} mm is not of a lumbar pedicle"
            ),
            Self::PedicleDirection {
                side,
                transverse_deg,
                sagittal_deg,
            } => write!(
                f,
                "the {side} axis points {transverse_deg:.0}° medially and {sagittal_deg:.0}° up"
            ),
            Self::Asymmetric { left_mm, right_mm } => write!(
                f,
                "the pedicles differ: {left_mm:.1} mm on the left, {right_mm:.1} mm on the right"
            ),
        }
    }
}

/// How far a measured vertebra may be relied upon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Confidence {
    /// Something essential is missing or implausible.
    Low,
    /// Sizes can be relied upon, the direction of an axis less.
    Fair,
    /// Nothing speaks against it.
    High,
}

impl Confidence {
    /// What some doubts leave.
    #[must_use]
    pub fn after(doubts: &[Doubt]) -> Self {
        match doubts.iter().all(Doubt::is_minor) {
            true if doubts.is_empty() => Self::High,
            true => Self::Fair,
            false => Self::Low,
        }
    }

    /// "low", "fair" or "high".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Low => "low",
            Self::Fair => "fair",
            Self::High => "high",
        }
    }
}

impl std::fmt::Display for Confidence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}
