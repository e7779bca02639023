//! Stiffness and mass of a mesh.
//!
//! ```text
//! W_ij = -(cot α_ij + cot β_ij) / 2,   W_ii = -Σ_j W_ij,   M_ii = a third of the areas at i
//! ```
//!
//! W is n × n, symmetric, positive semidefinite, rows sum to 0, no unit. M is diagonal, mm². Faces
//! may have any orientation and edges any number of faces. Pinkall & Polthier 1993.

use pedicle_mesh::TriMesh;
use sprs::CsMat;

use crate::assembly::assemble_stiffness;
use crate::mollify::mollify;
use crate::triangle::TriangleShape;
use crate::{MassKind, Mollification, OperatorError, OperatorOptions};

/// The two matrices of the Laplacian W x = λ M x.
#[derive(Debug, Clone, PartialEq)]
pub struct Operators {
    /// Cotangent stiffness W, n × n, CSR with sorted columns and a full diagonal, symmetric to the bit.
    pub stiffness: CsMat<f64>,
    /// Diagonal of the lumped mass M, mm², all positive.
    pub mass: Vec<f64>,
    /// What was met on the way.
    pub report: OperatorReport,
}

/// What was met while the operators were made.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatorReport {
    /// Sum of the masses, the area of the surface, mm².
    pub area_mm2: f64,
    /// Length ε that mollification added to every edge, mm; 0 if none was needed or asked for.
    pub mollification_mm: f64,
    /// ε over the mean edge length.
    pub relative_mollification: f64,
    /// The face of the smallest height over its longest edge, after mollification.
    pub thinnest_face: usize,
    /// That height as a share of that edge (√3/2 for an equilateral face).
    pub thinnest_height_over_length: f64,
    /// Number of edges whose weight has the wrong sign, (cot α + cot β) < 0: they break the
    /// maximum principle, but not semidefiniteness.
    pub n_negative_weights: usize,
}

/// Cotangent stiffness and lumped mass of a mesh.
///
/// # Errors
/// [`OperatorError`] for a face without area (unless mollified), a face that repeats a vertex, a
/// vertex without a face, or an option out of range.
///
/// ```
/// # use nalgebra::Point3;
/// # use pedicle_mesh::TriMesh;
/// use pedicle_laplacian::{OperatorError, OperatorOptions, cotangent_operators};
/// let vertices = [0.0, 1.0, 2.0].map(|x| Point3::new(x, 0.0, 0.0)).to_vec();
/// let flat = TriMesh::new(vertices, vec![[0, 1, 2]])?;
/// let error = cotangent_operators(&flat, &OperatorOptions::default()).unwrap_err();
/// assert!(matches!(error, OperatorError::DegenerateFace { face: 0, .. }));
/// # Ok::<(), pedicle_mesh::MeshError>(())
/// ```
pub fn cotangent_operators(
    mesh: &TriMesh,
    options: &OperatorOptions,
) -> Result<Operators, OperatorError> {
    check_options(options)?;
    check_faces(mesh)?;
    let (shapes, mollification_mm, relative_mollification) = triangle_shapes(mesh, options);
    let (thinnest_face, thinnest_height_over_length) = check_heights(&shapes, options)?;
    let stiffness = assemble_stiffness(mesh.n_vertices(), mesh.faces(), &shapes);
    let mass = lumped_mass(mesh.n_vertices(), mesh.faces(), &shapes, options.mass);
    let report = OperatorReport {
        area_mm2: shapes.iter().map(|s| s.area).sum(),
        mollification_mm,
        relative_mollification,
        thinnest_face,
        thinnest_height_over_length,
        n_negative_weights: count_negative_weights(&stiffness),
    };
    Ok(Operators {
        stiffness,
        mass,
        report,
    })
}

