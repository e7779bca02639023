//! Whether a bone is as large as the plan's.
//!
//! ```text
//! r_i = a_iᵀ δ + b_iᵀ e + noise,   b_ik = (n_i · f_k)(q_i · f_k)
//! ```
//!
//! r are signed distances of the target points from the surface in its pose, q their closest points from
//! the centroid, n the normals there, f the axes of the vertebra, a and δ the change of pose as in
//! [`pedicle_registration::PoseCovariance`]. e is the stretch of the bone along its axes that fits the points best once the pose
//! may follow, by least squares. Noise that hides every bump of a shape does not hide its size: over a whole
//! spine it is known to a few parts in a thousand, and people differ by several per cent.
//!
//! Noise itself makes a bone larger, by the curvature of its surface: see [`crate::misfit`].

use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, Vector3};
use pedicle_registration::ReferenceSurface;
use pedicle_trajectory::AnatomicalFrame;

use crate::bone::BoneSurface;

/// Unknowns: pose and stretch.
const N: usize = 9;
/// Residuals beyond this many standard deviations are not of this bone.
const WITHIN_SIGMA: f64 = 3.0;
/// The same for targets without noise, mm.
const WITHIN_FLOOR_MM: f64 = 0.3;
/// Prior deviation of a stretch: what is seen of a bone may not tell one of its sizes.
const PRIOR: f64 = 0.1;
/// Length that makes a rotation and a stretch comparable to a shift, mm.
const LEVER_MM: f64 = 25.0;
/// Noise of σ mm makes a bone larger by this many times σ² along its axes (left, anterior, up), 1/mm².
/// Measured on phantoms under poses found, at 2 and 3 mm: 0.0021 to 0.0056, 0.0020 to 0.0080 and 0.0070 to 0.0155.
const BY_NOISE: [f64; 3] = [0.0042, 0.0042, 0.0095];
/// The same of what a camera sees, whose noise lies along its rays.
const BY_NOISE_OF_CAMERA: [f64; 3] = [-0.002, 0.007, -0.010];
/// Standard deviation of that over spines and targets, for all bones of a spine together, 1/mm².
const NOISE_VARIES: [f64; 3] = [0.0020, 0.0025, 0.0035];
/// What triangulations and soft tissue do to the size.
const FLOOR: f64 = 0.006;

/// The stretch of a bone and how well it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stretch {
    /// Relative, along left, anterior and up: 0.02 is 2 % larger than in the plan. What noise does is taken
    /// off.
    pub(crate) relative: Vector3<f64>,
    pub(crate) information: Matrix3<f64>,
}

impl Stretch {
    /// Several bones together.
    pub(crate) fn pooled(all: &[Self]) -> Option<Self> {
        let information: Matrix3<f64> = all.iter().map(|s| s.information).sum();
        let sum: Vector3<f64> = all.iter().map(|s| s.information * s.relative).sum();
        let relative = information.cholesky()?.solve(&sum);
        Some(Self {
            relative,
            information,
        })
    }

    /// eᵀ C⁻¹ e with C the covariance of the stretch e, of what noise of `noise_mm` may do to it and of
    /// what else may: χ² with three degrees of freedom if the bones are as large as the plan's. NaN if
    /// unknown.
    pub(crate) fn chi_squared(&self, noise_mm: f64) -> f64 {
        let Some(mut covariance) = self.information.try_inverse() else {
            return f64::NAN;
        };
        for (k, varies) in NOISE_VARIES.iter().enumerate() {
            let by_noise = varies * noise_mm * noise_mm;
            covariance[(k, k)] += by_noise * by_noise + FLOOR * FLOOR;
        }
        covariance
            .cholesky()
            .map_or(f64::NAN, |c| self.relative.dot(&c.solve(&self.relative)))
    }
}

