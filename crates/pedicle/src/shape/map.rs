//! The map between two shapes: operators, eigenfunctions, descriptors, fit and refinement.
//!
//! ```text
//! W, M → Φ, λ → A, B (HKS, WKS, the same from landmarks) → C = argmin E(C) → ZoomOut → BCICP
//! ```

use std::path::Path;
use std::time::Instant;

use clap::ValueEnum;
use faer::Mat;
use nalgebra::Point3;
use pedicle_descriptors::{
    DescriptorError, HeatTimes, WaveEnergies, concatenate_columns, heat_kernel_from_landmark,
    heat_kernel_signature, normalize_columns, wave_kernel_from_landmark, wave_kernel_signature,
};
use pedicle_fmap::{
    BcicpOptions, EnergyWeights, Fit, FitOptions, FmapError, FunctionalMap, OrientationBehaviour,
    PointMap, PointMapPair, Shape, ZoomOutOptions, bcicp_from_point_maps, fit,
    point_map_from_adjoint, zoomout,
};
use pedicle_laplacian::{LaplaceOperators, OperatorError};
use pedicle_mesh::{MeshError, TriMesh};
use pedicle_spectral::{EigenOptions, LaplaceBasis, smallest_eigenpairs};
use serde::{Deserialize, Serialize};

use super::{OperatorChoice, OperatorsEntry, VertexPair, operators_for};
use crate::Error;

/// Size of the first map where the caller leaves it open and there are as many functions.
const DEFAULT_FIT_FUNCTIONS: usize = 50;

/// Whether sizes count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Scale {
    /// Both shapes are brought to the same area first: for two whole shapes of any size.
    UnitArea,
    /// The units of both files are the same and sizes are compared: for a part of a shape.
    Keep,
}

/// What follows ZoomOut.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Refinement {
    /// Nothing.
    Zoomout,
    /// BCICP: both directions at once, for coverage and bijectivity.
    Bcicp,
}

/// How two shapes are mapped.
#[derive(Debug, Clone, PartialEq)]
pub struct MapShapesOptions {
    /// Operators of both shapes; robust.
    pub operators: OperatorChoice,
    /// Whether sizes count; unit area.
    pub scale: Scale,
    /// Eigenfunctions of each shape, and the size of the map at the end, 100.
    pub n_functions: usize,
    /// Size of the map that is fitted to the descriptors; 50, or all functions if there are fewer,
    /// if `None`, which is the default.
    pub n_fit: Option<usize>,
    /// Size of the leading part of the fitted map from which ZoomOut starts, 20; all of the map
    /// if it is smaller.
    pub n_start: usize,
    /// Functions that ZoomOut adds a step, 5.
    pub step: usize,
    /// Wave kernel signatures, 30; from each landmark a third of them.
    pub n_wave: usize,
    /// Heat kernel signatures, 20; from each landmark a third of them.
    pub n_heat: usize,
    /// Orientation to keep or to reverse; `None` to leave it open. Kept.
    pub orientation: Option<OrientationBehaviour>,
    /// What follows ZoomOut; BCICP.
    pub refinement: Refinement,
}

impl Default for MapShapesOptions {
    fn default() -> Self {
        Self {
            operators: OperatorChoice::Robust,
            scale: Scale::UnitArea,
            n_functions: 100,
            n_fit: None,
            n_start: 20,
            step: 5,
            n_wave: 30,
            n_heat: 20,
            orientation: Some(OrientationBehaviour::Preserving),
            refinement: Refinement::Bcicp,
        }
    }
}

impl MapShapesOptions {
    /// Size of the map that is fitted.
    #[must_use]
    pub fn fit_functions(&self) -> usize {
        self.n_fit
            .unwrap_or(DEFAULT_FIT_FUNCTIONS.min(self.n_functions))
    }
}

/// A mesh and the file it came from.
#[derive(Debug, Clone, Copy)]
pub struct NamedShape<'a> {
    /// The file, for messages and results.
    pub path: &'a Path,
    /// The mesh.
    pub mesh: &'a TriMesh,
}

/// What the computation is about to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MapStage {
    /// Operators of both shapes.
    Operators,
    /// Eigenfunctions of both shapes.
    Eigenfunctions,
    /// Descriptors of both shapes.
    Descriptors,
    /// The first map.
    Fit,
    /// From few functions to all.
    ZoomOut,
    /// Both directions at once.
    Bcicp,
}

impl MapStage {
    /// Number of stages at most.
    pub const COUNT: u64 = 6;
}

impl std::fmt::Display for MapStage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Operators => "operators",
            Self::Eigenfunctions => "eigenfunctions",
            Self::Descriptors => "descriptors",
            Self::Fit => "fitting the map",
            Self::ZoomOut => "ZoomOut",
            Self::Bcicp => "BCICP",
        })
    }
}

