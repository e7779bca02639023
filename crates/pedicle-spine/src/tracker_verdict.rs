//! Which vertebrae of a frame are tracked and which are lost.
//!
//! ```text
//! Δ_v = T_v (M T_v')⁻¹,   |Δ_v c - c| and the angle of Δ_v small,   c the centroid
//! ```
//!
//! T_v' is the pose that was vouched for last, carried to the last frame, M the motion of the whole spine. Beside the jump Δ the fit, the
//! noise against the other vertebrae and the frames before, the covariance and the neighbours have to
//! allow it. Millimetres and radians.

use nalgebra::Isometry3;
use pedicle_registration::pose_error;

use crate::evidence::{Deviations, Evidence};
use crate::tracker::SpineTracker;
use crate::tracker_fit::{Fitted, Seen};
use crate::uncertainty::worst_of_pose;
use crate::verdict::rejections;
use crate::verdict_together::chain_rejections;
use crate::{LostReason, Rejection};

/// The noise of a vertebra against that of the frames before: by factor and by excess, mm. A vertebra
/// on another one's bone is one and a half to three times as noisy.
const NOISE_RATIO: f64 = 1.5;
const NOISE_EXCESS_MM: f64 = 0.2;
/// A lost vertebra may have moved on: so many frames' jumps are allowed at most.
const MAX_JUMPS: usize = 3;

impl SpineTracker<'_> {
    /// For every vertebra why it is lost; none if it is tracked.
    pub(crate) fn judged(
        &self,
        (seen, fits): (&Seen, &[Fitted]),
        (expected, is_in_view): (&[Isometry3<f64>], bool),
    ) -> Vec<Option<LostReason>> {
        let noise_mm = median(fits.iter().map(Fitted::noise_mm).collect());
        let (n_explained, n_near) = fits.iter().fold((0, 0), |(explained, near), fit| {
            (explained + fit.n_explained, near + fit.n_near)
        });
        let whole = Whole {
            noise_mm,
            sensor_noise_mm: seen.noise_mm,
            unexplained_share: 1.0 - share(n_explained, n_near),
        };
        let mut reasons: Vec<Option<LostReason>> = fits
            .iter()
            .enumerate()
            .map(|(v, own)| {
                if !self.tracks[v].is_followed {
                    return Some(LostReason::NotAccepted);
                }
                if !is_in_view {
                    return Some(LostReason::SpineJumped);
                }
                self.doubt(own, &whole)
                    .map(|reason| LostReason::Doubted { reason })
                    .or_else(|| {
                        // A vertebra out of sight moves on.
                        let n_jumps = (1 + self.tracks[v].n_frames_lost).min(MAX_JUMPS);
                        self.jump(v, &own.target_from_source, (&expected[v], n_jumps))
                    })
            })
            .collect();
        let pose = |v: usize| &fits[v].target_from_source;
        for (v, u) in (1..reasons.len()).map(|u| (u - 1, u)) {
            if reasons[v].is_some() || reasons[u].is_some() {
                continue;
            }
            let centroids = (self.centroid(v), self.centroid(u));
            let own = (pose(v), &centroids.0);
            let other = (pose(u), &centroids.1);
            let level = self.model.vertebrae[u].level;
            if chain_rejections(own, other, level, &self.options.verdict).is_empty() {
                continue;
            }
            // The one that moved more is the one to doubt.
            let moved =
                |v: usize| pose_error(pose(v), &expected[v], &self.centroid(v)).translation_mm;
            let (doubted, other) = if moved(v) > moved(u) { (v, u) } else { (u, v) };
            reasons[doubted] = Some(LostReason::AgainstNeighbour {
                neighbour: self.model.vertebrae[other].level,
            });
        }
        reasons
    }

    /// The first test of a transfer that a fit fails.
    fn doubt(&self, own: &Fitted, whole: &Whole) -> Option<Rejection> {
        let noise_mm = own.noise_mm();
        let evidence = Evidence {
            n_points: own.n_points,
            // What is seen has to fix the pose: the deviations tell.
            posterior_coverage: 1.0,
            explained_share: share(own.n_explained, own.n_near),
            noise_mm,
            others_noise_mm: whole.noise_mm,
            target_noise_mm: noise_mm,
            // Bones that are lost fit to anything: only those that were vouched for count.
            quiet_noise_mm: self.quiet_noise_mm,
            is_from_camera: self.view.is_some(),
            tells_tissue: false,
            deviations: own.covariance.as_ref().map(|covariance| {
                let (orientation_rad, position_mm) = worst_of_pose(covariance);
                Deviations {
                    position_mm,
                    orientation_rad,
                    screw_mm: 0.0,
                    breach_probability: 0.0,
                }
            }),
            unexplained_share: whole.unexplained_share,
            // Which level and which of all poses it is, the first result has settled.
            level_margin: f64::INFINITY,
            landmarks_support_levels: true,
            alternative_margin: f64::INFINITY,
            landmark_distance_mm: None,
            misfit: own.misfit,
            seen_through: own.seen_through,
            hidden_share: share(own.n_hiding, own.n_hiding + own.n_explained),
            sensor_noise_mm: whole.sensor_noise_mm,
            // How much bare bone is enough, the first result has settled as well.
            bare_area_mm2: Some(f64::INFINITY),
        };
        let found = rejections(&evidence, &self.options.verdict)
            .into_iter()
            .next();
        let before_mm = self.noise_mm.unwrap_or(f64::INFINITY);
        let max_mm = NOISE_RATIO * before_mm + NOISE_EXCESS_MM;
        let is_quiet = noise_mm <= max_mm;
        found.or_else(|| (!is_quiet).then_some(Rejection::Noisy { noise_mm, max_mm }))
    }

    /// Which fits, vouched for or not, are good enough to look for the vertebra beside them.
    pub(crate) fn guesses(&self, fits: &[Fitted], expected: &[Isometry3<f64>]) -> Vec<bool> {
        let is_guess = |(v, fit): (usize, &Fitted)| {
            fit.refinement.is_some()
                && fit.seen_through <= self.options.verdict.max_seen_through
                && share(fit.n_explained, fit.n_near) >= self.options.verdict.min_explained_share
                && self
                    .jump(v, &fit.target_from_source, (&expected[v], 1))
                    .is_none()
        };
        fits.iter().enumerate().map(is_guess).collect()
    }

    /// Farther from the expected pose than the jumps of so many frames.
    fn jump(
        &self,
        v: usize,
        pose: &Isometry3<f64>,
        (expected, n_jumps): (&Isometry3<f64>, usize),
    ) -> Option<LostReason> {
        let jump = pose_error(pose, expected, &self.centroid(v));
        let n_jumps = n_jumps as f64;
        let is_near = jump.translation_mm <= n_jumps * self.options.max_jump_mm
            && jump.rotation_rad <= n_jumps * self.options.max_jump_rad;
        (!is_near).then_some(LostReason::Jumped {
            translation_mm: jump.translation_mm,
            rotation_rad: jump.rotation_rad,
        })
    }
}

/// What all vertebrae of a frame say together.
struct Whole {
    /// Median noise.
    noise_mm: f64,
    sensor_noise_mm: Option<f64>,
    /// Of the points on or behind bone.
    unexplained_share: f64,
}

fn share(n: usize, of: usize) -> f64 {
    if of == 0 { 0.0 } else { n as f64 / of as f64 }
}

/// The middle value; NaN of none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|x| !x.is_nan());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
