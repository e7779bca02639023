//! A plan judged screw by screw, in the terms of clinical studies.
//!
//! Breach and clearance are those of [`check_trajectory`], the grade follows from the breach
//! ([`Grade`]). A screw whose axis passes its isthmus by more than the width or the height of the
//! pedicle is in other bone or in none: grade E whatever it touches. Lengths in mm.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};
use pedicle_mesh::TriMesh;
use rayon::prelude::*;

use crate::facets::{FacetViolation, articular_points};
use crate::{
    AnatomyError, BreachDirection, CheckOptions, Grade, Level, Pedicle, Plan, Side, Trajectory,
    TrajectoryCheck, TrajectoryDefect, VertebraAnatomy, check_trajectory,
};

/// Another screw of the plan, and how near it comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestScrew {
    /// Its level.
    pub level: Level,
    /// Its side.
    pub side: Side,
    /// Between the two walls, mm; negative if they cross.
    pub distance_mm: f64,
}

/// What is found out about one screw.
#[derive(Debug, Clone, PartialEq)]
pub struct ScrewReport {
    /// The screw.
    pub trajectory: Trajectory,
    /// Gertzbein and Robbins.
    pub grade: Grade,
    /// The check with its profile.
    pub check: TrajectoryCheck,
    /// How far the wall reaches into the canal, mm; 0 if it does not.
    pub canal_intrusion_mm: f64,
    /// Diameter over the narrowest chord of the isthmus.
    pub fill: f64,
    /// Bone in front of the tip along the axis, mm; `None` if the tip is outside.
    pub tip_to_cortex_mm: Option<f64>,
    /// Babu.
    pub facet: FacetViolation,
    /// Cortex at the entry that the judgement skips, mm from the bone's surface.
    pub skipped_entry_mm: f64,
    /// The nearest other screw; `None` in a plan of one.
    pub nearest_screw: Option<NearestScrew>,
}

/// Why a plan cannot be judged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AssessError {
    /// The spine lacks a level that the plan has.
    #[error("the plan has a screw for {level} {side}, but the spine has no {level}")]
    NoSuchLevel {
        /// The level.
        level: Level,
        /// The side.
        side: Side,
    },
    /// The pedicle of a screw was not found.
    #[error("{level} {side}: {source}")]
    Anatomy {
        /// The level.
        level: Level,
        /// The side.
        side: Side,
        /// Why.
        source: AnatomyError,
    },
    /// The numbers are no screw.
    #[error("{level} {side}: {source}")]
    Trajectory {
        /// The level.
        level: Level,
        /// The side.
        side: Side,
        /// What is wrong.
        source: TrajectoryDefect,
    },
    /// Most screws are nowhere near their vertebrae.
    #[error(
        "{n_off} of {n_screws} entries lie more than {limit_mm} mm from their vertebra ({level} {side}: {distance_mm:.0} mm): the plan is not in the frame of the spine{}",
        if *fits_flipped { "; with x and y negated it fits, so one of the two is in RAS and the other in LPS" } else { "" }
    )]
    OffSpine {
        /// Number of screws that are off.
        n_off: usize,
        /// Number of screws.
        n_screws: usize,
        /// Limit, mm.
        limit_mm: f64,
        /// Level of the screw that is furthest off.
        level: Level,
        /// Its side.
        side: Side,
        /// How far its entry is off, mm.
        distance_mm: f64,
        /// Whether the plan fits after the change between RAS and LPS.
        fits_flipped: bool,
    },
}

/// An entry further from its vertebra than this belongs to another frame, mm.
const MAX_ENTRY_OFF_MM: f64 = 15.0;

