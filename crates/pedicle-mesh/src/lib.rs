//! Validated triangle meshes: topology, measures, repair, simplification, closest points, formats.
//!
//! Lengths are in the unit of the file; the rest of the workspace reads them as millimetres.

mod error;
mod trimesh;

pub use error::MeshError;
pub use trimesh::{SubMesh, TriMesh, concatenate};
