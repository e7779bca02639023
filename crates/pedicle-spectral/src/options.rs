//! What the caller can choose.

use crate::SpectralError;

/// Options of [`smallest_eigenpairs`](crate::smallest_eigenpairs).
#[derive(Debug, Clone, PartialEq)]
pub struct EigenOptions {
    /// Largest residual ‖W x - λ M x‖ in the M⁻¹ norm, relative to the largest eigenvalue asked for.
    /// Eigenvalues are far more accurate, by its square. Default: 1e-11.
    pub tolerance: f64,
    /// Number of vectors multiplied at once. Default: 8.
    pub block_size: usize,
    /// Largest number of columns of the Krylov basis before a restart, known pairs not counted; `None` takes what the
    /// number of pairs needs. Default: `None`.
    pub max_basis_size: Option<usize>,
    /// Number of restarts after which the iteration gives up. Default: 100.
    pub max_restarts: usize,
    /// Seed of the Gaussian start block. Default: 0.
    pub seed: u64,
}

impl Default for EigenOptions {
    fn default() -> Self {
        Self {
            tolerance: 1e-11,
            block_size: 8,
            max_basis_size: None,
            max_restarts: 100,
            seed: 0,
        }
    }
}

impl EigenOptions {
    /// Refuses values outside their range.
    pub(crate) fn check(&self) -> Result<(), SpectralError> {
        if !(1e-13..=1e-2).contains(&self.tolerance) {
            return Err(SpectralError::InvalidOption {
                option: "tolerance",
                value: self.tolerance,
                range: "from 1e-13 to 1e-2",
            });
        }
        if !(1..=64).contains(&self.block_size) {
            return Err(SpectralError::InvalidOption {
                option: "block_size",
                value: self.block_size as f64,
                range: "from 1 to 64",
            });
        }
        Ok(())
    }
}
