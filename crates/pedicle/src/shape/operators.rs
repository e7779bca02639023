//! Which operators a command uses, and what it says of them.

use clap::ValueEnum;
use pedicle_laplacian::{
    Construction, LaplaceOperators, LaplaceOptions, OperatorError, Surface, laplace_operators,
};
use pedicle_mesh::TriMesh;
use serde::{Deserialize, Serialize};

/// How the Laplacian of a surface is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OperatorChoice {
    /// Cotangent weights of the faces as they are; faces without area and vertices without a face
    /// are refused.
    Cotangent,
    /// Mollified lengths, tufted cover where three faces meet, intrinsic Delaunay flips.
    Robust,
}

/// What was met and done to make the operators, for the result files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OperatorsEntry {
    /// The construction, in words.
    pub construction: String,
    /// Length added to every edge, in the unit of the file; 0 if nothing had to change.
    pub mollification: f64,
    /// The same over the mean length of the edges.
    pub relative_mollification: f64,
    /// Edges flipped, both sheets of a cover counted.
    pub n_flips: usize,
    /// Edges whose weight has the wrong sign: they break the maximum principle, not the spectrum.
    pub n_negative_weights: usize,
    /// Edges of three or more faces.
    pub n_non_manifold_edges: usize,
    /// Faces left out: copies of others, or with a corner twice.
    pub n_faces_left_out: usize,
    /// Faces without area.
    pub n_zero_area_faces: usize,
    /// Faces with an angle below 1 degree.
    pub n_sliver_faces: usize,
    /// Vertices of no face: they have no part in the spectrum.
    pub n_unreferenced_vertices: usize,
}

/// The operators of a mesh: the only place that knows how a choice is carried out.
///
/// # Errors
/// [`OperatorError`] if the mesh has a defect that the choice cannot live with.
pub fn operators_for(
    choice: OperatorChoice,
    mesh: &TriMesh,
) -> Result<(LaplaceOperators, OperatorsEntry), OperatorError> {
    let (words, construction) = match choice {
        OperatorChoice::Cotangent => ("cotangent", Construction::Cotangent),
        OperatorChoice::Robust => (
            "mollified lengths, tufted cover, intrinsic Delaunay",
            Construction::Robust,
        ),
    };
    let options = LaplaceOptions {
        construction,
        ..LaplaceOptions::default()
    };
    let operators = laplace_operators(Surface::Mesh(mesh), &options)?;
    if choice == OperatorChoice::Cotangent
        && let Some(&vertex) = operators.report.defects.unreferenced_vertices.first()
    {
        let vertex = vertex as usize;
        return Err(OperatorError::UnreferencedVertex { vertex });
    }
    let (report, defects) = (&operators.report, &operators.report.defects);
    let entry = OperatorsEntry {
        construction: words.to_owned(),
        mollification: report.mollification_mm,
        relative_mollification: report.relative_mollification,
        n_flips: report.n_flips,
        n_negative_weights: report.n_negative_weights,
        n_non_manifold_edges: defects.non_manifold_edges.len(),
        n_faces_left_out: defects.repeated_index_faces.len() + defects.duplicate_faces.len(),
        n_zero_area_faces: defects.zero_area_faces.len(),
        n_sliver_faces: defects.sliver_faces.len(),
        n_unreferenced_vertices: defects.unreferenced_vertices.len(),
    };
    Ok((operators, entry))
}
