//! The chain of five vertebrae: poses, facet joints and the gaps between neighbours.
//!
//! Going down, each vertebra follows from the one above by the lower endplate, half of the disc's
//! angle, the disc's height, the other half and the upper endplate. L3 has the identity pose.
//!
//! Neighbours share facet joints, where their raw solids overlap. With f the vertebra's own field
//! and f' a neighbour's, the bone is
//!
//! ```text
//! g = max(f, (f - f' + gap) / 2)
//! ```
//!
//! so a point belongs to the vertebra only if it is deeper in it than in the neighbour by the gap:
//! two neighbours can never share a point, and the facets of a joint fit each other.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use pedicle_trajectory::{Level, Side};

use crate::PhantomParameters;
use crate::arch::{FacetJoint, upper_joint};
use crate::parameters::LevelParameters;
use crate::sdf::smooth_intersection;
use crate::vertebra::VertebraShape;

/// Beyond this distance from the bone its neighbours need not be asked, mm.
const NEIGHBOUR_REACH_MM: f64 = 6.0;

/// The five solids and where they stand.
#[derive(Debug, Clone)]
pub(crate) struct SpineShape {
    pub(crate) vertebrae: Vec<VertebraShape>,
    /// `spine_from_vertebra`, one a level.
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// Boxes that hold the bones with a margin, each in its own frame.
    boxes: Vec<(Point3<f64>, Point3<f64>)>,
    gap_mm: f64,
}

impl SpineShape {
    pub(crate) fn new(parameters: &PhantomParameters) -> Self {
        let poses = poses(parameters);
        let mut vertebrae = Vec::with_capacity(5);
        let mut boxes = Vec::with_capacity(5);
        for level in Level::ALL {
            let index = level.index();
            let own = parameters.level(level);
            let joints: [FacetJoint; 2] = if index < 4 {
                let below = &parameters.levels[index + 1];
                let this_from_below = poses[index].inverse() * poses[index + 1];
                joints_of(below).map(|joint| joint.transformed(&this_from_below))
            } else {
                // No sacrum is modelled: the joints with it stand where those of another L5
                // below the disc would.
                let below = step_down(own, own);
                joints_of(own).map(|joint| joint.transformed(&below))
            };
            let phase = parameters.relief_phase_rad.map(|x| x + index as f64);
            let shape = VertebraShape::new(own, &joints, index, (parameters.relief_mm, phase));
            boxes.push(shape.bounds(&joints));
            vertebrae.push(shape);
        }
        Self {
            vertebrae,
            poses,
            boxes,
            gap_mm: parameters.facet_gap_mm,
        }
    }

    /// First-order distance to the bone of `level` from a point of its own frame.
    pub(crate) fn distance(&self, level: Level, p: &Point3<f64>) -> f64 {
        let index = level.index();
        let own = self.vertebrae[index].distance(p);
        if own > NEIGHBOUR_REACH_MM {
            return own;
        }
        let mut g = own;
        for other in [index.wrapping_sub(1), index + 1] {
            let Some(neighbour) = self.vertebrae.get(other) else {
                continue;
            };
            let q = self.poses[other].inverse_transform_point(&(self.poses[index] * p));
            let (low, high) = &self.boxes[other];
            if (0..3).any(|axis| q[axis] < low[axis] || q[axis] > high[axis]) {
                continue;
            }
            let clearance = 0.5 * (own - neighbour.distance(&q) + self.gap_mm);
            g = smooth_intersection(g, clearance, 1.2);
        }
        g
    }

    /// Gradient of [`Self::distance`], whose value at `p` is `f`, by one-sided differences.
    pub(crate) fn gradient(&self, level: Level, p: &Point3<f64>, f: f64) -> Vector3<f64> {
        const STEP_MM: f64 = 1e-6;
        Vector3::from_fn(|axis, _| {
            let mut moved = *p;
            moved[axis] += STEP_MM;
            (self.distance(level, &moved) - f) / STEP_MM
        })
    }

    /// A box that holds the bone of `level`, in its own frame.
    pub(crate) fn bounds(&self, level: Level) -> (Point3<f64>, Point3<f64>) {
        self.boxes[level.index()]
    }

    /// First sign change of the field along a ray, refined by bisection; `None` within `reach`.
    pub(crate) fn crossing(
        &self,
        level: Level,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        reach_mm: f64,
    ) -> Option<f64> {
        const STEP_MM: f64 = 0.25;
        let at = |t: f64| self.distance(level, &(origin + direction * t));
        let start_inside = at(0.0) < 0.0;
        let n_steps = (reach_mm / STEP_MM).ceil() as usize;
        let first = (1..=n_steps).find(|&i| (at(i as f64 * STEP_MM) < 0.0) != start_inside)?;
        let (mut low, mut high) = ((first - 1) as f64 * STEP_MM, first as f64 * STEP_MM);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if (at(middle) < 0.0) == start_inside {
                low = middle;
            } else {
                high = middle;
            }
        }
        Some(0.5 * (low + high))
    }
}

fn joints_of(parameters: &LevelParameters) -> [FacetJoint; 2] {
    [Side::Left, Side::Right].map(|side| upper_joint(parameters, side))
}

/// `upper_from_lower`: the frame of the vertebra below in that of the one above.
fn step_down(upper: &LevelParameters, lower: &LevelParameters) -> Isometry3<f64> {
    let turn = |angle: f64| {
        Isometry3::from_parts(
            Translation3::identity(),
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle),
        )
    };
    let drop = |distance: f64| Isometry3::translation(0.0, 0.0, -distance);
    drop(0.5 * upper.body_height_mm())
        * turn(-upper.half_wedge_rad())
        * turn(-0.5 * upper.disc_angle_rad)
        * drop(upper.disc_height_mm)
        * turn(-0.5 * upper.disc_angle_rad)
        * turn(-lower.half_wedge_rad())
        * drop(0.5 * lower.body_height_mm())
}

fn poses(parameters: &PhantomParameters) -> Vec<Isometry3<f64>> {
    let mut poses = vec![Isometry3::identity()];
    for pair in parameters.levels.windows(2) {
        let next = poses[poses.len() - 1] * step_down(&pair[0], &pair[1]);
        poses.push(next);
    }
    let middle = poses[Level::L3.index()].inverse();
    poses.into_iter().map(|pose| middle * pose).collect()
}
