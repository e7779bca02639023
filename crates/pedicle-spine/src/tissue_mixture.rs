//! Bone among soft tissue: where a camera looked, every point near a bone lies on it or on tissue in
//! front of it, and which is inferred together with the pose.
//!
//! ```text
//! w_i = π N(r̄_i - o; s_i) / p(r̄_i),   p(r̄) = π N(r̄ - o; s) + (1 - π) [Φ(r̄/s) - Φ((r̄ - H)/s)] / H + ε
//! s_i² = σ²/n_i + τ² + (κ σ²)²,   T = argmin Σ_i w_i r_i(T)²
//! ```
//!
//! r are signed distances from the surface, positive in front of it, r̄ their means over patches of n
//! neighbouring points: tissue lies in front over many points, noise on one. Tissue is as likely at every
//! thickness up to H; ε is for everything else. κ σ² are the bumps that noise leaves through the
//! curvature of the bone, o ≤ κ σ² what they add on the whole bone, τ what a pose and a surface of
//! triangles leave. σ, π and o are inferred beside w, in turns with the pose (expectation and maximisation,
//! Dempster, Laird & Rubin 1977), as long as Σ log p(r̄_i)/n_i grows.
//!
//! Points cut off at a distance pull a pose aside; points weighed by what they probably are do so less. The
//! covariance is A⁻¹ B A⁻¹ with A = Σ w a aᵀ / σ² and the scatter B of the gradients.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use pedicle_registration::{PoseCovariance, ReferenceSurface, pose_difference};
use rayon::prelude::*;

use crate::bone::BoneSurface;
use crate::points::PointSet;
use crate::scoring::{MIN_POINTS_A_TASK, UNASSIGNED};
use crate::uncertainty::{density, lower_tail};

/// Tissue thicker than this lies elsewhere, mm.
const THICKEST_MM: f64 = 8.0;
/// Density of everything that is neither bone nor tissue, 1/mm.
const ELSEWHERE: f64 = 2e-3;
/// And this many standard deviations more.
const REACH_IN_SIGMA: f64 = 3.0;
/// The noise along the normals of a bone over that of the sensor, the median of patches.
const SENSOR_TO_SURFACE: f64 = 1.05;
/// Bounds of the noise over that.
const NOISE_RANGE: (f64, f64) = (0.85, 1.25);
/// What the prior of π weighs, in points.
const PRIOR_POINTS: f64 = 6.0;
/// Share of bone where nothing is known.
const FIRST_SHARE: f64 = 0.7;
/// Bounds of π.
const SHARE_RANGE: (f64, f64) = (0.3, 0.98);
/// τ, mm.
const SURFACE_MM: f64 = 0.12;
/// κ, 1/mm: see [`crate::misfit`].
const BUMPS_PER_MM: f64 = 0.25;
/// A single point farther in front than this many standard deviations and this much is tissue, mm.
const FRONT_IN_SIGMA: f64 = 2.5;
const FRONT_FLOOR_MM: f64 = 0.2;
/// Points of a whole patch.
const PATCH_POINTS: f64 = 24.0;
/// Steps of the pose.
const MAX_STEPS: usize = 25;
/// A step shorter than this share of its standard error ends it.
const SHORT: f64 = 0.02;
/// Length that makes a rotation comparable to a shift, mm.
const LEVER_MM: f64 = 25.0;
/// Damping of what the points hardly fix, relative to the largest eigenvalue.
const DAMPING: f64 = 1e-6;
/// Longest step, mm and (times the lever) rad.
const LONGEST: f64 = 2.0;

/// A vertebra fitted to what is probably bone.
#[derive(Debug, Clone)]
pub(crate) struct AmongTissue {
    pub(crate) target_from_source: Isometry3<f64>,
    pub(crate) noise_mm: f64,
    /// The points that are more probably bone than not.
    pub(crate) bare: Vec<u32>,
    /// About the vertebra's centroid in the target frame.
    pub(crate) covariance: PoseCovariance,
}

