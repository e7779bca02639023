//! Closest points, rays and inside tests against truth and brute force.

use nalgebra::{Point3, Vector3};
use pedicle_mesh::{MeshError, SurfaceIndex, TriMesh};
use proptest::prelude::*;

use crate::shapes::{cube, grid, icosphere, scaled, spine, torus};

/// Distance from a point to a triangle by minimising over its plane and its edges.
fn distance_to_triangle(q: &Point3<f64>, [a, b, c]: [Point3<f64>; 3]) -> f64 {
    let to_segment = |p: Point3<f64>, r: Point3<f64>| {
        let d = r - p;
        let t = if d.norm_squared() > 0.0 {
            ((q - p).dot(&d) / d.norm_squared()).clamp(0.0, 1.0)
        } else {
            0.0
        };
        (q - (p + d * t)).norm()
    };
    let edges = to_segment(a, b).min(to_segment(b, c)).min(to_segment(c, a));
    let normal = (b - a).cross(&(c - a));
    if normal.norm() < 1e-12 {
        return edges;
    }
    let n = normal.normalize();
    let foot = q - n * (q - a).dot(&n);
    let same_side = |p: Point3<f64>, r: Point3<f64>| (r - p).cross(&(foot - p)).dot(&n) >= 0.0;
    if same_side(a, b) && same_side(b, c) && same_side(c, a) {
        (q - foot).norm()
    } else {
        edges
    }
}

fn brute_force(mesh: &TriMesh, q: &Point3<f64>) -> f64 {
    (0..mesh.n_faces())
        .map(|f| distance_to_triangle(q, mesh.triangle(f)))
        .fold(f64::INFINITY, f64::min)
}

/// Points on a regular lattice in [-4, 4]³, slightly off the symmetry planes.
fn lattice(n: usize) -> impl Iterator<Item = Point3<f64>> {
    let at = move |i: usize| -4.0 + 8.0 * (i as f64 + 0.37) / n as f64;
    (0..n * n * n).map(move |i| Point3::new(at(i % n), at(i / n % n), at(i / n / n)))
}

#[test]
fn closest_points_within_a_limit_are_the_closest_or_none() {
    let index = SurfaceIndex::new(&torus(24, 12)).unwrap();
    for q in lattice(7) {
        let closest = index.closest_point(&q);
        let distance_mm = closest.distance_mm;
        for limit_mm in [distance_mm, 1.5 * distance_mm, f64::INFINITY] {
            let found = index.closest_point_within(&q, limit_mm).unwrap();
            assert_eq!(found.distance_mm.to_bits(), distance_mm.to_bits(), "{q}");
        }
        for limit_mm in [0.999 * distance_mm, 0.0, -1.0, f64::NAN] {
            let found = index.closest_point_within(&q, limit_mm);
            assert!(found.is_none(), "{q} within {limit_mm} of {distance_mm}");
        }
    }
}

#[test]
fn closest_points_agree_with_brute_force() {
    for factor in [1e-3, 1.0, 1e3] {
        let mesh = scaled(&torus(24, 12), factor);
        let index = SurfaceIndex::new(&mesh).unwrap();
        for q in lattice(9).map(|q| q * factor) {
            let found = index.closest_point(&q);
            let expected = brute_force(&mesh, &q);
            let error = (found.distance_mm - expected).abs();
            assert!(error < 1e-12 * factor, "{error} at {q}");
            let corners = mesh.triangle(found.face as usize);
            assert!(
                distance_to_triangle(&found.point, corners) < 1e-12 * factor,
                "the point is not on the face it names"
            );
            assert!(
                ((q - found.point).norm() - found.distance_mm).abs() < 1e-12 * factor,
                "the distance is not that of the point"
            );
        }
    }
}

