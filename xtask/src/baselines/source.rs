//! The pre-operative spine as the simpler methods use it.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh, concatenate};
use pedicle_registration::{PointSurface, ReferenceSurface, SurfaceHit};
use pedicle_simulation::SpineCase;
use pedicle_trajectory::{AnatomicalFrame, Landmarks, Level, anatomical_frames};

use super::by_level;
use super::published::MapSource;
use crate::XtaskError;

/// One vertebra of the source.
pub(crate) struct SourceBone {
    pub(crate) level: Level,
    /// Vertices and normals of the full-resolution surface, for point-to-plane.
    pub(crate) surface: PointSurface,
    pub(crate) centroid: Point3<f64>,
    /// Largest distance of a vertex from the centroid, mm.
    pub(crate) radius_mm: f64,
    pub(crate) landmark: Point3<f64>,
}

/// The spine, prepared once.
pub(crate) struct Source {
    pub(crate) bones: Vec<SourceBone>,
    /// All full-resolution triangles.
    pub(crate) whole: PlaneSurface,
    pub(crate) map: MapSource,
}

/// The triangles of a surface, searched exactly.
pub(crate) struct PlaneSurface {
    index: SurfaceIndex,
}

impl PlaneSurface {
    pub(crate) fn new(mesh: &TriMesh) -> Result<Self, XtaskError> {
        let index = SurfaceIndex::new(mesh).map_err(mesh_error)?;
        Ok(Self { index })
    }
}

impl ReferenceSurface for PlaneSurface {
    fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
        let hit = self.index.closest_point(point);
        SurfaceHit::towards(point, hit.point, hit.normal)
    }
}

impl Source {
    /// Takes the full-resolution surfaces for registration and the simplified ones, from which the
    /// published targets are made, for the functional map.
    pub(crate) fn new(case: &SpineCase, landmarks: &Landmarks) -> Result<Self, XtaskError> {
        let vertebrae = case.vertebrae();
        let surfaces: Vec<&TriMesh> = vertebrae.iter().map(|v| &v.surface).collect();
        let pairs: Vec<(Level, &TriMesh)> =
            vertebrae.iter().map(|v| (v.level, &v.surface)).collect();
        let frames: Vec<AnatomicalFrame> =
            anatomical_frames(&pairs).map_err(|error| XtaskError::Anatomy {
                spine: NAME.to_owned(),
                error,
            })?;
        let bones = vertebrae
            .iter()
            .zip(by_level(landmarks))
            .map(|(vertebra, landmark)| {
                let landmark = landmark.ok_or_else(|| stage("a source landmark is missing"))?;
                bone(vertebra.level, &vertebra.surface, landmark)
            })
            .collect::<Result<Vec<_>, XtaskError>>()?;
        let whole = concatenate(&surfaces).map_err(mesh_error)?;
        let meshes: Vec<&TriMesh> = vertebrae.iter().map(|v| &v.mesh).collect();
        Ok(Self {
            bones,
            whole: PlaneSurface::new(&whole)?,
            map: MapSource::new(&meshes, &frames).map_err(stage)?,
        })
    }
}

fn bone(level: Level, mesh: &TriMesh, landmark: Point3<f64>) -> Result<SourceBone, XtaskError> {
    // A vertex of slivers alone may have no normal: it is left out.
    let (points, normals): (Vec<Point3<f64>>, Vec<Vector3<f64>>) = mesh
        .vertices()
        .iter()
        .zip(mesh.vertex_normals())
        .filter(|(_, normal)| normal.norm() > 0.5)
        .map(|(point, normal)| (*point, normal))
        .unzip();
    let centroid = mesh.centroid();
    let radius_mm = points
        .iter()
        .map(|p| (p - centroid).norm())
        .fold(0.0, |most, d| if d > most { d } else { most });
    Ok(SourceBone {
        level,
        surface: PointSurface::new(&points, &normals).map_err(stage)?,
        centroid,
        radius_mm,
        landmark,
    })
}

const NAME: &str = "source of the baselines";

fn mesh_error(error: pedicle_mesh::MeshError) -> XtaskError {
    XtaskError::Mesh {
        spine: NAME.to_owned(),
        error,
    }
}

fn stage(reason: impl ToString) -> XtaskError {
    XtaskError::Stage {
        stage: NAME.to_owned(),
        reason: reason.to_string(),
    }
}
