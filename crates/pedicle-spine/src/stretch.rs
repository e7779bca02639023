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

use crate::model::Vertebra;

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
/// How far that may be off for all bones of a spine together, 1/mm².
const NOISE_VARIES: f64 = 0.0045;
/// Standard deviations that chance is granted.
const CHANCE_IN_SIGMA: f64 = 3.0;

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

    /// What is left of the largest difference once what noise of `noise_mm` and chance may do is taken off.
    /// NaN if the sizes are.
    pub(crate) fn beyond_noise(&self, noise_mm: f64) -> f64 {
        let covariance = self.information.try_inverse();
        let deviations = covariance.map_or_else(
            || Vector3::repeat(f64::NAN),
            |c| c.diagonal().map(f64::sqrt),
        );
        let granted = NOISE_VARIES * noise_mm * noise_mm;
        let left = self
            .relative
            .zip_map(&deviations, |e, d| e.abs() - CHANCE_IN_SIGMA * d - granted);
        left.iter().fold(f64::NEG_INFINITY, |most, &x| {
            if x > most || x.is_nan() { x } else { most }
        })
    }
}

/// How much larger a vertebra is in the target, by the points given to it. None if they do not tell.
pub(crate) fn stretch(
    vertebra: &Vertebra,
    pose: &Isometry3<f64>,
    points: &[Point3<f64>],
    noise_mm: f64,
    is_from_camera: bool,
) -> Option<Stretch> {
    let bone = &vertebra.bone;
    let inverse = pose.inverse();
    let within_mm = WITHIN_FLOOR_MM + WITHIN_SIGMA * noise_mm;
    let frame = &vertebra.frame;
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
