//! The dimensions one phantom is built from: the mean spine, or a subject drawn around it.
//!
//! A drawn dimension is
//!
//!     mean + deviation · z,   z = 0.6 g + 0.7 r + 0.39 e   (cut off at ±1.7)
//!
//! with standard normal g shared by the whole subject (size; left out for angles), r shared by the
//! dimension over the levels (shape) and e of its own. The squares add up to 1. Left and right
//! differ by about 2 % and 1.5°.

use nalgebra::clamp;
use pedicle_trajectory::{Level, Side};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::SimulationError;
use crate::morphometry::{self as table, MorphometryRow};

/// Shares of the common size, the dimension and the single value in a drawn dimension.
const SHARES: [f64; 3] = [0.6, 0.7, 0.39];
/// Draws are cut off here, in standard deviations, so that every subject can be built.
const LARGEST_DRAW: f64 = 1.7;
/// Relative difference of a side from the mean of both (standard deviation).
const SIDE_DEVIATION: f64 = 0.02;
/// Difference of an angle of a side from the mean of both (standard deviation), degrees.
const SIDE_ANGLE_DEVIATION_DEG: f64 = 1.5;
/// The mean spine is not a mirror image of itself either: fixed draws, one a level.
const MEAN_SPINE_ASYMMETRY: [f64; 5] = [0.7, -0.5, 0.9, -0.8, 0.6];
/// Sideways lean of the tip of the spinous process (standard deviation), mm.
const SPINOUS_DEVIATION_MM: f64 = 1.2;

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

impl Default for PhantomParameters {
    /// The mean of the published tables, with a slight fixed asymmetry.
    fn default() -> Self {
        Self::drawn(&mut |_, _| 0.0, &mut |level, index| {
            let flip = if index % 2 == 0 { 1.0 } else { -1.0 };
            flip * MEAN_SPINE_ASYMMETRY[(level + index) % 5]
        })
    }
}

impl PhantomParameters {
    /// A subject: the same seed gives the same spine, another seed another one.
    #[must_use]
    pub fn subject(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
        let size = normal();
        let n_rows = table::TABLE.len();
        let shape: Vec<f64> = (0..n_rows).map(|_| normal()).collect();
        let own: Vec<f64> = (0..5 * n_rows).map(|_| normal()).collect();
        let sides: Vec<f64> = (0..5 * SideParameters::N_DRAWS)
            .map(|_| clamp(normal(), -LARGEST_DRAW, LARGEST_DRAW))
            .collect();
        let phases = [normal(), normal(), normal()];

        let mut parameters = Self::drawn(
            &mut |row, level| {
                let index = table::TABLE.iter().position(|r| r == row).unwrap_or(0);
                let [common, shared, single] = SHARES;
                let rest = shared * shape[index] + single * own[5 * index + level];
                let z = if row.name.contains("angle") {
                    rest / (shared * shared + single * single).sqrt()
                } else {
                    common * size + rest
                };
                clamp(z, -LARGEST_DRAW, LARGEST_DRAW)
            },
            &mut |level, index| sides[level * SideParameters::N_DRAWS + index],
        );
        parameters.relief_phase_rad = phases.map(|z| z * std::f64::consts::PI);
        parameters
    }

    /// The dimensions of one level.
    #[must_use]
    pub fn level(&self, level: Level) -> &LevelParameters {
        &self.levels[level.index()]
    }

