//! How far a found pose is from the true one, and how near one can get.
//!
//! - linear error |T_found c - T_true c| at the vertebra's centroid c, angular error the angle of
//!   R_found R_trueᵀ ([`pose_error`], from the registration crate);
//! - the error at the entry, the isthmus and the tip of a trajectory and of its direction;
//! - root mean squares over draws, as published;
//! - the Cramér-Rao bound of the vertebra's target points, for the efficiency error / bound.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::{PoseBound, RegistrationError, cramer_rao_bound};
use pedicle_trajectory::{Level, Side, Trajectory};

pub use pedicle_registration::{PoseError, pose_error};

use crate::VertebraTruth;

/// Error of one transferred trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryError {
    /// The level.
    pub level: Level,
    /// The side.
    pub side: Side,
    /// Distance at the entry, mm.
    pub entry_mm: f64,
    /// Distance at the isthmus, mm.
    pub isthmus_mm: f64,
    /// Distance at the tip, mm.
    pub tip_mm: f64,
    /// Angle between the two directions, rad.
    pub direction_rad: f64,
}

/// Error of a trajectory that is carried over by the found instead of the true pose.
///
/// The isthmus is `isthmus_depth_mm` behind the entry along the trajectory (20 mm in the published
/// margins; [`PedicleTruth::isthmus_depth_mm`](crate::PedicleTruth::isthmus_depth_mm) on the
/// phantom).
#[must_use]
pub fn trajectory_error(
    found: &Isometry3<f64>,
    truth: &Isometry3<f64>,
    planned: &Trajectory,
    isthmus_depth_mm: f64,
) -> TrajectoryError {
    let at = |p: &Point3<f64>| pose_error(found, truth, p).translation_mm;
    let direction = planned.direction();
    let (a, b) = (found * direction, truth * direction);
    TrajectoryError {
        level: planned.level,
        side: planned.side,
        entry_mm: at(&planned.entry_mm),
        isthmus_mm: at(&(planned.entry_mm + direction * isthmus_depth_mm)),
        tip_mm: at(&planned.tip_mm),
        // The arc tangent keeps its digits near 0.
        direction_rad: a.cross(&b).norm().atan2(a.dot(&b)),
    }
}

impl VertebraTruth {
    /// Linear and angular error of a found pose of this vertebra.
    #[must_use]
    pub fn error_of(&self, found: &Isometry3<f64>) -> PoseError {
        pose_error(found, &self.target_from_source, &self.source_centroid)
    }

    /// The smallest root mean square errors that any unbiased registration of this vertebra's
    /// target points can have, the linear one at the vertebra's centroid.
    ///
    /// # Errors
    /// [`RegistrationError`] if the points do not determine a pose.
    pub fn cramer_rao_bound(&self, noise_mm: f64) -> Result<PoseBound, RegistrationError> {
        cramer_rao_bound(
            &self.target_points,
            &self.target_normals,
            &(self.target_from_source * self.source_centroid),
            noise_mm,
        )
    }
}

/// Root mean square and largest value of errors that come one by one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ErrorSummary {
    n: usize,
    sum_of_squares: f64,
    largest: f64,
}

impl ErrorSummary {
    /// Takes one more error.
    pub fn push(&mut self, error: f64) {
        self.n += 1;
        self.sum_of_squares += error * error;
        self.largest = larger(self.largest, error.abs());
    }

    /// Takes all errors of another summary.
    pub fn merge(&mut self, other: &Self) {
        self.n += other.n;
        self.sum_of_squares += other.sum_of_squares;
        self.largest = larger(self.largest, other.largest);
    }

    /// How many errors were taken.
    #[must_use]
    pub fn n(&self) -> usize {
        self.n
    }

    /// Root of the mean of the squares; `None` before the first error.
    #[must_use]
    pub fn rmse(&self) -> Option<f64> {
        (self.n > 0).then(|| (self.sum_of_squares / self.n as f64).sqrt())
    }

    /// Largest absolute error; `None` before the first one.
    #[must_use]
    pub fn largest(&self) -> Option<f64> {
        (self.n > 0).then_some(self.largest)
    }
}

/// The larger of two numbers; a NaN stays visible, which `f64::max` would drop.
fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() { b } else { a }
}

/// Pose errors over several draws.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseErrorSummary {
    /// Linear errors, mm.
    pub translation_mm: ErrorSummary,
    /// Angular errors, rad.
    pub rotation_rad: ErrorSummary,
}

impl PoseErrorSummary {
    /// Takes one more pair of errors.
    pub fn push(&mut self, error: &PoseError) {
        self.translation_mm.push(error.translation_mm);
        self.rotation_rad.push(error.rotation_rad);
    }

    /// Takes all errors of another summary.
    pub fn merge(&mut self, other: &Self) {
        self.translation_mm.merge(&other.translation_mm);
        self.rotation_rad.merge(&other.rotation_rad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_is_the_root_mean_square() {
        let mut summary = ErrorSummary::default();
        assert_eq!(summary.rmse(), None, "nothing taken yet");
        for x in [3.0, 4.0] {
            summary.push(x);
        }
        let found = summary.rmse().unwrap();
        assert!((found - 12.5_f64.sqrt()).abs() < 1e-15, "{found}");
        assert_eq!(summary.largest(), Some(4.0), "largest");
        summary.push(f64::NAN);
        assert!(summary.largest().unwrap().is_nan(), "NaN must not hide");
    }
}
