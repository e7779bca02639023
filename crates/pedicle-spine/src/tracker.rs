//! Follows the vertebrae from frame to frame.
//!
//! ```text
//! T_v(t) = argmin Σ_{j of v} ρ( n_j · (T⁻¹ p_j - q_j) ),   from M T_v(t - 1)
//! ```
//!
//! p_j are the points of the frame nearest to vertebra v, q_j and n_j the closest points of its
//! source surface and the normals there, M the motion of the whole spine since the last frame.
//!
//! 1. The whole spine is moved as one body.
//! 2. Points are given to vertebrae and every vertebra is fitted, in rounds of shrinking gates, on
//!    the simplified surfaces; lost vertebrae afterwards, from where their neighbours' motion has
//!    carried them.
//! 3. One fit on the full-resolution surfaces, with a limited number of points.
//! 4. Fit, certainty, jump and neighbours are checked. What fails is lost in this frame, and said so.
//!
//! Points and poses are in the frame of the sensor, mm. The same frames give the same poses.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::Refinement;
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::tracker_verdict::median;
use crate::{
    LostReason, SpineError, SpineModel, TrackState, TrackedFrame, TrackedVertebra, TrackerOptions,
    Transfer,
};

/// A lost vertebra is looked for with gates this much wider.
const LOST_GATE_FACTOR: f64 = 1.5;
/// Weight of a new frame in the running mean of the noise.
const NOISE_MEMORY: f64 = 0.2;

/// One vertebra between frames.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    pub(crate) pose: Isometry3<f64>,
    /// Whether the first result vouched for it.
    pub(crate) is_followed: bool,
    pub(crate) n_frames_lost: usize,
}

/// Follows the vertebrae of a spine through the frames of a sensor, from a first result on.
///
/// A vertebra that cannot be followed is lost, with the reason, and looked for again where the motion
/// of its neighbours takes it. If everything is lost and stays so, a new transfer is needed.
#[derive(Debug, Clone)]
pub struct SpineTracker<'a> {
    pub(crate) model: &'a SpineModel,
    pub(crate) options: TrackerOptions,
    pub(crate) tracks: Vec<Track>,
    /// Running mean over the frames, mm; none before the first one.
    pub(crate) noise_mm: Option<f64>,
    n_frames: u64,
}

/// A vertebra after the fits of a frame, before it is judged.
pub(crate) struct Fitted {
    pub(crate) refinement: Option<Refinement>,
    pub(crate) n_points: usize,
    pub(crate) explained_share: f64,
}

impl<'a> SpineTracker<'a> {
    /// Starts from the result of a transfer. Vertebrae that it does not vouch for are not followed.
    ///
    /// # Errors
    /// [`SpineError::InvalidOption`], or [`SpineError::NothingToTrack`] if it vouches for none.
    pub fn new(
        model: &'a SpineModel,
        transfer: &Transfer,
        options: TrackerOptions,
    ) -> Result<Self, SpineError> {
        let tracks = transfer
            .vertebrae
            .iter()
            .map(|v| Track {
                pose: v.target_from_source,
                is_followed: v.accepted,
                n_frames_lost: 0,
            })
            .collect();
        Self::from_tracks(model, tracks, options)
    }

    /// Starts from one `target_from_source` a vertebra, L1 first, all of them trusted.
    ///
    /// # Errors
    /// [`SpineError::InvalidOption`], [`SpineError::PoseCount`] or [`SpineError::NonFinitePose`].
    pub fn from_poses(
        model: &'a SpineModel,
        poses: &[Isometry3<f64>],
        options: TrackerOptions,
    ) -> Result<Self, SpineError> {
        let tracks = poses
            .iter()
            .map(|pose| Track {
                pose: *pose,
                is_followed: true,
                n_frames_lost: 0,
            })
            .collect();
        Self::from_tracks(model, tracks, options)
    }

    fn from_tracks(
        model: &'a SpineModel,
        tracks: Vec<Track>,
        options: TrackerOptions,
    ) -> Result<Self, SpineError> {
        options.check()?;
        let n_vertebrae = model.vertebrae.len();
        if tracks.len() != n_vertebrae {
            return Err(SpineError::PoseCount {
                n_poses: tracks.len(),
                n_vertebrae,
            });
        }
        for (track, vertebra) in tracks.iter().zip(&model.vertebrae) {
            let matrix = track.pose.to_homogeneous();
            if !matrix.iter().all(|x| x.is_finite()) {
                let level = vertebra.level;
                return Err(SpineError::NonFinitePose { level });
            }
        }
        if !tracks.iter().any(|track| track.is_followed) {
            return Err(SpineError::NothingToTrack);
        }
        Ok(Self {
            model,
            options,
            tracks,
            noise_mm: None,
            n_frames: 0,
        })
    }

