//! How well a surface determines a pose, and what a pose error does to a point.
//!
//! ```text
//! a_j = [ (p_j - c) × n_j ; n_j ],   I = (1/σ²) Σ_j a_j a_jᵀ,   Σ = I⁻¹
//! ```
//!
//! 6 × 6, symmetric, positive definite unless the surface can slide on itself. Order of rows and
//! columns: `[rotation x y z (rad); translation x y z (mm)]`, about the centre c, all in the target
//! frame. σ is the noise of a point along the normal, in mm. Σ is the Cramér-Rao bound of every
//! unbiased registration of points to the surface (Censi 2007 for range scans).

use nalgebra::{Isometry3, Matrix3, Matrix3x6, Matrix6, Point3, SymmetricEigen, Vector3, Vector6};

use crate::{RegistrationError, pose_difference, validate};

/// A surface is degenerate below this ratio of the smallest to the largest eigenvalue of its
/// information (rotations scaled by the radius). Rounding alone gives up to about 1e-14; real
/// vertebrae, halves included, lie above 1e-3.
pub(crate) const MIN_EIGENVALUE_RATIO: f64 = 1e-10;

/// Fewest points whose normals can fix six degrees of freedom.
const MIN_POINTS: usize = 6;

/// Uncertainty of a pose `target_from_source`, to first order.
///
/// The true place of a point p of the target frame scatters by `ω × (p - center) + t`, where
/// `[ω; t]` has mean zero and covariance `matrix`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseCovariance {
    /// Covariance of `[rotation xyz (rad); translation xyz (mm)]`, axes of the target frame.
    pub matrix: Matrix6<f64>,
    /// The point the rotation turns about, in the target frame, mm.
    pub center: Point3<f64>,
}

/// The smallest errors any unbiased registration can have on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseBound {
    /// Root mean square error of the place of the centre: root of the trace of the 3 × 3 block.
    pub translation_mm: f64,
    /// Root mean square rotation error: root of the trace of its block, rad.
    pub rotation_rad: f64,
    /// The whole bound.
    pub covariance: PoseCovariance,
}

impl PoseCovariance {
    /// Standard deviations `[rotation xyz (rad); translation xyz (mm)]`.
    pub fn standard_deviations(&self) -> Vector6<f64> {
        self.matrix.diagonal().map(|v| v.max(0.0).sqrt())
    }

    /// Root mean square rotation error, rad.
    pub fn rotation_rad(&self) -> f64 {
        self.matrix.fixed_view::<3, 3>(0, 0).trace().max(0.0).sqrt()
    }

    /// Root mean square error of the place of the centre, mm.
    pub fn translation_mm(&self) -> f64 {
        self.matrix.fixed_view::<3, 3>(3, 3).trace().max(0.0).sqrt()
    }

    /// Covariance (mm²) of the place of a point given in the target frame.
    pub fn point_covariance(&self, point_in_target: &Point3<f64>) -> Matrix3<f64> {
        let mut jacobian = Matrix3x6::zeros();
        // ω × r = -[r]× ω.
        let lever = -(point_in_target - self.center).cross_matrix();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&lever);
        jacobian.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        symmetric3(jacobian * self.matrix * jacobian.transpose())
    }

    /// Root mean square error of the place of a point given in the target frame, mm.
    pub fn point_error_mm(&self, point_in_target: &Point3<f64>) -> f64 {
        self.point_covariance(point_in_target)
            .trace()
            .max(0.0)
            .sqrt()
    }

    /// Standard deviation of the place of a point along a direction of the target frame, mm. The
    /// direction may have any length but zero.
    pub fn point_error_along_mm(&self, point: &Point3<f64>, direction: &Vector3<f64>) -> f64 {
        let u = direction.normalize();
        u.dot(&(self.point_covariance(point) * u)).max(0.0).sqrt()
    }

    /// The same uncertainty with the rotation taken about another point of the target frame.
    pub fn about(&self, center: &Point3<f64>) -> Self {
        let mut jacobian = Matrix6::identity();
        let lever = -(center - self.center).cross_matrix();
        jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
        let matrix = symmetric6(jacobian * self.matrix * jacobian.transpose());
        Self {
            matrix,
            center: *center,
        }
    }

    /// `δᵀ Σ⁻¹ δ` of the difference between two poses: 6 on average if `truth` is the truth and
    /// the covariance is honest.
    ///
    /// # Errors
    /// A covariance without an inverse.
    pub fn normalized_error_squared(
        &self,
        found: &Isometry3<f64>,
        truth: &Isometry3<f64>,
    ) -> Result<f64, RegistrationError> {
        let difference = pose_difference(found, truth, &self.center);
        let (rotation, translation) = (self.rotation_rad(), self.translation_mm());
        let length = if rotation > 0.0 {
            translation / rotation
        } else {
            1.0
        };
        let inverse = invert_scaled(&self.matrix, &scaling(length), 0.0)?;
        Ok(difference.dot(&(inverse * difference)))
    }
}

