//! The suites with meshes: triangulation, motion in the discs, and what is wrong under stress.

use nalgebra::Point3;
use pedicle_mesh::SurfaceIndex;
use pedicle_simulation::{
    Deformation, MotionRange, Scenario, Stress, Suite, SuiteCell, SuiteScenario, SuiteTarget,
    TargetSurface, simulate, simulate_suite, subject_seed, suite_scenarios,
};
use pedicle_trajectory::Level;

use crate::mean_case;

fn run(cell: SuiteCell, draw: u32) -> SuiteTarget {
    let scenario = SuiteScenario {
        cell,
        draw,
        seed: 11,
    };
    simulate_suite(mean_case(), &scenario).unwrap()
}

fn stressed(stress: Stress, draw: u32) -> SuiteTarget {
    let noise_mm = 0.5;
    run(SuiteCell::Stress { stress, noise_mm }, draw)
}

fn landmark(target: &SuiteTarget, level: Level) -> Option<Point3<f64>> {
    target
        .target_landmarks
        .landmark(level)
        .map(|l| l.position_mm)
}

/// Where the tip of a vertebra's spinous process truly is.
fn true_landmark(target: &SuiteTarget, level: Level) -> Point3<f64> {
    let source = target.source_landmarks.landmark(level).unwrap().position_mm;
    target.truth[level.index()].vertebra.target_from_source * source
}

#[test]
fn every_suite_has_its_cells_with_names_of_their_own() {
    let n = Suite::ALL.map(|suite| suite.cells().len());
    assert_eq!(n, [9, 12, 9, 18, 15], "cells of each suite");
    for suite in Suite::ALL {
        let mut names: Vec<String> = suite.cells().iter().map(ToString::to_string).collect();
        assert_eq!(
            suite_scenarios(suite, 1, 3).len(),
            3 * names.len(),
            "{suite}"
        );
        let n = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), n, "two cells of {suite} have one name");
    }
    assert_ne!(subject_seed(1, 0), subject_seed(1, 1), "subjects differ");
    assert_ne!(subject_seed(1, 0), subject_seed(2, 0), "cohorts differ");
}

#[test]
fn the_published_scenarios_are_the_same_in_both_ways() {
    let deformation = Deformation::Partial;
    let (noise_mm, draw, seed) = (0.5, 2, 11);
    let suite = run(
        SuiteCell::Paper {
            deformation,
            noise_mm,
        },
        draw,
    );
    let paper = Scenario {
        deformation,
        noise_mm,
        draw,
        seed,
    };
    let paper = simulate(mean_case(), &paper).unwrap();
    assert_eq!(suite.surface, TargetSurface::Mesh(paper.mesh), "bit by bit");
    assert_eq!(suite.target_landmarks, paper.target_landmarks, "landmarks");
    for (a, b) in suite.truth.iter().zip(&paper.truth) {
        assert_eq!(&a.vertebra, b, "{}", b.level);
        assert!(a.present && a.posterior_seen > 0.85, "{}", a.posterior_seen);
    }
}

#[test]
fn a_resampled_target_lies_on_the_surface_and_shares_no_vertex_with_it() {
    let case = mean_case();
    let mut counts = Vec::new();
    for (draw, deformation) in Deformation::ALL.into_iter().enumerate() {
        let cell = SuiteCell::Resampled {
            deformation,
            noise_mm: 0.0,
        };
        let target = run(cell, draw as u32);
        let mesh = target.surface.mesh().unwrap();
        assert!(
            pedicle_mesh::non_manifold_edges(mesh).is_empty(),
            "{deformation}"
        );
        counts.push(mesh.n_vertices());
        let mut told = 0;
        for (truth, vertebra) in target.truth.iter().zip(case.vertebrae()) {
            let truth = &truth.vertebra;
            let index = SurfaceIndex::new(&vertebra.surface).unwrap();
            let back = truth.target_from_source.inverse();
            let mut least = f64::INFINITY;
            for (p, &v) in truth.target_points.iter().zip(&truth.target_vertices) {
                let shown = mesh.vertices()[v as usize];
                assert!((shown - p).norm() < 1e-9, "without noise: {shown} and {p}");
                let q = back * p;
                let distance = index.closest_point(&q).distance_mm;
                assert!(distance < 1e-9, "{} is off by {distance} mm", truth.level);
                for s in vertebra.surface.vertices() {
                    least = least.min((s - q).norm());
                }
            }
            assert!(
                least > 1e-4,
                "{}: {least} mm from a source vertex",
                truth.level
            );
            told += truth.target_points.len();
        }
        assert_eq!(told, mesh.n_vertices(), "every vertex is told");
    }
    let source: usize = case.vertebrae().iter().map(|v| v.mesh.n_vertices()).sum();
    counts.push(source);
    counts.sort_unstable();
    counts.dedup();
    assert_eq!(
        counts.len(),
        4,
        "three targets and the source differ: {counts:?}"
    );
}

