//! Operators of any surface: a mesh in any state, or a cloud of points.
//!
//! ```text
//! W x = λ M x,   W and M of the triangles that the construction makes, rows of free vertices only
//! ```
//!
//! W is n × n, symmetric to the bit, positive semidefinite, no unit; its rows sum to 0 under natural
//! conditions. M is diagonal, positive, mm². Plain cotangents: Pinkall & Polthier 1993. Robust:
//! mollified lengths, tufted cover, intrinsic Delaunay, Sharp & Crane 2020.

use nalgebra::Point3;
use pedicle_mesh::TriMesh;
use sprs::CsMat;

use crate::assembly::{assemble_stiffness, restrict};
use crate::clean::{CleanMesh, clean_mesh};
use crate::cloud::{MIN_POINTS, distinct_points, local_triangles};
use crate::construct::{Triangles, cloud_triangles, delaunay_triangles, plain_triangles};
use crate::operators::lumped_mass;
use crate::sides::edges;
use crate::triangle::TriangleShape;
use crate::{
    Boundary, Construction, LaplaceOptions, LaplaceReport, MassKind, OperatorError, SurfaceDefects,
    VertexRows,
};

/// A weight counts as negative below minus this share of the diagonal entries beside it.
const NEGATIVE_WEIGHT: f64 = 1e-8;

/// What operators can be made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Surface<'a> {
    /// A triangle mesh in any state.
    Mesh(&'a TriMesh),
    /// Points on a surface, mm, in any order.
    Cloud(&'a [Point3<f64>]),
}

impl<'a> From<&'a TriMesh> for Surface<'a> {
    fn from(mesh: &'a TriMesh) -> Self {
        Self::Mesh(mesh)
    }
}

impl<'a> From<&'a [Point3<f64>]> for Surface<'a> {
    fn from(points: &'a [Point3<f64>]) -> Self {
        Self::Cloud(points)
    }
}

/// The two matrices of the Laplacian, one row a free vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct LaplaceOperators {
    /// Stiffness W, n × n, CSR with sorted columns and a full diagonal, symmetric to the bit.
    pub stiffness: CsMat<f64>,
    /// Diagonal of the lumped mass M, mm², all positive.
    pub mass: Vec<f64>,
    /// Which vertex has which row, and how functions are extended to all vertices.
    pub rows: VertexRows,
    /// Mass of every vertex of the input, mm²; they sum to the area. Fixed vertices have theirs, those
    /// of no face 0, and points at one place equal parts of the mass of their row.
    pub vertex_mass: Vec<f64>,
    /// What was met and done.
    pub report: LaplaceReport,
}

/// Stiffness and mass of any surface.
///
/// Needless faces and vertices are left out and listed (see [`SurfaceDefects`]). Vertices that are
/// fixed or left out have no row; [`VertexRows`] tells which, and extends functions to them by 0.
///
/// # Errors
/// [`OperatorError`] for a surface without area, a face too large to square, options out of range,
/// fixed vertices that do not exist or leave none free; under [`Construction::Cotangent`] for a face
/// without area; under [`Construction::Delaunay`] for an edge of three faces or a surface with one
/// side; for a cloud that is not finite, too small or on a line, or whose boundary or faces are asked for.
///
/// ```
/// # use nalgebra::Point3;
/// # use pedicle_mesh::TriMesh;
/// use pedicle_laplacian::{Construction, LaplaceOptions, Surface, laplace_operators};
/// // Three sheets that meet at one edge, and a vertex of none.
/// let corners = [[0., 0., 0.], [0., 0., 1.], [1., 0., 0.], [-1., 1., 0.], [-1., -1., 0.], [9.; 3]];
/// let faces = vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]];
/// let mesh = TriMesh::new(corners.map(Point3::from).to_vec(), faces)?;
/// let operators = laplace_operators(Surface::Mesh(&mesh), &LaplaceOptions::default())?;
/// assert_eq!(operators.report.construction, Construction::Robust);
/// assert_eq!(operators.report.defects.non_manifold_edges, [[0, 1]]);
/// assert_eq!(operators.rows.vertex_of_row(), [0, 1, 2, 3, 4]);
/// assert_eq!(operators.rows.extend(&[1.0; 5])[5], 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn laplace_operators(
    surface: Surface<'_>,
    options: &LaplaceOptions,
) -> Result<LaplaceOperators, OperatorError> {
    check_options(options)?;
    match surface {
        Surface::Mesh(mesh) => mesh_operators(mesh, options),
        Surface::Cloud(points) => cloud_operators(points, options),
    }
}

fn check_options(options: &LaplaceOptions) -> Result<(), OperatorError> {
    for (option, value) in [
        ("relative_margin", options.relative_margin),
        ("sliver_angle_rad", options.sliver_angle_rad),
    ] {
        if !(0.0..1.0).contains(&value) {
            return Err(OperatorError::InvalidOption { option, value });
        }
    }
    if options.n_neighbors < MIN_POINTS {
        return Err(OperatorError::TooFewNeighbors {
            n_neighbors: options.n_neighbors,
            min: MIN_POINTS,
        });
    }
    Ok(())
}

