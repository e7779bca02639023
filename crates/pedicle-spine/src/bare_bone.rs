//! Which of the points near a bone lie on bare bone.
//!
//! ```text
//! r̄_i = mean of r over the points of the patch of i,   bare if r̄_i ≤ a_k (0.25 mm + 2.5 σ/√n_i)
//! ```
//!
//! r are signed distances from the surface, positive in front of it, a patch the 24 nearest points
//! as far as they may belong to this bone, n_i their number, σ the noise of the sensor. Soft
//! tissue lies in front of the bone over many points, noise on one: the mean tells them apart where
//! single points cannot. a_k falls to 1 over the rounds, as the pose gets better.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::ReferenceSurface;

use crate::bone::BoneSurface;
use crate::points::PointSet;

/// A single point farther in front of the bone than this many standard deviations is soft tissue.
const FRONT_IN_SIGMA: f64 = 2.2;
/// And this much more, mm.
const FRONT_FLOOR_MM: f64 = 0.2;
/// The same two for the mean of a patch, whose deviation is smaller.
const PATCH_IN_SIGMA: f64 = 2.5;
const PATCH_FLOOR_MM: f64 = 0.25;
/// How much farther patches may lie in front in the first rounds.
const ROUND_FACTORS: [f64; 4] = [4.0, 3.0, 2.0, 1.4];

/// What is known when the points of a bone are chosen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BareBone {
    /// Noise of the sensor, mm.
    pub(crate) noise_mm: Option<f64>,
    pub(crate) is_from_camera: bool,
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
            let hit = bone.closest(&local);
            points
                .agrees_in(p as usize, pose, &hit.normal)
                .then(|| (local - hit.point).dot(&hit.normal))
        };
        let found: Vec<(u32, f64)> = own
            .iter()
            .filter_map(|&p| Some((p, signed_mm(p)?)))
            .collect();
        let (Some(noise_mm), true) = (self.noise_mm, self.is_from_camera) else {
            *own = found.into_iter().map(|(p, _)| p).collect();
            return;
        };
        let mut residual = vec![f64::NAN; points.positions.len()];
        for &(p, r) in &found {
            residual[p as usize] = r;
        }
        let factor = ROUND_FACTORS.get(self.round).copied().unwrap_or(1.0);
        let in_front_mm = FRONT_FLOOR_MM + FRONT_IN_SIGMA * noise_mm;
        let is_bare = |&(p, r): &(u32, f64)| {
            let (mut n, mut sum) = (0.0, 0.0);
            for &q in points.patches.get(p as usize).into_iter().flatten() {
                let r = residual[q as usize];
                if r.is_finite() {
                    (n, sum) = (n + 1.0, sum + r);
                }
            }
            let limit_mm = factor * (PATCH_FLOOR_MM + PATCH_IN_SIGMA * noise_mm / f64::sqrt(n));
            r <= in_front_mm && (n <= 0.0 || sum / n <= limit_mm)
        };
        *own = found.iter().filter(|f| is_bare(f)).map(|f| f.0).collect();
    }
}
