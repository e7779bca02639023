//! Checks shared by the public functions: data is checked once at the door.

use nalgebra::{Isometry3, Point3, Unit, Vector3};

use crate::RegistrationError;

pub(crate) fn finite_points(
    set: &'static str,
    points: &[Point3<f64>],
) -> Result<(), RegistrationError> {
    let is_bad = |p: &Point3<f64>| !p.coords.iter().all(|x| x.is_finite());
    match points.iter().position(is_bad) {
        None => Ok(()),
        Some(index) => {
            let Point3 { coords } = points[index];
            let (x, y, z) = (coords.x, coords.y, coords.z);
            Err(RegistrationError::NonFinitePoint {
                set,
                index,
                x,
                y,
                z,
            })
        }
    }
}

pub(crate) fn finite_pose(pose: &Isometry3<f64>) -> Result<(), RegistrationError> {
    let finite = pose.translation.vector.iter().all(|x| x.is_finite())
        && pose.rotation.coords.iter().all(|x| x.is_finite());
    finite.then_some(()).ok_or(RegistrationError::NonFinitePose)
}

pub(crate) fn at_least(n_points: usize, n_needed: usize) -> Result<(), RegistrationError> {
    if n_points < n_needed {
        return Err(RegistrationError::TooFewPoints { n_points, n_needed });
    }
    Ok(())
}

/// Normalises one normal.
pub(crate) fn unit_normal(
    index: usize,
    normal: &Vector3<f64>,
) -> Result<Unit<Vector3<f64>>, RegistrationError> {
    // Dividing by the largest entry first keeps the square from overflowing or vanishing.
    let largest = normal.amax();
    let length = largest * (normal / largest).norm();
    if !length.is_finite() || largest <= 0.0 {
        let length = if largest == 0.0 { 0.0 } else { length };
        return Err(RegistrationError::BadNormal { index, length });
    }
    Ok(Unit::new_normalize(normal / largest))
}

pub(crate) fn positive(option: &'static str, value: f64) -> Result<(), RegistrationError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(out_of_range(option, value, "positive and finite"))
}

pub(crate) fn not_negative(option: &'static str, value: f64) -> Result<(), RegistrationError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(out_of_range(option, value, "zero or more and finite"))
}

pub(crate) fn out_of_range(
    option: &'static str,
    value: f64,
    expected: &'static str,
) -> RegistrationError {
    RegistrationError::OptionOutOfRange {
        option,
        value,
        expected,
    }
}
