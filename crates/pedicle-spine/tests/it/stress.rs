//! Another patient, landmarks that are missing or wrong, honest covariances.

use pedicle_simulation::{Deformation, Stress, SuiteCell};
use pedicle_spine::Rejection;

use super::{run, suite_target, verdicts};

fn cell(stress: Stress) -> SuiteCell {
    SuiteCell::Stress {
        stress,
        noise_mm: 0.5,
    }
}

#[test]
fn another_patient_is_rejected_for_the_shape() {
    for draw in 0..2 {
        let (truth, target) = suite_target(cell(Stress::OtherPatient), draw, 41);
        let found = run(&target);
        verdicts(&found, &truth);
        for v in &found.vertebrae {
            assert!(!v.accepted, "{} is of another patient", v.level);
        }
        let of_shape = |r: &&Rejection| matches!(r, Rejection::ShapeDiffers { .. });
        let n = found
            .vertebrae
            .iter()
            .flat_map(|v| &v.reasons)
            .filter(of_shape)
            .count();
        assert!(n >= 3, "{n} vertebrae are told to differ in shape");
    }
}

#[test]
fn one_landmark_or_none_is_enough_on_a_whole_spine() {
    for stress in [Stress::OneLandmark, Stress::NoLandmark] {
        let (truth, target) = suite_target(cell(stress), 0, 42);
        let found = run(&target);
        let verdicts = verdicts(&found, &truth);
        assert!(
            verdicts.iter().all(|(right, _)| *right),
            "{stress:?}: {verdicts:?}"
        );
        let n_accepted = verdicts.iter().filter(|(_, accepted)| *accepted).count();
        assert!(n_accepted >= 4, "{stress:?}: {verdicts:?}");
        if stress == Stress::NoLandmark {
            for v in &found.vertebrae {
                assert!(v.landmark_distance_mm.is_nan(), "there is none");
            }
        }
    }
}

#[test]
fn swapped_landmarks_are_found_out() {
    let (truth, target) = suite_target(cell(Stress::LandmarksSwapped), 0, 43);
    let found = run(&target);
    let verdicts = verdicts(&found, &truth);
    assert!(verdicts.iter().all(|(right, _)| *right), "{verdicts:?}");
    let told: Vec<_> = found
        .vertebrae
        .iter()
        .filter_map(|v| Some((v.level, v.landmark_lies_on?)))
        .collect();
    assert_eq!(told.len(), 2, "whose landmark lies on another: {told:?}");
    assert_eq!(
        (told[0].0, told[0].1),
        (told[1].1, told[1].0),
        "they changed places"
    );
    let words = found.vertebrae.iter().filter_map(|v| v.notice());
    assert!(words.clone().count() == 2 && words.clone().all(|w| w.contains("check the names")));
}

#[test]
fn covariances_are_honest_from_whole_to_partial() {
    let (mut sum, mut n) = (0.0, 0.0);
    for deformation in [Deformation::NonRigid, Deformation::Partial] {
        let cell = SuiteCell::Resampled {
            deformation,
            noise_mm: 1.0,
        };
        for draw in 0..2 {
            let (truth, target) = suite_target(cell, draw, 44);
            let found = run(&target);
            for (v, t) in found.vertebrae.iter().zip(&truth.truth) {
                let covariance = v.covariance.expect("a fit has a covariance");
                sum += covariance
                    .normalized_error_squared(&v.target_from_source, &t.vertebra.target_from_source)
                    .expect("the covariance can be inverted");
                n += 1.0;
            }
            for t in &found.trajectories {
                let screw = t.uncertainty.expect("a fit has one");
                assert!(screw.planned_clearance_mm > 0.0, "planned inside");
                assert!(
                    screw.tip_mm > 0.0 && screw.tip_mm < 2.0 && screw.isthmus_mm < 1.5,
                    "{screw:?}"
                );
                assert!(screw.breach_probability < 0.1, "{screw:?}");
            }
        }
    }
    let mean = sum / n / 6.0;
    assert!(
        (0.5..1.7).contains(&mean),
        "normalised error squared over 6 is {mean}, expected 1"
    );
}
