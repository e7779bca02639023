//! One vertebra as an implicit solid in its own frame.
//!
//! Frame: origin at the centre of the vertebral body, x to the right, y to the front, z up, the
//! plane z = 0 half-way between the endplates. Lengths in mm.
//!
//! The solid is
//!
//! ```text
//! f = (body ∪ pedicles ∪ arch) ∖ canal,   f ← f + w (f_pedicle - f)
//! ```
//!
//! with smooth operations ([`crate::sdf`]). The last step is done around each isthmus: w is 1 at
//! the isthmus plane inside an ellipse somewhat larger than the pedicle and falls to 0 within a
//! few millimetres. There the bone is the pedicle's tube and nothing else, so its narrowest
//! section has exactly the width and the height of the table.

use nalgebra::{Point3, Vector3};
use pedicle_trajectory::Side;

use crate::arch::{FacetJoint, Joined, SpinousProcess, side_parts, upper_joint};
use crate::parameters::LevelParameters;
use crate::pedicle::Pedicle;
use crate::sdf::{smooth_difference, smooth_intersection, smooth_step, smooth_union, superellipse};

/// Farther behind the body than this, its exact distance no longer matters, mm.
const BODY_REACH_MM: f64 = 14.0;
/// Farther in front of the body's back than this, the arch no longer matters, mm.
const ARCH_REACH_MM: f64 = 8.0;

/// One vertebra, ready to be evaluated.
#[derive(Debug, Clone)]
pub(crate) struct VertebraShape {
    parameters: LevelParameters,
    pub(crate) pedicles: [Pedicle; 2],
    arch: Vec<Joined>,
    pub(crate) spinous: SpinousProcess,
    canal_taper: f64,
    body_dent_mm: f64,
    relief_mm: f64,
    relief_phase_rad: [f64; 3],
}

impl VertebraShape {
    /// Builds the parts. `lower_joints` are the joints with the vertebra below in this frame.
    pub(crate) fn new(
        parameters: &LevelParameters,
        lower_joints: &[FacetJoint; 2],
        level_index: usize,
        relief: (f64, [f64; 3]),
    ) -> Self {
        let sides = [Side::Left, Side::Right];
        let pedicles = sides.map(|side| Pedicle::new(parameters, side));
        let spinous = SpinousProcess::new(parameters);
        let mut arch = Vec::new();
        for (side, (pedicle, lower)) in sides.into_iter().zip(pedicles.iter().zip(lower_joints)) {
            let upper = upper_joint(parameters, side);
            arch.extend(side_parts(parameters, side, pedicle, &upper, lower));
        }
        arch.extend(spinous.parts);
        let drop = level_index as f64 / 4.0;
        Self {
            parameters: *parameters,
            pedicles,
            arch,
            spinous,
            canal_taper: 0.38 + 0.22 * drop,
            body_dent_mm: 1.6 * (1.0 - drop),
            relief_mm: relief.0,
            relief_phase_rad: relief.1,
        }
    }

    /// First-order distance from a point of the vertebra's frame.
    pub(crate) fn distance(&self, p: &Point3<f64>) -> f64 {
        let x = p.coords;
        let mut f = self.body(&x);
        let tubes = self.pedicles.map(|pedicle| pedicle.distance(p));
        for tube in tubes {
            f = smooth_union(f, tube, 4.0);
        }
        // Far in front of the arch none of it matters.
        if x.y < self.parameters.back_of_body_mm() + ARCH_REACH_MM {
            let mut arch = ARCH_REACH_MM;
            for part in &self.arch {
                arch = smooth_union(arch, part.strut.distance(&x), part.fillet_mm);
            }
            f = smooth_union(f, arch, 3.5);
            f = smooth_difference(f, self.canal(&x), 3.0);
        }
        f += self.relief(&x);
        for (pedicle, tube) in self.pedicles.iter().zip(tubes) {
            let w = pedicle.purity(p);
            if w > 0.0 {
                f += w * (tube - f);
            }
        }
        f
    }

