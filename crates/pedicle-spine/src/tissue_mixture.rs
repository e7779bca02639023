//! Bone among soft tissue: where a camera looked, every point near a bone lies on it or on tissue in
//! front of it, and which is inferred together with the pose.
//!
//! ```text
//! w_i = π N(r̄_i; s_i) / p(r̄_i),   p(r̄) = π N(r̄; s) + (1 - π) { [Φ(r̄/s) - Φ((r̄ - H)/s)] / H + ε }
//! s_i² = σ² k/n_i + τ²,   T = argmin Σ_i w_i r_i(T)²
//! ```
//!
//! r are signed distances along the rays, at right angles to the surface ([`crate::seen_bone`]), positive in front
//! of it, r̄ their means over patches of n neighbouring points of the picture: tissue lies in front over many
//! points, noise on one, or on k pixels that err alike ([`crate::errs_alike`]). Tissue is as likely at every thickness up to H; ε is for everything else. τ is what a pose
//! and a surface of triangles leave. σ and π are inferred beside w, in turns with the pose (expectation and maximisation,
//! Dempster, Laird & Rubin 1977), as long as Σ log p(r̄_i)/n_i grows.
//!
//! Points cut off at a distance pull a pose aside; points weighed by what they probably are do so less. The
//! covariance is A⁻¹ B A⁻¹ with A = Σ w a aᵀ / σ² and the scatter B of the gradients. Nothing that a camera saw lies
//! behind bare bone: patches that do, by more than 3 s, contradict the pose or the bone. Their medians tell: rays that just miss the end of a bone meet what lies far behind it, and a few of them
//! move the mean of a patch beside it.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use pedicle_registration::PoseCovariance;
use rayon::prelude::*;

use crate::along_rays::CameraView;
use crate::errs_alike::ErrsAlike;
use crate::scoring::MIN_POINTS_A_TASK;
use crate::seen_bone::SeenBone;
use crate::uncertainty::{density, lower_tail};

/// Tissue thicker than this lies elsewhere, mm.
const THICKEST_MM: f64 = 8.0;
/// Points so thick in front of a bone, and this many standard deviations more, may be its own.
const REACH_IN_SIGMA: f64 = 3.0;
/// Density of everything that is neither bone nor tissue, 1/mm.
const ELSEWHERE: f64 = 2e-3;
/// The noise along the normals of a bone over that of the sensor, the median of patches.
const SENSOR_TO_SURFACE: f64 = 1.05;
/// Bounds of the noise over that.
const NOISE_RANGE: (f64, f64) = (0.8, 1.6);
/// What the prior of π weighs, in points.
const PRIOR_POINTS: f64 = 6.0;
/// Share of bone where nothing is known.
const FIRST_SHARE: f64 = 0.7;
/// Bounds of π.
const SHARE_RANGE: (f64, f64) = (0.3, 0.98);
/// τ, mm.
const SURFACE_MM: f64 = 0.12;
/// Least cosine of the angle between the normal of the points around one and of the bone.
const LEAST_AGREEMENT: f64 = 0.6;
/// Patches farther behind the bone than this many standard deviations of their median contradict it.
const BEHIND_IN_SIGMA: f64 = 3.0;
/// Steps of the first fit, and where its weights fall to zero in standard deviations.
const ROBUST_STEPS: usize = 10;
const TUKEY: f64 = 4.685;
/// A single point farther in front than this many standard deviations and this much is tissue, mm.
const FRONT_IN_SIGMA: f64 = 2.5;
const FRONT_FLOOR_MM: f64 = 0.2;
/// Points of a whole patch.
const PATCH_POINTS: f64 = 24.0;
/// Steps of the pose.
const MAX_STEPS: usize = 25;
/// A step shorter than this share of its standard error ends it.
const SHORT: f64 = 0.05;
/// Length that makes a rotation comparable to a shift, mm.
const LEVER_MM: f64 = 25.0;
/// Damping of what the points hardly fix, relative to the largest eigenvalue.
const DAMPING: f64 = 1e-6;
/// Longest step, mm and (times the lever) rad.
const LONGEST: f64 = 2.0;