/// Seconds that the stages took, both shapes together.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StageSeconds {
    /// Operators.
    pub operators: f64,
    /// Eigenfunctions.
    pub eigenfunctions: f64,
    /// Descriptors.
    pub descriptors: f64,
    /// The first map.
    pub fit: f64,
    /// ZoomOut with both point maps.
    pub zoomout: f64,
    /// BCICP; 0 if it was not asked for.
    pub bcicp: f64,
}

/// A shape with its basis.
#[derive(Debug, Clone)]
pub struct PreparedShape {
    /// The mesh, scaled to unit area if that was asked for.
    pub mesh: TriMesh,
    /// The basis that belongs to it.
    pub basis: LaplaceBasis,
    /// Area of the shape as it was given, in the unit of its file squared.
    pub area: f64,
    /// How the operators were made, in the unit of the file.
    pub operators: OperatorsEntry,
    /// Whether no eigenfunction is missing.
    pub certified: bool,
}

/// A map between two shapes in both directions.
#[derive(Debug, Clone)]
pub struct ShapeMap {
    /// The source.
    pub source: PreparedShape,
    /// The target.
    pub target: PreparedShape,
    /// The fit from which the map grew.
    pub fit: Fit,
    /// The point maps.
    pub maps: PointMapPair,
    /// What it took.
    pub seconds: StageSeconds,
}

/// Maps one shape to another; `progress` is told every stage before it begins.
///
/// # Errors
/// [`Error::Operators`] or [`Error::Spectrum`] for a shape that has none, [`Error::Descriptors`]
/// if the spectra have nothing in common or a landmark does not exist, [`Error::Map`] for sizes
/// that do not fit.
pub fn map_shapes(
    source: &NamedShape<'_>,
    target: &NamedShape<'_>,
    landmarks: &[VertexPair],
    options: &MapShapesOptions,
    progress: &mut dyn FnMut(MapStage),
) -> Result<ShapeMap, Error> {
    let descriptors_failed = |error: DescriptorError| Error::Descriptors {
        source_path: source.path.to_owned(),
        target_path: target.path.to_owned(),
        error,
    };
    let map_failed = |error: FmapError| Error::Map {
        source_path: source.path.to_owned(),
        target_path: target.path.to_owned(),
        error,
    };
    let mut seconds = StageSeconds::default();

    progress(MapStage::Operators);
    let clock = Instant::now();
    let source_operators = operators_of(source, options.operators)?;
    let target_operators = operators_of(target, options.operators)?;
    seconds.operators = clock.elapsed().as_secs_f64();

    progress(MapStage::Eigenfunctions);
    let clock = Instant::now();
    let source = prepare(source, source_operators, options)?;
    let target = prepare(target, target_operators, options)?;
    seconds.eigenfunctions = clock.elapsed().as_secs_f64();

    progress(MapStage::Descriptors);
    let clock = Instant::now();
    let (source_functions, target_functions) =
        descriptors(&source.basis, &target.basis, landmarks, options)
            .map_err(descriptors_failed)?;
    seconds.descriptors = clock.elapsed().as_secs_f64();

    let source_shape = shape(&source, &source_functions);
    let target_shape = shape(&target, &target_functions);
    progress(MapStage::Fit);
    let clock = Instant::now();
    let fitted = fit(&source_shape, &target_shape, &fit_options(options)).map_err(map_failed)?;
    seconds.fit = clock.elapsed().as_secs_f64();

    progress(MapStage::ZoomOut);
    let clock = Instant::now();
    let growth = ZoomOutOptions {
        n_source: options.n_functions,
        n_target: options.n_functions,
        step: options.step,
    };
    let start = leading(&fitted.map, options.n_start);
    let refined = zoomout(&source.basis, &target.basis, &start, &growth).map_err(map_failed)?;
    let back = refined.map.adjoint();
    let mut maps = PointMapPair {
        target_to_source: refined.point_map,
        source_to_target: point_map_from_adjoint(&target.basis, &source.basis, &back)
            .map_err(map_failed)?,
    };
    seconds.zoomout = clock.elapsed().as_secs_f64();

    if options.refinement == Refinement::Bcicp {
        progress(MapStage::Bcicp);
        let clock = Instant::now();
        let both = bcicp_from_point_maps(
            &source_shape,
            &target_shape,
            &maps,
            &BcicpOptions::default(),
        )
        .map_err(map_failed)?;
        maps = PointMapPair {
            target_to_source: both.target_to_source,
            source_to_target: both.source_to_target,
        };
        seconds.bcicp = clock.elapsed().as_secs_f64();
    }
    Ok(ShapeMap {
        source,
        target,
        fit: fitted,
        maps,
        seconds,
    })
}

impl ShapeMap {
    /// The map that the command writes: one source vertex for every target vertex.
    #[must_use]
    pub fn point_map(&self) -> &PointMap {
        &self.maps.target_to_source
    }
}

type MadeOperators = (LaplaceOperators, OperatorsEntry);

