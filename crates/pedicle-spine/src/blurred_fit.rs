//! The pose that makes a target's noisy points likeliest.
//!
//! ```text
//! T, σ, w, b, a = argmax Σ_i log p(T⁻¹ y_i)
//! ```
//!
//! p is the density of [`crate::blurred_bone`]. Its maximum is found by scoring with the information of the
//! points themselves, Σ g gᵀ with g = ∂ log p / ∂(T, σ, b, a) (Berndt et al. 1974); the inverse of it, the weights among the unknowns, is
//! the covariance.
//!
//! Where points face ([`crate::facing`]) tells which places they show, and no more: that the normals turn with the pose is left out of g, and ε is no unknown of the covariance, so that with
//! normals neither is exact. How honest it is then is measured (docs/verdict.md).
//!
//! y and T in the target frame, mm and rad.

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, SMatrix, SVector, Translation3, UnitQuaternion,
};
use pedicle_registration::{PoseCovariance, pose_error};

use crate::blurred_bone::{Blur, BlurredBone, Free, N_FREE, RIDGE_POINTS, Said};
use crate::deformation::RIDGE_OF_BENDS_POINTS;
use crate::facing::{FacingPoint, share_facing_away};
use crate::seen_edge::{N_EDGE, OfEdge, RIDGE_OF_EDGE};

/// A weight is worth so many points before any is seen.
const PRIOR_POINTS: f64 = 2.0;
/// The same, at most, where the points show that all weights are alike.
const MAX_PRIOR_POINTS: f64 = 40.0;
/// A region that would show fewer points by its share of the area does not tell whether it is seen.
const MIN_EXPECTED: f64 = 5.0;
/// One that shows less than this part of them is not seen, or not wholly.
const LEAST_OF_SHARE: f64 = 0.5;
/// Steps at most; after the first ones they are halved.
const MAX_STEPS: usize = 50;
const FULL_STEPS: usize = 8;
/// Settled where a step is shorter than this, as the root mean square over the unknowns in standard deviations, and no weight changes by
/// what so many points explain.
const SETTLED: f64 = 0.1;
const SETTLED_POINTS: f64 = 2.0;
/// At least this share of the points lies within reach of a place.
const LEAST_SHOWN: f64 = 0.9;
/// σ changes by this share of itself at most in a step.
const MAX_CHANGE_OF_SIGMA: f64 = 0.2;
/// A pose farther than this from the start is not the one that the fits before it found, mm and rad.
const MAX_CHANGE: (f64, f64) = (5.0, 0.3);

/// An edge of what is seen makes the points likelier by this at least, as a logarithm: it has four numbers, and a course that is chosen.
const LEAST_GAIN_OF_EDGE: f64 = 2.0;
/// Fewer regions than this above one do not tell whether all are alike.
const LEAST_FREEDOM: f64 = 5.0;

/// Unknowns of a step: turn, shift, σ, the edge, and how points crowd.
const N_STEP: usize = N_FREE + N_EDGE + 1;
/// Number of how points crowd among them.
const CROWDING: usize = N_FREE + N_EDGE;
/// That changes by this in a step at most.
const MAX_CHANGE_OF_CROWDING: f64 = 0.3;
/// Derivatives by them.
type OfStep = SVector<f64, N_STEP>;

/// The likeliest pose.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BlurredFit {
    pub(crate) target_from_source: Isometry3<f64>,
    /// About the bone's centroid in the target frame.
    pub(crate) covariance: PoseCovariance,
    pub(crate) blur: Blur,
}

impl BlurredBone {
    /// The likeliest pose of the points, from one that is nearly right. None if they do not fix it, if it is not found in time, and if
    /// too many lie far from the bone.
    pub(crate) fn fit(
        &self,
        start: &Isometry3<f64>,
        points: &[FacingPoint],
        noise_mm: f64,
    ) -> Option<BlurredFit> {
        self.fitted(start, points, (noise_mm, None))
    }

