//! Discrete Laplace-Beltrami operators on triangle meshes in any state and on clouds of points.
//!
//! ```text
//! W x = λ M x,   W_ij = -(cot α_ij + cot β_ij) / 2,   W_ii = -Σ_j W_ij,   M_ii = area at vertex i
//! ```
//!
//! W is n × n, symmetric, positive semidefinite, its rows sum to 0 (under natural boundary
//! conditions), and it has no unit (weak form). M is diagonal, in mm².
//!
//! - [`laplace_operators`]: the one entry point, for any [`Surface`].
//! - [`Construction`]: plain cotangents (Pinkall & Polthier 1993), intrinsic Delaunay triangles by
//!   edge flips (Fisher, Springborn, Schröder, Bobenko 2007), or mollified lengths and the tufted
//!   cover (Sharp & Crane 2020), which takes any faces and any cloud.
//! - [`Boundary`]: natural, Dirichlet, or fixed vertices of the caller's choice; [`VertexRows`] tells
//!   which vertices are kept and extends functions to the others by 0.
//! - [`MassKind`]: barycentric or mixed Voronoi (Meyer, Desbrun, Schröder, Barr 2003).
//! - [`LaplaceReport`], [`SurfaceDefects`]: what was wrong and what had to be done.
//! - [`cotangent_operators`]: plain cotangents alone, with every defect an error.
//!
//! ```
//! use nalgebra::Point3;
//! use pedicle_laplacian::{Boundary, LaplaceOptions, Surface, laplace_operators};
//! use pedicle_mesh::TriMesh;
//!
//! // A unit square in four triangles around its centre.
//! let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]];
//! let vertices = corners.iter().map(|c| Point3::new(c[0], c[1], 0.0)).collect();
//! let mesh = TriMesh::new(vertices, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])?;
//! let natural = laplace_operators(Surface::Mesh(&mesh), &LaplaceOptions::default())?;
//! assert!((natural.stiffness.get(4, 0).unwrap() + 1.0).abs() < 1e-15);
//! assert!((natural.mass.iter().sum::<f64>() - 1.0).abs() < 1e-15);
//!
//! // Held at 0 around the square, only the centre is left.
//! let options = LaplaceOptions { boundary: Boundary::Dirichlet, ..LaplaceOptions::default() };
//! let dirichlet = laplace_operators(Surface::Mesh(&mesh), &options)?;
//! assert_eq!(dirichlet.rows.vertex_of_row(), [4]);
//! assert_eq!(dirichlet.rows.extend(&[2.0]), [0.0, 0.0, 0.0, 0.0, 2.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assembly;
mod clean;
mod cloud;
mod construct;
mod delaunay;
mod error;
mod gluing;
mod intrinsic;
mod laplace;
mod mollify;
mod operators;
mod options;
mod report;
mod rows;
mod sides;
mod star;
mod triangle;

pub use error::OperatorError;
pub use laplace::{LaplaceOperators, Surface, laplace_operators};
pub use operators::{OperatorReport, Operators, cotangent_operators};
pub use options::{
    Boundary, Construction, LaplaceOptions, MassKind, Mollification, OperatorOptions,
};
pub use report::{LaplaceReport, SurfaceDefects};
pub use rows::VertexRows;
