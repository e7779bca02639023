use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_registration::{
    PointSurface, ReferenceSurface, RefineOptions, Refinement, RegistrationError, RobustKernel,
    SurfaceHit, Termination, pose_error, refine_on_surface, robust_cost,
};
use proptest::prelude::*;

use crate::shapes::{Lump, in_cube, motion, noise, normal, pose, rng};

struct Case {
    lump: Lump,
    target: Vec<Point3<f64>>,
    truth: Isometry3<f64>,
    start: Isometry3<f64>,
}

/// `n` points of the lump, carried away, with scattered points added; started 10° and 5 mm off.
fn case(seed: u64, n: usize, n_wrong: usize, sigma_mm: f64) -> Case {
    let mut rng = rng(seed);
    let lump = Lump::vertebra_sized();
    let truth = pose(&mut rng);
    let (points, _) = lump.points(n);
    let mut target: Vec<_> = points
        .iter()
        .map(|p| truth * p + noise(&mut rng, sigma_mm))
        .collect();
    let middle = truth * Point3::origin();
    target.extend((0..n_wrong).map(|_| in_cube(&mut rng, &middle, 30.0)));
    let start = truth * motion(&mut rng, 10_f64.to_radians(), 5.0);
    Case {
        lump,
        target,
        truth,
        start,
    }
}

fn refine(case: &Case, options: &RefineOptions) -> Refinement {
    refine_on_surface(&case.lump, &case.target, &case.start, options).expect("a sound case")
}

#[test]
fn exact_points_are_met_to_rounding() {
    for seed in 0..30 {
        let case = case(seed, 200, 0, 0.0);
        let found = refine(&case, &RefineOptions::default());
        let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
        assert!(error.translation_mm < 1e-9, "seed {seed}: {error:?}");
        assert!(error.rotation_rad < 1e-10, "seed {seed}: {error:?}");
        assert_eq!(found.termination, Termination::Converged, "seed {seed}");
        assert!(
            found.iterations <= 14,
            "seed {seed} took {} iterations",
            found.iterations
        );
        assert_eq!(found.n_inliers, 200, "all points are inliers");
        assert!(
            found.noise_mm < 1e-9 && found.rmse_mm < 1e-9,
            "noise {}",
            found.noise_mm
        );
    }
}

#[test]
fn exact_points_are_met_to_rounding_among_thirty_per_cent_of_outliers() {
    for kernel in [RobustKernel::Tukey, RobustKernel::GemanMcClure] {
        for seed in 0..20 {
            let case = case(100 + seed, 210, 90, 0.0);
            let found = refine(
                &case,
                &RefineOptions {
                    kernel,
                    ..RefineOptions::default()
                },
            );
            let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
            assert!(
                error.translation_mm < 1e-9,
                "{kernel:?}, seed {seed}: {error:?}"
            );
            assert_eq!(
                found.termination,
                Termination::Converged,
                "{kernel:?}, seed {seed}"
            );
            let right = found.inliers[..210].iter().filter(|i| **i).count();
            let wrong = found.inliers[210..].iter().filter(|i| **i).count();
            assert!(
                right >= 205 && wrong <= 1,
                "{kernel:?}: {right} right, {wrong} wrong inliers"
            );
        }
    }
}

#[test]
fn a_posterior_half_is_enough() {
    for seed in 0..20 {
        let mut case = case(200 + seed, 400, 0, 0.0);
        let truth = case.truth;
        case.target
            .retain(|p| truth.inverse_transform_point(p).y < 0.0);
        let found = refine(&case, &RefineOptions::default());
        let error = pose_error(&found.target_from_source, &truth, &Point3::origin());
        assert!(error.translation_mm < 1e-9, "seed {seed}: {error:?}");
    }
}

#[test]
fn noise_is_measured() {
    for sigma in [0.1, 0.5, 1.0] {
        let case = case(300, 400, 100, sigma);
        let found = refine(&case, &RefineOptions::default());
        assert!(
            (found.noise_mm / sigma - 1.0).abs() < 0.2,
            "σ = {sigma}: {}",
            found.noise_mm
        );
        assert!(
            (found.rmse_mm / sigma - 1.0).abs() < 0.2,
            "σ = {sigma}: {}",
            found.rmse_mm
        );
        let expected = found.covariance.translation_mm();
        let center = case.truth.inverse_transform_point(&found.covariance.center);
        let error = pose_error(&found.target_from_source, &case.truth, &center);
        assert!(
            error.translation_mm < 3.5 * expected,
            "{error:?}, expected {expected}"
        );
    }
}

