//! Whether the bones of the target have the shape of the plan's where noise hides every bump.
//!
//! ```text
//! r_i = a_iᵀ δ + β b_i + m_iᵀ e + noise,   m_i = n_i · { symmetric linear, quadratic fields at q_i }
//! χ² = gᵀ (G + R)⁻¹ g,   ⟨χ²⟩ = tr (G + R)⁻¹ G,   excess = (χ² - ⟨χ²⟩) / √(2 ⟨χ²⟩)
//! ```
//!
//! √(2 ⟨χ²⟩) is the standard deviation of χ² where the points fix all of e, and more than it elsewhere.
//!
//! r are the signed distances of the target points from the bone less those that noise gives them
//! (b, [`crate::noise_offset`]), a and δ the change of pose, e the 24 numbers of a smooth deformation along the axes
//! of the vertebra: stretch and shear, and all quadratic fields. δ and β (an error of the noise's size) are free. G and
//! g are information and score of e once those are taken out, R⁻¹ the variance that a deformation may have.
//!
//! χ² is judged twice: of every bone by itself, summed, and of one deformation common to all bones, for a person who is
//! larger is so at every level.

use nalgebra::{Isometry3, Point3, SMatrix, SVector, Vector3};
use pedicle_registration::ReferenceSurface;
use pedicle_trajectory::AnatomicalFrame;

use crate::SpineError;
use crate::bone::BoneSurface;
use crate::model::Vertebra;
use crate::noise_offset::NoiseOffset;
use crate::verdict_noise::median;

/// Pose and size of the noise.
const N_FREE: usize = 7;
/// Numbers of a deformation: 6 of stretch and shear, 18 of quadratic fields.
const N_MODES: usize = 24;
const N: usize = N_FREE + N_MODES;
/// Length by which places are divided: all unknowns are lengths then, mm.
const LEVER_MM: f64 = 25.0;
/// Prior deviation of every number of a deformation, mm.
const PRIOR_MM: f64 = 1.5;
/// Prior deviation of β.
const PRIOR_OF_SCALE: f64 = 0.1;
/// Residuals beyond this many robust deviations are not of this bone.
const WITHIN_SIGMA: f64 = 4.0;
/// Median absolute deviation of a normal distribution.
const MAD_OF_NORMAL: f64 = 0.674_489_75;
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
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct ChiSquared {
    value: f64,
    expected: f64,
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
    /// itself, or of one change common to all, whichever is more.
    pub excess: f64,
    /// By how much the bones are larger along their own left, anterior and up axes: 0.02 is 2 %.
    pub larger: Vector3<f64>,
}

impl ShapeChange {
    /// Of the points given to a vertebra, for a noise found by its fit. None if they are too few.
    pub(crate) fn new(
        vertebra: &Vertebra,
        pose: &Isometry3<f64>,
        points: &[Point3<f64>],
        (noise_mm, gate_mm): (f64, f64),
    ) -> Result<Option<Self>, SpineError> {
        let bone = &vertebra.bone;
        let offset = NoiseOffset::new(bone, noise_mm, gate_mm)?;
        Ok(offset.and_then(|offset| {
            Self::from_offset((bone, &vertebra.frame), &offset, pose, points, gate_mm)
        }))
    }

    fn from_offset(
        (bone, frame): (&BoneSurface, &AnatomicalFrame),
        offset: &NoiseOffset,
        pose: &Isometry3<f64>,
        points: &[Point3<f64>],
        gate_mm: f64,
    ) -> Option<Self> {
        let inverse = pose.inverse();
        let rows: Vec<(SVector<f64, N>, f64)> = points
            .iter()
            .filter_map(|p| {
                let local = inverse * p;
                let hit = bone.closest_within(&local, gate_mm)?;
                let offset_mm = offset.at(&hit);
                let r = (local - hit.point).dot(&hit.normal) - offset_mm;
                let place = (hit.point - bone.centroid()) / LEVER_MM;
                Some((row(&place, &hit.normal, offset_mm, frame), r))
            })
            .collect();
        if rows.len() < MIN_POINTS {
            return None;
        }
        let middle = median(rows.iter().map(|(_, r)| *r).collect());
        let deviations = rows.iter().map(|(_, r)| (r - middle).abs()).collect();
        let limit = WITHIN_SIGMA * median(deviations) / MAD_OF_NORMAL;
        let kept = || rows.iter().filter(|(_, r)| (r - middle).abs() <= limit);

        let n = kept().count();
        let mut normal = SMatrix::<f64, N, N>::zeros();
        let (mut right, mut squares) = (SVector::<f64, N>::zeros(), 0.0);
        for (row, r) in kept() {
            normal.ger(1.0, row, row, 1.0);
            right.axpy(*r, row, 1.0);
            squares += r * r;
        }
        let variance = squares / n as f64;
        normal[(N_FREE - 1, N_FREE - 1)] += variance / (PRIOR_OF_SCALE * PRIOR_OF_SCALE);
        let free = normal.fixed_view::<N_FREE, N_FREE>(0, 0).into_owned();
        let across = normal.fixed_view::<N_FREE, N_MODES>(0, N_FREE).into_owned();
        let modes = normal
            .fixed_view::<N_MODES, N_MODES>(N_FREE, N_FREE)
            .into_owned();
        let right_free = right.fixed_rows::<N_FREE>(0).into_owned();
        let cholesky = free.cholesky()?;
        let explained = right_free.dot(&cholesky.solve(&right_free));
        let variance = (squares - explained) / n as f64;
        if variance.is_nan() || variance <= 0.0 {
            return None;
        }
        let score =
            right.fixed_rows::<N_MODES>(N_FREE) - across.transpose() * cholesky.solve(&right_free);
        let information = modes - across.transpose() * cholesky.solve(&across);
        Some(Self {
            information: information / variance,
            score: score / variance,
        })
    }

