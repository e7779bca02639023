//! From the covariance of a vertebra to the uncertainty of its screws.
//!
//! ```text
//! Σ(p) = J(p) Σ J(p)ᵀ,   J(p) = [ -[p - c]ₓ  I ]
//! P(breach) ≤ 2 Q(m / s),   s² = largest eigenvalue of Σ(isthmus) across the screw's axis
//! ```
//!
//! m is the least clearance of the planned screw from the cortex in the pedicle and the body, measured
//! on the source. Q is the upper tail of the normal distribution: the screw breaches if its wall moves
//! towards the nearest cortex by more than m, and moves most in the direction of s. Lengths in mm.

use nalgebra::{Isometry3, Matrix3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use pedicle_registration::PoseCovariance;
use pedicle_trajectory::{
    AnatomicalFrame, CheckOptions, Pedicle, PedicleOptions, Side, Trajectory, check_trajectory,
    measure_pedicle,
};

/// Depth of the isthmus below the entry where it cannot be measured, mm: that of the published
/// margins.
const ISTHMUS_DEPTH_MM: f64 = 20.0;

/// How far a screw may be from where it was carried to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryUncertainty {
    /// Standard deviation of the entry in its worst direction, mm.
    pub entry_mm: f64,
    /// The same of the point in the isthmus of the pedicle.
    pub isthmus_mm: f64,
    /// The same of the tip.
    pub tip_mm: f64,
    /// Least clearance of the planned screw from the cortex, mm; negative if it breaches as
    /// planned, NaN where the pedicle could not be measured.
    pub planned_clearance_mm: f64,
    /// Probability that the screw breaches the cortex although the planned one does not; NaN where
    /// the clearance is.
    pub breach_probability: f64,
}

/// What is measured once on the source.
pub(crate) struct Anatomy {
    surface: SurfaceIndex,
    /// Left, right; none where it could not be measured.
    pedicles: [Option<Pedicle>; 2],
}

impl std::fmt::Debug for Anatomy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Anatomy")
            .field("pedicles", &self.pedicles)
            .finish_non_exhaustive()
    }
}

impl Anatomy {
    /// None if the surface cannot be indexed.
    pub(crate) fn new(surface: &TriMesh, frame: &AnatomicalFrame) -> Option<Self> {
        let index = SurfaceIndex::new(surface).ok()?;
        let options = PedicleOptions::default();
        let measured = |side| measure_pedicle(surface, &index, frame, side, &options).ok();
        let pedicles = [measured(Side::Left), measured(Side::Right)];
        Some(Self {
            surface: index,
            pedicles,
        })
    }

    pub(crate) fn pedicle(&self, side: Side) -> Option<&Pedicle> {
        self.pedicles[side as usize].as_ref()
    }

    pub(crate) fn surface(&self) -> &SurfaceIndex {
        &self.surface
    }

    /// Clearance of a planned screw, mm, and depth of the isthmus below its entry, mm.
    fn clearance(&self, planned: &Trajectory, frame: &AnatomicalFrame) -> Option<(f64, f64)> {
        let pedicle = self.pedicles[planned.side as usize].as_ref()?;
        let options = CheckOptions::default();
        let check = check_trajectory(planned, &self.surface, pedicle, frame, &options).ok()?;
        let depth_mm = check.isthmus_depth_mm.unwrap_or(ISTHMUS_DEPTH_MM);
        Some((check.min_clearance_mm(), depth_mm))
    }
}

/// The uncertainty of one screw of a vertebra in its pose.
pub(crate) fn uncertainty(
    planned: &Trajectory,
    pose: &Isometry3<f64>,
    covariance: &PoseCovariance,
    (anatomy, frame): (Option<&Anatomy>, &AnatomicalFrame),
) -> TrajectoryUncertainty {
    let measured = anatomy.and_then(|anatomy| anatomy.clearance(planned, frame));
    let (planned_clearance_mm, depth_mm) = measured.unwrap_or((f64::NAN, ISTHMUS_DEPTH_MM));
    let isthmus = pose * (planned.entry_mm + planned.direction() * depth_mm);
    let axis = pose.rotation * planned.direction();
    let at_isthmus = covariance.point_covariance(&isthmus);
    let across = Matrix3::identity() - axis * axis.transpose();
    let lateral_mm = worst_deviation(&(across * at_isthmus * across));
    let worst_at = |p| worst_deviation(&covariance.point_covariance(p));
    TrajectoryUncertainty {
        entry_mm: worst_at(&(pose * planned.entry_mm)),
        isthmus_mm: worst_at(&isthmus),
        tip_mm: worst_at(&(pose * planned.tip_mm)),
        planned_clearance_mm,
        breach_probability: breach_probability(planned_clearance_mm, lateral_mm),
    }
}

