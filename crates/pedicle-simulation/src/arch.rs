//! The vertebral arch: laminae, articular, transverse and spinous processes as struts.
//!
//! The two processes of a facet joint lie on either side of the joint's middle plane, which both
//! vertebrae share: the upper process of the lower vertebra outside, the lower process of the
//! upper one inside. They are thicker than their distance, so that the plane cuts both and the
//! two facets fit ([`crate::spine`]). Lengths in mm.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_trajectory::Side;

use crate::parameters::LevelParameters;
use crate::pedicle::Pedicle;
use crate::sdf::Strut;

/// Half thickness of the two processes of a facet joint, mm.
const FACET_HALF_THICKNESS_MM: f64 = 4.4;
/// Distance from the middle of a facet joint to the middle of either process, mm.
const FACET_TO_PROCESS_MM: f64 = 4.2;
/// The upper articular processes lie this far behind the back of the body, mm.
const FACET_BEHIND_BODY_MM: f64 = 12.5;

/// Half thickness of the transverse process at its tip, mm.
const TRANSVERSE_TIP_MM: f64 = 2.9;
/// How far the transverse process leans backwards over its length.
const TRANSVERSE_LEAN: f64 = 0.16;

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

/// 1 for the right and -1 for the left: the sign of x.
pub(crate) fn sign_of(side: Side) -> f64 {
    match side {
        Side::Left => -1.0,
        Side::Right => 1.0,
    }
}

/// The joint that the upper process of one side takes part in.
pub(crate) fn upper_joint(parameters: &LevelParameters, side: Side) -> FacetJoint {
    let sign = sign_of(side);
    let own = parameters.side(side);
    let (sin, cos) = own.facet_angle_rad.sin_cos();
    FacetJoint {
        center: Point3::new(
            sign * own.facet_offset_mm,
            parameters.back_of_body_mm() - FACET_BEHIND_BODY_MM - FACET_TO_PROCESS_MM * sin,
            0.5 * parameters.body_height_posterior_mm - 1.0,
        ),
        normal: Vector3::new(sign * cos, sin, 0.0),
    }
}

/// A strut and the fillet with which it joins the ones before it, mm.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joined {
    pub(crate) strut: Strut,
    pub(crate) fillet_mm: f64,
}

/// Where the two laminae meet: in front of the root of the spinous process.
fn lamina_root(p: &LevelParameters) -> Vector3<f64> {
    Vector3::new(
        0.0,
        p.back_of_body_mm() - p.canal_depth_mm - 0.5 * p.lamina_thickness_mm - 0.6,
        -0.5 * p.body_height_posterior_mm + 0.5 * p.lamina_height_mm - 6.5,
    )
}

/// The posterior parts of one side: upper and lower articular process, the pillar between them,
/// lamina and transverse process.
pub(crate) fn side_parts(
    p: &LevelParameters,
    side: Side,
    pedicle: &Pedicle,
    upper: &FacetJoint,
    lower: &FacetJoint,
) -> [Joined; 5] {
    let up = Vector3::z();
    let half_facet = 0.5 * p.facet_width_mm;
    let half_thick = 0.5 * p.lamina_thickness_mm;
    let half_process = 0.5 * p.facet_height_mm - FACET_HALF_THICKNESS_MM;
    let root = lamina_root(p);
    let sign = sign_of(side);
    let pedicle_z = pedicle.isthmus.z;

    // From behind the pedicle up along the outer side of the joint.
    let upper_middle = upper.center.coords + upper.normal * FACET_TO_PROCESS_MM;
    let upper_base = Vector3::new(upper_middle.x, upper_middle.y + 0.5, pedicle_z - 2.0);
    let upper_process = Strut::new(
        [upper_base, upper_middle + up * half_process],
        upper.normal,
        [
            [FACET_HALF_THICKNESS_MM + 0.9, half_facet],
            [FACET_HALF_THICKNESS_MM, half_facet * 0.92],
        ],
    );

    // Down along the inner side of the joint below.
    let lower_middle = lower.center.coords - lower.normal * FACET_TO_PROCESS_MM;
    let lower_base = Vector3::new(
        0.5 * (lower_middle.x + upper_base.x * 0.75),
        0.5 * (lower_middle.y + root.y) + 0.5,
        -0.5 * p.body_height_posterior_mm + 2.0,
    );
    let lower_process = Strut::new(
        [lower_base, lower_middle - up * half_process],
        lower.normal,
        [
            [half_thick + 0.6, half_facet * 0.9],
            [FACET_HALF_THICKNESS_MM, half_facet * 0.85],
        ],
    );

    let pillar = Strut::new(
        [upper_base, lower_base],
        Vector3::new(sign * 0.5, 0.6, 0.0),
        [
            [half_thick + 1.4, half_facet * 0.85],
            [half_thick + 0.4, half_facet * 0.85],
        ],
    );

    // The upper border of the lamina leans to the front.
    let lamina_start = Vector3::new(
        upper_base.x * 0.82,
        upper_base.y - 2.0,
        0.5 * (pedicle_z + root.z),
    );
    let half_height = 0.5 * p.lamina_height_mm;
    let lamina = Strut::new(
        [lamina_start, root],
        Vector3::new(0.0, 0.3, 1.0),
        [[half_height * 0.8, half_thick], [half_height, half_thick]],
    );

    let joined = |strut, fillet_mm| Joined { strut, fillet_mm };
    [
        joined(upper_process, 3.0),
        joined(lower_process, 4.0),
        joined(pillar, 4.0),
        joined(lamina, 4.0),
        joined(transverse_process(p, side, pedicle), 3.5),
    ]
}

