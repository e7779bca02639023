//! Whether the bones of the target have the shape of the plan's where noise hides every bump.
//!
//! ```text
//! g_i = ∂ log p(x_i) / ∂(T, σ, w, e),   s_j → s_j + Σ_k e_k f_k(s_j)
//! χ² = gᵀ (G + R)⁻¹ g,   ⟨χ²⟩ = tr (G + R)⁻¹ G,   excess = (χ² - ⟨χ²⟩) / √(2 ⟨χ²⟩)
//! ```
//!
//! √(2 ⟨χ²⟩) is the standard deviation of χ² where the points fix all of e, and more than it elsewhere.
//!
//! p is the density of noisy points of the bone ([`crate::blurred_bone`]), e the 54 numbers of a smooth deformation along the axes
//! of the vertebra: stretch and shear, and all quadratic and cubic fields. G and g are information and score of e once pose, σ and the
//! weights of the regions are taken out, R⁻¹ the variance that a deformation may have: the score test of Rao 1948, which needs no fit of the deformation. The
//! information is that of points drawn from p.
//!
//! χ² is judged twice: of every bone by itself, summed, and of one deformation common to all bones, for a person who is
//! larger is so at every level.

use nalgebra::{DMatrix, Point3, SMatrix, SVector, Vector3};
use pedicle_trajectory::AnatomicalFrame;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::blurred_bone::{BlurredBone, N_FREE, RIDGE_POINTS};
use crate::blurred_fit::BlurredFit;
use crate::deformation::{LEVER_MM, N_LINEAR, N_MODES, rows};

/// From this noise on the bones' shape is judged, mm: it hides what tells one person's bones from another's.
pub(crate) const SHAPE_FROM_MM: f64 = 1.25;
/// Prior deviation of every number of a deformation, mm.
const PRIOR_MM: f64 = 1.5;
/// Targets' points are not spread evenly over the bone, and not so in the same way on all bones: the excess of one common deformation
/// is so many times as large.
const COMMON_DEVIATIONS: f64 = 2.0;
/// Largest ratio of the points' information on the deformation to that of points drawn; of right bones it is 1 to 1.5.
const MAX_SCALE: f64 = 2.0;
/// How much every number of stretch and shear is of another person who is much alike, mm: 2 %.
const OTHER_MM: f64 = 0.5;
/// Points drawn for the information, the same for every bone and target.
const N_DRAWN: usize = 3000;
const SEED: u64 = 0x6e6f_6973_6520_6269;
/// Fewest points that say anything about a deformation.
const MIN_POINTS: usize = 60;

type Modes = SVector<f64, N_MODES>;
type Information = SMatrix<f64, N_MODES, N_MODES>;

/// What the points of a bone say of a smooth change of its shape.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShapeChange {
    information: Information,
    score: Modes,
}

/// χ² of a change of shape and what it is where there is none.
#[derive(Debug, Clone, Copy)]
struct ChiSquared {
    value: f64,
    expected: f64,
    /// What a stretch and shear of [`OTHER_MM`] in every number adds on average.
    by_other: f64,
}

impl ChiSquared {
    /// By how many of its standard deviations it is too large.
    fn excess(&self) -> f64 {
        (self.value - self.expected) / (2.0 * self.expected).sqrt()
    }
}

/// By how much the bones of the target differ from the plan's in shape, all together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpineChange {
    /// By how many of its standard deviations χ² is larger than where noise alone changes the shape: of all bones each by
    /// itself, or of one change common to all, whichever is more; half of the latter, for points lie unevenly in the same way on
    /// all bones, and the weights of regions do not take all of that out.
    pub excess: f64,
    /// The excess that the bones of another person who is much alike would have on average: of a stretch and shear of 2 %.
    pub shows: f64,
    /// By how much the bones are larger along their own left, anterior and up axes, if nothing but stretch and shear changes: 0.02
    /// is 2 %.
    pub larger: Vector3<f64>,
}