/// Fits vertebra `v` from a pose that is nearly right to the points that it or no vertebra owns. None if they
/// do not fix it.
///
/// The covariance holds the square of the way from that pose as well: where the choice of points moves the
/// pose, it is not known better than that.
pub(crate) fn among_tissue(
    bone: &BoneSurface,
    v: u8,
    owners: &[u8],
    pose: &Isometry3<f64>,
    (points, sensor_mm): (&PointSet, f64),
) -> Option<AmongTissue> {
    let inverse = pose.inverse();
    let reach_mm = THICKEST_MM + REACH_IN_SIGMA * sensor_mm;
    let own: Vec<u32> = (0..owners.len() as u32)
        .into_par_iter()
        .with_min_len(MIN_POINTS_A_TASK)
        .filter(|&p| [v, UNASSIGNED].contains(&owners[p as usize]))
        .filter(|&p| {
            let local = inverse * points.positions[p as usize];
            (local - bone.centroid()).norm() <= bone.radius_mm() + reach_mm
                && bone.closest_within(&local, reach_mm).is_some()
        })
        .collect();
    let mixture = TissueMixture {
        bone,
        points,
        own: &own,
        sensor_mm: SENSOR_TO_SURFACE * sensor_mm,
    };
    let fit = mixture.fit(pose)?;
    let mut covariance = fit.covariance?;
    let way = pose_difference(pose, &fit.target_from_source, &covariance.center);
    covariance.matrix += way * way.transpose();
    let bare = own.iter().zip(&fit.weights).filter(|(_, w)| **w > 0.5);
    Some(AmongTissue {
        target_from_source: fit.target_from_source,
        noise_mm: fit.noise_mm,
        bare: bare.map(|(p, _)| *p).collect(),
        covariance,
    })
}

/// The points that one bone may own.
struct TissueMixture<'a> {
    bone: &'a BoneSurface,
    points: &'a PointSet,
    /// Indices of the points.
    own: &'a [u32],
    /// Noise of the sensor along the normals, mm.
    sensor_mm: f64,
}

/// A maximum of the likelihood.
struct MixtureFit {
    target_from_source: Isometry3<f64>,
    /// σ, mm.
    noise_mm: f64,
    /// Probability of being bone, of every own point.
    weights: Vec<f64>,
    log_likelihood: f64,
    /// None if the points do not fix the pose.
    covariance: Option<PoseCovariance>,
}

/// What one point sees.
#[derive(Clone, Copy)]
struct Seen {
    /// Signed distance, mm; none if it is out of reach or its normal contradicts.
    residual: Option<f64>,
    /// d residual / d pose, levers in units of [`LEVER_MM`].
    row: Vector6<f64>,
}

