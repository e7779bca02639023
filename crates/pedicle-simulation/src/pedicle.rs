//! The pedicle as a tube around its axis.
//!
//! ```text
//! a(t) = a₀ (1 + 0.42 (t / 13 mm)²),   b(t) = b₀ (1 + 0.42 (t / 13 mm)²)
//! ```
//!
//! with t along the axis from the isthmus, a and b half the width and half the height: the
//! narrowest section is at t = 0. Lengths in mm.

use nalgebra::{Point3, Unit, Vector3};
use pedicle_trajectory::Side;

use crate::arch::sign_of;
use crate::parameters::LevelParameters;
use crate::sdf::{ellipse, smooth_intersection, smooth_step};

/// The isthmus lies this far behind the back of the body, mm.
const ISTHMUS_BEHIND_BODY_MM: f64 = 4.2;
/// Height of the pedicle's centre above the middle of the body over the body's posterior height.
const PEDICLE_ELEVATION: f64 = 0.13;
/// The upper border of the pedicle stays this far below the back of the upper endplate, mm.
const PEDICLE_BELOW_ENDPLATE_MM: f64 = 1.0;
/// Bone between the canal and the pedicle's inner wall, mm.
const CANAL_TO_PEDICLE_MM: f64 = 0.3;
/// The pedicle is its pure tube within this distance of the isthmus along the axis, mm.
const ISTHMUS_PURE_MM: f64 = 1.4;
/// Beyond that, the other parts come back over this distance, mm.
const ISTHMUS_BLEND_MM: f64 = 2.8;
/// Half of the pedicle's tube, from the isthmus to either end, mm.
const PEDICLE_REACH_MM: f64 = 13.0;
/// Relative growth of the tube's semi-axes from the isthmus to its ends.
const PEDICLE_FLARE: f64 = 0.42;

/// The pedicle's tube around its isthmus.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pedicle {
    /// Centre of the narrowest section.
    pub(crate) isthmus: Point3<f64>,
    /// Unit axis, from the back to the front.
    pub(crate) axis: Unit<Vector3<f64>>,
    /// Unit direction of the width, to the right.
    pub(crate) across: Vector3<f64>,
    /// Unit direction of the height, upwards.
    pub(crate) up: Vector3<f64>,
    /// Half width and half height at the isthmus.
    pub(crate) radii: [f64; 2],
}

impl Pedicle {
    pub(crate) fn new(parameters: &LevelParameters, side: Side) -> Self {
        let sign = sign_of(side);
        let side = parameters.side(side);
        let (sin_t, cos_t) = side.pedicle_transverse_rad.sin_cos();
        let (sin_s, cos_s) = side.pedicle_sagittal_rad.sin_cos();
        let axis = Vector3::new(-sign * sin_t * cos_s, cos_t * cos_s, sin_s);
        let across = axis.cross(&Vector3::z()).normalize();
        let half_width = 0.5 * side.pedicle_width_mm;
        let half_height = 0.5 * side.pedicle_height_mm;
        let height = parameters.body_height_posterior_mm;
        let highest = 0.5 * height - PEDICLE_BELOW_ENDPLATE_MM - half_height;
        let isthmus = Point3::new(
            sign * (0.5 * parameters.canal_width_mm + CANAL_TO_PEDICLE_MM + half_width / cos_t),
            parameters.back_of_body_mm() - ISTHMUS_BEHIND_BODY_MM,
            highest.min(PEDICLE_ELEVATION * height),
        );
        Self {
            isthmus,
            axis: Unit::new_normalize(axis),
            across,
            up: across.cross(&axis),
            radii: [half_width, half_height],
        }
    }

    /// Coordinates across, up and along.
    fn local(&self, p: &Point3<f64>) -> [f64; 3] {
        let offset = p - self.isthmus;
        [
            offset.dot(&self.across),
            offset.dot(&self.up),
            offset.dot(&self.axis),
        ]
    }

    /// First-order distance to the tube.
    pub(crate) fn distance(&self, p: &Point3<f64>) -> f64 {
        let [u, v, t] = self.local(p);
        let s = (t / PEDICLE_REACH_MM).clamp(-1.0, 1.0);
        let flare = 1.0 + PEDICLE_FLARE * s * s;
        let [a, b] = self.radii;
        let tube = ellipse(u, v, [a * flare, b * flare]);
        smooth_intersection(tube, t.abs() - PEDICLE_REACH_MM, 4.0)
    }

    /// How much the bone is the pure tube here: 1 around the isthmus, 0 away from it.
    pub(crate) fn purity(&self, p: &Point3<f64>) -> f64 {
        let [u, v, t] = self.local(p);
        let along = 1.0 - smooth_step((t.abs() - ISTHMUS_PURE_MM) / ISTHMUS_BLEND_MM);
        if along <= 0.0 {
            return 0.0;
        }
        let [a, b] = self.radii;
        let r = f64::hypot(u / (a + 1.5), v / (b + 1.5));
        along * (1.0 - smooth_step((r - 1.0) / 0.35))
    }
}
