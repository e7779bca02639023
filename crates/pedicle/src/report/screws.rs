//! One screw against the bone that it is in.

use nalgebra::{Isometry3, Matrix2, Point2, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_registration::PoseCovariance;
use pedicle_report::ScrewReport;
use pedicle_report::chart::{Band, Curve, Outline, OutlineView, Series, Zone};
use pedicle_trajectory::{
    IsthmusSection, Pedicle, Side, Trajectory, TrajectoryCheck, Zone as BoneZone,
};

use super::scene::screw_name;

/// Standard deviations on either side of a curve that hold 95 %.
const BAND_DEVIATIONS: f64 = 1.96;
/// Share of the positions in the ellipse at the isthmus.
const ELLIPSE_SHARE: f64 = 0.95;

/// A screw with its check, in the frame of the bone.
#[derive(Debug, Clone, Copy)]
pub struct CheckedScrew<'a> {
    /// What it is, such as "planned".
    pub name: &'a str,
    /// Colour and dash of it.
    pub series: Series,
    /// Where it lies.
    pub trajectory: &'a Trajectory,
    /// What [`check_trajectory`](pedicle_trajectory::check_trajectory) found.
    pub check: &'a TrajectoryCheck,
}

/// How well the pose of the bone is known.
#[derive(Debug, Clone, Copy)]
pub struct PoseDoubt<'a> {
    /// The pose found.
    pub target_from_source: &'a Isometry3<f64>,
    /// Its covariance, in the target frame.
    pub covariance: &'a PoseCovariance,
}

/// Grade of Gertzbein and Robbins (Spine 1990): A without a breach, B below 2 mm, C below 4, D below 6,
/// E from there on; "missed" for a screw beside its pedicle.
#[must_use]
pub fn grade(check: &TrajectoryCheck) -> &'static str {
    let breach_mm = check.breach_mm;
    if !check.through_pedicle {
        "missed"
    } else if breach_mm <= 0.0 {
        "A"
    } else if breach_mm < 2.0 {
        "B"
    } else if breach_mm < 4.0 {
        "C"
    } else if breach_mm < 6.0 {
        "D"
    } else {
        "E"
    }
}

