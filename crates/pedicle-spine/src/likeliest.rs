//! The likeliest pose of a vertebra's noisy points, and what they say of its shape.
//!
//! ```text
//! T, σ = argmax Σ_i log p(T⁻¹ y_i)
//! ```
//!
//! p is the density of [`crate::blurred_bone`]. Lengths in mm.

use nalgebra::Isometry3;
use pedicle_registration::{ReferenceSurface, Refinement};

use crate::SpineError;
use crate::blurred_bone::{BlurredBone, MAX_POINTS};
use crate::bone::BoneSurface;
use crate::facing::FacingPoint;
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

/// Puts the likeliest pose of noisy points in the place of the fit to the closest places, unless these do as well, and their noise; and
/// tells what they say of the bone's shape.
pub(crate) fn likeliest_pose(
    vertebra: &Vertebra,
    points: &[FacingPoint],
    (refinement, pose): (&mut Option<Refinement>, &mut Isometry3<f64>),
    asks_for_shape: bool,
) -> Result<Likeliest, SpineError> {
    let Some(fit) = refinement.as_mut() else {
        return Ok(Likeliest::default());
    };
    let stride = points.len().div_ceil(MAX_POINTS).max(1);
    let few: Vec<FacingPoint> = points.iter().step_by(stride).copied().collect();
    let bone = BlurredBone::new(
        (&vertebra.bone, &vertebra.bends),
        vertebra.area_mm2,
        fit.noise_mm,
    )?;
    let Some(likeliest) = bone.fit(pose, &few, fit.noise_mm) else {
        *refinement = None;
        return Ok(Likeliest::default());
    };
    let shape = asks_for_shape
        .then(|| {
            let start = &likeliest.target_from_source;
            let crowded = bone.fit_crowded(start, &few, likeliest.blur.sigma_mm)?;
            ShapeChange::new(&bone, vertebra, &crowded, &few)
        })
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
fn rms_distance_mm(bone: &BoneSurface, pose: &Isometry3<f64>, points: &[FacingPoint]) -> f64 {
    let inverse = pose.inverse();
    let squares = points
        .iter()
        .map(|p| bone.closest(&(inverse * p.position)).distance_mm.powi(2));
    (squares.sum::<f64>() / points.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MapOptions, SourceVertebra, SpineModel};
    use nalgebra::{Point3, Vector3};
    use pedicle_registration::{RefineOptions, refine_on_surface};
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn the_closest_places_of_many_points_count_until_noise_is_too_much_for_them() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let source = phantom.vertebrae.iter().map(|v| SourceVertebra {
            level: v.level,
            surface: v.mesh.clone(),
        });
        let landmarks = phantom.landmarks();
        let model = SpineModel::new(source.collect(), &landmarks, &MapOptions::default()).unwrap();
        let vertebra = &model.vertebrae[2];
        let truth = Isometry3::new(Vector3::new(4.0, 60.0, -9.0), Vector3::new(0.2, -0.4, 0.3));
        let judged = |n_points: usize, sigma_mm: f64| {
            let mut rng = ChaCha8Rng::seed_from_u64(5);
            let points: Vec<Point3<f64>> = vertebra
                .bone
                .spread_points(n_points)
                .into_iter()
                .map(|p| {
                    let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng));
                    truth * (p + noise * sigma_mm)
                })
                .collect();
            let options = RefineOptions {
                max_distance_mm: 10.0,
                start_distance_mm: None,
                ..RefineOptions::default()
            };
            let closest = refine_on_surface(&vertebra.bone, &points, &truth, &options).unwrap();
            let (mut fit, mut pose) = (Some(closest.clone()), closest.target_from_source);
            let points: Vec<FacingPoint> = points.into_iter().map(FacingPoint::of).collect();
            let found = likeliest_pose(vertebra, &points, (&mut fit, &mut pose), false).unwrap();
            let fit = fit.unwrap();
            assert!(found.shape.is_none(), "not asked for");
            assert!((fit.noise_mm - sigma_mm).abs() < 0.1, "{}", fit.noise_mm);
            assert_eq!(fit.target_from_source, pose);
            assert_eq!(found.is_pose, pose != closest.target_from_source);
            let squared = fit.covariance.normalized_error_squared(&pose, &truth);
            (found.is_pose, squared.unwrap() / 6.0)
        };
        assert!(judged(600, 1.5).0, "few points");
        assert!(!judged(4000, 1.5).0, "many points");
        let (is_pose, squared) = judged(4000, 2.3);
        assert!(is_pose, "many points and much noise");
        assert!(
            squared < 2.8,
            "χ² of 6 over 6 is {squared}: above 2.8 once in 100"
        );
    }
}
