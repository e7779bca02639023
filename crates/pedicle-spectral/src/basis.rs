//! The Laplace basis of a shape: M-orthonormal eigenfunctions of W x = λ M x.

use faer::{Mat, MatRef};

use crate::orthogonalize::product;

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
        product(self.eigenfunctions.transpose(), weighted.as_ref())
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
        product(self.eigenfunctions.as_ref(), coefficients)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Two functions on four vertices of unequal mass.
    fn basis() -> LaplaceBasis {
        let mass = vec![1.0, 2.0, 3.0, 4.0];
        let constant = 1.0 / 10.0_f64.sqrt();
        let mut eigenfunctions = Mat::from_fn(4, 2, |_, _| constant);
        for (i, x) in [3.0, 3.0, -3.0, 0.0].into_iter().enumerate() {
            eigenfunctions[(i, 1)] = x / 54.0_f64.sqrt();
        }
        LaplaceBasis {
            eigenvalues: vec![0.0, 1.0],
            eigenfunctions,
            mass,
            null_dimension: 1,
        }
    }

    #[test]
    fn projection_undoes_reconstruction() {
        let basis = basis();
        let coefficients = Mat::from_fn(2, 3, |i, j| (i as f64 - 0.3) * (j as f64 + 1.0));
        let functions = basis.reconstruct(coefficients.as_ref());
        let again = basis.project(functions.as_ref());
        assert!(
            (&again - &coefficients).norm_l2() < 1e-14,
            "ΦᵀMΦ is the identity"
        );
        assert!((basis.area() - 10.0).abs() < 1e-14, "area");
    }

    #[test]
    fn truncation_keeps_the_first_functions() {
        let shorter = basis().truncated(1);
        assert_eq!(shorter.n_functions(), 1, "functions");
        assert_eq!(shorter.eigenfunctions.ncols(), 1, "columns");
        assert_eq!(shorter.n_vertices(), 4, "vertices");
    }
}
