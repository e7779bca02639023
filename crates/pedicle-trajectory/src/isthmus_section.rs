//! The narrowest section of a pedicle as a picture.

use nalgebra::{Point2, Point3};
use pedicle_mesh::TriMesh;

use crate::Pedicle;
use crate::section::{Plane, section};

/// A vertebra cut at the isthmus of a pedicle: closed contours in the plane at right angles to the
/// pedicle's axis, seen from behind.
#[derive(Debug, Clone, PartialEq)]
pub struct IsthmusSection {
    plane: Plane,
    /// Closed contours with the bone on their left, mm from the middle of the isthmus: x towards the
    /// patient's right along the pedicle's width, y towards the head along its height.
    pub contours_mm: Vec<Vec<Point2<f64>>>,
}

impl IsthmusSection {
    /// Cuts a vertebra. Empty where the plane meets nothing.
    #[must_use]
    pub fn new(mesh: &TriMesh, pedicle: &Pedicle) -> Self {
        // Right × up points backwards, at the viewer.
        let x = -pedicle.width_direction;
        let plane = Plane {
            origin: pedicle.isthmus_center_mm,
            x,
            y: x.cross(&pedicle.axis),
        };
        let contours_mm = section(mesh, &plane)
            .into_iter()
            .map(|contour| contour.points)
            .collect();
        Self { plane, contours_mm }
    }

    /// A point of the vertebra's frame in the section's, and how far in front of the plane it lies, mm.
    #[must_use]
    pub fn coordinates(&self, p: &Point3<f64>) -> (Point2<f64>, f64) {
        let ahead = -(p - self.plane.origin).dot(&self.plane.normal());
        (self.plane.to_plane(p), ahead)
    }

    /// The directions of x and y in the vertebra's frame.
    #[must_use]
    pub fn directions(&self) -> [nalgebra::Vector3<f64>; 2] {
        [self.plane.x, self.plane.y]
    }
}
