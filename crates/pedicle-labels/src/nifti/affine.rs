//! From voxel indices to RAS millimetres.
//!
//! ```text
//! sform:  x = S (i, j, k, 1)
//! qform:  x = R(b, c, d) diag(p₁, p₂, q p₃) (i, j, k) + offset,   q = ±1
//! ```
//!
//! sform before qform, as most programs do; without either nobody can tell left from right, and the
//! file is refused. nifti1.h, "METHOD 2" and "METHOD 3".

use std::path::Path;

use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};

use super::header::Header;
use crate::LabelError;

/// Excess of b² + c² + d² over 1 that rounding to f32 explains.
const QUATERNION_SLACK: f64 = 1e-4;
/// Smallest determinant relative to the product of the columns' lengths: below it the axes lie in
/// a plane.
const MIN_RELATIVE_DETERMINANT: f64 = 1e-6;

pub(super) fn ras_from_voxel(header: &Header, path: &Path) -> Result<Matrix4<f64>, LabelError> {
    let (form, mut matrix) = if header.sform_code > 0 {
        ("sform", sform(header))
    } else if header.qform_code > 0 {
        ("qform", qform(header, path)?)
    } else {
        return Err(LabelError::NoOrientation {
            path: path.to_owned(),
        });
    };
    for x in matrix.fixed_view_mut::<3, 4>(0, 0).iter_mut() {
        *x *= header.unit_mm;
    }
    let linear = matrix.fixed_view::<3, 3>(0, 0);
    let lengths: f64 = linear.column_iter().map(|c| c.norm()).product();
    let determinant = linear.determinant();
    let is_finite = matrix.iter().all(|x| x.is_finite()) && lengths.is_finite();
    if !is_finite || lengths <= 0.0 || determinant.abs() < MIN_RELATIVE_DETERMINANT * lengths {
        return Err(LabelError::SingularAffine {
            path: path.to_owned(),
            form,
            determinant,
        });
    }
    Ok(matrix)
}

fn sform(header: &Header) -> Matrix4<f64> {
    Matrix4::from_fn(|r, c| match r {
        3 => f64::from(u8::from(c == 3)),
        _ => header.srow[r][c],
    })
}

fn qform(header: &Header, path: &Path) -> Result<Matrix4<f64>, LabelError> {
    let broken = |message: String| LabelError::Header {
        path: path.to_owned(),
        message,
    };
    let [b, c, d] = header.quaternion;
    let rest = 1.0 - (b * b + c * c + d * d);
    if rest.is_nan() || rest < -QUATERNION_SLACK {
        return Err(broken(format!(
            "the quaternion ({b}, {c}, {d}) of the qform is longer than 1"
        )));
    }
    let a = if rest > 0.0 { rest.sqrt() } else { 0.0 };
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(a, b, c, d));
    let [q, p1, p2, p3] = header.pixdim;
    if !(p1 > 0.0 && p2 > 0.0 && p3 > 0.0) {
        return Err(broken(format!("pixdim is {p1}, {p2}, {p3}")));
    }
    let handedness = if q < 0.0 { -1.0 } else { 1.0 };
    let linear: Matrix3<f64> = rotation.to_rotation_matrix().matrix()
        * Matrix3::from_diagonal(&Vector3::new(p1, p2, handedness * p3));
    let mut matrix = linear.to_homogeneous();
    for (row, x) in header.offset.iter().enumerate() {
        matrix[(row, 3)] = *x;
    }
    Ok(matrix)
}
