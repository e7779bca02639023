//! Simplification of known shapes and of real spines.

use pedicle_mesh::{
    FaceShare, MeshError, SimplifyOptions, Spacing, SurfaceIndex, TriMesh, concatenate,
    connected_components, defects, genus, simplify, volume,
};

use crate::shapes::{cube, grid, icosphere, scaled, spine, torus};

/// Checks what must hold for every result: vertices of the input, no more components, no pinch.
fn check(before: &TriMesh, target: usize, after: &pedicle_mesh::Simplified) {
    assert_eq!(
        after.n_faces,
        after.mesh.n_faces(),
        "the count is that of the mesh"
    );
    assert_eq!(after.n_faces_before, before.n_faces(), "the count before");
    assert_eq!(after.target_faces, target, "the target");
    assert!(after.source_vertex.is_sorted(), "vertices keep their order");
    for (v, &source) in after.source_vertex.iter().enumerate() {
        let original = before.vertices()[source as usize];
        assert_eq!(
            after.mesh.vertices()[v],
            original,
            "vertices are original ones"
        );
    }
    assert_eq!(
        connected_components(&after.mesh).n_components,
        connected_components(before).n_components,
        "no component is lost or split"
    );
    assert_eq!(after.n_pinched_components, 0, "nothing is pinched");
}

#[test]
fn a_sphere_and_a_torus_keep_their_shape_at_any_scale() {
    for factor in [1e-3, 1.0, 1e3] {
        for (mesh, target) in [(icosphere(5), 800), (torus(120, 60), 900)] {
            let mesh = scaled(&mesh, factor);
            let simplified = simplify(&mesh, target, &SimplifyOptions::default()).unwrap();
            check(&mesh, target, &simplified);
            let n = simplified.n_faces as f64;
            assert!(
                (n / target as f64 - 1.0).abs() < 0.02,
                "{n} of {target} faces"
            );
            assert_eq!(genus(&simplified.mesh), genus(&mesh), "handles stay");
            let degrees = simplified.smallest_angle_rad.to_degrees();
            assert!(degrees > 8.0, "smallest angle {degrees}°");
            let lost = 1.0 - volume(&simplified.mesh) / volume(&mesh);
            assert!(lost.abs() < 0.06, "{lost} of the volume is lost");
        }
    }
}

#[test]
fn faces_are_dealt_out_by_area_or_by_number() {
    let small = icosphere(4);
    let large = scaled(&icosphere(4), 3.0);
    let both = concatenate(&[&small, &large]).unwrap();
    let n_of_small = |share| {
        let options = SimplifyOptions {
            share,
            ..SimplifyOptions::default()
        };
        let simplified = simplify(&both, 1000, &options).unwrap();
        check(&both, 1000, &simplified);
        let of_face = connected_components(&simplified.mesh).of_face;
        of_face.iter().filter(|&&component| component == 0).count() as f64
    };
    assert!(
        (n_of_small(FaceShare::Area) - 100.0).abs() < 4.0,
        "a tenth of the area"
    );
    assert!(
        (n_of_small(FaceShare::FaceCount) - 500.0).abs() < 10.0,
        "half of the faces"
    );
}

#[test]
fn small_components_keep_a_minimum_and_the_result_says_so() {
    let crumbs: Vec<TriMesh> = (0..10)
        .map(|i| scaled(&icosphere(2), 1.0 + 0.01 * i as f64))
        .collect();
    let mesh = concatenate(&crumbs.iter().collect::<Vec<_>>()).unwrap();
    let simplified = simplify(&mesh, 100, &SimplifyOptions::default()).unwrap();
    check(&mesh, 100, &simplified);
    assert!(
        simplified.n_faces >= 240,
        "24 faces each: {}",
        simplified.n_faces
    );
    let tiny = concatenate(&[&cube(), &scaled(&icosphere(4), 10.0)]).unwrap();
    let simplified = simplify(&tiny, 300, &SimplifyOptions::default()).unwrap();
    let of_face = connected_components(&simplified.mesh).of_face;
    let n_of_cube = of_face.iter().filter(|&&component| component == 0).count();
    assert_eq!(
        n_of_cube, 12,
        "the cube has less than the minimum and stays"
    );
}

