use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use pedicle_registration::{RegistrationError, kabsch, pose_error};
use proptest::prelude::*;

use crate::shapes::{Lump, in_cube, noise, pose, rng};

fn carried(pose: &Isometry3<f64>, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    points.iter().map(|p| pose * p).collect()
}

fn determinant(pose: &Isometry3<f64>) -> f64 {
    pose.rotation.to_rotation_matrix().matrix().determinant()
}

fn sum_of_squares(pose: &Isometry3<f64>, s: &[Point3<f64>], q: &[Point3<f64>]) -> f64 {
    s.iter()
        .zip(q)
        .map(|(s, q)| (pose * s - q).norm_squared())
        .sum()
}

#[test]
fn exact_pairs_give_the_exact_pose_at_every_scale() {
    let mut rng = rng(1);
    for scale in [1e-3, 1.0, 1e3] {
        for n in [3, 4, 10, 300] {
            for _ in 0..20 {
                let points: Vec<_> = (0..n)
                    .map(|_| in_cube(&mut rng, &Point3::origin(), 40.0 * scale))
                    .collect();
                let mut truth = pose(&mut rng);
                truth.translation.vector *= scale;
                let target = carried(&truth, &points);
                let found = kabsch(&points, &target, None).expect("points in general position");
                let error = pose_error(&found, &truth, &points[0]);
                assert!(
                    error.rotation_rad < 1e-12,
                    "{n} points: {} rad",
                    error.rotation_rad
                );
                let relative = error.translation_mm / (300.0 * scale);
                assert!(relative < 1e-12, "{n} points, scale {scale}: {relative}");
                assert!((determinant(&found) - 1.0).abs() < 1e-12, "not a rotation");
            }
        }
    }
}

#[test]
fn flat_points_have_a_pose() {
    let mut rng = rng(2);
    let points: Vec<_> = (0..50)
        .map(|_| in_cube(&mut rng, &Point3::origin(), 30.0))
        .map(|p| Point3::new(p.x, p.y, 0.0))
        .collect();
    let truth = pose(&mut rng);
    let found = kabsch(&points, &carried(&truth, &points), None).expect("a plane is enough");
    let error = pose_error(&found, &truth, &Point3::origin());
    assert!(error.rotation_rad < 1e-12, "{} rad", error.rotation_rad);
}

#[test]
fn thin_points_lose_no_more_than_their_thinness() {
    let mut rng = rng(3);
    let points: Vec<_> = (0..50)
        .map(|_| in_cube(&mut rng, &Point3::origin(), 30.0))
        .map(|p| Point3::new(p.x, 1e-3 * p.y, 1e-3 * p.z))
        .collect();
    let truth = pose(&mut rng);
    let found = kabsch(&points, &carried(&truth, &points), None).expect("thin, but no line");
    let error = pose_error(&found, &truth, &Point3::origin());
    assert!(error.rotation_rad < 1e-8, "{} rad", error.rotation_rad);
}

#[test]
fn mirrored_points_give_a_proper_rotation_no_worse_than_any_other() {
    let mut rng = rng(4);
    for _ in 0..50 {
        let points: Vec<_> = (0..20)
            .map(|_| in_cube(&mut rng, &Point3::origin(), 30.0))
            .collect();
        let mirrored: Vec<_> = points.iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        let target = carried(&pose(&mut rng), &mirrored);
        let found = kabsch(&points, &target, None).expect("points without symmetry");
        assert!(
            (determinant(&found) - 1.0).abs() < 1e-12,
            "determinant {}",
            determinant(&found)
        );
        let best = sum_of_squares(&found, &points, &target);
        for angle in [1e-3, 0.1, 1.0] {
            for _ in 0..20 {
                let turn = Isometry3::rotation(noise(&mut rng, 1.0).normalize() * angle);
                let turned: Vec<_> = carried(&turn, &points);
                let center = |p: &[Point3<f64>]| {
                    p.iter().map(|p| p.coords).sum::<Vector3<f64>>() / p.len() as f64
                };
                let shift = center(&target) - found.rotation * center(&turned);
                let other = Isometry3::from_parts(shift.into(), found.rotation) * turn;
                let cost = sum_of_squares(&other, &points, &target);
                assert!(
                    cost >= best - 1e-9 * best,
                    "a turn by {angle} fits better: {cost} < {best}"
                );
            }
        }
    }
}

