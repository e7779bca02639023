//! One vertebra as an implicit solid in its own frame.
//!
//! Frame: origin at the centre of the vertebral body, x to the right, y to the front, z up, the
//! plane z = 0 half-way between the endplates. Lengths in mm.
//!
//! The solid is
//!
//!     f = (body ∪ pedicles ∪ arch) ∖ canal,   f ← f + w (f_pedicle - f)
//!
//! with smooth operations ([`crate::sdf`]). The last step is done around each isthmus: w is 1 at
//! the isthmus plane inside an ellipse somewhat larger than the pedicle and falls to 0 within a
//! few millimetres. There the bone is the pedicle's tube and nothing else, so its narrowest
//! section has exactly the width and the height of the table.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::parameters::{LevelParameters, SideParameters};
use crate::sdf::{
    Strut, ellipse, smooth_difference, smooth_intersection, smooth_step, smooth_union, superellipse,
};

/// The isthmus lies this far behind the back of the body, mm.
const ISTHMUS_BEHIND_BODY_MM: f64 = 4.2;
/// Height of the pedicle's centre above the middle of the body over the body's posterior height.
const PEDICLE_ELEVATION: f64 = 0.13;
/// The upper border of the pedicle stays this far below the back of the upper endplate, mm.
const PEDICLE_BELOW_ENDPLATE_MM: f64 = 1.0;
/// Bone between the canal and the pedicle's inner wall, mm.
const CANAL_TO_PEDICLE_MM: f64 = 0.3;
/// Half thickness of the two processes of a facet joint, mm.
const FACET_HALF_THICKNESS_MM: f64 = 4.4;
/// Distance from the middle of a facet joint to the middle of either process, mm.
const FACET_TO_PROCESS_MM: f64 = 4.2;
/// The upper articular processes lie this far behind the back of the body, mm.
const FACET_BEHIND_BODY_MM: f64 = 12.5;
/// The pedicle is its pure tube within this distance of the isthmus along the axis, mm.
const ISTHMUS_PURE_MM: f64 = 1.4;
/// Beyond that, the other parts come back over this distance, mm.
const ISTHMUS_BLEND_MM: f64 = 2.8;
/// Half of the pedicle's tube, from the isthmus to either end, mm.
const PEDICLE_REACH_MM: f64 = 13.0;
/// Relative growth of the tube's semi-axes from the isthmus to its ends.
const PEDICLE_FLARE: f64 = 0.42;

/// Farther behind the body than this, its exact distance no longer matters, mm.
const BODY_REACH_MM: f64 = 14.0;
/// Farther in front of the body's back than this, the arch no longer matters, mm.
const ARCH_REACH_MM: f64 = 8.0;

/// Middle of a facet joint in the frame of a vertebra.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FacetJoint {
    /// Middle of the joint space.
    pub(crate) center: Point3<f64>,
    /// Unit normal of the joint, from the lower process of the upper vertebra to the upper
    /// process of the lower one.
    pub(crate) normal: Vector3<f64>,
}