/// Information of unit noise, `Σ a aᵀ` with `a = [ (p - c) × n ; n ]`, about `center`. Divide by σ²
/// for noise of σ mm. Points, normals and centre are in one frame; normals are made unit length.
///
/// # Errors
/// No point, counts that differ, a coordinate that is not finite or a normal without direction.
pub fn pose_information(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    center: &Point3<f64>,
) -> Result<Matrix6<f64>, RegistrationError> {
    let n_points = points.len();
    if normals.len() != n_points {
        let n_normals = normals.len();
        return Err(RegistrationError::NormalCountDiffers {
            n_points,
            n_normals,
        });
    }
    validate::at_least(n_points, 1)?;
    validate::finite_points("surface", points)?;
    validate::finite_points("center", std::slice::from_ref(center))?;
    let mut information = Matrix6::zeros();
    for (index, (point, normal)) in points.iter().zip(normals).enumerate() {
        let normal = validate::unit_normal(index, normal)?;
        let a = constraint(&(point - center), &normal);
        information.ger(1.0, &a, &a, 1.0);
    }
    Ok(information)
}

/// The Cramér-Rao bound of registering these points, with noise of `noise_mm` along the normals,
/// to the surface they lie on. Points and normals are the true ones, in the target frame; the
/// bound is about `center`.
///
/// # Errors
/// What [`pose_information`] refuses, noise that is negative or not finite, fewer than six points,
/// and a surface that does not determine the pose (a plane, a sphere, a cylinder).
pub fn cramer_rao_bound(
    points: &[Point3<f64>],
    normals: &[Vector3<f64>],
    center: &Point3<f64>,
    noise_mm: f64,
) -> Result<PoseBound, RegistrationError> {
    validate::not_negative("noise_mm", noise_mm)?;
    validate::at_least(points.len(), MIN_POINTS)?;
    validate::finite_points("surface", points)?;
    validate::finite_points("center", std::slice::from_ref(center))?;
    // About the centroid the matrix is best conditioned; the bound is moved afterwards.
    let centroid = centroid(points);
    let radius = root_mean_square_radius(points, &centroid);
    let information = pose_information(points, normals, &centroid)?;
    let covariance = covariance_of(&information, radius, &centroid)?
        .scaled(noise_mm * noise_mm)
        .about(center);
    Ok(PoseBound {
        translation_mm: covariance.translation_mm(),
        rotation_rad: covariance.rotation_rad(),
        covariance,
    })
}

impl PoseCovariance {
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self {
            matrix: self.matrix * factor,
            center: self.center,
        }
    }
}

/// One row of the design matrix.
pub(crate) fn constraint(lever: &Vector3<f64>, normal: &Vector3<f64>) -> Vector6<f64> {
    let turn = lever.cross(normal);
    Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z)
}