/// What the last step needs.
struct Ingredients {
    triangles: Triangles,
    /// For every vertex of the triangles, its first vertex in the input.
    source_vertex: Vec<u32>,
    /// For every vertex of the input, its vertex in the triangles.
    triangle_vertex: Vec<Option<u32>>,
    construction: Construction,
    defects: SurfaceDefects,
    n_triangles: usize,
}

fn mesh_operators(
    mesh: &TriMesh,
    options: &LaplaceOptions,
) -> Result<LaplaceOperators, OperatorError> {
    let clean = clean_mesh(mesh.vertices(), mesh.faces(), options.sliver_angle_rad)?;
    let construction = match options.construction {
        Construction::Auto if clean.defects.is_clean() => Construction::Cotangent,
        Construction::Auto => Construction::Robust,
        chosen => chosen,
    };
    let triangles = match construction {
        Construction::Cotangent => plain_triangles(&clean)?,
        _ => delaunay_triangles(&clean, construction, options.relative_margin)?,
    };
    let fixed = match &options.boundary {
        Boundary::Natural => Vec::new(),
        Boundary::Dirichlet => boundary_vertices(&clean),
        Boundary::Fixed(vertices) => vertices.clone(),
    };
    let mut triangle_vertex = vec![None; mesh.n_vertices()];
    for (new, &old) in clean.source_vertex.iter().enumerate() {
        triangle_vertex[old as usize] = Some(new as u32);
    }
    let ingredients = Ingredients {
        triangles,
        source_vertex: clean.source_vertex,
        triangle_vertex,
        construction,
        n_triangles: clean.source_face.len(),
        defects: clean.defects,
    };
    finish(ingredients, &fixed, options.mass)
}

/// Vertices of the input on edges of one face.
fn boundary_vertices(clean: &CleanMesh) -> Vec<u32> {
    let boundary = edges(&clean.sides).filter(|uses| uses.len() == 1);
    boundary
        .flat_map(|uses| uses[0].edge.map(|v| clean.source_vertex[v as usize]))
        .collect()
}

fn cloud_operators(
    points: &[Point3<f64>],
    options: &LaplaceOptions,
) -> Result<LaplaceOperators, OperatorError> {
    match options.construction {
        Construction::Auto | Construction::Robust => {}
        Construction::Cotangent | Construction::Delaunay => {
            let is_plain = options.construction == Construction::Cotangent;
            let construction = if is_plain { "Cotangent" } else { "Delaunay" };
            return Err(OperatorError::CloudHasNoFaces { construction });
        }
    }
    let fixed: &[u32] = match &options.boundary {
        Boundary::Natural => &[],
        Boundary::Dirichlet => return Err(OperatorError::CloudHasNoBoundary),
        Boundary::Fixed(points) => points,
    };
    let distinct = distinct_points(points)?;
    let local = local_triangles(&distinct.positions, options.n_neighbors)?;
    // The triangles as a mesh, without the points that none of them uses. Copies must stay.
    let mut new_index = vec![None; distinct.positions.len()];
    for &v in local.iter().flatten() {
        new_index[v as usize] = Some(0);
    }
    let mut used = Vec::with_capacity(new_index.len());
    for (old, slot) in new_index.iter_mut().enumerate() {
        if slot.is_some() {
            *slot = Some(used.len() as u32);
            used.push(old);
        }
    }
    let faces: Vec<[u32; 3]> = local
        .iter()
        // Every corner is in use.
        .map(|f| f.map(|v| new_index[v as usize].unwrap_or_default()))
        .collect();
    let positions: Vec<_> = used.iter().map(|&v| distinct.positions[v]).collect();
    let triangles = cloud_triangles(&positions, &faces, options.relative_margin);
    let triangle_vertex = distinct.distinct_of.iter().map(|&d| new_index[d as usize]);
    let triangle_vertex: Vec<Option<u32>> = triangle_vertex.collect();
    let ingredients = Ingredients {
        triangles,
        source_vertex: used.iter().map(|&v| distinct.source[v]).collect(),
        defects: cloud_defects(&distinct.source, &triangle_vertex, &positions, &faces),
        triangle_vertex,
        construction: Construction::Robust,
        n_triangles: faces.len(),
    };
    finish(ingredients, fixed, options.mass)
}

