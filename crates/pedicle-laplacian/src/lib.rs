//! Discrete Laplace-Beltrami operators on triangle meshes.
//!
//! ```text
//! W x = λ M x,   W_ij = -(cot α_ij + cot β_ij) / 2,   W_ii = -Σ_j W_ij,   M_ii = area at vertex i
//! ```
//!
//! W is n × n, symmetric, positive semidefinite, its rows sum to 0, and it has no unit (weak form).
//! M is diagonal, in mm². Pinkall & Polthier 1993; Meyer, Desbrun, Schröder, Barr 2003;
//! Sharp & Crane 2020 for the mollification.
//!
//! One function does the work: [`cotangent_operators`]. Bad faces and vertices are refused by name;
//! [`OperatorOptions`] can ask for mollified lengths and for Voronoi areas instead.
//!
//! ```
//! use nalgebra::Point3;
//! use pedicle_laplacian::{OperatorOptions, cotangent_operators};
//! use pedicle_mesh::TriMesh;
//!
//! // A unit square cut along one diagonal.
//! let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
//! let vertices = corners.iter().map(|c| Point3::new(c[0], c[1], 0.0)).collect();
//! let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]])?;
//! let operators = cotangent_operators(&mesh, &OperatorOptions::default())?;
//!
//! // Right angles face the diagonal, 45 degrees face the sides.
//! assert_eq!(operators.stiffness.get(0, 1), Some(&-0.5));
//! assert!((operators.mass.iter().sum::<f64>() - 1.0).abs() < 1e-15);
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