#[test]
fn agrees_with_the_singular_value_form() {
    // Umeyama: R = U diag(1, 1, det U Vᵀ) Vᵀ of Σ q sᵀ.
    let mut rng = rng(6);
    let (points, _) = Lump::vertebra_sized().points(100);
    let truth = pose(&mut rng);
    let target: Vec<_> = points
        .iter()
        .map(|p| truth * p + noise(&mut rng, 2.0))
        .collect();
    let center = |p: &[Point3<f64>]| p.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 100.0;
    let (cs, cq) = (center(&points), center(&target));
    let sum: Matrix3<f64> = points
        .iter()
        .zip(&target)
        .map(|(s, q)| (q.coords - cq) * (s.coords - cs).transpose())
        .sum();
    let svd = sum.svd_unordered(true, true);
    let rotation = svd.u.expect("asked for") * svd.v_t.expect("asked for");
    let found = kabsch(&points, &target, None).expect("points in general position");
    let gap = (found.rotation.to_rotation_matrix().matrix() - rotation).amax();
    assert!(gap < 1e-10, "rotations differ by {gap}");
}

#[test]
fn weights_act_like_repeated_points() {
    let mut rng = rng(7);
    let points: Vec<_> = (0..10)
        .map(|_| in_cube(&mut rng, &Point3::origin(), 30.0))
        .collect();
    let target: Vec<_> = points.iter().map(|p| p + noise(&mut rng, 3.0)).collect();
    let weights: Vec<f64> = (0..10).map(|i| f64::from(i % 3 + 1)).collect();
    let repeated = |p: &[Point3<f64>]| -> Vec<Point3<f64>> {
        (0..10).flat_map(|i| vec![p[i]; i % 3 + 1]).collect()
    };
    let expected = kabsch(&repeated(&points), &repeated(&target), None).expect("general position");
    for factor in [1e-300, 1.0, 1e300] {
        let scaled: Vec<f64> = weights.iter().map(|w| w * factor).collect();
        let found = kabsch(&points, &target, Some(&scaled)).expect("general position");
        let error = pose_error(&found, &expected, &points[0]);
        assert!(
            error.translation_mm < 1e-12 && error.rotation_rad < 1e-13,
            "{error:?}"
        );
    }
}

#[test]
fn far_from_the_origin_only_the_digits_of_the_coordinates_are_lost() {
    let mut rng = rng(8);
    let far = Point3::new(1e6, -2e6, 3e6);
    let points: Vec<_> = (0..50).map(|_| in_cube(&mut rng, &far, 30.0)).collect();
    let shift = Isometry3::translation(5.0, -4.0, 3.0);
    let found = kabsch(&points, &carried(&shift, &points), None).expect("general position");
    let error = pose_error(&found, &shift, &far);
    assert!(
        error.translation_mm < 1e-8 && error.rotation_rad < 1e-10,
        "{error:?}"
    );
}

#[test]
fn lines_and_single_places_are_refused() {
    let line: Vec<_> = (0..9)
        .map(|i| Point3::new(1.0, 2.0, 3.0) + Vector3::new(0.3, 0.5, -0.7) * f64::from(i))
        .collect();
    let place = vec![Point3::new(1e3, 2.0, -3.0); 9];
    let (spread, _) = Lump::vertebra_sized().points(9);
    for (s, q) in [
        (&line, &line),
        (&place, &place),
        (&spread, &line),
        (&place, &spread),
    ] {
        let error = kabsch(s, q, None).expect_err("no rotation is determined");
        assert!(
            matches!(error, RegistrationError::RotationUndetermined { .. }),
            "{error}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn swapping_source_and_target_inverts(seed in 0_u64..1_000_000, n in 3_usize..30) {
        let mut rng = rng(seed);
        let points: Vec<_> = (0..n).map(|_| in_cube(&mut rng, &Point3::origin(), 30.0)).collect();
        let truth = pose(&mut rng);
        let target: Vec<_> = points.iter().map(|p| truth * p + noise(&mut rng, 1.0)).collect();
        if let (Ok(there), Ok(back)) = (kabsch(&points, &target, None), kabsch(&target, &points, None)) {
            let error = pose_error(&(back * there), &Isometry3::identity(), &points[0]);
            prop_assert!(error.translation_mm < 1e-9 && error.rotation_rad < 1e-10, "{:?}", error);
            prop_assert!((determinant(&there) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn any_numbers_give_a_finite_pose_or_an_error(values in prop::collection::vec(any::<f64>(), 18..60)) {
        let points: Vec<_> = values.chunks_exact(3).map(|c| Point3::new(c[0], c[1], c[2])).collect();
        let half = points.len() / 2;
        if let Ok(pose) = kabsch(&points[..half], &points[half..2 * half], None) {
            prop_assert!(pose.rotation.coords.iter().all(|x| x.is_finite()));
        }
    }
}