/// What there is to say of a cloud and its local triangles.
fn cloud_defects(
    first_points: &[u32],
    triangle_vertex: &[Option<u32>],
    positions: &[Point3<f64>],
    faces: &[[u32; 3]],
) -> SurfaceDefects {
    let points = || (0_u32..).zip(triangle_vertex);
    let smallest_angle_rad = faces
        .iter()
        .map(|f| TriangleShape::from_corners(f.map(|v| positions[v as usize])))
        .map(|shape| shape.smallest_angle_rad())
        .fold(f64::INFINITY, f64::min);
    SurfaceDefects {
        unreferenced_vertices: points()
            .filter(|(_, vertex)| vertex.is_none())
            .map(|(point, _)| point)
            .collect(),
        coincident_points: points()
            .map(|(point, _)| point)
            .filter(|point| first_points.binary_search(point).is_err())
            .collect(),
        smallest_angle_rad,
        ..SurfaceDefects::default()
    }
}

/// Assembles, takes the fixed vertices out and reports.
fn finish(
    ingredients: Ingredients,
    fixed: &[u32],
    mass_kind: MassKind,
) -> Result<LaplaceOperators, OperatorError> {
    let Ingredients {
        triangles,
        source_vertex,
        triangle_vertex,
        ..
    } = ingredients;
    let n = source_vertex.len();
    let whole = assemble_stiffness(n, &triangles.faces, &triangles.shapes);
    let whole = whole.map(|w| triangles.weight * w);
    let mut whole_mass = lumped_mass(n, &triangles.faces, &triangles.shapes, mass_kind);
    for (mass, &vertex) in whole_mass.iter_mut().zip(&source_vertex) {
        *mass *= triangles.weight;
        if !(*mass > 0.0 && mass.is_finite()) {
            return Err(OperatorError::NotMeasurable {
                vertex,
                mass_mm2: *mass,
            });
        }
    }
    let report = LaplaceReport {
        construction: ingredients.construction,
        area_mm2: whole_mass.iter().sum(),
        mollification_mm: triangles.mollification_mm,
        relative_mollification: triangles.relative_mollification,
        n_flips: triangles.flips.n_flips,
        n_non_delaunay_edges: triangles.flips.n_left,
        n_negative_weights: count_negative_weights(&whole),
        n_triangles: ingredients.n_triangles,
        defects: ingredients.defects,
    };
    let vertex_mass = share_mass(&whole_mass, &triangle_vertex);
    let new_row = free_rows(fixed, n, &triangle_vertex)?;
    let row_of_vertex = triangle_vertex
        .iter()
        .map(|v| v.and_then(|v| new_row[v as usize]));
    let rows = VertexRows::new(free_of(&source_vertex, &new_row), row_of_vertex.collect());
    if rows.n_rows() == n {
        return Ok(LaplaceOperators {
            stiffness: whole,
            mass: whole_mass,
            rows,
            vertex_mass,
            report,
        });
    }
    Ok(LaplaceOperators {
        stiffness: restrict(&whole, &new_row),
        mass: free_of(&whole_mass, &new_row),
        rows,
        vertex_mass,
        report,
    })
}

/// For every vertex of the triangles its row, `None` for a fixed one.
fn free_rows(
    fixed: &[u32],
    n: usize,
    triangle_vertex: &[Option<u32>],
) -> Result<Vec<Option<u32>>, OperatorError> {
    let n_vertices = triangle_vertex.len();
    let mut new_row = vec![Some(0); n];
    for &vertex in fixed {
        match triangle_vertex.get(vertex as usize) {
            Some(Some(v)) => new_row[*v as usize] = None,
            Some(None) => {}
            None => return Err(OperatorError::VertexOutOfRange { vertex, n_vertices }),
        }
    }
    for (row, slot) in new_row.iter_mut().flatten().enumerate() {
        *slot = row as u32;
    }
    if new_row.iter().all(Option::is_none) {
        return Err(OperatorError::NoFreeVertex { n_vertices });
    }
    Ok(new_row)
}

/// The values of the free vertices.
fn free_of<T: Copy>(values: &[T], new_row: &[Option<u32>]) -> Vec<T> {
    let pairs = values.iter().zip(new_row);
    pairs
        .filter_map(|(&value, row)| row.map(|_| value))
        .collect()
}

/// The mass of every vertex of the input; those that share a vertex of the triangles get equal parts.
fn share_mass(mass: &[f64], triangle_vertex: &[Option<u32>]) -> Vec<f64> {
    let mut n_sharing = vec![0.0; mass.len()];
    for &v in triangle_vertex.iter().flatten() {
        n_sharing[v as usize] += 1.0;
    }
    let vertices = triangle_vertex.iter();
    let share = |v: u32| mass[v as usize] / n_sharing[v as usize];
    vertices.map(|v| v.map_or(0.0, share)).collect()
}

/// Edges whose weight is clearly negative beside the others at its two vertices.
fn count_negative_weights(stiffness: &CsMat<f64>) -> usize {
    let diagonal: Vec<f64> = stiffness.diag().iter().map(|(_, &w)| w).collect();
    stiffness
        .iter()
        .filter(|&(&w, (i, j))| j > i && w > NEGATIVE_WEIGHT * diagonal[i].min(diagonal[j]))
        .count()
}
