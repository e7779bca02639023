//! Whether a plan and a spine are in the same coordinates.
//!
//! ```text
//! x_LPS = diag(-1, -1, 1) x_RAS
//! ```
//!
//! A plan in RAS read as LPS lies outside the spine, and inside once both its signs are turned.

use std::path::Path;

use nalgebra::Point3;
use pedicle_mesh::Space;
use pedicle_spine::SourceVertebra;
use pedicle_trajectory::{Plan, Trajectory};

use crate::Error;

/// A screw may stand out of the box of its vertebra by this much, mm.
const MAX_OUTSIDE_MM: f64 = 15.0;

/// Refuses a plan that lies outside the spine, but inside if RAS and LPS are exchanged.
///
/// A plan that lies outside either way is of another spine, which is for others to say.
///
/// # Errors
/// [`Error::PlanFlipped`] naming the file and the numbers of screws.
pub fn check_plan_frame(
    path: &Path,
    plan: &Plan,
    vertebrae: &[SourceVertebra],
) -> Result<(), Error> {
    let flip = |p: &Point3<f64>| Space::Ras.point_to(Space::Lps, p);
    let flipped = |t: &Trajectory| Trajectory {
        entry_mm: flip(&t.entry_mm),
        tip_mm: flip(&t.tip_mm),
        ..*t
    };
    let n_inside = plan
        .trajectories
        .iter()
        .filter(|t| is_inside(t, vertebrae))
        .count();
    let n_flipped = plan
        .trajectories
        .iter()
        .filter(|t| is_inside(&flipped(t), vertebrae))
        .count();
    let n_trajectories = plan.trajectories.len();
    if n_inside < n_trajectories && n_flipped == n_trajectories {
        return Err(Error::PlanFlipped {
            path: path.to_owned(),
            n_outside: n_trajectories - n_inside,
            n_trajectories,
        });
    }
    Ok(())
}

/// Whether both ends are near the box of the screw's vertebra.
fn is_inside(t: &Trajectory, vertebrae: &[SourceVertebra]) -> bool {
    let Some(vertebra) = vertebrae.iter().find(|v| v.level == t.level) else {
        return false;
    };
    let (low, high) = vertebra.surface.bounding_box();
    [t.entry_mm, t.tip_mm].iter().all(|p| {
        (0..3).all(|axis| {
            (low[axis] - MAX_OUTSIDE_MM..=high[axis] + MAX_OUTSIDE_MM).contains(&p[axis])
        })
    })
}
