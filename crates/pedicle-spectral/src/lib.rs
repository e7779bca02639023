//! Smallest eigenpairs of sparse symmetric pencils and the Laplace basis made of them.

mod basis;

pub use basis::LaplaceBasis;