fn check_options(options: &OperatorOptions) -> Result<(), OperatorError> {
    let margin = match options.mollification {
        Mollification::Refuse => None,
        Mollification::Intrinsic { relative_margin } => Some(("relative_margin", relative_margin)),
    };
    let height = ("min_height_over_length", options.min_height_over_length);
    for (option, value) in [Some(height), margin].into_iter().flatten() {
        if !(0.0..1.0).contains(&value) {
            return Err(OperatorError::InvalidOption { option, value });
        }
    }
    Ok(())
}

/// Refuses what no change of lengths can mend.
fn check_faces(mesh: &TriMesh) -> Result<(), OperatorError> {
    let mut is_used = vec![false; mesh.n_vertices()];
    for (face, &[a, b, c]) in mesh.faces().iter().enumerate() {
        if a == b || a == c || b == c {
            let vertex = if b == c { b } else { a };
            return Err(OperatorError::RepeatedVertex { face, vertex });
        }
        for v in [a, b, c] {
            is_used[v as usize] = true;
        }
    }
    match is_used.iter().position(|used| !used) {
        Some(vertex) => Err(OperatorError::UnreferencedVertex { vertex }),
        None => Ok(()),
    }
}

/// Shapes of all faces with the length added by mollification, absolute and relative.
fn triangle_shapes(mesh: &TriMesh, options: &OperatorOptions) -> (Vec<TriangleShape>, f64, f64) {
    let shapes: Vec<_> = (0..mesh.n_faces())
        .map(|face| TriangleShape::from_corners(mesh.triangle(face)))
        .collect();
    let Mollification::Intrinsic { relative_margin } = options.mollification else {
        return (shapes, 0.0, 0.0);
    };
    let lengths: Vec<_> = shapes
        .iter()
        .map(|s| s.squared_lengths.map(f64::sqrt))
        .collect();
    let mean = lengths.iter().flatten().sum::<f64>() / (3 * lengths.len()) as f64;
    let mollified = mollify(lengths, relative_margin);
    if mollified.added > 0.0 {
        let shapes = mollified.lengths.into_iter();
        let shapes = shapes.map(TriangleShape::from_lengths).collect();
        return (shapes, mollified.added, mollified.added / mean);
    }
    // Cotangents from vectors are the more accurate ones; keep them where nothing had to change.
    (shapes, 0.0, 0.0)
}

/// Finds the thinnest face and refuses the first one that is too thin.
fn check_heights(
    shapes: &[TriangleShape],
    options: &OperatorOptions,
) -> Result<(usize, f64), OperatorError> {
    let mut thinnest = (0, f64::INFINITY);
    for (face, shape) in shapes.iter().enumerate() {
        let height = shape.height_over_length();
        // Asked this way round so that NaN is refused as well.
        if !(height > options.min_height_over_length && height.is_finite()) {
            return Err(OperatorError::DegenerateFace {
                face,
                area_mm2: shape.area,
                longest_edge_mm: shape.longest_edge(),
            });
        }
        if height < thinnest.1 {
            thinnest = (face, height);
        }
    }
    Ok(thinnest)
}

/// Area of the triangles, shared among their vertices.
pub(crate) fn lumped_mass(
    n_vertices: usize,
    faces: &[[u32; 3]],
    shapes: &[TriangleShape],
    kind: MassKind,
) -> Vec<f64> {
    let mut mass = vec![0.0; n_vertices];
    for (face, shape) in faces.iter().zip(shapes) {
        let shares = match kind {
            MassKind::Barycentric => [shape.area / 3.0; 3],
            MassKind::MixedVoronoi => shape.mixed_voronoi_areas(),
        };
        for (&v, share) in face.iter().zip(shares) {
            mass[v as usize] += share;
        }
    }
    mass
}

/// Edges whose cotangents sum to clearly less than 0 (right angles leave rounding behind).
fn count_negative_weights(stiffness: &CsMat<f64>) -> usize {
    stiffness
        .iter()
        .filter(|&(&w, (i, j))| j > i && w > 1e-12)
        .count()
}