/// The points that one bone may own.
pub(crate) struct TissueMixture<'a> {
    pub(crate) seen: SeenBone<'a>,
    pub(crate) view: CameraView<'a>,
    /// Indices of the points.
    pub(crate) own: &'a [u32],
}

/// A maximum of the likelihood.
pub(crate) struct MixtureFit {
    pub(crate) target_from_source: Isometry3<f64>,
    /// Root mean square of the weighed residuals, mm: not held within the bounds of σ.
    pub(crate) noise_mm: f64,
    /// Probability of being bone, of every own point.
    pub(crate) weights: Vec<f64>,
    /// Of the points on or behind the bone the share behind it, where bone would hide them.
    pub(crate) behind_share: f64,
    /// None if the points do not fix the pose.
    pub(crate) covariance: Option<PoseCovariance>,
}

/// The best pose of a fit until then, with what was seen from it.
struct Maximum {
    pose: Isometry3<f64>,
    /// σ, mm.
    noise_mm: f64,
    seen: Vec<Seen>,
    weights: Vec<f64>,
    log_likelihood: f64,
}

/// How far points may lie from a bone to be its own, mm.
pub(crate) fn reach_mm(noise_mm: f64) -> f64 {
    THICKEST_MM + REACH_IN_SIGMA * noise_mm
}

/// What one point sees.
#[derive(Clone, Copy)]
struct Seen {
    /// Signed distance, mm; none if it is out of reach or its normal contradicts.
    residual: Option<f64>,
    /// -d residual / d pose, levers in units of [`LEVER_MM`].
    row: Vector6<f64>,
}