#[test]
fn a_ray_hits_a_sphere_where_it_should() {
    let index = SurfaceIndex::new(&icosphere(5)).unwrap();
    let origin = Point3::new(3.0, 0.0, 0.0);
    let hit = index
        .cast_ray(&origin, &Vector3::new(-2.0, 0.0, 0.0), 10.0)
        .expect("the ray hits");
    assert!((hit.distance_mm - 2.0).abs() < 2e-3, "{hit:?}");
    assert!(hit.normal.x > 0.99, "the normal points outwards: {hit:?}");
    let away = index.cast_ray(&origin, &Vector3::x(), 10.0);
    assert_eq!(away, None, "a ray away from the sphere hits nothing");
    let short = index.cast_ray(&origin, &-Vector3::x(), 1.9);
    assert_eq!(short, None, "the sphere is further than 1.9");
}

#[test]
fn rays_through_edges_and_vertices_of_a_flat_grid_hit() {
    let index = SurfaceIndex::new(&grid(8)).unwrap();
    for i in 0..=32 {
        for j in 0..=32 {
            let above = Point3::new(i as f64 / 4.0, j as f64 / 4.0, 2.0);
            let hit = index.cast_ray(&above, &-Vector3::z(), 2.0);
            let hit = hit.unwrap_or_else(|| panic!("the ray at {above} slips through"));
            assert!((hit.distance_mm - 2.0).abs() < 1e-15, "{hit:?}");
            assert_eq!(hit.normal, Vector3::z(), "the grid faces up");
        }
    }
}

#[test]
fn inside_of_a_torus_is_its_tube_and_not_its_hole() {
    for factor in [1e-3, 1.0, 1e3] {
        let index = SurfaceIndex::new(&scaled(&torus(96, 48), factor)).unwrap();
        for q in lattice(12) {
            let ring = (q.x.hypot(q.y) - 3.0).hypot(q.z);
            if (ring - 1.0).abs() < 0.02 {
                continue;
            }
            let q = q * factor;
            assert_eq!(
                index.contains(&q),
                ring < 1.0,
                "at {q}, {ring} from the ring"
            );
            let signed = index.signed_distance_mm(&q);
            let error = (signed / factor - (ring - 1.0)).abs();
            assert!(error < 5e-3, "signed distance off by {error}");
        }
    }
}

#[test]
fn inside_survives_a_hole_a_doubled_face_and_symmetric_positions() {
    let cube = cube();
    let index = SurfaceIndex::new(&cube).unwrap();
    for i in 1..8 {
        for j in 1..8 {
            let q = Point3::new(i as f64 / 8.0, j as f64 / 8.0, 0.5);
            assert!(index.contains(&q), "{q} is inside the cube");
            assert!(!index.contains(&(q + Vector3::x())), "{q} + x is outside");
        }
    }
    let sphere = icosphere(3);
    let mut faces = sphere.faces().to_vec();
    faces.swap_remove(100);
    faces.push(faces[200]);
    let dirty = TriMesh::new(sphere.vertices().to_vec(), faces).unwrap();
    let index = SurfaceIndex::new(&dirty).unwrap();
    for q in lattice(12).map(|q| q / 4.0) {
        let r = q.coords.norm();
        if (r - 1.0).abs() > 0.02 {
            assert_eq!(index.contains(&q), r < 1.0, "at {q}");
        }
    }
}

#[test]
fn faces_without_area_are_passed_over() {
    let grid = grid(2);
    let mut faces = grid.faces().to_vec();
    faces.insert(0, [0, 0, 4]);
    faces.insert(3, [0, 1, 2]);
    faces.push([3, 3, 3]);
    let mesh = TriMesh::new(grid.vertices().to_vec(), faces).unwrap();
    let index = SurfaceIndex::new(&mesh).unwrap();
    assert_eq!(index.n_faces(), grid.n_faces(), "three faces are left out");
    let near = index.closest_point(&Point3::new(0.0, 0.0, 1.0));
    assert_eq!(near.normal, Vector3::z(), "a real face is found: {near:?}");
    let flat = TriMesh::new(grid.vertices().to_vec(), vec![[0, 1, 2], [4, 4, 4]]).unwrap();
    let refused = SurfaceIndex::new(&flat).unwrap_err();
    assert_eq!(
        refused,
        MeshError::NoArea { n_faces: 2 },
        "no face has an area"
    );
}

