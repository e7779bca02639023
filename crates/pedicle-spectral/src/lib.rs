//! Smallest eigenpairs of sparse symmetric pencils and the Laplace basis made of them.

mod basis;
mod block;
mod components;
mod dense;
mod eigenpairs;
mod error;
mod factor;
mod lanczos;
mod lanes;
mod options;
mod orthogonalize;
mod pencil;
mod shift;
mod triangular;

pub use basis::LaplaceBasis;
pub use eigenpairs::{Certificate, EigenPairs, Work, laplace_basis, smallest_eigenpairs};
pub use error::SpectralError;
pub use options::EigenOptions;
