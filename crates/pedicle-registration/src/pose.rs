//! Differences between two rigid transforms.
//!
//! ```text
//! Δ = T_found T_true⁻¹,   ω = log R_Δ,   t = Δ(c) - c
//! ```
//!
//! Δ lives in the target frame and carries the true place of a point to the found one:
//! `p_found = c + exp(ω) (p_true - c) + t`. Translations in mm, rotations in radians.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3, Vector6};

/// How far a found pose is from the true one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseError {
    /// Distance between a chosen source point under the found and under the true pose, mm.
    pub translation_mm: f64,
    /// Angle of `R_found R_trueᵀ`, in 0..π rad.
    pub rotation_rad: f64,
}

/// Compares two poses `target_from_source` at a point of the source (a centroid, an entry point).
pub fn pose_error(
    found: &Isometry3<f64>,
    truth: &Isometry3<f64>,
    point_in_source: &Point3<f64>,
) -> PoseError {
    PoseError {
        translation_mm: (found * point_in_source - truth * point_in_source).norm(),
        rotation_rad: rotation_angle(&(found.rotation * truth.rotation.inverse())),
    }
}

/// Angle of a rotation in 0..π rad, exact near 0 where the arc cosine of the trace is not.
pub fn rotation_angle(rotation: &UnitQuaternion<f64>) -> f64 {
    2.0 * rotation.imag().norm().atan2(rotation.w.abs())
}

/// The difference of two poses as `[rotation xyz (rad); translation xyz (mm)]` about `center`,
/// a point of the target frame: the vector that a [`PoseCovariance`](crate::PoseCovariance) about
/// the same centre describes.
pub fn pose_difference(
    found: &Isometry3<f64>,
    truth: &Isometry3<f64>,
    center: &Point3<f64>,
) -> Vector6<f64> {
    let turn = found.rotation * truth.rotation.inverse();
    let omega = rotation_vector(&turn);
    let shift = found * truth.inverse_transform_point(center) - center;
    Vector6::new(omega.x, omega.y, omega.z, shift.x, shift.y, shift.z)
}

/// `log R`, the axis times the angle.
fn rotation_vector(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let angle = rotation_angle(rotation);
    let imag = rotation.imag() * rotation.w.signum();
    let length = imag.norm();
    // sin(x/2) = x/2 to the last digit below this length.
    if length < 1e-9 {
        imag * 2.0
    } else {
        imag * (angle / length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;

    #[test]
    fn small_angles_keep_their_digits() {
        for angle in [1e-15, 1e-12, 1e-8, 1e-3, 1.0, 3.1] {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, angle, 0.0));
            let found = rotation_angle(&turn);
            assert!(
                (found / angle - 1.0).abs() < 1e-9,
                "angle {angle} came back as {found}"
            );
            let vector = rotation_vector(&turn);
            assert!(
                (vector.y / angle - 1.0).abs() < 1e-9,
                "axis {vector} for {angle}"
            );
        }
        assert!(
            rotation_angle(&UnitQuaternion::identity()).abs() < 1e-300,
            "no angle"
        );
    }

    #[test]
    fn both_signs_of_the_quaternion_are_one_rotation() {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.2, 0.1));
        let other = UnitQuaternion::new_unchecked(-turn.into_inner());
        assert!(
            (rotation_angle(&turn) - rotation_angle(&other)).abs() < 1e-15,
            "angles differ"
        );
        let gap = (rotation_vector(&turn) - rotation_vector(&other)).norm();
        assert!(gap < 1e-15, "axes differ by {gap}");
    }

    #[test]
    fn the_difference_carries_true_places_to_found_ones() {
        let truth = Isometry3::new(Vector3::new(5.0, -2.0, 1.0), Vector3::new(0.4, 0.1, -0.9));
        let found = Isometry3::new(Vector3::new(4.0, 3.0, 2.0), Vector3::new(0.3, 0.2, -0.7));
        let center = Point3::new(20.0, 10.0, -7.0);
        let d = pose_difference(&found, &truth, &center);
        let turn = UnitQuaternion::from_scaled_axis(d.fixed_rows::<3>(0).into_owned());
        let shift = Translation3::from(d.fixed_rows::<3>(3).into_owned());
        let p = Point3::new(1.0, 2.0, 3.0);
        let carried = shift * (center + turn * (truth * p - center));
        assert!((carried - found * p).norm() < 1e-12, "carried to {carried}");
    }
}
