//! The functional map between the two spines and the pose of each vertebra that it gives.
//!
//! descriptors A, B → C = argmin E(C) → ZoomOut → BCICP → point map → MSAC per vertebra.

use faer::Mat;
use nalgebra::{Isometry3, Point3};
use pedicle_descriptors::{
    HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark, heat_kernel_signature,
    normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{
    FitOptions, FunctionalMap, PointMapPair, bcicp_from_point_maps, coverage, fit,
    functional_from_point_map, point_map_from_adjoint, zoomout,
};
use pedicle_mesh::TriMesh;
use pedicle_registration::{MsacOptions, msac};
use pedicle_spectral::LaplaceBasis;

use crate::map_shape::MapShape;
use crate::model::{SourceView, SpineModel};
use crate::scoring::Poses;
use crate::{MapOptions, SearchOptions, SpineError, TransferOptions};

/// What the map was compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// The whole source spine.
    Whole,
    /// The part of the source that a posterior approach exposes.
    Posterior,
}

/// What the functional map found.
#[derive(Debug, Clone, PartialEq)]
pub struct MapReport {
    /// Which part of the source took part.
    pub view: View,
    /// Vertices of the source and of the target surface in the map.
    pub n_vertices: (usize, usize),
    /// Share of the source's vertices that some target vertex is mapped to.
    pub coverage: f64,
    /// For each vertebra the number of target vertices mapped to it.
    pub n_mapped: Vec<usize>,
    /// For each vertebra the share of them that one rigid motion explains (MSAC inliers).
    pub inlier_share: Vec<f64>,
    /// For each vertebra the pose `target_from_source` of MSAC, before any refinement; none if
    /// there was no consensus.
    pub poses: Vec<Option<Isometry3<f64>>>,
    /// The map itself, for pictures.
    pub detail: MapDetail,
}

/// The functional map between the simplified surfaces.
#[derive(Debug, Clone, PartialEq)]
pub struct MapDetail {
    /// The source as the map saw it, in the source frame, mm.
    pub source: TriMesh,
    /// The target as the map saw it, in the target frame, mm.
    pub target: TriMesh,
    /// One source vertex for every target vertex.
    pub source_of_target: Vec<u32>,
    /// The functional map of this point map, k_target × k_source.
    pub functional_map: FunctionalMap,
    /// Eigenvalues of the source, 1/mm².
    pub source_eigenvalues: Vec<f64>,
    /// Eigenvalues of the target, 1/mm².
    pub target_eigenvalues: Vec<f64>,
}

/// The poses of all vertebrae by the map, if it gave one for each.
pub(crate) struct MapResult {
    pub(crate) poses: Option<Poses>,
    pub(crate) report: MapReport,
}

/// The view of the source that a target of this area is compared with.
pub(crate) fn choose_view(model: &SpineModel, target: &MapShape, whole_area_share: f64) -> View {
    let share = target.basis.area() / model.whole.shape.basis.area();
    if share < whole_area_share {
        View::Posterior
    } else {
        View::Whole
    }
}

/// Computes the map and estimates a pose for every vertebra.
pub(crate) fn map_poses(
    model: &SpineModel,
    target: &MapShape,
    target_landmarks: &[Option<Point3<f64>>],
    options: &TransferOptions,
) -> Result<MapResult, SpineError> {
    let view = choose_view(model, target, model.map_options.whole_area_share);
    let source = match view {
        View::Whole => &model.whole,
        View::Posterior => &model.posterior,
    };
    // A landmark tells something only where both shapes have it.
    let (source_landmarks, target_landmarks): (Vec<Point3<f64>>, Vec<Point3<f64>>) = model
        .vertebrae
        .iter()
        .zip(target_landmarks)
        .filter_map(|(v, landmark)| Some((v.landmark, (*landmark)?)))
        .unzip();
    let (source_functions, target_functions) = descriptors(
        &source.shape,
        target,
        &source_landmarks,
        &target_landmarks,
        &model.map_options,
    )?;
    let source_shape = pedicle_fmap::Shape {
        mesh: &source.shape.mesh,
        basis: &source.shape.basis,
        descriptors: &source_functions,
    };
    let target_shape = pedicle_fmap::Shape {
        mesh: &target.mesh,
        basis: &target.basis,
        descriptors: &target_functions,
    };
    let fit_options = FitOptions {
        n_source: model.map_options.n_fit,
        n_target: model.map_options.n_fit,
        weights: model.map_options.weights,
        ..FitOptions::default()
    };
    let first = fit(&source_shape, &target_shape, &fit_options)?;
    let zoomed = zoomout(
        &source.shape.basis,
        &target.basis,
        &first.map,
        &model.map_options.zoomout,
    )?;
    // One of the two point maps that BCICP begins with is there already.
    let adjoint = zoomed.map.adjoint();
    let point_maps = PointMapPair {
        source_to_target: point_map_from_adjoint(&target.basis, &source.shape.basis, &adjoint)?,
        target_to_source: zoomed.point_map,
    };
    let refined = bcicp_from_point_maps(
        &source_shape,
        &target_shape,
        &point_maps,
        &model.map_options.bcicp,
    )?;
    let point_map = &refined.target_to_source;

    let (n_target, n_source) = (zoomed.map.n_target(), zoomed.map.n_source());
    let detail = MapDetail {
        source: source.shape.mesh.clone(),
        target: target.mesh.clone(),
        source_of_target: point_map.source_of_target.clone(),
        functional_map: functional_from_point_map(
            &source.shape.basis,
            &target.basis,
            point_map,
            (n_target, n_source),
        )?,
        source_eigenvalues: source.shape.basis.eigenvalues.clone(),
        target_eigenvalues: target.basis.eigenvalues.clone(),
    };
    let estimate = poses_from_pairs(model, source, target, &point_map.source_of_target, options);
    Ok(MapResult {
        poses: estimate.poses,
        report: MapReport {
            view,
            n_vertices: (source.shape.mesh.n_vertices(), target.mesh.n_vertices()),
            coverage: coverage(point_map, &source.shape.basis.mass)?,
            n_mapped: estimate.n_mapped,
            inlier_share: estimate.inlier_share,
            poses: estimate.found,
            detail,
        },
    })
}