impl ShapeChange {
    /// Of the points of a vertebra and where they are likeliest. None if they are too few.
    pub(crate) fn new(
        blurred: &BlurredBone,
        frame: &AnatomicalFrame,
        fit: &BlurredFit,
        points: &[Point3<f64>],
    ) -> Option<Self> {
        let inverse = fit.target_from_source.inverse();
        let local: Vec<Point3<f64>> = points.iter().map(|p| inverse * p).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        let noise = || Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng));
        let drawn = blurred.drawn(&fit.blur, N_DRAWN, noise);
        let of_drawn = rows(blurred, frame, &fit.blur, drawn);
        let of_points = rows(blurred, frame, &fit.blur, local);
        let (n, n_drawn) = (of_points.nrows(), of_drawn.nrows());
        if n < MIN_POINTS || n_drawn == 0 {
            return None;
        }
        let per_drawn = n as f64 / n_drawn as f64;
        let n_free = of_points.ncols() - N_MODES;
        let (free, modes) = (
            of_drawn.columns(0, n_free),
            of_drawn.columns_range(n_free..),
        );
        let mut information = free.tr_mul(&free) * per_drawn;
        for r in N_FREE..n_free {
            information[(r, r)] += RIDGE_POINTS;
        }
        // What pose, σ and weights do instead of a deformation is taken out of every row.
        let instead = information
            .cholesky()?
            .solve(&(free.tr_mul(&modes) * per_drawn));
        let taken_out =
            |rows: &DMatrix<f64>| rows.columns_range(n_free..) - rows.columns(0, n_free) * &instead;
        let (of_drawn, of_points) = (taken_out(&of_drawn), taken_out(&of_points));
        let square = |rows: &DMatrix<f64>| {
            rows.tr_mul(rows)
                .fixed_view::<N_MODES, N_MODES>(0, 0)
                .into_owned()
        };
        let information: Information = square(&of_drawn) * per_drawn;
        let score: Modes = of_points
            .row_sum()
            .transpose()
            .fixed_rows::<N_MODES>(0)
            .into_owned();
        // Points that lie more densely where they tell more say more than those drawn.
        let seen = square(&of_points);
        let scale = information.cholesky()?.solve(&seen).trace() / N_MODES as f64;
        // A density that explains the points this badly tells nothing. A NaN does not either.
        if !(0.0..=MAX_SCALE).contains(&scale) {
            return None;
        }
        let scale = if scale > 1.0 { scale } else { 1.0 };
        Some(Self {
            information: information / scale,
            score: score / scale,
        })
    }

    /// χ² of all changes.
    fn judged(&self) -> Option<ChiSquared> {
        let prior = Information::identity() / (PRIOR_MM * PRIOR_MM);
        let cholesky = (self.information + prior).cholesky()?;
        let change = cholesky.solve(&self.score);
        let added = self.information * cholesky.solve(&self.information);
        Some(ChiSquared {
            value: self.score.dot(&change),
            expected: cholesky.solve(&self.information).trace(),
            by_other: OTHER_MM * OTHER_MM * added.view((0, 0), (N_LINEAR, N_LINEAR)).trace(),
        })
    }

    /// The stretch along the axes that the points make likely, where nothing but stretch and shear changes.
    fn stretch(&self) -> Option<Vector3<f64>> {
        let linear = self.information.fixed_view::<N_LINEAR, N_LINEAR>(0, 0);
        let prior = SMatrix::<f64, N_LINEAR, N_LINEAR>::identity() / (PRIOR_MM * PRIOR_MM);
        let score = self.score.fixed_rows::<N_LINEAR>(0);
        let change = (linear + prior).cholesky()?.solve(&score);
        Some(change.fixed_rows::<3>(0) / LEVER_MM)
    }

    /// By how many standard deviations χ² of this bone alone is too large; none if it cannot be told.
    pub(crate) fn excess(&self) -> Option<f64> {
        Some(self.judged()?.excess())
    }

    /// All bones together that tell anything; none of no bones.
    pub(crate) fn of_spine(all: &[&Self]) -> Option<SpineChange> {
        let (known, each): (Vec<&Self>, Vec<ChiSquared>) = all
            .iter()
            .filter_map(|change| Some((*change, change.judged()?)))
            .unzip();
        let summed = ChiSquared {
            value: each.iter().map(|chi| chi.value).sum(),
            expected: each.iter().map(|chi| chi.expected).sum(),
            by_other: each.iter().map(|chi| chi.by_other).sum(),
        };
        let (first, rest) = known.split_first()?;
        let mut common: Self = (*first).clone();
        for change in rest {
            common.information += change.information;
            common.score += change.score;
        }
        let chi = common.judged()?;
        let (alone, together) = (summed.excess(), chi.excess());
        let together = together / COMMON_DEVIATIONS;
        let shows = |chi: &ChiSquared| chi.by_other / (2.0 * chi.expected).sqrt();
        let (a, b) = (shows(&summed), shows(&chi) / COMMON_DEVIATIONS);
        Some(SpineChange {
            excess: if together > alone || together.is_nan() {
                together
            } else {
                alone
            },
            shows: if b > a { b } else { a },
            larger: common.stretch()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VerdictOptions;
    use crate::bone::BoneSurface;
    use nalgebra::Isometry3;
    use pedicle_simulation::{MeshingOptions, Phantom, PhantomParameters, generate_phantom};

    fn phantom() -> Phantom {
        generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap()
    }

    /// What noisy points of larger bones say, of those places that are seen, from their centroid in mm.
    fn spine(
        phantom: &Phantom,
        larger: [f64; 3],
        sigma_mm: f64,
        is_seen: impl Fn(usize, &Vector3<f64>) -> bool,
    ) -> Vec<ShapeChange> {
        let pose = Isometry3::new(Vector3::new(5.0, -3.0, 80.0), Vector3::new(0.3, 0.2, -0.4));
        let frame = AnatomicalFrame {
            origin: Point3::origin(),
            left: Vector3::x(),
            anterior: -Vector3::y(),
            up: Vector3::z(),
        };
        let scale = Vector3::new(1.0 + larger[0], 1.0 + larger[1], 1.0 + larger[2]);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let all = phantom.vertebrae.iter().map(|vertebra| {
            let bone = BoneSurface::new(&vertebra.mesh).unwrap();
            let center = bone.centroid();
            let seen = bone.spread_points(900).into_iter().enumerate();
            let points: Vec<Point3<f64>> = seen
                .filter(|(i, p)| is_seen(*i, &(p - center)))
                .map(|(_, p)| {
                    let noise = Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * sigma_mm;
                    pose * (center + (p - center).component_mul(&scale) + noise)
                })
                .collect();
            let area_mm2 = vertebra.mesh.area();
            let blurred = BlurredBone::new(&bone, area_mm2, sigma_mm).unwrap();
            let fit = blurred.fit(&pose, &points, sigma_mm).unwrap();
            ShapeChange::new(&blurred, &frame, &fit, &points).unwrap()
        });
        all.collect()
    }

    fn together(all: &[ShapeChange]) -> SpineChange {
        ShapeChange::of_spine(&all.iter().collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_spine_of_another_size_is_told_through_noise_and_the_own_is_not() {
        let (phantom, limits) = (phantom(), VerdictOptions::default());
        for sigma_mm in [2.0, 3.0] {
            let own = spine(&phantom, [0.0; 3], sigma_mm, |_, _| true);
            let change = together(&own);
            assert!(change.excess <= limits.max_shape_excess, "{change:?}");
            assert!(change.shows >= limits.min_shape_shown, "{change:?}");
            for bone in &own {
                let excess = bone.excess().unwrap();
                assert!(excess <= limits.max_shape_excess_of_bone, "{excess}");
            }
            let truth = Vector3::new(0.015, -0.01, 0.015) * sigma_mm;
            let other = together(&spine(&phantom, truth.into(), sigma_mm, |_, _| true));
            assert!(other.excess > limits.max_shape_excess, "{other:?}");
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
    fn half_a_spine_with_more_points_on_one_side_has_its_own_shape() {
        let (phantom, limits) = (phantom(), VerdictOptions::default());
        let is_seen = |i: usize, p: &Vector3<f64>| p.y > -5.0 && (p.x > 0.0 || i.is_multiple_of(2));
        let own = together(&spine(&phantom, [0.0; 3], 2.0, is_seen));
        assert!(own.excess <= limits.max_shape_excess, "{own:?}");
        let other = together(&spine(&phantom, [0.06, -0.04, 0.06], 2.0, is_seen));
        assert!(other.excess > limits.max_shape_excess, "{other:?}");
        let less = together(&spine(&phantom, [0.0; 3], 3.0, |i, p| {
            is_seen(i, p) && i % 4 < 2
        }));
        assert!(
            less.shows < limits.min_shape_shown,
            "few points at 3 mm do not tell: {less:?}"
        );
    }
}
