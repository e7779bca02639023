//! Validated triangle meshes: topology, measures, repair, simplification, closest points, formats.
//!
//! - [`TriMesh`]: a mesh that exists has finite vertices and valid indices; [`concatenate`].
//! - [`read_mesh`], [`write_mesh`], [`read_parts`]: PLY, STL, OBJ, OFF and VTP; [`Space`] tells RAS from LPS.
//! - [`topology`]: components, boundary loops, manifoldness, genus, neighbours.
//! - [`defects`], [`repair`]: what is wrong with a mesh, and what can be removed without a hole.
//! - [`simplify`]: fewer faces out of the original vertices, component by component.
//! - [`SurfaceIndex`]: closest points, rays and inside tests.
//! - [`ScalarGrid`]: the closed surface of samples on a grid.
//! - [`edge_lengths`], [`volume`], [`angle_weighted_normals`], [`smallest_angle_rad`].
//!
//! Lengths are in the unit of the file; the rest of the workspace reads them as millimetres.
//! Faces turn counter-clockwise seen from outside. Every result depends on the input alone.
//!
//! ```
//! use nalgebra::Point3;
//! use pedicle_mesh::{RepairOptions, SurfaceIndex, TriMesh, defects, genus, repair, volume};
//!
//! // A tetrahedron with a doubled face and a vertex that no face uses.
//! let vertices = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0], [9.0; 3]];
//! let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2], [3, 1, 2]];
//! let mesh = TriMesh::new(vertices.map(Point3::from).to_vec(), faces)?;
//! assert_eq!(defects(&mesh).duplicate_faces, [4]);
//!
//! let (mesh, report) = repair(&mesh, &RepairOptions::default())?;
//! assert_eq!((report.n_duplicate_faces, report.n_removed_vertices), (1, 1));
//! assert_eq!(genus(&mesh), Some(0));
//! assert!((volume(&mesh) - 4.5).abs() < 1e-12);
//!
//! let surface = SurfaceIndex::new(&mesh)?;
//! let near = surface.closest_point(&Point3::new(0.5, 0.5, -2.0));
//! assert_eq!((near.face, near.distance_mm), (0, 2.0));
//! assert!(surface.contains(&Point3::new(0.5, 0.5, 0.5)));
//! # Ok::<(), pedicle_mesh::MeshError>(())
//! ```

mod collapse;
mod defects;
mod edit;
mod error;
pub mod io;
mod isosurface;
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
    Encoding, MeshFile, MeshFormat, Part, ReadError, Space, WriteError, WriteOptions, read_mesh,
    read_parts, space_of, write_mesh,
};
pub use isosurface::{IsoSurface, ScalarGrid};
pub use measures::{EdgeLengths, angle_weighted_normals, edge_lengths, smallest_angle_rad, volume};
pub use repair::{RepairOptions, RepairReport, repair};
pub use simplify::{FaceShare, Simplified, SimplifyOptions, Spacing, simplify};
pub use surface_index::{RayHit, SurfaceIndex, SurfacePoint};
pub use topology::{
    Components, VertexAdjacency, boundary_loops, connected_components, euler_characteristic, genus,
    is_closed_manifold, non_manifold_edges, non_manifold_vertices, vertex_adjacency,
};
pub use trimesh::{SubMesh, TriMesh, concatenate};
