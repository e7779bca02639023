//! The target made ready: cleaned, checked, thinned out.
//!
//! What its points tell of themselves is found in `local_shape.rs`.

use nalgebra::Point3;
use pedicle_mesh::{RepairReport, TriMesh, connected_components};
use pedicle_trajectory::Level;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::facing::facing;
use crate::image_shape::image_shape;
use crate::local_shape::{Local, local_shape, not_alone};
use crate::map_shape::clean;
use crate::model::{MAX_LANDMARK_DISTANCE_MM, SpineModel};
use crate::pieces::FinePoints;
use crate::points::PointSet;
use crate::{Shape, SpineError, Target, TargetSurface};

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
    pub(crate) picture: Option<Local>,
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
    let positions = &fine.points.positions;
    let local = if is_measured {
        local_shape(positions, LARGEST_PATCH_MM)?
    } else {
        None
    };
    // The search needs what points tell in space, the last fit what they tell in the picture.
    let picture = match (&target.view, &local) {
        (Some(view), Some(_)) => image_shape(positions, view, LARGEST_PATCH_MM)?,
        _ => None,
    };
    // Neighbours in space err alike even more than those in the picture.
    let alike = picture
        .as_ref()
        .map(|picture| picture.alike)
        .unwrap_or_default();
    let told_by = if alike.is_told() { &picture } else { &local };
    let sensor_noise_mm = told_by.as_ref().map(|local| local.noise_mm);
    if let Some(local) = local {
        let points = &mut fine.points;
        points.normals = local.normals;
        points.patches = local.patches;
        points.alike = alike;
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
        picture,
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
            facing: Vec::new(),
        };
    };
    let components = connected_components(mesh);
    // The surface is clean: every vertex belongs to a face and so to a piece.
    chosen.retain(|&v| components.of_vertex[v].is_some());
    let normals = facing(mesh);
    FinePoints {
        points: PointSet {
            positions: chosen.iter().map(|&v| points[v]).collect(),
            ..PointSet::default()
        },
        piece: chosen
            .iter()
            .filter_map(|&v| components.of_vertex[v])
            .collect(),
        n_pieces: components.n_components,
        facing: chosen.into_iter().map(|v| normals[v]).collect(),
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
