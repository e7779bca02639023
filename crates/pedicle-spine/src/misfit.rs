//! Misfit that is not noise.
//!
//! ```text
//! m² = Σ r_i r_j / N   over the N pairs with |p_i - p_j| ≤ 6 mm and n_i · n_j ≥ 0.7
//! ```
//!
//! r are the signed distances of the target points from the surface in its pose. Where noise
//! is independent from point to point m² is small under the right bone; where a camera's pixels err alike ([`crate::errs_alike`]) it is what
//! their correlation makes it. Another shape (another
//! patient, another level, soft tissue) leaves dents and bumps of some millimetres' extent:
//! neighbouring residuals agree in sign, and m is the depth of the bumps. This is Moran's I
//! (Moran 1950) without the division by the variance, in mm.
//!
//! Noise alone leaves bumps too, through the curvature of the bone: a point displaced along the surface
//! by σ lies σ² κ / 2 outside a bone of curvature κ.

use kiddo::SquaredEuclidean;
use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::ReferenceSurface;

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::errs_alike::{ErrsAlike, correlation};
use crate::local_shape::tree_of;
use crate::seen_bone::Sight;

/// Points are compared with those this near, mm.
pub(crate) const PATCH_MM: f64 = 6.0;
/// And with normals whose cosine is at least this.
const SAME_SIDE: f64 = 0.7;
/// Points of a vertebra that are looked at; more are thinned out.
const MAX_POINTS: usize = 1200;
/// Noise leaves bumps of this many times σ², 1/mm. Measured on phantoms under the true pose: 0.20 to
/// 0.25 at every noise from 0.9 to 3 mm, on whole bones and on what a camera sees.
const CURVATURE_PER_MM: f64 = 0.24;

/// How far the shape differs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Misfit {
    /// m², mm²; may be negative by chance.
    pub(crate) covariance_mm2: f64,
    /// m² of noise alone on this bone, mm².
    pub(crate) by_noise_mm2: f64,
    /// Standard deviation of m² if there were only noise, mm².
    pub(crate) deviation_mm2: f64,
    /// Pairs a point over the variance of the residuals, 1/mm²: what m² does to the variance of sums.
    pub(crate) pairs_over_variance: f64,
    pub(crate) n_pairs: usize,
}

impl Misfit {
    /// No pair was found.
    pub(crate) const UNKNOWN: Self = Self {
        covariance_mm2: f64::NAN,
        by_noise_mm2: f64::NAN,
        deviation_mm2: f64::NAN,
        pairs_over_variance: 0.0,
        n_pairs: 0,
    };

    /// A right fit of noisy points, for tests of what is said of it.
    #[cfg(test)]
    pub(crate) const NOISE_ONLY: Self = Self {
        covariance_mm2: 0.002,
        by_noise_mm2: 0.001,
        deviation_mm2: 0.005,
        pairs_over_variance: 1.0,
        n_pairs: 500,
    };

    /// What is left of m² once noise is taken off, mm²: what it does through the curvature of the
    /// bone, and what it may do by chance.
    pub(crate) fn beyond_noise_mm2(&self, in_sigma: f64) -> f64 {
        self.covariance_mm2 - self.by_noise_mm2 - in_sigma * self.deviation_mm2
    }

    /// Several bones together: what is too small to tell on one may show on all.
    pub(crate) fn pooled(all: &[Self]) -> Self {
        let n_pairs: usize = all.iter().map(|m| m.n_pairs).sum();
        if n_pairs == 0 {
            return Self::UNKNOWN;
        }
        let mean = |f: &dyn Fn(&Self) -> f64| {
            let weighted = |m: &Self| m.n_pairs as f64 * f(m);
            all.iter().map(weighted).sum::<f64>() / n_pairs as f64
        };
        let squares = all
            .iter()
            .map(|m| (m.n_pairs as f64 * m.deviation_mm2).powi(2));
        Self {
            covariance_mm2: mean(&|m| m.covariance_mm2),
            by_noise_mm2: mean(&|m| m.by_noise_mm2),
            deviation_mm2: squares.sum::<f64>().sqrt() / n_pairs as f64,
            pairs_over_variance: mean(&|m| m.pairs_over_variance),
            n_pairs,
        }
    }