#[test]
fn discs_move_within_their_limits_about_their_centres() {
    let case = mean_case();
    let centers = case.disc_centers();
    assert_eq!(centers.len(), 4, "between five vertebrae");
    for (range, limit_deg, reach_mm) in [
        // Three angles, the largest 8°, 8° and 2°.
        (MotionRange::Physiological, 11.6, 2.0),
        (MotionRange::Fifteen, 15.0, 5.0),
        (MotionRange::TwentyFive, 25.0, 5.0),
    ] {
        let mut largest = (0.0_f64, 0.0_f64);
        for draw in 0..12 {
            let noise_mm = 0.5;
            let target = run(SuiteCell::Motion { range, noise_mm }, draw);
            for (i, center) in centers.iter().enumerate() {
                let [upper, lower] =
                    [i, i + 1].map(|v| target.truth[v].vertebra.target_from_source);
                let motion = lower.inverse() * upper;
                let angle = motion.rotation.angle().to_degrees();
                let shift = (motion * center - center).norm();
                assert!(angle <= limit_deg + 1e-6, "{range:?}: {angle}°");
                assert!(
                    shift <= reach_mm + 1e-6,
                    "{range:?}: {shift} mm at the disc"
                );
                largest = (largest.0.max(angle), largest.1.max(shift));
            }
        }
        assert!(
            largest.0 > 0.7 * limit_deg && largest.1 > 0.7 * reach_mm,
            "{range:?} fills its range: {largest:?}"
        );
    }
}

#[test]
fn disc_centres_lie_between_the_bodies() {
    let case = mean_case();
    let phantom = crate::mean_phantom();
    for (i, center) in case.disc_centers().iter().enumerate() {
        for v in [i, i + 1] {
            let index = SurfaceIndex::new(&case.vertebrae()[v].mesh).unwrap();
            let distance = index.signed_distance_mm(center);
            assert!((0.0..12.0).contains(&distance), "disc {i}: {distance} mm");
        }
        let behind = phantom.vertebrae[i].pedicles[0].isthmus_center.y;
        assert!(center.y > behind + 10.0, "in front of the pedicles");
    }
}

#[test]
fn landmarks_are_as_wrong_as_the_stress_says() {
    for draw in 0..6 {
        let off = stressed(Stress::LandmarksOff, draw);
        for level in Level::ALL {
            let error = (landmark(&off, level).unwrap() - true_landmark(&off, level)).norm();
            assert!((error - 10.0).abs() < 1e-9, "{level}: {error} mm");
        }
        let one = stressed(Stress::OneLandmark, draw);
        assert_eq!(one.target_landmarks.landmarks.len(), 1, "one in all");
        assert_eq!(one.source_landmarks.landmarks.len(), 5, "all are planned");
        let none = stressed(Stress::NoLandmark, draw);
        assert!(none.target_landmarks.landmarks.is_empty(), "none");

        let swapped = stressed(Stress::LandmarksSwapped, draw);
        // Which vertebra each landmark was touched on.
        let touched = touched_levels(&swapped);
        let wrong: Vec<(Level, Level)> = touched.into_iter().filter(|(a, b)| a != b).collect();
        assert_eq!(wrong.len(), 2, "two of five: {wrong:?}");
        assert_eq!(wrong[0], (wrong[1].1, wrong[1].0), "with each other");

        let shifted = stressed(Stress::LandmarksShifted, draw);
        let n = shifted.target_landmarks.landmarks.len();
        assert_eq!(n, if draw % 2 == 0 { 5 } else { 4 }, "the last one");
        let steps: Vec<i64> = touched_levels(&shifted)
            .into_iter()
            .map(|(name, on)| on.index() as i64 - name.index() as i64)
            .filter(|step| *step != 0)
            .collect();
        assert_eq!(steps.len(), 4, "four are touched on a neighbour");
        assert!(
            steps.iter().all(|s| *s == steps[0] && s.abs() == 1),
            "{steps:?}"
        );
    }
}

