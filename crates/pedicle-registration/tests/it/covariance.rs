use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};
use pedicle_registration::{
    PoseCovariance, RegistrationError, cramer_rao_bound, pose_difference, pose_information,
};

use crate::shapes::{Lump, fibonacci, noise, rng};

/// Two points on each face of a cube of half width h: its information is known in closed form.
fn cube(h: f64, d: f64) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let mut points = Vec::new();
    let mut normals = Vec::new();
    for i in 0..3 {
        for sign in [1.0, -1.0] {
            let n = axes[i] * sign;
            for along in [axes[(i + 1) % 3], axes[(i + 2) % 3]] {
                for side in [d, -d] {
                    points.push(Point3::from(n * h + along * side));
                    normals.push(n);
                }
            }
        }
    }
    (points, normals)
}

#[test]
fn a_cube_has_the_information_of_its_faces() {
    let (h, d, sigma) = (10.0, 4.0, 0.5);
    let (points, normals) = cube(h, d);
    let information = pose_information(&points, &normals, &Point3::origin()).expect("sound");
    // Translation: 8 normals along each axis. Rotation about an axis: four faces with two points
    // each at lever d.
    let mut expected = Matrix6::zeros();
    for i in 0..3 {
        expected[(i, i)] = 8.0 * d * d;
        expected[(i + 3, i + 3)] = 8.0;
    }
    let gap = (information - expected).amax();
    assert!(gap < 1e-12, "information off by {gap}: {information}");
    let bound = cramer_rao_bound(&points, &normals, &Point3::origin(), sigma).expect("sound");
    let translation = sigma * (3.0_f64 / 8.0).sqrt();
    assert!(
        (bound.translation_mm - translation).abs() < 1e-12,
        "{}",
        bound.translation_mm
    );
    assert!(
        (bound.rotation_rad - translation / d).abs() < 1e-12,
        "{}",
        bound.rotation_rad
    );
    // At a distance the rotation adds lever² times the two turns across it.
    let far = bound
        .covariance
        .point_error_mm(&Point3::new(50.0, 0.0, 0.0));
    let turn = sigma / (8.0_f64.sqrt() * d);
    let expected = (translation.powi(2) + 2.0 * (50.0 * turn).powi(2)).sqrt();
    assert!((far - expected).abs() < 1e-12, "{far} is not {expected}");
    let along = bound
        .covariance
        .point_error_along_mm(&Point3::new(50.0, 0.0, 0.0), &(Vector3::x() * 7.0));
    assert!(
        (along - sigma / 8.0_f64.sqrt()).abs() < 1e-12,
        "along the lever only the shift: {along}"
    );
}

#[test]
fn the_bound_scales_with_noise_size_and_number() {
    let lump = Lump::vertebra_sized();
    let (points, normals) = lump.points(500);
    let center = Point3::new(3.0, -2.0, 1.0);
    let reference = cramer_rao_bound(&points, &normals, &center, 1.0).expect("sound");
    let noisy = cramer_rao_bound(&points, &normals, &center, 3.0).expect("sound");
    assert!(
        (noisy.translation_mm / reference.translation_mm - 3.0).abs() < 1e-12,
        "noise"
    );
    for scale in [1e-3, 1e3] {
        let scaled: Vec<_> = points.iter().map(|p| p * scale).collect();
        let bound = cramer_rao_bound(&scaled, &normals, &(center * scale), scale).expect("sound");
        let ratio = bound.translation_mm / reference.translation_mm / scale;
        assert!(
            (ratio - 1.0).abs() < 1e-9,
            "translation at scale {scale}: {ratio}"
        );
        let ratio = bound.rotation_rad / reference.rotation_rad;
        assert!(
            (ratio - 1.0).abs() < 1e-9,
            "rotation at scale {scale}: {ratio}"
        );
    }
    let (points, normals) = lump.points(2000);
    let more = cramer_rao_bound(&points, &normals, &center, 1.0).expect("sound");
    let ratio = reference.translation_mm / more.translation_mm;
    assert!(
        (ratio - 2.0).abs() < 0.02,
        "four times the points, half the error: {ratio}"
    );
    let clean = cramer_rao_bound(&points, &normals, &center, 0.0).expect("no noise, no error");
    assert!(
        clean.translation_mm <= 0.0 && clean.rotation_rad <= 0.0,
        "{clean:?}"
    );
}