/// Profiles, section and grades of one screw in one pedicle; the first of `screws` names it. Verdict,
/// reasons and deviations are left for the caller.
///
/// # Panics
/// If there is no screw.
#[must_use]
pub fn screw_report(
    screws: &[CheckedScrew<'_>],
    bone: &TriMesh,
    pedicle: Option<&Pedicle>,
    doubt: Option<PoseDoubt<'_>>,
) -> ScrewReport {
    assert!(!screws.is_empty(), "a report is about a screw");
    let first = &screws[0];
    let profile = screws.iter().map(profile_of).collect();
    ScrewReport {
        name: screw_name(first.trajectory),
        size_mm: (first.trajectory.diameter_mm, first.trajectory.length_mm()),
        is_accepted: first.check.valid,
        grades: screws
            .iter()
            .map(|s| (s.name.to_owned(), grade(s.check).to_owned()))
            .collect(),
        profile,
        profile_band: doubt.map(|doubt| band(first, doubt)),
        zones: zones(first.check),
        isthmus: pedicle.map(|pedicle| isthmus(screws, bone, pedicle, doubt)),
        facts: vec![(
            "least clearance".to_owned(),
            format!("{:.2} mm", first.check.min_clearance_mm()),
        )],
        reasons: screws.iter().filter_map(breach_in_words).collect(),
        ..ScrewReport::default()
    }
}

fn breach_in_words(screw: &CheckedScrew<'_>) -> Option<String> {
    let CheckedScrew { name, check, .. } = screw;
    if !check.through_pedicle {
        return Some(format!(
            "The {name} screw does not run through its pedicle."
        ));
    }
    let to = check
        .breach_direction
        .map_or_else(String::new, |direction| format!(", {direction}"));
    (check.breach_mm > 0.0).then(|| {
        format!(
            "The {name} screw reaches {:.2} mm beyond the cortex{to}.",
            check.breach_mm
        )
    })
}

fn profile_of(screw: &CheckedScrew<'_>) -> Curve {
    Curve {
        name: screw.name.to_owned(),
        series: screw.series,
        points: screw
            .check
            .profile
            .iter()
            .map(|sample| (sample.depth_mm, sample.clearance_mm))
            .collect(),
    }
}

/// The clearance less and more what the doubt about the pose moves the wall at right angles.
fn band(screw: &CheckedScrew<'_>, doubt: PoseDoubt<'_>) -> Band {
    let axis = screw.trajectory.direction();
    let points = screw
        .check
        .profile
        .iter()
        .map(|sample| {
            let at = screw.trajectory.entry_mm + axis * sample.depth_mm;
            let across = across(doubt, &at, &axis);
            let reach = BAND_DEVIATIONS * across;
            let c = sample.clearance_mm;
            (sample.depth_mm, c - reach, c + reach)
        })
        .collect();
    Band {
        name: "95 %".to_owned(),
        series: Series::Grey,
        points,
    }
}

/// Largest standard deviation of a point of the bone at right angles to an axis, mm.
fn across(doubt: PoseDoubt<'_>, at: &nalgebra::Point3<f64>, axis: &Vector3<f64>) -> f64 {
    let in_source = covariance_in_source(doubt, at);
    let one = axis.cross(&least_along(axis)).normalize();
    let other = axis.cross(&one);
    let plane = in_plane(&in_source, &[one, other]);
    let largest = plane.symmetric_eigenvalues().max();
    if largest > 0.0 { largest.sqrt() } else { 0.0 }
}

/// The coordinate axis that a direction follows least.
fn least_along(axis: &Vector3<f64>) -> Vector3<f64> {
    let mut out = Vector3::zeros();
    out[axis.iamin()] = 1.0;
    out
}

fn covariance_in_source(
    doubt: PoseDoubt<'_>,
    at: &nalgebra::Point3<f64>,
) -> nalgebra::Matrix3<f64> {
    let turn = doubt.target_from_source.rotation.to_rotation_matrix();
    let in_target = doubt
        .covariance
        .point_covariance(&(doubt.target_from_source * at));
    turn.matrix().transpose() * in_target * turn.matrix()
}

fn in_plane(covariance: &nalgebra::Matrix3<f64>, directions: &[Vector3<f64>; 2]) -> Matrix2<f64> {
    Matrix2::from_fn(|i, j| directions[i].dot(&(covariance * directions[j])))
}

/// Stretches of the screw in one part of the bone.
fn zones(check: &TrajectoryCheck) -> Vec<Zone> {
    let mut zones: Vec<(BoneZone, f64, f64)> = Vec::new();
    for sample in &check.profile {
        match zones.last_mut() {
            Some(last) if last.0 == sample.zone => last.2 = sample.depth_mm,
            Some(last) => {
                last.2 = sample.depth_mm;
                zones.push((sample.zone, sample.depth_mm, sample.depth_mm));
            }
            None => zones.push((sample.zone, sample.depth_mm, sample.depth_mm)),
        }
    }
    zones
        .into_iter()
        .map(|(zone, from, to)| Zone {
            name: match zone {
                BoneZone::Entry => "entry",
                BoneZone::Pedicle => "pedicle",
                BoneZone::Body => "body",
            }
            .to_owned(),
            range: (from, to),
            is_grey: zone == BoneZone::Entry,
        })
        .collect()
}

fn isthmus(
    screws: &[CheckedScrew<'_>],
    bone: &TriMesh,
    pedicle: &Pedicle,
    doubt: Option<PoseDoubt<'_>>,
) -> OutlineView {
    let section = IsthmusSection::new(bone, pedicle);
    let mut outlines: Vec<Outline> = screws
        .iter()
        .filter_map(|screw| cut_screw(screw, pedicle, &section))
        .collect();
    if let (Some(doubt), Some(last)) = (doubt, outlines.last()) {
        let center_mm = last.center_mm;
        let covariance = covariance_in_source(doubt, &pedicle.isthmus_center_mm);
        let plane = in_plane(&covariance, &section.directions());
        let name = "95 % of its axis";
        outlines.push(Outline::of_covariance(
            name,
            center_mm,
            &plane,
            ELLIPSE_SHARE,
        ));
    }
    let (left, right) = match pedicle.side {
        Side::Left => ("lateral", "medial"),
        Side::Right => ("medial", "lateral"),
    };
    OutlineView {
        label: format!(
            "Pedicle {} across the isthmus, with the screw",
            screw_name(screws[0].trajectory)
        ),
        contours: near_the_pedicle(section.contours_mm),
        outlines,
        directions: [left, right, "cranial", "caudal"].map(String::from),
    }
}

/// The contour around the isthmus: the plane may meet other parts of the bone.
fn near_the_pedicle(contours: Vec<Vec<Point2<f64>>>) -> Vec<Vec<Point2<f64>>> {
    let nearest = |c: &Vec<Point2<f64>>| {
        c.iter()
            .map(|p| p.coords.norm())
            .fold(f64::INFINITY, f64::min)
    };
    let best = contours
        .into_iter()
        .min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    best.into_iter().collect()
}

/// The ellipse in which a plane cuts the cylinder; none if the two are parallel.
fn cut_screw(
    screw: &CheckedScrew<'_>,
    pedicle: &Pedicle,
    section: &IsthmusSection,
) -> Option<Outline> {
    let axis = screw.trajectory.direction();
    let alignment = axis.dot(&pedicle.axis).abs();
    if alignment < 0.1 {
        return None;
    }
    let ahead = pedicle.isthmus_center_mm - screw.trajectory.entry_mm;
    let depth = ahead.dot(&pedicle.axis) / axis.dot(&pedicle.axis);
    let (center_mm, _) = section.coordinates(&(screw.trajectory.entry_mm + axis * depth));
    // Longer by 1/cos along the part of the axis that lies in the plane.
    let tilt = section.directions().map(|d| d.dot(&axis));
    let tilt = nalgebra::Vector2::from(tilt);
    let stretch = tilt.try_normalize(1e-9).map_or_else(Matrix2::zeros, |d| {
        d * d.transpose() * (1.0 / alignment - 1.0)
    });
    Some(Outline {
        name: format!("{} screw", screw.name),
        series: screw.series,
        center_mm,
        shape_mm: (Matrix2::identity() + stretch) * (0.5 * screw.trajectory.diameter_mm),
        is_filled: true,
    })
}
