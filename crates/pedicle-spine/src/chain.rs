//! What speaks against two neighbours posed so, from anatomy alone.
//!
//! ```text
//! c = w Σ over neighbours u of [ ((θ - 15°)₊ / 15°)²₁ + ((d - 6 mm)₊ / 6 mm)²₁ ]
//! ```
//!
//! θ is the turn of the vertebra against its neighbour compared with the plan, d how far the point
//! midway between their centroids parts; (x)₊ is max(0, x) and (x)₁ is min(1, x). Lumbar
//! segments turn by less than 20° and part by a few millimetres (White & Panjabi 1990, table 2-6). The
//! weight is a small share of the target: the chain decides between poses that explain the surface
//! almost equally well, and never against the surface.

use nalgebra::Isometry3;

use crate::model::Vertebra;

/// Turn that costs nothing, rad (15°).
const FREE_TURN_RAD: f64 = 0.262;
/// Parting that costs nothing, mm.
const FREE_PARTING_MM: f64 = 6.0;
/// Most that each of the two can cost, as a share of the target.
const WEIGHT: f64 = 0.01;

/// Cost of a pose of vertebra `v` given the poses of the others.
pub(crate) fn chain_cost(
    vertebrae: &[Vertebra],
    v: usize,
    pose: &Isometry3<f64>,
    poses: &[Isometry3<f64>],
) -> f64 {
    let mut cost = 0.0;
    for u in [v.checked_sub(1), Some(v + 1)].into_iter().flatten() {
        let (Some(neighbour), Some(other)) = (vertebrae.get(u), poses.get(u)) else {
            continue;
        };
        let turn_rad = pose.rotation.angle_to(&other.rotation);
        let middle = nalgebra::center(&vertebrae[v].bone.centroid(), &neighbour.bone.centroid());
        let parting_mm = (pose * middle - other * middle).norm();
        cost += WEIGHT * (excess(turn_rad, FREE_TURN_RAD) + excess(parting_mm, FREE_PARTING_MM));
    }
    cost
}

/// Squared share by which a figure exceeds what is free, at most 1.
fn excess(figure: f64, free: f64) -> f64 {
    let share = ((figure - free) / free).clamp(0.0, 1.0);
    share * share
}
