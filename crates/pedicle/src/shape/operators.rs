//! Which operators a command uses, and what it says of them.

use clap::ValueEnum;
use pedicle_laplacian::{
    Mollification, OperatorError, OperatorOptions, Operators, cotangent_operators,
};
use pedicle_mesh::TriMesh;
use serde::{Deserialize, Serialize};

/// How the Laplacian of a surface is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OperatorChoice {
    /// Cotangent weights of the faces as they are; faces without area are refused.
    Cotangent,
    /// Cotangent weights after intrinsic mollification: one small length is added to every edge
    /// where faces are slivers or without area.
    Robust,
}

/// What was done to make the operators, for the result files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OperatorsEntry {
    /// The construction, in words.
    pub construction: String,
    /// Length added to every edge, in the unit of the file; 0 if nothing had to change.
    pub mollification: f64,
    /// The same over the mean length of the edges.
    pub relative_mollification: f64,
    /// Edges whose weight has the wrong sign: they break the maximum principle, not the spectrum.
    pub n_negative_weights: usize,
    /// The face of the smallest height over its longest edge, counted from 0.
    pub thinnest_face: usize,
    /// That height as a share of that edge; 0.87 for an equilateral face.
    pub thinnest_height_over_length: f64,
}

/// The operators of a mesh: the only place that knows how a choice is carried out.
///
/// # Errors
/// [`OperatorError`] if the mesh has a defect that the choice cannot live with.
pub fn operators_for(
    choice: OperatorChoice,
    mesh: &TriMesh,
) -> Result<(Operators, OperatorsEntry), OperatorError> {
    let (construction, mollification) = match choice {
        OperatorChoice::Cotangent => ("cotangent", Mollification::Refuse),
        OperatorChoice::Robust => (
            "cotangent on intrinsically mollified lengths",
            Mollification::intrinsic(),
        ),
    };
    let options = OperatorOptions {
        mollification,
        ..OperatorOptions::default()
    };
    let operators = cotangent_operators(mesh, &options)?;
    let report = &operators.report;
    let entry = OperatorsEntry {
        construction: construction.to_owned(),
        mollification: report.mollification_mm,
        relative_mollification: report.relative_mollification,
        n_negative_weights: report.n_negative_weights,
        thinnest_face: report.thinnest_face,
        thinnest_height_over_length: report.thinnest_height_over_length,
    };
    Ok((operators, entry))
}
