//! How much of a vertebra's posterior surface a target shows.
//!
//! ```text
//! seen = #{k : |x_k - S| ≤ 1.5 mm} / K
//! ```
//!
//! x_k are K = 400 samples of equal area on the faces whose middle lies behind the centroid along
//! the anterior axis, S the true surface or the true points that the target shows of the vertebra.
//! Undersides and the walls of the canal are among them, so that even a view of bare bone shows about
//! 0.4. The second share counts only samples whose normal looks backwards too. Lengths in mm.

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::{SurfaceIndex, TriMesh};

use crate::case::VertebraAxes;
use crate::{CaseVertebra, SimulationError, VertebraTruth};

/// Samples a vertebra.
const N_SAMPLES: usize = 400;
/// A sample this near to what is shown is seen, mm.
const NEAR_MM: f64 = 1.5;

/// Whether a point lies behind the vertebra's centroid, in the source frame.
pub(crate) fn is_posterior(p: &Point3<f64>, centroid: &Point3<f64>, axes: &VertebraAxes) -> bool {
    (p - centroid).dot(&axes.anterior) < 0.0
}

/// How much is seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Coverage {
    /// Of the posterior surface.
    pub(crate) posterior: f64,
    /// Of the part of it that faces backwards.
    pub(crate) facing: f64,
}

impl Coverage {
    pub(crate) const NONE: Self = Self {
        posterior: 0.0,
        facing: 0.0,
    };
}

/// A point of the posterior surface, in the source frame.
struct Sample {
    point: Point3<f64>,
    faces_backwards: bool,
}

/// Samples of equal area: one in the middle of every stretch of the faces' running area, at the
/// centre of the face there.
fn posterior_samples(vertebra: &CaseVertebra, axes: &VertebraAxes) -> Vec<Sample> {
    let surface = &vertebra.surface;
    let centroid = vertebra.mesh.centroid();
    let middle_of = |face: usize| {
        let [a, b, c] = surface.triangle(face);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let faces: Vec<usize> = (0..surface.n_faces())
        .filter(|&face| is_posterior(&middle_of(face), &centroid, axes))
        .collect();
    let total: f64 = faces.iter().map(|&face| surface.face_area(face)).sum();
    let step = total / N_SAMPLES as f64;
    let mut samples = Vec::with_capacity(N_SAMPLES);
    let (mut behind, mut next) = (0.0, 0.5 * step);
    for face in faces {
        behind += surface.face_area(face);
        while next < behind && samples.len() < N_SAMPLES {
            samples.push(Sample {
                point: middle_of(face),
                faces_backwards: surface.face_normal_scaled(face).dot(&axes.anterior) < 0.0,
            });
            next += step;
        }
    }
    samples
}

fn coverage(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    pose: &Isometry3<f64>,
    is_near: impl Fn(&Point3<f64>) -> bool,
) -> Coverage {
    let [mut n, mut seen] = [[0_usize; 2]; 2];
    for sample in posterior_samples(vertebra, axes) {
        let near = usize::from(is_near(&(pose * sample.point)));
        let facing = usize::from(sample.faces_backwards);
        n[0] += 1;
        n[1] += facing;
        seen[0] += near;
        seen[1] += near * facing;
    }
    let share = |k: usize| seen[k] as f64 / n[k].max(1) as f64;
    Coverage {
        posterior: share(0),
        facing: share(1),
    }
}

/// The shares near the true points.
pub(crate) fn seen_by_points(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    truth: &VertebraTruth,
) -> Coverage {
    // Sorted along one axis, only a slab of points needs to be looked at.
    let mut points = truth.target_points.clone();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    coverage(vertebra, axes, &truth.target_from_source, |p| {
        let first = points.partition_point(|q| q.x < p.x - NEAR_MM);
        points[first..]
            .iter()
            .take_while(|q| q.x <= p.x + NEAR_MM)
            .any(|q| (q - p).norm() <= NEAR_MM)
    })
}

/// The shares near the part of a target mesh that shows the vertebra, as it would be without noise.
pub(crate) fn seen_by_mesh(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    truth: &VertebraTruth,
    target: &TriMesh,
) -> Result<Coverage, SimulationError> {
    let mut of_vertebra = vec![u32::MAX; target.n_vertices()];
    for (own, &index) in truth.target_vertices.iter().enumerate() {
        of_vertebra[index as usize] = own as u32;
    }
    let faces: Vec<[u32; 3]> = target
        .faces()
        .iter()
        .map(|corners| corners.map(|v| of_vertebra[v as usize]))
        .filter(|corners| corners.iter().all(|&v| v != u32::MAX))
        .collect();
    if faces.is_empty() {
        return Ok(Coverage::NONE);
    }
    let part = TriMesh::new(truth.target_points.clone(), faces)?;
    let index = SurfaceIndex::new(&part)?;
    Ok(coverage(vertebra, axes, &truth.target_from_source, |p| {
        index.closest_point(p).distance_mm <= NEAR_MM
    }))
}