#[test]
fn queries_that_are_not_finite_find_nothing() {
    let index = SurfaceIndex::new(&cube()).unwrap();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200] {
        let q = Point3::new(bad, 0.0, 0.0);
        let found = index.closest_point(&q).distance_mm;
        assert!(found.is_infinite(), "{bad} is nowhere near: {found}");
        assert!(!index.contains(&q), "{bad} is not inside");
        assert_eq!(index.cast_ray(&q, &Vector3::x(), 9.0), None, "{bad}");
        let origin = Point3::origin();
        let direction = Vector3::new(0.0, bad, f64::NAN);
        assert_eq!(index.cast_ray(&origin, &direction, 9.0), None, "{bad}");
    }
    let nowhere = index.cast_ray(&Point3::origin(), &Vector3::zeros(), 9.0);
    assert_eq!(nowhere, None, "a ray needs a direction");
    let nan = index.cast_ray(&Point3::origin(), &Vector3::x(), f64::NAN);
    assert_eq!(nan, None, "a limit that is not a number admits nothing");
    let huge = scaled(&cube(), 1e120);
    let refused = SurfaceIndex::new(&huge).unwrap_err();
    assert!(
        matches!(refused, MeshError::CoordinateTooLarge { .. }),
        "{refused}"
    );
}

#[test]
fn real_vertebrae_contain_what_lies_beneath_their_surface() {
    for subject in ["vhp-male-remus", "verse010"] {
        let Some(vertebrae) = spine(subject) else {
            return;
        };
        for mesh in vertebrae {
            let index = SurfaceIndex::new(&mesh).unwrap();
            let mut n_wrong = 0;
            for face in (0..mesh.n_faces()).step_by(mesh.n_faces() / 300) {
                let normal = mesh.face_normal_scaled(face).normalize();
                let [a, b, c] = mesh.triangle(face);
                let centre = Point3::from((a.coords + b.coords + c.coords) / 3.0);
                n_wrong += usize::from(!index.contains(&(centre - normal * 1e-3)));
                n_wrong += usize::from(index.contains(&(centre + normal * 1e-3)));
            }
            assert_eq!(n_wrong, 0, "{subject}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_triangle_soup_is_searched_without_panic(
        points in prop::collection::vec(prop::array::uniform3(-4i8..4), 3..12),
        corners in prop::collection::vec(prop::array::uniform3(0usize..12), 1..20),
        queries in prop::collection::vec(prop::array::uniform3(-6.0f64..6.0), 1..20),
    ) {
        let n = points.len();
        let vertices = points.iter().map(|p| Point3::from(p.map(f64::from))).collect();
        let faces = corners.iter().map(|c| c.map(|v| (v % n) as u32)).collect();
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let Ok(index) = SurfaceIndex::new(&mesh) else {
            prop_assert!(mesh.area() == 0.0);
            return Ok(());
        };
        let with_area: Vec<u32> = (0..mesh.n_faces() as u32)
            .filter(|&f| mesh.face_area(f as usize) > 0.0)
            .collect();
        let real = mesh.submesh_of_faces(&with_area).unwrap().mesh;
        for q in queries.into_iter().map(Point3::from) {
            let found = index.closest_point(&q);
            prop_assert!((found.distance_mm - brute_force(&real, &q)).abs() < 1e-12);
            prop_assert!((found.normal.norm() - 1.0).abs() < 1e-12);
            let towards = found.point - q;
            if towards.norm() > 1e-6 {
                let limit = found.distance_mm * (1.0 + 1e-9);
                if let Some(hit) = index.cast_ray(&q, &towards, limit) {
                    prop_assert!((hit.distance_mm - found.distance_mm).abs() < 1e-6);
                }
            }
            let signed = index.signed_distance_mm(&q);
            prop_assert!((signed.abs() - found.distance_mm).abs() < 1e-12);
        }
    }
}
