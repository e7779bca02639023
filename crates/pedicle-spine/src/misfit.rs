//! Misfit that is not noise.
//!
//! ```text
//! m² = Σ r_i r_j / N   over the N pairs with |p_i - p_j| ≤ 6 mm and n_i · n_j ≥ 0.7
//! ```
//!
//! r are the signed distances of the target points from the surface in its pose. Noise of a sensor
//! is independent from point to point, so under the right bone m² is zero up to σ²/√N. Another
//! shape (another patient, another level, soft tissue) leaves dents and bumps of some millimetres'
//! extent: neighbouring residuals agree in sign, and m is the depth of the bumps. This is Moran's I
//! (Moran 1950) without the division by the variance, in mm.

use kiddo::SquaredEuclidean;
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::ReferenceSurface;

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::prepare::tree_of;

/// Points are compared with those this near, mm.
pub(crate) const PATCH_MM: f64 = 6.0;
/// And with normals whose cosine is at least this.
const SAME_SIDE: f64 = 0.7;
/// A point displaced along the surface by σ lies σ² κ / 2 outside a bone of curvature κ: noise leaves
/// bumps of this many times σ², 1/mm. Measured on phantoms under the true pose: 0.21 to 0.25 at every
/// noise from 0.9 to 3 mm, on whole bones and on what a camera sees.
const CURVATURE_PER_MM: f64 = 0.24;
/// Points of a vertebra that are looked at; more are thinned out.
const MAX_POINTS: usize = 1200;

/// How far the shape differs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Misfit {
    /// m², mm²; may be negative by chance.
    pub(crate) covariance_mm2: f64,
    /// Standard deviation of m² if there were only noise, mm².
    pub(crate) deviation_mm2: f64,
    /// Pairs a point over the variance of the residuals, 1/mm²: what m² does to the variance of sums.
    pub(crate) pairs_over_variance: f64,
}

impl Misfit {
    /// No pair was found.
    pub(crate) const UNKNOWN: Self = Self {
        covariance_mm2: f64::NAN,
        deviation_mm2: f64::NAN,
        pairs_over_variance: 0.0,
    };

    /// What is left of m² once noise of this deviation is taken off, mm²: what it does to m² through
    /// the curvature of the bone, and what it may do by chance.
    pub(crate) fn beyond_noise_mm2(&self, noise_mm: f64, in_sigma: f64) -> f64 {
        self.beyond_curvature_mm2(noise_mm) - in_sigma * self.deviation_mm2
    }

    fn beyond_curvature_mm2(&self, noise_mm: f64) -> f64 {
        let by_curvature = CURVATURE_PER_MM * noise_mm * noise_mm;
        self.covariance_mm2 - by_curvature * by_curvature
    }

    /// Factor by which the correlation enlarges the variance of sums over the points:
    /// Var(Σ r) = n σ² + 2 Σ over pairs of m².
    pub(crate) fn inflation(&self, noise_mm: f64) -> f64 {
        let grown = 2.0 * self.pairs_over_variance * self.beyond_curvature_mm2(noise_mm);
        if grown > 0.0 { 1.0 + grown } else { 1.0 }
    }

    /// Depth of the bumps, mm: zero if the correlation is negative.
    pub(crate) fn depth_mm(&self) -> f64 {
        if self.covariance_mm2 > 0.0 {
            self.covariance_mm2.sqrt()
        } else {
            self.covariance_mm2 * 0.0
        }
    }
}

/// Compares neighbouring residuals of the points of one vertebra that lie within `gate_mm`.
pub(crate) fn misfit(
    bone: &BoneSurface,
    pose: &Isometry3<f64>,
    points: &[Point3<f64>],
    gate_mm: f64,
) -> Result<Misfit, SpineError> {
    let inverse = pose.inverse();
    let mut within: Vec<(Point3<f64>, Vector3<f64>, f64)> = points
        .iter()
        .filter_map(|p| {
            let local = inverse * p;
            let hit = bone.closest(&local);
            (hit.distance_mm <= gate_mm)
                .then(|| (local, hit.normal, (local - hit.point).dot(&hit.normal)))
        })
        .collect();
    let stride = within.len().div_ceil(MAX_POINTS).max(1);
    if stride > 1 {
        within = within.into_iter().step_by(stride).collect();
    }
    if within.len() < 2 {
        return Ok(Misfit::UNKNOWN);
    }
    let variance = within.iter().map(|w| w.2 * w.2).sum::<f64>() / within.len() as f64;
    let locals: Vec<Point3<f64>> = within.iter().map(|w| w.0).collect();
    let tree = tree_of(&locals)?;
    let (mut sum, mut n_pairs) = (0.0, 0_usize);
    for (i, (p, normal, residual)) in within.iter().enumerate() {
        let row: [f64; 3] = p.coords.into();
        let found = tree
            .query(&row)
            .within::<SquaredEuclidean<f64>>(PATCH_MM * PATCH_MM)
            .execute();
        let mut others: Vec<usize> = found
            .into_iter()
            .map(|item| item.item as usize)
            .filter(|&j| j > i && within[j].1.dot(normal) >= SAME_SIDE)
            .collect();
        others.sort_unstable();
        n_pairs += others.len();
        sum += residual * others.iter().map(|&j| within[j].2).sum::<f64>();
    }
    if n_pairs == 0 {
        return Ok(Misfit::UNKNOWN);
    }
    let n = n_pairs as f64;
    let covariance_mm2 = sum / n;
    Ok(Misfit {
        covariance_mm2,
        deviation_mm2: variance / n.sqrt(),
        pairs_over_variance: if variance > 0.0 {
            n / (within.len() as f64 * variance)
        } else {
            0.0
        },
    })
}