/// Judges every screw of a plan against the measured spine it is for.
///
/// `meshes` are those that `spine` was measured on, in the same order.
///
/// # Errors
/// [`AssessError`] for a level that is not there, a pedicle that was not found, numbers that are no
/// screw, or a plan in another frame than the spine.
pub fn assess_plan(
    spine: &[VertebraAnatomy],
    meshes: &[(Level, &TriMesh)],
    plan: &Plan,
    options: &CheckOptions,
) -> Result<Vec<ScrewReport>, AssessError> {
    for t in &plan.trajectories {
        let (level, side) = (t.level, t.side);
        t.validate().map_err(|source| AssessError::Trajectory {
            level,
            side,
            source,
        })?;
        vertebra(spine, t)?;
    }
    refuse_other_frame(spine, plan)?;
    let levels: BTreeSet<Level> = plan.trajectories.iter().map(|t| t.level).collect();
    let levels: Vec<Level> = levels.into_iter().collect();
    let facets: BTreeMap<Level, Vec<Point3<f64>>> = levels
        .par_iter()
        .map(|&level| (level, facet_points(spine, meshes, level)))
        .collect();
    let reports: Vec<Result<ScrewReport, AssessError>> = plan
        .trajectories
        .par_iter()
        .map(|t| assess(spine, &facets[&t.level], plan, (t, options)))
        .collect();
    // The first error in the order of the plan, whichever came first in time.
    reports.into_iter().collect()
}

fn vertebra<'a>(
    spine: &'a [VertebraAnatomy],
    t: &Trajectory,
) -> Result<&'a VertebraAnatomy, AssessError> {
    let (level, side) = (t.level, t.side);
    spine
        .iter()
        .find(|v| v.level == level)
        .ok_or(AssessError::NoSuchLevel { level, side })
}

fn assess(
    spine: &[VertebraAnatomy],
    facet_points: &[Point3<f64>],
    plan: &Plan,
    (t, options): (&Trajectory, &CheckOptions),
) -> Result<ScrewReport, AssessError> {
    let (level, side) = (t.level, t.side);
    let v = vertebra(spine, t)?;
    let anatomy = v.pedicle(side).map_err(|source| AssessError::Anatomy {
        level,
        side,
        source,
    })?;
    let pedicle = &anatomy.pedicle;
    let check = check_trajectory(t, &v.surface, pedicle, &v.frame, options).map_err(|source| {
        AssessError::Trajectory {
            level,
            side,
            source,
        }
    })?;
    let tip_to_cortex_mm = v
        .surface
        .contains(&t.tip_mm)
        .then(|| v.surface.cast_ray(&t.tip_mm, &t.direction(), REACH_MM))
        .flatten()
        .map(|hit| hit.distance_mm);
    Ok(ScrewReport {
        trajectory: *t,
        grade: Grade::of_screw(t, &check, pedicle),
        canal_intrusion_mm: canal_intrusion_mm(&check),
        fill: t.diameter_mm / pedicle.narrowest_mm,
        tip_to_cortex_mm,
        facet: FacetViolation::of(t, facet_points),
        skipped_entry_mm: options.ignored_entry_depth_mm,
        nearest_screw: nearest_screw(plan, t),
        check,
    })
}

/// Longest ray, mm.
const REACH_MM: f64 = 120.0;

impl Grade {
    /// The grade of a checked screw: that of its breach, but E if its axis does not pass the isthmus
    /// or passes it further off than the pedicle is wide or high.
    #[must_use]
    pub fn of_screw(t: &Trajectory, check: &TrajectoryCheck, pedicle: &Pedicle) -> Self {
        let Some(depth) = check.isthmus_depth_mm else {
            return Self::E;
        };
        let offset = t.entry_mm + t.direction() * depth - pedicle.isthmus_center_mm;
        let height_direction = pedicle.axis.cross(&pedicle.width_direction);
        let elsewhere = offset.dot(&pedicle.width_direction).abs() > pedicle.width_mm
            || offset.dot(&height_direction).abs() > pedicle.height_mm;
        if elsewhere {
            return Self::E;
        }
        Self::of_breach_mm(check.breach_mm)
    }
}

fn canal_intrusion_mm(check: &TrajectoryCheck) -> f64 {
    use crate::Zone;
    check
        .profile
        .iter()
        .filter(|s| s.zone != Zone::Entry && s.direction == BreachDirection::Medial)
        .map(|s| -s.clearance_mm)
        .fold(0.0, f64::max)
}