    /// The same if points may crowd where the bone bends: poses are not better for it, but what is left tells more of the bone's shape.
    pub(crate) fn fit_crowded(
        &self,
        start: &Isometry3<f64>,
        points: &[FacingPoint],
        noise_mm: f64,
    ) -> Option<BlurredFit> {
        self.fitted(start, points, (noise_mm, Some(0.0)))
    }

    fn fitted(
        &self,
        start: &Isometry3<f64>,
        points: &[FacingPoint],
        begin: (f64, Option<f64>),
    ) -> Option<BlurredFit> {
        let (mut pose, mut blur) = self.fit_to_what_is_seen(start, points, begin)?;
        let mut ridge_points = RIDGE_POINTS;
        if let Some(alike_points) = self.alike_points(&pose, &blur, points) {
            let again = (&pose, blur.clone());
            if let Some(found) = self.settled(start, again, points, Some(alike_points)) {
                (pose, blur) = found;
                ridge_points = alike_points;
            }
        }
        Some(BlurredFit {
            target_from_source: pose,
            covariance: self.covariance(&pose, (&blur, ridge_points), points)?,
            blur,
        })
    }

    /// The likeliest pose where all weights are free: with an edge of what is seen, if there is one and it makes the points likelier by far.
    fn fit_to_what_is_seen(
        &self,
        start: &Isometry3<f64>,
        points: &[FacingPoint],
        (noise_mm, crowding): (f64, Option<f64>),
    ) -> Option<(Isometry3<f64>, Blur)> {
        let settled = |edge| {
            let blur = Blur {
                crowding,
                ..self.even(noise_mm, edge)
            };
            self.settled(start, (start, blur), points, None)
        };
        let Some(edge) = self.found_edge(start, noise_mm, points) else {
            return settled(None);
        };
        match (settled(None), settled(Some(edge))) {
            (Some(without), Some(with)) => {
                let likely = |(pose, blur): &(Isometry3<f64>, Blur)| {
                    let inverse = pose.inverse();
                    self.log_likelihood(points.iter().map(|y| y.placed(&inverse)), blur)
                };
                let gain = likely(&with) - likely(&without);
                Some(if gain > LEAST_GAIN_OF_EDGE {
                    with
                } else {
                    without
                })
            }
            (without, with) => without.or(with),
        }
    }

    /// How many points a weight is worth before any is seen where all are alike: where no region shows far fewer points than its share of the
    /// area, and all are scattered about their shares no more than chance scatters them. None elsewhere.
    fn alike_points(
        &self,
        pose: &Isometry3<f64>,
        blur: &Blur,
        points: &[FacingPoint],
    ) -> Option<f64> {
        let flat = Blur {
            weights: vec![1.0; self.n_regions()],
            ..blur.clone()
        };
        let shares = self.shares(&flat);
        let inverse = pose.inverse();
        let mut explained = vec![0.0; self.n_regions()];
        let local = points.iter().map(|y| y.placed(&inverse));
        let n_shown = self.each_said(local, &flat, |said| {
            self.add_regions(said.shown, &mut explained);
        });
        let (mut scatter, mut n_judged) = (0.0, 0);
        for (explained, share) in explained.iter().zip(&shares) {
            let expected = share * n_shown as f64;
            if expected < MIN_EXPECTED {
                continue;
            }
            if *explained < LEAST_OF_SHARE * expected {
                return None;
            }
            scatter += (explained - expected).powi(2) / expected;
            n_judged += 1;
        }
        let freedom = f64::from(n_judged) - 1.0;
        if freedom < LEAST_FREEDOM || scatter > freedom + 2.0 * (2.0 * freedom).sqrt() {
            return None;
        }
        let more = scatter / freedom - 1.0;
        let mean = n_shown as f64 / self.n_regions() as f64;
        let least = mean / MAX_PRIOR_POINTS;
        let worth = mean / if more > least { more } else { least };
        (worth > PRIOR_POINTS).then_some(worth)
    }