    /// Builds the parameters from one draw a row and level and some draws a level for the sides.
    fn drawn(
        draw: &mut dyn FnMut(&MorphometryRow, usize) -> f64,
        side_draw: &mut dyn FnMut(usize, usize) -> f64,
    ) -> Self {
        let levels = std::array::from_fn(|level| {
            let mut value =
                |row: &MorphometryRow| row.mean[level] + row.deviation[level] * draw(row, level);
            let pedicle_width_mm = value(&table::PEDICLE_WIDTH).max(SMALLEST_PEDICLE_WIDTH_MM);
            let middle = SideParameters {
                pedicle_width_mm,
                pedicle_height_mm: value(&table::PEDICLE_HEIGHT).max(pedicle_width_mm * 0.8),
                pedicle_transverse_rad: value(&table::PEDICLE_TRANSVERSE_ANGLE).to_radians(),
                pedicle_sagittal_rad: value(&table::PEDICLE_SAGITTAL_ANGLE).to_radians(),
                facet_offset_mm: 0.5 * value(&table::INTERFACET_WIDTH),
                facet_angle_rad: value(&table::FACET_ANGLE).to_radians(),
                transverse_reach_mm: 0.5 * value(&table::TRANSVERSE_WIDTH),
                transverse_elevation_rad: value(&table::TRANSVERSE_ELEVATION).to_radians(),
            };
            let mut side_value = |index| side_draw(level, index);
            let sides = middle.split(&mut side_value);
            LevelParameters {
                body_width_upper_mm: value(&table::BODY_WIDTH_UPPER),
                body_width_lower_mm: value(&table::BODY_WIDTH_LOWER),
                body_depth_upper_mm: value(&table::BODY_DEPTH_UPPER),
                body_depth_lower_mm: value(&table::BODY_DEPTH_LOWER),
                body_height_anterior_mm: value(&table::BODY_HEIGHT_ANTERIOR),
                body_height_posterior_mm: value(&table::BODY_HEIGHT_POSTERIOR),
                disc_height_mm: value(&table::DISC_HEIGHT),
                disc_angle_rad: value(&table::DISC_ANGLE).to_radians(),
                canal_width_mm: value(&table::CANAL_WIDTH),
                canal_depth_mm: value(&table::CANAL_DEPTH),
                lamina_thickness_mm: value(&table::LAMINA_THICKNESS),
                lamina_height_mm: value(&table::LAMINA_HEIGHT),
                facet_width_mm: value(&table::FACET_WIDTH),
                facet_height_mm: value(&table::FACET_HEIGHT),
                transverse_half_height_mm: value(&table::TRANSVERSE_HALF_HEIGHT),
                spinous_reach_mm: value(&table::SPINOUS_REACH),
                spinous_height_mm: value(&table::SPINOUS_HEIGHT),
                spinous_thickness_mm: value(&table::SPINOUS_THICKNESS),
                spinous_slope_rad: value(&table::SPINOUS_SLOPE).to_radians(),
                spinous_deviation_mm: SPINOUS_DEVIATION_MM
                    * side_draw(level, SideParameters::N_DRAWS - 1),
                sides,
            }
        });
        Self {
            levels,
            facet_gap_mm: 1.4,
            relief_mm: 0.25,
            relief_phase_rad: [0.4, 1.7, 2.9],
        }
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

/// A pedicle thinner than this is not meshed faithfully.
const SMALLEST_PEDICLE_WIDTH_MM: f64 = 5.0;

impl SideParameters {
    /// Draws a level takes for its sides: one a field and one for the spinous process.
    const N_DRAWS: usize = 9;

    /// Left and right around the mean of both; `draw` gives a standard normal number a field.
    fn split(&self, draw: &mut dyn FnMut(usize) -> f64) -> [Self; 2] {
        let shares: [f64; 8] = std::array::from_fn(&mut *draw);
        [-1.0, 1.0].map(|sign| {
            let length =
                |value: f64, index: usize| value * (1.0 + sign * SIDE_DEVIATION * shares[index]);
            let angle = |value: f64, index: usize| {
                value + sign * (SIDE_ANGLE_DEVIATION_DEG * shares[index]).to_radians()
            };
            Self {
                pedicle_width_mm: length(self.pedicle_width_mm, 0).max(SMALLEST_PEDICLE_WIDTH_MM),
                pedicle_height_mm: length(self.pedicle_height_mm, 1),
                pedicle_transverse_rad: angle(self.pedicle_transverse_rad, 2),
                // Half as much: the planned screws have to miss the endplates.
                pedicle_sagittal_rad: 0.5
                    * (self.pedicle_sagittal_rad + angle(self.pedicle_sagittal_rad, 3)),
                facet_offset_mm: length(self.facet_offset_mm, 4),
                facet_angle_rad: angle(self.facet_angle_rad, 5),
                transverse_reach_mm: length(self.transverse_reach_mm, 6),
                transverse_elevation_rad: angle(self.transverse_elevation_rad, 7),
            }
        })
    }
}
