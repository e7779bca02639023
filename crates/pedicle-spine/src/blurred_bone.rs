//! A bone as noise shows it: the density of noisy points, and the pose that makes a target's points likeliest.
//!
//! ```text
//! p(x) = Σ_j w_j N(x; s_j, σ² I)
//! ∇ log p(x) = (m(x) - x) / σ²,   m(x) = Σ_j r_j(x) s_j,   r_j(x) ∝ w_j N(x; s_j, σ² I)
//! T, σ = argmax Σ_i log p(T⁻¹ y_i)
//! ```
//!
//! s_j lie evenly over the bone's surface. Where noise is as large as the detail of the bone, the place closest to a point
//! is seldom the one it shows, and the points lie off the surface on average, but their density is known: it is the
//! surface blurred by the noise (the model of EM-ICP: Granger & Pennec 2002). Its maximum is found by scoring with the information of the
//! points themselves, Σ g gᵀ with g = ∂ log p / ∂(T, σ) (Berndt et al. 1974), whose inverse is the covariance.
//!
//! The w_j are one weight a region of some centimetres, for a target may show a part of the bone or one part more densely:
//! each is the share of the points that its region explains over its share of the area.
//!
//! s and x in the source frame, y and T in the target frame, mm and rad.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, SMatrix, SVector, Translation3, UnitQuaternion,
    Vector3,
};
use pedicle_registration::{PoseCovariance, pose_error};

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::local_shape::tree_of;

/// From this noise on points are fitted to the density, mm: below, the closest places tell as much.
pub(crate) const BLURRED_FROM_MM: f64 = 0.75;
/// More points fix a pose by their closest places just as well, and take long.
pub(crate) const MAX_POINTS: usize = 1500;
/// Places of the surface lie this many σ apart, and there are no fewer or more than so many.
const SPACING_IN_SIGMA: f64 = 1.0;
const N_PLACES: (usize, usize) = (2000, 30_000);
/// Places farther from a point than this many σ do not count.
const REACH_IN_SIGMA: f64 = 3.5;
/// Edges of the regions with one weight, mm.
const REGION_MM: f64 = 25.0;
/// A weight is worth so many points before any is seen.
const PRIOR_POINTS: f64 = 2.0;
/// Steps at most; after the first ones they are halved.
const MAX_STEPS: usize = 50;
const FULL_STEPS: usize = 8;
/// Settled where a step is shorter than this, as the root mean square over the unknowns in standard deviations, and no weight changes by
/// what so many points explain.
const SETTLED: f64 = 0.1;
const SETTLED_POINTS: f64 = 2.0;
/// At least this share of the points lies within reach of a place.
const LEAST_SHOWN: f64 = 0.9;
/// Information on the logarithm of a weight that no point tells, points.
const RIDGE_POINTS: f64 = 0.1;
/// σ changes by this share of itself at most in a step.
const MAX_CHANGE_OF_SIGMA: f64 = 0.2;
/// A pose farther than this from the start is not the one that the fits before it found, mm and rad.
const MAX_CHANGE: (f64, f64) = (5.0, 0.3);
/// Unknowns: turn, shift, σ.
pub(crate) const N_FREE: usize = 7;

pub(crate) type Free = SVector<f64, N_FREE>;

/// The places of a bone and the regions they belong to.
pub(crate) struct BlurredBone {
    pub(crate) places: Vec<Point3<f64>>,
    tree: ImmutableKdTree<f64, 3>,
    region: Vec<u32>,
    /// Share of the places in every region.
    share: Vec<f64>,
    center: Point3<f64>,
}

/// The noise and the weights of the regions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Blur {
    pub(crate) sigma_mm: f64,
    weights: Vec<f64>,
}

/// The likeliest pose.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BlurredFit {
    pub(crate) target_from_source: Isometry3<f64>,
    /// About the bone's centroid in the target frame.
    pub(crate) covariance: PoseCovariance,
    pub(crate) blur: Blur,
}

/// What a point says of the pose and of σ: the derivative of its log density by turn and shift of the bone about a centre in
/// the target frame, and by σ.
pub(crate) fn derivative(
    pull_mm: &Vector3<f64>,
    square_mm2: f64,
    arm_mm: &Vector3<f64>,
    sigma_mm: f64,
) -> Free {
    let force = pull_mm / (sigma_mm * sigma_mm);
    let turn = -arm_mm.cross(&force);
    let by_sigma = (square_mm2 / (sigma_mm * sigma_mm) - 3.0) / sigma_mm;
    Free::from_column_slice(&[
        turn.x, turn.y, turn.z, -force.x, -force.y, -force.z, by_sigma,
    ])
}

