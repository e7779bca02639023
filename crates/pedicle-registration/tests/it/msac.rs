use nalgebra::{Isometry3, Point3};
use pedicle_registration::{
    Msac, MsacOptions, MsacTermination, RegistrationError, kabsch, msac, pose_error,
};
use proptest::prelude::*;
use rand::RngExt;

use crate::shapes::{Lump, in_cube, noise, pose, rng};

struct Case {
    source: Vec<Point3<f64>>,
    target: Vec<Point3<f64>>,
    is_right: Vec<bool>,
    truth: Isometry3<f64>,
}

/// Pairs on the lump of which a share is scattered over its box.
fn case(seed: u64, share_wrong: f64, sigma_mm: f64) -> Case {
    let mut rng = rng(seed);
    let (source, _) = Lump::vertebra_sized().points(300);
    let truth = pose(&mut rng);
    let middle = truth * Point3::origin();
    let is_right: Vec<bool> = source
        .iter()
        .map(|_| rng.random_range(0.0..1.0) >= share_wrong)
        .collect();
    let target = source
        .iter()
        .zip(&is_right)
        .map(|(p, right)| {
            if *right {
                truth * p + noise(&mut rng, sigma_mm)
            } else {
                in_cube(&mut rng, &middle, 30.0)
            }
        })
        .collect();
    Case {
        source,
        target,
        is_right,
        truth,
    }
}

fn run(case: &Case, options: &MsacOptions) -> Msac {
    msac(&case.source, &case.target, options).expect("there is a consensus")
}

#[test]
fn half_of_the_pairs_may_be_wrong() {
    for seed in 0..20 {
        let case = case(seed, 0.5, 0.0);
        let found = run(
            &case,
            &MsacOptions {
                seed,
                ..MsacOptions::default()
            },
        );
        // Scattered points that happen to lie within reach join the fit, so the pose is near, and
        // the fit to the right pairs exact.
        let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
        assert!(
            error.translation_mm < 0.1 && error.rotation_rad < 0.01,
            "seed {seed}: {error:?}"
        );
        let missed = found
            .inliers
            .iter()
            .zip(&case.is_right)
            .filter(|(i, r)| **r && !**i)
            .count();
        assert_eq!(missed, 0, "every right pair is an inlier");
        assert_eq!(
            found.n_inliers,
            found.inliers.iter().filter(|i| **i).count(),
            "counts differ"
        );
        assert_eq!(
            found.termination,
            MsacTermination::Confident,
            "half is easy"
        );
        assert!(found.n_trials < 100, "{} trials", found.n_trials);
    }
}

#[test]
fn four_fifths_of_the_pairs_may_be_wrong() {
    for seed in 0..10 {
        let case = case(100 + seed, 0.8, 0.2);
        let found = run(
            &case,
            &MsacOptions {
                seed,
                ..MsacOptions::default()
            },
        );
        let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
        assert!(
            error.translation_mm < 0.4 && error.rotation_rad < 0.04,
            "seed {seed}: {error:?}"
        );
    }
}

#[test]
fn clean_pairs_take_one_trial_and_are_exact() {
    let case = case(5, 0.0, 0.0);
    let found = run(&case, &MsacOptions::default());
    let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
    assert!(
        error.translation_mm < 1e-10 && error.rotation_rad < 1e-12,
        "{error:?}"
    );
    assert_eq!(
        (found.n_trials, found.n_inliers),
        (1, 300),
        "all pairs agree"
    );
    assert!(
        found.cost < 1e-20 && found.rmse_mm < 1e-10,
        "cost {}",
        found.cost
    );
}

#[test]
fn the_result_is_the_least_squares_fit_of_its_inliers() {
    let case = case(6, 0.3, 0.5);
    let found = run(
        &case,
        &MsacOptions {
            max_distance_mm: 2.0,
            ..MsacOptions::default()
        },
    );
    let pick = |points: &[Point3<f64>]| -> Vec<Point3<f64>> {
        points
            .iter()
            .zip(&found.inliers)
            .filter(|(_, i)| **i)
            .map(|(p, _)| *p)
            .collect()
    };
    let (s, q) = (pick(&case.source), pick(&case.target));
    let fit = kabsch(&s, &q, None).expect("many inliers");
    let error = pose_error(&found.target_from_source, &fit, &Point3::origin());
    assert!(
        error.translation_mm < 1e-10 && error.rotation_rad < 1e-12,
        "{error:?}"
    );
    let sum: f64 = s
        .iter()
        .zip(&q)
        .map(|(s, q)| (fit * s - q).norm_squared())
        .sum();
    assert!(
        (found.rmse_mm - (sum / s.len() as f64).sqrt()).abs() < 1e-10,
        "rmse {}",
        found.rmse_mm
    );
    let cost = (sum / 4.0 + (300 - s.len()) as f64) / 300.0;
    assert!(
        (found.cost - cost).abs() < 1e-12,
        "cost {} is not {cost}",
        found.cost
    );
}

