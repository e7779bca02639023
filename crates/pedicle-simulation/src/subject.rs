//! The mean spine and the subjects drawn around it.
//!
//! A drawn dimension is
//!
//! ```text
//! mean + deviation · z,   z = 0.6 g + 0.7 r + 0.39 e   (cut off at ±1.7)
//! ```
//!
//! with standard normal g shared by the whole subject (size; left out for angles), r shared by the
//! dimension over the levels (shape) and e of its own. The squares add up to 1. Left and right
//! differ by about 2 % and 1.5°.

use nalgebra::clamp;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::morphometry::{self as table, MorphometryRow, Unit};
use crate::parameters::SMALLEST_PEDICLE_WIDTH_MM;
use crate::phantom::has_all_tips;
use crate::{LevelParameters, PhantomParameters, SideParameters};

/// Shares of the common size, the dimension and the single value in a drawn dimension.
const SHARES: [f64; 3] = [0.6, 0.7, 0.39];
/// Times that a subject is drawn again at most.
const MAX_REDRAWS: usize = 50;
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

/// Where the axes come nearest to the side of the body, mm in front of the isthmus.
const WAIST_AHEAD_OF_ISTHMUS_MM: f64 = 15.0;
/// Bone to keep there beside the axis, mm.
const WAIST_ROOM_MM: f64 = 4.4;
/// Width of the waist over that of the endplates.
const WAIST_RATIO: f64 = 0.87;

impl Default for PhantomParameters {
    /// The means of the table, with a slight fixed asymmetry.
    fn default() -> Self {
        Self::drawn(&mut |_, _| 0.0, &mut |level, index| {
            let flip = if index % 2 == 0 { 1.0 } else { -1.0 };
            flip * MEAN_SPINE_ASYMMETRY[(level + index) % 5]
        })
    }
}

impl PhantomParameters {
    /// A subject: the same seed gives the same spine, another seed another one. Dimensions that do not fit together
    /// (one in some hundreds: a neighbour takes the place of a spinous process) are drawn again, up to fifty times.
    #[must_use]
    pub fn subject(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut parameters = Self::person(&mut rng);
        for _ in 0..MAX_REDRAWS {
            if has_all_tips(&parameters) {
                break;
            }
            parameters = Self::person(&mut rng);
        }
        parameters
    }

    fn person(rng: &mut ChaCha8Rng) -> Self {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
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
                let z = match row.unit {
                    Unit::Degree => rest / f64::hypot(shared, single),
                    Unit::Millimetre => common * size + rest,
                };
                clamp(z, -LARGEST_DRAW, LARGEST_DRAW)
            },
            &mut |level, index| sides[level * SideParameters::N_DRAWS + index],
        );
        parameters.relief_phase_rad = phases.map(|z| z * std::f64::consts::PI);
        parameters
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
            let canal_width_mm = value(&table::CANAL_WIDTH);
            let least_width_mm = sides
                .iter()
                .map(|side| side.least_body_width_mm(canal_width_mm))
                .fold(0.0, f64::max);
            LevelParameters {
                body_width_upper_mm: value(&table::BODY_WIDTH_UPPER).max(least_width_mm),
                body_width_lower_mm: value(&table::BODY_WIDTH_LOWER).max(least_width_mm),
                body_depth_upper_mm: value(&table::BODY_DEPTH_UPPER),
                body_depth_lower_mm: value(&table::BODY_DEPTH_LOWER),
                body_height_anterior_mm: value(&table::BODY_HEIGHT_ANTERIOR),
                body_height_posterior_mm: value(&table::BODY_HEIGHT_POSTERIOR),
                disc_height_mm: value(&table::DISC_HEIGHT),
                disc_angle_rad: value(&table::DISC_ANGLE).to_radians(),
                canal_width_mm,
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
}

impl SideParameters {
    /// Draws a level takes for its sides: one a field and one for the spinous process.
    const N_DRAWS: usize = 9;

    /// Width of a body whose waist the pedicle's axis does not leave: a wide canal and a narrow
    /// body are drawn one without the other, but do not come together.
    fn least_body_width_mm(&self, canal_width_mm: f64) -> f64 {
        let (sin, cos) = self.pedicle_transverse_rad.sin_cos();
        let at_isthmus = 0.5 * (canal_width_mm + self.pedicle_width_mm / cos);
        let at_waist = at_isthmus - WAIST_AHEAD_OF_ISTHMUS_MM * sin;
        2.0 * (at_waist + WAIST_ROOM_MM) / WAIST_RATIO
    }

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
