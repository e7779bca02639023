//! Following a moving phantom: accuracy, losing and finding, and what is refused.

use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use pedicle_registration::pose_error;
use pedicle_simulation::Deformation;
use pedicle_spine::{
    LostReason, SpineError, SpineTracker, TrackState, TrackedFrame, TrackerOptions,
};
use pedicle_trajectory::Level;

#[path = "../../examples/follow_frames/scene.rs"]
mod scene;
use scene::{Frame, MovingPhantom};

const N_POINTS: usize = 6000;
const NOISE_MM: f64 = 0.5;

fn phantom() -> &'static MovingPhantom {
    static PHANTOM: OnceLock<MovingPhantom> = OnceLock::new();
    PHANTOM.get_or_init(|| MovingPhantom::new(7).unwrap())
}

fn tracker() -> SpineTracker<'static> {
    let phantom = phantom();
    SpineTracker::from_poses(
        &phantom.model,
        &phantom.poses(0.0),
        TrackerOptions::default(),
    )
    .unwrap()
}

fn frame(time: usize, hidden: &[usize]) -> Frame {
    phantom().frame(time as f64, N_POINTS, NOISE_MM, hidden)
}

/// Every tracked vertebra within the limits; how many are tracked.
fn assert_right(found: &TrackedFrame, truth: &[Isometry3<f64>], what: &str) -> usize {
    let mut n = 0;
    for (vertebra, truth) in found.vertebrae.iter().zip(truth) {
        if vertebra.is_tracked() {
            let center = phantom().model.centroid(vertebra.level);
            let error = pose_error(&vertebra.target_from_source, truth, &center);
            let (mm, degrees) = (error.translation_mm, error.rotation_rad.to_degrees());
            assert!(
                mm < 0.5 && degrees < 1.0,
                "{what}, {}: {mm} mm {degrees}°",
                vertebra.level
            );
            assert!(vertebra.covariance.is_some(), "{what}: a covariance");
            n += 1;
        }
    }
    n
}

#[test]
fn twenty_frames_are_followed() {
    let mut tracker = tracker();
    for time in 1..=20 {
        let frame = frame(time, &[]);
        let found = tracker.update(&frame.points).unwrap();
        let n = assert_right(&found, &frame.truth, &format!("frame {time}"));
        assert_eq!(n, 5, "frame {time}: {found:?}");
        assert!((found.noise_mm - NOISE_MM).abs() < 0.1, "the noise is told");
    }
}

#[test]
fn a_covered_vertebra_is_lost_and_found_again() {
    let mut tracker = tracker();
    for time in 1..=14 {
        let is_covered = (5..9).contains(&time);
        let frame = frame(time, if is_covered { &[2] } else { &[] });
        let found = tracker.update(&frame.points).unwrap();
        let n = assert_right(&found, &frame.truth, &format!("frame {time}"));
        if is_covered {
            assert!(!found.vertebrae[2].is_tracked(), "frame {time}: not there");
            assert_eq!(n, 4, "frame {time}: the others are followed");
            assert_eq!(found.vertebrae[2].n_frames_lost, time - 4, "frames without");
        } else {
            assert_eq!(n, 5, "frame {time}: {:?}", found.vertebrae[2].state);
        }
    }
}

#[test]
fn what_teleports_is_lost_not_wrong() {
    let shift = |mm: f64| Translation3::from(Vector3::new(0.4, 0.2, 0.89).normalize() * mm);
    for mm in [12.0, 20.0, 36.0] {
        // One vertebra.
        let mut tracker = tracker();
        let mut poses = phantom().poses(0.0);
        poses[1] = shift(mm) * poses[1];
        for seed in 0..4 {
            let frame = phantom().frame_of(&poses, seed, (N_POINTS, NOISE_MM), &[]);
            let found = tracker.update(&frame.points).unwrap();
            assert_right(&found, &frame.truth, &format!("L2 moved {mm} mm"));
        }
    }
    for mm in [20.0, 36.0, 200.0] {
        let mut tracker = tracker();
        let poses: Vec<_> = phantom()
            .poses(0.0)
            .iter()
            .map(|pose| shift(mm) * pose)
            .collect();
        for seed in 0..4 {
            let frame = phantom().frame_of(&poses, seed, (N_POINTS, NOISE_MM), &[]);
            let found = tracker.update(&frame.points).unwrap();
            assert_right(&found, &frame.truth, &format!("spine moved {mm} mm"));
        }
    }
}