#[test]
fn equal_seeds_give_equal_bits_and_other_seeds_the_same_answer() {
    let case = case(7, 0.4, 0.5);
    let options = MsacOptions {
        max_distance_mm: 2.0,
        ..MsacOptions::default()
    };
    let first = run(&case, &options);
    assert_eq!(first, run(&case, &options), "the same seed");
    let other = run(
        &case,
        &MsacOptions {
            seed: 99,
            ..options
        },
    );
    let error = pose_error(
        &first.target_from_source,
        &other.target_from_source,
        &Point3::origin(),
    );
    assert!(
        error.translation_mm < 0.1 && error.rotation_rad < 0.01,
        "{error:?}"
    );
}

#[test]
fn the_answer_scales_with_the_data() {
    for scale in [1e-3, 1e3] {
        let mut scaled = case(8, 0.4, 0.2);
        let reference = run(&scaled, &MsacOptions::default());
        for p in scaled.source.iter_mut().chain(&mut scaled.target) {
            p.coords *= scale;
        }
        let options = MsacOptions {
            max_distance_mm: 1.5 * scale,
            ..MsacOptions::default()
        };
        let found = run(&scaled, &options);
        assert_eq!(found.inliers, reference.inliers, "inliers at scale {scale}");
        assert!(
            (found.cost - reference.cost).abs() < 1e-9,
            "cost at scale {scale}"
        );
        assert!(
            (found.rmse_mm / scale - reference.rmse_mm).abs() < 1e-9,
            "rmse at scale {scale}"
        );
    }
}

#[test]
fn repeated_source_points_only_cost_draws() {
    // A functional map sends many target vertices to the same source vertex.
    let mut case = case(9, 0.0, 0.0);
    for i in 0..300 {
        let kept = (i / 100) * 100 + i % 4;
        case.source[i] = case.source[kept];
        case.target[i] = case.target[kept];
    }
    let found = run(&case, &MsacOptions::default());
    let error = pose_error(&found.target_from_source, &case.truth, &Point3::origin());
    assert!(
        error.translation_mm < 1e-9 && error.rotation_rad < 1e-10,
        "{error:?}"
    );
}

#[test]
fn a_line_has_no_consensus_and_ends() {
    let line: Vec<_> = (0..50)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    let error = msac(&line, &line, &MsacOptions::default()).expect_err("a line has no rotation");
    assert!(
        matches!(error, RegistrationError::NoConsensus { n_inliers: 0, .. }),
        "{error}"
    );
}

#[test]
fn scattered_pairs_do_not_reach_the_wanted_number_of_inliers() {
    let case = case(10, 1.0, 0.0);
    let options = MsacOptions {
        min_inliers: 30,
        ..MsacOptions::default()
    };
    let error = msac(&case.source, &case.target, &options).expect_err("nothing agrees");
    let RegistrationError::NoConsensus {
        n_inliers,
        n_needed,
        n_trials,
    } = error
    else {
        panic!("unexpected {error}");
    };
    assert!((1..30).contains(&n_inliers), "{n_inliers} inliers");
    assert_eq!((n_needed, n_trials), (30, 1000), "all trials were used");
    // A symmetric result may still be asked for: it says that it is not confident.
    let found = run(&case, &MsacOptions::default());
    assert_eq!(
        found.termination,
        MsacTermination::MaxTrials,
        "no confidence"
    );
    assert!(found.cost > 0.9, "cost {}", found.cost);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(30))]

    #[test]
    fn swapping_source_and_target_inverts(seed in 0_u64..1_000_000) {
        let case = case(seed, 0.4, 0.1);
        let options = MsacOptions { seed, ..MsacOptions::default() };
        let there = run(&case, &options);
        let back = msac(&case.target, &case.source, &options).expect("there is a consensus");
        let around = back.target_from_source * there.target_from_source;
        let error = pose_error(&around, &Isometry3::identity(), &Point3::origin());
        prop_assert!(error.translation_mm < 1e-9 && error.rotation_rad < 1e-10, "{:?}", error);
        prop_assert_eq!(there.inliers, back.inliers);
    }
}
