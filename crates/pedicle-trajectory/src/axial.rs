//! The transverse angle of a pedicle as surveys read it from axial images.
//!
//! ```text
//! (p, φ) = argmin |chord(p, φ)|,   transverse angle = φ
//! ```
//!
//! In an axial section the neck of a pedicle lies between the wall of the canal and the lateral cortex.
//! p runs along the neck, φ is how far the chord through p turns from medio-lateral; the axis is at right
//! angles to the shortest chord. The median over some sections is the angle. Where a neck is too short to
//! show an axis in space, as at L5, it still shows one here. Lengths in mm.

use nalgebra::{Point2, Vector2};
use pedicle_mesh::TriMesh;

use crate::section::{Contour, Plane, Slicer};
use crate::{AnatomicalFrame, Pedicle};

/// Heights of the sections above the middle of the isthmus, mm.
const SECTIONS_MM: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// What rounding may add to their heights, mm.
const SLACK_MM: f64 = 0.1;
/// How far along the axis from the isthmus, either way, chords are laid, mm.
const ALONG_MM: f64 = 6.0;
/// Angles that are tried, degrees: published means are 10 to 30.
const ANGLES_DEG: (f64, f64) = (-15.0, 55.0);
/// Steps of the first and of the last look, mm and degrees.
const STEPS: [(f64, f64); 2] = [(1.0, 5.0), (0.25, 1.0)];
/// Each half of a chord is at least this part of the shortest chord of the isthmus: shorter ones end in a
/// groove or in a cavity of the segmentation.
const MIN_HALF_CHORD: f64 = 0.25;

/// The angle with the sagittal plane, radians, positive: converges to the front; `None` if no section shows
/// bone between two walls.
pub(crate) fn axial_transverse_angle_rad(
    mesh: &TriMesh,
    frame: &AnatomicalFrame,
    pedicle: &Pedicle,
) -> Option<f64> {
    let reach = (
        SECTIONS_MM[0] - SLACK_MM,
        SECTIONS_MM[SECTIONS_MM.len() - 1] + SLACK_MM,
    );
    let slicer = Slicer::new(mesh, pedicle.isthmus_center_mm, frame.up, reach);
    let mut found: Vec<f64> = SECTIONS_MM
        .iter()
        .filter_map(|&above| angle_of_section(&slicer, frame, pedicle, above))
        .collect();
    found.sort_by(f64::total_cmp);
    let middle = found.get(found.len() / 2)?;
    let lower = found.get((found.len() - 1) / 2)?;
    Some(0.5 * (middle + lower))
}

fn angle_of_section(
    slicer: &Slicer,
    frame: &AnatomicalFrame,
    pedicle: &Pedicle,
    above_mm: f64,
) -> Option<f64> {
    let plane = Plane {
        origin: pedicle.isthmus_center_mm + frame.up * above_mm,
        x: -frame.left * pedicle.side.sign(),
        y: frame.anterior,
    };
    let contours = slicer.section(&plane);
    let along = Vector2::new(pedicle.axis.dot(&plane.x), pedicle.axis.dot(&plane.y));
    let along = along.try_normalize(f64::MIN_POSITIVE)?;
    let least = MIN_HALF_CHORD * pedicle.narrowest_mm;
    let chord = |at_mm: f64, angle_deg: f64| {
        let p = Point2::from(along * at_mm);
        let angle = angle_deg.to_radians();
        // At right angles to an axis that converges by this much.
        let across = Vector2::new(angle.cos(), -angle.sin());
        let halves = [across, -across].map(|d| reach(&contours, &p, &d));
        (halves[0].min(halves[1]) >= least).then(|| halves[0] + halves[1])
    };
    let mut range = ((-ALONG_MM, ALONG_MM), ANGLES_DEG);
    let mut best = None;
    for (step_mm, step_deg) in STEPS {
        let (_, at, angle) = shortest(range, (step_mm, step_deg), chord)?;
        range = (
            (at - step_mm, at + step_mm),
            (angle - step_deg, angle + step_deg),
        );
        best = Some(angle.to_radians());
    }
    best
}

/// A place along the neck and an angle, from and to.
type Range = ((f64, f64), (f64, f64));

/// The shortest chord of a grid, where it is and its angle.
fn shortest(
    (along, angles): Range,
    (step_mm, step_deg): (f64, f64),
    chord: impl Fn(f64, f64) -> Option<f64>,
) -> Option<(f64, f64, f64)> {
    let spots = move |(from, to): (f64, f64), step: f64| {
        let n = ((to - from) / step).round() as usize;
        (0..=n).map(move |i| from + i as f64 * step)
    };
    spots(along, step_mm)
        .flat_map(|at| spots(angles, step_deg).map(move |angle| (at, angle)))
        .filter_map(|(at, angle)| Some((chord(at, angle)?, at, angle)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
}

/// Distance to the nearest contour along a direction; 0 if there is none.
fn reach(contours: &[Contour], p: &Point2<f64>, direction: &Vector2<f64>) -> f64 {
    let reaches = contours.iter().map(|contour| contour.reach(p, direction));
    let nearest = reaches.filter(|r| *r > 0.0).fold(f64::INFINITY, f64::min);
    if nearest.is_finite() { nearest } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_a_valley_is_found() {
        let chord = |at: f64, angle: f64| {
            let far = (at - 1.25).powi(2) + 0.01 * (angle - 23.0).powi(2);
            (angle < 50.0).then_some(9.0 + far)
        };
        let range = ((-6.0, 6.0), ANGLES_DEG);
        let (_, at, angle) = shortest(range, STEPS[0], chord).unwrap();
        assert_eq!((at, angle), (1.0, 25.0), "on the coarse grid");
        assert_eq!(shortest(range, STEPS[0], |_, _| None), None, "no wall");
    }
}
