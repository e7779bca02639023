//! The planner beside a dense search over lines: two offsets in the isthmus and two slopes on a
//! regular grid, then finer grids around the best.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::{
    Catalogue, CheckOptions, FacetViolation, Level, Pedicle, PlannerError, PlannerOptions, Side,
    Trajectory, VertebraAnatomy, articular_points, check_trajectory, plan_from_stock,
};

/// Thinnest lumbar pedicle screw; what is thinner is a guide wire, mm.
pub(super) const THINNEST_SCREW_MM: f64 = 4.0;
/// By how much a dense search may be better, mm.
pub(super) const LIMIT_MM: f64 = 0.3;
/// Half the width of the first grid: offsets mm, slopes.
const REACH: [f64; 4] = [3.0, 4.5, 0.35, 0.35];
/// Steps from the middle of a grid to its border.
const STEPS: i32 = 3;
/// Each next grid around the best is smaller by this.
const SHRINK: f64 = 0.45;
/// Grids, one after the other.
const ROUNDS: usize = 5;
/// Bone kept in front of the tip, mm.
const TIP_MARGIN_MM: f64 = 4.0;

/// The clearance of a planned screw and of the best that was found.
pub(super) struct PlanError {
    pub(super) name: String,
    pub(super) planned_mm: f64,
    pub(super) best_mm: f64,
}

/// The screw that `pedicle plan` gives.
pub(super) fn planned(
    spine: &[VertebraAnatomy],
    pairs: &[(Level, &TriMesh)],
    place: (Level, Side),
) -> Result<Trajectory, PlannerError> {
    let options = PlannerOptions {
        length_mm: 45.0,
        min_clearance_mm: 1.0,
        ..PlannerOptions::default()
    };
    let screw = plan_from_stock(spine, pairs, place, &Catalogue::default(), &options)?;
    Ok(screw.trajectory)
}

/// Looks for a line of the same diameter and length with more clearance.
/// It keeps to the limits of the plan: bone in front of the tip and the facet joint as clear.
pub(super) fn search(
    name: &str,
    spine: &[VertebraAnatomy],
    pairs: &[(Level, &TriMesh)],
    t: &Trajectory,
) -> Option<PlanError> {
    let v = spine.iter().find(|v| v.level == t.level)?;
    let pedicle = &v.pedicle(t.side).ok()?.pedicle;
    let facets = facets(spine, pairs, t.level);
    let facet = |t: &Trajectory| FacetViolation::of(t, &facets).grade;
    let facet_of_plan = facet(t);
    let clearance = |t: &Trajectory| {
        if facet(t) > facet_of_plan {
            return None;
        }
        let options = CheckOptions::default();
        let check = check_trajectory(t, &v.surface, pedicle, &v.frame, &options).ok()?;
        check.valid.then(|| check.min_clearance_mm())
    };
    let planned_mm = clearance(t)?;
    let mut middle = [0.0; 4];
    let mut reach = REACH;
    let mut best_mm = f64::NEG_INFINITY;
    for _ in 0..ROUNDS {
        let around = middle;
        for k in 0..(2 * STEPS + 1).pow(4) {
            let at = std::array::from_fn(|i| {
                let digit = k / (2 * STEPS + 1).pow(i as u32) % (2 * STEPS + 1) - STEPS;
                around[i] + reach[i] * f64::from(digit) / f64::from(STEPS)
            });
            let Some(candidate) = line(v, pedicle, t, at) else {
                continue;
            };
            if let Some(found) = clearance(&candidate).filter(|c| *c > best_mm) {
                best_mm = found;
                middle = at;
            }
        }
        reach = reach.map(|r| r * SHRINK);
    }
    Some(PlanError {
        name: format!("{name} {} {}", t.level, t.side),
        planned_mm,
        best_mm,
    })
}

/// The upper articular surface of a level.
fn facets(
    spine: &[VertebraAnatomy],
    pairs: &[(Level, &TriMesh)],
    level: Level,
) -> Vec<Point3<f64>> {
    let above = spine.iter().find(|v| v.level.index() + 1 == level.index());
    let own = pairs.iter().find(|(l, _)| *l == level);
    match (above, own) {
        (Some(above), Some((_, mesh))) => articular_points(mesh, &above.surface),
        _ => Vec::new(),
    }
}

/// The screw on a line, if it has an entry behind and keeps its distance in front.
fn line(
    v: &VertebraAnatomy,
    pedicle: &Pedicle,
    t: &Trajectory,
    [across, upward, medial, up]: [f64; 4],
) -> Option<Trajectory> {
    let height = pedicle.axis.cross(&pedicle.width_direction);
    let through: Point3<f64> =
        pedicle.isthmus_center_mm + pedicle.width_direction * across + height * upward;
    let inward: Vector3<f64> = -v.frame.left * t.side.sign();
    let direction = (pedicle.axis + inward * medial + v.frame.up * up).normalize();
    let entry = v.surface.cast_ray(&through, &-direction, 40.0)?;
    if entry.distance_mm <= pedicle.behind_mm + TIP_MARGIN_MM {
        return None;
    }
    let tip_mm = entry.point + direction * t.length_mm();
    (v.surface.signed_distance_mm(&tip_mm) <= -TIP_MARGIN_MM).then_some(Trajectory {
        entry_mm: entry.point,
        tip_mm,
        ..*t
    })
}
