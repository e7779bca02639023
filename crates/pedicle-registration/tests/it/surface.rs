use nalgebra::{Point3, Vector3};
use pedicle_registration::{PointSurface, ReferenceSurface, RegistrationError, SurfaceHit};

use crate::shapes::{Lump, in_cube, noise, rng};

#[test]
fn the_test_shape_answers_its_nearest_point() {
    let lump = Lump::vertebra_sized();
    let (points, normals) = lump.points(4000);
    let mut rng = rng(3);
    for i in (0..points.len()).step_by(40) {
        // A step along the normal comes back to the same point.
        for offset in [-1.5, -1e-9, 0.0, 1e-3, 3.0] {
            let hit = lump.closest(&(points[i] + normals[i] * offset));
            let gap = (hit.point - points[i]).norm();
            assert!(gap < 1e-10, "offset {offset} at {i}: {gap} mm off");
            assert!(
                (hit.distance_mm - offset.abs()).abs() < 1e-10,
                "distance {}",
                hit.distance_mm
            );
            assert!(
                (hit.normal - normals[i]).norm() < 1e-9,
                "normal {}",
                hit.normal
            );
        }
        // No sample of the surface is nearer than the answer.
        let query = points[i] + noise(&mut rng, 1.5);
        let hit = lump.closest(&query);
        let sampled = points
            .iter()
            .map(|p| (p - query).norm())
            .fold(f64::INFINITY, f64::min);
        assert!(
            hit.distance_mm <= sampled + 1e-9,
            "{} but {sampled} at {i}",
            hit.distance_mm
        );
    }
}

#[test]
fn point_surface_finds_what_a_full_search_finds() {
    let mut rng = rng(5);
    for n in [1, 2, 7, 33, 1000] {
        let points: Vec<_> = (0..n)
            .map(|_| in_cube(&mut rng, &Point3::origin(), 10.0))
            .collect();
        let normals: Vec<_> = (0..n).map(|_| noise(&mut rng, 4.0)).collect();
        let surface = PointSurface::new(&points, &normals).expect("valid points");
        for _ in 0..50 {
            let query = in_cube(&mut rng, &Point3::origin(), 15.0);
            let best = (0..n)
                .min_by(|&a, &b| {
                    (points[a] - query)
                        .norm()
                        .total_cmp(&(points[b] - query).norm())
                })
                .expect("there is a point");
            let hit = surface.closest(&query);
            assert_eq!(surface.nearest_index(&query), best, "wrong point");
            assert_eq!(hit.point, points[best], "wrong place");
            assert!(
                (hit.normal - normals[best].normalize()).norm() < 1e-12,
                "wrong normal"
            );
            assert!(
                (hit.normal.norm() - 1.0).abs() < 1e-14,
                "normal is not unit"
            );
            let d = hit.distance_mm;
            assert!(
                surface.closest_within(&query, d * 1.001).is_some(),
                "within reach"
            );
            assert!(
                surface.closest_within(&query, d * 0.999).is_none(),
                "out of reach"
            );
        }
    }
}

#[test]
fn many_equal_points_are_one_surface() {
    let points = vec![Point3::new(1.0, 2.0, 3.0); 500];
    let surface = PointSurface::new(&points, &vec![Vector3::z(); 500]).expect("valid points");
    let hit = surface.closest(&Point3::new(1.0, 2.0, 5.0));
    assert!(
        (hit.distance_mm - 2.0).abs() < 1e-15,
        "distance {}",
        hit.distance_mm
    );
}

#[test]
fn tiny_and_huge_normals_become_unit() {
    let points = [Point3::origin(), Point3::new(1.0, 0.0, 0.0)];
    let normals = [
        Vector3::new(0.0, 3e-200, 4e-200),
        Vector3::new(3e200, 0.0, 4e200),
    ];
    let surface = PointSurface::new(&points, &normals).expect("normals have directions");
    for normal in surface.normals() {
        assert!((normal.norm() - 1.0).abs() < 1e-14, "normal {normal:?}");
    }
}

#[test]
fn surfaces_of_bad_points_are_refused() {
    let point = Point3::new(1.0, 2.0, 3.0);
    let error = PointSurface::new(&[], &[]).expect_err("no points");
    assert_eq!(
        error,
        RegistrationError::TooFewPoints {
            n_points: 0,
            n_needed: 1
        }
    );
    let error = PointSurface::new(&[point], &[]).expect_err("no normals");
    assert_eq!(
        error,
        RegistrationError::NormalCountDiffers {
            n_points: 1,
            n_normals: 0
        }
    );
    let nan = Point3::new(1.0, f64::NAN, 3.0);
    let error = PointSurface::new(&[point, nan], &[Vector3::x(); 2]).expect_err("NaN");
    assert!(
        matches!(error, RegistrationError::NonFinitePoint { index: 1, .. }),
        "{error}"
    );
    for normal in [
        Vector3::zeros(),
        Vector3::repeat(f64::NAN),
        Vector3::repeat(f64::INFINITY),
    ] {
        let error = PointSurface::new(&[point], &[normal]).expect_err("no direction");
        assert!(
            matches!(error, RegistrationError::BadNormal { index: 0, .. }),
            "{error}"
        );
    }
}

#[test]
fn hits_towards_the_query_fall_back_to_the_surface() {
    for scale in [1e-3, 1.0, 1e3] {
        let place = Point3::new(1.0, 2.0, 3.0) * scale;
        let off = place + Vector3::new(0.0, 3.0, 4.0) * (0.1 * scale);
        let hit = SurfaceHit::towards(&off, place, Vector3::x());
        assert!(
            (hit.normal - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-12,
            "{hit:?}"
        );
        assert!((hit.distance_mm / scale - 0.5).abs() < 1e-12, "{hit:?}");
        for query in [place, place + Vector3::z() * (1e-12 * scale)] {
            let hit = SurfaceHit::towards(&query, place, Vector3::x());
            assert_eq!(
                hit.normal,
                Vector3::x(),
                "on the surface its own normal counts"
            );
        }
    }
}

#[test]
fn trait_objects_are_surfaces() {
    let lump = Lump::vertebra_sized();
    let surface: &dyn ReferenceSurface = &lump;
    let hit: SurfaceHit = surface.closest(&Point3::new(40.0, 0.0, 0.0));
    assert!(hit.distance_mm > 10.0, "distance {}", hit.distance_mm);
}
