use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::{
    MsacOptions, RefineOptions, RegistrationError, cramer_rao_bound, kabsch, msac,
    pose_information, refine_on_surface, robust_cost,
};

use crate::shapes::Lump;

fn points(n: usize) -> Vec<Point3<f64>> {
    Lump::vertebra_sized().points(n).0
}

#[test]
fn point_pairs() {
    let good = points(5);
    let mut nan = good.clone();
    nan[3].y = f64::NAN;
    let cases = [
        (
            &good[..0],
            &good[..0],
            "there are 0 points, but at least 3 are needed",
        ),
        (
            &good[..2],
            &good[..2],
            "there are 2 points, but at least 3 are needed",
        ),
        (
            &good,
            &good[..4],
            "there are 5 source points but 4 target points",
        ),
        (&nan[..], &good[..], "source point 3 is not finite"),
        (&good[..], &nan[..], "target point 3 is not finite"),
    ];
    for (source, target, expected) in cases {
        let from_kabsch = kabsch(source, target, None).expect_err(expected);
        let from_msac = msac(source, target, &MsacOptions::default()).expect_err(expected);
        for error in [from_kabsch, from_msac] {
            assert!(error.to_string().starts_with(expected), "{error}");
        }
    }
}

#[test]
fn weights() {
    let good = points(4);
    let error = kabsch(&good, &good, Some(&[1.0; 3])).expect_err("three weights");
    assert_eq!(error.to_string(), "there are 4 point pairs but 3 weights");
    for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = kabsch(&good, &good, Some(&[1.0, 1.0, weight, 1.0])).expect_err("bad weight");
        assert!(
            matches!(error, RegistrationError::BadWeight { index: 2, .. }),
            "{error}"
        );
    }
}

#[test]
fn msac_options() {
    let good = points(9);
    let base = MsacOptions::default();
    let cases = [
        (
            MsacOptions {
                max_trials: 0,
                ..base
            },
            "max_trials",
        ),
        (
            MsacOptions {
                confidence: 0.0,
                ..base
            },
            "confidence",
        ),
        (
            MsacOptions {
                confidence: 99.0,
                ..base
            },
            "confidence",
        ),
        (
            MsacOptions {
                confidence: f64::NAN,
                ..base
            },
            "confidence",
        ),
        (
            MsacOptions {
                max_distance_mm: 0.0,
                ..base
            },
            "max_distance_mm",
        ),
        (
            MsacOptions {
                max_distance_mm: f64::INFINITY,
                ..base
            },
            "max_distance_mm",
        ),
        (
            MsacOptions {
                min_inliers: 2,
                ..base
            },
            "min_inliers",
        ),
    ];
    for (options, name) in cases {
        let error = msac(&good, &good, &options).expect_err(name);
        assert!(
            matches!(error, RegistrationError::OptionOutOfRange { option, .. } if option == name),
            "{name}: {error}"
        );
    }
}

#[test]
fn refine_options() {
    let good = points(50);
    let base = RefineOptions::default();
    let cases = [
        (
            RefineOptions {
                max_iterations: 0,
                ..base
            },
            "max_iterations",
        ),
        (
            RefineOptions {
                max_distance_mm: -1.0,
                ..base
            },
            "max_distance_mm",
        ),
        (
            RefineOptions {
                start_distance_mm: Some(1.0),
                ..base
            },
            "start_distance_mm",
        ),
        (
            RefineOptions {
                start_distance_mm: Some(f64::NAN),
                ..base
            },
            "start_distance_mm",
        ),
        (
            RefineOptions {
                min_points: 6,
                ..base
            },
            "min_points",
        ),
        (
            RefineOptions {
                step_tolerance: f64::NAN,
                ..base
            },
            "step_tolerance",
        ),
        (
            RefineOptions {
                noise_tolerance: -0.1,
                ..base
            },
            "noise_tolerance",
        ),
    ];
    let lump = Lump::vertebra_sized();
    for (options, name) in cases {
        let error =
            refine_on_surface(&lump, &good, &Isometry3::identity(), &options).expect_err(name);
        assert!(
            matches!(error, RegistrationError::OptionOutOfRange { option, .. } if option == name),
            "{name}: {error}"
        );
    }
}

#[test]
fn refine_points_and_pose() {
    let lump = Lump::vertebra_sized();
    let options = RefineOptions::default();
    let identity = Isometry3::identity();
    let refine = |points: &[Point3<f64>], pose| refine_on_surface(&lump, points, pose, &options);
    let error = refine(&points(9), &identity).expect_err("nine points");
    assert_eq!(
        error,
        RegistrationError::TooFewPoints {
            n_points: 9,
            n_needed: 10
        }
    );
    let mut bad = points(30);
    bad[7].x = f64::INFINITY;
    let error = refine(&bad, &identity).expect_err("an infinite point");
    assert!(
        matches!(error, RegistrationError::NonFinitePoint { index: 7, .. }),
        "{error}"
    );
    let error = robust_cost(&lump, &bad, &identity, 1.0).expect_err("an infinite point");
    assert!(
        matches!(error, RegistrationError::NonFinitePoint { index: 7, .. }),
        "{error}"
    );
    let nowhere = Isometry3::translation(f64::NAN, 0.0, 0.0);
    let error = refine(&points(30), &nowhere).expect_err("a pose of NaN");
    assert_eq!(error, RegistrationError::NonFinitePose);
    let error = refine(&vec![points(1)[0]; 30], &identity).expect_err("one place");
    assert!(
        matches!(error, RegistrationError::Degenerate { .. }),
        "{error}"
    );
    let error = robust_cost(&lump, &points(3), &identity, 0.0).expect_err("no truncation");
    assert!(
        matches!(error, RegistrationError::OptionOutOfRange { .. }),
        "{error}"
    );
    let error = robust_cost(&lump, &[], &identity, 1.0).expect_err("no points");
    assert!(
        matches!(error, RegistrationError::TooFewPoints { .. }),
        "{error}"
    );
}

#[test]
fn bounds() {
    let (points, normals) = Lump::vertebra_sized().points(20);
    let center = Point3::origin();
    let error = pose_information(&points, &normals[..19], &center).expect_err("one is missing");
    assert_eq!(
        error,
        RegistrationError::NormalCountDiffers {
            n_points: 20,
            n_normals: 19
        }
    );
    let error = pose_information(&[], &[], &center).expect_err("nothing");
    assert_eq!(
        error,
        RegistrationError::TooFewPoints {
            n_points: 0,
            n_needed: 1
        }
    );
    let nan = Point3::new(f64::NAN, 0.0, 0.0);
    let error = pose_information(&points, &normals, &nan).expect_err("no centre");
    assert!(
        matches!(
            error,
            RegistrationError::NonFinitePoint { set: "center", .. }
        ),
        "{error}"
    );
    let error = cramer_rao_bound(&points[..5], &normals[..5], &center, 1.0).expect_err("five");
    assert_eq!(
        error,
        RegistrationError::TooFewPoints {
            n_points: 5,
            n_needed: 6
        }
    );
    for noise in [-1.0, f64::NAN, f64::INFINITY] {
        let error = cramer_rao_bound(&points, &normals, &center, noise).expect_err("bad noise");
        assert!(
            matches!(error, RegistrationError::OptionOutOfRange { .. }),
            "{error}"
        );
    }
    let mut flat = normals;
    flat[4] = Vector3::zeros();
    let error = cramer_rao_bound(&points, &flat, &center, 1.0).expect_err("no direction");
    assert!(
        matches!(error, RegistrationError::BadNormal { index: 4, .. }),
        "{error}"
    );
}