/// Inverse of an information matrix about `center`, for points within about `radius` of it.
pub(crate) fn covariance_of(
    information: &Matrix6<f64>,
    radius: f64,
    center: &Point3<f64>,
) -> Result<PoseCovariance, RegistrationError> {
    // A lever of `radius` makes a rotation comparable to a translation.
    let scale = scaling(1.0 / radius);
    let matrix = invert_scaled(information, &scale, MIN_EIGENVALUE_RATIO)?;
    Ok(PoseCovariance {
        matrix,
        center: *center,
    })
}

/// The diagonal that multiplies rotations by `length` and leaves translations alone.
pub(crate) fn scaling(length: f64) -> Vector6<f64> {
    Vector6::new(length, length, length, 1.0, 1.0, 1.0)
}

/// `M⁻¹` by way of the eigenvalues of `D M D`, D = diag(scale).
fn invert_scaled(
    matrix: &Matrix6<f64>,
    scale: &Vector6<f64>,
    min_ratio: f64,
) -> Result<Matrix6<f64>, RegistrationError> {
    let scaled = Matrix6::from_fn(|i, j| scale[i] * matrix[(i, j)] * scale[j]);
    if !scaled.iter().all(|x| x.is_finite()) {
        return Err(degenerate(&Vector6::zeros()));
    }
    let eigen = SymmetricEigen::new(scaled);
    let largest = eigen.eigenvalues.amax();
    if eigen.eigenvalues.min() <= min_ratio * largest {
        return Err(degenerate(&eigen.eigenvalues));
    }
    let mut inverse = Matrix6::zeros();
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        inverse.ger(1.0 / value, &vector, &vector, 1.0);
    }
    Ok(symmetric6(Matrix6::from_fn(|i, j| {
        scale[i] * inverse[(i, j)] * scale[j]
    })))
}

fn degenerate(eigenvalues: &Vector6<f64>) -> RegistrationError {
    RegistrationError::Degenerate {
        smallest_eigenvalue: eigenvalues.min(),
        largest_eigenvalue: eigenvalues.amax(),
    }
}

pub(crate) fn centroid(points: &[Point3<f64>]) -> Point3<f64> {
    // Summed from the first point: far from the origin this keeps the digits.
    let Some(first) = points.first() else {
        return Point3::origin();
    };
    first + points.iter().map(|p| p - first).sum::<Vector3<f64>>() / points.len() as f64
}

fn root_mean_square_radius(points: &[Point3<f64>], center: &Point3<f64>) -> f64 {
    let sum: f64 = points.iter().map(|p| (p - center).norm_squared()).sum();
    (sum / points.len() as f64).sqrt()
}

fn symmetric3(m: Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}

fn symmetric6(m: Matrix6<f64>) -> Matrix6<f64> {
    (m + m.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scaled_inverse_is_the_inverse() {
        let a = Matrix6::from_fn(|i, j| ((3 * i + 5 * j + i * j) % 7) as f64 - 3.0);
        let spd = a * a.transpose() + Matrix6::identity();
        for length in [1e-4, 1.0, 1e4] {
            let scale = scaling(length);
            let stretched = Matrix6::from_fn(|i, j| spd[(i, j)] / (scale[i] * scale[j]));
            let inverse = invert_scaled(&stretched, &scale, 1e-10).expect("positive definite");
            let product = Matrix6::from_fn(|i, j| {
                (0..6)
                    .map(|k| stretched[(i, k)] * inverse[(k, j)])
                    .sum::<f64>()
                    * scale[i]
                    / scale[j]
            });
            let gap = (product - Matrix6::identity()).amax();
            assert!(
                gap < 1e-10,
                "at length {length} the product is off by {gap}"
            );
        }
    }

    #[test]
    fn nan_information_is_degenerate() {
        let nan = Matrix6::from_element(f64::NAN);
        assert!(
            covariance_of(&nan, 1.0, &Point3::origin()).is_err(),
            "NaN has no inverse"
        );
        let zero = Matrix6::zeros();
        assert!(
            covariance_of(&zero, 0.0, &Point3::origin()).is_err(),
            "a point has no pose"
        );
    }
}
