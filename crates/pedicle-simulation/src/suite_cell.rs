//! The cells of the suites: what the draws of one line of a table have in common.

use crate::{Deformation, Suite};

/// How far neighbours move against each other in [`Suite::Motion`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MotionRange {
    /// Flexion, lateral bending and axial rotation within what a healthy disc allows, and up to
    /// 2 mm of translation.
    Physiological,
    /// Up to 15° about any axis and up to 5 mm of translation a level.
    Fifteen,
    /// Up to 25° about any axis and up to 5 mm of translation a level.
    TwentyFive,
}

impl MotionRange {
    /// All of them, from the smallest to the largest.
    pub const ALL: [Self; 3] = [Self::Physiological, Self::Fifteen, Self::TwentyFive];
}

/// What is made of a depth image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SensorForm {
    /// Points without normals, in random order.
    Cloud,
    /// A mesh over the pixel grid, torn where the depth jumps.
    Mesh,
}

impl SensorForm {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Cloud, Self::Mesh];
}

/// What is wrong in a cell of [`Suite::Stress`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stress {
    /// Nothing but much noise, on whole vertebrae.
    Whole,
    /// Nothing but much noise, on their back halves.
    Partial,
    /// Only the rear 30 % of the surface is left.
    Remnant,
    /// Every landmark is off by 10 mm.
    LandmarksOff,
    /// One landmark in all.
    OneLandmark,
    /// No landmark at all.
    NoLandmark,
    /// Two landmarks carry each other's names.
    LandmarksSwapped,
    /// Every landmark carries the name of its neighbour.
    LandmarksShifted,
    /// One vertebra is not in the target.
    LevelMissing,
    /// The target is the spine of somebody else.
    OtherPatient,
}

impl Stress {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Whole,
        Self::Partial,
        Self::Remnant,
        Self::LandmarksOff,
        Self::OneLandmark,
        Self::NoLandmark,
        Self::LandmarksSwapped,
        Self::LandmarksShifted,
        Self::LevelMissing,
        Self::OtherPatient,
    ];
}

/// One cell of a suite: what its draws have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SuiteCell {
    /// As published.
    Paper {
        /// What happens to the spine.
        deformation: Deformation,
        /// Standard deviation of the noise on every coordinate, mm.
        noise_mm: f64,
    },
    /// With a triangulation of its own.
    Resampled {
        /// What happens to the spine.
        deformation: Deformation,
        /// Standard deviation of the noise on every coordinate, mm.
        noise_mm: f64,
    },
    /// With a motion in every disc.
    Motion {
        /// How large.
        range: MotionRange,
        /// Standard deviation of the noise on every coordinate, mm.
        noise_mm: f64,
    },
    /// Seen by a depth camera.
    Sensor {
        /// What is made of the depth image.
        form: SensorForm,
        /// Share of the bone in view that soft tissue covers, 0 to 1.
        cover: f64,
        /// Standard deviation of the range at 500 mm and a right angle, mm.
        noise_mm: f64,
    },
    /// With something wrong.
    Stress {
        /// What.
        stress: Stress,
        /// Standard deviation of the noise on every coordinate, mm.
        noise_mm: f64,
    },
}

impl SuiteCell {
    /// The suite it belongs to.
    #[must_use]
    pub fn suite(&self) -> Suite {
        match self {
            Self::Paper { .. } => Suite::Paper,
            Self::Resampled { .. } => Suite::Resampled,
            Self::Motion { .. } => Suite::Motion,
            Self::Sensor { .. } => Suite::Sensor,
            Self::Stress { .. } => Suite::Stress,
        }
    }

    /// The noise, mm; of a sensor the one of its range at 500 mm.
    #[must_use]
    pub fn noise_mm(&self) -> f64 {
        match *self {
            Self::Paper { noise_mm, .. }
            | Self::Resampled { noise_mm, .. }
            | Self::Motion { noise_mm, .. }
            | Self::Sensor { noise_mm, .. }
            | Self::Stress { noise_mm, .. } => noise_mm,
        }
    }

    /// The target in words, without the noise: "partial", "up to 15° a level".
    #[must_use]
    pub fn target(&self) -> String {
        match self {
            Self::Paper { deformation, .. } | Self::Resampled { deformation, .. } => {
                deformation.to_string()
            }
            Self::Motion { range, .. } => match range {
                MotionRange::Physiological => "physiological motion",
                MotionRange::Fifteen => "up to 15° a level",
                MotionRange::TwentyFive => "up to 25° a level",
            }
            .to_owned(),
            Self::Sensor { form, cover, .. } => {
                let form = match form {
                    SensorForm::Cloud => "cloud",
                    SensorForm::Mesh => "mesh",
                };
                format!("{form}, {:.0} % covered", 100.0 * cover)
            }
            Self::Stress { stress, .. } => match stress {
                Stress::Whole => "whole",
                Stress::Partial => "partial",
                Stress::Remnant => "30 % left",
                Stress::LandmarksOff => "landmarks off by 10 mm",
                Stress::OneLandmark => "one landmark",
                Stress::NoLandmark => "no landmark",
                Stress::LandmarksSwapped => "two landmarks swapped",
                Stress::LandmarksShifted => "landmarks shifted by a level",
                Stress::LevelMissing => "a level missing",
                Stress::OtherPatient => "another patient",
            }
            .to_owned(),
        }
    }

    /// Numbers that tell this cell from every other.
    pub(crate) fn words(&self) -> [u64; 4] {
        let noise = self.noise_mm().to_bits();
        let suite = self.suite() as u64;
        match *self {
            Self::Paper { deformation, .. } | Self::Resampled { deformation, .. } => {
                [suite, deformation as u64, 0, noise]
            }
            Self::Motion { range, .. } => [suite, range as u64, 0, noise],
            Self::Sensor { form, cover, .. } => [suite, form as u64, cover.to_bits(), noise],
            Self::Stress { stress, .. } => [suite, stress as u64, 0, noise],
        }
    }
}

impl std::fmt::Display for SuiteCell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, noise {} mm", self.target(), self.noise_mm())
    }
}