    /// The change that the points make likely, and its χ².
    fn judged(&self) -> Option<(Modes, ChiSquared)> {
        let prior = Information::identity() / (PRIOR_MM * PRIOR_MM);
        let cholesky = (self.information + prior).cholesky()?;
        let change = cholesky.solve(&self.score);
        let chi = ChiSquared {
            value: self.score.dot(&change),
            expected: cholesky.solve(&self.information).trace(),
        };
        Some((change, chi))
    }

    /// Whether there is a change that the points make likely.
    pub(crate) fn is_known(&self) -> bool {
        self.judged().is_some()
    }

    /// All bones together that tell anything; none of no bones.
    pub(crate) fn of_spine(all: &[&Self]) -> Option<SpineChange> {
        let (known, each): (Vec<&Self>, Vec<ChiSquared>) = all
            .iter()
            .filter_map(|change| Some((*change, change.judged()?.1)))
            .unzip();
        let summed = ChiSquared {
            value: each.iter().map(|chi| chi.value).sum(),
            expected: each.iter().map(|chi| chi.expected).sum(),
        };
        let (first, rest) = known.split_first()?;
        let mut common: Self = (*first).clone();
        for change in rest {
            common.information += change.information;
            common.score += change.score;
        }
        let (change, chi) = common.judged()?;
        let (alone, together) = (summed.excess(), chi.excess());
        Some(SpineChange {
            excess: if together > alone || together.is_nan() {
                together
            } else {
                alone
            },
            larger: Vector3::new(change[0], change[1], change[2]) / LEVER_MM,
        })
    }
}

/// Derivatives of a residual by the change of pose, the size of the noise and the deformation.
fn row(
    place: &Vector3<f64>,
    normal: &Vector3<f64>,
    offset_mm: f64,
    frame: &AnatomicalFrame,
) -> SVector<f64, N> {
    let axes = [frame.left, frame.anterior, frame.up];
    let u = axes.map(|f| f.dot(place));
    let n = axes.map(|f| f.dot(normal));
    let mut row = SVector::<f64, N>::zeros();
    let turn = place.cross(normal);
    let pose = turn.iter().chain(normal.iter()).copied();
    let stretch = (0..3).map(|k| u[k] * n[k]);
    let shear = [(0, 1), (0, 2), (1, 2)].map(|(i, j)| u[i] * n[j] + u[j] * n[i]);
    let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let quadratic = pairs
        .into_iter()
        .flat_map(|(i, j)| (0..3).map(move |k| u[i] * u[j] * n[k]));
    let all = pose
        .chain([offset_mm])
        .chain(stretch)
        .chain(shear)
        .chain(quadratic);
    for (entry, value) in row.iter_mut().zip(all) {
        *entry = value;
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn a_spine_of_another_size_is_told_through_noise_and_the_own_is_not() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let pose = Isometry3::new(Vector3::new(5.0, -3.0, 80.0), Vector3::new(0.3, 0.2, -0.4));
        let frame = AnatomicalFrame {
            origin: Point3::origin(),
            left: Vector3::x(),
            anterior: -Vector3::y(),
            up: Vector3::z(),
        };
        let (sigma_mm, gate_mm) = (2.0, 10.0);
        let spine = |larger: [f64; 3]| {
            let scale = Vector3::new(1.0 + larger[0], 1.0 + larger[1], 1.0 + larger[2]);
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let all: Vec<ShapeChange> = phantom
                .vertebrae
                .iter()
                .map(|vertebra| {
                    let bone = BoneSurface::new(&vertebra.mesh).unwrap();
                    let center = bone.centroid();
                    let points: Vec<Point3<f64>> = vertebra
                        .mesh
                        .vertices()
                        .iter()
                        .step_by(7)
                        .map(|p| {
                            let noise =
                                Vector3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * sigma_mm;
                            pose * (center + (p - center).component_mul(&scale) + noise)
                        })
                        .collect();
                    let offset = NoiseOffset::new(&bone, 1.9, gate_mm).unwrap().unwrap();
                    ShapeChange::from_offset((&bone, &frame), &offset, &pose, &points, gate_mm)
                        .unwrap()
                })
                .collect();
            ShapeChange::of_spine(&all.iter().collect::<Vec<_>>()).unwrap()
        };
        let own = spine([0.0; 3]);
        assert!(own.excess < 3.0, "{own:?}");
        let truth = Vector3::new(0.03, -0.02, 0.03);
        let other = spine(truth.into());
        assert!(other.excess > 10.0, "{other:?}");
        assert!(
            (other.larger - truth).amax() < 0.012,
            "{:?} for {truth:?}",
            other.larger
        );
        assert!(
            ShapeChange::of_spine(&[]).is_none(),
            "nothing is known of nothing"
        );
    }
}
