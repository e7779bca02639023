//! Targets of the published kind.

use nalgebra::{Isometry3, Vector3};
use pedicle_registration::pose_error;
use pedicle_simulation::Deformation;
use pedicle_spine::{Stage, Target, TransferOptions, transfer_with_progress};
use pedicle_trajectory::SafetyMargins;

use super::{run, scene, simulated, target_of, worst};

#[test]
fn clean_targets_are_met_exactly_and_accepted() {
    for deformation in Deformation::ALL {
        let simulated = simulated(deformation, 0.0, 3);
        let found = run(&target_of(&simulated));
        let (mm, rad) = worst(&found, &simulated);
        assert!(mm < 1e-6 && rad < 1e-7, "{deformation}: {mm} mm, {rad} rad");
        assert!(
            found.all_accepted(),
            "{deformation}: a vertebra was rejected"
        );
    }
}

#[test]
fn noisy_targets_stay_well_inside_the_margins() {
    let margins = SafetyMargins::default();
    for deformation in Deformation::ALL {
        let simulated = simulated(deformation, 1.0, 4);
        let found = run(&target_of(&simulated));
        let (mm, rad) = worst(&found, &simulated);
        assert!(
            margins.is_within(2.0 * mm, 2.0 * rad),
            "{deformation}: {mm} mm, {rad} rad"
        );
        for v in &found.vertebrae {
            assert!(
                (v.noise_mm - 1.0).abs() < 0.25,
                "{}: noise {}",
                v.level,
                v.noise_mm
            );
        }
    }
}

#[test]
fn the_errors_follow_the_covariance() {
    // Five vertebrae in four draws: the mean of a χ² with 6 degrees of freedom over 20 of them
    // lies between 3.3 and 9.9 with more than 99.9 % probability.
    let mut sum = 0.0;
    let mut n = 0.0;
    for seed in 0..4 {
        let simulated = simulated(Deformation::Rigid, 0.5, 100 + seed);
        let found = run(&target_of(&simulated));
        for (v, t) in found.vertebrae.iter().zip(&simulated.truth) {
            let covariance = v.covariance.expect("a fit has a covariance");
            let nees = covariance
                .normalized_error_squared(&v.target_from_source, &t.target_from_source)
                .expect("the covariance can be inverted");
            sum += nees;
            n += 1.0;
        }
    }
    let mean = sum / n;
    assert!(
        (3.0..10.0).contains(&mean),
        "mean normalised error squared {mean}, expected 6"
    );
}

#[test]
fn the_same_seed_gives_the_same_result_to_the_last_bit() {
    let target = target_of(&simulated(Deformation::Partial, 0.5, 5));
    assert_eq!(
        run(&target),
        run(&target),
        "nothing may depend on anything but the input"
    );
}

#[test]
fn a_moved_target_gives_the_moved_result() {
    let simulated = simulated(Deformation::NonRigid, 0.5, 6);
    let target = target_of(&simulated);
    let motion = Isometry3::new(
        Vector3::new(500.0, -200.0, 90.0),
        Vector3::new(2.0, 0.4, -1.1),
    );
    let mut moved = Target::mesh(
        simulated.mesh.transformed(&motion),
        target.landmarks.clone(),
    );
    for landmark in &mut moved.landmarks.landmarks {
        landmark.position_mm = motion * landmark.position_mm;
    }
    let (here, there) = (run(&target), run(&moved));
    for (a, b) in here.vertebrae.iter().zip(&there.vertebrae) {
        let center = scene().model.centroid(a.level);
        let difference = pose_error(
            &b.target_from_source,
            &(motion * a.target_from_source),
            &center,
        );
        assert!(
            difference.translation_mm < 0.02,
            "{}: {difference:?}",
            a.level
        );
        assert!(
            difference.rotation_rad < 1e-3,
            "{}: {difference:?}",
            a.level
        );
    }
}

#[test]
fn stages_are_told_in_order() {
    let target = target_of(&simulated(Deformation::Rigid, 0.0, 7));
    let mut stages = Vec::new();
    let plan = scene().phantom.plan();
    let options = TransferOptions::default();
    transfer_with_progress(&scene().model, &plan, &target, &options, &mut |s| {
        stages.push(s)
    })
    .unwrap();
    assert_eq!(
        stages,
        [Stage::Spectrum, Stage::Map, Stage::Search, Stage::Finish],
        "in order"
    );
}
