//! What the intra-operative sensor gave.

use nalgebra::Point3;
use pedicle_mesh::{RepairReport, TriMesh};
use pedicle_trajectory::Landmarks;

/// The surface seen.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetSurface {
    /// A mesh, mm.
    Mesh(TriMesh),
    /// Points without normals, mm.
    Cloud(Vec<Point3<f64>>),
}

/// Where a depth camera stood. Between it and every point it saw there is nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorView {
    /// Centre of projection in the target frame, mm.
    pub camera_mm: Point3<f64>,
}

/// The intra-operative side: one surface in its own frame, rough landmarks, and the camera if
/// there was one.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The surface seen.
    pub surface: TargetSurface,
    /// The top of each spinous process, to some millimetres; at most one a level. Those that are
    /// not given are done without.
    pub landmarks: Landmarks,
    /// The camera that saw the surface; `None` if it is not known or there was none.
    pub view: Option<SensorView>,
}

impl Target {
    /// A mesh as target.
    #[must_use]
    pub fn mesh(mesh: TriMesh, landmarks: Landmarks) -> Self {
        Self {
            surface: TargetSurface::Mesh(mesh),
            landmarks,
            view: None,
        }
    }

    /// Points without normals as target.
    #[must_use]
    pub fn cloud(points: Vec<Point3<f64>>, landmarks: Landmarks) -> Self {
        Self {
            surface: TargetSurface::Cloud(points),
            landmarks,
            view: None,
        }
    }

    /// The same target with the camera that saw it.
    #[must_use]
    pub fn seen_from(mut self, view: SensorView) -> Self {
        self.view = Some(view);
        self
    }
}

/// What the preparation of the target had to change.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetChanges {
    /// Degenerate and doubled faces and unreferenced vertices removed; all zero for a cloud.
    pub repair: RepairReport,
    /// Faces of crumbs left out of the map (not of the registration).
    pub n_faces_not_in_map: usize,
    /// Points of a cloud or of a camera's mesh removed because they float alone.
    pub n_points_alone: usize,
}