    fn body(&self, x: &Vector3<f64>) -> f64 {
        let p = &self.parameters;
        let behind = p.back_of_body_mm() - x.y;
        if behind > BODY_REACH_MM {
            return behind;
        }
        let height = p.body_height_mm();
        let u = (2.0 * x.z / height).clamp(-1.0, 1.0);
        let share = 0.5 * (1.0 + u);
        let hollow = 1.0 - u * u;
        let width = p.body_width_lower_mm + (p.body_width_upper_mm - p.body_width_lower_mm) * share;
        let depth = p.body_depth_lower_mm + (p.body_depth_upper_mm - p.body_depth_lower_mm) * share;
        // The widest place lies a little behind the middle; the back is flatter than the front.
        let middle = -0.06 * depth;
        let back = p.back_of_body_mm();
        let a = 0.5 * width * (1.0 - 0.13 * hollow);
        let y = x.y - middle;
        let (b, n) = if y > 0.0 {
            ((0.5 * depth - middle) * (1.0 - 0.11 * hollow), 2.3)
        } else {
            (middle - back, 3.2)
        };
        let dent = self.body_dent_mm * (-(x.x / 9.0).powi(2)).exp() * smooth_step(-y / b);
        let side = superellipse(x.x, y - dent, [a, b], n);

        let slope = p.half_wedge_rad().tan();
        let rho2 = ((x.x / (0.5 * width)).powi(2) + (y / (0.5 * depth)).powi(2)).min(1.0);
        let dish = (1.0 - rho2).powi(2);
        let cos = 1.0 / (1.0 + slope * slope).sqrt();
        let half = 0.5 * height;
        let top = (x.z - half - slope * x.y + 2.2 * dish) * cos;
        let bottom = (-x.z - half - slope * x.y + 2.8 * dish) * cos;
        smooth_intersection(smooth_intersection(side, top, 4.0), bottom, 4.0)
    }

    fn canal(&self, x: &Vector3<f64>) -> f64 {
        let p = &self.parameters;
        let half_depth = 0.5 * p.canal_depth_mm;
        let center = p.back_of_body_mm() - half_depth - 0.3;
        let v = (x.y - center) / half_depth;
        // Oval above, triangular below: narrower towards the back.
        let narrowing = 1.0 - self.canal_taper * smooth_step((0.45 - v) / 1.45);
        superellipse(
            x.x / narrowing,
            x.y - center,
            [0.5 * p.canal_width_mm, half_depth],
            2.6,
        )
    }

    /// A low relief with wavelengths of one to two centimetres.
    fn relief(&self, x: &Vector3<f64>) -> f64 {
        let [px, py, pz] = self.relief_phase_rad;
        let wave = (0.41 * x.x + 0.17 * x.z + px).sin()
            + (0.37 * x.y - 0.21 * x.x + py).sin()
            + (0.45 * x.z + 0.19 * x.y + pz).sin();
        self.relief_mm * wave / 3.0
    }

    /// A box that holds the vertebra, in its frame.
    pub(crate) fn bounds(&self, lower_joints: &[FacetJoint; 2]) -> (Point3<f64>, Point3<f64>) {
        let p = &self.parameters;
        let reach = p.sides[0]
            .transverse_reach_mm
            .max(p.sides[1].transverse_reach_mm);
        let lowest =
            lower_joints[0].center.z.min(lower_joints[1].center.z) - 0.5 * p.facet_height_mm;
        let spinous_low = self.spinous.inside.z - 0.6 * p.spinous_height_mm;
        let tall = p.body_height_anterior_mm.max(p.body_height_posterior_mm);
        let front = 0.5 * p.body_depth_upper_mm.max(p.body_depth_lower_mm);
        let half_width = reach.max(0.5 * p.body_width_lower_mm);
        (
            Point3::new(
                -half_width - 5.0,
                p.back_of_body_mm() - p.spinous_reach_mm - 5.0,
                lowest.min(spinous_low).min(-0.5 * tall) - 5.0,
            ),
            Point3::new(
                half_width + 5.0,
                front + 5.0,
                0.5 * tall.max(p.body_height_posterior_mm) + 0.5 * p.facet_height_mm + 8.0,
            ),
        )
    }
}
