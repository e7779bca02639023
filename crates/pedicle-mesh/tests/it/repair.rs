//! Defects are found, and repair removes each kind without opening holes.

use nalgebra::Point3;
use pedicle_mesh::{
    MeshError, RepairOptions, RepairReport, TriMesh, concatenate, defects, genus,
    is_closed_manifold, repair, volume,
};
use proptest::prelude::*;

use crate::shapes::{cube, grid, icosphere, scaled, spine, torus};

fn repaired(mesh: &TriMesh) -> (TriMesh, RepairReport) {
    let (after, report) =
        repair(mesh, &RepairOptions::default()).expect("something is left of the mesh");
    assert!(defects(&after).is_repaired(), "{:?}", defects(&after));
    for (v, &source) in report.source_vertex.iter().enumerate() {
        let original = mesh.vertices()[source as usize];
        assert_eq!(after.vertices()[v], original, "vertices do not move");
    }
    assert_eq!(
        report.n_removed_vertices,
        mesh.n_vertices() - after.n_vertices(),
        "the vertices are accounted for"
    );
    (after, report)
}

#[test]
fn a_clean_mesh_is_left_alone() {
    for factor in [1e-6, 1.0, 1e6] {
        for mesh in [cube(), icosphere(3), torus(20, 10), grid(5)] {
            let mesh = scaled(&mesh, factor);
            let (after, report) = repaired(&mesh);
            assert_eq!(after, mesh, "unchanged at scale {factor}");
            assert!(!report.changed(), "{report:?}");
        }
    }
}

#[test]
fn litter_is_listed_and_removed() {
    let cube = cube();
    let mut vertices = cube.vertices().to_vec();
    vertices.insert(3, Point3::new(7.0, 7.0, 7.0));
    let shift = |v: u32| if v >= 3 { v + 1 } else { v };
    let mut faces: Vec<[u32; 3]> = cube.faces().iter().map(|f| f.map(shift)).collect();
    let doubled = [faces[2][1], faces[2][2], faces[2][0]];
    faces.push(doubled);
    faces.insert(0, [5, 5, 6]);
    let mesh = TriMesh::new(vertices, faces).unwrap();
    let found = defects(&mesh);
    assert_eq!(found.unreferenced_vertices, [3], "{found:?}");
    assert_eq!(found.repeated_index_faces, [0], "{found:?}");
    assert_eq!(found.duplicate_faces, [13], "{found:?}");
    assert_eq!(found.non_manifold_edges.len(), 3, "{found:?}");
    assert!(!found.is_repaired(), "{found:?}");
    let (after, report) = repaired(&mesh);
    assert_eq!(after, cube, "the cube is left");
    assert_eq!(report.n_duplicate_faces, 1, "{report:?}");
    assert_eq!(report.n_repeated_index_faces, 1, "{report:?}");
    assert_eq!(report.n_removed_vertices, 1, "{report:?}");
    assert_eq!(report.source_vertex, [0, 1, 2, 4, 5, 6, 7, 8], "{report:?}");
}

#[test]
fn a_flap_of_two_opposite_faces_goes_but_a_two_sided_sheet_stays() {
    let sphere = icosphere(2);
    let [a, b, _] = sphere.faces()[0];
    let mut vertices = sphere.vertices().to_vec();
    vertices.push(Point3::new(2.0, 2.0, 2.0));
    let apex = sphere.n_vertices() as u32;
    let mut faces = sphere.faces().to_vec();
    faces.extend([[a, b, apex], [b, a, apex]]);
    let (after, report) = repaired(&TriMesh::new(vertices, faces).unwrap());
    assert_eq!(after, sphere, "the flap is gone");
    assert_eq!(report.n_duplicate_faces, 2, "{report:?}");
    let grid = grid(3);
    let mut faces = grid.faces().to_vec();
    faces.extend(grid.faces().iter().map(|&[a, b, c]| [a, c, b]));
    let (after, report) = repaired(&TriMesh::new(grid.vertices().to_vec(), faces).unwrap());
    assert_eq!(after, grid, "one side is left");
    assert_eq!(report.n_duplicate_faces, grid.n_faces(), "{report:?}");
}