impl TissueMixture<'_> {
    /// Noise expected along the normals, mm.
    fn sensor_mm(&self) -> f64 {
        let noise_mm = SENSOR_TO_SURFACE * self.view.noise_mm;
        // An exact sensor still sees a surface of triangles.
        if noise_mm > SURFACE_MM {
            noise_mm
        } else {
            SURFACE_MM
        }
    }

    /// The maximum that a pose leads to.
    pub(crate) fn fit(&self, start: &Isometry3<f64>) -> Option<MixtureFit> {
        let patches = self.patches();
        let mut pose = *start;
        let mut state = State {
            noise_mm: self.sensor_mm(),
            share: FIRST_SHARE,
        };
        let mut best: Option<Maximum> = None;
        for _ in 0..=MAX_STEPS {
            let seen = self.look(&pose);
            let means = patch_means(&seen, &patches);
            let alike = &self.view.alike;
            let (weights, _) = state.weighed(&seen, &means, alike);
            state = self.state_of(&seen, &weights);
            let (weights, log_likelihood) = state.weighed(&seen, &means, alike);
            state = self.state_of(&seen, &weights);
            if best
                .as_ref()
                .is_some_and(|b| log_likelihood < b.log_likelihood)
            {
                break;
            }
            let (information, gradient) = normal_equations(&seen, &weights, state.noise_mm);
            let step = solved(&information, &gradient);
            best = Some(Maximum {
                pose,
                noise_mm: state.noise_mm,
                seen,
                weights,
                log_likelihood,
            });
            let length = step.dot(&(information * step)).sqrt();
            // A NaN ends it as well.
            if length.is_nan() || length <= SHORT {
                break;
            }
            pose = moved(&pose, &step, &(pose * self.seen.bone.centroid()));
        }
        best.map(|best| self.told(best))
    }

    /// What a maximum tells.
    fn told(&self, at: Maximum) -> MixtureFit {
        // A wrong pose must not widen its own limit.
        let noise_mm = if at.noise_mm < self.sensor_mm() {
            at.noise_mm
        } else {
            self.sensor_mm()
        };
        let center = at.pose * self.seen.bone.centroid();
        MixtureFit {
            target_from_source: at.pose,
            noise_mm: weighted_noise_mm(&at.seen, &at.weights),
            behind_share: self.share_behind(&at.seen, noise_mm),
            covariance: covariance(&at.seen, &at.weights, at.noise_mm, &center),
            weights: at.weights,
        }
    }

    /// σ and the share of bone from the weights.
    fn state_of(&self, seen: &[Seen], weights: &[f64]) -> State {
        let (mut n, mut n_all) = (0.0, 0.0);
        for (s, w) in seen.iter().zip(weights) {
            if s.residual.is_some() {
                n_all += 1.0;
                n += w;
            }
        }
        if n <= 0.0 {
            return State {
                noise_mm: self.sensor_mm(),
                share: FIRST_SHARE,
            };
        }
        State {
            noise_mm: weighted_noise_mm(seen, weights).clamp(
                NOISE_RANGE.0 * self.sensor_mm(),
                NOISE_RANGE.1 * self.sensor_mm(),
            ),
            share: ((n + PRIOR_POINTS * FIRST_SHARE) / (n_all + PRIOR_POINTS))
                .clamp(SHARE_RANGE.0, SHARE_RANGE.1),
        }
    }

    /// Of the points that lie on the bone in a pose or behind it the share behind.
    pub(crate) fn behind_share(&self, pose: &Isometry3<f64>) -> f64 {
        self.share_behind(&self.look(pose), self.sensor_mm())
    }

    fn share_behind(&self, seen: &[Seen], noise_mm: f64) -> f64 {
        let alike = &self.view.alike;
        let told = patch_medians(seen, &self.patches()).into_iter().flatten();
        behind_share(told.map(|(median, n)| (median, alike.n_told(n))), noise_mm)
    }

    /// The pose that robust weights lead to where nearly all points are bone.
    pub(crate) fn robust(&self, start: &Isometry3<f64>) -> Option<Isometry3<f64>> {
        let mut pose = *start;
        for _ in 0..ROBUST_STEPS {
            let seen = self.look(&pose);
            let weights: Vec<f64> = seen
                .iter()
                .map(|s| {
                    let x = s.residual.map_or(1.0, |r| r / (TUKEY * self.sensor_mm()));
                    if x.abs() < 1.0 {
                        (1.0 - x * x).powi(2)
                    } else {
                        0.0
                    }
                })
                .collect();
            let (information, gradient) = normal_equations(&seen, &weights, self.sensor_mm());
            information.cholesky()?;
            let step = solved(&information, &gradient);
            pose = moved(&pose, &step, &(pose * self.seen.bone.centroid()));
            let length = step.dot(&(information * step)).sqrt();
            if length.is_nan() || length <= SHORT {
                break;
            }
        }
        Some(pose)
    }

    fn look(&self, pose: &Isometry3<f64>) -> Vec<Seen> {
        let center = pose * self.seen.bone.centroid();
        let reach_mm = reach_mm(self.view.noise_mm);
        let sight = self.seen.before(self.view.camera_mm, pose);
        let view = self.view;
        self.own
            .par_iter()
            .with_min_len(MIN_POINTS_A_TASK)
            .map(|&p| {
                let nothing = Seen {
                    residual: None,
                    row: Vector6::zeros(),
                };
                let Some(hit) = sight.hit(&view.positions[p as usize], reach_mm) else {
                    return nothing;
                };
                let normal = pose.rotation * hit.normal;
                if view.normals[p as usize].dot(&normal) < LEAST_AGREEMENT {
                    return nothing;
                }
                let turn = (pose * hit.point - center).cross(&normal) / LEVER_MM;
                Seen {
                    residual: Some(hit.residual_mm),
                    row: Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z),
                }
            })
            .collect()
    }

    /// For every own point the own points of its patch, by their place in the list, without itself.
    fn patches(&self) -> Vec<Vec<u32>> {
        let mut place = vec![u32::MAX; self.view.positions.len()];
        for (i, &p) in self.own.iter().enumerate() {
            place[p as usize] = i as u32;
        }
        self.own
            .iter()
            .map(|&p| {
                let patch = self.view.patches.get(p as usize);
                patch
                    .into_iter()
                    .flatten()
                    .filter(|&&q| q != p && place[q as usize] != u32::MAX)
                    .map(|&q| place[q as usize])
                    .collect()
            })
            .collect()
    }
}

/// What is inferred beside the pose.
#[derive(Clone, Copy)]
struct State {
    noise_mm: f64,
    share: f64,
}

