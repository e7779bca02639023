//! Measures of point maps on maps whose values are known.

use nalgebra::Point3;
use pedicle_fmap::{
    PointMap, PointMapPair, bijectivity_error, continuity, coverage, mean_error_mm,
    mean_error_over_sqrt_area, vertex_coverage,
};
use pedicle_mesh::TriMesh;

/// Two unit right triangles that make a unit square.
fn square(scale: f64) -> TriMesh {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let vertices = corners
        .iter()
        .map(|c| Point3::new(c[0] * scale, c[1] * scale, 0.0))
        .collect();
    TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
}

fn map(images: &[u32]) -> PointMap {
    PointMap::new(images.to_vec(), 4).unwrap()
}

#[test]
fn the_identity_is_perfect() {
    let mesh = square(1.0);
    let identity = PointMap::identity(4).unwrap();
    let both = PointMapPair {
        target_to_source: identity.clone(),
        source_to_target: identity.clone(),
    };
    assert!(vertex_coverage(&identity) >= 1.0);
    assert!(bijectivity_error(&mesh, &both).unwrap() <= 0.0);
    let edges = continuity(&mesh, &mesh, &identity).unwrap();
    assert!((edges.mean_stretch - 1.0).abs() < 1e-15 && edges.torn_share <= 0.0);
    assert!(mean_error_mm(&mesh, &mesh, &identity, &identity).unwrap() <= 0.0);
}

#[test]
fn shares_and_distances_are_weighted_by_area() {
    // Areas of the vertices: 1/3, 1/6, 1/3, 1/6.
    let mesh = square(1.0);
    let areas = [1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0, 1.0 / 6.0];
    let squashed = map(&[0, 1, 1, 1]);
    assert!((vertex_coverage(&squashed) - 0.5).abs() < 1e-15);
    assert!((coverage(&squashed, &areas).unwrap() - 0.5).abs() < 1e-15);
    assert!((coverage(&map(&[0, 0, 2, 2]), &areas).unwrap() - 2.0 / 3.0).abs() < 1e-15);
    let identity = PointMap::identity(4).unwrap();
    // Vertex 2 is 1 away, vertex 3 is √2 away.
    let expected = 1.0 / 3.0 + 2.0_f64.sqrt() / 6.0;
    for scale in [1e-3, 1.0, 1e3] {
        let mesh = square(scale);
        let found = mean_error_mm(&mesh, &mesh, &squashed, &identity).unwrap();
        assert!((found / scale - expected).abs() < 1e-12);
        let found = mean_error_over_sqrt_area(&mesh, &mesh, &squashed, &identity).unwrap();
        assert!((found - expected).abs() < 1e-12);
        let both = PointMapPair {
            target_to_source: identity.clone(),
            source_to_target: squashed.clone(),
        };
        assert!((bijectivity_error(&mesh, &both).unwrap() - expected).abs() < 1e-12);
    }
    // Edges 12, 23, 13 do not exist or collapse: 01 keeps, 02 → 1/√2, 03 keeps, 12 and 23 → 0.
    let edges = continuity(&mesh, &mesh, &squashed).unwrap();
    let expected = (1.0 + 1.0 / 2.0_f64.sqrt() + 1.0) / 5.0;
    assert!((edges.mean_stretch - expected).abs() < 1e-12);
}

#[test]
fn maps_of_other_meshes_are_refused() {
    let mesh = square(1.0);
    let identity = PointMap::identity(4).unwrap();
    let longer = PointMap::new(vec![0; 5], 4).unwrap();
    assert!(continuity(&mesh, &mesh, &longer).is_err());
    assert!(mean_error_mm(&mesh, &mesh, &longer, &identity).is_err());
    assert!(coverage(&identity, &[1.0; 3]).is_err());
    let broken = PointMapPair {
        target_to_source: identity.clone(),
        source_to_target: PointMap {
            source_of_target: vec![9; 4],
            n_source_vertices: 4,
        },
    };
    assert!(bijectivity_error(&mesh, &broken).is_err());
}
