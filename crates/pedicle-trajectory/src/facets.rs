//! Whether a screw violates the facet joint with the vertebra above.
//!
//! ```text
//! d = min_p |p - axis| - r over points p of the upper articular surface
//! 0: d > 1,   1: 0 < d ≤ 1,   2: d ≤ 0,   3: the axis itself passes within 1 mm of the surface
//! ```
//!
//! Babu et al., Spine 37(19), 2012, grade a CT by eye: 0 screw outside of the facet, 1 in the
//! lateral facet but not in the articulation, 2 penetrates the articulation, 3 travels within the
//! articular surface. These are the distances that come nearest to that. The articular surface is
//! the part of a vertebra that lies close to its upper neighbour. Lengths in mm.

use nalgebra::Point3;
use pedicle_mesh::{SurfaceIndex, TriMesh};

use crate::Trajectory;

/// Babu's grade of a facet violation, 0 (none) to 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacetViolation {
    /// 0, 1, 2 or 3.
    pub grade: u8,
    /// From the screw's wall to the upper articular surface, mm; negative if it is cut; `None`
    /// without a vertebra above to tell where that surface is.
    pub distance_mm: Option<f64>,
}

/// A joint: points of the lower vertebra nearer to the upper one than this, mm. Cartilage and joint
/// space together are about 2 to 4 mm.
const JOINT_GAP_MM: f64 = 3.5;
/// A wall nearer to the articular surface than this is in the facet, mm.
pub(crate) const FACET_MM: f64 = 1.0;

/// The vertices of a vertebra that face the one above across a facet joint, mm.
#[must_use]
pub fn articular_points(own: &TriMesh, above: &SurfaceIndex) -> Vec<Point3<f64>> {
    own.vertices()
        .iter()
        .filter(|p| above.closest_point_within(p, JOINT_GAP_MM).is_some())
        .copied()
        .collect()
}

/// Distance from the screw's axis, entry to tip, to the nearest of the points.
pub(crate) fn axis_distance_mm(screw: &Trajectory, points: &[Point3<f64>]) -> Option<f64> {
    let (axis, length) = (screw.direction(), screw.length_mm());
    points
        .iter()
        .map(|p| {
            let along = (p - screw.entry_mm).dot(&axis).clamp(0.0, length);
            (p - (screw.entry_mm + axis * along)).norm()
        })
        .min_by(f64::total_cmp)
}

impl FacetViolation {
    /// The grade of a screw beside the articular points of its vertebra ([`articular_points`]).
    #[must_use]
    pub fn of(screw: &Trajectory, points: &[Point3<f64>]) -> Self {
        let Some(axis_mm) = axis_distance_mm(screw, points) else {
            return Self {
                grade: 0,
                distance_mm: None,
            };
        };
        let distance_mm = axis_mm - 0.5 * screw.diameter_mm;
        let grade = if axis_mm <= FACET_MM {
            3
        } else if distance_mm <= 0.0 {
            2
        } else if distance_mm <= FACET_MM {
            1
        } else {
            0
        };
        Self {
            grade,
            distance_mm: Some(distance_mm),
        }
    }
}
