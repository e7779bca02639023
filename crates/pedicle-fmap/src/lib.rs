//! Functional maps between shapes: energy, fit, refinements, point maps and their quality.

mod adjacency;
mod convert;
mod energy;
mod error;
mod fit;
mod linear;
mod map;
mod mask;
mod nearest;
mod operators;
/// How good a point map is, with and without a known truth.
pub mod quality;
mod zoomout;

pub use convert::{
    functional_from_point_map, point_map_from_functional, point_map_pair_from_functional,
};
pub use energy::{
    Energy, EnergyOptions, EnergyTerms, EnergyWeights, OperatorColumns, OrientationBehaviour,
};
pub use error::{FmapError, Side};
pub use fit::{Fit, FitOptions, FitTermination, fit, minimize};
pub use map::{FunctionalMap, PointMap, PointMapPair, Shape};
pub use mask::{LaplacianMask, laplacian_mask};
pub use zoomout::{Refined, SpectralStep, ZoomOutOptions, spectral_icp, zoomout};
