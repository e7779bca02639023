//! The spectrum of a mesh file, as `pedicle spectrum` writes it.

use std::path::Path;

use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs};
use serde::{Deserialize, Serialize};

use super::{OperatorChoice, OperatorsEntry, operators_for};
use crate::Error;

/// Name of the format of [`SpectrumFile`].
const FORMAT: &str = "pedicle-spectrum";
/// Its version; it grows when a key changes its meaning or goes away.
const FORMAT_VERSION: u32 = 1;

/// The smallest eigenvalues of W x = λ M x on a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpectrumFile {
    /// `pedicle-spectrum`.
    pub format: String,
    /// Version of the format, 1.
    pub format_version: u32,
    /// Version of the program.
    pub program_version: String,
    /// The mesh file as it was named.
    pub mesh: String,
    /// Number of vertices.
    pub n_vertices: usize,
    /// Number of faces.
    pub n_faces: usize,
    /// Sum of the lumped masses, in the unit of the file squared.
    pub area: f64,
    /// Number of leading eigenvalues that are zero: the number of connected pieces.
    pub null_dimension: usize,
    /// How the operators were made.
    pub operators: OperatorsEntry,
    /// Whether the count of the eigenvalues below the last one proves that none is missing.
    pub certified: bool,
    /// The count.
    pub certificate: CertificateEntry,
    /// Eigenvalues in ascending order, one over the unit of the file squared.
    pub eigenvalues: Vec<f64>,
    /// ‖W x - λ M x‖ in the M⁻¹ norm, one a pair, in the unit of the eigenvalues.
    pub residuals: Vec<f64>,
}

/// The count of eigenvalues by inertia.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CertificateEntry {
    /// A shift above the last eigenvalue; null where all eigenvalues were computed.
    pub shift: Option<f64>,
    /// Eigenvalues below the shift, from the signs of the pivots of W - shift M.
    pub n_below: usize,
    /// Eigenvalues below the shift that the solver has seen.
    pub n_found: usize,
}

/// The `n_pairs` smallest eigenvalues of a mesh that was read from `path`.
///
/// # Errors
/// [`Error::Operators`] for a mesh with defects that the choice of operators cannot live with,
/// [`Error::Spectrum`] for more pairs than vertices or no convergence.
pub fn spectrum(
    path: &Path,
    mesh: &TriMesh,
    n_pairs: usize,
    choice: OperatorChoice,
) -> Result<SpectrumFile, Error> {
    let (operators, entry) = operators_for(choice, mesh).map_err(|error| Error::Operators {
        path: path.to_owned(),
        error,
    })?;
    let EigenPairs {
        eigenvalues,
        residuals,
        null_dimension,
        certificate,
        ..
    } = smallest_eigenpairs(
        &operators.stiffness,
        &operators.mass,
        n_pairs,
        &EigenOptions::default(),
    )
    .map_err(|error| Error::Spectrum {
        path: path.to_owned(),
        error,
    })?;
    Ok(SpectrumFile {
        format: FORMAT.to_owned(),
        format_version: FORMAT_VERSION,
        program_version: env!("CARGO_PKG_VERSION").to_owned(),
        mesh: path.display().to_string(),
        n_vertices: mesh.n_vertices(),
        n_faces: mesh.n_faces(),
        area: operators.mass.iter().sum(),
        null_dimension,
        operators: entry,
        certified: certificate.complete,
        certificate: CertificateEntry {
            shift: certificate.shift.is_finite().then_some(certificate.shift),
            n_below: certificate.n_below,
            n_found: certificate.n_found,
        },
        eigenvalues,
        residuals,
    })
}
