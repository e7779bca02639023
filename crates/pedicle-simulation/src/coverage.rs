//! How much of a vertebra's posterior surface a target shows.
//!
//! ```text
//! seen = #{k : |x_k - S| ≤ 1.5 mm} / K
//! ```
//!
//! x_k are K = 400 samples of equal area on the faces whose middle lies behind the centroid along
//! the anterior axis, S the true surface or the true points that the target shows of the vertebra.
//! Lengths in mm.

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

/// Samples of equal area on the posterior surface, in the source frame: one in the middle of
/// every stretch of the faces' running area, at the centre of the face there.
fn posterior_samples(vertebra: &CaseVertebra, axes: &VertebraAxes) -> Vec<Point3<f64>> {
    let surface = &vertebra.surface;
    let centroid = vertebra.mesh.centroid();
    let faces: Vec<(Point3<f64>, f64)> = (0..surface.n_faces())
        .map(|face| {
            let [a, b, c] = surface.triangle(face);
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            (middle, surface.face_area(face))
        })
        .filter(|(middle, _)| is_posterior(middle, &centroid, axes))
        .collect();
    let total: f64 = faces.iter().map(|(_, area)| area).sum();
    let step = total / N_SAMPLES as f64;
    let mut samples = Vec::with_capacity(N_SAMPLES);
    let (mut behind, mut next) = (0.0, 0.5 * step);
    for (middle, area) in faces {
        behind += area;
        while next < behind && samples.len() < N_SAMPLES {
            samples.push(middle);
            next += step;
        }
    }
    samples
}

fn share(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    pose: &Isometry3<f64>,
    is_near: impl Fn(&Point3<f64>) -> bool,
) -> f64 {
    let samples = posterior_samples(vertebra, axes);
    let n_seen = samples.iter().filter(|p| is_near(&(pose * *p))).count();
    n_seen as f64 / samples.len().max(1) as f64
}

/// The share near the true points.
pub(crate) fn seen_by_points(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    truth: &VertebraTruth,
) -> f64 {
    // Sorted along one axis, only a slab of points needs to be looked at.
    let mut points = truth.target_points.clone();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    share(vertebra, axes, &truth.target_from_source, |p| {
        let first = points.partition_point(|q| q.x < p.x - NEAR_MM);
        points[first..]
            .iter()
            .take_while(|q| q.x <= p.x + NEAR_MM)
            .any(|q| (q - p).norm() <= NEAR_MM)
    })
}

/// The share near the part of a target mesh that shows the vertebra, as it would be without noise.
pub(crate) fn seen_by_mesh(
    vertebra: &CaseVertebra,
    axes: &VertebraAxes,
    truth: &VertebraTruth,
    target: &TriMesh,
) -> Result<f64, SimulationError> {
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
        return Ok(0.0);
    }
    let part = TriMesh::new(truth.target_points.clone(), faces)?;
    let index = SurfaceIndex::new(&part)?;
    Ok(share(vertebra, axes, &truth.target_from_source, |p| {
        index.closest_point(p).distance_mm <= NEAR_MM
    }))
}
