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
use crate::tracker::{SpineTracker, Track};
use crate::tracker_fit::Fitted;
use crate::tracker_motion::{PosedSpine, SPINE_GATES_MM, fit, neighbours_motion, spine_motion};

/// Points that find the motion of the whole spine: six unknowns for all of them.
const N_SPINE_POINTS: usize = 500;
/// Steps of a fit within a round of the search.
const STEPS: usize = 4;

impl<'a> SpineTracker<'a> {
    /// The motion of the spine since its anchors; none if it is not in view or went too far. Vertebrae that are not
    /// followed may be anywhere: they keep the points nearest to them and have no say.
    pub(crate) fn moved(&self, search: &[Point3<f64>]) -> Option<Isometry3<f64>> {
        let anchors: Vec<Isometry3<f64>> = self.tracks.iter().map(|track| track.anchor).collect();
        let all = self.posed(&anchors);
        let is_of_followed = |p: &Point3<f64>| {
            let nearest = all.nearest(p, SPINE_GATES_MM.0);
            nearest.is_none_or(|(v, _)| self.tracks[v].is_followed)
        };
        // The points are a random sample already: every n-th is one as well.
        let stride = search.len().div_ceil(N_SPINE_POINTS).max(1);
        let some = search.iter().copied().step_by(stride);
        let some: Vec<Point3<f64>> = some.filter(is_of_followed).collect();
        let followed: Vec<usize> = (0..anchors.len())
            .filter(|&v| self.tracks[v].is_followed)
            .collect();
        let spine = PosedSpine::new(
            followed.iter().map(|&v| all.bones[v]).collect(),
            followed.iter().map(|&v| anchors[v]).collect(),
        );
        let motion = spine_motion(&spine, &some)?;
        let largest = followed
            .iter()
            .map(|&v| {
                let center = anchors[v] * self.centroid(v);
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

    /// The anchors as the motions of near neighbours carry them, one a vertebra and none where it is not known;
    /// without such neighbours as `otherwise` does.
    pub(crate) fn carried(
        &self,
        motions: &[Option<Isometry3<f64>>],
        otherwise: &Isometry3<f64>,
    ) -> Vec<Isometry3<f64>> {
        let carry = |(v, track): (usize, &Track)| {
            let center = track.anchor * self.centroid(v);
            let motion = neighbours_motion(motions, v, &center).unwrap_or(*otherwise);
            motion * track.anchor
        };
        self.tracks.iter().enumerate().map(carry).collect()
    }

    /// The motions since the last frame of what was tracked there and still is.
    pub(crate) fn motions(
        &self,
        fits: &[Fitted],
        reasons: &[Option<LostReason>],
    ) -> Vec<Option<Isometry3<f64>>> {
        let tracked = self.tracks.iter().zip(fits).zip(reasons);
        tracked
            .map(|((track, fit), reason)| {
                let is_tracked = track.is_tracked() && reason.is_none();
                is_tracked.then(|| fit.target_from_source * track.anchor.inverse())
            })
            .collect()
    }

    /// Where every vertebra was vouched for last, carried along by what is tracked in both frames. While nothing
    /// is, it stays: a motion that nobody vouches for would walk it away.
    pub(crate) fn next_anchors(
        &self,
        fits: &[Fitted],
        reasons: &[Option<LostReason>],
        moved: Option<&Isometry3<f64>>,
    ) -> Vec<Isometry3<f64>> {
        let motions = self.motions(fits, reasons);
        let is_any_tracked = motions.iter().any(Option::is_some);
        let otherwise = moved.filter(|_| is_any_tracked).copied();
        let mut anchors = self.carried(&motions, &otherwise.unwrap_or_default());
        for ((anchor, fit), reason) in anchors.iter_mut().zip(fits).zip(reasons) {
            if reason.is_none() {
                *anchor = fit.target_from_source;
            }
        }
        anchors
    }
}
