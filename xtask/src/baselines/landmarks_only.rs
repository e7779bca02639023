//! Landmarks only: one rigid motion of the whole spine.
//!
//! ```text
//! T = argmin Σ_l |T s_l - t_l|²
//! ```
//!
//! Kabsch 1976. The landmarks lie nearly on a line, so the turn about it is all but free: errors of
//! some millimetres turn the spine by tens of degrees.

use nalgebra::{Isometry3, Point3};
use pedicle_registration::kabsch;

use super::{Seen, Source};

/// The fit, if at least three levels have a landmark.
pub(super) fn pose(source: &Source, seen: &Seen<'_>) -> Result<Isometry3<f64>, String> {
    let (from, to): (Vec<Point3<f64>>, Vec<Point3<f64>>) = source
        .bones
        .iter()
        .zip(seen.landmarks)
        .filter_map(|(bone, landmark)| Some((bone.landmark, (*landmark)?)))
        .unzip();
    kabsch(&from, &to, None).map_err(|error| format!("{} landmark pairs: {error}", from.len()))
}
