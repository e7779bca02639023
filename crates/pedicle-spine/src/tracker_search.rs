//! The search of a frame: the spine as one body, and vertebrae in rounds.
//!
//! ```text
//! T_v = argmin Σ_{j of v} ρ( n_j · (T⁻¹ p_j - q_j) ),   j of v: |p_j - q_j| least for v, within a gate
//! ```
//!
//! Points of the frame are in the target frame, surfaces in the source frame, mm.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use crate::LostReason;
use crate::tracker::SpineTracker;
use crate::tracker_fit::Fitted;
use crate::tracker_motion::{PosedSpine, fit, neighbours_motion, spine_motion};

/// Points that find the motion of the whole spine: six unknowns for all of them.
const N_SPINE_POINTS: usize = 500;
/// Steps of a fit within a round of the search.
const STEPS: usize = 4;

impl<'a> SpineTracker<'a> {
    /// The motion of the spine since the last frame; none if it is not in view or jumped too far.
    pub(crate) fn moved(&self, search: &[Point3<f64>]) -> Option<Isometry3<f64>> {
        let poses: Vec<Isometry3<f64>> = self.tracks.iter().map(|track| track.anchor).collect();
        // The points are a random sample already: every n-th is one as well.
        let stride = search.len().div_ceil(N_SPINE_POINTS).max(1);
        let some: Vec<Point3<f64>> = search.iter().copied().step_by(stride).collect();
        let motion = spine_motion(&self.posed(&poses), &some)?;
        let of_followed = (0..poses.len()).filter(|&v| self.tracks[v].is_followed);
        let largest = of_followed
            .map(|v| {
                let center = poses[v] * self.centroid(v);
                (motion * center - center).norm()
            })
            .fold(0.0, |most, d| if d > most { d } else { most });
        (largest <= self.options.max_spine_jump_mm).then_some(motion)
    }

    /// The points among which the spine may be, as far as it may have moved.
    pub(crate) fn about(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let reach_mm = self.options.max_spine_jump_mm;
        let inverses: Vec<Isometry3<f64>> =
            self.tracks.iter().map(|t| t.anchor.inverse()).collect();
        let is_about = |p: &&Point3<f64>| {
            let mut bones = self.model.vertebrae.iter().zip(&inverses);
            bones.any(|(vertebra, inverse)| vertebra.bone.is_about(&(inverse * *p), reach_mm))
        };
        points.par_iter().filter(is_about).copied().collect()
    }

    pub(crate) fn centroid(&self, v: usize) -> Point3<f64> {
        self.model.vertebrae[v].bone.centroid()
    }

    /// All vertebrae, on the simplified surfaces: those that nobody follows hold their points against those that
    /// are looked for.
    fn posed(&self, poses: &[Isometry3<f64>]) -> PosedSpine<'a> {
        let bones = self.model.vertebrae.iter().map(|v| &v.coarse);
        PosedSpine::new(bones.collect(), poses.to_vec())
    }

    /// Rounds of giving points to vertebrae and fitting those that are chosen.
    pub(crate) fn search_rounds(
        &self,
        poses: &mut [Isometry3<f64>],
        search: &[Point3<f64>],
        (widening, is_chosen): (f64, &[bool]),
    ) {
        for gate_mm in self.options.gates_mm.iter().map(|gate| gate * widening) {
            let lists = self.posed(poses).assign(search, gate_mm);
            let found: Vec<(usize, Isometry3<f64>)> = lists
                .par_iter()
                .enumerate()
                .filter(|(v, _)| is_chosen[*v])
                .filter_map(|(v, own)| {
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

    /// Where every vertebra was vouched for last, carried by its neighbours that are tracked in both frames,
    /// without any by the whole spine. Poses that nobody vouches for have no say: they would walk it away.
    pub(crate) fn carry_anchors(
        &mut self,
        fits: &[Fitted],
        reasons: &[Option<LostReason>],
        moved: Option<&Isometry3<f64>>,
    ) {
        let motions: Vec<Option<Isometry3<f64>>> = self
            .tracks
            .iter()
            .zip(fits)
            .zip(reasons)
            .map(|((track, fit), reason)| {
                let is_tracked = reason.is_none() && track.n_frames_lost == 0;
                is_tracked.then(|| fit.target_from_source * track.anchor.inverse())
            })
            .collect();
        for v in 0..self.tracks.len() {
            let anchor = self.tracks[v].anchor;
            self.tracks[v].anchor = if reasons[v].is_none() {
                fits[v].target_from_source
            } else {
                let center = anchor * self.centroid(v);
                let motion = neighbours_motion(&motions, v, &center).or(moved.copied());
                motion.unwrap_or_default() * anchor
            };
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
