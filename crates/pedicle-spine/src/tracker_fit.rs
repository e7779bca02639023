//! The last fits of a frame on the full-resolution surfaces, and what they say about themselves.
//!
//! ```text
//! T_v = argmin Σ_{j of v, bare} ρ( n_j · (T⁻¹ p_j - q_j) )
//! ```
//!
//! As the last refinement of a transfer, from poses that are nearly right and with fewer points: points go
//! to the nearest vertebra, those that lie in front of it or across it are left out (`bare_bone.rs`), the
//! gate follows the noise of the sensor. Points are in the target frame, surfaces in the source frame, mm.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{
    PoseCovariance, ReferenceSurface, RefineOptions, Refinement, refine_on_surface,
};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::SpineError;
use crate::along_rays::{CameraView, behind_share};
use crate::bare_bone::BareBone;
use crate::enlarged::enlarged;
use crate::explained::{CLOSE_MM, EXPLAINED_FLOOR_MM, EXPLAINED_IN_SIGMA};
use crate::finish::select;
use crate::free_space::FreeSpace;
use crate::local_shape::{noise_of_points, shaped};
use crate::misfit::{Misfit, misfit};
use crate::points::PointSet;
use crate::sensor::Sensor;
use crate::tracker::{SpineTracker, Track, thin_out};
use crate::verdict_noise::median;

/// Points so near to a vertebra take part, mm: poses are right to a millimetre or two, and soft tissue
/// close to the bone has to be seen.
const NEAR_MM: f64 = 6.0;
/// Patches that tell the noise are no larger than this, mm.
const NOISE_PATCH_MM: f64 = 5.0;
/// Those that tell front from back may be larger.
const NORMAL_PATCH_MM: f64 = 8.0;
/// Rounds of choosing points and fitting, from which on a vertebra that need not be sought takes part, and the
/// steps of each.
const ROUNDS: usize = 5;
const KNOWN_FROM: usize = 2;
const STEPS: usize = 4;
/// A step that is a smaller share of its own standard error ends the fit.
const STEP_TOLERANCE: f64 = 0.03;
/// The gates of the rounds are so many times as wide as the last one.
const WIDER: [f64; ROUNDS] = [3.0, 2.5, 2.0, 1.4, 1.0];
/// What a frame shows of the bone.
pub(crate) struct Seen {
    pub(crate) points: PointSet,
    /// Noise of the sensor; none if the points lie too far apart to tell.
    pub(crate) noise_mm: Option<f64>,
    pub(crate) free_space: Option<FreeSpace>,
}

/// A vertebra after the fits of a frame, before it is judged.
pub(crate) struct Fitted {
    pub(crate) target_from_source: Isometry3<f64>,
    pub(crate) refinement: Option<Refinement>,
    /// About the centroid in the target frame.
    pub(crate) covariance: Option<PoseCovariance>,
    pub(crate) n_points: usize,
    /// Of the points nearest to it those that lie on it, without those that may be tissue.
    pub(crate) n_near: usize,
    pub(crate) n_explained: usize,
    /// Points a little in front of it or across it.
    pub(crate) n_hiding: usize,
    pub(crate) seen_through: f64,
    pub(crate) misfit: Misfit,
    /// Of the points on or behind the bone the share behind it; none without a camera.
    pub(crate) behind_share: Option<f64>,
}

impl Fitted {
    pub(crate) fn noise_mm(&self) -> f64 {
        self.refinement.as_ref().map_or(f64::NAN, |r| r.noise_mm)
    }
}