impl BlurredBone {
    /// For noise of about this size.
    pub(crate) fn new(
        bone: &BoneSurface,
        area_mm2: f64,
        sigma_mm: f64,
    ) -> Result<Self, SpineError> {
        let spacing_mm = SPACING_IN_SIGMA * sigma_mm;
        let n = (area_mm2 / (spacing_mm * spacing_mm)) as usize;
        let places = bone.spread_points(n.clamp(N_PLACES.0, N_PLACES.1));
        let mut keys: Vec<[i64; 3]> = Vec::new();
        let mut n_in: Vec<usize> = Vec::new();
        let region = places
            .iter()
            .map(|p| {
                let cell = (p - bone.centroid()) / REGION_MM;
                let key: [i64; 3] = cell.map(|x| x.floor() as i64).into();
                let known = keys.iter().position(|k| *k == key);
                let r = known.unwrap_or_else(|| {
                    keys.push(key);
                    n_in.push(0);
                    keys.len() - 1
                });
                n_in[r] += 1;
                r as u32
            })
            .collect();
        Ok(Self {
            tree: tree_of(&places)?,
            region,
            share: n_in
                .iter()
                .map(|&n| n as f64 / places.len() as f64)
                .collect(),
            places,
            center: bone.centroid(),
        })
    }

    /// How probably each place near a point is the one it shows: places and probabilities whose sum is 1, or none if
    /// all lie too far.
    pub(crate) fn shown_by(&self, x: &Point3<f64>, blur: &Blur, found: &mut Vec<(u32, f64)>) {
        found.clear();
        let row: [f64; 3] = x.coords.into();
        let variance = blur.sigma_mm * blur.sigma_mm;
        let within = REACH_IN_SIGMA * REACH_IN_SIGMA * variance;
        let near = self
            .tree
            .query(&row)
            .within::<SquaredEuclidean<f64>>(within)
            .unsorted()
            .execute();
        let mut sum = 0.0;
        for item in near {
            let j = item.item;
            let weight = blur.weights[self.region[j as usize] as usize];
            let r = weight * (-0.5 * item.distance / variance).exp();
            sum += r;
            found.push((j, r));
        }
        if sum > 0.0 {
            found.iter_mut().for_each(|(_, r)| *r /= sum);
        } else {
            found.clear();
        }
    }

    /// Where the places shown by a point lie from it on average, and the mean square of their distances.
    pub(crate) fn pull(&self, x: &Point3<f64>, shown: &[(u32, f64)]) -> (Vector3<f64>, f64) {
        let (mut pull_mm, mut square_mm2) = (Vector3::zeros(), 0.0);
        for &(j, r) in shown {
            let d = self.places[j as usize] - x;
            pull_mm += d * r;
            square_mm2 += r * d.norm_squared();
        }
        (pull_mm, square_mm2)
    }

