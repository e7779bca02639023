//! Validated triangle meshes: topology, measures, repair, simplification, closest points, formats.
//!
//! Lengths are in the unit of the file; the rest of the workspace reads them as millimetres.

mod collapse;
mod defects;
mod edit;
mod error;
pub mod io;
mod measures;
mod repair;
mod simplify;
mod slivers;
mod surface_index;
pub mod topology;
mod trimesh;

pub use defects::{Defects, defects};
pub use error::MeshError;
pub use io::{
    Encoding, MeshFile, MeshFormat, Part, ReadError, WriteError, WriteOptions, read_mesh,
    read_parts, write_mesh,
};
pub use measures::{EdgeLengths, angle_weighted_normals, edge_lengths, smallest_angle_rad, volume};
pub use repair::{RepairOptions, RepairReport, repair};
pub use simplify::{FaceShare, Simplified, SimplifyOptions, Spacing, simplify};
pub use surface_index::{RayHit, SurfaceIndex, SurfacePoint};
pub use topology::{
    Components, VertexAdjacency, boundary_loops, connected_components, euler_characteristic, genus,
    is_closed_manifold, non_manifold_edges, non_manifold_vertices, vertex_adjacency,
};
pub use trimesh::{SubMesh, TriMesh, concatenate};
