//! The search of a frame: the spine as one body, and vertebrae in rounds.
//!
//! ```text
//! T_v = argmin Σ_{j of v} ρ( n_j · (T⁻¹ p_j - q_j) ),   j of v: |p_j - q_j| least for v, within a gate
//! ```
//!
//! Points of the frame are in the target frame, surfaces in the source frame, mm.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::tracker::SpineTracker;
use crate::tracker_motion::{PosedSpine, fit, neighbours_motion, spine_motion};

/// Points that find the motion of the whole spine: six unknowns for all of them.
const N_SPINE_POINTS: usize = 300;
/// Steps of a fit within a round of the search.
const STEPS: usize = 4;
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
                    let fit = fit(bone, own, &poses[v], (gate_mm, STEPS))?;
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
}
