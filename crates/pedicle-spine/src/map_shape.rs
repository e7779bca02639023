//! A surface as the functional map sees it: simplified, with its Laplace basis.

use pedicle_laplacian::{OperatorOptions, cotangent_operators};
use pedicle_mesh::{
    RepairOptions, RepairReport, SimplifyOptions, Spacing, TriMesh, repair, simplify,
};
use pedicle_spectral::{EigenOptions, LaplaceBasis, laplace_basis};

use crate::{MapOptions, Shape, SpineError};

/// Vertices needed per eigenfunction: beyond half of the spectrum the discrete eigenfunctions
/// have nothing to do with the smooth ones any more.
const VERTICES_PER_FUNCTION: usize = 2;
/// Loose pieces with a smaller share of the area are left out of the map (not of the
/// registration): each would cost one dimension of the null space.
const MIN_PIECE_AREA_SHARE: f64 = 0.004;

/// A simplified surface whose vertices remember the vertices they were.
#[derive(Debug)]
pub(crate) struct MapMesh {
    pub(crate) mesh: TriMesh,
    pub(crate) original_vertex: Vec<u32>,
}

/// A simplified surface with its basis.
#[derive(Debug)]
pub(crate) struct MapShape {
    pub(crate) mesh: TriMesh,
    pub(crate) basis: LaplaceBasis,
}

/// Removes what no operator can live with: degenerate and doubled faces, unreferenced vertices.
pub(crate) fn clean(mesh: &TriMesh, shape: Shape) -> Result<(TriMesh, RepairReport), SpineError> {
    repair(mesh, &RepairOptions::default()).map_err(|error| SpineError::Mesh { shape, error })
}

/// A surface simplified for the map, or as it is if it is small already.
pub(crate) fn simplified(
    mesh: &TriMesh,
    options: &MapOptions,
    shape: Shape,
) -> Result<MapMesh, SpineError> {
    // A surface only just above the number of faces gains nothing from losing a few.
    if mesh.n_faces() <= options.n_faces + options.n_faces / 10 {
        let original_vertex = (0..mesh.n_vertices() as u32).collect();
        return Ok(MapMesh {
            mesh: mesh.clone(),
            original_vertex,
        });
    }
    let simplification = SimplifyOptions {
        spacing: Spacing::Adaptive,
        ..SimplifyOptions::default()
    };
    let simple = simplify(mesh, options.n_faces, &simplification)
        .map_err(|error| SpineError::Mesh { shape, error })?;
    Ok(MapMesh {
        mesh: simple.mesh,
        original_vertex: simple.source_vertex,
    })
}

/// The part of a simplified surface made of the given faces.
pub(crate) fn restrict(whole: &MapMesh, faces: &[u32]) -> Result<MapMesh, SpineError> {
    let part = whole
        .mesh
        .submesh_of_faces(faces)
        .map_err(|error| SpineError::Mesh {
            shape: Shape::Source,
            error,
        })?;
    let original_vertex = part
        .source_vertex
        .iter()
        .map(|&v| whole.original_vertex[v as usize])
        .collect();
    Ok(MapMesh {
        mesh: part.mesh,
        original_vertex,
    })
}

/// A surface without its smallest loose pieces.
pub(crate) fn without_crumbs(whole: MapMesh, shape: Shape) -> Result<MapMesh, SpineError> {
    let components = pedicle_mesh::connected_components(&whole.mesh);
    let mut area = vec![0.0; components.n_components];
    for (f, &c) in components.of_face.iter().enumerate() {
        area[c as usize] += whole.mesh.face_area(f);
    }
    let least = MIN_PIECE_AREA_SHARE * area.iter().sum::<f64>();
    let kept: Vec<u32> = (0..whole.mesh.n_faces() as u32)
        .filter(|&f| area[components.of_face[f as usize] as usize] >= least)
        .collect();
    if kept.len() == whole.mesh.n_faces() {
        return Ok(whole);
    }
    restrict(&whole, &kept).map_err(|error| match error {
        SpineError::Mesh { error, .. } => SpineError::Mesh { shape, error },
        other => other,
    })
}

impl MapShape {
    /// Operators and eigenfunctions of a surface.
    pub(crate) fn new(
        mesh: TriMesh,
        options: &MapOptions,
        shape: Shape,
    ) -> Result<Self, SpineError> {
        let needed = VERTICES_PER_FUNCTION * options.n_functions;
        if mesh.n_vertices() < needed {
            return Err(SpineError::TooFewVertices {
                shape,
                n_vertices: mesh.n_vertices(),
                n_functions: options.n_functions,
                needed,
            });
        }
        let operators = cotangent_operators(&mesh, &OperatorOptions::default())
            .map_err(|error| SpineError::Operators { shape, error })?;
        let basis = laplace_basis(
            &operators.stiffness,
            &operators.mass,
            options.n_functions,
            &EigenOptions::default(),
        )
        .map_err(|error| SpineError::Spectrum { shape, error })?;
        Ok(Self { mesh, basis })
    }
}
