//! The target made ready: cleaned, checked, thinned out.
//!
//! Points of a camera that float alone (flying pixels between front and back) are removed:
//!
//! ```text
//! mean distance to the 8 nearest points > 3 × its median over all points
//! ```
//!
//! after Rusu et al. 2008, with the median in place of mean and deviation, which the very points to
//! remove would inflate.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Matrix6, Point3, Vector3, Vector6};
use pedicle_mesh::{RepairReport, TriMesh, connected_components};
use pedicle_trajectory::Level;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::finish::FinePoints;
use crate::map_shape::clean;
use crate::model::{MAX_LANDMARK_DISTANCE_MM, SpineModel};
use crate::points::PointSet;
use crate::{Shape, SpineError, Target, TargetSurface};

/// Neighbours whose mean distance tells whether a point floats alone.
const NEIGHBORS: usize = 8;
/// Times the median from which on it does.
const ALONE_RATIO: f64 = 3.0;
/// Neighbours that a quadric and a plane are fitted to.
const PATCH_NEIGHBORS: usize = 24;
/// Unknowns of the quadric.
const QUADRIC_UNKNOWNS: usize = 6;
/// Points at which the noise is estimated.
const NOISE_SAMPLES: usize = 400;
/// The patch must be this small for a quadric to follow the bone, mm.
const LARGEST_PATCH_MM: f64 = 5.0;
/// Fewest points of a target.
const MIN_POINTS: usize = 50;

/// A target whose surface is clean and whose units are right.
pub(crate) struct Prepared {
    /// The surface; none of a cloud.
    pub(crate) mesh: Option<TriMesh>,
    /// Points to register, with the loose pieces they belong to.
    pub(crate) fine: FinePoints,
    pub(crate) repair: RepairReport,
    pub(crate) n_points_alone: usize,
    /// Noise along the normals estimated from the target alone, mm; none if its points lie too
    /// far apart to tell noise from shape.
    pub(crate) sensor_noise_mm: Option<f64>,
    /// Share of the source's area; none of a cloud.
    pub(crate) area_share: Option<f64>,
}

pub(crate) fn prepare(
    model: &SpineModel,
    target: &Target,
    landmarks: &[Option<Point3<f64>>],
    n_fine: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Prepared, SpineError> {
    let (mesh, repair) = match &target.surface {
        TargetSurface::Mesh(mesh) => {
            let (mesh, repair) = clean(mesh, Shape::Target)?;
            (Some(mesh), repair)
        }
        TargetSurface::Cloud(points) => {
            check_cloud(points)?;
            (None, RepairReport::default())
        }
    };
    let points: &[Point3<f64>] = match (&mesh, &target.surface) {
        (Some(mesh), _) => mesh.vertices(),
        (None, TargetSurface::Cloud(points)) => points,
        (None, TargetSurface::Mesh(mesh)) => mesh.vertices(),
    };
    check_units(model, points)?;
    check_landmarks(points, landmarks)?;

    let is_measured = mesh.is_none() || target.view.is_some();
    let kept: Vec<usize> = if is_measured {
        not_alone(points)?
    } else {
        (0..points.len()).collect()
    };
    let n_points_alone = points.len() - kept.len();
    let mut fine = sample(points, mesh.as_ref(), kept, n_fine, rng);
    let local = if is_measured {
        local_shape(&fine.points.positions, LARGEST_PATCH_MM)?
    } else {
        None
    };
    let sensor_noise_mm = local.as_ref().map(|local| local.noise_mm);
    if let Some(local) = local {
        let points = &mut fine.points;
        points.normals = local.normals;
        points.patches = local.patches;
        if let Some(view) = &target.view {
            points.turn_towards(view);
        }
    }
    let area_share = mesh.as_ref().map(|mesh| {
        let source: f64 = model.vertebrae.iter().map(|v| v.area_mm2).sum();
        mesh.area() / source
    });
    Ok(Prepared {
        mesh,
        fine,
        repair,
        n_points_alone,
        sensor_noise_mm,
        area_share,
    })
}

fn check_cloud(points: &[Point3<f64>]) -> Result<(), SpineError> {
    if let Some(point) = points
        .iter()
        .position(|p| !p.coords.iter().all(|c| c.is_finite()))
    {
        return Err(SpineError::NonFinitePoint { point });
    }
    if points.len() < MIN_POINTS {
        return Err(SpineError::TooFewPoints {
            n_points: points.len(),
            needed: MIN_POINTS,
        });
    }
    Ok(())
}

pub(crate) fn tree_of(points: &[Point3<f64>]) -> Result<ImmutableKdTree<f64, 3>, SpineError> {
    let rows: Vec<[f64; 3]> = points.iter().map(|p| p.coords.into()).collect();
    ImmutableKdTree::new_from_slice(&rows).map_err(|e| SpineError::Index {
        reason: format!("{e:?}"),
    })
}

/// Indices of the points that do not float alone.
pub(crate) fn not_alone(points: &[Point3<f64>]) -> Result<Vec<usize>, SpineError> {
    let tree = tree_of(points)?;
    let wanted = NonZero::<usize>::MIN.saturating_add(NEIGHBORS);
    let spread: Vec<f64> = points
        .par_iter()
        .map(|p| {
            let row: [f64; 3] = p.coords.into();
            let found = tree
                .query(&row)
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute();
            let sum: f64 = found.into_iter().map(|item| item.distance.sqrt()).sum();
            sum / NEIGHBORS as f64
        })
        .collect();
    let mut sorted = spread.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = ALONE_RATIO * sorted[sorted.len() / 2];
    // Points that all coincide are nobody's outliers.
    Ok((0..points.len())
        .filter(|&p| spread[p] <= limit || limit <= 0.0)
        .collect())
}

/// The noise of dense points and their normals.
pub(crate) struct Local {
    /// Median over samples of the deviation of a patch from its own best quadric
    /// z = a + bx + cy + dx² + exy + fy², corrected for its six unknowns.
    pub(crate) noise_mm: f64,
    pub(crate) normals: Vec<Vector3<f64>>,
    pub(crate) patches: Vec<Vec<u32>>,
}

/// Points in which patches are looked for.
struct Patches<'a> {
    points: &'a [Point3<f64>],
    tree: ImmutableKdTree<f64, 3>,
}

