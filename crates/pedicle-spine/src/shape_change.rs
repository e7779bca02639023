//! Whose bones a target shows where noise hides every bump.
//!
//! ```text
//! g_i = ∂ log p(x_i) / ∂(T, σ, w, e),   s → s + u_e(s),   e ~ N(0, I)
//! log B = ½ sᵀ (I + G)⁻¹ s - ½ log det (I + G),   s = Σ_i g_i
//! ```
//!
//! p is the density of noisy points of the bone ([`crate::blurred_bone`]), u a smooth displacement of its surface as one person's bones are displaced
//! against another's ([`crate::shape_basis`]). G and s are information and score of e once pose, σ and the weights of places are taken out; the
//! information is that of points drawn from p. B is the Bayes factor: by how much likelier the points are if the bones are some other person's
//! than if they are the plan's (Kass & Raftery 1995; to second order about no displacement, as in the score test of Rao 1948). It is below 1 where points
//! tell that the bones are the plan's, and 1 where they tell nothing.
//!
//! A displacement is common to all bones, for a person whose processes are longer has longer ones at every level: s and G are sums
//! over them.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::blurred_bone::BlurredBone;
use crate::blurred_fit::BlurredFit;
use crate::deformation::Deformable;
use crate::facing::FacingPoint;
use crate::model::Vertebra;
use crate::shape_basis::ShapeBasis;

/// From this noise on the bones' shape is judged, mm: it hides what tells one person's bones from another's.
pub(crate) const SHAPE_FROM_MM: f64 = 1.25;
/// Ratio of the points' information on the displacement to that of points drawn; of right bones it is 1.0 to 1.3.
const SCALES: (f64, f64) = (0.5, 2.0);
/// Somebody who is more like the plan's person than the process says: displacements are so much smaller.
const LESS: f64 = 0.5;
/// Points drawn for the information, the same for every bone and target.
const N_DRAWN: usize = 3000;
const SEED: u64 = 0x6e6f_6973_6520_6269;
/// Fewest points that say anything about a displacement.
const MIN_POINTS: usize = 60;
/// Information on a stretch that no point tells: of 10 %.
const RIDGE_OF_STRETCH: f64 = 100.0;

/// What the points of a bone say of a smooth displacement of its surface.
#[derive(Debug, Clone)]
pub(crate) struct ShapeChange {
    basis: Arc<ShapeBasis>,
    information: Arc<DMatrix<f64>>,
    score: DVector<f64>,
    /// Of this bone by itself; none if it cannot be told.
    log_bayes_factor: Option<f64>,
}

/// Whose bones the target shows, all together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpineChange {
    /// Natural logarithm of the Bayes factor: of how many times likelier the points are if the bones are another person's than if they are
    /// the plan's. Below 0 where they are the plan's, near 0 where the points do not tell.
    pub log_bayes_factor: f64,
    /// The largest such logarithm of three kinds of other bones: these, those that differ by half as much, and those that differ each by itself.
    pub largest_log_bayes_factor: f64,
    /// By how much the bones are larger along their own left, anterior and up axes, if nothing but stretch changes: 0.02
    /// is 2 %.
    pub larger: Vector3<f64>,
}

