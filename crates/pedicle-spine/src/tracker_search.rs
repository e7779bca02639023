//! The fits of a frame: of the spine as one body, of vertebrae in rounds, and the last one.
//!
//! ```text
//! T_v = argmin Σ_{j of v} ρ( n_j · (T⁻¹ p_j - q_j) ),   j of v: |p_j - q_j| least for v, within a gate
//! ```
//!
//! Points of the frame are in the target frame, surfaces in the source frame, mm.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::ReferenceSurface;
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::tracker::{Fitted, SpineTracker};
use crate::tracker_motion::{PosedSpine, fit, neighbours_motion, spine_motion};

/// Points that find the motion of the whole spine: six unknowns for all of them.
const N_SPINE_POINTS: usize = 500;
/// Steps of a fit within a round of the search, and of the last fit.
const STEPS: (usize, usize) = (4, 6);
/// The last gate in standard deviations of the noise, and its bounds, mm.
const FINE_GATE_IN_SIGMA: f64 = 5.0;
const FINE_GATE_MM: (f64, f64) = (4.0, 8.0);
/// Points so near belong to a vertebra; they lie on it within so many standard deviations of the
/// noise and this much more, mm.
const NEAR_MM: f64 = 8.0;
const EXPLAINED: (f64, f64) = (3.0, 0.5);

impl<'a> SpineTracker<'a> {
    /// The motion of the spine since the last frame; none if it is not in view or jumped too far.
    pub(crate) fn moved(&self, search: &[Point3<f64>]) -> Option<Isometry3<f64>> {
        let followed = self.followed();
        let poses: Vec<Isometry3<f64>> = self.tracks.iter().map(|track| track.pose).collect();
        // The points are a random sample already: every n-th is one as well.
        let stride = search.len().div_ceil(N_SPINE_POINTS).max(1);
        let some: Vec<Point3<f64>> = search.iter().copied().step_by(stride).collect();
        let motion = spine_motion(&self.posed(&poses, true), &some)?;
        let largest = followed
            .iter()
            .map(|&v| {
                let center = self.tracks[v].pose * self.centroid(v);
                (motion * center - center).norm()
            })
            .fold(0.0, |most, d| if d > most { d } else { most });
        (largest <= self.options.max_spine_jump_mm).then_some(motion)
    }

    /// Indices of the vertebrae that are followed, lost or not.
    fn followed(&self) -> Vec<usize> {
        (0..self.tracks.len())
            .filter(|&v| self.tracks[v].is_followed)
            .collect()
    }

    pub(crate) fn centroid(&self, v: usize) -> Point3<f64> {
        self.model.vertebrae[v].bone.centroid()
    }

    /// The followed vertebrae in their poses, on the simplified or the full surfaces.
    fn posed(&self, poses: &[Isometry3<f64>], is_coarse: bool) -> PosedSpine<'a> {
        let followed = self.followed();
        let bone = |v: usize| -> &'a BoneSurface {
            let vertebra = &self.model.vertebrae[v];
            if is_coarse {
                &vertebra.coarse
            } else {
                &vertebra.bone
            }
        };
        PosedSpine::new(
            followed.iter().map(|&v| bone(v)).collect(),
            followed.iter().map(|&v| poses[v]).collect(),
        )
    }

    /// Rounds of giving points to vertebrae and fitting those that are chosen.
    pub(crate) fn search_rounds(
        &self,
        poses: &mut [Isometry3<f64>],
        search: &[Point3<f64>],
        (widening, is_chosen): (f64, &[bool]),
    ) {
        for gate_mm in self.options.gates_mm.iter().map(|gate| gate * widening) {
            let lists = self.posed(poses, true).assign(search, gate_mm);
            let found: Vec<(usize, Isometry3<f64>)> = lists
                .par_iter()
                .zip(self.followed())
                .filter(|(_, v)| is_chosen[*v])
                .filter_map(|(own, v)| {
                    let bone = &self.model.vertebrae[v].coarse;
                    let fit = fit(bone, own, &poses[v], (gate_mm, STEPS.0))?;
                    Some((v, fit.target_from_source))
                })
                .collect();
            for (v, pose) in found {
                poses[v] = pose;
            }
        }
    }

    /// Carries the vertebrae that are not known from their last poses, as those that are known went.
    pub(crate) fn carry_unknown(&self, poses: &mut [Isometry3<f64>], is_known: &[bool]) {
        let motions: Vec<Option<Isometry3<f64>>> = (0..poses.len())
            .map(|v| is_known[v].then(|| poses[v] * self.tracks[v].pose.inverse()))
            .collect();
        for (v, pose) in poses.iter_mut().enumerate().filter(|(v, _)| !is_known[*v]) {
            let center = self.tracks[v].pose * self.centroid(v);
            if let Some(motion) = neighbours_motion(&motions, v, &center) {
                *pose = motion * self.tracks[v].pose;
            }
        }
    }

    /// The fit on the full-resolution surfaces; poses of vertebrae with one are replaced.
    pub(crate) fn last_fit(
        &self,
        poses: &mut [Isometry3<f64>],
        fine: &[Point3<f64>],
    ) -> Vec<Fitted> {
        let lists = self.posed(poses, false).assign(fine, NEAR_MM);
        let gate_mm = self.noise_mm.map_or(FINE_GATE_MM.0, |noise| {
            (FINE_GATE_IN_SIGMA * noise).clamp(FINE_GATE_MM.0, FINE_GATE_MM.1)
        });
        let mut fitted: Vec<Fitted> = (0..poses.len())
            .map(|_| Fitted {
                refinement: None,
                n_points: 0,
                explained_share: 0.0,
            })
            .collect();
        let found: Vec<(usize, Fitted)> = lists
            .par_iter()
            .zip(self.followed())
            .map(|(own, v)| (v, self.fitted(v, own, &poses[v], gate_mm)))
            .collect();
        for (v, found) in found {
            if let Some(refinement) = &found.refinement {
                poses[v] = refinement.target_from_source;
            }
            fitted[v] = found;
        }
        fitted
    }

    /// The fit of one vertebra to its points, and how many of them lie on it.
    fn fitted(
        &self,
        v: usize,
        own: &[(Point3<f64>, f64)],
        start: &Isometry3<f64>,
        gate_mm: f64,
    ) -> Fitted {
        let bone = &self.model.vertebrae[v].bone;
        let Some(refinement) = fit(bone, own, start, (gate_mm, STEPS.1)) else {
            return Fitted {
                refinement: None,
                n_points: own.len(),
                explained_share: 0.0,
            };
        };
        let limit_mm = EXPLAINED.0 * refinement.noise_mm + EXPLAINED.1;
        let back = refinement.target_from_source.inverse();
        let lies_on_it = |p: &Point3<f64>| bone.closest(&(back * p)).distance_mm <= limit_mm;
        let n_explained = own.iter().filter(|(p, _)| lies_on_it(p)).count();
        Fitted {
            n_points: refinement.n_inliers,
            explained_share: n_explained as f64 / own.len().max(1) as f64,
            refinement: Some(refinement),
        }
    }
}
