//! Follows the vertebrae from frame to frame.
//!
//! ```text
//! T_v(t) = argmin Σ_{j of v} ρ( n_j · (T⁻¹ p_j - q_j) ),   from M T_v(t - 1)
//! ```
//!
//! p_j are the points of the frame nearest to vertebra v, q_j and n_j the closest points of its
//! source surface and the normals there, M the motion of the whole spine since the last frame in which any
//! vertebra was tracked.
//!
//! 1. The whole spine is moved as one body, among the points that are near enough to be its own.
//! 2. Points are given to vertebrae and every vertebra is fitted, in rounds of shrinking gates, on
//!    the simplified surfaces; lost vertebrae afterwards, from where their neighbours' motion has
//!    carried them. Vertebrae that are not followed ride along and keep their points.
//! 3. Fits on the full-resolution surfaces to the points of bare bone among a limited number. Among
//!    points so dense that they have normals, vertebrae that were placed in the last frame go there at once.
//! 4. What a transfer asks of a fit, jump and neighbours are checked. What fails is lost in this frame, and
//!    said so. It is found again only near where it was vouched for last, carried along since: a fit that
//!    nobody vouches for may help to look for it, and does not move that place.
//!
//! Points and poses are in the frame of the sensor, mm. The same frames give the same poses.

use nalgebra::{Isometry3, Point3};
use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::tracker_fit::Fitted;
use crate::tracker_verdict::Judged;
use crate::verdict_noise::{median, second_smallest};
use crate::{
    SensorView, SpineError, SpineModel, TrackState, TrackedFrame, TrackedVertebra, TrackerOptions,
    Transfer,
};

/// A lost vertebra is looked for with gates this much wider.
const LOST_GATE_FACTOR: f64 = 1.5;
/// Weight of a new frame in the running mean of the noise.
const NOISE_MEMORY: f64 = 0.2;

/// One vertebra between frames.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    /// Where to look for it in the next frame, before the motion of the spine is known.
    pub(crate) pose: Isometry3<f64>,
    /// Where it was vouched for last, carried along since.
    pub(crate) anchor: Isometry3<f64>,
    /// Whether the first result vouched for it.
    pub(crate) is_followed: bool,
    /// Whether that comes from a fit of the last frame near the anchor, although nobody vouches for it.
    pub(crate) is_guessed: bool,
    pub(crate) n_frames_lost: usize,
    /// Of the other vertebrae in the first result the second quietest, mm; NaN if that is not known.
    pub(crate) quiet_noise_mm: f64,
}

impl Track {
    fn new(pose: Isometry3<f64>, is_followed: bool, quiet_noise_mm: f64) -> Self {
        Self {
            pose,
            anchor: pose,
            is_followed,
            is_guessed: false,
            n_frames_lost: 0,
            quiet_noise_mm,
        }
    }

    /// Whether its pose was vouched for in the last frame.
    pub(crate) fn is_tracked(&self) -> bool {
        self.is_followed && self.n_frames_lost == 0
    }

    /// Whether it is followed and nobody knows even nearly where it is.
    pub(crate) fn is_sought(&self) -> bool {
        self.is_followed && self.n_frames_lost > 0 && !self.is_guessed
    }

    /// Whether it is followed and was tracked or guessed in the last frame.
    pub(crate) fn is_nearly_known(&self) -> bool {
        self.is_followed && !self.is_sought()
    }
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
    /// Noise of the sensor as the first result found it without a camera, or as the first frame tells it in which a vertebra
    /// is tracked, mm.
    pub(crate) sensor_noise_mm: Option<f64>,
    pub(crate) view: Option<SensorView>,
    n_frames: u64,
}

impl<'a> SpineTracker<'a> {
    /// Starts from the result of a transfer. Vertebrae that it does not vouch for are not followed; those that it accepts with a small doubt
    /// ([`VertebraTransfer::doubts`](crate::VertebraTransfer::doubts)) are, and the frames do not repeat the doubt. Pixels of frames are taken to err independently.
    ///
    /// # Errors
    /// [`SpineError::InvalidOption`], or [`SpineError::NothingToTrack`] if it vouches for none.
    pub fn new(
        model: &'a SpineModel,
        transfer: &Transfer,
        options: TrackerOptions,
    ) -> Result<Self, SpineError> {
        let noises: Vec<f64> = transfer.vertebrae.iter().map(|v| v.noise_mm).collect();
        let quiet_beside = |v: usize| {
            let others = noises.iter().enumerate().filter(|(u, _)| *u != v);
            second_smallest(others.map(|(_, noise)| *noise).collect())
        };
        let vertebrae = transfer.vertebrae.iter().enumerate();
        let tracks = vertebrae
            .map(|(v, found)| Track::new(found.target_from_source, found.accepted, quiet_beside(v)))
            .collect();
        let mut tracker = Self::from_tracks(model, tracks, options)?;
        // What a camera's picture tells is not what the points of a frame tell in space: that is found anew.
        if transfer.vertebrae.iter().all(|v| v.bare_area_mm2.is_none()) {
            tracker.sensor_noise_mm = transfer.sensor_noise_mm;
        }
        tracker.noise_mm = Some(transfer.noise_mm).filter(|noise| noise.is_finite());
        Ok(tracker)
    }