    /// The likeliest pose from one that is nearly right, and not far from where all began.
    fn settled(
        &self,
        start: &Isometry3<f64>,
        (pose, mut blur): (&Isometry3<f64>, Blur),
        points: &[FacingPoint],
        alike_points: Option<f64>,
    ) -> Option<(Isometry3<f64>, Blur)> {
        let mut pose = *pose;
        for k in 0..MAX_STEPS {
            let inverse = pose.inverse();
            let mut information = SMatrix::<f64, N_STEP, N_STEP>::zeros();
            let mut score = OfStep::zeros();
            let mean = (self.mean_by_edge(&blur), self.mean_crowded(&blur));
            let mut explained = vec![0.0; self.n_regions()];
            let mut away = (0.0, 0.0);
            let n_shown =
                self.each_said(points.iter().map(|y| y.placed(&inverse)), &blur, |said| {
                    self.add_regions(said.shown, &mut explained);
                    if let Some(facing_away) = self.facing_away(said, &blur) {
                        away = (away.0 + facing_away, away.1 + 1.0);
                    }
                    let all = self.said_of_step(said, &blur, &mean);
                    information.ger(1.0, &all, &all, 1.0);
                    score += all;
                });
            let moved = blur
                .edge
                .as_ref()
                .map_or(OfEdge::zeros(), |edge| edge.moved);
            for (k, moved) in (N_FREE..CROWDING).zip(moved.iter()) {
                information[(k, k)] += RIDGE_OF_EDGE;
                score[k] -= RIDGE_OF_EDGE * moved;
            }
            information[(CROWDING, CROWDING)] += RIDGE_OF_BENDS_POINTS;
            score[CROWDING] -= RIDGE_OF_BENDS_POINTS * blur.crowding.unwrap_or(0.0);
            let whole_step = information.cholesky()?.solve(&score);
            // Full steps may go to and fro between two poses.
            let step = whole_step * if k < FULL_STEPS { 1.0 } else { 0.5 };
            pose *= self.moved_by(&step.fixed_rows::<N_FREE>(0).into_owned());
            let of_edge = step.fixed_rows::<N_EDGE>(N_FREE).into_owned();
            blur.edge = blur.edge.map(|edge| self.edge_moved(edge, &of_edge));
            let most = MAX_CHANGE_OF_CROWDING;
            self.crowd(&mut blur, step[CROWDING].clamp(-most, most));
            let most = MAX_CHANGE_OF_SIGMA * blur.sigma_mm;
            blur.sigma_mm += step[6].clamp(-most, most);
            let facing_away = share_facing_away(away);
            let turned_points = (facing_away - blur.facing_away).abs() * away.1;
            blur.facing_away = facing_away;
            let changed_points = self.weigh(&mut blur, &explained, (points.len(), alike_points));
            let change = pose_error(&pose, start, &self.center);
            let is_near =
                change.translation_mm <= MAX_CHANGE.0 && change.rotation_rad <= MAX_CHANGE.1;
            if !is_near || (n_shown as f64) < LEAST_SHOWN * points.len() as f64 {
                return None;
            }
            let n_edge = if blur.edge.is_some() { N_EDGE } else { 0 };
            let n_free = N_FREE + n_edge + usize::from(blur.crowding.is_some());
            let is_settled = score.dot(&whole_step) <= SETTLED * SETTLED * n_free as f64;
            if is_settled && changed_points <= SETTLED_POINTS && turned_points <= SETTLED_POINTS {
                return Some((pose, blur));
            }
        }
        None
    }

    /// What a point says of turn, shift, σ, the edge and how points crowd, given the means over the density of what places say of these.
    fn said_of_step(
        &self,
        said: &Said<'_>,
        blur: &Blur,
        (mean_by_edge, mean_crowded): &(OfEdge, f64),
    ) -> OfStep {
        let of_edge = self.said_of_edge(blur, said.shown, mean_by_edge);
        let mut all = OfStep::zeros();
        all.fixed_rows_mut::<N_FREE>(0).copy_from(&said.free);
        all.fixed_rows_mut::<N_EDGE>(N_FREE).copy_from(&of_edge);
        all[CROWDING] = self.said_of_crowding(blur, said.shown, *mean_crowded);
        all
    }

