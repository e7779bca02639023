//! The Laplace basis of a shape: M-orthonormal eigenfunctions of W x = λ M x.

use faer::{Mat, MatRef};

/// Eigenfunctions of the Laplacian, the generalised Fourier basis of a shape.
///
/// Φ is n × k with ΦᵀMΦ = I, M the lumped mass; eigenvalues ascend from 0.
#[derive(Debug, Clone)]
pub struct LaplaceBasis {
    /// Eigenvalues in ascending order, 1/mm².
    pub eigenvalues: Vec<f64>,
    /// Eigenfunctions, one a column, n × k, M-orthonormal.
    pub eigenfunctions: Mat<f64>,
    /// Diagonal of the lumped mass matrix, mm².
    pub mass: Vec<f64>,
    /// Number of leading eigenvalues that are zero: the number of connected components.
    pub null_dimension: usize,
}

impl LaplaceBasis {
    /// Number of vertices n.
    #[must_use]
    pub fn n_vertices(&self) -> usize {
        self.mass.len()
    }

    /// Number of eigenfunctions k.
    #[must_use]
    pub fn n_functions(&self) -> usize {
        self.eigenvalues.len()
    }

    /// Total area of the shape, mm².
    #[must_use]
    pub fn area(&self) -> f64 {
        self.mass.iter().sum()
    }

    /// Coefficients ΦᵀM f of functions given as columns (n × p in, k × p out).
    ///
    /// # Panics
    /// If the number of rows is not the number of vertices.
    #[must_use]
    pub fn project(&self, functions: MatRef<'_, f64>) -> Mat<f64> {
        assert_eq!(functions.nrows(), self.n_vertices(), "one row per vertex");
        let weighted = Mat::from_fn(functions.nrows(), functions.ncols(), |i, j| {
            self.mass[i] * functions[(i, j)]
        });
        self.eigenfunctions.transpose() * weighted
    }

    /// Functions Φ a of coefficients given as columns (k × p in, n × p out).
    ///
    /// # Panics
    /// If the number of rows is not the number of eigenfunctions.
    #[must_use]
    pub fn reconstruct(&self, coefficients: MatRef<'_, f64>) -> Mat<f64> {
        assert_eq!(
            coefficients.nrows(),
            self.n_functions(),
            "one row per eigenfunction"
        );
        &self.eigenfunctions * coefficients
    }

    /// The basis of the first `n_functions` eigenfunctions.
    ///
    /// # Panics
    /// If there are fewer.
    #[must_use]
    pub fn truncated(&self, n_functions: usize) -> Self {
        assert!(
            n_functions <= self.n_functions(),
            "only {} functions",
            self.n_functions()
        );
        Self {
            eigenvalues: self.eigenvalues[..n_functions].to_vec(),
            eigenfunctions: self.eigenfunctions.subcols(0, n_functions).to_owned(),
            mass: self.mass.clone(),
            null_dimension: self.null_dimension.min(n_functions),
        }
    }
}