fn descriptors(
    source: &MapShape,
    target: &MapShape,
    source_landmarks: &[Point3<f64>],
    target_landmarks: &[Point3<f64>],
    options: &MapOptions,
) -> Result<(Mat<f64>, Mat<f64>), SpineError> {
    // One range for both shapes, or the columns mean different things on each.
    let energies = WaveEnergies::joint(&source.basis, &target.basis, options.n_wave)?;
    let landmark_energies =
        WaveEnergies::joint(&source.basis, &target.basis, options.n_landmark_wave)?;
    let times = HeatTimes::joint(&source.basis, &target.basis, options.n_heat)?;
    let of = |shape: &MapShape, landmarks: &[Point3<f64>]| -> Result<Mat<f64>, SpineError> {
        let basis: &LaplaceBasis = &shape.basis;
        let mut parts = vec![
            wave_kernel_signature(basis, &energies),
            heat_kernel_signature(basis, &times),
        ];
        for landmark in landmarks {
            let vertex = nearest_vertex(shape, landmark);
            parts.push(wave_kernel_from_landmark(
                basis,
                vertex,
                &landmark_energies,
            )?);
            parts.push(heat_kernel_from_landmark(basis, vertex, &times)?);
        }
        Ok(normalize_columns(concatenate_columns(&parts), &basis.mass))
    };
    Ok((of(source, source_landmarks)?, of(target, target_landmarks)?))
}

fn nearest_vertex(shape: &MapShape, point: &Point3<f64>) -> usize {
    let mut best = (f64::INFINITY, 0);
    for (v, p) in shape.mesh.vertices().iter().enumerate() {
        let squared = (p - point).norm_squared();
        if squared < best.0 {
            best = (squared, v);
        }
    }
    best.1
}

/// Source points and the target points mapped to them, in the same order.
type Pairs = (Vec<Point3<f64>>, Vec<Point3<f64>>);

struct Estimate {
    found: Vec<Option<Isometry3<f64>>>,
    /// One for every vertebra, borrowed from the nearest one where there was none.
    poses: Option<Poses>,
    n_mapped: Vec<usize>,
    inlier_share: Vec<f64>,
}

/// MSAC over the pairs that the point map makes of each vertebra.
fn poses_from_pairs(
    model: &SpineModel,
    source: &SourceView,
    target: &MapShape,
    source_of_target: &[u32],
    options: &TransferOptions,
) -> Estimate {
    let n = model.vertebrae.len();
    let mut pairs: Vec<Pairs> = vec![Default::default(); n];
    for (t, &s) in source_of_target.iter().enumerate() {
        let (from, to) = &mut pairs[source.vertebra_of_vertex[s as usize] as usize];
        from.push(source.shape.mesh.vertices()[s as usize]);
        to.push(target.mesh.vertices()[t]);
    }
    let SearchOptions {
        msac: msac_options, ..
    } = &options.search;
    let mut poses = Vec::with_capacity(n);
    let mut inlier_share = Vec::with_capacity(n);
    for (v, (from, to)) in pairs.iter().enumerate() {
        let seeded = MsacOptions {
            seed: options.seed.wrapping_mul(n as u64).wrapping_add(v as u64),
            ..*msac_options
        };
        // Too few pairs or no consensus: the map says nothing about this vertebra.
        match msac(from, to, &seeded) {
            Ok(found) => {
                inlier_share.push(found.n_inliers as f64 / from.len() as f64);
                poses.push(Some(found.target_from_source));
            }
            Err(_) => {
                inlier_share.push(0.0);
                poses.push(None);
            }
        }
    }
    Estimate {
        poses: fill_from_neighbours(&poses),
        found: poses,
        n_mapped: pairs.iter().map(|(from, _)| from.len()).collect(),
        inlier_share,
    }
}

/// A vertebra without a pose starts from the nearest one that has one.
fn fill_from_neighbours(poses: &[Option<Isometry3<f64>>]) -> Option<Poses> {
    let known: Vec<usize> = (0..poses.len()).filter(|&v| poses[v].is_some()).collect();
    (0..poses.len())
        .map(|v| {
            let nearest = known.iter().min_by_key(|&&k| k.abs_diff(v))?;
            poses[*nearest]
        })
        .collect()
}
