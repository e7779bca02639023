//! Targets and landmarks that are not what they should be.

use pedicle_simulation::Deformation;
use pedicle_spine::{Rejection, Target, VerdictOptions, VertebraTransfer};
use pedicle_trajectory::{Level, SafetyMargins};

use super::{run, simulated, target_of};

#[test]
fn a_vertebra_that_is_not_there_is_rejected_and_the_others_stay_right() {
    let simulated = simulated(Deformation::NonRigid, 0.5, 8);
    for missing in [Level::L1, Level::L4] {
        let hidden: std::collections::BTreeSet<u32> = simulated.truth[missing.index()]
            .target_vertices
            .iter()
            .copied()
            .collect();
        let kept: Vec<u32> = (0..simulated.mesh.n_faces() as u32)
            .filter(|&f| !hidden.contains(&simulated.mesh.faces()[f as usize][0]))
            .collect();
        let surface = simulated.mesh.submesh_of_faces(&kept).unwrap().mesh;
        let landmarks = simulated.target_landmarks.clone();
        let found = run(&Target::mesh(surface, landmarks));
        for (v, t) in found.vertebrae.iter().zip(&simulated.truth) {
            let error = t.error_of(&v.target_from_source);
            let valid =
                SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
            assert!(
                valid || !v.accepted,
                "{} falsely accepted: {error:?}",
                v.level
            );
            if v.level == missing {
                assert!(!v.accepted, "{} is not there", v.level);
                continue;
            }
            // Without its first vertebra the target might as well be the spine one level on: to
            // say so is right. Nothing else may be said against a vertebra that is seen.
            let at_the_end = missing == Level::L1;
            let only_the_level = |r: &Rejection| matches!(r, Rejection::LevelAmbiguous { .. });
            assert!(
                v.accepted || (at_the_end && v.reasons.iter().all(only_the_level)),
                "{} without {missing}: {:?}",
                v.level,
                v.reasons
            );
        }
    }
}

#[test]
fn a_bone_of_noise_is_not_accepted() {
    let simulated = simulated(Deformation::Rigid, 6.0, 9);
    let found = run(&target_of(&simulated));
    for (v, t) in found.vertebrae.iter().zip(&simulated.truth) {
        let error = t.error_of(&v.target_from_source);
        let valid = SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
        assert!(
            valid || !v.accepted,
            "{} falsely accepted: {error:?}",
            v.level
        );
    }
    let noisy = found.vertebrae.iter().flat_map(|v| &v.reasons);
    assert!(
        noisy
            .clone()
            .any(|r| matches!(r, Rejection::Noisy { .. } | Rejection::PoorFit { .. })),
        "6 mm of noise is said: {:?}",
        noisy.collect::<Vec<_>>()
    );
}

#[test]
fn landmarks_one_level_off_never_lead_to_a_false_accept() {
    let mut n_beyond = 0;
    for deformation in Deformation::ALL {
        let simulated = simulated(deformation, 0.5, 13);
        let given = &simulated.target_landmarks.landmarks;
        for down in [true, false] {
            let mut target = target_of(&simulated);
            for (i, landmark) in target.landmarks.landmarks.iter_mut().enumerate() {
                // The user took the spinous process of the neighbour; at the end, the place where
                // one more would be.
                landmark.position_mm = match (down, i) {
                    (true, 4) => {
                        given[4].position_mm + (given[4].position_mm - given[3].position_mm)
                    }
                    (true, _) => given[i + 1].position_mm,
                    (false, 0) => {
                        given[0].position_mm + (given[0].position_mm - given[1].position_mm)
                    }
                    (false, _) => given[i - 1].position_mm,
                };
            }
            let found = run(&target);
            for (v, t) in found.vertebrae.iter().zip(&simulated.truth) {
                let error = t.error_of(&v.target_from_source);
                let valid =
                    SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
                assert!(
                    valid || !v.accepted,
                    "{deformation}, {} falsely accepted: {error:?}",
                    v.level
                );
            }
            let told = |v: &&VertebraTransfer| v.notice().is_some();
            assert!(
                found.vertebrae.iter().any(|v| told(&v)),
                "{deformation}: no wrong name is told"
            );
            let beyond = |v: &&VertebraTransfer| v.accepted && v.landmark_lies_beyond;
            n_beyond += found.vertebrae.iter().filter(beyond).count();
            let max_mm = VerdictOptions::default().max_landmark_distance_mm;
            let far = |v: &&VertebraTransfer| v.accepted && v.landmark_distance_mm > max_mm;
            assert!(
                found.vertebrae.iter().filter(far).all(|v| told(&v)),
                "{deformation}: an accepted vertebra is far from its landmark, and nobody says so"
            );
        }
    }
    assert!(
        n_beyond > 0,
        "nowhere is a vertebra accepted whose landmark lies a level beyond the end"
    );
}

#[test]
fn swapped_landmarks_never_lead_to_a_false_accept() {
    let simulated = simulated(Deformation::Partial, 0.5, 10);
    let mut target = target_of(&simulated);
    let (a, b) = (
        target.landmarks.landmarks[1].position_mm,
        target.landmarks.landmarks[2].position_mm,
    );
    target.landmarks.landmarks[1].position_mm = b;
    target.landmarks.landmarks[2].position_mm = a;
    let found = run(&target);
    for level in [Level::L1, Level::L4, Level::L5] {
        let v = &found.vertebrae[level.index()];
        assert!(v.accepted, "{level} has its own landmark: {:?}", v.reasons);
    }
    for level in [Level::L2, Level::L3] {
        let v = &found.vertebrae[level.index()];
        let other = if level == Level::L2 {
            Level::L3
        } else {
            Level::L2
        };
        assert_eq!(v.landmark_lies_on, Some(other), "{level} has a wrong name");
    }
    for (v, t) in found.vertebrae.iter().zip(&simulated.truth) {
        let error = t.error_of(&v.target_from_source);
        let valid = SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
        assert!(
            valid || !v.accepted,
            "{} falsely accepted: {error:?}",
            v.level
        );
    }
}