/// The articular points of a level, if the spine has the level right above.
pub(crate) fn facet_points(
    spine: &[VertebraAnatomy],
    meshes: &[(Level, &TriMesh)],
    level: Level,
) -> Vec<Point3<f64>> {
    let above = spine.iter().find(|v| v.level.index() + 1 == level.index());
    let own = meshes.iter().find(|(l, _)| *l == level);
    match (above, own) {
        (Some(above), Some((_, mesh))) => articular_points(mesh, &above.surface),
        _ => Vec::new(),
    }
}

fn nearest_screw(plan: &Plan, t: &Trajectory) -> Option<NearestScrew> {
    plan.trajectories
        .iter()
        .filter(|other| (other.level, other.side) != (t.level, t.side))
        .map(|other| NearestScrew {
            level: other.level,
            side: other.side,
            distance_mm: segment_distance(t, other) - 0.5 * (t.diameter_mm + other.diameter_mm),
        })
        .min_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm))
}

/// Least distance between two axes, entry to tip.
///
/// The distance from a point of one segment to the other segment is convex along the first, so the
/// least one is at an end or where the derivative of the two lines' distance vanishes (Ericson,
/// Real-Time Collision Detection, section 5.1.9).
fn segment_distance(a: &Trajectory, b: &Trajectory) -> f64 {
    let (p, q) = (a.entry_mm, b.entry_mm);
    let (d, e): (Vector3<f64>, Vector3<f64>) = (a.tip_mm - p, b.tip_mm - q);
    let r = p - q;
    let (dd, ee, de, dr, er) = (d.dot(&d), e.dot(&e), d.dot(&e), d.dot(&r), e.dot(&r));
    let denominator = dd * ee - de * de;
    let mut s = if denominator > 1e-12 * dd * ee {
        ((de * er - dr * ee) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut t = (de * s + er) / ee;
    if !(0.0..=1.0).contains(&t) {
        t = t.clamp(0.0, 1.0);
        s = ((de * t - dr) / dd).clamp(0.0, 1.0);
    }
    ((p + d * s) - (q + e * t)).norm()
}

fn refuse_other_frame(spine: &[VertebraAnatomy], plan: &Plan) -> Result<(), AssessError> {
    let off = |flip: bool| -> Result<Vec<(f64, Level, Side)>, AssessError> {
        let mut off = Vec::new();
        for t in &plan.trajectories {
            let p = t.entry_mm;
            let p = if flip {
                Point3::new(-p.x, -p.y, p.z)
            } else {
                p
            };
            let distance = vertebra(spine, t)?.surface.closest_point(&p).distance_mm;
            if distance > MAX_ENTRY_OFF_MM {
                off.push((distance, t.level, t.side));
            }
        }
        Ok(off)
    };
    let n_screws = plan.trajectories.len();
    let found = off(false)?;
    let furthest = found.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(distance_mm, level, side)) = furthest.filter(|_| 2 * found.len() > n_screws) else {
        return Ok(());
    };
    Err(AssessError::OffSpine {
        n_off: found.len(),
        n_screws,
        limit_mm: MAX_ENTRY_OFF_MM,
        level,
        side,
        distance_mm,
        fits_flipped: 2 * off(true)?.len() <= n_screws,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screw(entry: [f64; 3], tip: [f64; 3]) -> Trajectory {
        Trajectory {
            level: Level::L3,
            side: Side::Left,
            entry_mm: entry.into(),
            tip_mm: tip.into(),
            diameter_mm: 6.0,
        }
    }

    #[test]
    fn distances_between_axes_are_exact() {
        let a = screw([0.0, 0.0, 0.0], [40.0, 0.0, 0.0]);
        let cases = [
            (screw([0.0, 7.0, 0.0], [40.0, 7.0, 0.0]), 7.0),
            (screw([20.0, -9.0, 3.0], [20.0, 9.0, 3.0]), 3.0),
            (screw([43.0, 4.0, 0.0], [60.0, 30.0, 0.0]), 5.0),
            (screw([-8.0, 0.0, 6.0], [-30.0, 0.0, 6.0]), 10.0),
        ];
        for (b, expected) in cases {
            for found in [segment_distance(&a, &b), segment_distance(&b, &a)] {
                assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
            }
        }
    }
}
