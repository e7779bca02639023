//! Functional maps between shapes: energy, fit, refinements, point maps and their quality.

mod adjacency;
mod bcicp;
mod convert;
mod energy;
mod error;
mod fit;
mod linear;
mod map;
mod mask;
mod nearest;
mod operators;
mod quality;
mod spatial;
mod zoomout;

pub use bcicp::{Bcicp, BcicpOptions, BcicpStep, bcicp, bcicp_from_point_maps};
pub use convert::{
    functional_from_point_map, point_map_from_functional, point_map_pair_from_functional,
};
pub use energy::{Energy, EnergyTerms, EnergyWeights, OperatorColumns, OrientationBehaviour};
pub use error::{FmapError, Side};
pub use fit::{Fit, FitOptions, FitTermination, fit, minimize};
pub use map::{FunctionalMap, PointMap, PointMapPair, Shape};
pub use mask::{LaplacianMask, laplacian_mask};
pub use quality::{
    Continuity, bijectivity_error, continuity, coverage, mean_error_mm, mean_error_over_sqrt_area,
    vertex_coverage,
};
pub use zoomout::{Refined, SpectralStep, ZoomOutOptions, spectral_icp, zoomout};
