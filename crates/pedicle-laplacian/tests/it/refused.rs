//! What the one entry point refuses, and how it is named.

use nalgebra::Point3;
use pedicle_laplacian::{
    Boundary, Construction, LaplaceOptions, OperatorError, Surface, laplace_operators,
};
use pedicle_mesh::TriMesh;

use crate::shapes::{rectangle, scaled, sphere_points};

fn by(construction: Construction) -> LaplaceOptions {
    LaplaceOptions {
        construction,
        ..LaplaceOptions::default()
    }
}

fn refusal(surface: Surface<'_>, options: &LaplaceOptions) -> OperatorError {
    laplace_operators(surface, options).unwrap_err()
}

fn mesh(corners: &[[f64; 3]], faces: &[[u32; 3]]) -> TriMesh {
    let vertices = corners.iter().copied().map(Point3::from).collect();
    TriMesh::new(vertices, faces.to_vec()).unwrap()
}

#[test]
fn face_without_area_is_named_in_the_input() {
    // Two faces are left out before the flat one.
    let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0.5, 0., 0.]];
    let flat = mesh(&corners, &[[0, 1, 2], [1, 0, 2], [1, 1, 2], [0, 1, 3]]);
    let error = refusal(Surface::Mesh(&flat), &by(Construction::Cotangent));
    assert!(
        matches!(error, OperatorError::DegenerateFace { face: 3, .. }),
        "{error}"
    );
    assert!(laplace_operators(Surface::Mesh(&flat), &LaplaceOptions::default()).is_ok());
}

#[test]
fn surface_without_area() {
    let line = mesh(
        &[[0., 0., 0.], [1., 0., 0.], [3., 0., 0.]],
        &[[0, 1, 2], [0, 0, 1]],
    );
    for construction in [
        Construction::Auto,
        Construction::Cotangent,
        Construction::Robust,
    ] {
        let error = refusal(Surface::Mesh(&line), &by(construction));
        assert_eq!(error, OperatorError::NoArea { n_faces: 2 });
    }
}

#[test]
fn one_sheet_needs_one_sheet() {
    let corners = [
        [9., 9., 9.],
        [0., 0., 0.],
        [0., 0., 1.],
        [1., 0., 0.],
        [-1., 1., 0.],
        [0., -1., 0.],
    ];
    let book = mesh(&corners, &[[1, 2, 3], [1, 2, 4], [1, 2, 5]]);
    let error = refusal(Surface::Mesh(&book), &by(Construction::Delaunay));
    assert_eq!(
        error,
        OperatorError::NonManifoldEdge {
            edge: [1, 2],
            n_faces: 3
        }
    );
    // Five triangles in a strip, closed with a twist.
    let corners: Vec<[f64; 3]> = (0..5)
        .map(|i| {
            let (s, c) = (f64::from(i) * 1.2566).sin_cos();
            [c, s, f64::from(i * i % 3)]
        })
        .collect();
    let strip = mesh(
        &corners,
        &[[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 0], [4, 0, 1]],
    );
    let error = refusal(Surface::Mesh(&strip), &by(Construction::Delaunay));
    assert!(
        matches!(error, OperatorError::NotOrientable { .. }),
        "{error}"
    );
    assert!(laplace_operators(Surface::Mesh(&strip), &by(Construction::Robust)).is_ok());
}

#[test]
fn too_large_and_too_small() {
    for construction in [Construction::Auto, Construction::Robust] {
        let huge = scaled(&rectangle(1.0, 1.0, 1, 1), 1e200);
        let error = refusal(Surface::Mesh(&huge), &by(construction));
        assert!(
            matches!(error, OperatorError::DegenerateFace { face: 0, .. }),
            "{error}"
        );
        let tiny = scaled(&rectangle(1.0, 1.0, 1, 1), 1e-200);
        let error = refusal(Surface::Mesh(&tiny), &by(construction));
        assert!(
            matches!(error, OperatorError::NoArea { n_faces: 2 }),
            "{error}"
        );
    }
    for scale in [1e-170, 1e170] {
        let points: Vec<_> = sphere_points(50).iter().map(|p| p * scale).collect();
        let error = refusal(Surface::Cloud(&points), &LaplaceOptions::default());
        assert!(matches!(error, OperatorError::Extent { .. }), "{error}");
    }
}

#[test]
fn clouds_that_are_no_surface() {
    let refused =
        |points: &[Point3<f64>]| refusal(Surface::from(points), &LaplaceOptions::default());
    let mut points = sphere_points(50);
    let at = |n: usize| OperatorError::TooFewPoints {
        n_points: n,
        min: 3,
    };
    assert_eq!(refused(&[]), at(0));
    assert_eq!(refused(&[points[0]; 9]), at(1), "nine times one point");
    let line: Vec<_> = (0..40)
        .map(|i| Point3::new(f64::from(i * i), 0.0, 0.0))
        .collect();
    assert_eq!(refused(&line), OperatorError::NoTriangles { n_points: 40 });
    points[7].y = f64::NAN;
    let error = refused(&points);
    assert!(
        matches!(error, OperatorError::NonFinitePoint { point: 7, .. }),
        "{error}"
    );
}

#[test]
fn clouds_have_no_faces_and_no_boundary() {
    let points = sphere_points(50);
    for (construction, name) in [
        (Construction::Cotangent, "Cotangent"),
        (Construction::Delaunay, "Delaunay"),
    ] {
        let error = refusal(Surface::Cloud(&points), &by(construction));
        assert_eq!(error, OperatorError::CloudHasNoFaces { construction: name });
    }
    let options = LaplaceOptions {
        boundary: Boundary::Dirichlet,
        ..LaplaceOptions::default()
    };
    assert_eq!(
        refusal(Surface::Cloud(&points), &options),
        OperatorError::CloudHasNoBoundary
    );
}

#[test]
fn options_out_of_range() {
    let mesh = rectangle(1.0, 1.0, 2, 2);
    let surface = Surface::Mesh(&mesh);
    let n_neighbors = LaplaceOptions {
        n_neighbors: 2,
        ..LaplaceOptions::default()
    };
    let error = refusal(surface, &n_neighbors);
    assert_eq!(
        error,
        OperatorError::TooFewNeighbors {
            n_neighbors: 2,
            min: 3
        }
    );
    for value in [-1e-3, 1.0, f64::NAN] {
        let margin = LaplaceOptions {
            relative_margin: value,
            ..LaplaceOptions::default()
        };
        let angle = LaplaceOptions {
            sliver_angle_rad: value,
            ..LaplaceOptions::default()
        };
        for options in [margin, angle] {
            let error = refusal(surface, &options);
            assert!(
                matches!(error, OperatorError::InvalidOption { .. }),
                "{error}"
            );
        }
    }
    let fixed = |vertices| LaplaceOptions {
        boundary: Boundary::Fixed(vertices),
        ..LaplaceOptions::default()
    };
    let error = refusal(surface, &fixed(vec![3, 9]));
    assert_eq!(
        error,
        OperatorError::VertexOutOfRange {
            vertex: 9,
            n_vertices: 9
        }
    );
    let error = refusal(surface, &fixed((0..9).collect()));
    assert_eq!(error, OperatorError::NoFreeVertex { n_vertices: 9 });
}