fn operators_of(shape: &NamedShape<'_>, choice: OperatorChoice) -> Result<MadeOperators, Error> {
    let failed = |error| Error::Operators {
        path: shape.path.to_owned(),
        error,
    };
    let made = operators_for(choice, shape.mesh).map_err(failed)?;
    // A vertex that is on no face lies nowhere on the shape, so it has no image.
    match made.0.rows.row_of_vertex().iter().position(Option::is_none) {
        Some(vertex) => Err(failed(OperatorError::UnreferencedVertex { vertex })),
        None => Ok(made),
    }
}

/// Eigenfunctions in the unit of the file, then everything scaled.
fn prepare(
    shape: &NamedShape<'_>,
    (operators, entry): MadeOperators,
    options: &MapShapesOptions,
) -> Result<PreparedShape, Error> {
    let pairs = smallest_eigenpairs(
        &operators.stiffness,
        &operators.mass,
        options.n_functions,
        &EigenOptions::default(),
    )
    .map_err(|error| Error::Spectrum {
        path: shape.path.to_owned(),
        error,
    })?;
    let certified = pairs.certificate.complete;
    let mut basis = LaplaceBasis {
        eigenvalues: pairs.eigenvalues,
        eigenfunctions: pairs.eigenvectors,
        mass: operators.mass,
        null_dimension: pairs.null_dimension,
    };
    let area = basis.area();
    let mut mesh = shape.mesh.clone();
    if options.scale == Scale::UnitArea {
        // x → x/√A:  λ → A λ,  M → M/A,  φ → √A φ.
        let length = area.sqrt();
        mesh = scaled(&mesh, 1.0 / length).map_err(|error| Error::Scaled {
            path: shape.path.to_owned(),
            error,
        })?;
        basis
            .eigenvalues
            .iter_mut()
            .for_each(|value| *value *= area);
        basis.mass.iter_mut().for_each(|mass| *mass /= area);
        basis.eigenfunctions *= faer::Scale(length);
    }
    Ok(PreparedShape {
        mesh,
        basis,
        area,
        operators: entry,
        certified,
    })
}

/// The mesh with its centroid at the origin, so that no digits are lost, times a factor.
fn scaled(mesh: &TriMesh, factor: f64) -> Result<TriMesh, MeshError> {
    let center = mesh.centroid();
    let vertices = mesh
        .vertices()
        .iter()
        .map(|p| Point3::from((p - center) * factor))
        .collect();
    TriMesh::new(vertices, mesh.faces().to_vec())
}

fn shape<'a>(prepared: &'a PreparedShape, descriptors: &'a Mat<f64>) -> Shape<'a> {
    Shape {
        mesh: &prepared.mesh,
        basis: &prepared.basis,
        descriptors,
    }
}

fn fit_options(options: &MapShapesOptions) -> FitOptions {
    let default = EnergyWeights::default();
    FitOptions {
        n_source: options.fit_functions(),
        n_target: options.fit_functions(),
        weights: EnergyWeights {
            orientation: options.orientation.map_or(0.0, |_| default.orientation),
            ..default
        },
        orientation: options.orientation.unwrap_or_default(),
        ..FitOptions::default()
    }
}

/// The part of a map in the first functions: those that descriptors determine best.
fn leading(map: &FunctionalMap, n: usize) -> FunctionalMap {
    let (rows, columns) = (map.n_target().min(n), map.n_source().min(n));
    FunctionalMap {
        matrix: map.matrix.submatrix(0, 0, rows, columns).to_owned(),
    }
}

/// Descriptors of both shapes, with one range of times and energies for the two.
fn descriptors(
    source: &LaplaceBasis,
    target: &LaplaceBasis,
    landmarks: &[VertexPair],
    options: &MapShapesOptions,
) -> Result<(Mat<f64>, Mat<f64>), DescriptorError> {
    let energies = |n| WaveEnergies::joint(source, target, n);
    let times = |n| HeatTimes::joint(source, target, n);
    let third = |n: usize| n.div_ceil(3);
    let (waves, heats) = (energies(options.n_wave)?, times(options.n_heat)?);
    let landmark_waves = energies(third(options.n_wave))?;
    let landmark_heats = times(third(options.n_heat))?;
    let of = |basis: &LaplaceBasis, vertex_of: fn(&VertexPair) -> usize| {
        let mut parts = vec![
            wave_kernel_signature(basis, &waves),
            heat_kernel_signature(basis, &heats),
        ];
        for vertex in landmarks.iter().map(vertex_of) {
            parts.push(wave_kernel_from_landmark(basis, vertex, &landmark_waves)?);
            parts.push(heat_kernel_from_landmark(basis, vertex, &landmark_heats)?);
        }
        Ok(normalize_columns(concatenate_columns(&parts), &basis.mass))
    };
    Ok((
        of(source, |pair| pair.source)?,
        of(target, |pair| pair.target)?,
    ))
}
