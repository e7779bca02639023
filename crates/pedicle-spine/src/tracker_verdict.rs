//! Which vertebrae of a frame are tracked and which are lost.
//!
//! ```text
//! Δ_v = T_v (M T_v')⁻¹,   |Δ_v c - c| and the angle of Δ_v small,   c the centroid
//! ```
//!
//! T_v' is the pose in the last frame, M the motion of the whole spine. Beside the jump Δ the fit, the
//! noise against the other vertebrae and the frames before, the covariance and the neighbours have to
//! allow it. Millimetres and radians.

use nalgebra::Isometry3;
use pedicle_registration::{PoseCovariance, Refinement, pose_error, rotation_angle};

use crate::LostReason;
use crate::tracker::{Fitted, SpineTracker};

/// The noise of a vertebra against the others', and of a frame against those before: by factor and
/// by excess, mm. A vertebra on another one's bone is one and a half to three times as noisy.
const NOISE_RATIO: f64 = 1.5;
const NOISE_EXCESS_MM: f64 = 0.2;
/// A lost vertebra may have moved on: so many frames' jumps are allowed at most.
const MAX_JUMPS: usize = 3;

impl SpineTracker<'_> {
    /// For every vertebra why it is lost; none if it is tracked.
    pub(crate) fn judged(
        &self,
        fitted: &[Fitted],
        poses: &[Isometry3<f64>],
        (expected, is_in_view): (&[Isometry3<f64>], bool),
    ) -> Vec<Option<LostReason>> {
        let noises = fitted.iter().filter_map(|f| f.refinement.as_ref());
        let others_mm = median(noises.map(|fit| fit.noise_mm).collect());
        let mut reasons: Vec<Option<LostReason>> = fitted
            .iter()
            .enumerate()
            .map(|(v, fitted)| {
                if !self.tracks[v].is_followed {
                    return Some(LostReason::NotAccepted);
                }
                if !is_in_view {
                    return Some(LostReason::SpineJumped);
                }
                self.bad_fit(v, fitted, others_mm)
                    .or_else(|| self.jump(v, &poses[v], &expected[v]))
            })
            .collect();
        for (v, u) in (1..poses.len()).map(|u| (u - 1, u)) {
            if reasons[v].is_none() && reasons[u].is_none() && self.is_against(v, u, poses) {
                // The one that moved more is the one to doubt.
                let moved = |v: usize| {
                    pose_error(&poses[v], &expected[v], &self.centroid(v)).translation_mm
                };
                let (doubted, other) = if moved(v) > moved(u) { (v, u) } else { (u, v) };
                reasons[doubted] = Some(LostReason::AgainstNeighbour {
                    neighbour: self.model.vertebrae[other].level,
                });
            }
        }
        reasons
    }

    fn bad_fit(&self, v: usize, fitted: &Fitted, others_mm: f64) -> Option<LostReason> {
        let options = &self.options;
        let n_points = fitted.n_points;
        if n_points < options.min_points {
            let min = options.min_points;
            return Some(LostReason::TooFewPoints { n_points, min });
        }
        let Some(fit) = &fitted.refinement else {
            return Some(LostReason::NoFit { n_points });
        };
        let before_mm = self.noise_mm.unwrap_or(options.max_noise_mm);
        let max_mm = [others_mm, before_mm]
            .map(|noise| NOISE_RATIO * noise + NOISE_EXCESS_MM)
            .into_iter()
            .fold(options.max_noise_mm, |a, b| if b < a { b } else { a });
        let noise_mm = fit.noise_mm;
        // Each test asks for what is wanted, so that a NaN is never accepted.
        let is_quiet = noise_mm <= max_mm;
        if !is_quiet {
            return Some(LostReason::Noisy { noise_mm, max_mm });
        }
        let (explained_share, min) = (fitted.explained_share, options.min_explained_share);
        let is_explained = explained_share >= min;
        if !is_explained {
            return Some(LostReason::PoorFit {
                explained_share,
                min,
            });
        }
        let translation_std_mm = self.covariance(v, fit).translation_mm();
        let rotation_std_rad = fit.covariance.rotation_rad();
        let is_certain = translation_std_mm <= options.max_translation_std_mm
            && rotation_std_rad <= options.max_rotation_std_rad;
        (!is_certain).then_some(LostReason::Uncertain {
            translation_std_mm,
            rotation_std_rad,
        })
    }

    fn jump(
        &self,
        v: usize,
        pose: &Isometry3<f64>,
        expected: &Isometry3<f64>,
    ) -> Option<LostReason> {
        let jump = pose_error(pose, expected, &self.centroid(v));
        // A vertebra out of sight moves on.
        let n_jumps = (1 + self.tracks[v].n_frames_lost).min(MAX_JUMPS) as f64;
        let is_near = jump.translation_mm <= n_jumps * self.options.max_jump_mm
            && jump.rotation_rad <= n_jumps * self.options.max_jump_rad;
        (!is_near).then_some(LostReason::Jumped {
            translation_mm: jump.translation_mm,
            rotation_rad: jump.rotation_rad,
        })
    }

    /// Whether neighbours lie against each other as no spine allows.
    fn is_against(&self, v: usize, u: usize, poses: &[Isometry3<f64>]) -> bool {
        let turn_rad = rotation_angle(&(poses[v].rotation.inverse() * poses[u].rotation));
        let (a, b) = (self.centroid(v), self.centroid(u));
        let shift_mm = ((poses[v] * a - poses[u] * b).norm() - (a - b).norm()).abs();
        turn_rad > self.options.max_neighbour_turn_rad
            || shift_mm > self.options.max_neighbour_shift_mm
    }

    fn covariance(&self, v: usize, fit: &Refinement) -> PoseCovariance {
        fit.covariance
            .about(&(fit.target_from_source * self.centroid(v)))
    }
}

/// The middle value; NaN of none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