#[test]
fn the_centre_is_only_a_point_of_view() {
    let (points, normals) = Lump::vertebra_sized().points(300);
    let a = Point3::new(0.0, 0.0, 0.0);
    let b = Point3::new(800.0, -500.0, 300.0);
    let about_a = cramer_rao_bound(&points, &normals, &a, 0.7)
        .expect("sound")
        .covariance;
    let about_b = cramer_rao_bound(&points, &normals, &b, 0.7)
        .expect("sound")
        .covariance;
    for p in [a, b, Point3::new(10.0, 20.0, 30.0)] {
        let (x, y) = (about_a.point_covariance(&p), about_b.point_covariance(&p));
        assert!((x - y).amax() < 1e-9 * x.amax(), "at {p}: {x} {y}");
    }
    assert!(
        (about_b.about(&a).matrix - about_a.matrix).amax() < 1e-9,
        "moved back"
    );
    // Inverting the information about b directly gives the same.
    let direct = pose_information(&points, &normals, &b).expect("sound") / 0.49;
    let product = direct * about_b.matrix;
    assert!((product - Matrix6::identity()).amax() < 1e-5, "{product}");
}

#[test]
fn a_point_scatters_as_its_covariance_says() {
    let (points, normals) = Lump::vertebra_sized().points(60);
    let center = Point3::new(100.0, 50.0, -20.0);
    let shifted: Vec<_> = points.iter().map(|p| p + center.coords).collect();
    let covariance = cramer_rao_bound(&shifted, &normals, &center, 0.2)
        .expect("sound")
        .covariance;
    let root = covariance.matrix.cholesky().expect("positive definite").l();
    let p = center + Vector3::new(20.0, -35.0, 10.0);
    let truth = Isometry3::new(Vector3::new(5.0, 2.0, 1.0), Vector3::new(0.2, 0.5, -0.3));
    let mut rng = rng(12);
    let n = 20_000;
    let mut scatter = Matrix3::zeros();
    let mut squares = 0.0;
    for _ in 0..n {
        let (a, b) = (noise(&mut rng, 1.0), noise(&mut rng, 1.0));
        let d = root * nalgebra::Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
        let turn = UnitQuaternion::from_scaled_axis(d.fixed_rows::<3>(0).into_owned());
        let shift = Translation3::from(d.fixed_rows::<3>(3).into_owned());
        let about = Translation3::from(center.coords);
        let delta: Isometry3<f64> =
            shift * about * Isometry3::from_parts(Translation3::identity(), turn) * about.inverse();
        let offset = delta * p - p;
        scatter += offset * offset.transpose() / f64::from(n);
        let found = delta * truth;
        assert!(
            (pose_difference(&found, &truth, &center) - d).norm() < 1e-9,
            "difference"
        );
        squares += covariance
            .normalized_error_squared(&found, &truth)
            .expect("sound")
            / f64::from(n);
    }
    let expected = covariance.point_covariance(&p);
    assert!(
        (scatter - expected).amax() < 0.05 * expected.amax(),
        "{scatter} {expected}"
    );
    assert!(
        (squares - 6.0).abs() < 0.1,
        "normalised squares average {squares}"
    );
    let deviations = covariance.standard_deviations();
    assert!(
        (deviations[4] - covariance.matrix[(4, 4)].sqrt()).abs() < 1e-15,
        "{deviations}"
    );
}

#[test]
fn planes_spheres_and_cylinders_are_degenerate_at_every_scale() {
    for scale in [1e-3, 1.0, 1e3] {
        let sphere: Vec<Vector3<f64>> = (0..200).map(|i| fibonacci(i, 200)).collect();
        let offset = Vector3::new(40.0, 30.0, -20.0);
        let at = |v: Vector3<f64>| Point3::from((v * 20.0 + offset) * scale);
        let flat = |v: &Vector3<f64>| Vector3::new(v.x, v.y, 0.0);
        let cases: [(&str, Vec<_>, Vec<_>); 3] = [
            (
                "sphere",
                sphere.iter().map(|v| at(*v)).collect(),
                sphere.clone(),
            ),
            (
                "plane",
                sphere.iter().map(|v| at(flat(v))).collect(),
                vec![Vector3::z(); 200],
            ),
            (
                "cylinder",
                sphere
                    .iter()
                    .map(|v| at(flat(v).normalize() + Vector3::z() * v.z))
                    .collect(),
                sphere.iter().map(flat).collect(),
            ),
        ];
        for (name, points, normals) in cases {
            let error = cramer_rao_bound(&points, &normals, &points[0], 1.0).expect_err(name);
            let RegistrationError::Degenerate {
                smallest_eigenvalue,
                largest_eigenvalue,
            } = error
            else {
                panic!("{name}: unexpected {error}");
            };
            let ratio = smallest_eigenvalue / largest_eigenvalue;
            assert!(ratio.abs() < 1e-12, "{name} at scale {scale}: {ratio}");
        }
    }
}

#[test]
fn a_covariance_without_inverse_has_no_normalised_error() {
    let covariance = PoseCovariance {
        matrix: Matrix6::zeros(),
        center: Point3::origin(),
    };
    let pose = Isometry3::identity();
    let error = covariance
        .normalized_error_squared(&pose, &pose)
        .expect_err("no inverse");
    assert!(
        matches!(error, RegistrationError::Degenerate { .. }),
        "{error}"
    );
}
