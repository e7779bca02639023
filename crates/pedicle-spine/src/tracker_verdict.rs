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
use crate::margin::Spread;
use crate::tracker::SpineTracker;
use crate::tracker_fit::{Fitted, Seen};
use crate::verdict::rejections;
use crate::verdict_noise::median;
use crate::verdict_together::chain_rejections;
use crate::{LostReason, Rejection};

/// The noise of a vertebra against that of the frames before: by factor and by excess, mm. A vertebra
/// on another one's bone is one and a half to three times as noisy.
const NOISE_RATIO: f64 = 1.5;
const NOISE_EXCESS_MM: f64 = 0.2;
/// A lost vertebra may have moved on: so many frames' jumps are allowed at most, less than half of what two
/// vertebrae are apart.
const MAX_JUMPS: usize = 2;

impl SpineTracker<'_> {
    /// For every vertebra why it is lost, none if it is tracked; and whether its fit may be looked at again.
    pub(crate) fn judged(
        &self,
        (seen, fits): (&Seen, &[Fitted]),
        moved: Option<&Isometry3<f64>>,
    ) -> Judged {
        let noise_mm = median(fits.iter().map(Fitted::noise_mm).collect());
        let (n_explained, n_near) = fits.iter().fold((0, 0), |(explained, near), fit| {
            (explained + fit.n_explained, near + fit.n_near)
        });
        let whole = Whole {
            noise_mm,
            sensor_noise_mm: seen.noise_mm,
            unexplained_share: 1.0 - share(n_explained, n_near),
        };
        let motion = moved.copied().unwrap_or_default();
        let of_spine: Vec<Isometry3<f64>> = self.tracks.iter().map(|t| motion * t.anchor).collect();
        let mut reasons: Vec<Option<LostReason>> = fits
            .iter()
            .enumerate()
            .map(|(v, own)| {
                let track = &self.tracks[v];
                if !track.is_followed {
                    Some(LostReason::NotAccepted)
                } else if moved.is_none() {
                    Some(LostReason::SpineJumped)
                } else if track.n_frames_lost >= self.options.max_frames_lost {
                    let n_frames = track.n_frames_lost;
                    Some(LostReason::TooLong { n_frames })
                } else if let Some(reason) = self.doubt(own, v, &whole) {
                    Some(LostReason::Doubted { reason })
                } else if track.is_tracked() {
                    self.jump(v, &own.target_from_source, (&of_spine[v], 1))
                } else {
                    None
                }
            })
            .collect();
        // Where those that were tracked and still are put the others.
        let mut expected = self.carried(&self.motions(fits, &reasons), &motion);
        for (v, expected) in expected.iter_mut().enumerate() {
            if self.tracks[v].is_tracked() {
                *expected = of_spine[v];
            } else if reasons[v].is_none() {
                // A vertebra out of sight moves on.
                let n_jumps = (1 + self.tracks[v].n_frames_lost).min(MAX_JUMPS);
                reasons[v] = self.jump(v, &fits[v].target_from_source, (expected, n_jumps));
            }
        }
        self.doubt_in_chain(fits, &expected, &mut reasons);
        let guesses = self.guesses(fits, &expected);
        Judged {
            reasons,
            guesses,
            expected,
        }
    }

    /// Every tracked vertebra against the next one that is, be it a neighbour or farther away.
    fn doubt_in_chain(
        &self,
        fits: &[Fitted],
        expected: &[Isometry3<f64>],
        reasons: &mut [Option<LostReason>],
    ) {
        let pose = |v: usize| &fits[v].target_from_source;
        // The one that moved more is the one to doubt.
        let moved_mm =
            |v: usize| pose_error(pose(v), &expected[v], &self.centroid(v)).translation_mm;
        let mut last: Option<usize> = None;
        for u in 0..reasons.len() {
            if reasons[u].is_some() {
                continue;
            }
            let Some(v) = last.replace(u) else { continue };
            let mut options = self.options.verdict;
            options.max_neighbour_turn_rad *= (u - v) as f64;
            let centroids = (self.centroid(v), self.centroid(u));
            let level = self.model.vertebrae[u].level;
            let own = (pose(v), &centroids.0);
            if chain_rejections(own, (pose(u), &centroids.1), level, &options).is_empty() {
                continue;
            }
            let (doubted, other) = if moved_mm(v) > moved_mm(u) {
                (v, u)
            } else {
                last = Some(v);
                (u, v)
            };
            reasons[doubted] = Some(LostReason::AgainstNeighbour {
                neighbour: self.model.vertebrae[other].level,
            });
        }
    }

    /// The first test of a transfer that a fit fails.
    fn doubt(&self, own: &Fitted, v: usize, whole: &Whole) -> Option<Rejection> {
        let noise_mm = own.noise_mm();
        let evidence = Evidence {
            n_points: own.n_points,
            // What is seen has to fix the pose: the deviations tell.
            posterior_coverage: 1.0,
            explained_share: share(own.n_explained, own.n_near),
            noise_mm,
            others_noise_mm: whole.noise_mm,
            target_noise_mm: noise_mm,
            // Bones that are lost fit to anything: those of the first result count.
            quiet_noise_mm: self.tracks[v].quiet_noise_mm,
            is_from_camera: self.view.is_some(),
            tells_tissue: false,
            deviations: own.covariance.as_ref().map(|covariance| {
                // In whatever direction it is largest.
                let (turn, shift) = Spread::of_pose(covariance);
                Deviations {
                    position_mm: Spread::alike(shift.worst()),
                    orientation_rad: Spread::alike(turn.worst()),
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
            landmark_is_of_another: false,
            misfit: own.misfit,
            seen_through: own.seen_through,
            hidden_share: share(own.n_hiding, own.n_hiding + own.n_explained),
            n_alike: 1.0,
            sensor_noise_mm: whole.sensor_noise_mm,
            // How much bare bone is enough, the first result has settled as well.
            bare_area_mm2: Some(f64::INFINITY),
            behind_share: own.behind_share,
        };
        let found = rejections(&evidence, &self.options.verdict)
            .into_iter()
            .next();
        let before_mm = self.noise_mm.unwrap_or(f64::INFINITY);
        let max_mm = NOISE_RATIO * before_mm + NOISE_EXCESS_MM;
        let is_quiet = noise_mm <= max_mm;
        found.or_else(|| {
            (!is_quiet).then_some(Rejection::Noisy {
                noise_mm,
                max_mm,
                n_alike: 1.0,
            })
        })
    }

    /// Which fits, vouched for or not, are good enough to look for the vertebra beside them.
    fn guesses(&self, fits: &[Fitted], expected: &[Isometry3<f64>]) -> Vec<bool> {
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

/// What is said of the vertebrae of a frame.
pub(crate) struct Judged {
    /// Why each is lost; none if it is tracked.
    pub(crate) reasons: Vec<Option<LostReason>>,
    /// Which fits, vouched for or not, are good enough to look for the vertebra beside them.
    pub(crate) guesses: Vec<bool>,
    /// Where each was expected in this frame: its anchor, carried there.
    pub(crate) expected: Vec<Isometry3<f64>>,
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