impl FacetJoint {
    /// The joint in another frame.
    pub(crate) fn transformed(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            center: motion * self.center,
            normal: motion * self.normal,
        }
    }
}

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
    fn new(parameters: &LevelParameters, side: &SideParameters, sign: f64) -> Self {
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
            back_of_body(parameters) - ISTHMUS_BEHIND_BODY_MM,
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

    fn distance(&self, p: &Point3<f64>) -> f64 {
        let [u, v, t] = self.local(p);
        let s = (t / PEDICLE_REACH_MM).clamp(-1.0, 1.0);
        let flare = 1.0 + PEDICLE_FLARE * s * s;
        let [a, b] = self.radii;
        let tube = ellipse(u, v, [a * flare, b * flare]);
        smooth_intersection(tube, t.abs() - PEDICLE_REACH_MM, 4.0)
    }

    /// How much the bone is the pure tube here: 1 around the isthmus, 0 away from it.
    fn purity(&self, p: &Point3<f64>) -> f64 {
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

/// Where the back of the body lies in its own frame, mm.
pub(crate) fn back_of_body(parameters: &LevelParameters) -> f64 {
    -0.5 * parameters.body_depth_mm()
}

/// The joint that the upper process of one side takes part in.
pub(crate) fn upper_joint(
    parameters: &LevelParameters,
    side: &SideParameters,
    sign: f64,
) -> FacetJoint {
    let (sin, cos) = side.facet_angle_rad.sin_cos();
    FacetJoint {
        center: Point3::new(
            sign * side.facet_offset_mm,
            back_of_body(parameters) - FACET_BEHIND_BODY_MM - FACET_TO_PROCESS_MM * sin,
            0.5 * parameters.body_height_posterior_mm - 1.0,
        ),
        normal: Vector3::new(sign * cos, sin, 0.0),
    }
}

/// One vertebra, ready to be evaluated.
#[derive(Debug, Clone)]
pub(crate) struct VertebraShape {
    parameters: LevelParameters,
    pub(crate) pedicles: [Pedicle; 2],
    /// Laminae, pillars and articular and transverse processes of either side.
    struts: Vec<(Strut, f64)>,
    /// The plate of the spinous process and its thick border.
    spinous: Vec<(Strut, f64)>,
    /// A point deep in the end of the spinous process and the direction to its top.
    pub(crate) spinous_end: (Point3<f64>, Vector3<f64>),
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
        let mut struts = Vec::new();
        let mut pedicles = Vec::new();
        for (index, sign) in [-1.0, 1.0].into_iter().enumerate() {
            let side = &parameters.sides[index];
            let pedicle = Pedicle::new(parameters, side, sign);
            let upper = upper_joint(parameters, side, sign);
            push_side(
                &mut struts,
                (parameters, side, sign),
                &pedicle,
                [&upper, &lower_joints[index]],
            );
            pedicles.push(pedicle);
        }
        let (spinous, spinous_end) = spinous_process(parameters);
        let drop = level_index as f64 / 4.0;
        Self {
            parameters: *parameters,
            pedicles: [pedicles[0], pedicles[1]],
            struts,
            spinous,
            spinous_end,
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
        if x.y < back_of_body(&self.parameters) + ARCH_REACH_MM {
            let mut arch = ARCH_REACH_MM;
            for (strut, blend) in self.struts.iter().chain(&self.spinous) {
                arch = smooth_union(arch, strut.distance(&x), *blend);
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
        let behind = back_of_body(p) - x.y;
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
        let back = back_of_body(p);
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
        let center = back_of_body(p) - half_depth - 0.3;
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
        let spinous_low = self.spinous_end.0.z - 0.6 * p.spinous_height_mm;
        let tall = p.body_height_anterior_mm.max(p.body_height_posterior_mm);
        let front = 0.5 * p.body_depth_upper_mm.max(p.body_depth_lower_mm);
        let half_width = reach.max(0.5 * p.body_width_lower_mm);
        (
            Point3::new(
                -half_width - 5.0,
                back_of_body(p) - p.spinous_reach_mm - 5.0,
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

/// Where the two laminae meet: in front of the root of the spinous process.
fn lamina_root(p: &LevelParameters) -> Vector3<f64> {
    Vector3::new(
        0.0,
        back_of_body(p) - p.canal_depth_mm - 0.5 * p.lamina_thickness_mm - 0.6,
        -0.5 * p.body_height_posterior_mm + 0.5 * p.lamina_height_mm - 6.5,
    )
}

/// The posterior parts of one side.
fn push_side(
    struts: &mut Vec<(Strut, f64)>,
    (p, side, sign): (&LevelParameters, &SideParameters, f64),
    pedicle: &Pedicle,
    [upper, lower]: [&FacetJoint; 2],
) {
    let up = Vector3::z();
    let half_facet = 0.5 * p.facet_width_mm;
    let half_thick = 0.5 * p.lamina_thickness_mm;
    let root = lamina_root(p);

    // Upper articular process: from behind the pedicle up along the outer side of the joint.
    let process = upper.center.coords + upper.normal * FACET_TO_PROCESS_MM;
    let pedicle_z = pedicle.isthmus.z;
    let upper_base = Vector3::new(process.x, process.y + 0.5, pedicle_z - 2.0);
    let upper_tip = process + up * (0.5 * p.facet_height_mm - FACET_HALF_THICKNESS_MM);
    let upper_radii = [FACET_HALF_THICKNESS_MM, half_facet * 0.92];
    struts.push((
        Strut::new(
            [upper_base, upper_tip],
            upper.normal,
            [[FACET_HALF_THICKNESS_MM + 0.9, half_facet], upper_radii],
        ),
        3.0,
    ));

    // Lower articular process: down along the inner side of the joint below.
    let process = lower.center.coords - lower.normal * FACET_TO_PROCESS_MM;
    let lower_tip = process - up * (0.5 * p.facet_height_mm - FACET_HALF_THICKNESS_MM);
    let lower_base = Vector3::new(
        0.5 * (process.x + upper_base.x * 0.75),
        0.5 * (process.y + root.y) + 0.5,
        -0.5 * p.body_height_posterior_mm + 2.0,
    );
    struts.push((
        Strut::new(
            [lower_base, lower_tip],
            lower.normal,
            [
                [half_thick + 0.6, half_facet * 0.9],
                [FACET_HALF_THICKNESS_MM, half_facet * 0.85],
            ],
        ),
        4.0,
    ));

    // Pillar between the two (the isthmus of the arch).
    struts.push((
        Strut::new(
            [upper_base, lower_base],
            Vector3::new(sign * 0.5, 0.6, 0.0),
            [
                [half_thick + 1.4, half_facet * 0.85],
                [half_thick + 0.4, half_facet * 0.85],
            ],
        ),
        4.0,
    ));

    // Lamina, its upper border leaning to the front.
    let lamina_start = Vector3::new(
        upper_base.x * 0.82,
        upper_base.y - 2.0,
        0.5 * (pedicle_z + root.z),
    );
    let half_height = 0.5 * p.lamina_height_mm;
    struts.push((
        Strut::new(
            [lamina_start, root],
            Vector3::new(0.0, 0.3, 1.0),
            [[half_height * 0.8, half_thick], [half_height, half_thick]],
        ),
        4.0,
    ));

    // Transverse process.
    let (sin, cos) = side.transverse_elevation_rad.sin_cos();
    let start = Vector3::new(
        pedicle.isthmus.x + sign * 1.5,
        pedicle.isthmus.y - 6.5,
        pedicle_z - 1.5,
    );
    let tip_radius = 2.9;
    let half = p.transverse_half_height_mm;
    let tip_height = half * 0.86;
    // The tip is a tilted plate: its upper edge reaches farthest.
    let edge = tip_radius + (tip_height - tip_radius).max(0.0) * sin.abs();
    let run = side.transverse_reach_mm - edge - start.x.abs();
    let end = start + Vector3::new(sign * run, -0.16 * run, run * sin / cos);
    struts.push((
        Strut::new(
            [start, end],
            up,
            [[half, half * 0.8], [tip_height, tip_radius]],
        ),
        3.5,
    ));
}

/// The plate of the spinous process with its thick border, and the landmark's ray.
fn spinous_process(p: &LevelParameters) -> (Vec<(Strut, f64)>, (Point3<f64>, Vector3<f64>)) {
    let root = lamina_root(p);
    let (sin, cos) = p.spinous_slope_rad.sin_cos();
    let half_thick = 0.5 * p.spinous_thickness_mm;
    let half_height = 0.5 * p.spinous_height_mm;
    let border = half_thick + 0.7;
    let run = (p.spinous_reach_mm - (back_of_body(p) - root.y)) - border;
    let start = root + Vector3::new(0.0, 1.0, -0.5);
    let fall = run * sin / cos;
    let end = root + Vector3::new(p.spinous_deviation_mm, -run, -fall);
    let down = Vector3::new(0.0, -sin, -cos);
    let plate = Strut::new(
        [start, end],
        down,
        [
            [half_height * 0.82, half_thick],
            [half_height, half_thick * 0.9],
        ],
    );
    // The border runs along the end of the plate and is thickest below.
    let span = half_height - border;
    let rim = Strut::new(
        [end - down * (span * 0.75), end + down * span],
        Vector3::x(),
        [[border * 0.85, border * 0.85], [border * 1.1, border]],
    );
    let outward = Vector3::new(0.0, -cos, 0.35 * cos).normalize();
    (
        vec![(plate, 4.0), (rim, 3.0)],
        (Point3::from(end - down * (span * 0.6)), outward),
    )
}
