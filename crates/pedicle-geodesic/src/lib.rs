//! Distances along triangle meshes.
//!
//! | file | what it holds |
//! |---|---|
//! | `graph` | [`EdgeGraph`]: shortest paths along edges and across them, balls, pairs |
//! | `heat` | [`HeatGeodesics`]: the heat method, two factors and any number of queries |
//!
//! The graph is cheap for what is near and never too short; the heat method converges to the
//! geodesic distance and is cheaper for distances to all vertices. Neither needs more memory than
//! in proportion to the vertices. Lengths are in the unit of the mesh, which the rest of the
//! workspace reads as millimetres. Distances between connected components are infinite. Results do
//! not depend on the number of threads.
//!
//! ```
//! use nalgebra::Point3;
//! use pedicle_geodesic::{EdgeGraph, HeatGeodesics, HeatOptions, Links};
//! use pedicle_mesh::TriMesh;
//!
//! // A strip of 40 × 8 squares bent into a U: the ends are near, but not along the surface.
//! let vertices = (0..41 * 9)
//!     .map(|v| {
//!         let angle = std::f64::consts::PI * f64::from(v / 9) / 40.0;
//!         Point3::new(10.0 * angle.cos(), f64::from(v % 9), 10.0 * angle.sin())
//!     })
//!     .collect();
//! let faces = (0..40 * 8)
//!     .map(|square| 9 * (square / 8) + square % 8)
//!     .flat_map(|v| [[v, v + 1, v + 9], [v + 1, v + 10, v + 9]])
//!     .collect();
//! let mesh = TriMesh::new(vertices, faces)?;
//! let truth = 10.0 * std::f64::consts::PI;
//!
//! let graph = EdgeGraph::new(&mesh, Links::AcrossEdges);
//! let along_edges = graph.distances_between(&[(4, 40 * 9 + 4)])?[0];
//! assert!((along_edges / truth - 1.0).abs() < 1e-3);
//!
//! let heat = HeatGeodesics::new(&mesh, &HeatOptions::default())?;
//! assert!((heat.distances_from(&[4])?[40 * 9 + 4] / truth - 1.0).abs() < 0.03);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod graph;
mod heat;
mod pairs;

pub use error::GeodesicError;
pub use graph::{EdgeGraph, Links};
pub use heat::{HeatGeodesics, HeatOptions};