    /// The likeliest pose of the points, from one that is nearly right. None if they do not fix it, if it is not found in time, and if
    /// too many lie far from the bone.
    pub(crate) fn fit(
        &self,
        start: &Isometry3<f64>,
        points: &[Point3<f64>],
        noise_mm: f64,
    ) -> Option<BlurredFit> {
        let mut pose = *start;
        let mut blur = Blur {
            sigma_mm: noise_mm,
            weights: vec![1.0; self.share.len()],
        };
        let mut shown = Vec::new();
        for k in 0..MAX_STEPS {
            let mut n_shown = 0;
            let inverse = pose.inverse();
            let center = pose * self.center;
            let mut information = SMatrix::<f64, N_FREE, N_FREE>::zeros();
            let mut score = Free::zeros();
            let mut explained = vec![0.0; self.share.len()];
            for y in points {
                let x = inverse * y;
                self.shown_by(&x, &blur, &mut shown);
                if shown.is_empty() {
                    continue;
                }
                n_shown += 1;
                for &(j, r) in &shown {
                    explained[self.region[j as usize] as usize] += r;
                }
                let (pull_mm, square_mm2) = self.pull(&x, &shown);
                let pull_mm = pose.rotation * pull_mm;
                let g = derivative(&pull_mm, square_mm2, &(y - center), blur.sigma_mm);
                information.ger(1.0, &g, &g, 1.0);
                score += g;
            }
            let covariance = information.cholesky()?.inverse();
            // Full steps may go to and fro between two poses.
            let damped = if k < FULL_STEPS { 1.0 } else { 0.5 };
            let step = covariance * score * damped;
            let (turn, shift) = (
                step.fixed_rows::<3>(0).into_owned(),
                step.fixed_rows::<3>(3).into_owned(),
            );
            let about = Translation3::from(center.coords + shift)
                * UnitQuaternion::from_scaled_axis(turn)
                * Translation3::from(-center.coords);
            pose = about * pose;
            let most = MAX_CHANGE_OF_SIGMA * blur.sigma_mm;
            blur.sigma_mm += step[6].clamp(-most, most);
            let changed_points = self.weigh(&mut blur, &explained, points.len());
            let change = pose_error(&pose, start, &self.center);
            let is_near =
                change.translation_mm <= MAX_CHANGE.0 && change.rotation_rad <= MAX_CHANGE.1;
            if !is_near || (n_shown as f64) < LEAST_SHOWN * points.len() as f64 {
                return None;
            }
            let is_settled = score.dot(&step) <= SETTLED * SETTLED * N_FREE as f64;
            if is_settled && changed_points <= SETTLED_POINTS {
                return Some(BlurredFit {
                    target_from_source: pose,
                    covariance: self.covariance(&pose, &blur, points)?,
                    blur,
                });
            }
        }
        None
    }

    /// The inverse information of the points where the weights are unknown as well as pose and σ.
    fn covariance(
        &self,
        pose: &Isometry3<f64>,
        blur: &Blur,
        points: &[Point3<f64>],
    ) -> Option<PoseCovariance> {
        let inverse = pose.inverse();
        let center = pose * self.center;
        let total: f64 = blur
            .weights
            .iter()
            .zip(&self.share)
            .map(|(w, s)| w * s)
            .sum();
        let expected: Vec<f64> = blur
            .weights
            .iter()
            .zip(&self.share)
            .map(|(w, s)| w * s / total)
            .collect();
        let n = N_FREE + expected.len();
        let mut information = DMatrix::<f64>::zeros(n, n);
        let mut g = DVector::<f64>::zeros(n);
        let mut shown = Vec::new();
        for y in points {
            let x = inverse * y;
            self.shown_by(&x, blur, &mut shown);
            if shown.is_empty() {
                continue;
            }
            let (pull_mm, square_mm2) = self.pull(&x, &shown);
            let pull_mm = pose.rotation * pull_mm;
            let free = derivative(&pull_mm, square_mm2, &(y - center), blur.sigma_mm);
            g.fixed_rows_mut::<N_FREE>(0).copy_from(&free);
            for (r, expected) in expected.iter().enumerate() {
                g[N_FREE + r] = -expected;
            }
            for &(j, r) in &shown {
                g[N_FREE + self.region[j as usize] as usize] += r;
            }
            information.ger(1.0, &g, &g, 1.0);
        }
        for r in N_FREE..n {
            information[(r, r)] += RIDGE_POINTS;
        }
        let covariance = information.cholesky()?.inverse();
        let matrix: Matrix6<f64> = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        Some(PoseCovariance { matrix, center })
    }

    /// The weights of the regions, from how many points each explains; by how many points the one that changes most does.
    fn weigh(&self, blur: &mut Blur, explained: &[f64], n_points: usize) -> f64 {
        let mut most = 0.0;
        for ((weight, explained), share) in blur.weights.iter_mut().zip(explained).zip(&self.share)
        {
            let before = if *weight < 1.0 { *weight } else { 1.0 };
            let expected = share * n_points as f64;
            let after = (explained + PRIOR_POINTS * before) / (expected + PRIOR_POINTS);
            let change = (after - *weight).abs() * expected;
            most = if change > most { change } else { most };
            *weight = after;
        }
        most
    }

    /// Points drawn from the density, evenly over the weighed surface.
    pub(crate) fn drawn(
        &self,
        blur: &Blur,
        n: usize,
        mut noise: impl FnMut() -> Vector3<f64>,
    ) -> Vec<Point3<f64>> {
        let weight = |j: usize| blur.weights[self.region[j] as usize];
        let total: f64 = (0..self.places.len()).map(weight).sum();
        let step = total / n.max(1) as f64;
        let (mut behind, mut next) = (0.0, 0.5 * step);
        let mut points = Vec::with_capacity(n);
        for (j, place) in self.places.iter().enumerate() {
            behind += weight(j);
            while next < behind && points.len() < n {
                points.push(place + noise() * blur.sigma_mm);
                next += step;
            }
        }
        points
    }

