//! Every wrong query is refused by name.

use nalgebra::Point3;
use pedicle_geodesic::{EdgeGraph, GeodesicError, HeatGeodesics, HeatOptions, Links};
use pedicle_mesh::TriMesh;

use crate::shapes::{sphere, square};

#[test]
fn vertices_that_do_not_exist_are_refused() {
    let mesh = sphere(1);
    let n = mesh.n_vertices() as u32;
    let graph = EdgeGraph::new(&mesh, Links::Edges);
    let heat = HeatGeodesics::new(&mesh, &HeatOptions::default()).unwrap();
    let missing = Err(GeodesicError::VertexOutOfRange {
        vertex: n,
        n_vertices: n as usize,
    });
    assert_eq!(graph.distances_from(&[0, n]), missing);
    assert_eq!(heat.distances_from(&[0, n]), missing);
    assert_eq!(graph.distances_between(&[(0, n)]), missing);
    assert_eq!(heat.distances_between(&[(n, 0)]), missing);
    assert!(graph.ball(n, 1.0).is_err() && graph.ball(0, f64::NAN).is_err());
    assert!(graph.ball(0, -1.0).is_err());
    assert_eq!(graph.distances_from(&[]), Err(GeodesicError::NoSource));
    assert_eq!(heat.distances_from(&[]), Err(GeodesicError::NoSource));
    assert_eq!(graph.distances_between(&[]), Ok(vec![]));
    assert_eq!(heat.distances_between(&[]), Ok(vec![]));
}

#[test]
fn operators_of_another_mesh_and_bad_times_are_refused() {
    let mesh = sphere(1);
    let small = sprs::CsMat::eye(3);
    let refused = HeatGeodesics::with_operators(&mesh, &small, &[1.0; 3], &HeatOptions::default());
    assert!(matches!(
        refused,
        Err(GeodesicError::SizeMismatch { found: 3, .. })
    ));
    for time_factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = HeatGeodesics::new(&mesh, &HeatOptions { time_factor });
        assert!(matches!(refused, Err(GeodesicError::InvalidValue { .. })));
    }
}

#[test]
fn degenerate_meshes_give_distances_or_errors_but_no_nonsense() {
    // A vertex no face uses: no path leads to it, and there is no Laplacian.
    let flat = square(4, 0.0);
    let mut vertices = flat.vertices().to_vec();
    vertices.push(Point3::new(5.0, 5.0, 5.0));
    let loose = TriMesh::new(vertices, flat.faces().to_vec()).unwrap();
    let graph = EdgeGraph::new(&loose, Links::default());
    assert!(graph.distances_from(&[0]).unwrap()[25].is_infinite());
    assert!(HeatGeodesics::new(&loose, &HeatOptions::default()).is_err());

    // A face without area: three corners on a line.
    let mut faces = flat.faces().to_vec();
    faces.push([0, 1, 2]);
    let thin = TriMesh::new(flat.vertices().to_vec(), faces).unwrap();
    for distances in [
        EdgeGraph::new(&thin, Links::default())
            .distances_from(&[0])
            .unwrap(),
        HeatGeodesics::new(&thin, &HeatOptions::default())
            .unwrap()
            .distances_from(&[0])
            .unwrap(),
    ] {
        assert!(distances.iter().all(|d| d.is_finite() && *d >= 0.0));
        assert!((distances[24] - 2.0_f64.sqrt()).abs() < 0.3);
    }
}
