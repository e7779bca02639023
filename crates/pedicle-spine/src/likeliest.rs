//! The likeliest pose of a vertebra's noisy points, and what they say of its shape.
//!
//! ```text
//! T, σ = argmax Σ_i log p(T⁻¹ y_i)
//! ```
//!
//! p is the density of [`crate::blurred_bone`]. Lengths in mm.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{ReferenceSurface, Refinement};

use crate::SpineError;
use crate::blurred_bone::{BlurredBone, MAX_POINTS};
use crate::bone::BoneSurface;
use crate::model::Vertebra;
use crate::shape_change::ShapeChange;

/// More noise than this makes the covariance of the closest places too small, however many points there are, mm: then the likeliest pose
/// of a part of them counts.
const DENSE_UP_TO_MM: f64 = 2.0;

/// What the density of noisy points says.
#[derive(Debug, Default)]
pub(crate) struct Likeliest {
    pub(crate) shape: Option<ShapeChange>,
    /// Whether it has taken the place of the fit to the closest places.
    pub(crate) is_pose: bool,
}

/// Puts the likeliest pose of noisy points in the place of the fit to the closest places, unless there are enough points for
/// that, and their noise; and what they say of the bone's shape.
pub(crate) fn likeliest_pose(
    vertebra: &Vertebra,
    points: &[Point3<f64>],
    (refinement, pose): (&mut Option<Refinement>, &mut Isometry3<f64>),
    asks_for_shape: bool,
) -> Result<Likeliest, SpineError> {
    let Some(fit) = refinement.as_mut() else {
        return Ok(Likeliest::default());
    };
    let stride = points.len().div_ceil(MAX_POINTS).max(1);
    let few: Vec<Point3<f64>> = points.iter().step_by(stride).copied().collect();
    let bone = BlurredBone::new(&vertebra.bone, vertebra.area_mm2, fit.noise_mm)?;
    let Some(likeliest) = bone.fit(pose, &few, fit.noise_mm) else {
        *refinement = None;
        return Ok(Likeliest::default());
    };
    let shape = asks_for_shape
        .then(|| ShapeChange::new(&bone, &vertebra.frame, &likeliest, &few))
        .flatten();
    fit.noise_mm = likeliest.blur.sigma_mm;
    let is_pose = stride == 1 || likeliest.blur.sigma_mm > DENSE_UP_TO_MM;
    if is_pose {
        *pose = likeliest.target_from_source;
        fit.target_from_source = likeliest.target_from_source;
        fit.covariance = likeliest.covariance;
        fit.rmse_mm = rms_distance_mm(&vertebra.bone, pose, points);
    }
    Ok(Likeliest { shape, is_pose })
}

/// Root mean square distance of points from a bone, mm.
fn rms_distance_mm(bone: &BoneSurface, pose: &Isometry3<f64>, points: &[Point3<f64>]) -> f64 {
    let inverse = pose.inverse();
    let squares = points
        .iter()
        .map(|p| bone.closest(&(inverse * p)).distance_mm.powi(2));
    (squares.sum::<f64>() / points.len() as f64).sqrt()
}