#[test]
fn points_and_normals_serve_as_a_surface() {
    let case = case(400, 300, 60, 0.0);
    let (points, normals) = case.lump.points(300);
    let surface = PointSurface::new(&points, &normals).expect("valid points");
    let start = case.truth * motion(&mut rng(1), 0.05, 1.0);
    let found = refine_on_surface(&surface, &case.target, &start, &RefineOptions::default())
        .expect("a sound case");
    let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
    assert!(
        error.translation_mm < 1e-9 && error.rotation_rad < 1e-10,
        "{error:?}"
    );
}

#[test]
fn a_coarse_point_surface_still_ends_near() {
    let mut rng = rng(2);
    let case = case(401, 300, 0, 0.3);
    let (points, normals) = case.lump.points(1700);
    let surface = PointSurface::new(&points, &normals).expect("valid points");
    for _ in 0..10 {
        let start = case.truth * motion(&mut rng, 0.1, 2.0);
        let found = refine_on_surface(&surface, &case.target, &start, &RefineOptions::default())
            .expect("a sound case");
        let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
        assert!(
            error.translation_mm < 0.15 && error.rotation_rad < 0.015,
            "{error:?}"
        );
    }
}

#[test]
fn equal_input_gives_equal_bits_whatever_the_sign_of_the_normals() {
    struct Inside(Lump);
    impl ReferenceSurface for Inside {
        fn closest(&self, point: &Point3<f64>) -> SurfaceHit {
            let hit = self.0.closest(point);
            SurfaceHit {
                normal: -hit.normal,
                ..hit
            }
        }
    }
    let case = case(500, 150, 40, 0.5);
    let first = refine(&case, &RefineOptions::default());
    assert_eq!(
        first,
        refine(&case, &RefineOptions::default()),
        "the same input"
    );
    let inside = Inside(case.lump);
    let other = refine_on_surface(
        &inside,
        &case.target,
        &case.start,
        &RefineOptions::default(),
    )
    .expect("a sound case");
    assert_eq!(
        first.target_from_source, other.target_from_source,
        "the sign of a normal"
    );
}

#[test]
fn the_answer_scales_with_the_data() {
    for scale in [1e-3, 1e3] {
        let mut case = case(600, 200, 50, 0.4);
        let reference = refine(&case, &RefineOptions::default());
        case.lump.axes_mm *= scale;
        case.truth.translation.vector *= scale;
        case.start.translation.vector *= scale;
        for p in &mut case.target {
            p.coords *= scale;
        }
        let options = RefineOptions {
            max_distance_mm: 6.0 * scale,
            start_distance_mm: Some(12.0 * scale),
            ..RefineOptions::default()
        };
        let found = refine(&case, &options);
        assert_eq!(found.inliers, reference.inliers, "inliers at scale {scale}");
        assert_eq!(
            found.iterations, reference.iterations,
            "iterations at scale {scale}"
        );
        assert!(
            (found.noise_mm / scale - reference.noise_mm).abs() < 1e-6,
            "noise at {scale}"
        );
        let (a, b) = (found.covariance, reference.covariance);
        assert!(
            (a.translation_mm() / scale / b.translation_mm() - 1.0).abs() < 1e-6,
            "bound"
        );
        assert!(
            (a.rotation_rad() / b.rotation_rad() - 1.0).abs() < 1e-6,
            "bound at {scale}"
        );
    }
}

#[test]
fn stray_points_far_away_change_nothing() {
    let mut case = case(700, 200, 0, 0.0);
    case.target
        .extend((0..20).map(|i| Point3::new(1e7, f64::from(i) * 1e6, -1e7)));
    let found = refine(&case, &RefineOptions::default());
    let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
    assert!(
        error.translation_mm < 1e-9 && error.rotation_rad < 1e-10,
        "{error:?}"
    );
    assert_eq!(found.n_inliers, 200, "strays are no inliers");
}

#[test]
fn iterations_are_bounded_and_recorded() {
    let case = case(800, 200, 0, 0.0);
    let found = refine(
        &case,
        &RefineOptions {
            max_iterations: 2,
            ..RefineOptions::default()
        },
    );
    assert_eq!(
        (found.termination, found.iterations),
        (Termination::MaxIterations, 2),
        "two steps"
    );
    assert_eq!(found.history.len(), 3, "two steps and the look at the end");
    let found = refine(&case, &RefineOptions::default());
    assert!(
        (found.history[0].gate_mm - 12.0).abs() < 1e-12,
        "first gate"
    );
    assert!(
        (found.history.last().expect("history").gate_mm - 6.0).abs() < 1e-12,
        "last gate"
    );
}

/// The plane z = 0.
struct Plane;

