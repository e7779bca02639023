//! The vertebral body as the section in the mirror plane shows it. Lengths in mm.

use nalgebra::{Point2, Vector2};
use pedicle_mesh::TriMesh;

use crate::section::{Contour, Plane, section};
use crate::{AnatomicalFrame, AnatomyError};

/// The vertebral body in the mirror plane.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    /// Coordinate along anterior of its posterior wall, mm.
    pub(crate) posterior_wall_mm: f64,
    /// Coordinate along anterior of its foremost point, mm.
    pub(crate) anterior_wall_mm: f64,
    /// Coordinates along up of its lowest and highest point, mm.
    pub(crate) low_mm: f64,
    pub(crate) high_mm: f64,
    /// Heights at the back, in the middle and at the front, mm.
    pub(crate) heights_mm: [f64; 3],
}

/// Contours below this part of the largest area are osteophytes, not bodies.
const BODY_AREA_RATIO: f64 = 0.4;
/// The posterior wall is looked at over this part of the height about the middle.
const WALL_HEIGHT_RATIO: f64 = 0.5;
/// Levels at which the posterior wall is looked at.
const WALL_LEVELS: usize = 9;

/// Where heights are measured: parts of the depth from the posterior wall.
const HEIGHTS_AT: [f64; 3] = [0.08, 0.5, 0.9];

impl Body {
    pub(crate) fn find(mesh: &TriMesh, frame: &AnatomicalFrame) -> Result<Self, AnatomyError> {
        let plane = Plane {
            origin: frame.origin,
            x: frame.anterior,
            y: frame.up,
        };
        let contours = section(mesh, &plane);
        let largest = contours.iter().map(Contour::area).fold(0.0, f64::max);
        // The spinous process is as large in some, but the body lies in front.
        let body = contours
            .iter()
            .filter(|c| c.area() > 0.0 && c.area() >= BODY_AREA_RATIO * largest)
            .max_by(|a, b| a.bounds().1.x.total_cmp(&b.bounds().1.x))
            .ok_or(AnatomyError::NoCanal)?;
        let (low, high) = body.bounds();
        let middle = 0.5 * (low.y + high.y);
        let mut walls: Vec<f64> = (0..WALL_LEVELS)
            .filter_map(|k| {
                let t = k as f64 / (WALL_LEVELS - 1) as f64 - 0.5;
                body.leftmost_at(middle + t * WALL_HEIGHT_RATIO * (high.y - low.y))
            })
            .collect();
        walls.sort_by(f64::total_cmp);
        let posterior_wall_mm = *walls.get(walls.len() / 2).ok_or(AnatomyError::NoCanal)?;
        let depth = high.x - posterior_wall_mm;
        let heights_mm = HEIGHTS_AT.map(|share| {
            let x = posterior_wall_mm + share * depth;
            body.chord(&Point2::new(x, middle), &Vector2::y())
        });
        Ok(Self {
            posterior_wall_mm,
            anterior_wall_mm: high.x,
            low_mm: low.y,
            high_mm: high.y,
            heights_mm,
        })
    }
}
