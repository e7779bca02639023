//! A spine to simulate with: vertebrae, their full-resolution surfaces and landmarks.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{SimplifyOptions, TriMesh, simplify};
use pedicle_trajectory::{Landmarks, Level};

use crate::SimulationError;

/// Fewest vertebrae that have an axis.
const MIN_VERTEBRAE: usize = 2;
/// A direction shorter than this is none, mm.
const SHORTEST_DIRECTION_MM: f64 = 1e-6;

/// One vertebra of a case.
#[derive(Debug, Clone, PartialEq)]
pub struct CaseVertebra {
    /// Its level.
    pub level: Level,
    /// The simplified surface the target is made from.
    pub mesh: TriMesh,
    /// The surface at full resolution, which a method may refine against.
    pub surface: TriMesh,
}

/// A spine to simulate with, in any frame, mm.
///
/// **Invariant:** at least two vertebrae, from the top down, each level once and each with exactly
/// one finite landmark; the spine has an axis and every vertebra a front.
#[derive(Debug, Clone, PartialEq)]
pub struct SpineCase {
    vertebrae: Vec<CaseVertebra>,
    landmarks: Vec<Point3<f64>>,
    axes: Vec<VertebraAxes>,
}

/// Directions at one vertebra, derived from the centroids and the landmarks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct VertebraAxes {
    /// Unit vector along the chain of centroids, upwards.
    pub(crate) up: Vector3<f64>,
    /// Unit vector to the front, square to `up`.
    pub(crate) anterior: Vector3<f64>,
}

impl SpineCase {
    /// Checks and takes the vertebrae (from the top down) and one landmark a level.
    ///
    /// # Errors
    /// [`SimulationError`] for too few vertebrae, levels out of order, landmarks missing, doubled
    /// or not finite, or a spine without an axis or a front.
    pub fn new(
        vertebrae: Vec<CaseVertebra>,
        landmarks: &Landmarks,
    ) -> Result<Self, SimulationError> {
        if vertebrae.len() < MIN_VERTEBRAE {
            return Err(SimulationError::TooFewVertebrae {
                n_vertebrae: vertebrae.len(),
                min: MIN_VERTEBRAE,
            });
        }
        for (index, pair) in vertebrae.windows(2).enumerate() {
            if pair[0].level >= pair[1].level {
                return Err(SimulationError::LevelsOutOfOrder {
                    index: index + 1,
                    level: pair[1].level,
                });
            }
        }
        let landmarks = vertebrae
            .iter()
            .map(|v| landmark_of(landmarks, v.level))
            .collect::<Result<Vec<_>, _>>()?;
        let centroids: Vec<_> = vertebrae.iter().map(|v| v.mesh.centroid()).collect();
        let axes = (0..vertebrae.len())
            .map(|i| axes_at(&centroids, &landmarks, i))
            .collect::<Result<Vec<_>, _>>()?;
        let case = Self {
            vertebrae,
            landmarks,
            axes,
        };
        case.axis_through_ends()?;
        Ok(case)
    }

    /// Simplifies full-resolution surfaces to `n_faces` faces in all (3 500 in the suite `paper`),
    /// each vertebra in proportion to its area.
    ///
    /// # Errors
    /// [`SimulationError`] as in [`SpineCase::new`], or if a surface cannot be simplified.
    pub fn from_surfaces(
        surfaces: Vec<(Level, TriMesh)>,
        landmarks: &Landmarks,
        n_faces: usize,
    ) -> Result<Self, SimulationError> {
        let area: f64 = surfaces.iter().map(|(_, surface)| surface.area()).sum();
        let vertebrae = surfaces
            .into_iter()
            .map(|(level, surface)| {
                let share = (n_faces as f64 * surface.area() / area).round() as usize;
                let mesh = simplify(&surface, share, &SimplifyOptions::default())?.mesh;
                Ok(CaseVertebra {
                    level,
                    mesh,
                    surface,
                })
            })
            .collect::<Result<Vec<_>, SimulationError>>()?;
        Self::new(vertebrae, landmarks)
    }

