//! The dimensions one phantom is built from, and the ranges they may take.

use pedicle_trajectory::{Level, Side};

use crate::SimulationError;

/// A pedicle thinner than this is not meshed faithfully.
pub(crate) const SMALLEST_PEDICLE_WIDTH_MM: f64 = 5.0;

/// What belongs to one side of a vertebra.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SideParameters {
    /// Width of the pedicle at its isthmus, square to its axis, mm.
    pub pedicle_width_mm: f64,
    /// Height of the pedicle at its isthmus, mm.
    pub pedicle_height_mm: f64,
    /// Angle of the pedicle's axis with the sagittal plane, rad, converging to the front.
    pub pedicle_transverse_rad: f64,
    /// Rise of the pedicle's axis to the front, rad.
    pub pedicle_sagittal_rad: f64,
    /// Distance of the upper facet's centre from the midline, mm.
    pub facet_offset_mm: f64,
    /// Angle of the upper facet's plane with the sagittal plane, rad.
    pub facet_angle_rad: f64,
    /// Distance of the transverse process's tip from the midline, mm.
    pub transverse_reach_mm: f64,
    /// Rise of the transverse process to its tip, rad.
    pub transverse_elevation_rad: f64,
}

/// The dimensions of one vertebra and of the disc below it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelParameters {
    /// Width of the upper endplate, mm.
    pub body_width_upper_mm: f64,
    /// Width of the lower endplate, mm.
    pub body_width_lower_mm: f64,
    /// Depth of the upper endplate, mm.
    pub body_depth_upper_mm: f64,
    /// Depth of the lower endplate, mm.
    pub body_depth_lower_mm: f64,
    /// Height of the front of the body, mm.
    pub body_height_anterior_mm: f64,
    /// Height of the back of the body, mm.
    pub body_height_posterior_mm: f64,
    /// Height of the disc below, mm. Below L5 it only places the lower facets.
    pub disc_height_mm: f64,
    /// Opening of the disc below to the front, rad.
    pub disc_angle_rad: f64,
    /// Width of the vertebral canal between the pedicles, mm.
    pub canal_width_mm: f64,
    /// Depth of the vertebral canal, mm.
    pub canal_depth_mm: f64,
    /// Thickness of the laminae, mm.
    pub lamina_thickness_mm: f64,
    /// Height of the laminae, mm.
    pub lamina_height_mm: f64,
    /// Width of the facets, mm.
    pub facet_width_mm: f64,
    /// Height of the facets, mm.
    pub facet_height_mm: f64,
    /// Half height of the transverse processes at the root, mm.
    pub transverse_half_height_mm: f64,
    /// Distance from the back of the body to the tip of the spinous process, mm.
    pub spinous_reach_mm: f64,
    /// Height of the spinous process, mm.
    pub spinous_height_mm: f64,
    /// Thickness of the spinous process, mm.
    pub spinous_thickness_mm: f64,
    /// Fall of the spinous process to its tip, rad.
    pub spinous_slope_rad: f64,
    /// Offset of the tip of the spinous process to the right, mm.
    pub spinous_deviation_mm: f64,
    /// Left and right, in the order of [`Side`].
    pub sides: [SideParameters; 2],
}

impl LevelParameters {
    /// The dimensions of one side.
    #[must_use]
    pub fn side(&self, side: Side) -> &SideParameters {
        &self.sides[side as usize]
    }

    /// Height of the body half-way between its front and its back, mm.
    #[must_use]
    pub fn body_height_mm(&self) -> f64 {
        0.5 * (self.body_height_anterior_mm + self.body_height_posterior_mm)
    }

    /// Mean depth of the body, mm.
    #[must_use]
    pub fn body_depth_mm(&self) -> f64 {
        0.5 * (self.body_depth_upper_mm + self.body_depth_lower_mm)
    }

    /// Where the back of the body lies in front of the body's centre (negative), mm.
    pub(crate) fn back_of_body_mm(&self) -> f64 {
        -0.5 * self.body_depth_mm()
    }

    /// Angle of either endplate with the plane half-way between them, rad; positive if the front
    /// is the higher side.
    #[must_use]
    pub fn half_wedge_rad(&self) -> f64 {
        let rise = self.body_height_anterior_mm - self.body_height_posterior_mm;
        (0.5 * rise / self.body_depth_mm()).atan()
    }
}