/// How much larger a vertebra is in the target, by the points given to it. None if they do not tell.
pub(crate) fn stretch(
    (bone, frame): (&BoneSurface, &AnatomicalFrame),
    pose: &Isometry3<f64>,
    points: &[Point3<f64>],
    noise_mm: f64,
    is_from_camera: bool,
) -> Option<Stretch> {
    let inverse = pose.inverse();
    let within_mm = WITHIN_FLOOR_MM + WITHIN_SIGMA * noise_mm;
    let axes = [frame.left, frame.anterior, frame.up];
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let mut right = SVector::<f64, N>::zeros();
    let (mut n, mut squares) = (0_usize, 0.0);
    for p in points {
        let local = inverse * p;
        let Some(hit) = bone.closest_within(&local, within_mm) else {
            continue;
        };
        let r = (local - hit.point).dot(&hit.normal);
        let lever = (hit.point - bone.centroid()) / LEVER_MM;
        let turn = lever.cross(&hit.normal);
        let by_axis = axes.map(|f| f.dot(&hit.normal) * f.dot(&lever));
        let row = SVector::<f64, N>::from_iterator(
            turn.iter()
                .chain(hit.normal.iter())
                .chain(by_axis.iter())
                .copied(),
        );
        matrix.ger(1.0, &row, &row, 1.0);
        right.axpy(r, &row, 1.0);
        n += 1;
        squares += r * r;
    }
    if n <= N {
        return None;
    }
    let variance = squares / (n - N) as f64 + 1e-6;
    matrix /= variance;
    right /= variance;
    for k in 6..N {
        matrix[(k, k)] += 1.0 / (PRIOR * LEVER_MM).powi(2);
    }
    let covariance = matrix.cholesky()?.inverse();
    let found = covariance * right;
    let scale = 1.0 / LEVER_MM;
    let own = covariance.fixed_view::<3, 3>(6, 6) * (scale * scale);
    let by_noise = if is_from_camera {
        BY_NOISE_OF_CAMERA
    } else {
        BY_NOISE
    };
    let relative =
        Vector3::from_fn(|k, _| found[6 + k] * scale - by_noise[k] * noise_mm * noise_mm);
    Some(Stretch {
        relative,
        information: own.try_inverse()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pedicle_simulation::{MeshingOptions, PhantomParameters, generate_phantom};

    #[test]
    fn bones_of_another_size_are_told_and_their_own_are_not() {
        let phantom =
            generate_phantom(&PhantomParameters::default(), &MeshingOptions::default()).unwrap();
        let pose = Isometry3::new(Vector3::new(5.0, -3.0, 80.0), Vector3::new(0.3, 0.2, -0.4));
        let frame = AnatomicalFrame {
            origin: Point3::origin(),
            left: Vector3::x(),
            anterior: -Vector3::y(),
            up: Vector3::z(),
        };
        let pooled = |larger: [f64; 3]| {
            let scale = Vector3::new(1.0 + larger[0], 1.0 + larger[1], 1.0 + larger[2]);
            let all: Vec<Stretch> = phantom
                .vertebrae
                .iter()
                .map(|vertebra| {
                    let bone = BoneSurface::new(&vertebra.mesh).unwrap();
                    let center = bone.centroid();
                    let grown =
                        |p: &Point3<f64>| pose * (center + (p - center).component_mul(&scale));
                    let points: Vec<_> = vertebra
                        .mesh
                        .vertices()
                        .iter()
                        .step_by(7)
                        .map(grown)
                        .collect();
                    stretch((&bone, &frame), &pose, &points, 0.2, false).unwrap()
                })
                .collect();
            Stretch::pooled(&all).unwrap()
        };
        let own = pooled([0.0; 3]);
        assert!(own.chi_squared(0.2) < 0.1, "{own:?}");
        let other = pooled([0.02, -0.01, 0.015]);
        for (k, truth) in [0.02, -0.01, 0.015].into_iter().enumerate() {
            let found = other.relative[k];
            assert!(
                (found - truth).abs() < 0.004,
                "axis {k}: {found} for {truth}"
            );
        }
        assert!(other.chi_squared(0.2) > 10.0, "{other:?}");
        assert!(
            other.chi_squared(3.0) < 3.0,
            "at a noise of 3 mm such a size proves nothing"
        );
        assert!(
            Stretch::pooled(&[]).is_none(),
            "nothing is known of nothing"
        );
    }
}
