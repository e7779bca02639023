//! Anatomical directions of a spine, from its shape alone.
//!
//! ```text
//! up × anterior = left,   anterior × left = up,   left × up = anterior
//! ```
//!
//! Up follows the chain of centroids (tangent at each level). Anterior is where the bulk of a
//! vertebra, its body, lies: the thin posterior elements have surface but little volume, so
//!
//! ```text
//! f = centroid of the volume - centroid of the surface,   made perpendicular to up
//! ```
//!
//! points forward (4 to 7 mm long on lumbar vertebrae). Each level votes and the votes are
//! added. Each frame is then refined by its own vertebra: `left` becomes the normal of the best
//! mirror plane and `up` the direction that most end-plate area faces. Nothing depends on the
//! pose of the spine, nor on the scale.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use pedicle_mesh::{SurfaceIndex, TriMesh};
use rayon::prelude::*;

use crate::{AnatomyError, Level};

/// The directions of one vertebra; unit vectors, right-handed in the sense above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnatomicalFrame {
    /// A point of the mirror plane: the centroid of the surface, brought onto that plane, mm.
    pub origin: Point3<f64>,
    /// Towards the patient's left.
    pub left: Vector3<f64>,
    /// Towards the patient's front.
    pub anterior: Vector3<f64>,
    /// Towards the patient's head.
    pub up: Vector3<f64>,
}

impl AnatomicalFrame {
    /// The frame whose `up` is exact and whose `anterior` is made perpendicular to it.
    ///
    /// # Errors
    /// [`AnatomyError::NoDirection`] if the two are parallel, zero or not finite.
    pub fn new(
        origin: Point3<f64>,
        anterior: Vector3<f64>,
        up: Vector3<f64>,
    ) -> Result<Self, AnatomyError> {
        let no_direction = AnatomyError::NoDirection {
            what: "up and anterior",
        };
        let Some(up) = unit(up) else {
            return Err(no_direction);
        };
        let Some(anterior) = unit(anterior).and_then(|a| unit_perpendicular(a, up)) else {
            return Err(no_direction);
        };
        Ok(Self {
            origin,
            left: up.cross(&anterior),
            anterior,
            up,
        })
    }

    /// Coordinates of a point in the frame: left, anterior, up, mm.
    #[must_use]
    pub fn coordinates(&self, p: &Point3<f64>) -> Vector3<f64> {
        let d = p - self.origin;
        Vector3::new(d.dot(&self.left), d.dot(&self.anterior), d.dot(&self.up))
    }

    /// The point with the given coordinates: left, anterior, up, mm.
    #[must_use]
    pub fn point(&self, left_mm: f64, anterior_mm: f64, up_mm: f64) -> Point3<f64> {
        self.origin + self.left * left_mm + self.anterior * anterior_mm + self.up * up_mm
    }
}

/// The frames of a spine's vertebrae, in the order given.
///
/// The vertebrae may come in any order and with levels missing between them.
///
/// # Errors
/// [`AnatomyError`] for fewer than two vertebrae, a level given twice, or shapes that have no
/// direction (centroids that coincide, a surface that is the same all around).
pub fn anatomical_frames(
    vertebrae: &[(Level, &TriMesh)],
) -> Result<Vec<AnatomicalFrame>, AnatomyError> {
    let found = frames_and_surfaces(vertebrae)?;
    Ok(found.into_iter().map(|(frame, _)| frame).collect())
}

/// The frames, each with the index of its surface.
pub(crate) fn frames_and_surfaces(
    vertebrae: &[(Level, &TriMesh)],
) -> Result<Vec<(AnatomicalFrame, SurfaceIndex)>, AnatomyError> {
    let ups = chain_tangents(vertebrae)?;
    let samples: Vec<Samples> = vertebrae
        .par_iter()
        .map(|(_, mesh)| Samples::new(mesh))
        .collect();
    let mut forward = Vector3::zeros();
    for (sample, up) in samples.iter().zip(&ups) {
        let vote = unit_perpendicular(sample.volume_offset, *up);
        forward += vote.unwrap_or_else(Vector3::zeros);
    }
    let found: Vec<Result<_, AnatomyError>> = vertebrae
        .par_iter()
        .zip(&samples)
        .zip(ups)
        .map(|(((_, mesh), sample), up)| {
            let coarse = AnatomicalFrame::new(sample.centroid, forward, up)?;
            let index = SurfaceIndex::new(mesh)?;
            let mirrored = mirror_refined(coarse, sample, &index)?;
            Ok((end_plate_refined(mirrored, sample)?, index))
        })
        .collect();
    // The first error in the order given, whichever came first in time.
    found.into_iter().collect()
}