/// For every landmark its name and the vertebra whose tip it is nearest to.
fn touched_levels(target: &SuiteTarget) -> Vec<(Level, Level)> {
    target
        .target_landmarks
        .landmarks
        .iter()
        .map(|l| {
            let distance = |level: &Level| (true_landmark(target, *level) - l.position_mm).norm();
            let near = |a: &Level, b: &Level| distance(a).total_cmp(&distance(b));
            (l.level, Level::ALL.into_iter().min_by(near).unwrap())
        })
        .collect()
}

#[test]
fn what_is_missing_has_no_truth() {
    for (draw, level) in [
        (0, Level::L1),
        (1, Level::L3),
        (2, Level::L5),
        (3, Level::L1),
    ] {
        let target = stressed(Stress::LevelMissing, draw);
        for truth in &target.truth {
            let missing = truth.vertebra.level == level;
            assert_eq!(truth.present, !missing, "draw {draw}");
            assert_eq!(
                truth.vertebra.target_points.is_empty(),
                missing,
                "draw {draw}"
            );
        }
        // Its landmark is touched where it would be, or not at all.
        let touched = landmark(&target, level).is_some();
        assert_eq!(touched, draw < 3, "draw {draw}");
        let told: usize = target
            .truth
            .iter()
            .map(|t| t.vertebra.target_points.len())
            .sum();
        assert_eq!(told, target.surface.points().len(), "nothing else is there");
    }
    let other = stressed(Stress::OtherPatient, 0);
    assert!(other.truth.iter().all(|t| !t.present), "no pose is valid");
    assert!(other.surface.points().len() > 1000, "but there is a spine");
    assert_eq!(
        other.target_landmarks.landmarks.len(),
        5,
        "with its landmarks"
    );
}

#[test]
fn a_remnant_is_the_rear_third_or_less() {
    let target = stressed(Stress::Remnant, 0);
    for (truth, vertebra) in target.truth.iter().zip(mean_case().vertebrae()) {
        let n = truth.vertebra.target_points.len() as f64;
        assert!(n > 30.0, "{} keeps something", vertebra.level);
        let seen = truth.posterior_seen;
        assert!((0.3..0.8).contains(&seen), "{}: {seen}", vertebra.level);
    }
}

#[test]
fn a_scenario_gives_the_same_bytes_alone_in_any_order_and_on_any_thread() {
    let mut scenarios = Vec::new();
    for suite in [
        Suite::Resampled,
        Suite::Motion,
        Suite::Sensor,
        Suite::Stress,
    ] {
        scenarios.extend(suite_scenarios(suite, 9, 1).into_iter().step_by(5));
    }
    let forward: Vec<_> = scenarios
        .iter()
        .map(|s| simulate_suite(mean_case(), s).unwrap())
        .collect();
    let half = scenarios.len() / 2;
    let halves = [scenarios[..half].to_vec(), scenarios[half..].to_vec()];
    let handles = halves.map(|part| {
        std::thread::spawn(move || -> Vec<SuiteTarget> {
            let backward = part.iter().rev();
            backward
                .map(|s| simulate_suite(mean_case(), s).unwrap())
                .collect()
        })
    });
    let mut found = Vec::new();
    for handle in handles {
        found.extend(handle.join().unwrap().into_iter().rev());
    }
    for ((a, b), scenario) in found.iter().zip(&forward).zip(&scenarios) {
        assert_eq!(a, b, "{scenario}");
    }
    let other = SuiteScenario {
        seed: 10,
        ..scenarios[0]
    };
    let other = simulate_suite(mean_case(), &other).unwrap();
    assert_ne!(other.surface, forward[0].surface, "another seed");
}