impl ShapeChange {
    /// Of the points of a vertebra and where they are likeliest. None if they are too few.
    pub(crate) fn new(
        blurred: &BlurredBone,
        vertebra: &Vertebra,
        fit: &BlurredFit,
        points: &[FacingPoint],
    ) -> Option<Self> {
        let bone = Deformable::new((blurred, &fit.blur), &vertebra.frame, &vertebra.shape_basis);
        let inverse = fit.target_from_source.inverse();
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let is_facing = points.iter().any(|p| p.normal.is_some());
        let of_drawn = bone.said_of(blurred.drawn((&fit.blur, is_facing), N_DRAWN, &mut rng));
        let of_points = bone.said_of(points.iter().map(|p| p.placed(&inverse)));
        let (n, n_drawn) = (of_points.ncols(), of_drawn.ncols());
        if n < MIN_POINTS || n_drawn == 0 {
            return None;
        }
        let (n_free, n_modes) = (bone.n_free(), bone.n_modes());
        let all = &of_drawn * of_drawn.transpose() * (n as f64 / n_drawn as f64);
        let mut of_free = all.view((0, 0), (n_free, n_free)).into_owned();
        for number in 0..n_free {
            of_free[(number, number)] += bone.ridge(number);
        }
        let both = all.view((0, n_free), (n_free, n_modes));
        // What pose, σ and weights do instead of a displacement is taken out.
        let instead = of_free.cholesky()?.solve(&both).transpose();
        let information = all.view((n_free, n_free), (n_modes, n_modes)) - &instead * both;
        let taken_out = of_points.rows_range(n_free..) - &instead * of_points.rows(0, n_free);
        // Points that lie more densely where they tell more say more than those drawn.
        let scale = taken_out.norm_squared() / information.trace();
        // A density that explains the points this badly tells nothing. A NaN does not either.
        if !(SCALES.0..=SCALES.1).contains(&scale) {
            return None;
        }
        let scale = if scale > 1.0 { scale } else { 1.0 };
        let (information, score) = (information / scale, taken_out.column_sum() / scale);
        Some(Self {
            basis: Arc::clone(&vertebra.shape_basis),
            log_bayes_factor: log_bayes_factor(&information, &score, 1.0),
            information: Arc::new(information),
            score,
        })
    }

    /// The logarithm of the Bayes factor of this bone by itself; none if it cannot be told.
    pub(crate) fn log_bayes_factor(&self) -> Option<f64> {
        self.log_bayes_factor
    }

    /// All bones together that tell anything; none of no bones.
    pub(crate) fn of_spine(all: &[&Self]) -> Option<SpineChange> {
        let (first, rest) = all.split_first()?;
        let mut information = first.information.as_ref().clone();
        let mut score = first.score.clone();
        for change in rest {
            information += change.information.as_ref();
            score += &change.score;
        }
        let each = all.iter().map(|change| change.log_bayes_factor);
        let alone = each.sum::<Option<f64>>()?;
        let common = |size| log_bayes_factor(&information, &score, size);
        let (log_bayes_factor, less) = (common(1.0)?, common(LESS)?);
        let larger = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
        Some(SpineChange {
            log_bayes_factor,
            largest_log_bayes_factor: larger(larger(log_bayes_factor, less), alone),
            larger: stretch(&first.basis, &information, &score)?,
        })
    }
}

/// The logarithm of the Bayes factor where displacements are of this size; none if it cannot be told.
fn log_bayes_factor(information: &DMatrix<f64>, score: &DVector<f64>, size: f64) -> Option<f64> {
    let n = score.len();
    let variance = size * size;
    let posterior = (DMatrix::identity(n, n) + information * variance).cholesky()?;
    let log_determinant = 2.0 * posterior.l_dirty().diagonal().map(f64::ln).sum();
    let told = score.dot(&posterior.solve(score)) * variance;
    Some(0.5 * (told - log_determinant))
}

