//! Motion in the discs: every vertebra against the one below.
//!
//! ```text
//! B_n = 1,   B_i = B_{i+1} M_i,   M_i = T(t_i) · turn by R_i about the disc centre d_i
//! ```
//!
//! i counts from the top, n is the lowest vertebra and stands still. d_i lies midway between the
//! bodies of i and i + 1. Within physiological limits, R_i is a flexion or extension, then a
//! lateral bending, then an axial rotation, each uniform in its range (White & Panjabi 1990,
//! *Clinical Biomechanics of the Spine*, representative lumbar values), and t_i is uniform in a ball of
//! 2 mm. Beyond them R_i turns about a direction uniform on the sphere by an angle uniform from 0
//! to 15° or 25°, and t_i is uniform in a ball of 5 mm.
//!
//! A motion in which two neighbours enter each other by more than 3 mm is drawn again; of 30 that
//! all do, the one with the least overlap is taken. Lengths in mm, angles in rad.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, UnitBall, UnitSphere};

use crate::case::VertebraAxes;
use crate::simulate::turn_about;
use crate::{MotionRange, SimulationError, SpineCase};

/// Half of the range of flexion and extension together of the discs below L1 to L4, degrees.
const FLEXION_DEG: [f64; 4] = [6.0, 7.0, 7.5, 8.0];
/// Lateral bending to one side, degrees.
const LATERAL_DEG: [f64; 4] = [6.0, 6.0, 8.0, 6.0];
/// Axial rotation to one side, degrees.
const AXIAL_DEG: [f64; 4] = [2.0, 2.0, 2.0, 2.0];
/// Translation of a healthy disc, mm.
const HEALTHY_SHIFT_MM: f64 = 2.0;
/// Translation beyond physiological limits, mm.
const LARGEST_SHIFT_MM: f64 = 5.0;
/// Deepest that neighbours may enter each other, mm.
const LARGEST_OVERLAP_MM: f64 = 3.0;
/// How often a motion is drawn.
const MAX_DRAWS: usize = 30;

/// The motions B_i of all vertebrae, from the top down, in the source frame.
pub(crate) fn bends(
    case: &SpineCase,
    range: MotionRange,
    rng: &mut impl Rng,
) -> Result<Vec<Isometry3<f64>>, SimulationError> {
    let indices = case
        .vertebrae()
        .iter()
        .map(|v| SurfaceIndex::new(&v.mesh))
        .collect::<Result<Vec<_>, _>>()?;
    let centers = case.disc_centers();
    let mut bends = vec![Isometry3::identity()];
    for i in (0..centers.len()).rev() {
        let axes = &case.axes()[i];
        let level = case.vertebrae()[i].level.index();
        let [upper, lower] = [i, i + 1].map(|v| (&case.vertebrae()[v].mesh, &indices[v]));
        let mut best: Option<(f64, Isometry3<f64>)> = None;
        for _ in 0..MAX_DRAWS {
            let motion = drawn(&centers[i], axes, level, range, rng);
            let overlap = overlap_mm(upper, lower, &motion);
            if best.is_none_or(|(least, _)| overlap < least) {
                best = Some((overlap, motion));
            }
            if overlap <= LARGEST_OVERLAP_MM {
                break;
            }
        }
        let motion = best.map_or_else(Isometry3::identity, |(_, motion)| motion);
        let below = bends[bends.len() - 1];
        bends.push(below * motion);
    }
    bends.reverse();
    Ok(bends)
}

fn drawn(
    center: &Point3<f64>,
    axes: &VertebraAxes,
    level: usize,
    range: MotionRange,
    rng: &mut impl Rng,
) -> Isometry3<f64> {
    let (turn, reach) = match range {
        MotionRange::Physiological => (healthy_turn(axes, level, rng), HEALTHY_SHIFT_MM),
        MotionRange::Fifteen => (any_turn(15.0, rng), LARGEST_SHIFT_MM),
        MotionRange::TwentyFive => (any_turn(25.0, rng), LARGEST_SHIFT_MM),
    };
    let ball: [f64; 3] = UnitBall.sample(rng);
    Translation3::from(Vector3::from(ball) * reach) * turn_about(center, turn)
}

fn healthy_turn(axes: &VertebraAxes, level: usize, rng: &mut impl Rng) -> UnitQuaternion<f64> {
    let level = level.min(FLEXION_DEG.len() - 1);
    let mut about = |axis: Vector3<f64>, limits: &[f64; 4]| {
        let limit = limits[level].to_radians();
        let angle = rng.random_range(-limit..=limit);
        UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle)
    };
    let flexion = about(axes.up.cross(&axes.anterior), &FLEXION_DEG);
    let lateral = about(axes.anterior, &LATERAL_DEG);
    let axial = about(axes.up, &AXIAL_DEG);
    axial * lateral * flexion
}

fn any_turn(limit_deg: f64, rng: &mut impl Rng) -> UnitQuaternion<f64> {
    let axis: [f64; 3] = UnitSphere.sample(rng);
    let angle = rng.random_range(0.0..=limit_deg.to_radians());
    UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis.into()), angle)
}

/// How deep a vertex of either vertebra lies in the other once the upper one has moved.
fn overlap_mm(
    upper: (&TriMesh, &SurfaceIndex),
    lower: (&TriMesh, &SurfaceIndex),
    motion: &Isometry3<f64>,
) -> f64 {
    let back = motion.inverse();
    let upper_in_lower = depth_mm(upper.0, motion, lower);
    let lower_in_upper = depth_mm(lower.0, &back, upper);
    if upper_in_lower > lower_in_upper {
        upper_in_lower
    } else {
        lower_in_upper
    }
}

fn depth_mm(mesh: &TriMesh, motion: &Isometry3<f64>, other: (&TriMesh, &SurfaceIndex)) -> f64 {
    let (low, high) = other.0.bounding_box();
    let mut deepest = 0.0;
    for p in mesh.vertices() {
        let q = motion * p;
        if (0..3).any(|axis| q[axis] < low[axis] || q[axis] > high[axis]) {
            continue;
        }
        let depth = other.1.closest_point(&q).distance_mm;
        if depth > deepest && other.1.contains(&q) {
            deepest = depth;
        }
    }
    deepest
}
