//! The isthmus of a pedicle, refined on the surface around it.
//!
//! ```text
//! place   A(t) ≈ A₀ + k (t - t₀)²,   isthmus at t₀
//! axis    a ∝ n + Σ_t t c⊥(t) / Σ_t t²
//! ```
//!
//! A(t) area and c⊥(t) centroid of the section at t along the axis n, from the isthmus, across n.
//! Both steps are repeated until they rest. The second asks for a neck: a stretch along which
//! sections hardly grow. Where the neck is short, as in most real pedicles, centroids follow the
//! parts that merge there and not the pedicle, so the first axis is kept. Lengths in mm.

use std::cell::OnceCell;

use nalgebra::{Matrix3, Point2, Point3, Vector3};
use pedicle_mesh::TriMesh;

use crate::section::{Contour, Plane, Slicer, contour_around};

/// Spacing of the sections whose areas are compared, mm.
const SPACING_MM: f64 = 0.25;
/// Sections on either side that a search for the narrowest looks at.
const SEARCH_SECTIONS: i32 = 16;
/// Sections on either side of the narrowest that the parabola is fitted to.
const FIT_SECTIONS: i32 = 4;
/// Sections on either side of the isthmus whose centroids tell the axis.
const AXIS_SECTIONS: i32 = 10;
/// How far from the isthmus those sections reach, mm.
const AXIS_REACH_MM: f64 = 1.0;
/// The neck: sections with at most this times the area of the narrowest.
const NECK_AREA_RATIO: f64 = 1.1;
/// A shorter neck does not tell the axis, mm.
pub(crate) const MIN_NECK_MM: f64 = 4.2;
/// Largest number of rounds.
const MAX_ROUNDS: usize = 12;
/// The rounds end when neither the isthmus moves nor its axis turns by more than this: mm, radians.
const REST: (f64, f64) = (0.02, 2e-3);
/// Largest turn in one round, radians: far off, the outer parts of a section lie.
const MAX_STEP_RAD: f64 = 0.1;
/// Largest turn from the first axis, radians.
const MAX_TURN_RAD: f64 = 0.4;

/// A section through a pedicle.
#[derive(Debug, Clone)]
pub(crate) struct Section {
    /// Its plane; the normal is the axis.
    pub(crate) plane: Plane,
    pub(crate) contour: Contour,
    /// Centroid of the section.
    pub(crate) center: Point2<f64>,
}

impl Isthmus {
    /// The contour in space, mm.
    pub(crate) fn contour_mm(&self) -> Vec<Point3<f64>> {
        let Section { plane, contour, .. } = &self.section;
        contour.points.iter().map(|p| plane.to_space(p)).collect()
    }
}

impl Section {
    /// The section around a point, perpendicular to an axis.
    fn at(slicer: &Slicer, p: Point3<f64>, axis: Vector3<f64>, x: Vector3<f64>) -> Option<Self> {
        let plane = Plane::new(p, axis, x)?;
        let contours = slicer.section(&plane);
        let contour = contour_around(&contours, &Point2::origin())?.clone();
        let center = contour.centroid()?;
        Some(Self {
            plane,
            contour,
            center,
        })
    }

    pub(crate) fn center_mm(&self) -> Point3<f64> {
        self.plane.to_space(&self.center)
    }
}

/// A refined isthmus.
#[derive(Debug, Clone)]
pub(crate) struct Isthmus {
    pub(crate) section: Section,
    /// Length of the neck, mm; at most what the search looks at.
    pub(crate) neck_mm: f64,
    /// Whether sections get larger on both sides within the search.
    pub(crate) is_narrowest: bool,
}

/// The isthmus near a point, with an axis near the one given; `None` if there is no closed section.
///
/// `x` is the direction of the first axis of the section's plane.
pub(crate) fn refined_isthmus(
    mesh: &TriMesh,
    near: Point3<f64>,
    first_axis: Vector3<f64>,
    x: Vector3<f64>,
) -> Option<Isthmus> {
    let first = narrowest(mesh, near, first_axis, x)?;
    let mut best = first.clone();
    for _ in 0..MAX_ROUNDS {
        let (center, axis) = (best.section.center_mm(), best.section.plane.normal());
        let next_axis = step(axis, axis_of_centers(mesh, &best.section, x)?);
        let Some(next) = narrowest(mesh, center, next_axis, x) else {
            return Some(first);
        };
        best = next;
        let moved = (best.section.center_mm() - center).norm();
        if moved < REST.0 && next_axis.angle(&axis) < REST.1 {
            break;
        }
    }
    let turn = best.section.plane.normal().angle(&first_axis);
    let believed = best.neck_mm >= MIN_NECK_MM && best.is_narrowest && turn <= MAX_TURN_RAD;
    Some(if believed { best } else { first })
}