#[test]
fn a_spine_out_of_view_is_lost_until_it_comes_back() {
    let mut tracker = tracker();
    let away: Vec<Point3<f64>> = frame(1, &[])
        .points
        .iter()
        .map(|p| p + Vector3::new(500.0, 0.0, 0.0))
        .collect();
    let found = tracker.update(&away).unwrap();
    for vertebra in &found.vertebrae {
        let reason = LostReason::SpineJumped;
        assert_eq!(vertebra.state, TrackState::Lost { reason }, "out of view");
        assert!(vertebra.covariance.is_none(), "nothing is known");
    }
    let back = frame(1, &[]);
    let found = tracker.update(&back.points).unwrap();
    assert_eq!(assert_right(&found, &back.truth, "back"), 5, "{found:?}");
}

/// A hand over the wound that moves along the spine takes nothing with it.
#[test]
fn what_slides_over_the_spine_does_not_carry_it_a_level_away() {
    let model = &phantom().model;
    let poses = phantom().poses(0.0);
    let along = model.centroid(Level::L2) - model.centroid(Level::L1);
    let slab = |shift: Vector3<f64>| -> Vec<Point3<f64>> {
        let points = frame(0, &[]).points;
        let back = points.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        let flat = points.iter().map(|p| Point3::new(p.x, back - 3.0, p.z));
        flat.map(|p| p + shift).collect()
    };
    let mut tracker = tracker();
    for step in 1..=8 {
        let found = tracker
            .update(&slab(along * f64::from(step) / 8.0))
            .unwrap();
        for (vertebra, pose) in found.vertebrae.iter().zip(&poses) {
            assert!(!vertebra.is_tracked(), "a slab: {vertebra:?}");
            let center = model.centroid(vertebra.level);
            let moved = pose_error(&vertebra.target_from_source, pose, &center);
            assert!(moved.translation_mm < 7.0, "step {step}: {moved:?}");
        }
    }
    let shifted: Vec<_> = poses
        .iter()
        .map(|pose| Translation3::from(along) * pose)
        .collect();
    for seed in 0..6 {
        let frame = phantom().frame_of(&shifted, seed, (N_POINTS, NOISE_MM), &[]);
        let found = tracker.update(&frame.points).unwrap();
        assert_right(&found, &frame.truth, "a level away");
    }
}

/// Fits that nobody vouches for help to look for vertebrae, however often the spine has moved meanwhile.
#[test]
fn a_spine_that_drifts_through_noise_is_found_again_behind_it() {
    let poses = phantom().poses(0.0);
    let mut tracker = tracker();
    for step in 1..=6_u32 {
        let shift = Translation3::new(0.6 * f64::from(step), 2.0 * f64::from(step), 0.0);
        let shifted: Vec<_> = poses.iter().map(|pose| shift * pose).collect();
        let noise_mm = if step < 6 { 3.5 } else { NOISE_MM };
        let frame = phantom().frame_of(&shifted, u64::from(step), (N_POINTS, noise_mm), &[]);
        let found = tracker.update(&frame.points).unwrap();
        let n = assert_right(&found, &frame.truth, &format!("step {step}"));
        assert_eq!(n, if step < 6 { 0 } else { 5 }, "step {step}: {found:?}");
    }
}

#[test]
fn what_was_lost_for_too_long_is_not_found_again() {
    let options = TrackerOptions {
        max_frames_lost: 3,
        ..TrackerOptions::default()
    };
    let poses = phantom().poses(0.0);
    let mut tracker = SpineTracker::from_poses(&phantom().model, &poses, options).unwrap();
    for time in 1..=5 {
        let hidden: &[usize] = if time <= 3 { &[2] } else { &[] };
        let frame = frame(time, hidden);
        let found = tracker.update(&frame.points).unwrap();
        let n = assert_right(&found, &frame.truth, &format!("frame {time}"));
        assert_eq!(n, 4, "frame {time}: L3 is lost for good");
        if time > 3 {
            let reason = LostReason::TooLong { n_frames: time - 1 };
            assert_eq!(found.vertebrae[2].state, TrackState::Lost { reason }, "L3");
        }
    }
}