impl<'a> Patches<'a> {
    fn new(points: &'a [Point3<f64>]) -> Result<Self, SpineError> {
        let tree = tree_of(points)?;
        Ok(Self { points, tree })
    }

    /// The nearest points of one and the distance of the farthest of them.
    fn around(&self, p: &Point3<f64>) -> (f64, Vec<u32>) {
        let row: [f64; 3] = p.coords.into();
        let wanted = NonZero::<usize>::MIN.saturating_add(PATCH_NEIGHBORS - 1);
        let found = self
            .tree
            .query(&row)
            .nearest_n::<SquaredEuclidean<f64>>(wanted)
            .execute();
        let mut patch: Vec<(f64, u32)> = found
            .into_iter()
            .map(|item| (item.distance, item.item))
            .collect();
        // Ties may come in any order, and sums depend on it.
        patch.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let radius = patch.last().map_or(f64::INFINITY, |(d, _)| d.sqrt());
        let near: Vec<u32> = patch.into_iter().map(|(_, i)| i).collect();
        (radius, near)
    }

    fn positions(&self, patch: &[u32]) -> Vec<Point3<f64>> {
        patch.iter().map(|&i| self.points[i as usize]).collect()
    }

    /// Median noise of some patches; none if half of them are larger than this radius.
    fn noise_mm(&self, largest_patch_mm: f64) -> Option<f64> {
        let stride = self.points.len().div_ceil(NOISE_SAMPLES).max(1);
        let samples: Vec<&Point3<f64>> = self.points.iter().step_by(stride).collect();
        let (mut radii, mut noise): (Vec<f64>, Vec<f64>) = samples
            .into_par_iter()
            .filter_map(|p| {
                let (radius, patch) = self.around(p);
                Some((radius, quadric_deviation(&self.positions(&patch))?))
            })
            .unzip();
        radii.sort_by(f64::total_cmp);
        noise.sort_by(f64::total_cmp);
        let middle = radii.len() / 2;
        let is_dense = radii.get(middle).is_some_and(|r| *r <= largest_patch_mm);
        is_dense.then(|| noise[middle])
    }
}

/// The noise of dense points alone; none if half of their patches are larger than this radius.
pub(crate) fn noise_of_points(
    points: &[Point3<f64>],
    largest_patch_mm: f64,
) -> Result<Option<f64>, SpineError> {
    Ok(Patches::new(points)?.noise_mm(largest_patch_mm))
}

/// None if the points lie so far apart that half of the patches are larger than this radius.
pub(crate) fn local_shape(
    points: &[Point3<f64>],
    largest_patch_mm: f64,
) -> Result<Option<Local>, SpineError> {
    let patches = Patches::new(points)?;
    let Some(noise_mm) = patches.noise_mm(largest_patch_mm) else {
        return Ok(None);
    };
    let (normals, patches) = points
        .par_iter()
        .map(|p| {
            let patch = patches.around(p).1;
            let axes = plane_of(&patches.positions(&patch)).1;
            (axes.column(0).into_owned(), patch)
        })
        .unzip();
    Ok(Some(Local {
        noise_mm,
        normals,
        patches,
    }))
}