/// From one direction towards another, by the largest step at most.
fn step(from: Vector3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    let angle = from.angle(&to);
    if angle <= MAX_STEP_RAD {
        return to;
    }
    let across = (to - from * from.dot(&to)).normalize();
    from * MAX_STEP_RAD.cos() + across * MAX_STEP_RAD.sin()
}

/// The direction of the line through the centroids of the sections around the isthmus.
fn axis_of_centers(mesh: &TriMesh, isthmus: &Section, x: Vector3<f64>) -> Option<Vector3<f64>> {
    let normal = isthmus.plane.normal();
    let middle = isthmus.center_mm();
    let slicer = Slicer::new(mesh, middle, normal, (-AXIS_REACH_MM, AXIS_REACH_MM));
    let (mut slope, mut weight) = (Vector3::zeros(), 0.0);
    for k in -AXIS_SECTIONS..=AXIS_SECTIONS {
        let t = f64::from(k) / f64::from(AXIS_SECTIONS) * AXIS_REACH_MM;
        if let Some(section) = Section::at(&slicer, middle + normal * t, normal, x) {
            let offset = section.center_mm() - middle;
            slope += (offset - normal * offset.dot(&normal)) * t;
            weight += t * t;
        }
    }
    (normal + slope / weight).try_normalize(f64::MIN_POSITIVE)
}

/// The narrowest section along an axis near a point.
fn narrowest(
    mesh: &TriMesh,
    near: Point3<f64>,
    axis: Vector3<f64>,
    x: Vector3<f64>,
) -> Option<Isthmus> {
    let reach = f64::from(SEARCH_SECTIONS + FIT_SECTIONS) * SPACING_MM;
    let slicer = Slicer::new(mesh, near, axis, (-reach, reach));
    let at = |t: f64| Section::at(&slicer, near + axis * t, axis, x);
    let area = |k: i32| at(f64::from(k) * SPACING_MM).map(|s| s.contour.area());
    let areas = vec![OnceCell::new(); 2 * SEARCH_SECTIONS as usize + 1];
    // Only what is asked for is cut.
    let area_at = |k: i32| {
        let index = usize::try_from(k + SEARCH_SECTIONS).ok()?;
        *areas.get(index)?.get_or_init(|| area(k))
    };
    // Walk downhill: another narrow place further off is another part of the bone.
    let mut k = 0;
    area_at(k)?;
    loop {
        let here = area_at(k)?;
        let lower = [k - 1, k + 1, k - 2, k + 2]
            .into_iter()
            .filter(|&n| area_at(n).is_some_and(|a| a < here))
            .min_by(|&a, &b| {
                let of = |n| area_at(n).unwrap_or(f64::INFINITY);
                of(a).total_cmp(&of(b))
            });
        match lower {
            Some(next) => k = next,
            None => break,
        }
    }
    let samples: Vec<(f64, f64)> = (k - FIT_SECTIONS..=k + FIT_SECTIONS)
        .filter_map(|n| Some((f64::from(n - k) * SPACING_MM, area_at(n)?)))
        .collect();
    let smallest = area_at(k)?;
    let on_neck = |n: &i32| area_at(*n).is_some_and(|a| a <= NECK_AREA_RATIO * smallest);
    let behind = (1..).map(|i| k - i).take_while(on_neck).count();
    let ahead = (1..).map(|i| k + i).take_while(on_neck).count();
    let bottom = f64::from(k) * SPACING_MM + vertex_of_parabola(&samples).unwrap_or(0.0);
    Some(Isthmus {
        section: at(bottom).or_else(|| at(f64::from(k) * SPACING_MM))?,
        neck_mm: (behind + ahead) as f64 * SPACING_MM,
        is_narrowest: k.abs() < SEARCH_SECTIONS,
    })
}

/// Where the least-squares parabola through the samples has its minimum, if it has one among them.
fn vertex_of_parabola(samples: &[(f64, f64)]) -> Option<f64> {
    let (mut moment, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, area) in samples {
        let row = Vector3::new(1.0, *t, t * t);
        moment += row * row.transpose();
        right += row * *area;
    }
    let [_, slope, curvature]: [f64; 3] = moment.lu().solve(&right)?.into();
    let vertex = -0.5 * slope / curvature;
    let reach = f64::from(FIT_SECTIONS) * SPACING_MM;
    (curvature > 0.0 && vertex.abs() <= reach).then_some(vertex)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_vertex_of_a_parabola_is_exact() {
        let samples: Vec<(f64, f64)> = (-4..=4)
            .map(|k| f64::from(k) * 0.25)
            .map(|t| (t, 90.0 + 0.7 * (t - 0.33).powi(2)))
            .collect();
        let vertex = vertex_of_parabola(&samples).unwrap();
        assert!((vertex - 0.33).abs() < 1e-9, "{vertex}");
        let upside_down: Vec<(f64, f64)> = samples.iter().map(|(t, a)| (*t, -a)).collect();
        assert_eq!(vertex_of_parabola(&upside_down), None, "a maximum");
    }
}