/// The tip of the spinous process: the middle of its dorsal border, which is what a finger or a pointer
/// meets first in a prone patient.
///
/// The vertices near the mirror plane that reach furthest back are averaged, and the nearest of them
/// is taken. The border of a lumbar process is a ridge of 10 to 25 mm, nearly upright, so its upper and
/// its lower corner lie as far back as its middle to a millimetre or two; the average over the last
/// millimetres keeps a small tilt of the axes, or a single spike, from moving the tip along the ridge.
///
/// # Errors
/// [`AnatomyError::NoSpinousProcess`] if no vertex lies near the mirror plane.
pub fn spinous_process_tip(
    mesh: &TriMesh,
    frame: &AnatomicalFrame,
) -> Result<Point3<f64>, AnatomyError> {
    let mut near: Vec<(f64, Point3<f64>)> = mesh
        .vertices()
        .iter()
        .map(|p| (frame.coordinates(p), *p))
        .filter(|(c, _)| c.x.abs() <= MIDLINE_BAND_MM)
        .map(|(c, p)| (c.y, p))
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(&(last, _)) = near.first() else {
        return Err(AnatomyError::NoSpinousProcess {
            band_mm: MIDLINE_BAND_MM,
        });
    };
    let n = near.partition_point(|(a, _)| *a <= last + TIP_DEPTH_MM);
    let n = n.max(near.len().min(MIN_TIP_VERTICES));
    let sum: Vector3<f64> = near[..n].iter().map(|(_, p)| p.coords).sum();
    let mean = Point3::from(sum / n as f64);
    let nearest = near[..n]
        .iter()
        .min_by(|a, b| (a.1 - mean).norm().total_cmp(&(b.1 - mean).norm()));
    Ok(nearest.map_or(mean, |(_, p)| *p))
}

/// Half width of the band about the mirror plane in which the spinous process ends, mm.
const MIDLINE_BAND_MM: f64 = 8.0;
/// Depth of the region whose mean is the tip of the spinous process, mm.
const TIP_DEPTH_MM: f64 = 2.0;
/// Least number of vertices averaged for the tip.
const MIN_TIP_VERTICES: usize = 5;

fn unit(v: Vector3<f64>) -> Option<Vector3<f64>> {
    v.try_normalize(f64::MIN_POSITIVE)
        .filter(|u| u.iter().all(|c| c.is_finite()))
}

fn unit_perpendicular(v: Vector3<f64>, to: Vector3<f64>) -> Option<Vector3<f64>> {
    (v - to * to.dot(&v)).try_normalize(PARALLEL)
}

/// Sine below which two directions count as parallel.
const PARALLEL: f64 = 1e-6;

/// Tangents of the chain of centroids, towards the head.
fn chain_tangents(vertebrae: &[(Level, &TriMesh)]) -> Result<Vec<Vector3<f64>>, AnatomyError> {
    if vertebrae.len() < 2 {
        return Err(AnatomyError::TooFewVertebrae {
            n_vertebrae: vertebrae.len(),
            min: 2,
        });
    }
    let mut order: Vec<usize> = (0..vertebrae.len()).collect();
    order.sort_by_key(|&i| vertebrae[i].0);
    if let Some(pair) = order
        .windows(2)
        .find(|pair| vertebrae[pair[0]].0 == vertebrae[pair[1]].0)
    {
        return Err(AnatomyError::DuplicateLevel {
            level: vertebrae[pair[0]].0,
        });
    }
    let centroids: Vec<Point3<f64>> = order.iter().map(|&i| vertebrae[i].1.centroid()).collect();
    let mut ups = vec![Vector3::zeros(); order.len()];
    for (position, &i) in order.iter().enumerate() {
        let above = centroids[position.saturating_sub(1)];
        let below = centroids[(position + 1).min(order.len() - 1)];
        ups[i] = unit(above - below).ok_or(AnatomyError::NoDirection {
            what: "the chain of centroids",
        })?;
    }
    Ok(ups)
}

