//! Components, boundaries, manifoldness and measures of shapes whose topology is known.

use std::f64::consts::{FRAC_PI_3, FRAC_PI_4, PI};

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::{
    TriMesh, angle_weighted_normals, boundary_loops, concatenate, connected_components,
    edge_lengths, euler_characteristic, genus, is_closed_manifold, non_manifold_edges,
    non_manifold_vertices, smallest_angle_rad, vertex_adjacency, volume,
};

use crate::shapes::{cube, grid, icosphere, scaled, spine, torus};

fn with_faces(mesh: &TriMesh, faces: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(mesh.vertices().to_vec(), faces).expect("the faces fit the vertices")
}

#[test]
fn genus_and_euler_characteristic_of_known_surfaces() {
    let (sphere, torus) = (icosphere(2), torus(12, 8));
    let both = concatenate(&[&sphere, &torus, &sphere]).unwrap();
    for (mesh, chi, handles) in [
        (&sphere, 2, Some(0)),
        (&torus, 0, Some(1)),
        (&both, 4, Some(1)),
    ] {
        assert_eq!(euler_characteristic(mesh), chi, "χ");
        assert_eq!(genus(mesh), handles, "genus");
        assert!(is_closed_manifold(mesh), "closed");
        assert!(boundary_loops(mesh).is_empty(), "no boundary");
    }
    assert_eq!(euler_characteristic(&grid(3)), 1, "a disk");
    assert_eq!(genus(&grid(3)), None, "a disk is not closed");
    let mut turned = cube().faces().to_vec();
    turned[0].swap(0, 1);
    assert_eq!(
        genus(&with_faces(&cube(), turned)),
        None,
        "a face is turned over"
    );
}

#[test]
fn genus_of_real_vertebrae() {
    let Some(vertebrae) = spine("verse010") else {
        return;
    };
    assert_eq!(genus(&vertebrae[4]), Some(5), "L5 has four extra handles");
}

#[test]
fn components_leave_out_vertices_that_no_face_uses() {
    let mesh = concatenate(&[&cube(), &icosphere(1)]).unwrap();
    let mut vertices = vec![Point3::origin()];
    vertices.extend(mesh.vertices());
    let faces = mesh
        .faces()
        .iter()
        .map(|f| f.map(|v| v + 1))
        .rev()
        .collect();
    let mesh = TriMesh::new(vertices, faces).unwrap();
    let components = connected_components(&mesh);
    assert_eq!(components.n_components, 2, "a cube and a sphere");
    assert_eq!(components.of_vertex[0], None, "no face uses vertex 0");
    assert_eq!(
        components.of_vertex[1],
        Some(1),
        "the cube's faces come last here"
    );
    assert_eq!(
        components.of_face[0], 0,
        "components are numbered by their first face"
    );
    let faces = components.faces();
    assert_eq!(
        (faces[0].len(), faces[1].len()),
        (80, 12),
        "faces of either"
    );
}

#[test]
fn boundary_loops_run_along_their_faces() {
    let grid = grid(3);
    let loops = boundary_loops(&grid);
    assert_eq!(loops.len(), 1, "one outline");
    assert_eq!(loops[0].len(), 12, "twelve edges");
    let points: Vec<Point3<f64>> = loops[0]
        .iter()
        .map(|&v| grid.vertices()[v as usize])
        .collect();
    let twice_area: f64 = (0..points.len())
        .map(|i| {
            let (p, q) = (points[i], points[(i + 1) % points.len()]);
            p.x * q.y - p.y * q.x
        })
        .sum();
    assert!(
        (twice_area - 18.0).abs() < 1e-12,
        "counter-clockwise: {twice_area}"
    );
    // Two opposite squares taken out of a grid: the holes touch in one vertex.
    let mut faces = grid.faces().to_vec();
    let hole = |i: usize, j: usize| 2 * (3 * i + j);
    for start in [hole(1, 1), hole(0, 0)] {
        faces.drain(start..start + 2);
    }
    let pierced = with_faces(&grid, faces);
    let mut lengths: Vec<usize> = boundary_loops(&pierced).iter().map(Vec::len).collect();
    lengths.sort_unstable();
    assert_eq!(
        lengths,
        [4, 12],
        "the outline goes around one hole, the other is alone"
    );
    assert_eq!(
        non_manifold_vertices(&pierced),
        [5],
        "where the hole touches the outline"
    );
}

