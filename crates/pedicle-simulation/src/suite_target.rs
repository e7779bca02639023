//! What a method is given in the suites, and the truth about it.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::Landmarks;

use crate::coverage::Coverage;
use crate::{CaseVertebra, VertebraTruth};

/// The surface seen.
#[derive(Debug, Clone, PartialEq)]
pub enum TargetSurface {
    /// An unlabelled mesh in random order, mm.
    Mesh(TriMesh),
    /// Points without normals in random order, mm.
    Cloud(Vec<Point3<f64>>),
}

impl TargetSurface {
    /// Its points: the vertices of a mesh, the points of a cloud.
    #[must_use]
    pub fn points(&self) -> &[Point3<f64>] {
        match self {
            Self::Mesh(mesh) => mesh.vertices(),
            Self::Cloud(points) => points,
        }
    }

    /// The mesh, if it is one.
    #[must_use]
    pub fn mesh(&self) -> Option<&TriMesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Cloud(_) => None,
        }
    }
}

/// Where a depth camera stood. Between it and every point it saw there is nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorView {
    /// Centre of projection in the target frame, mm.
    pub camera_mm: Point3<f64>,
    /// Direction of the optical axis in the target frame, away from the camera.
    pub forward: Unit<Vector3<f64>>,
    /// Distance between neighbouring pixels at a distance of 1: the tangent of their angle.
    pub pixel_pitch: f64,
}

/// What is true about one vertebra of a suite's target. No method may look at it.
#[derive(Debug, Clone, PartialEq)]
pub struct SuiteTruth {
    /// Pose and true points. Of a target with a triangulation of its own no point comes from a
    /// source vertex: `source_vertices` is then empty. `target_vertices` are indices into the
    /// points of the target. Points that no surface has (flying pixels, soft tissue) are not told.
    pub vertebra: VertebraTruth,
    /// Whether the target has this vertebra at all. If not, no pose is valid, the pose here is
    /// without meaning and there are no points.
    pub present: bool,
    /// Share of its posterior surface that the target shows: samples of equal area behind the
    /// centroid within 1.5 mm of the true surface or points shown. Undersides and the walls of the
    /// canal count, so that a camera sees about 0.4 of bare bone.
    pub posterior_seen: f64,
    /// The same share of those samples whose normal looks backwards: a camera sees about 0.7 of
    /// bare bone.
    pub facing_seen: f64,
}

/// A simulated target of any suite with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SuiteTarget {
    /// All that is seen, in the target frame, mm.
    pub surface: TargetSurface,
    /// The landmarks as planned, one a level, in the source frame, mm.
    pub source_landmarks: Landmarks,
    /// The landmarks as touched, in the target frame, mm: off by up to 5 mm, and in
    /// [`Suite::Stress`](crate::Suite::Stress) wrong or missing.
    pub target_landmarks: Landmarks,
    /// The camera, if there is one.
    pub view: Option<SensorView>,
    /// Standard deviation along the normals of the surface, mm: the noise that bounds how well it
    /// can be registered.
    pub noise_mm: f64,
    /// One a vertebra of the source, from the top down.
    pub truth: Vec<SuiteTruth>,
}

impl SuiteTruth {
    /// The truth about a vertebra that is there.
    pub(crate) fn shown(vertebra: VertebraTruth, coverage: Coverage) -> Self {
        Self {
            vertebra,
            present: true,
            posterior_seen: coverage.posterior,
            facing_seen: coverage.facing,
        }
    }
}

/// A vertebra that is not in the target.
pub(crate) fn absent(case_vertebra: &CaseVertebra) -> SuiteTruth {
    SuiteTruth {
        vertebra: VertebraTruth {
            level: case_vertebra.level,
            target_from_source: Isometry3::identity(),
            source_centroid: case_vertebra.mesh.centroid(),
            target_points: Vec::new(),
            target_normals: Vec::new(),
            source_vertices: Vec::new(),
            target_vertices: Vec::new(),
        },
        present: false,
        posterior_seen: 0.0,
        facing_seen: 0.0,
    }
}