/// The mean of some points and the axes of their spread: the normal of their plane and two in it.
fn plane_of(patch: &[Point3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let n = patch.len().max(1) as f64;
    let mean = patch.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let scatter: Matrix3<f64> = patch
        .iter()
        .map(|p| (p.coords - mean) * (p.coords - mean).transpose())
        .sum();
    let eigen = scatter.symmetric_eigen();
    let low = eigen.eigenvalues.imin();
    let axes = [0, 1, 2].map(|k| eigen.eigenvectors.column((low + k) % 3).into_owned());
    (mean, Matrix3::from_columns(&axes))
}

fn quadric_deviation(patch: &[Point3<f64>]) -> Option<f64> {
    let n = patch.len();
    if n <= QUADRIC_UNKNOWNS {
        return None;
    }
    let (mean, axes) = plane_of(patch);
    let mut normal_matrix = Matrix6::zeros();
    let mut right = Vector6::zeros();
    let mut sum = 0.0;
    for p in patch {
        let d = p.coords - mean;
        let (w, u, v) = (
            d.dot(&axes.column(0)),
            d.dot(&axes.column(1)),
            d.dot(&axes.column(2)),
        );
        let row = Vector6::new(1.0, u, v, u * u, u * v, v * v);
        normal_matrix.ger(1.0, &row, &row, 1.0);
        right += row * w;
        sum += w * w;
    }
    let solution = normal_matrix.cholesky()?.solve(&right);
    let rest = sum - solution.dot(&right);
    let rest = if rest > 0.0 { rest } else { 0.0 };
    Some((rest / (n - QUADRIC_UNKNOWNS) as f64).sqrt())
}

fn sample(
    points: &[Point3<f64>],
    mesh: Option<&TriMesh>,
    mut chosen: Vec<usize>,
    n: usize,
    rng: &mut ChaCha8Rng,
) -> FinePoints {
    if chosen.len() > n {
        let mut few = index::sample(rng, chosen.len(), n).into_vec();
        few.sort_unstable();
        chosen = few.into_iter().map(|i| chosen[i]).collect();
    }
    let Some(mesh) = mesh else {
        return FinePoints {
            points: PointSet {
                positions: chosen.into_iter().map(|v| points[v]).collect(),
                ..PointSet::default()
            },
            piece: Vec::new(),
            n_pieces: 0,
        };
    };
    let components = connected_components(mesh);
    // The surface is clean: every vertex belongs to a face and so to a piece.
    let (positions, piece) = chosen
        .into_iter()
        .filter_map(|v| Some((points[v], components.of_vertex[v]?)))
        .unzip();
    FinePoints {
        points: PointSet {
            positions,
            ..PointSet::default()
        },
        piece,
        n_pieces: components.n_components,
    }
}

/// Ratio of sizes from which on the units must differ: the smallest useful part of a spine still
/// measures a quarter of it.
const MAX_SIZE_RATIO: f64 = 6.0;
/// Ratio between centimetres and metres, halfway on the logarithmic scale.
const CENTIMETRES_TO_METRES: f64 = 30.0;

fn check_units(model: &SpineModel, points: &[Point3<f64>]) -> Result<(), SpineError> {
    let (mut low, mut high) = (points[0].coords, points[0].coords);
    for p in points {
        (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
    }
    let target_mm = (high - low).norm();
    let source_mm = model.diagonal_mm;
    let hint = if target_mm * CENTIMETRES_TO_METRES < source_mm {
        "the target seems to be in metres; multiply it by 1000 to get millimetres"
    } else if target_mm * MAX_SIZE_RATIO < source_mm {
        "the target seems to be in centimetres or inches; bring it to millimetres"
    } else if target_mm > source_mm * CENTIMETRES_TO_METRES {
        "the target seems to be in micrometres; divide it by 1000 to get millimetres"
    } else if target_mm > source_mm * MAX_SIZE_RATIO {
        "the target is no spine of this size; is it in millimetres, and is everything else cut away?"
    } else {
        return Ok(());
    };
    Err(SpineError::UnitMismatch {
        target_mm,
        source_mm,
        hint,
    })
}

fn check_landmarks(
    points: &[Point3<f64>],
    landmarks: &[Option<Point3<f64>>],
) -> Result<(), SpineError> {
    for (level, landmark) in Level::ALL.into_iter().zip(landmarks) {
        let Some(landmark) = landmark else { continue };
        let distance_mm =
            points
                .iter()
                .map(|p| (p - landmark).norm())
                .fold(
                    f64::INFINITY,
                    |nearest, d| if d < nearest { d } else { nearest },
                );
        if distance_mm > MAX_LANDMARK_DISTANCE_MM {
            return Err(SpineError::LandmarkFarFromSurface {
                shape: Shape::Target,
                level,
                distance_mm,
                max_distance_mm: MAX_LANDMARK_DISTANCE_MM,
            });
        }
    }
    Ok(())
}
