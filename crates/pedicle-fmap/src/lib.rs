//! Functional maps between shapes: energy, fit, refinements, point maps and their quality.
//!
//! ```text
//! b = C a      C: k_target × k_source, functions from the source to the target
//! x = T(y)     a point map goes the other way: one source vertex for every target vertex
//! ```
//!
//! | file | what it holds |
//! |---|---|
//! | `map` | [`FunctionalMap`], [`PointMap`], [`Shape`] |
//! | `energy`, `mask`, `operators` | [`Energy`]: its terms, value and gradient |
//! | `fit` | [`fit`]: the map of least energy |
//! | `convert` | [`point_map_from_functional`], [`functional_from_point_map`] |
//! | `zoomout` | [`zoomout`], [`spectral_icp`] |
//! | `zoomout_bijective` | [`zoomout_bijective`]: both directions, each C of both point maps |
//! | `zoomout_subsampled`, `sampling` | [`zoomout_subsampled`] on [`farthest_point_samples`] |
//! | `bcicp`, `spatial` | [`bcicp`]: both directions at once |
//! | `progress` | [`RefinementStep`]: the report and the callback of every refinement |
//! | `precise`, `nearest_triangle` | [`PreciseMap`]: points in triangles; [`point_map_from_adjoint`] |
//! | `transfer` | functions, labels and points carried from the source to the target |
//! | `partial` | [`PartialSizes`]: size, slope and rank for a part; [`crop_along`] |
//! | `metric_quality`, `distribution` | [`map_errors`], [`edge_stretch`], .. in a [`Metric`]; quantiles |
//! | `quality` | [`coverage`], [`bijectivity_error`], [`continuity`], [`mean_error_mm`] |
//!
//! The crate does not know what its descriptors describe, nor what the shapes are. A null space of
//! any dimension (one for every connected component) is treated as a whole; nothing pins the first
//! column of C. Results do not depend on the number of threads.
//!
//! # Example
//!
//! ```
//! use faer::Mat;
//! use nalgebra::Point3;
//! use pedicle_fmap::{
//!     FitOptions, PointMap, Shape, ZoomOutOptions, fit, mean_error_mm, zoomout,
//! };
//! use pedicle_laplacian::{OperatorOptions, cotangent_operators};
//! use pedicle_mesh::TriMesh;
//! use pedicle_spectral::{EigenOptions, laplace_basis};
//!
//! // A strip of 40 × 8 squares, and the same strip rolled up.
//! let flat: Vec<Point3<f64>> = (0..41 * 9)
//!     .map(|v| Point3::new((v / 9) as f64, (v % 9) as f64, 0.0))
//!     .collect();
//! let rolled = flat.iter().map(|p| {
//!     let angle = p.x / 12.0;
//!     Point3::new(12.0 * angle.sin(), p.y, 12.0 * angle.cos())
//! });
//! let faces: Vec<[u32; 3]> = (0..40 * 8)
//!     .map(|square| 9 * (square / 8) + square % 8)
//!     .flat_map(|v| [[v, v + 9, v + 1], [v + 1, v + 9, v + 10]])
//!     .collect();
//! let source = TriMesh::new(flat.clone(), faces.clone())?;
//! let target = TriMesh::new(rolled.collect(), faces)?;
//!
//! let basis = |mesh: &TriMesh| -> Result<_, Box<dyn std::error::Error>> {
//!     let operators = cotangent_operators(mesh, &OperatorOptions::default())?;
//!     Ok(laplace_basis(&operators.stiffness, &operators.mass, 40, &EigenOptions::default())?)
//! };
//! let (source_basis, target_basis) = (basis(&source)?, basis(&target)?);
//!
//! // Functions that mean the same on both: distances along the strip to two landmarks.
//! let descriptors = Mat::from_fn(41 * 9, 8, |v, j| {
//!     let (p, landmark) = (flat[v], flat[if j % 2 == 0 { 20 } else { 300 }]);
//!     (-(p - landmark).norm() / (2.0 + j as f64)).exp()
//! });
//! let source_shape = Shape { mesh: &source, basis: &source_basis, descriptors: &descriptors };
//! let target_shape = Shape { mesh: &target, basis: &target_basis, descriptors: &descriptors };
//!
//! let options = FitOptions { n_source: 20, n_target: 20, ..FitOptions::default() };
//! let first = fit(&source_shape, &target_shape, &options)?;
//! let grow = ZoomOutOptions { n_source: 40, n_target: 40, step: 5 };
//! let refined = zoomout(&source_basis, &target_basis, &first.map, &grow)?;
//!
//! let truth = PointMap::identity(source.n_vertices())?;
//! assert!(mean_error_mm(&source, &target, &refined.point_map, &truth)? < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod adjacency;
mod ball_tree;
mod bcicp;
mod commutators;
mod convert;
mod correspondence;
mod distribution;
mod edges;
mod energy;
mod error;
mod fit;
mod growth;
mod joint;
mod lanes;
mod linear;
mod map;
mod mask;
mod metric_quality;
mod nearest;
mod nearest_triangle;
mod operators;
mod pairs;
mod partial;
mod precise;
mod progress;
mod pulled_back;
mod quality;
mod sampling;
mod scalar;
mod spatial;
mod stack;
mod transfer;
mod zoomout;
mod zoomout_bijective;
mod zoomout_subsampled;

pub use bcicp::{
    Bcicp, BcicpOptions, bcicp, bcicp_from_point_maps, bcicp_from_point_maps_with_progress,
    bcicp_with_progress,
};
pub use convert::{
    functional_from_point_map, point_map_from_functional, point_map_pair_from_functional,
};
pub use distribution::Distribution;
pub use energy::{Energy, EnergyTerms, EnergyWeights, OperatorColumns, OrientationBehaviour};
pub use error::{FmapError, Side};
pub use fit::{Fit, FitOptions, FitTermination, fit, minimize};
pub use map::{FunctionalMap, PointMap, PointMapPair, Shape};
pub use mask::{LaplacianMask, laplacian_mask};
pub use metric_quality::{Metric, edge_stretch, map_errors, precise_map_errors, round_trip_errors};
pub use partial::{PartialOptions, PartialSizes, crop_along};
pub use precise::{
    Embedding, PointInFace, PreciseMap, functional_from_precise_map, point_map_from_adjoint,
    precise_map_from_functional,
};
pub use progress::{MapQuality, QualityAt, RefinementStep, map_quality};
pub use quality::{
    Continuity, bijectivity_error, continuity, coverage, mean_error_mm, mean_error_over_sqrt_area,
    vertex_coverage,
};
pub use sampling::{SampleDistance, Samples, farthest_point_samples};
pub use transfer::target_vertices_of_points;
pub use zoomout::{
    Refined, ZoomOutOptions, spectral_icp, spectral_icp_with_progress, zoomout,
    zoomout_with_progress,
};
pub use zoomout_bijective::{
    BijectiveZoomOutOptions, RefinedPair, zoomout_bijective, zoomout_bijective_with_progress,
};
pub use zoomout_subsampled::{
    SubsampledZoomOut, SubsampledZoomOutOptions, zoomout_subsampled,
    zoomout_subsampled_with_progress,
};