    pub(crate) fn center(&self) -> Point3<f64> {
        self.center
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_registration::{RefineOptions, refine_on_surface};
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    const SIGMA_MM: f64 = 2.0;

    /// Mean squares of the errors over their standard deviations, and sums of squares of errors (mm², rad²): of the likeliest
    /// poses, and of the fits to the closest places that they start from.
    struct Errors {
        normalized: f64,
        likeliest: (f64, f64),
        closest: (f64, f64),
        sigma_mm: f64,
    }

    /// Fits noisy points of a lumbar vertebra of which a share of the faces is seen, several times.
    fn errors(is_seen: impl Fn(&Vector3<f64>) -> bool, n_points: usize) -> Errors {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred = BlurredBone::new(&bone, mesh.area(), SIGMA_MM).unwrap();
        let truth = Isometry3::new(Vector3::new(4.0, 60.0, -9.0), Vector3::new(0.2, -0.4, 0.3));
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let options = RefineOptions {
            max_distance_mm: 10.0,
            start_distance_mm: None,
            ..RefineOptions::default()
        };
        let n_draws = 40;
        let mut sum = Errors {
            normalized: 0.0,
            likeliest: (0.0, 0.0),
            closest: (0.0, 0.0),
            sigma_mm: 0.0,
        };
        for draw in 0..n_draws {
            // Vertices, and not the places of the density.
            let step = mesh.n_vertices() / n_points;
            let points: Vec<Point3<f64>> = mesh
                .vertices()
                .iter()
                .skip(draw % step)
                .step_by(step)
                .filter(|p| is_seen(&(*p - bone.centroid())))
                .map(|p| {
                    let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng));
                    truth * (p + noise * SIGMA_MM)
                })
                .collect();
            let closest = refine_on_surface(&bone, &points, &truth, &options).unwrap();
            let found = blurred
                .fit(&closest.target_from_source, &points, closest.noise_mm)
                .unwrap();
            let center = bone.centroid();
            for (pose, sum) in [
                (&found.target_from_source, &mut sum.likeliest),
                (&closest.target_from_source, &mut sum.closest),
            ] {
                let error = pose_error(pose, &truth, &center);
                sum.0 += error.translation_mm.powi(2);
                sum.1 += error.rotation_rad.powi(2);
            }
            let squared = found
                .covariance
                .normalized_error_squared(&found.target_from_source, &truth)
                .unwrap();
            sum.normalized += squared / 6.0 / n_draws as f64;
            sum.sigma_mm += found.blur.sigma_mm / n_draws as f64;
        }
        sum
    }

    #[test]
    fn the_likeliest_pose_is_nearer_than_that_of_the_closest_places_and_knows_its_error() {
        let whole = errors(|_| true, 400);
        assert!(
            whole.likeliest.0 < whole.closest.0 && whole.likeliest.1 < 0.95 * whole.closest.1,
            "{:?} against {:?}",
            whole.likeliest,
            whole.closest
        );
        assert!(
            (0.6..1.4).contains(&whole.normalized),
            "normalised error squared over 6 is {}",
            whole.normalized
        );
        assert!(
            (whole.sigma_mm - SIGMA_MM).abs() < 0.1,
            "a noise of {} mm",
            whole.sigma_mm
        );
    }

    #[test]
    fn a_part_that_is_not_seen_does_not_draw_the_pose_to_it() {
        let back = errors(|p| p.y > 0.0, 400);
        assert!(
            (0.6..1.5).contains(&back.normalized),
            "normalised error squared over 6 is {}",
            back.normalized
        );
        assert!(
            back.likeliest.0 < 1.1 * back.closest.0,
            "{:?} against {:?}",
            back.likeliest,
            back.closest
        );
    }

    #[test]
    fn points_that_fix_nothing_have_no_fit() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred = BlurredBone::new(&bone, mesh.area(), SIGMA_MM).unwrap();
        let start = Isometry3::identity();
        let far = vec![bone.centroid() + Vector3::new(0.0, 0.0, 500.0); 100];
        assert_eq!(blurred.fit(&start, &far, SIGMA_MM), None, "far away");
        assert_eq!(blurred.fit(&start, &[], SIGMA_MM), None, "no points");
    }
}