    /// The same tracker with the camera that sees the frames. It may be told anew before every frame.
    #[must_use]
    pub fn seen_from(mut self, view: SensorView) -> Self {
        self.view = Some(view);
        self
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
            .map(|pose| Track::new(*pose, true, f64::NAN))
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
            sensor_noise_mm: None,
            view: None,
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
        let search = thin_out(&self.about(points), self.options.n_search_points, &mut rng);

        let moved = self.moved(&search);
        let motion = moved.unwrap_or_default();
        let mut poses: Vec<Isometry3<f64>> = self.tracks.iter().map(|t| motion * t.pose).collect();
        let seen = self.seen(points, &poses, &mut rng)?;
        let is_known: Vec<bool> = self.tracks.iter().map(Track::is_tracked).collect();
        let is_sought: Vec<bool> = self.tracks.iter().map(Track::is_sought).collect();
        // Among dense points the last fit finds its own way, and tissue would pull the search.
        if seen.noise_mm.is_none() {
            let is_near: Vec<bool> = self.tracks.iter().map(Track::is_nearly_known).collect();
            self.search_rounds(&mut poses, &search, (1.0, &is_near));
        }
        if is_sought.contains(&true) {
            let motion_of = |v: usize| poses[v] * self.tracks[v].anchor.inverse();
            let motions: Vec<Option<Isometry3<f64>>> = (0..poses.len())
                .map(|v| is_known[v].then(|| motion_of(v)))
                .collect();
            let carried = self.carried(&motions, &motion);
            for v in (0..poses.len()).filter(|&v| is_sought[v]) {
                poses[v] = carried[v];
            }
            self.search_rounds(&mut poses, &search, (LOST_GATE_FACTOR, &is_sought));
        }
        let fits = self.last_fit(&seen, &poses)?;
        let judged = self.judged((&seen, &fits), moved.as_ref());
        let anchors = self.next_anchors(&fits, &judged.reasons, moved.as_ref());
        self.n_frames += 1;
        Ok(self.taken_over(&fits, &judged, (&anchors, seen.noise_mm)))
    }

    /// Remembers what was found and reports it.
    fn taken_over(
        &mut self,
        fits: &[Fitted],
        judged: &Judged,
        (anchors, sensor_noise_mm): (&[Isometry3<f64>], Option<f64>),
    ) -> TrackedFrame {
        let Judged {
            reasons,
            guesses,
            expected,
        } = judged;
        let is_known: Vec<bool> = reasons.iter().map(Option::is_none).collect();
        let of_known = |v: usize| is_known[v].then_some(&fits[v]);
        let poses: Vec<Isometry3<f64>> = (0..is_known.len())
            .map(|v| {
                if is_known[v] || guesses[v] {
                    fits[v].target_from_source
                } else {
                    anchors[v]
                }
            })
            .collect();
        // What a frame tells in which nothing was found may be anything.
        if is_known.contains(&true) {
            self.sensor_noise_mm = self.sensor_noise_mm.or(sensor_noise_mm);
        }
        let known = (0..poses.len()).filter_map(of_known);
        let noise_mm = median(known.map(Fitted::noise_mm).collect());
        if noise_mm.is_finite() {
            let before = self.noise_mm.unwrap_or(noise_mm);
            self.noise_mm = Some(before + NOISE_MEMORY * (noise_mm - before));
        }
        for (v, (track, is_known)) in self.tracks.iter_mut().zip(&is_known).enumerate() {
            // Beside the anchor as it was beside where the anchor was expected: the anchor may have stayed.
            track.pose = if *is_known || !guesses[v] {
                anchors[v]
            } else {
                anchors[v] * expected[v].inverse() * poses[v]
            };
            track.anchor = anchors[v];
            track.is_guessed = guesses[v] && !is_known;
            track.n_frames_lost = if *is_known {
                0
            } else {
                track.n_frames_lost + 1
            };
        }
        let vertebrae = (0..poses.len())
            .map(|v| TrackedVertebra {
                level: self.model.vertebrae[v].level,
                state: match &reasons[v] {
                    None => TrackState::Tracking,
                    Some(reason) => TrackState::Lost {
                        reason: reason.clone(),
                    },
                },
                target_from_source: poses[v],
                covariance: of_known(v).and_then(|own| own.covariance),
                n_points: fits[v].n_points,
                residual_mm: of_known(v)
                    .and_then(|own| own.refinement.as_ref())
                    .map_or(f64::NAN, |r| r.rmse_mm),
                noise_mm: fits[v].noise_mm(),
                n_frames_lost: self.tracks[v].n_frames_lost,
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

pub(crate) fn thin_out(points: &[Point3<f64>], n: usize, rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
    if points.len() <= n {
        return points.to_vec();
    }
    let mut chosen = index::sample(rng, points.len(), n).into_vec();
    chosen.sort_unstable();
    chosen.into_iter().map(|p| points[p]).collect()
}
