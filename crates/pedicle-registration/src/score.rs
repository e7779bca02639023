//! Score of a pose that needs no refinement, for comparing hypotheses.
//!
//! ```text
//! cost = (1/n) Σ_j min(d_j² / τ², 1),   d_j = distance of T⁻¹ p_j from the surface
//! ```
//!
//! Between 0 and 1, the cost of MSAC with the surface in place of pairs; τ = `truncation_mm`.

use nalgebra::{Isometry3, Point3};

use crate::{ReferenceSurface, RegistrationError, validate};

/// How well a pose explains target points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceScore {
    /// Mean truncated squared distance, 0 (every point on the surface) to 1 (none near it).
    pub cost: f64,
    /// Share of the points nearer than the truncation, 0..1.
    pub explained: f64,
    /// Root mean square distance of those points, mm; 0 if there are none.
    pub rmse_mm: f64,
}

/// Scores one pose: target points are brought into the source frame, where the surface lives.
///
/// # Errors
/// No point, a coordinate or pose that is not finite, a truncation that is not positive.
pub fn robust_cost(
    surface: &(impl ReferenceSurface + ?Sized),
    target_points: &[Point3<f64>],
    target_from_source: &Isometry3<f64>,
    truncation_mm: f64,
) -> Result<SurfaceScore, RegistrationError> {
    validate::at_least(target_points.len(), 1)?;
    validate::finite_points("target", target_points)?;
    validate::finite_pose(target_from_source)?;
    validate::positive("truncation_mm", truncation_mm)?;

    let (mut n_near, mut sum) = (0_usize, 0.0);
    for p in target_points {
        let query = target_from_source.inverse_transform_point(p);
        let Some(hit) = surface.closest_within(&query, truncation_mm) else {
            continue;
        };
        // A NaN from a broken surface counts as far away.
        if hit.distance_mm.is_nan() || hit.distance_mm > truncation_mm {
            continue;
        }
        n_near += 1;
        sum += hit.distance_mm.powi(2);
    }
    let n = target_points.len() as f64;
    let n_far = (target_points.len() - n_near) as f64;
    Ok(SurfaceScore {
        cost: (sum / truncation_mm.powi(2) + n_far) / n,
        explained: n_near as f64 / n,
        rmse_mm: if n_near == 0 {
            0.0
        } else {
            (sum / n_near as f64).sqrt()
        },
    })
}