#[test]
fn non_manifold_places_are_named() {
    let mut faces = cube().faces().to_vec();
    let fin = *faces.first().unwrap();
    let mut vertices = cube().vertices().to_vec();
    vertices.push(Point3::new(0.5, 0.5, -1.0));
    faces.push([fin[0], fin[1], 8]);
    let finned = TriMesh::new(vertices, faces).unwrap();
    assert_eq!(
        non_manifold_edges(&finned),
        [[0, 2]],
        "the edge with the fin"
    );
    assert!(!is_closed_manifold(&finned), "not a manifold");
    // Two cubes that share the corner (1, 1, 1) and nothing else.
    let mut vertices = cube().vertices().to_vec();
    let mut faces = cube().faces().to_vec();
    vertices.extend(
        cube()
            .vertices()
            .iter()
            .skip(1)
            .map(|p| p + Vector3::repeat(1.0)),
    );
    faces.extend(cube().faces().iter().map(|f| f.map(|v| v + 7)));
    let touching = TriMesh::new(vertices, faces).unwrap();
    assert_eq!(non_manifold_vertices(&touching), [7], "the shared corner");
    assert!(
        non_manifold_edges(&touching).is_empty(),
        "every edge has two faces"
    );
    assert_eq!(
        connected_components(&touching).n_components,
        1,
        "a shared vertex connects"
    );
}

#[test]
fn neighbors_are_sorted_and_mutual() {
    let mesh = torus(9, 7);
    let adjacency = vertex_adjacency(&mesh);
    for v in 0..mesh.n_vertices() as u32 {
        let neighbors = adjacency.of(v);
        assert_eq!(neighbors.len(), 6, "a regular torus");
        assert!(neighbors.is_sorted(), "sorted");
        for &w in neighbors {
            assert!(adjacency.of(w).contains(&v), "{v} and {w} are neighbours");
        }
    }
    let folded = TriMesh::new(vec![Point3::origin(); 3], vec![[0, 0, 1]]).unwrap();
    assert!(
        vertex_adjacency(&folded).neighbors.is_empty(),
        "an improper face connects nothing"
    );
}

#[test]
fn measures_of_known_shapes_scale_as_they_should() {
    for factor in [1e-3, 1.0, 1e3] {
        let cube = scaled(&cube(), factor);
        assert!(
            (volume(&cube) / factor.powi(3) - 1.0).abs() < 1e-12,
            "volume of a cube"
        );
        let lengths = edge_lengths(&cube);
        let diagonal = 2.0_f64.sqrt();
        assert_eq!(lengths.n_edges, 18, "12 edges and 6 diagonals");
        assert!((lengths.min_mm / factor - 1.0).abs() < 1e-12, "{lengths:?}");
        assert!(
            (lengths.max_mm / factor - diagonal).abs() < 1e-12,
            "{lengths:?}"
        );
        let mean = (12.0 + 6.0 * diagonal) / 18.0;
        assert!(
            (lengths.mean_mm / factor - mean).abs() < 1e-12,
            "{lengths:?}"
        );
        assert!(
            (smallest_angle_rad(&cube) - FRAC_PI_4).abs() < 1e-12,
            "halved squares"
        );
        // At a corner of a cube three right angles meet, however the squares are cut.
        for (normal, p) in angle_weighted_normals(&cube).iter().zip(cube.vertices()) {
            let outward = (p / factor - Point3::new(0.5, 0.5, 0.5)).normalize();
            assert!((normal - outward).norm() < 1e-12, "{normal} at {p}");
        }
    }
    let far = icosphere(4).transformed(&Isometry3::translation(1e5, 1e5, 1e5));
    assert!(
        (volume(&far) - 4.0 / 3.0 * PI).abs() < 0.02,
        "volume far from the origin"
    );
    assert!(
        smallest_angle_rad(&icosphere(0)) - FRAC_PI_3 < 1e-12,
        "an icosahedron is regular"
    );
}