fn breach_probability(clearance_mm: f64, deviation_mm: f64) -> f64 {
    if clearance_mm.is_nan() || deviation_mm.is_nan() {
        return f64::NAN;
    }
    if clearance_mm < 0.0 {
        return 1.0;
    }
    if deviation_mm <= 0.0 {
        return 0.0;
    }
    let both_tails = 2.0 * upper_tail(clearance_mm / deviation_mm);
    if both_tails < 1.0 { both_tails } else { 1.0 }
}

/// Q(z) for z ≥ 0 to 1e-7 (Abramowitz & Stegun 1964, 26.2.17).
fn upper_tail(z: f64) -> f64 {
    const B: [f64; 5] = [
        0.319_381_530,
        -0.356_563_782,
        1.781_477_937,
        -1.821_255_978,
        1.330_274_429,
    ];
    let t = 1.0 / (1.0 + 0.231_641_9 * z);
    let series = B.iter().rev().fold(0.0, |sum, b| (sum + b) * t);
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    density * series
}

/// Root of the largest eigenvalue.
pub(crate) fn worst_deviation(covariance: &Matrix3<f64>) -> f64 {
    if !covariance.iter().all(|x| x.is_finite()) {
        return f64::NAN;
    }
    let largest = covariance.symmetric_eigenvalues().max();
    if largest > 0.0 { largest.sqrt() } else { 0.0 }
}

/// Worst direction of the orientation, rad, and of the place of the centre, mm.
pub(crate) fn worst_of_pose(covariance: &PoseCovariance) -> (f64, f64) {
    let block = |at: usize| {
        let block: Matrix3<f64> = covariance.matrix.fixed_view::<3, 3>(at, at).into_owned();
        worst_deviation(&block)
    };
    (block(0), block(3))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix6, Point3};

    use super::*;

    #[test]
    fn the_tail_is_that_of_the_normal_distribution() {
        for (z, tail) in [
            (0.0, 0.5),
            (1.0, 0.158_655_3),
            (2.0, 0.022_750_1),
            (4.0, 3.167_1e-5),
        ] {
            let found = upper_tail(z);
            assert!((found - tail).abs() < 2e-7, "Q({z}) = {found}");
        }
    }

    #[test]
    fn a_breach_is_certain_without_room_and_impossible_without_doubt() {
        assert!((breach_probability(0.0, 0.3) - 1.0).abs() < 1e-6, "no room");
        assert!(breach_probability(2.0, 0.0) <= 0.0, "no doubt");
        assert!(breach_probability(-0.1, 0.1) >= 1.0, "planned outside");
        let (near, far) = (breach_probability(1.0, 0.5), breach_probability(2.0, 0.5));
        assert!(near > far && far > 0.0, "more room, less danger");
    }

    #[test]
    fn the_worst_direction_grows_with_the_lever() {
        let mut matrix = Matrix6::zeros();
        matrix[(2, 2)] = 0.01_f64.powi(2);
        let covariance = PoseCovariance {
            matrix,
            center: Point3::origin(),
        };
        let at = |x: f64| worst_deviation(&covariance.point_covariance(&Point3::new(x, 0.0, 0.0)));
        assert!(
            (at(10.0) - 0.1).abs() < 1e-12 && (at(50.0) - 0.5).abs() < 1e-12,
            "lever"
        );
        let (turn, shift) = worst_of_pose(&covariance);
        assert!(
            (turn - 0.01).abs() < 1e-12 && shift == 0.0,
            "{turn} {shift}"
        );
    }
}