/// Faces as weighted points with normals.
struct Samples {
    centroid: Point3<f64>,
    /// From the centroid of the surface to that of the volume; zero without a volume.
    volume_offset: Vector3<f64>,
    points: Vec<Point3<f64>>,
    /// Unit normal times area.
    normals: Vec<Vector3<f64>>,
    areas: Vec<f64>,
}

impl Samples {
    fn new(mesh: &TriMesh) -> Self {
        let n = mesh.n_faces();
        let centroid = mesh.centroid();
        let middle = |face| {
            let [a, b, c] = mesh.triangle(face);
            Point3::from((a.coords + b.coords + c.coords) / 3.0)
        };
        Self {
            centroid,
            volume_offset: volume_offset(mesh, centroid),
            points: (0..n).map(middle).collect(),
            normals: (0..n).map(|f| mesh.face_normal_scaled(f) * 0.5).collect(),
            areas: (0..n).map(|f| mesh.face_area(f)).collect(),
        }
    }
}

/// The offset of the centroid of the volume from `origin`.
fn volume_offset(mesh: &TriMesh, origin: Point3<f64>) -> Vector3<f64> {
    let (mut volume, mut moment) = (0.0, Vector3::zeros());
    for face in 0..mesh.n_faces() {
        let [a, b, c] = mesh.triangle(face).map(|p| p - origin);
        let six_volumes = a.dot(&b.cross(&c));
        volume += six_volumes;
        moment += (a + b + c) * (six_volumes / 4.0);
    }
    // The quotient is the same for a surface that is inside out.
    let offset = moment / volume;
    if offset.iter().all(|c| c.is_finite()) {
        offset
    } else {
        Vector3::zeros()
    }
}

/// Points used to fit the mirror plane.
const MIRROR_SAMPLES: usize = 500;
/// Most steps of the fit of the mirror plane.
const MIRROR_STEPS: usize = 40;
/// Part of the pairs kept: ragged transverse processes have no partner.
const MIRROR_KEPT: f64 = 0.8;
/// The fit has converged when the normal turns by less than this, radians.
const MIRROR_TOLERANCE_RAD: f64 = 1e-4;
/// A mirror plane further from the coarse one than this is not believed, radians.
const MIRROR_MAX_TURN_RAD: f64 = 0.6;

/// Turns `left` to the normal of the plane that best mirrors the surface onto itself.
///
/// With q_j the surface point closest to the mirrored p_j, the best plane normal is the
/// eigenvector of the smallest eigenvalue of Σ (p_j - p̄)(q_j - q̄)ᵀ + its transpose, and the
/// plane passes through the middle of p̄ and q̄; repeated until it rests.
fn mirror_refined(
    coarse: AnatomicalFrame,
    samples: &Samples,
    index: &SurfaceIndex,
) -> Result<AnatomicalFrame, AnatomyError> {
    let stride = samples.points.len().div_ceil(MIRROR_SAMPLES).max(1);
    let chosen: Vec<usize> = (0..samples.points.len()).step_by(stride).collect();
    let (mut normal, mut origin) = (coarse.left, coarse.origin);
    let mut last: Vec<Option<Point3<f64>>> = vec![None; chosen.len()];
    for _ in 0..MIRROR_STEPS {
        let mut pairs: Vec<(f64, usize, Point3<f64>)> = chosen
            .iter()
            .zip(&mut last)
            .map(|(&i, last)| {
                let p = samples.points[i];
                let mirrored = p - normal * (2.0 * normal.dot(&(p - origin)));
                // No further than what was closest before the plane moved.
                let found = last
                    .and_then(|q| index.closest_point_within(&mirrored, (mirrored - q).norm()))
                    .unwrap_or_else(|| index.closest_point(&mirrored));
                *last = Some(found.point);
                (found.distance_mm, i, found.point)
            })
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        pairs.truncate(((pairs.len() as f64 * MIRROR_KEPT) as usize).max(3));
        let Some((next, through)) = best_mirror(&pairs, samples) else {
            break;
        };
        let next = if next.dot(&normal) < 0.0 { -next } else { next };
        let turn = next.cross(&normal).norm();
        (normal, origin) = (next, through);
        if turn < MIRROR_TOLERANCE_RAD {
            break;
        }
    }
    if normal.dot(&coarse.left) < MIRROR_MAX_TURN_RAD.cos() {
        return Ok(coarse);
    }
    let origin = coarse.origin - normal * normal.dot(&(coarse.origin - origin));
    let up = unit_perpendicular(coarse.up, normal).ok_or(AnatomyError::NoDirection {
        what: "the mirror plane",
    })?;
    AnatomicalFrame::new(origin, normal.cross(&up), up)
}