impl SpineTracker<'_> {
    /// The points near the vertebrae, cleaned, with what their neighbours tell: normals, patches, noise.
    pub(crate) fn seen(
        &self,
        points: &[Point3<f64>],
        poses: &[Isometry3<f64>],
        rng: &mut ChaCha8Rng,
    ) -> Result<Seen, SpineError> {
        let inverses: Vec<Isometry3<f64>> = poses.iter().map(Isometry3::inverse).collect();
        let is_near = |p: &Point3<f64>| {
            let mut bones = self.model.vertebrae.iter().zip(&inverses);
            bones.any(|(vertebra, inverse)| vertebra.bone.is_about(&(inverse * p), NEAR_MM))
        };
        let near: Vec<Point3<f64>> = points.par_iter().filter(|p| is_near(p)).copied().collect();
        let mut seen = Seen {
            points: PointSet::default(),
            noise_mm: None,
            free_space: None,
        };
        if near.is_empty() {
            return Ok(seen);
        }
        // Once it is known it need not be found again.
        let noise_mm = match self.sensor_noise_mm {
            Some(known) => Some(known),
            None => noise_of_points(&near, NOISE_PATCH_MM)?,
        };
        let positions = thin_out(&near, self.options.n_fine_points, rng);
        // Where the noise is not known, neither is what normals are worth.
        let largest_mm = noise_mm.map_or(0.0, |_| NORMAL_PATCH_MM);
        seen.points = shaped(&positions, largest_mm, self.view.is_some())?;
        if !seen.points.normals.is_empty() {
            seen.noise_mm = noise_mm;
        }
        if let (Some(view), Some(noise_mm)) = (&self.view, seen.noise_mm) {
            seen.points.turn_towards(view);
            seen.free_space = FreeSpace::new(points, view, noise_mm);
        }
        Ok(seen)
    }

    /// Fits every vertebra to its points, from poses that are nearly right.
    pub(crate) fn last_fit(
        &self,
        seen: &Seen,
        poses: &[Isometry3<f64>],
    ) -> Result<Vec<Fitted>, SpineError> {
        let sensor = Sensor {
            noise_mm: seen.noise_mm,
            free_space: seen.free_space.as_ref(),
            picture: None,
        };
        let gate_mm = sensor.gate_mm(self.noise_mm.unwrap_or(0.0));
        let mut poses = poses.to_vec();
        let mut refinements: Vec<Option<Refinement>> = vec![None; poses.len()];
        let mut bare: Vec<Vec<u32>> = Vec::new();
        let mut owned: Vec<Vec<u32>> = Vec::new();
        let is_any_sought = self.tracks.iter().any(Track::is_sought);
        let first_round = if is_any_sought { 0 } else { KNOWN_FROM };
        for (round, wider) in WIDER.iter().enumerate().skip(first_round) {
            // Later poses are nearly right: points do not change hands.
            if round == first_round || round == KNOWN_FROM {
                owned = self.owned(&seen.points, &poses);
            }
            bare = owned.clone();
            let gate_mm = wider * gate_mm;
            bare.par_iter_mut()
                .zip(&mut refinements)
                .zip(&mut poses)
                .zip(self.tracks.par_iter().zip(&self.model.vertebrae))
                .for_each(|(((own, refinement), pose), (track, vertebra))| {
                    if round < KNOWN_FROM && !track.is_sought() {
                        return;
                    }
                    let choice = BareBone {
                        noise_mm: seen.noise_mm,
                        is_from_camera: seen.free_space.is_some(),
                        gate_mm,
                        round,
                    };
                    choice.retain(own, &vertebra.bone, pose, &seen.points);
                    let options = RefineOptions {
                        max_distance_mm: gate_mm,
                        start_distance_mm: None,
                        max_iterations: STEPS,
                        noise_tolerance: STEP_TOLERANCE,
                        ..RefineOptions::default()
                    };
                    let points = select(&seen.points.positions, own);
                    // Too few points or a degenerate patch: there is no fit, and the verdict says so.
                    *refinement = refine_on_surface(&vertebra.bone, &points, pose, &options).ok();
                    if let Some(fit) = refinement {
                        *pose = fit.target_from_source;
                    }
                });
        }
        let noise = refinements.iter().flatten().map(|fit| fit.noise_mm);
        let noise_mm = median(noise.collect());
        (0..poses.len())
            .into_par_iter()
            .map(|v| {
                let mut fitted = Fitted {
                    target_from_source: poses[v],
                    refinement: refinements[v].clone(),
                    covariance: None,
                    n_points: bare[v].len(),
                    n_near: 0,
                    n_explained: 0,
                    n_hiding: 0,
                    seen_through: 0.0,
                    misfit: Misfit::UNKNOWN,
                    behind_share: None,
                };
                self.count(&mut fitted, v, (seen, &owned[v]), noise_mm);
                self.doubts(
                    &mut fitted,
                    v,
                    (seen, &bare[v], &owned[v]),
                    (&sensor, gate_mm),
                )?;
                Ok(fitted)
            })
            .collect()
    }

    /// The points of every vertebra.
    fn owned(&self, points: &PointSet, poses: &[Isometry3<f64>]) -> Vec<Vec<u32>> {
        let inverses: Vec<Isometry3<f64>> = poses.iter().map(Isometry3::inverse).collect();
        let owners: Vec<Option<usize>> = points
            .positions
            .par_iter()
            .map(|p| {
                let mut nearest = (NEAR_MM, None);
                for (v, (vertebra, inverse)) in
                    self.model.vertebrae.iter().zip(&inverses).enumerate()
                {
                    let local = inverse * p;
                    if !vertebra.bone.is_about(&local, nearest.0) {
                        continue;
                    }
                    match vertebra.bone.closest_within(&local, nearest.0) {
                        Some(hit) if hit.distance_mm < nearest.0 => {
                            nearest = (hit.distance_mm, Some(v));
                        }
                        _ => {}
                    }
                }
                nearest.1
            })
            .collect();
        let mut lists = vec![Vec::new(); poses.len()];
        for (p, owner) in owners.into_iter().enumerate() {
            if let Some(v) = owner {
                lists[v].push(p as u32);
            }
        }
        lists
    }

    /// Which of its points lie on a vertebra. Before the eyes of a camera, points in front of the bone or
    /// across it may be soft tissue: they contradict nothing.
    fn count(&self, fitted: &mut Fitted, v: usize, (seen, own): (&Seen, &[u32]), noise_mm: f64) {
        let limit_mm = EXPLAINED_FLOOR_MM + EXPLAINED_IN_SIGMA * noise_mm;
        let bone = &self.model.vertebrae[v].bone;
        let pose = &fitted.target_from_source;
        let inverse = pose.inverse();
        for &p in own {
            let point = &seen.points.positions[p as usize];
            let local = inverse * point;
            let hit = bone.closest(&local);
            if hit.distance_mm <= limit_mm {
                (fitted.n_near, fitted.n_explained) = (fitted.n_near + 1, fitted.n_explained + 1);
                continue;
            }
            let hides_bone = seen.free_space.as_ref().is_some_and(|free_space| {
                let offset = pose.rotation * (local - hit.point);
                offset.dot(&free_space.towards_camera(point)) > 0.0
                    || !seen.points.agrees_in(p as usize, pose, &hit.normal)
            });
            if hides_bone {
                fitted.n_hiding += usize::from(hit.distance_mm <= CLOSE_MM);
            } else {
                fitted.n_near += 1;
            }
        }
    }

    /// Covariance, misfit and what the camera saw through.
    fn doubts(
        &self,
        fitted: &mut Fitted,
        v: usize,
        (seen, own, owned): (&Seen, &[u32], &[u32]),
        (sensor, gate_mm): (&Sensor<'_>, f64),
    ) -> Result<(), SpineError> {
        let vertebra = &self.model.vertebrae[v];
        let pose = &fitted.target_from_source;
        let Some(fit) = &fitted.refinement else {
            return Ok(());
        };
        let points = select(&seen.points.positions, own);
        fitted.misfit = misfit(&vertebra.bone, pose, &points, gate_mm, fit.noise_mm)?;
        if let Some(free_space) = &seen.free_space {
            fitted.seen_through = free_space.contradiction(&vertebra.patches, pose).of_bone;
        }
        if let (Some(free_space), Some(noise_mm)) = (&seen.free_space, seen.noise_mm) {
            let view = CameraView {
                camera_mm: free_space.camera_mm(),
                positions: &seen.points.positions,
                normals: &seen.points.normals,
                patches: &seen.points.patches,
                noise_mm,
                alike: seen.points.alike,
            };
            fitted.behind_share = Some(behind_share(vertebra, pose, owned, view));
        }
        let first_order = fit.covariance.about(&(pose * self.centroid(v)));
        let all = fitted.n_hiding + fitted.n_explained;
        let hidden_share = fitted.n_hiding as f64 / all.max(1) as f64;
        let noise = (fit.noise_mm, hidden_share);
        fitted.covariance = Some(enlarged(&first_order, noise, sensor, &fitted.misfit));
        Ok(())
    }
}