    /// A turn about the centroid, then a shift.
    fn moved_by(&self, step: &Free) -> Isometry3<f64> {
        let turn = step.fixed_rows::<3>(0).into_owned();
        let shift = step.fixed_rows::<3>(3).into_owned();
        Translation3::from(self.center.coords + shift)
            * UnitQuaternion::from_scaled_axis(turn)
            * Translation3::from(-self.center.coords)
    }

    /// The inverse information of the points where edge, crowding and weights are unknown as well as pose and σ.
    fn covariance(
        &self,
        pose: &Isometry3<f64>,
        (blur, ridge_points): (&Blur, f64),
        points: &[FacingPoint],
    ) -> Option<PoseCovariance> {
        let inverse = pose.inverse();
        let by_weights = -DVector::from_vec(self.expected(blur));
        let n = N_STEP + by_weights.len();
        let mean = (self.mean_by_edge(blur), self.mean_crowded(blur));
        let mut information = DMatrix::<f64>::zeros(n, n);
        let mut g = DVector::<f64>::zeros(n);
        self.each_said(points.iter().map(|y| y.placed(&inverse)), blur, |said| {
            let of_step = self.said_of_step(said, blur, &mean);
            g.fixed_rows_mut::<N_STEP>(0).copy_from(&of_step);
            g.rows_mut(N_STEP, n - N_STEP).copy_from(&by_weights);
            self.add_regions(said.shown, &mut g.as_mut_slice()[N_STEP..]);
            information.ger(1.0, &g, &g, 1.0);
        });
        for number in N_FREE..n {
            information[(number, number)] += match number {
                0..CROWDING => RIDGE_OF_EDGE,
                CROWDING => RIDGE_OF_BENDS_POINTS,
                _ => ridge_points,
            };
        }
        let of_all = information.cholesky()?.inverse();
        let of_pose: Matrix6<f64> = of_all.fixed_view::<6, 6>(0, 0).into_owned();
        let rotation = pose.rotation.to_rotation_matrix();
        let mut turned = Matrix6::zeros();
        for block in [0, 3] {
            let mut part = turned.fixed_view_mut::<3, 3>(block, block);
            part.copy_from(rotation.matrix());
        }
        Some(PoseCovariance {
            matrix: turned * of_pose * turned.transpose(),
            center: pose * self.center,
        })
    }