    /// Follows the vertebrae into the next frame: all its points, in any order.
    ///
    /// # Errors
    /// [`SpineError::EmptyFrame`] or [`SpineError::NonFinitePoint`]; the tracker is as before then.
    pub fn update(&mut self, points: &[Point3<f64>]) -> Result<TrackedFrame, SpineError> {
        check_points(points)?;
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed ^ self.n_frames);
        self.n_frames += 1;
        let search = thin_out(points, self.options.n_search_points, &mut rng);
        let fine = thin_out(points, self.options.n_fine_points, &mut rng);

        let moved = self.moved(&search);
        let mut poses: Vec<Isometry3<f64>> = self
            .tracks
            .iter()
            .map(|track| moved.unwrap_or_default() * track.pose)
            .collect();
        let expected = poses.clone();
        let is_known: Vec<bool> = self
            .tracks
            .iter()
            .map(|track| track.is_followed && track.n_frames_lost == 0)
            .collect();
        self.search_rounds(&mut poses, &search, (1.0, &is_known));
        self.carry_unknown(&mut poses, &is_known);
        let is_lost: Vec<bool> = self
            .tracks
            .iter()
            .map(|track| track.is_followed && track.n_frames_lost > 0)
            .collect();
        if is_lost.contains(&true) {
            self.search_rounds(&mut poses, &search, (LOST_GATE_FACTOR, &is_lost));
        }
        let fitted = self.last_fit(&mut poses, &fine);
        let reasons = self.judged(&fitted, &poses, (&expected, moved.is_some()));
        Ok(self.taken_over(&fitted, poses, &reasons))
    }

    /// Remembers what was found and reports it.
    fn taken_over(
        &mut self,
        fitted: &[Fitted],
        mut poses: Vec<Isometry3<f64>>,
        reasons: &[Option<LostReason>],
    ) -> TrackedFrame {
        let is_known: Vec<bool> = reasons.iter().map(Option::is_none).collect();
        for ((pose, track), is_known) in poses.iter_mut().zip(&self.tracks).zip(&is_known) {
            if !is_known {
                *pose = track.pose;
            }
        }
        self.carry_unknown(&mut poses, &is_known);
        let known = |(fitted, is_known): (&'_ Fitted, &bool)| {
            let refinement = fitted.refinement.as_ref()?;
            is_known.then_some(refinement.noise_mm)
        };
        let noise_mm = median(fitted.iter().zip(&is_known).filter_map(known).collect());
        if noise_mm.is_finite() {
            let before = self.noise_mm.unwrap_or(noise_mm);
            self.noise_mm = Some(before + NOISE_MEMORY * (noise_mm - before));
        }
        for ((track, pose), is_known) in self.tracks.iter_mut().zip(&poses).zip(&is_known) {
            track.pose = *pose;
            track.n_frames_lost = if *is_known {
                0
            } else {
                track.n_frames_lost + 1
            };
        }
        let vertebrae = (0..poses.len())
            .map(|v| {
                let fit = fitted[v].refinement.as_ref();
                let of_known = fit.filter(|_| is_known[v]);
                TrackedVertebra {
                    level: self.model.vertebrae[v].level,
                    state: reasons[v]
                        .map_or(TrackState::Tracking, |reason| TrackState::Lost { reason }),
                    target_from_source: poses[v],
                    covariance: of_known
                        .map(|fit| fit.covariance.about(&(poses[v] * self.centroid(v)))),
                    n_points: fitted[v].n_points,
                    residual_mm: of_known.map_or(f64::NAN, |fit| fit.rmse_mm),
                    noise_mm: fit.map_or(f64::NAN, |fit| fit.noise_mm),
                    n_frames_lost: self.tracks[v].n_frames_lost,
                }
            })
            .collect();
        TrackedFrame {
            vertebrae,
            noise_mm,
        }
    }
}

fn check_points(points: &[Point3<f64>]) -> Result<(), SpineError> {
    if points.is_empty() {
        return Err(SpineError::EmptyFrame);
    }
    let is_finite = |p: &Point3<f64>| p.coords.iter().all(|c| c.is_finite());
    match points.iter().position(|p| !is_finite(p)) {
        Some(point) => Err(SpineError::NonFinitePoint { point }),
        None => Ok(()),
    }
}

fn thin_out(points: &[Point3<f64>], n: usize, rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
    if points.len() <= n {
        return points.to_vec();
    }
    let mut chosen = index::sample(rng, points.len(), n).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|p| points[p]).collect()
}