    /// Factor by which a correlation beyond some m² enlarges the variance of sums over the points:
    /// Var(Σ r) = n σ² + 2 Σ over pairs of m². One deviation of chance is taken off.
    pub(crate) fn inflation(&self, explained_mm2: f64) -> f64 {
        let left = self.covariance_mm2 - explained_mm2 - self.deviation_mm2;
        let grown = 2.0 * self.pairs_over_variance * left;
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

/// A point of the target on the bone, in the source frame.
struct OnBone {
    point: Point3<f64>,
    normal: Vector3<f64>,
    residual: f64,
}

/// Compares neighbouring residuals of the points of one vertebra that lie within `gate_mm`, for a noise
/// of `noise_mm`.
pub(crate) fn misfit(
    bone: &BoneSurface,
    pose: &Isometry3<f64>,
    points: &[Point3<f64>],
    gate_mm: f64,
    noise_mm: f64,
) -> Result<Misfit, SpineError> {
    let inverse = pose.inverse();
    let within: Vec<OnBone> = points
        .iter()
        .filter_map(|p| {
            let point = inverse * p;
            let hit = bone.closest(&point);
            (hit.distance_mm <= gate_mm).then(|| OnBone {
                point,
                normal: hit.normal,
                residual: (point - hit.point).dot(&hit.normal),
            })
        })
        .collect();
    let by_curvature = CURVATURE_PER_MM * noise_mm * noise_mm;
    compared(within, NoiseOfPairs::Same(by_curvature * by_curvature))
}

/// The same of what a camera saw, by distances along its rays: noise leaves no bumps through the curvature there, but those of
/// pixels that err alike.
pub(crate) fn misfit_along_rays(
    sight: &Sight<'_>,
    points: &[Point3<f64>],
    gate_mm: f64,
    (noise_mm, alike): (f64, ErrsAlike),
) -> Result<Misfit, SpineError> {
    let within = points
        .iter()
        .filter_map(|p| {
            let hit = sight.hit(p, gate_mm)?;
            Some(OnBone {
                point: hit.point,
                normal: hit.normal,
                residual: hit.residual_mm,
            })
        })
        .collect();
    if !alike.is_told() {
        return compared(within, NoiseOfPairs::Same(0.0));
    }
    let of_pair =
        |a: &OnBone, b: &OnBone| correlation(sight.apart_mm(&a.point, &b.point), alike.length_mm);
    let noise = NoiseOfPairs::Alike {
        of_pair: &of_pair,
        noise_mm,
    };
    compared(within, noise)
}

/// What noise alone makes of the products of pairs.
enum NoiseOfPairs<'a> {
    /// The same m² of all, mm².
    Same(f64),
    /// Correlations: errors that are alike.
    Alike {
        of_pair: &'a dyn Fn(&OnBone, &OnBone) -> f64,
        noise_mm: f64,
    },
}

impl NoiseOfPairs<'_> {
    /// m² of noise alone, and by how much its standard deviation is larger than that of independent errors.
    fn of(&self, within: &[OnBone], pairs: &[Vec<usize>], variance: f64) -> (f64, f64) {
        match self {
            Self::Same(square_mm2) => (*square_mm2, 1.0),
            Self::Alike { of_pair, noise_mm } => {
                let all = within.iter().zip(pairs);
                let sum: f64 = all
                    .flat_map(|(a, others)| others.iter().map(move |&j| of_pair(a, &within[j])))
                    .sum();
                let n_pairs: usize = pairs.iter().map(Vec::len).sum();
                // Noise cannot explain more than there is.
                let told = noise_mm * noise_mm;
                let variance = if told < variance { told } else { variance };
                let by_noise_mm2 = variance * sum / n_pairs as f64;
                (by_noise_mm2, 1.0 + 2.0 * sum / within.len() as f64)
            }
        }
    }
}

fn compared(mut within: Vec<OnBone>, noise: NoiseOfPairs<'_>) -> Result<Misfit, SpineError> {
    let stride = within.len().div_ceil(MAX_POINTS).max(1);
    if stride > 1 {
        within = within.into_iter().step_by(stride).collect();
    }
    if within.len() < 2 {
        return Ok(Misfit::UNKNOWN);
    }
    let pairs = pairs_of(&within)?;
    let n_pairs: usize = pairs.iter().map(Vec::len).sum();
    if n_pairs == 0 {
        return Ok(Misfit::UNKNOWN);
    }
    let residuals: Vec<f64> = within.iter().map(|w| w.residual).collect();
    let covariance_mm2 = covariance(&residuals, &pairs);
    let variance = mean_square(&residuals);
    let (by_noise_mm2, wider) = noise.of(&within, &pairs, variance);
    Ok(Misfit {
        covariance_mm2,
        by_noise_mm2,
        deviation_mm2: wider * variance / (n_pairs as f64).sqrt(),
        // Of the points that were thinned out every one has as many pairs again.
        pairs_over_variance: if variance > 0.0 {
            (stride * n_pairs) as f64 / (within.len() as f64 * variance)
        } else {
            0.0
        },
        n_pairs,
    })
}

/// For every point the later ones that it is compared with.
fn pairs_of(within: &[OnBone]) -> Result<Vec<Vec<usize>>, SpineError> {
    let locals: Vec<Point3<f64>> = within.iter().map(|w| w.point).collect();
    let tree = tree_of(&locals)?;
    let pairs = within
        .iter()
        .enumerate()
        .map(|(i, w)| {
            let row: [f64; 3] = w.point.coords.into();
            let found = tree
                .query(&row)
                .within::<SquaredEuclidean<f64>>(PATCH_MM * PATCH_MM)
                .execute();
            let mut others: Vec<usize> = found
                .into_iter()
                .map(|item| item.item as usize)
                .filter(|&j| j > i && within[j].normal.dot(&w.normal) >= SAME_SIDE)
                .collect();
            others.sort_unstable();
            others
        })
        .collect();
    Ok(pairs)
}

/// Mean product over the pairs.
fn covariance(residuals: &[f64], pairs: &[Vec<usize>]) -> f64 {
    let n: usize = pairs.iter().map(Vec::len).sum();
    let products = pairs
        .iter()
        .zip(residuals)
        .map(|(others, r)| r * others.iter().map(|&j| residuals[j]).sum::<f64>());
    products.sum::<f64>() / n as f64
}

fn mean_square(residuals: &[f64]) -> f64 {
    residuals.iter().map(|r| r * r).sum::<f64>() / residuals.len() as f64
}
