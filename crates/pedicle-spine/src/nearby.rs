//! Small steps from a pose: where soft tissue pulls a fit aside, the right pose is often a few
//! millimetres and degrees away, beyond a ridge that no single refinement crosses.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::model::Vertebra;

/// Length of the steps, mm. Longer than what counts as the same pose.
const STEP_MM: f64 = 5.5;
/// Angle of the turns about the landmark, rad (14°).
const TURN_RAD: f64 = 0.244;

/// Steps along and turns about the axes of the vertebra, both ways. Turns keep the middle of what
/// a posterior view shows.
pub(crate) fn nearby(vertebra: &Vertebra, pose: &Isometry3<f64>) -> Vec<Isometry3<f64>> {
    let frame = &vertebra.frame;
    let axes: [Vector3<f64>; 3] = [frame.left, frame.anterior, frame.up];
    let center: Point3<f64> = nalgebra::center(&vertebra.landmark, &vertebra.bone.centroid());
    let mut found = Vec::with_capacity(12);
    for axis in axes {
        for sign in [1.0, -1.0] {
            let step = Translation3::from(axis * (sign * STEP_MM));
            found.push(pose * step);
            let rotation =
                UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), sign * TURN_RAD);
            let shift = center.coords - rotation * center.coords;
            found.push(pose * Isometry3::from_parts(Translation3::from(shift), rotation));
        }
    }
    found
}