    /// The vertebrae from the top down.
    #[must_use]
    pub fn vertebrae(&self) -> &[CaseVertebra] {
        &self.vertebrae
    }

    /// The landmark of every vertebra, from the top down, mm.
    #[must_use]
    pub fn landmark_positions(&self) -> &[Point3<f64>] {
        &self.landmarks
    }

    /// The middle of every disc, from the top down, mm: midway between the bodies above and below
    /// it. The middle of a body is the centroid of the surface in front of the vertebra's centroid.
    #[must_use]
    pub fn disc_centers(&self) -> Vec<Point3<f64>> {
        let bodies: Vec<Point3<f64>> = self
            .vertebrae
            .iter()
            .zip(&self.axes)
            .map(|(vertebra, axes)| body_center(&vertebra.mesh, &axes.anterior))
            .collect();
        bodies
            .windows(2)
            .map(|pair| nalgebra::center(&pair[0], &pair[1]))
            .collect()
    }

    pub(crate) fn axes(&self) -> &[VertebraAxes] {
        &self.axes
    }

    /// The spine axis: the centroid of the lowest vertebra and the unit vector from there to the
    /// centroid of the highest one.
    pub(crate) fn axis_through_ends(&self) -> Result<(Point3<f64>, Vector3<f64>), SimulationError> {
        let low = self.vertebrae[self.vertebrae.len() - 1].mesh.centroid();
        let high = self.vertebrae[0].mesh.centroid();
        Ok((low, direction(high - low, "upward")?))
    }
}

fn body_center(mesh: &TriMesh, anterior: &Vector3<f64>) -> Point3<f64> {
    let centroid = mesh.centroid();
    let mut moment = Vector3::zeros();
    let mut total = 0.0;
    for face in 0..mesh.n_faces() {
        let [a, b, c] = mesh.triangle(face);
        let middle = (a.coords + b.coords + c.coords) / 3.0;
        if (middle - centroid.coords).dot(anterior) > 0.0 {
            let area = mesh.face_area(face);
            moment += middle * area;
            total += area;
        }
    }
    if total > 0.0 {
        Point3::from(moment / total)
    } else {
        centroid
    }
}

fn landmark_of(landmarks: &Landmarks, level: Level) -> Result<Point3<f64>, SimulationError> {
    let mut found = landmarks.landmarks.iter().filter(|l| l.level == level);
    let n_landmarks = found.clone().count();
    let (Some(landmark), 1) = (found.next(), n_landmarks) else {
        return Err(SimulationError::LandmarkCount { level, n_landmarks });
    };
    let p = landmark.position_mm;
    if p.coords.iter().all(|c| c.is_finite()) {
        return Ok(p);
    }
    Err(SimulationError::NonFiniteLandmark {
        level,
        x: p.x,
        y: p.y,
        z: p.z,
    })
}

fn axes_at(
    centroids: &[Point3<f64>],
    landmarks: &[Point3<f64>],
    i: usize,
) -> Result<VertebraAxes, SimulationError> {
    let above = centroids[i.saturating_sub(1)];
    let below = centroids[(i + 1).min(centroids.len() - 1)];
    let up = direction(above - below, "upward")?;
    // The spinous process points backwards.
    let forward = centroids[i] - landmarks[i];
    let anterior = direction(forward - up * forward.dot(&up), "anterior")?;
    Ok(VertebraAxes { up, anterior })
}

fn direction(v: Vector3<f64>, name: &'static str) -> Result<Vector3<f64>, SimulationError> {
    v.try_normalize(SHORTEST_DIRECTION_MM)
        .ok_or(SimulationError::DegenerateDirection {
            direction: name,
            distance_mm: v.norm(),
        })
}