/// A cube with a vertex put on the diagonal of its bottom, exactly or at a hair's breadth, and
/// connected so that the face on one side of the diagonal is a cap.
fn cube_with_cap(height: f64) -> TriMesh {
    let cube = cube();
    let mut vertices = cube.vertices().to_vec();
    // Bottom faces are [0, 2, 3] and [0, 3, 1]; the first becomes two with a corner at 8 and a
    // cap [0, 8, 3] against the diagonal.
    vertices.push(Point3::new(0.5 - height, 0.5 + height, 0.0));
    let mut faces = cube.faces().to_vec();
    faces[0] = [0, 2, 8];
    faces.extend([[2, 3, 8], [0, 8, 3]]);
    TriMesh::new(vertices, faces).expect("the construction is a mesh")
}

/// A sphere with one vertex doubled in place: its two copies joined by two needles.
fn sphere_with_needles(gap: f64) -> TriMesh {
    let sphere = icosphere(1);
    let v = sphere.faces()[0][0];
    let copy = sphere.n_vertices() as u32;
    let mut vertices = sphere.vertices().to_vec();
    let p = vertices[v as usize];
    // The ring of v in order: the copy takes over the first two faces of the fan.
    let next = |at: u32| {
        sphere.faces().iter().find_map(|f| {
            let i = f.iter().position(|&w| w == v)?;
            (f[(i + 1) % 3] == at).then_some(f[(i + 2) % 3])
        })
    };
    let first = sphere.faces()[0][1];
    let second = next(first).expect("the vertex has a closed fan");
    let third = next(second).expect("the vertex has a closed fan");
    let towards = vertices[second as usize] - p;
    vertices.push(p + towards * gap);
    let mut faces: Vec<[u32; 3]> = sphere
        .faces()
        .iter()
        .map(|f| {
            let is_moved = f.contains(&v) && f.contains(&second);
            f.map(|w| if is_moved && w == v { copy } else { w })
        })
        .collect();
    faces.extend([[v, first, copy], [v, copy, third]]);
    TriMesh::new(vertices, faces).expect("the construction is a mesh")
}

#[test]
fn caps_are_flipped_away_without_a_hole() {
    for height in [0.0, 1e-13] {
        for factor in [1e-3, 1.0, 1e3] {
            let mesh = scaled(&cube_with_cap(height), factor);
            assert!(is_closed_manifold(&mesh), "the construction is sound");
            assert_eq!(defects(&mesh).zero_area_faces, [13], "the cap");
            let (after, report) = repaired(&mesh);
            assert_eq!(report.n_flipped_edges, 1, "{report:?}");
            assert_eq!(after.n_faces(), 14, "a flip keeps the number of faces");
            assert!(is_closed_manifold(&after), "still closed");
            assert!(
                (volume(&after) / factor.powi(3) - 1.0).abs() < 1e-9,
                "still a cube"
            );
        }
    }
    let (same, report) = repaired(&cube_with_cap(1e-3));
    assert_eq!(same, cube_with_cap(1e-3), "a thin face is a face");
    assert!(!report.changed(), "{report:?}");
}

#[test]
fn needles_are_collapsed_without_a_hole() {
    for gap in [0.0, 1e-12] {
        for factor in [1e-3, 1.0, 1e3] {
            let mesh = scaled(&sphere_with_needles(gap), factor);
            assert!(is_closed_manifold(&mesh), "the construction is sound");
            assert_eq!(defects(&mesh).zero_area_faces.len(), 2, "two needles");
            let (after, report) = repaired(&mesh);
            assert_eq!(report.n_collapsed_edges, 1, "{report:?}");
            assert_eq!(report.n_removed_zero_area_faces, 0, "{report:?}");
            assert!(is_closed_manifold(&after), "still closed");
            assert_eq!(after, scaled(&icosphere(1), factor), "the sphere is back");
        }
    }
}

#[test]
fn a_stray_face_without_area_vanishes_and_nothing_but_such_is_refused() {
    let grid = grid(2);
    let mut vertices = grid.vertices().to_vec();
    let mut faces = grid.faces().to_vec();
    // A face without area that hangs on nothing.
    vertices.extend([0.0, 1.0, 2.0].map(|x| Point3::new(x, 9.0, 0.0)));
    faces.push([9, 10, 11]);
    let (after, report) = repaired(&TriMesh::new(vertices, faces).unwrap());
    assert_eq!(after, grid, "the stray face is gone");
    assert_eq!(report.n_collapsed_edges, 1, "{report:?}");
    let line = TriMesh::new(grid.vertices().to_vec(), vec![[0, 1, 2]]).unwrap();
    let refused = repair(&line, &RepairOptions::default()).unwrap_err();
    assert_eq!(
        refused,
        MeshError::NothingLeft { n_faces: 1 },
        "nothing has an area"
    );
}