impl ReferenceSurface for Plane {
    fn closest(&self, p: &Point3<f64>) -> SurfaceHit {
        SurfaceHit::new(p, Point3::new(p.x, p.y, 0.0), Vector3::z())
    }
}

/// The unit sphere times 20.
struct Sphere;

impl ReferenceSurface for Sphere {
    fn closest(&self, p: &Point3<f64>) -> SurfaceHit {
        let n = p.coords.normalize();
        SurfaceHit::new(p, Point3::from(n * 20.0), n)
    }
}

/// A surface that answers NaN on one side.
struct Broken(Lump);

impl ReferenceSurface for Broken {
    fn closest(&self, p: &Point3<f64>) -> SurfaceHit {
        let hit = self.0.closest(p);
        if p.x > 12.0 {
            SurfaceHit {
                normal: Vector3::repeat(f64::NAN),
                ..hit
            }
        } else {
            hit
        }
    }
}

#[test]
fn planes_and_spheres_are_refused() {
    let mut rng = rng(9);
    let flat: Vec<_> = (0..100)
        .map(|_| {
            let p = in_cube(&mut rng, &Point3::origin(), 20.0);
            Point3::new(p.x, p.y, 0.1 * normal(&mut rng))
        })
        .collect();
    let start = Isometry3::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.02, 0.01, 0.1));
    let options = RefineOptions::default();
    let error = refine_on_surface(&Plane, &flat, &start, &options).expect_err("a plane slides");
    assert!(
        matches!(error, RegistrationError::Degenerate { .. }),
        "{error}"
    );
    let round: Vec<_> = (0..100)
        .map(|_| Point3::from(noise(&mut rng, 1.0).normalize() * 20.0))
        .collect();
    let error = refine_on_surface(&Sphere, &round, &start, &options).expect_err("a sphere turns");
    assert!(
        matches!(error, RegistrationError::Degenerate { .. }),
        "{error}"
    );
}

#[test]
fn a_surface_that_answers_nan_costs_only_those_points() {
    let case = case(900, 300, 0, 0.0);
    let found = refine_on_surface(
        &Broken(case.lump),
        &case.target,
        &case.start,
        &RefineOptions::default(),
    )
    .expect("the other side is enough");
    let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
    assert!(error.translation_mm < 1e-8, "{error:?}");
}

#[test]
fn points_out_of_reach_are_an_error() {
    let mut case = case(1000, 100, 0, 0.0);
    case.start.translation.vector += Vector3::new(500.0, 0.0, 0.0);
    let error = refine_on_surface(
        &case.lump,
        &case.target,
        &case.start,
        &RefineOptions::default(),
    )
    .expect_err("nothing is near");
    assert!(
        matches!(
            error,
            RegistrationError::TooFewWithinReach { n_within: 0, .. }
        ),
        "{error}"
    );
}

#[test]
fn the_score_prefers_the_truth() {
    let case = case(1100, 200, 50, 0.0);
    let score = |pose| robust_cost(&case.lump, &case.target, pose, 3.0).expect("a sound case");
    let (at_truth, at_start) = (score(&case.truth), score(&case.start));
    assert!(at_truth.cost < at_start.cost, "{at_truth:?} {at_start:?}");
    assert!((0.8..0.95).contains(&at_truth.explained), "{at_truth:?}");
    assert!(at_truth.cost <= 0.2 && at_truth.cost > 0.05, "{at_truth:?}");
    let far = score(&(case.truth * Isometry3::translation(1e4, 0.0, 0.0)));
    assert!(
        (far.cost - 1.0).abs() < 1e-15 && far.explained <= 0.0,
        "{far:?}"
    );
    let exact = robust_cost(&case.lump, &case.target[..200], &case.truth, 3.0).expect("sound");
    assert!(exact.cost < 1e-20 && exact.rmse_mm < 1e-9, "{exact:?}");
    assert!((exact.explained - 1.0).abs() < 1e-15, "{exact:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn moving_the_target_moves_the_pose(seed in 0_u64..100_000) {
        let case = case(seed, 120, 30, 0.3);
        let options = RefineOptions { noise_tolerance: 1e-9, ..RefineOptions::default() };
        let found = refine(&case, &options);
        let carry = pose(&mut rng(seed + 1));
        let target: Vec<_> = case.target.iter().map(|p| carry * p).collect();
        let moved = refine_on_surface(&case.lump, &target, &(carry * case.start), &options)
            .expect("a sound case");
        let expected = carry * found.target_from_source;
        // The two middles of the points differ, and with them the path, not the end.
        let error = pose_error(&moved.target_from_source, &expected, &Point3::origin());
        prop_assert!(error.translation_mm < 1e-2 && error.rotation_rad < 1e-3, "{:?}", error);
    }
}