/// Normal of the best mirror plane of the pairs, and a point of it.
fn best_mirror(
    pairs: &[(f64, usize, Point3<f64>)],
    samples: &Samples,
) -> Option<(Vector3<f64>, Point3<f64>)> {
    let (mut p_mean, mut q_mean, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0);
    for (_, i, q) in pairs {
        let w = samples.areas[*i];
        p_mean += samples.points[*i].coords * w;
        q_mean += q.coords * w;
        total += w;
    }
    if total <= 0.0 {
        return None;
    }
    (p_mean, q_mean) = (p_mean / total, q_mean / total);
    let mut moment = Matrix3::zeros();
    for (_, i, q) in pairs {
        let p = samples.points[*i].coords - p_mean;
        moment += p * (q.coords - q_mean).transpose() * (samples.areas[*i] / total);
    }
    let eigen = SymmetricEigen::new(moment + moment.transpose());
    let normal = unit(
        eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .into_owned(),
    )?;
    Some((normal, Point3::from(0.5 * (p_mean + q_mean))))
}

/// How far `up` may turn to face the end plates, radians. The chain of centroids is off by up
/// to half the lordosis between two levels.
const END_PLATE_MAX_TURN_RAD: f64 = 0.7;
/// Steps of the search within that range, on either side.
const END_PLATE_STEPS: i32 = 140;
/// Exponent of the agreement of normals with `up`: walls at right angles count for nothing.
const END_PLATE_EXPONENT: i32 = 8;
/// The body: further anterior of the centroid than this part of the anterior extent.
const BODY_FROM_ANTERIOR: f64 = 0.15;
/// The body: nearer to the mirror plane than this part of the anterior extent.
const BODY_HALF_WIDTH: f64 = 0.4;

/// Turns `up` about `left` to where most of the area of the body's end plates faces.
fn end_plate_refined(
    frame: AnatomicalFrame,
    samples: &Samples,
) -> Result<AnatomicalFrame, AnatomyError> {
    let coordinates: Vec<Vector3<f64>> = samples
        .points
        .iter()
        .map(|p| frame.coordinates(p))
        .collect();
    let extent = coordinates.iter().map(|c| c.y).fold(0.0, f64::max);
    let body: Vec<(f64, f64)> = coordinates
        .iter()
        .zip(&samples.normals)
        .filter(|(c, _)| c.y > BODY_FROM_ANTERIOR * extent && c.x.abs() < BODY_HALF_WIDTH * extent)
        .map(|(_, n)| (n.dot(&frame.anterior), n.dot(&frame.up)))
        .collect();
    let score = |angle: f64| -> f64 {
        let (sin, cos) = angle.sin_cos();
        body.iter()
            .map(|(anterior, up)| {
                let area = anterior.hypot(*up);
                if area > 0.0 {
                    let agreement = (anterior * sin + up * cos) / area;
                    area * agreement.powi(END_PLATE_EXPONENT)
                } else {
                    0.0
                }
            })
            .sum()
    };
    let step = END_PLATE_MAX_TURN_RAD / f64::from(END_PLATE_STEPS);
    let best = (-END_PLATE_STEPS..=END_PLATE_STEPS)
        .map(|k| f64::from(k) * step)
        .map(|angle| (score(angle), angle))
        .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.abs().total_cmp(&a.1.abs())))
        .map_or(0.0, |(_, angle)| angle);
    let (sin, cos) = best.sin_cos();
    let up = frame.up * cos + frame.anterior * sin;
    AnatomicalFrame::new(frame.origin, frame.anterior, up)
}
