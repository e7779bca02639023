//! The line of landmarks, turned about itself in steps of 30°, and ICP for each vertebra.
//!
//! ```text
//! R(φ) = Rot(u_t, φ) · R₀,   R₀ u_s = u_t,   t = l_t - R l_s
//! T = the refined one of twelve with the largest Σ_j max(0, 1 - d_j²/τ²)
//! ```
//!
//! u_s, u_t are the directions of the landmarks near the vertebra in the source and in the target,
//! l_s, l_t its own landmark; d_j are distances of target points. No functional map, no word about
//! the neighbours, and no doubt.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use pedicle_registration::{ReferenceSurface, RefineOptions, refine_on_surface};

use super::source::SourceBone;
use super::{Poses, Seen, Source, thinned};

/// Turns, every 30°.
const N_TURNS: usize = 12;
/// Landmarks at most so many levels away make the line.
const LEVELS_AWAY: usize = 2;
/// Target points of the search, of all vertebrae together.
const N_SEARCH_POINTS: usize = 2000;
/// Target points of the last ICP.
const N_FINE_POINTS: usize = 20_000;
/// Distance at which a point counts as not explained, mm.
const TRUNCATION_MM: f64 = 4.0;
/// Gates of the search and of the last ICP, mm.
const SEARCH_GATES_MM: (f64, f64) = (15.0, 5.0);
const FINE_GATE_MM: f64 = 4.0;

/// A pose for every vertebra that has a landmark and another one near it.
pub(super) fn poses(source: &Source, seen: &Seen<'_>) -> Poses {
    let search = thinned(seen.surface.points(), N_SEARCH_POINTS);
    let fine = thinned(seen.surface.points(), N_FINE_POINTS);
    (0..source.bones.len())
        .map(|v| {
            let starts = starts(source, seen, v)?;
            let bone = &source.bones[v];
            let best = starts
                .iter()
                .filter_map(|start| refined(bone, &search, start, SEARCH_GATES_MM))
                .map(|pose| (explained(bone, &search, &pose), pose))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let (_, pose) = best.ok_or("no turn about the landmarks meets a surface")?;
            Ok(refined(bone, &fine, &pose, (FINE_GATE_MM, FINE_GATE_MM)).unwrap_or(pose))
        })
        .collect()
}

/// The turns about the line through landmark `v`.
fn starts(source: &Source, seen: &Seen<'_>, v: usize) -> Result<Vec<Isometry3<f64>>, String> {
    let level = source.bones[v].level;
    let landmark = seen.landmarks[v].ok_or_else(|| format!("{level} has no landmark"))?;
    let first = v.saturating_sub(LEVELS_AWAY);
    let last = (v + LEVELS_AWAY + 1).min(source.bones.len());
    let (from, to): (Vec<Point3<f64>>, Vec<Point3<f64>>) = (first..last)
        .filter_map(|u| Some((source.bones[u].landmark, seen.landmarks[u]?)))
        .unzip();
    if from.len() < 2 {
        return Err(format!("{level}: one landmark makes no line"));
    }
    let (u_s, u_t) = (direction(&from), direction(&to));
    let align = UnitQuaternion::rotation_between(&u_s, &u_t).unwrap_or_else(|| {
        // Opposite directions: half a turn about anything square to them.
        let seed = if u_s.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let axis = Unit::new_normalize(u_s.cross(&seed));
        UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI)
    });
    let axis = Unit::new_normalize(u_t);
    Ok((0..N_TURNS)
        .map(|turn| {
            let angle = std::f64::consts::TAU * turn as f64 / N_TURNS as f64;
            let rotation = UnitQuaternion::from_axis_angle(&axis, angle) * align;
            let translation = landmark - rotation * source.bones[v].landmark;
            Isometry3::from_parts(Translation3::from(translation), rotation)
        })
        .collect())
}

/// Main axis of points, from the first to the last.
fn direction(points: &[Point3<f64>]) -> Vector3<f64> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let scatter: Matrix3<f64> = points
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let axis = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    let span = points[points.len() - 1] - points[0];
    if axis.dot(&span) < 0.0 { -axis } else { axis }
}

/// Point-to-plane ICP with the points near the vertebra.
fn refined(
    bone: &SourceBone,
    points: &[Point3<f64>],
    start: &Isometry3<f64>,
    (first_mm, last_mm): (f64, f64),
) -> Option<Isometry3<f64>> {
    let near = near(bone, points, start, first_mm);
    let options = RefineOptions {
        start_distance_mm: Some(first_mm),
        max_distance_mm: last_mm,
        ..RefineOptions::default()
    };
    let fit = refine_on_surface(&bone.surface, &near, start, &options).ok()?;
    Some(fit.target_from_source)
}

fn explained(bone: &SourceBone, points: &[Point3<f64>], pose: &Isometry3<f64>) -> f64 {
    let back = pose.inverse();
    near(bone, points, pose, TRUNCATION_MM)
        .iter()
        .map(|p| {
            let ratio = bone.surface.closest(&(back * p)).distance_mm / TRUNCATION_MM;
            let score = 1.0 - ratio * ratio;
            if score > 0.0 { score } else { 0.0 }
        })
        .sum()
}

fn near(
    bone: &SourceBone,
    points: &[Point3<f64>],
    pose: &Isometry3<f64>,
    margin_mm: f64,
) -> Vec<Point3<f64>> {
    let center = pose * bone.centroid;
    let reach = bone.radius_mm + margin_mm;
    points
        .iter()
        .copied()
        .filter(|p| (p - center).norm() <= reach)
        .collect()
}
