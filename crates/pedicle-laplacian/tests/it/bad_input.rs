//! What is refused, and how it is named.

use nalgebra::Point3;
use pedicle_laplacian::{
    Mollification, OperatorError, OperatorOptions, Operators, cotangent_operators,
};
use pedicle_mesh::TriMesh;

use crate::shapes::{rectangle, scaled};

fn default_operators(mesh: &TriMesh) -> Result<Operators, OperatorError> {
    cotangent_operators(mesh, &OperatorOptions::default())
}

/// A grid with one vertex in the middle of an edge, so that one face is flat.
fn with_flat_face() -> TriMesh {
    let grid = rectangle(2.0, 2.0, 2, 2);
    let mut vertices = grid.vertices().to_vec();
    vertices.push(Point3::new(0.5, 0.0, 0.0));
    let mut faces = grid.faces().to_vec();
    faces.push([0, 9, 1]);
    TriMesh::new(vertices, faces).unwrap()
}

#[test]
fn flat_face_is_named_at_every_scale() {
    for scale in [1e-3, 1.0, 1e3] {
        let error = default_operators(&scaled(&with_flat_face(), scale)).unwrap_err();
        let OperatorError::DegenerateFace {
            face,
            longest_edge_mm,
            ..
        } = error
        else {
            panic!("wrong error: {error}");
        };
        assert_eq!(face, 8, "face at scale {scale}");
        assert!((longest_edge_mm - scale).abs() < 1e-12 * scale, "edge");
    }
}

#[test]
fn flat_face_is_mollified_alike_at_every_scale() {
    let options = OperatorOptions {
        mollification: Mollification::intrinsic(),
        ..OperatorOptions::default()
    };
    let reference = cotangent_operators(&with_flat_face(), &options).unwrap();
    assert!(
        reference.report.mollification_mm > 0.0,
        "something was added"
    );
    assert!(
        reference.report.relative_mollification < 1.1e-5,
        "added {}",
        reference.report.relative_mollification
    );
    for scale in [1e-3, 1e3] {
        let mesh = scaled(&with_flat_face(), scale);
        let operators = cotangent_operators(&mesh, &options).unwrap();
        for (a, b) in operators
            .stiffness
            .data()
            .iter()
            .zip(reference.stiffness.data())
        {
            assert!((a - b).abs() < 1e-8 * b.abs().max(1.0), "{a} against {b}");
        }
    }
}

#[test]
fn repeated_vertex_is_named() {
    let grid = rectangle(1.0, 1.0, 2, 2);
    let mut faces = grid.faces().to_vec();
    faces.push([3, 4, 3]);
    let mesh = TriMesh::new(grid.vertices().to_vec(), faces).unwrap();
    let error = default_operators(&mesh).unwrap_err();
    assert_eq!(error, OperatorError::RepeatedVertex { face: 8, vertex: 3 });
}

#[test]
fn unreferenced_vertex_is_named() {
    let grid = rectangle(1.0, 1.0, 2, 2);
    let mut vertices = grid.vertices().to_vec();
    vertices.push(Point3::new(9.0, 9.0, 9.0));
    let mesh = TriMesh::new(vertices, grid.faces().to_vec()).unwrap();
    let options = OperatorOptions {
        mollification: Mollification::intrinsic(),
        ..OperatorOptions::default()
    };
    for options in [OperatorOptions::default(), options] {
        let error = cotangent_operators(&mesh, &options).unwrap_err();
        assert_eq!(error, OperatorError::UnreferencedVertex { vertex: 9 });
        assert!(error.to_string().contains("repair"), "says what to do");
    }
}

#[test]
fn coordinates_too_large_to_square_are_refused() {
    let error = default_operators(&scaled(&rectangle(1.0, 1.0, 1, 1), 1e200)).unwrap_err();
    assert!(
        matches!(error, OperatorError::DegenerateFace { face: 0, .. }),
        "{error}"
    );
}

#[test]
fn options_out_of_range_are_refused() {
    for value in [-1.0, 1.0, f64::NAN] {
        let options = OperatorOptions {
            min_height_over_length: value,
            ..OperatorOptions::default()
        };
        let error = cotangent_operators(&rectangle(1.0, 1.0, 1, 1), &options).unwrap_err();
        let OperatorError::InvalidOption { option, .. } = error else {
            panic!("wrong error: {error}");
        };
        assert_eq!(option, "min_height_over_length", "name of the option");
    }
}