/// A plate that rises to its tip and leans backwards.
fn transverse_process(p: &LevelParameters, side: Side, pedicle: &Pedicle) -> Strut {
    let sign = sign_of(side);
    let own = p.side(side);
    let (sin, cos) = own.transverse_elevation_rad.sin_cos();
    let start = pedicle.isthmus.coords + Vector3::new(sign * 1.5, -6.5, -1.5);
    let half_height = p.transverse_half_height_mm;
    let tip_height = half_height * 0.86;
    // The tip is tilted: one of its edges reaches farthest.
    let edge = TRANSVERSE_TIP_MM + (tip_height - TRANSVERSE_TIP_MM).max(0.0) * sin.abs();
    let run = own.transverse_reach_mm - edge - start.x.abs();
    let end = start + Vector3::new(sign * run, -TRANSVERSE_LEAN * run, run * sin / cos);
    Strut::new(
        [start, end],
        Vector3::z(),
        [
            [half_height, half_height * 0.8],
            [tip_height, TRANSVERSE_TIP_MM],
        ],
    )
}

/// The spinous process.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpinousProcess {
    /// The plate and its thick border at the end.
    pub(crate) parts: [Joined; 2],
    /// A point inside its end, from which `outward` leads to the top.
    pub(crate) inside: Point3<f64>,
    /// Unit vector to the back and a little upwards: from where it is touched.
    pub(crate) outward: Vector3<f64>,
}

impl SpinousProcess {
    pub(crate) fn new(p: &LevelParameters) -> Self {
        let root = lamina_root(p);
        let (sin, cos) = p.spinous_slope_rad.sin_cos();
        let half_thick = 0.5 * p.spinous_thickness_mm;
        let half_height = 0.5 * p.spinous_height_mm;
        let border = half_thick + 0.7;
        let run = p.spinous_reach_mm - (p.back_of_body_mm() - root.y) - border;
        let start = root + Vector3::new(0.0, 1.0, -0.5);
        let end = root + Vector3::new(p.spinous_deviation_mm, -run, -run * sin / cos);
        let down = Vector3::new(0.0, -sin, -cos);
        let plate = Strut::new(
            [start, end],
            down,
            [
                [half_height * 0.82, half_thick],
                [half_height, half_thick * 0.9],
            ],
        );
        let span = half_height - border;
        let rim = Strut::new(
            [end - down * (span * 0.75), end + down * span],
            Vector3::x(),
            [[border * 0.85, border * 0.85], [border * 1.1, border]],
        );
        Self {
            parts: [
                Joined {
                    strut: plate,
                    fillet_mm: 4.0,
                },
                Joined {
                    strut: rim,
                    fillet_mm: 3.0,
                },
            ],
            inside: Point3::from(end - down * (span * 0.6)),
            outward: Vector3::new(0.0, -1.0, 0.35).normalize(),
        }
    }
}