#[test]
fn the_same_frames_give_the_same_bits_on_any_thread() {
    let run = || {
        let mut tracker = tracker();
        (1..=4)
            .map(|time| tracker.update(&frame(time, &[]).points).unwrap())
            .flat_map(|found| found.vertebrae)
            .map(|v| (v.target_from_source, v.n_points))
            .collect::<Vec<_>>()
    };
    let here = run();
    let threads: Vec<_> = (0..3).map(|_| std::thread::spawn(run)).collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), here, "the same poses");
    }
}

#[test]
fn bad_input_is_refused_and_changes_nothing() {
    let mut tracker = tracker();
    let good = frame(1, &[]);
    assert!(
        matches!(tracker.update(&[]), Err(SpineError::EmptyFrame)),
        "nothing"
    );
    let mut bad = good.points.clone();
    bad[17].y = f64::NAN;
    let error = tracker.update(&bad).unwrap_err();
    assert!(
        matches!(error, SpineError::NonFinitePoint { point: 17 }),
        "{error}"
    );
    let found = tracker.update(&good.points).unwrap();
    assert!(found.all_tracked(), "as if nothing had been");

    let model = &phantom().model;
    let from = |poses: &[Isometry3<f64>], options| {
        SpineTracker::from_poses(model, poses, options).map(|_| ())
    };
    let error = from(&[Isometry3::identity(); 3], TrackerOptions::default()).unwrap_err();
    assert!(error.to_string().contains("3 poses for 5"), "{error}");
    let mut poses = [Isometry3::identity(); 5];
    poses[4].translation.x = f64::INFINITY;
    let error = from(&poses, TrackerOptions::default()).unwrap_err();
    assert!(error.to_string().contains("L5 is not finite"), "{error}");
    let options = TrackerOptions {
        max_jump_mm: -1.0,
        ..TrackerOptions::default()
    };
    let error = from(&[Isometry3::identity(); 5], options).unwrap_err();
    assert!(error.to_string().contains("max_jump_mm"), "{error}");
}

#[test]
fn what_the_first_result_rejected_is_not_followed() {
    let simulated = super::simulated(Deformation::NonRigid, 0.5, 3);
    let mut first = super::run(&super::target_of(&simulated));
    first.vertebrae[4].accepted = false;
    let model = &super::scene().model;
    let mut tracker = SpineTracker::new(model, &first, TrackerOptions::default()).unwrap();
    let found = tracker.update(simulated.mesh.vertices()).unwrap();
    let reason = LostReason::NotAccepted;
    assert_eq!(found.vertebrae[4].state, TrackState::Lost { reason }, "L5");
    for (vertebra, truth) in found.vertebrae.iter().zip(&simulated.truth).take(4) {
        assert!(vertebra.is_tracked(), "{vertebra:?}");
        let error = truth.error_of(&vertebra.target_from_source);
        assert!(
            error.translation_mm < 0.5 && error.rotation_rad < 0.02,
            "{error:?}"
        );
    }
    for vertebra in &mut first.vertebrae {
        vertebra.accepted = false;
    }
    let error = SpineTracker::new(model, &first, TrackerOptions::default()).map(|_| ());
    assert!(
        matches!(error, Err(SpineError::NothingToTrack)),
        "nothing to follow"
    );
}

#[test]
fn few_points_are_lost_not_wrong() {
    let mut tracker = tracker();
    for n in [1, 20, 200] {
        let frame = phantom().frame(1.0, n, NOISE_MM, &[]);
        if frame.points.is_empty() {
            continue;
        }
        let found = tracker.update(&frame.points).unwrap();
        assert!(!found.all_tracked(), "{n} points are too few");
    }
}