impl State {
    /// w of every point and the likelihood of all patches.
    fn weighed(
        &self,
        seen: &[Seen],
        means: &[Option<(f64, f64)>],
        alike: &ErrsAlike,
    ) -> (Vec<f64>, f64) {
        let farthest_mm = FRONT_FLOOR_MM + FRONT_IN_SIGMA * self.noise_mm;
        let mut log_likelihood = 0.0;
        let weights = seen
            .iter()
            .zip(means)
            .map(|(s, mean)| {
                let (Some(r), Some((u, n))) = (s.residual, mean) else {
                    log_likelihood += ELSEWHERE.ln() / PATCH_POINTS;
                    return 0.0;
                };
                let scatter_mm = scatter_mm(self.noise_mm, alike.n_told(*n));
                let bone = self.share * density(u / scatter_mm) / scatter_mm;
                let all = bone + (1.0 - self.share) * tissue(*u, scatter_mm);
                log_likelihood += all.ln() / n;
                if r > farthest_mm { 0.0 } else { bone / all }
            })
            .collect();
        (weights, log_likelihood)
    }
}

/// s of a patch of n points.
fn scatter_mm(noise_mm: f64, n: f64) -> f64 {
    (noise_mm * noise_mm / n + SURFACE_MM * SURFACE_MM).sqrt()
}

/// Of patches that lie on bone or behind it the share behind. Medians of the residuals and numbers of points.
fn behind_share(medians: impl Iterator<Item = (f64, f64)>, noise_mm: f64) -> f64 {
    let (mut n_behind, mut n_on) = (0.0, 0.0);
    for (median, n) in medians {
        let limit_mm = BEHIND_IN_SIGMA * scatter_mm(noise_mm, n_of_median(n));
        if median < -limit_mm {
            n_behind += 1.0;
        } else if median <= limit_mm {
            n_on += 1.0;
        }
    }
    n_behind / (n_behind + n_on)
}

/// Of how many normal numbers the mean scatters as the median of n does: π/2 times fewer of many, of one itself.
fn n_of_median(n: f64) -> f64 {
    (n - 1.0) / std::f64::consts::FRAC_PI_2 + 1.0
}

/// Root mean square of the residuals, weighed, mm; NaN of none.
fn weighted_noise_mm(seen: &[Seen], weights: &[f64]) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    for (s, w) in seen.iter().zip(weights) {
        if let Some(r) = s.residual {
            sum += w;
            squares += w * r * r;
        }
    }
    (squares / sum).sqrt()
}

/// Mean residual of every patch and how many points it has.
fn patch_means(seen: &[Seen], patches: &[Vec<u32>]) -> Vec<Option<(f64, f64)>> {
    seen.iter()
        .zip(patches)
        .map(|(s, patch)| {
            let r = s.residual?;
            let (mut n, mut sum) = (1.0, r);
            for &j in patch {
                if let Some(r) = seen[j as usize].residual {
                    n += 1.0;
                    sum += r;
                }
            }
            Some((sum / n, n))
        })
        .collect()
}

/// Median residual of every patch and how many points it has.
fn patch_medians(seen: &[Seen], patches: &[Vec<u32>]) -> Vec<Option<(f64, f64)>> {
    let mut residuals = Vec::new();
    seen.iter()
        .zip(patches)
        .map(|(s, patch)| {
            residuals.clear();
            residuals.push(s.residual?);
            residuals.extend(patch.iter().filter_map(|&j| seen[j as usize].residual));
            residuals.sort_unstable_by(f64::total_cmp);
            let n = residuals.len();
            let median = 0.5 * (residuals[(n - 1) / 2] + residuals[n / 2]);
            Some((median, n as f64))
        })
        .collect()
}

/// Density of everything but bone.
fn tissue(r: f64, noise_mm: f64) -> f64 {
    let between = lower_tail(r / noise_mm) - lower_tail((r - THICKEST_MM) / noise_mm);
    between / THICKEST_MM + ELSEWHERE
}

fn normal_equations(seen: &[Seen], weights: &[f64], noise_mm: f64) -> (Matrix6<f64>, Vector6<f64>) {
    let mut information = Matrix6::zeros();
    let mut gradient = Vector6::zeros();
    for (s, &w) in seen.iter().zip(weights) {
        let Some(r) = s.residual else { continue };
        information.ger(w / (noise_mm * noise_mm), &s.row, &s.row, 1.0);
        gradient.axpy(w * r / (noise_mm * noise_mm), &s.row, 1.0);
    }
    (information, gradient)
}