/// Everything a phantom is built from.
#[derive(Debug, Clone, PartialEq)]
pub struct PhantomParameters {
    /// L1 to L5.
    pub levels: [LevelParameters; 5],
    /// Gap left in the facet joints, mm.
    pub facet_gap_mm: f64,
    /// Amplitude of the low relief of the bone's surface, mm.
    pub relief_mm: f64,
    /// Phase of the relief along x, y and z, rad: what makes two equal bones different.
    pub relief_phase_rad: [f64; 3],
}

impl PhantomParameters {
    /// The dimensions of one level.
    #[must_use]
    pub fn level(&self, level: Level) -> &LevelParameters {
        &self.levels[level.index()]
    }

    /// Checks that every dimension is one the shape can be built with.
    ///
    /// # Errors
    /// [`SimulationError::ParameterOutOfRange`] for the first dimension that is not.
    pub fn validate(&self) -> Result<(), SimulationError> {
        for level in Level::ALL {
            let p = self.level(level);
            let mut checks = vec![
                ("the upper body width", p.body_width_upper_mm, 20.0, 80.0),
                ("the lower body width", p.body_width_lower_mm, 20.0, 80.0),
                ("the upper body depth", p.body_depth_upper_mm, 15.0, 60.0),
                ("the lower body depth", p.body_depth_lower_mm, 15.0, 60.0),
                (
                    "the anterior body height",
                    p.body_height_anterior_mm,
                    12.0,
                    50.0,
                ),
                (
                    "the posterior body height",
                    p.body_height_posterior_mm,
                    12.0,
                    50.0,
                ),
                ("the disc height", p.disc_height_mm, 3.0, 20.0),
                ("the disc angle", p.disc_angle_rad, -0.3, 0.5),
                ("the canal width", p.canal_width_mm, 12.0, 40.0),
                ("the canal depth", p.canal_depth_mm, 9.0, 30.0),
                ("the lamina thickness", p.lamina_thickness_mm, 4.0, 12.0),
                ("the lamina height", p.lamina_height_mm, 8.0, 32.0),
                ("the facet width", p.facet_width_mm, 7.0, 24.0),
                ("the facet height", p.facet_height_mm, 8.0, 26.0),
                (
                    "the transverse half height",
                    p.transverse_half_height_mm,
                    3.0,
                    12.0,
                ),
                ("the spinous reach", p.spinous_reach_mm, 25.0, 80.0),
                ("the spinous height", p.spinous_height_mm, 8.0, 36.0),
                ("the spinous thickness", p.spinous_thickness_mm, 4.0, 14.0),
                ("the spinous slope", p.spinous_slope_rad, -0.3, 1.0),
                ("the spinous deviation", p.spinous_deviation_mm, -8.0, 8.0),
                ("the facet gap", self.facet_gap_mm, 0.5, 4.0),
                ("the relief", self.relief_mm, 0.0, 0.6),
            ];
            checks.extend(
                self.relief_phase_rad
                    .map(|x| ("the relief phase", x, -1e3, 1e3)),
            );
            for side in &p.sides {
                checks.extend([
                    (
                        "the pedicle width",
                        side.pedicle_width_mm,
                        SMALLEST_PEDICLE_WIDTH_MM,
                        24.0,
                    ),
                    (
                        "the pedicle height",
                        side.pedicle_height_mm,
                        SMALLEST_PEDICLE_WIDTH_MM,
                        22.0,
                    ),
                    (
                        "the pedicle transverse angle",
                        side.pedicle_transverse_rad,
                        0.0,
                        0.7,
                    ),
                    (
                        "the pedicle sagittal angle",
                        side.pedicle_sagittal_rad,
                        -0.3,
                        0.3,
                    ),
                    ("the facet offset", side.facet_offset_mm, 8.0, 28.0),
                    ("the facet angle", side.facet_angle_rad, 0.0, 1.3),
                    ("the transverse reach", side.transverse_reach_mm, 25.0, 65.0),
                    (
                        "the transverse elevation",
                        side.transverse_elevation_rad,
                        -0.6,
                        0.8,
                    ),
                ]);
            }
            for (name, value, min, max) in checks {
                if !(min..=max).contains(&value) {
                    return Err(SimulationError::ParameterOutOfRange {
                        level,
                        name,
                        value,
                        min,
                        max,
                    });
                }
            }
        }
        Ok(())
    }
}
