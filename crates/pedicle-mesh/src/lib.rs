//! Validated triangle meshes: topology, measures, repair, simplification, closest points, formats.
//!
//! Lengths are in the unit of the file; the rest of the workspace reads them as millimetres.

mod error;
pub mod io;
mod measures;
mod surface_index;
mod trimesh;

pub use error::MeshError;
pub use io::{
    Encoding, MeshFile, MeshFormat, Part, ReadError, WriteError, WriteOptions, read_mesh,
    read_parts, write_mesh,
};
pub use measures::{EdgeLengths, angle_weighted_normals, edge_lengths, smallest_angle_rad, volume};
pub use surface_index::{RayHit, SurfaceIndex, SurfacePoint};
pub use trimesh::{SubMesh, TriMesh, concatenate};