fn solved(information: &Matrix6<f64>, gradient: &Vector6<f64>) -> Vector6<f64> {
    let damped = information + Matrix6::identity() * (DAMPING * information.diagonal().amax());
    let step = damped
        .cholesky()
        .map_or_else(Vector6::zeros, |c| c.solve(gradient));
    let excess = step.norm() / LONGEST;
    if excess > 1.0 { step / excess } else { step }
}

/// Turned by ω about the centre and shifted by t: the step that takes the residuals away.
fn moved(pose: &Isometry3<f64>, step: &Vector6<f64>, center: &Point3<f64>) -> Isometry3<f64> {
    let omega = Vector3::new(step[0], step[1], step[2]) / LEVER_MM;
    let rotation = UnitQuaternion::from_scaled_axis(omega);
    let shift = Vector3::new(step[3], step[4], step[5]) + center.coords - rotation * center.coords;
    let mut moved = Isometry3::from_parts(Translation3::from(shift), rotation) * pose;
    moved.rotation.renormalize();
    moved
}

fn covariance(
    seen: &[Seen],
    weights: &[f64],
    noise_mm: f64,
    center: &Point3<f64>,
) -> Option<PoseCovariance> {
    let mut curvature = Matrix6::zeros();
    let mut scatter = Matrix6::zeros();
    for (s, &w) in seen.iter().zip(weights) {
        let Some(r) = s.residual else { continue };
        let variance = noise_mm * noise_mm;
        curvature.ger(w / variance, &s.row, &s.row, 1.0);
        let g = w * r / variance;
        scatter.ger(g * g, &s.row, &s.row, 1.0);
    }
    let inverse = curvature.cholesky()?.inverse();
    let scaled = inverse * scatter * inverse;
    let scale = Vector6::new(LEVER_MM, LEVER_MM, LEVER_MM, 1.0, 1.0, 1.0).map(|x| 1.0 / x);
    let matrix =
        Matrix6::from_fn(|i, j| 0.5 * (scaled[(i, j)] + scaled[(j, i)]) * scale[i] * scale[j]);
    Some(PoseCovariance {
        matrix,
        center: *center,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share behind of points of which each has all others in its patch.
    fn share(residuals: &[f64], noise_mm: f64) -> f64 {
        let seen: Vec<Seen> = residuals
            .iter()
            .map(|&r| Seen {
                residual: Some(r),
                row: Vector6::zeros(),
            })
            .collect();
        let all = 0..residuals.len() as u32;
        let patches: Vec<Vec<u32>> = all
            .clone()
            .map(|i| all.clone().filter(|&j| j != i).collect())
            .collect();
        behind_share(
            patch_medians(&seen, &patches).into_iter().flatten(),
            noise_mm,
        )
    }

    #[test]
    fn medians_scatter_as_means_of_fewer_numbers() {
        // Variances of medians of n normal numbers.
        for (n, variance) in [(1.0, 1.0), (3.0, 0.4487), (5.0, 0.2868)] {
            let told = 1.0 / n_of_median(n);
            assert!((told / variance - 1.0).abs() < 0.03, "{told} of {n}");
        }
    }

    #[test]
    fn rays_that_just_miss_a_bone_do_not_put_it_behind_and_a_pose_in_front_does() {
        let noise = |k: i32| 0.1 * f64::from(k % 5 - 2);
        let mut edge: Vec<f64> = (0..25).map(noise).collect();
        for far in &mut edge[..6] {
            *far = -6.0;
        }
        assert!(share(&edge, 0.3) <= 0.0, "the end of a process");
        let in_front: Vec<f64> = (0..25).map(|k| noise(k) - 0.8).collect();
        assert!(share(&in_front, 0.3) >= 1.0, "all of it lies behind");
        let on: Vec<f64> = (0..25).map(noise).collect();
        assert!(share(&on, 0.3) <= 0.0, "on the bone");
    }
}
