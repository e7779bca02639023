//! Least-squares rigid transform of point pairs.
//!
//! ```text
//! (R, t) = argmin Σ_i w_i |R s_i + t - q_i|²,   det R = +1
//! ```
//!
//! Kabsch 1976; Umeyama 1991, with the scale fixed at 1. With the centred sums
//! `H_ab = Σ w s_a q_b` the best rotation is the unit quaternion of the largest eigenvalue of
//!
//! ```text
//! N = [ tr H   zᵀ            ]    z = (H_yz - H_zy, H_zx - H_xz, H_xy - H_yx)
//!     [ z      H + Hᵀ - tr H ]
//! ```
//!
//! (Horn 1987). A quaternion is a proper rotation by construction, so reflected data needs no
//! case of its own, and the gap between the two largest eigenvalues, 2 (σ₂ ± σ₃), says whether the
//! rotation is determined at all. Units: whatever the points have, mm by convention.

use nalgebra::{Isometry3, Matrix3, Matrix4, Point3, Quaternion, Translation3, UnitQuaternion};

use crate::{RegistrationError, validate};

/// Smallest gap between the best and the second best rotation, relative to the spread of the
/// points. Rounding reaches about 1e-15; points this close to a line have lost six digits.
const MIN_STIFFNESS: f64 = 1e-12;

/// Fewest pairs that determine a rigid transform.
pub(crate) const MIN_PAIRS: usize = 3;

/// Rigid transform that takes `source[i]` to `target[i]` in the least-squares sense.
///
/// The result is always a proper rotation (determinant +1), also for reflected data. Without
/// `weights` all pairs count the same; weights need not sum to one.
///
/// # Errors
/// Fewer than three pairs, counts that differ, a coordinate that is not finite, a weight that is
/// not positive, or pairs that do not determine the rotation (all on a line, all in one place, or
/// a mirror image so symmetric that several rotations fit equally well).
pub fn kabsch(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    weights: Option<&[f64]>,
) -> Result<Isometry3<f64>, RegistrationError> {
    check_pairs(source, target)?;
    match weights {
        None => fit_pairs(source.iter().zip(target).map(|(s, q)| (s, q, 1.0))),
        Some(weights) => {
            check_weights(weights, source.len())?;
            // Only ratios count; dividing by the largest keeps tiny and huge weights in range.
            let largest = weights.iter().fold(0.0_f64, |a, &b| a.max(b));
            let pairs = source.iter().zip(target).zip(weights);
            fit_pairs(pairs.map(|((s, q), w)| (s, q, w / largest)))
        }
    }
}

/// Checks that two sets of points can be paired.
pub(crate) fn check_pairs(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
) -> Result<(), RegistrationError> {
    if source.len() != target.len() {
        let (n_source, n_target) = (source.len(), target.len());
        return Err(RegistrationError::PointCountsDiffer { n_source, n_target });
    }
    validate::at_least(source.len(), MIN_PAIRS)?;
    validate::finite_points("source", source)?;
    validate::finite_points("target", target)
}

fn check_weights(weights: &[f64], n_points: usize) -> Result<(), RegistrationError> {
    if weights.len() != n_points {
        let n_weights = weights.len();
        return Err(RegistrationError::WeightCountDiffers {
            n_points,
            n_weights,
        });
    }
    match weights.iter().position(|w| !(w.is_finite() && *w > 0.0)) {
        Some(index) => Err(RegistrationError::BadWeight {
            index,
            weight: weights[index],
        }),
        None => Ok(()),
    }
}

