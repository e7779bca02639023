//! Smallest eigenpairs of sparse symmetric pencils, with a proof that none is missing.
//!
//! ```text
//! W x = λ M x,   0 ≤ λ_1 ≤ … ≤ λ_k,   x_iᵀ M x_j = δ_ij
//! ```
//!
//! W is sparse, symmetric and positive semidefinite, M diagonal and positive. The crate has never
//! heard of a mesh: any Laplacian will do. Eigenvalues have the unit of W over M (1/mm² for a
//! cotangent matrix and areas in mm²); nothing depends on that unit.
//!
//! - [`smallest_eigenpairs`] does the work: connected blocks, shift-invert block Lanczos, inertia.
//! - [`smallest_eigenpairs_from`] goes on from pairs that are known, the next 100 from the last 100.
//! - [`laplace_basis`] hands the result on as a [`LaplaceBasis`], the Fourier basis of a shape;
//!   [`laplace_basis_from`] goes on from one.
//!
//! Large matrices and several blocks use the threads of the current rayon pool. The work is cut in
//! the same pieces for any number of threads: every run gives the same bits.
//!
//! ```
//! use pedicle_spectral::{EigenOptions, laplace_basis};
//! use sprs::TriMat;
//!
//! // A ring of 200 vertices: 0, then every eigenvalue 2 - 2cos(2πi/200) twice.
//! let n = 200;
//! let mut ring = TriMat::new((n, n));
//! for i in 0..n {
//!     ring.add_triplet(i, i, 2.0);
//!     ring.add_triplet(i, (i + 1) % n, -1.0);
//!     ring.add_triplet((i + 1) % n, i, -1.0);
//! }
//! let basis = laplace_basis(&ring.to_csr(), &vec![1.0; n], 11, &EigenOptions::default())?;
//! let fifth = 2.0 - 2.0 * (std::f64::consts::TAU * 5.0 / 200.0).cos();
//! assert!((basis.eigenvalues[9] / fifth - 1.0).abs() < 1e-12);
//! assert!((basis.eigenvalues[10] / fifth - 1.0).abs() < 1e-12);
//! assert_eq!(basis.null_dimension, 1);
//! # Ok::<(), pedicle_spectral::SpectralError>(())
//! ```

mod basis;
mod block;
mod components;
mod dense;
mod eigenpairs;
mod error;
mod factor;
mod lanczos;
mod lanes;
mod narrow;
mod options;
mod orthogonalize;
mod panels;
mod parallel;
mod pencil;
mod shift;
mod triangular;
mod warm;

pub use basis::LaplaceBasis;
pub use eigenpairs::{
    Certificate, EigenPairs, Work, laplace_basis, laplace_basis_from, smallest_eigenpairs,
    smallest_eigenpairs_from,
};
pub use error::SpectralError;
pub use options::EigenOptions;
