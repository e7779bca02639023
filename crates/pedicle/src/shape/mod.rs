//! Spectra of shapes and maps between two of them, from files to files.
//!
//! The shapes may be anything: none of this has heard of a vertebra. Lengths are in the unit of
//! the files.

mod colors;
mod glb;
mod landmarks;
mod map;
mod map_file;
mod operators;
mod outputs;
mod spectrum;

pub use colors::{pulled_back_colors, side_by_side, smooth_colors};
pub use glb::{ColoredShape, glb_bytes};
pub use landmarks::{VertexPair, VertexPairError, read_vertex_pairs};
pub use map::{
    MapShapesOptions, MapStage, NamedShape, PreparedShape, Refinement, Scale, ShapeMap,
    StageSeconds, map_shapes,
};
pub use map_file::{
    EnergyEntry, LandmarkEntry, MapFile, QualityEntry, ShapeEntry, SizesEntry, mean_image_distance,
};
pub use operators::{OperatorChoice, OperatorsEntry, operators_for};
pub use outputs::{check_output, write_bytes};
pub use spectrum::{CertificateEntry, SpectrumFile, spectrum};