/// The fit itself, for pairs that are known to be finite and weights known to be positive.
pub(crate) fn fit_pairs<'a, I>(pairs: I) -> Result<Isometry3<f64>, RegistrationError>
where
    I: Iterator<Item = (&'a Point3<f64>, &'a Point3<f64>, f64)> + Clone,
{
    let Some((first_source, first_target, _)) = pairs.clone().next() else {
        return Err(RegistrationError::TooFewPoints {
            n_points: 0,
            n_needed: MIN_PAIRS,
        });
    };
    // Centroids relative to the first pair: far from the origin this keeps the digits.
    let mut n_points = 0;
    let mut total = 0.0;
    let mut source_sum = nalgebra::Vector3::zeros();
    let mut target_sum = nalgebra::Vector3::zeros();
    for (s, q, w) in pairs.clone() {
        n_points += 1;
        total += w;
        source_sum += (s - first_source) * w;
        target_sum += (q - first_target) * w;
    }
    let source_center = first_source + source_sum / total;
    let target_center = first_target + target_sum / total;

    let mut h = Matrix3::zeros();
    let mut source_spread = 0.0;
    let mut target_spread = 0.0;
    for (s, q, w) in pairs {
        let (s, q) = (s - source_center, q - target_center);
        h += s * (q.transpose() * w);
        source_spread += w * s.norm_squared();
        target_spread += w * q.norm_squared();
    }
    let rotation = best_rotation(&h, (source_spread * target_spread).sqrt(), n_points)?;
    let translation = Translation3::from(target_center - rotation * source_center);
    Ok(Isometry3::from_parts(translation, rotation))
}

/// The rotation that maximises `tr(R H)`.
fn best_rotation(
    h: &Matrix3<f64>,
    spread: f64,
    n_points: usize,
) -> Result<UnitQuaternion<f64>, RegistrationError> {
    let undetermined = |stiffness| RegistrationError::RotationUndetermined {
        n_points,
        stiffness,
        needed: MIN_STIFFNESS,
    };
    if n_points < MIN_PAIRS || !spread.is_normal() {
        return Err(undetermined(0.0));
    }
    let h = h / spread;
    let trace = h.trace();
    let z = [h.m23 - h.m32, h.m31 - h.m13, h.m12 - h.m21];
    let n = Matrix4::new(
        trace,
        z[0],
        z[1],
        z[2], //
        z[0],
        2.0 * h.m11 - trace,
        h.m12 + h.m21,
        h.m13 + h.m31, //
        z[1],
        h.m12 + h.m21,
        2.0 * h.m22 - trace,
        h.m23 + h.m32, //
        z[2],
        h.m13 + h.m31,
        h.m23 + h.m32,
        2.0 * h.m33 - trace,
    );
    let eigen = n.symmetric_eigen();
    let best = eigen.eigenvalues.imax();
    let second = (0..4)
        .filter(|&i| i != best)
        .map(|i| eigen.eigenvalues[i])
        .fold(f64::NEG_INFINITY, f64::max);
    let stiffness = eigen.eigenvalues[best] - second;
    if stiffness.is_nan() || stiffness <= MIN_STIFFNESS {
        return Err(undetermined(stiffness));
    }
    let q = eigen.eigenvectors.column(best);
    Ok(UnitQuaternion::from_quaternion(Quaternion::new(
        q[0], q[1], q[2], q[3],
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn stiffness_is_the_sum_of_the_two_smaller_singular_values() {
        // A unit spread along x, y, z of 9 : 4 : 1; the gap is 2 (4 + 1) / 14.
        let h = Matrix3::from_diagonal(&Vector3::new(9.0, 4.0, 1.0));
        assert!(
            best_rotation(&h, 14.0, 3).is_ok(),
            "a well spread set has a rotation"
        );
        // Mirrored with σ₂ = σ₃ the gap closes.
        let h = Matrix3::from_diagonal(&Vector3::new(9.0, 4.0, -4.0));
        let error = best_rotation(&h, 17.0, 3).expect_err("two rotations fit equally well");
        assert!(
            matches!(error, RegistrationError::RotationUndetermined { stiffness, .. } if stiffness < 1e-12),
            "unexpected {error}"
        );
    }

    #[test]
    fn nan_sums_are_refused() {
        let h = Matrix3::from_element(f64::NAN);
        assert!(
            best_rotation(&h, f64::NAN, 3).is_err(),
            "NaN has no rotation"
        );
    }
}
