//! Which of the points near a bone lie on bare bone.
//!
//! ```text
//! r̄ = Pᵏ r,   bare if r̄_i ≤ max(0, q) + a (0.25 mm + 2.5 σ √(c/(n k)))
//! ```
//!
//! r are signed distances from the surface, positive in front of it, P takes the mean over a patch: the
//! 24 nearest points as far as they may belong to this bone, n of them where points were thinned out, c of which err alike. k means of means reach
//! as far as a patch of n k points; the noisier the sensor (σ), the larger k. Soft tissue lies in front of the bone over many
//! points, noise on one: means tell them apart where single points cannot. q is a quantile of r̄: where
//! nearly all points lie in front, the pose is too deep. a falls to 1 over the rounds,
//! as the pose gets better.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::ReferenceSurface;
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::points::PointSet;
use crate::scoring::MIN_POINTS_A_TASK;

/// A single point farther in front of the bone than this many standard deviations is soft tissue.
const FRONT_IN_SIGMA: f64 = 2.2;
/// And this much more, mm.
const FRONT_FLOOR_MM: f64 = 0.2;
/// The same two for the mean of a patch, whose deviation is smaller.
const PATCH_IN_SIGMA: f64 = 2.5;
const PATCH_FLOOR_MM: f64 = 0.25;
/// Noise from which on means are taken twice, mm.
const SMOOTHER_FROM_MM: [f64; 1] = [0.7];
/// Share of the points that lie behind what counts as the bone's own offset: a pose that is too deep
/// must not make bare bone look like tissue.
const OFFSET_SHARE: f64 = 0.4;
/// How much farther patches may lie in front in the first rounds.
const ROUND_FACTORS: [f64; 4] = [4.0, 3.0, 2.0, 1.4];

/// What is known when the points of a bone are chosen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BareBone {
    /// Noise of the sensor, mm.
    pub(crate) noise_mm: Option<f64>,
    pub(crate) is_from_camera: bool,
    /// Points farther away are not this bone's, mm.
    pub(crate) gate_mm: f64,
    /// Number of times the pose has been fitted.
    pub(crate) round: usize,
}

impl BareBone {
    /// Leaves out points that lie too far in front of the bone, or whose normals contradict its own.
    pub(crate) fn retain(
        &self,
        own: &mut Vec<u32>,
        bone: &BoneSurface,
        pose: &Isometry3<f64>,
        points: &PointSet,
    ) {
        if points.normals.is_empty() {
            return;
        }
        let inverse = pose.inverse();
        let signed_mm = |p: u32| -> Option<f64> {
            let local: Point3<f64> = inverse * points.positions[p as usize];
            let hit = bone.closest_within(&local, self.gate_mm)?;
            points
                .agrees_in(p as usize, pose, &hit.normal)
                .then(|| (local - hit.point).dot(&hit.normal))
        };
        let found: Vec<(u32, f64)> = own
            .par_iter()
            .with_min_len(MIN_POINTS_A_TASK)
            .filter_map(|&p| Some((p, signed_mm(p)?)))
            .collect();
        let (Some(noise_mm), true) = (self.noise_mm, self.is_from_camera) else {
            *own = found.into_iter().map(|(p, _)| p).collect();
            return;
        };
        let factor = ROUND_FACTORS.get(self.round).copied().unwrap_or(1.0);
        let in_front_mm = FRONT_FLOOR_MM + FRONT_IN_SIGMA * noise_mm;
        let n_smoother = SMOOTHER_FROM_MM.iter().filter(|&&s| noise_mm > s).count();
        // Of points that were thinned out less of every patch is left.
        let n_left: usize = found
            .iter()
            .filter_map(|(p, _)| Some(points.patches.get(*p as usize)?.len()))
            .sum();
        let n_patch = (n_left as f64 / found.len().max(1) as f64).max(1.0);
        let n_reached = points.alike.n_told(n_patch * (1 + n_smoother) as f64);
        let limit_mm = factor * (PATCH_FLOOR_MM + PATCH_IN_SIGMA * noise_mm / n_reached.sqrt());
        let mut mean = vec![f64::NAN; points.positions.len()];
        for &(p, r) in &found {
            mean[p as usize] = r;
        }
        for _ in 0..=n_smoother {
            mean = smoothed(&found, &mean, points);
        }
        let mut sorted: Vec<f64> = found.iter().map(|f| mean[f.0 as usize]).collect();
        sorted.sort_by(f64::total_cmp);
        let offset_mm = sorted
            .get((OFFSET_SHARE * sorted.len() as f64) as usize)
            .copied()
            .filter(|&offset| offset > 0.0)
            .unwrap_or(0.0);
        let limit_mm = offset_mm + limit_mm;
        let is_bare =
            |&(p, r): &(u32, f64)| r <= offset_mm + in_front_mm && mean[p as usize] <= limit_mm;
        *own = found.iter().filter(|f| is_bare(f)).map(|f| f.0).collect();
    }
}

/// The mean over the patch of every point, as far as its points have a figure.
fn smoothed(found: &[(u32, f64)], figures: &[f64], points: &PointSet) -> Vec<f64> {
    let mut means = vec![f64::NAN; figures.len()];
    for &(p, _) in found {
        let (mut n, mut sum) = (0.0, 0.0);
        for &q in points.patches.get(p as usize).into_iter().flatten() {
            let figure = figures[q as usize];
            if figure.is_finite() {
                (n, sum) = (n + 1.0, sum + figure);
            }
        }
        // The point itself is in its patch.
        means[p as usize] = if n > 0.0 {
            sum / n
        } else {
            figures[p as usize]
        };
    }
    means
}