impl TissueMixture<'_> {
    /// The maximum that a pose leads to.
    fn fit(&self, start: &Isometry3<f64>) -> Option<MixtureFit> {
        let patches = self.patches();
        let mut pose = *start;
        let mut state = State {
            noise_mm: self.sensor_mm,
            share: FIRST_SHARE,
            offset_mm: 0.0,
        };
        let mut best: Option<MixtureFit> = None;
        for _ in 0..=MAX_STEPS {
            let seen = self.look(&pose);
            let means = patch_means(&seen, &patches);
            let (weights, _) = state.weighed(&seen, &means);
            state = self.state_of(&seen, &means, &weights);
            let (weights, log_likelihood) = state.weighed(&seen, &means);
            state = self.state_of(&seen, &means, &weights);
            if best
                .as_ref()
                .is_some_and(|b| log_likelihood < b.log_likelihood)
            {
                break;
            }
            let (information, gradient) = normal_equations(&seen, &weights, state.noise_mm);
            let step = solved(&information, &gradient);
            let center = pose * self.bone.centroid();
            let covariance = covariance(&seen, &weights, state.noise_mm, &center);
            best = Some(MixtureFit {
                target_from_source: pose,
                noise_mm: state.noise_mm,
                weights,
                log_likelihood,
                covariance,
            });
            let length = step.dot(&(information * step)).sqrt();
            // A NaN ends it as well.
            if length.is_nan() || length <= SHORT {
                break;
            }
            pose = moved(&pose, &step, &center);
        }
        best
    }

    /// σ, the share of bone and the offset that noise leaves, from the weights.
    fn state_of(&self, seen: &[Seen], means: &[Option<(f64, f64)>], weights: &[f64]) -> State {
        let (mut n, mut n_all, mut squares, mut offset) = (0.0, 0.0, 0.0, 0.0);
        for ((s, m), w) in seen.iter().zip(means).zip(weights) {
            if let (Some(r), Some((u, _))) = (s.residual, m) {
                n_all += 1.0;
                n += w;
                squares += w * r * r;
                offset += w * u;
            }
        }
        if n <= 0.0 {
            return State {
                noise_mm: self.sensor_mm,
                share: FIRST_SHARE,
                offset_mm: 0.0,
            };
        }
        let noise_mm = (squares / n).sqrt().clamp(
            NOISE_RANGE.0 * self.sensor_mm,
            NOISE_RANGE.1 * self.sensor_mm,
        );
        let most_mm = BUMPS_PER_MM * noise_mm * noise_mm;
        State {
            noise_mm,
            share: ((n + PRIOR_POINTS * FIRST_SHARE) / (n_all + PRIOR_POINTS))
                .clamp(SHARE_RANGE.0, SHARE_RANGE.1),
            offset_mm: (offset / n).clamp(0.0, most_mm),
        }
    }

    fn look(&self, pose: &Isometry3<f64>) -> Vec<Seen> {
        let inverse = pose.inverse();
        let center = pose * self.bone.centroid();
        let reach_mm = THICKEST_MM + REACH_IN_SIGMA * self.sensor_mm;
        self.own
            .par_iter()
            .with_min_len(MIN_POINTS_A_TASK)
            .map(|&p| {
                let point = self.points.positions[p as usize];
                let local = inverse * point;
                let nothing = Seen {
                    residual: None,
                    row: Vector6::zeros(),
                };
                let Some(hit) = self.bone.closest_within(&local, reach_mm) else {
                    return nothing;
                };
                let normal = pose.rotation * hit.normal;
                if !self.points.agrees(p as usize, &normal) {
                    return nothing;
                }
                let turn = (point - center).cross(&normal) / LEVER_MM;
                Seen {
                    residual: Some((local - hit.point).dot(&hit.normal)),
                    row: Vector6::new(turn.x, turn.y, turn.z, normal.x, normal.y, normal.z),
                }
            })
            .collect()
    }

    /// For every own point the own points of its patch, by their place in the list, without itself.
    fn patches(&self) -> Vec<Vec<u32>> {
        let mut place = vec![u32::MAX; self.points.positions.len()];
        for (i, &p) in self.own.iter().enumerate() {
            place[p as usize] = i as u32;
        }
        self.own
            .iter()
            .map(|&p| {
                let patch = self.points.patches.get(p as usize);
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
    offset_mm: f64,
}

impl State {
    /// w of every point and the likelihood of all patches.
    fn weighed(&self, seen: &[Seen], means: &[Option<(f64, f64)>]) -> (Vec<f64>, f64) {
        let bump_mm = BUMPS_PER_MM * self.noise_mm * self.noise_mm;
        let floor = SURFACE_MM * SURFACE_MM + bump_mm * bump_mm;
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
                let scatter_mm = (self.noise_mm * self.noise_mm / n + floor).sqrt();
                let u = u - self.offset_mm;
                let bone = self.share * density(u / scatter_mm) / scatter_mm;
                let all = bone + (1.0 - self.share) * tissue(u, scatter_mm);
                log_likelihood += all.ln() / n;
                if r > farthest_mm { 0.0 } else { bone / all }
            })
            .collect();
        (weights, log_likelihood)
    }
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

/// s(r).
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
    use pedicle_registration::{RefineOptions, pose_error, refine_on_surface};
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const NOISE_MM: f64 = 0.5;

    /// What is seen from behind of a vertebra, the upper left of it under tissue of 1 to 4 mm; with the
    /// points that are bone.
    fn seen(
        bone: &BoneSurface,
        mesh: &pedicle_mesh::TriMesh,
        pose: &Isometry3<f64>,
    ) -> (PointSet, Vec<bool>) {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut normal_draw = || (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
        let (mut positions, mut normals, mut is_bone) = (Vec::new(), Vec::new(), Vec::new());
        for (p, n) in mesh.vertices().iter().zip(mesh.vertex_normals()).step_by(3) {
            if n.y < 0.3 {
                continue;
            }
            let from_center = p - bone.centroid();
            let tissue_mm = (0.2 * (from_center.x + from_center.z)).clamp(-1.0, 4.0);
            let bare = tissue_mm < 1.0;
            let offset_mm = if bare { 0.0 } else { tissue_mm } + NOISE_MM * normal_draw();
            positions.push(pose * (p + n * offset_mm));
            normals.push(pose.rotation * n);
            is_bone.push(bare);
        }
        let patches = positions
            .iter()
            .map(|p: &Point3<f64>| {
                let mut order: Vec<u32> = (0..positions.len() as u32).collect();
                let far = |q: u32| (positions[q as usize] - p).norm_squared();
                order.sort_by(|&a, &b| far(a).total_cmp(&far(b)));
                order.truncate(24);
                order
            })
            .collect();
        let points = PointSet {
            positions,
            normals,
            is_oriented: true,
            patches,
        };
        (points, is_bone)
    }

    #[test]
    fn tissue_is_told_from_bone_and_does_not_pull() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let truth = Isometry3::new(Vector3::new(4.0, 7.0, -3.0), Vector3::new(0.1, -0.2, 0.3));
        let (points, is_bone) = seen(&bone, mesh, &truth);
        let start =
            truth * Isometry3::new(Vector3::new(0.3, 0.3, -0.2), Vector3::new(0.01, 0.0, -0.01));
        let owners = vec![2; points.positions.len()];
        let found = among_tissue(&bone, 2, &owners, &start, (&points, NOISE_MM)).unwrap();
        let n_bone = found.bare.iter().filter(|&&p| is_bone[p as usize]).count();
        let n_tissue = found.bare.len() - n_bone;
        let all_bone = is_bone.iter().filter(|b| **b).count();
        assert!(
            10 * n_bone > 9 * all_bone,
            "{n_bone} of {all_bone} points of bone are kept"
        );
        let all_tissue = is_bone.len() - all_bone;
        assert!(
            all_tissue > 100 && 5 * n_tissue < all_tissue,
            "{n_tissue} of {all_tissue} of tissue"
        );
        let center = bone.centroid();
        let error = pose_error(&found.target_from_source, &truth, &center);
        let options = RefineOptions {
            max_distance_mm: 4.5 * NOISE_MM,
            ..RefineOptions::default()
        };
        let plain = refine_on_surface(&bone, &points.positions, &start, &options).unwrap();
        let plain = pose_error(&plain.target_from_source, &truth, &center);
        assert!(
            error.translation_mm < 0.2 && error.translation_mm < plain.translation_mm,
            "{error:?}, without telling {plain:?}"
        );
        let chi_squared = found
            .covariance
            .normalized_error_squared(&found.target_from_source, &truth)
            .unwrap();
        assert!(
            chi_squared < 25.0,
            "the covariance is honest: {chi_squared}"
        );
    }

    #[test]
    fn too_few_points_fix_nothing() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let bone = BoneSurface::new(&phantom.vertebrae[0].mesh).unwrap();
        let points = PointSet::default();
        let pose = Isometry3::identity();
        assert!(
            among_tissue(&bone, 0, &[], &pose, (&points, 0.5)).is_none(),
            "no point"
        );
    }
}