#[test]
fn a_mesh_that_is_small_enough_comes_back_without_its_litter() {
    let cube = cube();
    let simplified = simplify(&cube, 12, &SimplifyOptions::default()).unwrap();
    assert_eq!(simplified.mesh, cube, "nothing to do");
    let mut vertices = cube.vertices().to_vec();
    vertices.insert(0, nalgebra::Point3::new(9.0, 9.0, 9.0));
    let mut faces: Vec<[u32; 3]> = cube.faces().iter().map(|f| f.map(|v| v + 1)).collect();
    faces.push([3, 3, 4]);
    let littered = TriMesh::new(vertices, faces).unwrap();
    let simplified = simplify(&littered, 100, &SimplifyOptions::default()).unwrap();
    assert_eq!(simplified.mesh, cube, "the litter is gone");
    assert_eq!(
        simplified.source_vertex,
        [1, 2, 3, 4, 5, 6, 7, 8],
        "one vertex is left out"
    );
}

#[test]
fn an_open_grid_keeps_its_outline() {
    let grid = grid(40);
    let simplified = simplify(&grid, 200, &SimplifyOptions::default()).unwrap();
    check(&grid, 200, &simplified);
    let area = simplified.mesh.area();
    assert!((area / 1600.0 - 1.0).abs() < 0.03, "area {area}");
    assert!(simplified.n_faces <= 204, "{} faces", simplified.n_faces);
}

#[test]
fn an_error_limit_stops_before_the_target() {
    let mesh = icosphere(4);
    let options = SimplifyOptions {
        max_error_mm: Some(1e-3),
        ..SimplifyOptions::default()
    };
    let simplified = simplify(&mesh, 100, &options).unwrap();
    assert!(
        simplified.n_faces > 300,
        "{} faces are left",
        simplified.n_faces
    );
    assert!(
        simplified.estimated_error_mm <= 1e-3,
        "{}",
        simplified.estimated_error_mm
    );
}

#[test]
fn impossible_targets_are_refused() {
    let refused = simplify(&cube(), 3, &SimplifyOptions::default()).unwrap_err();
    let expected = MeshError::TargetTooSmall {
        target_faces: 3,
        min: 4,
    };
    assert_eq!(refused, expected, "3 faces make no surface");
    let folded = TriMesh::new(cube().vertices().to_vec(), vec![[0, 0, 1]]).unwrap();
    let refused = simplify(&folded, 10, &SimplifyOptions::default()).unwrap_err();
    assert_eq!(
        refused,
        MeshError::NothingLeft { n_faces: 1 },
        "no proper face"
    );
}

#[test]
fn real_spines_keep_topology_and_shape() {
    let cases = [
        ("vhp-male-remus", Spacing::Even, 2.5),
        ("vhp-male-remus", Spacing::Adaptive, 1.8),
        ("verse010", Spacing::Even, 4.0),
        ("verse010", Spacing::Adaptive, 3.0),
    ];
    for (subject, spacing, max_error_mm) in cases {
        let options = SimplifyOptions {
            spacing,
            ..SimplifyOptions::default()
        };
        let Some(vertebrae) = spine(subject) else {
            return;
        };
        let before = concatenate(&vertebrae.iter().collect::<Vec<_>>()).unwrap();
        let simplified = simplify(&before, 3500, &options).unwrap();
        let found = defects(&simplified.mesh);
        let index = SurfaceIndex::new(&simplified.mesh).unwrap();
        let distances: Vec<f64> = before
            .vertices()
            .iter()
            .map(|p| index.closest_point(p).distance_mm)
            .collect();
        let largest = distances.iter().copied().fold(0.0, f64::max);
        check(&before, 3500, &simplified);
        assert!(
            (3430..=3570).contains(&simplified.n_faces),
            "{} faces",
            simplified.n_faces
        );
        assert!(found.is_closed_oriented_manifold(), "{found:?}");
        assert!(found.smallest_angle_rad.to_degrees() > 3.0, "{found:?}");
        assert_eq!(genus(&simplified.mesh), genus(&before), "handles stay");
        assert!(largest < max_error_mm, "{largest} mm off");
    }
}

#[test]
fn the_same_input_gives_the_same_mesh() {
    let mesh = torus(100, 40);
    let first = simplify(&mesh, 700, &SimplifyOptions::default()).unwrap();
    let second = simplify(&mesh, 700, &SimplifyOptions::default()).unwrap();
    assert_eq!(first, second, "nothing depends on chance");
}