/// The stretch along the axes that the points make likely, where nothing else changes.
fn stretch(
    basis: &ShapeBasis,
    information: &DMatrix<f64>,
    score: &DVector<f64>,
) -> Option<Vector3<f64>> {
    let stretches = basis.stretches();
    let mut of_stretch = stretches.tr_mul(&(information * &stretches));
    for axis in 0..3 {
        of_stretch[(axis, axis)] += RIDGE_OF_STRETCH;
    }
    let stretch = of_stretch.cholesky()?.solve(&stretches.tr_mul(score));
    Some(Vector3::new(stretch[0], stretch[1], stretch[2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MapOptions, SourceVertebra, SpineModel, VerdictOptions};
    use nalgebra::{Isometry3, Point3};
    use pedicle_mesh::{SimplifyOptions, Spacing, TriMesh, simplify};
    use pedicle_simulation::{MeshingOptions, Phantom, PhantomParameters, generate_phantom};
    use rand_distr::{Distribution, StandardNormal};

    /// Points of every bone before noise.
    type Points = Vec<Vec<Point3<f64>>>;

    fn person(parameters: &PhantomParameters) -> Phantom {
        generate_phantom(parameters, &MeshingOptions::default()).unwrap()
    }

    fn planned() -> SpineModel {
        let phantom = person(&PhantomParameters::default());
        let landmarks = phantom.landmarks();
        let vertebrae = phantom.vertebrae.into_iter().map(|v| SourceVertebra {
            level: v.level,
            surface: v.mesh,
        });
        SpineModel::new(vertebrae.collect(), &landmarks, &MapOptions::default()).unwrap()
    }

    /// Even points of the plan's bones, larger along their axes.
    fn even(model: &SpineModel, n: usize, larger: [f64; 3]) -> Points {
        let bones = model.vertebrae.iter().map(|vertebra| {
            let frame = &vertebra.frame;
            let axes = [frame.left, frame.anterior, frame.up];
            let center = vertebra.bone.centroid();
            let points = vertebra.bone.spread_points(n).into_iter().map(|p| {
                let more = axes.iter().zip(larger);
                p + more
                    .map(|(a, part)| a * (part * a.dot(&(p - center))))
                    .sum::<Vector3<f64>>()
            });
            points.collect()
        });
        bones.collect()
    }

    /// Vertices of a simplified surface, which crowd where it bends.
    fn crowded(mesh: &TriMesh, n_faces: usize) -> Vec<Point3<f64>> {
        let options = SimplifyOptions {
            spacing: Spacing::Adaptive,
            ..SimplifyOptions::default()
        };
        let simplified = simplify(mesh, n_faces, &options).unwrap();
        simplified.mesh.vertices().to_vec()
    }

    /// What noisy points say of each bone.
    fn said(model: &SpineModel, bones: &Points, sigma_mm: f64) -> Vec<ShapeChange> {
        let pose = Isometry3::new(Vector3::new(5.0, -3.0, 80.0), Vector3::new(0.3, 0.2, -0.4));
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let all = model.vertebrae.iter().zip(bones).map(|(vertebra, bone)| {
            let noisy = bone.iter().map(|p| {
                let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * sigma_mm;
                FacingPoint::of(pose * (p + noise))
            });
            let points: Vec<FacingPoint> = noisy.collect();
            let blurred = BlurredBone::new(
                (&vertebra.bone, &vertebra.bends),
                vertebra.area_mm2,
                sigma_mm,
            )
            .unwrap();
            let fit = blurred.fit_crowded(&pose, &points, sigma_mm).unwrap();
            ShapeChange::new(&blurred, vertebra, &fit, &points).unwrap()
        });
        all.collect()
    }

    fn together(all: &[ShapeChange]) -> SpineChange {
        ShapeChange::of_spine(&all.iter().collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_spine_of_another_size_is_told_through_noise_and_the_own_is_not() {
        let (model, limits) = (planned(), VerdictOptions::default());
        for sigma_mm in [1.3, 1.6, 2.0, 3.0] {
            let own = said(&model, &even(&model, 900, [0.0; 3]), sigma_mm);
            let change = together(&own);
            let factor = change.log_bayes_factor;
            assert!(factor <= limits.max_log_bayes_factor, "{change:?}");
            assert!(change.largest_log_bayes_factor < 0.0, "{change:?}");
            for bone in &own {
                let factor = bone.log_bayes_factor().unwrap();
                assert!(factor <= limits.max_log_bayes_factor_of_bone, "{factor}");
            }
            let truth = Vector3::new(0.015, -0.01, 0.015) * sigma_mm;
            let other = together(&said(&model, &even(&model, 900, truth.into()), sigma_mm));
            let largest = other.largest_log_bayes_factor;
            assert!(largest > limits.max_log_bayes_factor_of_any, "{other:?}");
            assert!(
                (other.larger - truth).amax() < 0.012,
                "{:?} for {truth:?}",
                other.larger
            );
        }
        assert!(
            ShapeChange::of_spine(&[]).is_none(),
            "nothing is known of nothing"
        );
    }

    #[test]
    fn bones_that_differ_each_by_itself_are_not_the_plans() {
        let model = planned();
        // In turn wider and narrower: on average they are the plan's.
        let bones: Points = (0..5)
            .map(|v| {
                let part = if v % 2 == 0 { 0.06 } else { -0.08 };
                let larger = if v == 4 {
                    [0.0; 3]
                } else {
                    [part, -part, part]
                };
                even(&model, 900, larger).swap_remove(v)
            })
            .collect();
        let change = together(&said(&model, &bones, 2.0));
        assert!(change.largest_log_bayes_factor > 1.0, "{change:?}");
    }

    #[test]
    fn half_a_spine_with_more_points_on_one_side_has_its_own_shape() {
        let (model, limits) = (planned(), VerdictOptions::default());
        let part = |points: Points, every: usize| -> Points {
            let bones = model.vertebrae.iter().zip(points);
            let seen = bones.map(|(vertebra, points)| {
                let seen = points.into_iter().enumerate().filter(|(i, p)| {
                    let from_center = p - vertebra.bone.centroid();
                    let is_behind = from_center.dot(&vertebra.frame.anterior) < 5.0;
                    let is_left = from_center.dot(&vertebra.frame.left) > 0.0;
                    is_behind && (is_left || i % 2 == 0) && i % every == 0
                });
                seen.map(|(_, p)| p).collect()
            });
            seen.collect()
        };
        let own = part(even(&model, 900, [0.0; 3]), 1);
        let change = together(&said(&model, &own, 2.0));
        let factor = change.log_bayes_factor;
        assert!(factor <= limits.max_log_bayes_factor, "{change:?}");
        let other = part(even(&model, 900, [0.06, -0.04, 0.06]), 1);
        let change = together(&said(&model, &other, 2.0));
        assert!(change.log_bayes_factor > 0.0, "{change:?}");
        let few = part(even(&model, 900, [0.0; 3]), 4);
        let change = together(&said(&model, &few, 3.0));
        let factor = change.log_bayes_factor;
        assert!(
            factor > limits.max_log_bayes_factor,
            "few points at 3 mm do not tell: {change:?}"
        );
    }

    #[test]
    fn vertices_that_crowd_where_a_bone_bends_do_not_make_it_anothers() {
        let (model, limits) = (planned(), VerdictOptions::default());
        let bones = |parameters: &PhantomParameters| -> Points {
            let vertebrae = person(parameters).vertebrae;
            vertebrae.iter().map(|v| crowded(&v.mesh, 700)).collect()
        };
        let own = together(&said(&model, &bones(&PhantomParameters::default()), 3.0));
        let factor = own.log_bayes_factor;
        assert!(factor <= limits.max_log_bayes_factor, "{own:?}");
        // People whose bones are as large as the plan's to 1 or 2 %, and differ from them by 0.6 to 0.9 mm.
        for seed in [900_007, 900_022] {
            let phantom = person(&PhantomParameters::subject(seed));
            let bones: Points = phantom
                .vertebrae
                .iter()
                .zip(&model.vertebrae)
                .map(|(v, planned)| {
                    let shift = planned.bone.centroid() - v.mesh.centroid();
                    crowded(&v.mesh, 700).iter().map(|p| p + shift).collect()
                })
                .collect();
            let other = together(&said(&model, &bones, 3.0));
            assert!(other.log_bayes_factor > 0.0, "{seed}: {other:?}");
        }
    }
}