    /// The weights of the regions, from how many points each explains; by how many points the one that changes most does.
    fn weigh(
        &self,
        blur: &mut Blur,
        explained: &[f64],
        (n_points, alike_points): (usize, Option<f64>),
    ) -> f64 {
        let prior_points = alike_points.unwrap_or(PRIOR_POINTS);
        let mut most = 0.0;
        let shares = self.shares(blur);
        for ((weight, explained), share) in blur.weights.iter_mut().zip(explained).zip(&shares) {
            // A region that is not seen stays so, unless all are alike.
            let is_free = alike_points.is_none() && *weight < 1.0;
            let before = if is_free { *weight } else { 1.0 };
            let expected = share * n_points as f64;
            let after = (explained + prior_points * before) / (expected + prior_points);
            let change = (after - *weight).abs() * expected;
            most = if change > most { change } else { most };
            *weight = after;
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bends::{Bends, CROWDED};
    use crate::bone::BoneSurface;
    use nalgebra::{Point3, Vector3};
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
        let blurred =
            BlurredBone::new((&bone, &Bends::of(&bone).unwrap()), mesh.area(), SIGMA_MM).unwrap();
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
            let facing: Vec<FacingPoint> = points.into_iter().map(FacingPoint::of).collect();
            let found = blurred
                .fit(&closest.target_from_source, &facing, closest.noise_mm)
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
    fn where_a_target_ends_hardly_draws_the_pose() {
        for cut_mm in [6.0, 15.0] {
            let found = errors(|p| p.y > -cut_mm, 400);
            assert!(
                (0.6..1.35).contains(&found.normalized),
                "normalised error squared over 6 is {} at {cut_mm} mm",
                found.normalized
            );
            assert!(
                found.likeliest.0 < found.closest.0 && found.likeliest.1 < 0.9 * found.closest.1,
                "{:?} against {:?} at {cut_mm} mm",
                found.likeliest,
                found.closest
            );
        }
    }

    #[test]
    fn weights_are_alike_where_all_of_a_bone_is_seen_and_no_part_is_taken_for_seen() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred =
            BlurredBone::new((&bone, &Bends::of(&bone).unwrap()), mesh.area(), SIGMA_MM).unwrap();
        let pose = Isometry3::identity();
        let mut rng = ChaCha8Rng::seed_from_u64(17);
        let mut alike = |n: usize, is_seen: &dyn Fn(&Vector3<f64>) -> bool| {
            let noise = |rng: &mut ChaCha8Rng| {
                Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(rng) }) * SIGMA_MM
            };
            let seen = bone.spread_points(n).into_iter();
            let seen = seen.filter(|p| is_seen(&(p - bone.centroid())));
            let points: Vec<FacingPoint> =
                seen.map(|p| FacingPoint::of(p + noise(&mut rng))).collect();
            blurred.alike_points(&pose, &blurred.even(SIGMA_MM, None), &points)
        };
        for n in [100, 400, 1500] {
            let whole = alike(n, &|_| true);
            assert!(whole.is_some_and(|points| points >= 10.0), "{n}: {whole:?}");
            let front_cut = alike(n, &|p| p.y > -15.0);
            assert_eq!(front_cut, None, "{n}: the front is not seen");
            assert_eq!(alike(n, &|p| p.y > 0.0), None, "{n}: half is seen");
        }
        // A quarter is cut away: the covariance has to know that.
        let most = errors(|p| p.y > -15.0, 400);
        assert!(
            (0.6..1.5).contains(&most.normalized),
            "normalised error squared over 6 is {}",
            most.normalized
        );
    }

    #[test]
    fn points_that_fix_nothing_have_no_fit() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let blurred =
            BlurredBone::new((&bone, &Bends::of(&bone).unwrap()), mesh.area(), SIGMA_MM).unwrap();
        let start = Isometry3::identity();
        let far = FacingPoint::of(bone.centroid() + Vector3::new(0.0, 0.0, 500.0));
        let far = vec![far; 100];
        assert_eq!(blurred.fit(&start, &far, SIGMA_MM), None, "far away");
        assert_eq!(blurred.fit(&start, &[], SIGMA_MM), None, "no points");
    }

    #[test]
    fn points_that_crowd_where_a_bone_bends_are_told_from_points_that_do_not() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let mesh = &phantom.vertebrae[2].mesh;
        let bone = BoneSurface::new(mesh).unwrap();
        let bends = Bends::of(&bone).unwrap();
        let blurred = BlurredBone::new((&bone, &bends), mesh.area(), SIGMA_MM).unwrap();
        let pose = Isometry3::new(Vector3::new(4.0, 60.0, -9.0), Vector3::new(0.2, -0.4, 0.3));
        let crowding = |wanted: f64| {
            let mut rng = ChaCha8Rng::seed_from_u64(12);
            let most = (3.0 * wanted).exp();
            let places = bone.spread_points(6000).into_iter().enumerate();
            let kept = places.filter(|(i, p)| {
                let density = (wanted * bends.at(p)[CROWDED]).exp() / most;
                *i as f64 * 0.618_034 % 1.0 < density
            });
            let noisy = kept.take(700).map(|(_, p)| {
                let noise = Vector3::from_fn(|_, _| -> f64 { StandardNormal.sample(&mut rng) });
                FacingPoint::of(pose * (p + noise * SIGMA_MM))
            });
            let points: Vec<FacingPoint> = noisy.collect();
            let plain = blurred.fit(&pose, &points, SIGMA_MM).unwrap();
            assert_eq!(plain.blur.crowding, None, "not asked for");
            let found = blurred.fit_crowded(&pose, &points, SIGMA_MM).unwrap();
            found.blur.crowding.unwrap()
        };
        let (even, crowded) = (crowding(0.0), crowding(0.5));
        assert!(even.abs() < 0.15, "{even} of even points");
        assert!((crowded - 0.5).abs() < 0.2, "{crowded} for 0.5");
    }
}