#[test]
fn small_components_go_only_if_asked() {
    let mesh = concatenate(&[&scaled(&cube(), 0.01), &icosphere(2)]).unwrap();
    let (same, _) = repaired(&mesh);
    assert_eq!(same, mesh, "the crumb stays by default");
    let options = RepairOptions {
        min_component_area_fraction: Some(0.01),
    };
    let (after, report) = repair(&mesh, &options).unwrap();
    assert_eq!(after, icosphere(2), "the crumb is gone");
    assert_eq!(report.n_removed_components, 1, "{report:?}");
    assert_eq!(report.n_faces_of_removed_components, 12, "{report:?}");
    let all = RepairOptions {
        min_component_area_fraction: Some(2.0),
    };
    let refused = repair(&mesh, &all).unwrap_err();
    assert_eq!(
        refused,
        MeshError::NothingLeft { n_faces: 332 },
        "no component is that large"
    );
}

#[test]
fn turned_faces_and_boundaries_are_named_and_left() {
    let mut faces = cube().faces().to_vec();
    faces[0].swap(0, 1);
    let mesh = TriMesh::new(cube().vertices().to_vec(), faces).unwrap();
    let found = defects(&mesh);
    assert_eq!(
        found.inconsistent_edges,
        [[0, 2], [0, 3], [2, 3]],
        "{found:?}"
    );
    assert!(
        found.is_repaired() && !found.is_closed_oriented_manifold(),
        "{found:?}"
    );
    assert_eq!(repaired(&mesh).0, mesh, "left as it is");
    assert_eq!(
        defects(&grid(3)).n_boundary_edges,
        12,
        "the outline of a grid"
    );
}

#[test]
fn real_vertebrae_keep_their_topology() {
    for subject in ["vhp-male-remus", "verse010"] {
        let Some(vertebrae) = spine(subject) else {
            return;
        };
        for mesh in vertebrae {
            let (after, report) = repaired(&mesh);
            assert_eq!(genus(&after), genus(&mesh), "{report:?}");
            assert_eq!(report.n_removed_zero_area_faces, 0, "{report:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_soup_is_repaired_or_refused_and_repair_is_idempotent(
        points in prop::collection::vec(prop::array::uniform3(0u8..4), 3..10),
        corners in prop::collection::vec(prop::array::uniform3(0usize..10), 1..30),
    ) {
        let n = points.len();
        let vertices = points.iter().map(|p| Point3::from(p.map(f64::from))).collect();
        let faces = corners.iter().map(|c| c.map(|v| (v % n) as u32)).collect();
        let mesh = TriMesh::new(vertices, faces).unwrap();
        match repair(&mesh, &RepairOptions::default()) {
            Ok((after, _)) => {
                let found = defects(&after);
                prop_assert!(found.is_repaired(), "{:?}", found);
                let (again, report) = repair(&after, &RepairOptions::default()).unwrap();
                prop_assert_eq!(&again, &after);
                prop_assert!(!report.changed());
            }
            Err(error) => prop_assert_eq!(error, MeshError::NothingLeft { n_faces: mesh.n_faces() }),
        }
    }

    #[test]
    fn simplifying_any_soup_does_not_panic(
        points in prop::collection::vec(prop::array::uniform3(-2.0f64..2.0), 3..12),
        corners in prop::collection::vec(prop::array::uniform3(0usize..12), 1..60),
        target in 4usize..40,
    ) {
        let n = points.len();
        let vertices: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
        let faces = corners.iter().map(|c| c.map(|v| (v % n) as u32)).collect();
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let options = pedicle_mesh::SimplifyOptions {
            min_faces_per_component: 4,
            ..pedicle_mesh::SimplifyOptions::default()
        };
        if let Ok(simplified) = pedicle_mesh::simplify(&mesh, target, &options) {
            for (v, &source) in simplified.source_vertex.iter().enumerate() {
                prop_assert_eq!(simplified.mesh.vertices()[v], mesh.vertices()[source as usize]);
            }
        }
    }
}
