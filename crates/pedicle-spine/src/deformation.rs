//! What noisy points say of a smooth deformation of a bone.
//!
//! ```text
//! ∂ log p(x) / ∂e_k = Σ_j r_j(x) (x - s_j) · f_k(s_j) / σ²,   s_j → s_j + Σ_k e_k f_k(s_j)
//! ```
//!
//! p, r and s are those of [`crate::blurred_bone`]; the fields f_k are stretch and shear, and all quadratic and cubic fields, along the axes of
//! the vertebra. Source frame, mm.

use nalgebra::{DMatrix, Point3, SMatrix};
use pedicle_trajectory::AnatomicalFrame;

use crate::blurred_bone::{Blur, BlurredBone, N_FREE};

/// Numbers of a deformation: of stretch and shear, of quadratic, and of cubic fields.
pub(crate) const N_LINEAR: usize = 6;
pub(crate) const N_MODES: usize = N_LINEAR + 18 + 30;
/// Linear, quadratic and cubic monomials of a place.
const N_FIELDS: usize = 3 + 6 + 10;
/// Length by which places are divided: all numbers of a deformation are lengths then, mm.
pub(crate) const LEVER_MM: f64 = 25.0;

/// A row a point that lies near a place: the derivatives of its log density by the change of pose, σ, the weights of the regions
/// and the deformation, in the source frame.
pub(crate) fn rows(
    blurred: &BlurredBone,
    frame: &AnatomicalFrame,
    blur: &Blur,
    points: Vec<Point3<f64>>,
) -> DMatrix<f64> {
    let expected = blurred.expected(blur);
    let n_columns = N_FREE + expected.len() + N_MODES;
    let variance = blur.sigma_mm * blur.sigma_mm;
    let fields: Vec<[f64; N_FIELDS]> = blurred
        .places
        .iter()
        .map(|place| monomials(&lever(blurred, frame, place)))
        .collect();
    let mut all = Vec::with_capacity(points.len() * n_columns);
    let n_rows = blurred.each_said(points, blur, |said| {
        let start = all.len();
        all.extend(said.free.iter());
        all.extend(expected.iter().map(|e| -e));
        blurred.add_regions(said.shown, &mut all[start + N_FREE..]);
        // Moving a place by a field moves the density with it: the noise (x - s) / σ² along the field.
        let mut by_field = SMatrix::<f64, 3, N_FIELDS>::zeros();
        for &(j, r) in said.shown {
            let away = (said.point - blurred.places[j as usize]) * (r / variance);
            let along = [frame.left, frame.anterior, frame.up].map(|axis| axis.dot(&away));
            for (column, field) in fields[j as usize].iter().enumerate() {
                for (i, along) in along.into_iter().enumerate() {
                    by_field[(i, column)] += along * field;
                }
            }
        }
        // Of the linear fields what turns is part of the pose.
        all.extend((0..3).map(|k| by_field[(k, k)]));
        let shears = [(0, 1), (0, 2), (1, 2)];
        all.extend(shears.map(|(i, k)| by_field[(i, k)] + by_field[(k, i)]));
        all.extend(by_field.columns(3, N_FIELDS - 3).iter());
    });
    DMatrix::from_row_slice(n_rows, n_columns, &all)
}

/// A place from the centre of the bone along the axes of the vertebra, in levers.
fn lever(blurred: &BlurredBone, frame: &AnatomicalFrame, place: &Point3<f64>) -> [f64; 3] {
    let from_center = (place - blurred.center) / LEVER_MM;
    [frame.left, frame.anterior, frame.up].map(|axis| axis.dot(&from_center))
}

/// All products of one, two and three coordinates.
fn monomials(u: &[f64; 3]) -> [f64; N_FIELDS] {
    let [x, y, z] = *u;
    [
        x,
        y,
        z,
        x * x,
        x * y,
        x * z,
        y * y,
        y * z,
        z * z,
        x * x * x,
        x * x * y,
        x * x * z,
        x * y * y,
        x * y * z,
        x * z * z,
        y * y * y,
        y * y * z,
        y * z * z,
        z * z * z,
    ]
}
