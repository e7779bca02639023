//! The transfer against truth that is known.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set its scene up must fail"
)]

mod tracker;

use std::sync::OnceLock;

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_mesh::TriMesh;
use pedicle_registration::pose_error;
use pedicle_simulation::{
    Deformation, MeshingOptions, Phantom, PhantomParameters, Scenario, SimulatedTarget, SpineCase,
    generate_phantom, simulate,
};
use pedicle_spine::{
    MapOptions, Rejection, SourceVertebra, SpineError, SpineModel, Stage, Target, Transfer,
    TransferOptions, transfer, transfer_with_progress,
};
use pedicle_trajectory::{Landmarks, Level, Plan, SafetyMargins};

struct Scene {
    phantom: Phantom,
    case: SpineCase,
    model: SpineModel,
}

fn sources(phantom: &Phantom) -> Vec<SourceVertebra> {
    phantom
        .vertebrae
        .iter()
        .map(|v| SourceVertebra {
            level: v.level,
            surface: v.mesh.clone(),
        })
        .collect()
}

fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let parameters = PhantomParameters::subject(11);
        let phantom = generate_phantom(&parameters, &MeshingOptions::default()).unwrap();
        let case = phantom.spine_case(3500).unwrap();
        let model = SpineModel::new(
            sources(&phantom),
            &phantom.landmarks(),
            &MapOptions::default(),
        )
        .unwrap();
        Scene {
            phantom,
            case,
            model,
        }
    })
}

fn simulated(deformation: Deformation, noise_mm: f64, seed: u64) -> SimulatedTarget {
    simulate(
        &scene().case,
        &Scenario {
            deformation,
            noise_mm,
            draw: 0,
            seed,
        },
    )
    .unwrap()
}

fn target_of(simulated: &SimulatedTarget) -> Target {
    Target::mesh(simulated.mesh.clone(), simulated.target_landmarks.clone())
}

fn run(target: &Target) -> Transfer {
    let plan = scene().phantom.plan();
    transfer(&scene().model, &plan, target, &TransferOptions::default()).unwrap()
}

fn worst(found: &Transfer, truth: &SimulatedTarget) -> (f64, f64) {
    let mut worst = (0.0_f64, 0.0_f64);
    for (v, t) in found.vertebrae.iter().zip(&truth.truth) {
        let error = t.error_of(&v.target_from_source);
        worst = (
            worst.0.max(error.translation_mm),
            worst.1.max(error.rotation_rad),
        );
    }
    worst
}

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
            assert!(
                !found.all_accepted(),
                "{deformation}: wrong landmarks must be noticed"
            );
        }
    }
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
        assert!(
            !found.vertebrae[level.index()].accepted,
            "{level} is far from its landmark"
        );
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

#[test]
fn sources_plans_and_landmarks_are_checked() {
    let scene = scene();
    let landmarks = scene.phantom.landmarks();
    let build = |vertebrae, landmarks: &Landmarks| {
        SpineModel::new(vertebrae, landmarks, &MapOptions::default()).map(|_| ())
    };

    let mut four = sources(&scene.phantom);
    four.remove(2);
    let error = build(four, &landmarks).unwrap_err();
    assert!(
        matches!(error, SpineError::MissingLevel { level: Level::L3 }),
        "{error}"
    );

    let mut twice = sources(&scene.phantom);
    twice[4].level = Level::L1;
    let error = build(twice, &landmarks).unwrap_err();
    assert!(
        matches!(error, SpineError::DoubledLevel { level: Level::L1 }),
        "{error}"
    );

    let mut far = landmarks.clone();
    far.landmarks[0].position_mm = Point3::new(1e4, 0.0, 0.0);
    let error = build(sources(&scene.phantom), &far).unwrap_err();
    assert!(
        matches!(
            error,
            SpineError::LandmarkFarFromSurface {
                level: Level::L1,
                ..
            }
        ),
        "{error}"
    );

    let mut infinite = landmarks;
    infinite.landmarks[0].position_mm.x = f64::INFINITY;
    let error = build(sources(&scene.phantom), &infinite).unwrap_err();
    assert!(
        matches!(
            error,
            SpineError::NonFiniteLandmark {
                level: Level::L1,
                ..
            }
        ),
        "{error}"
    );

    let error = scene.model.check_plan(&Plan::default()).unwrap_err();
    assert!(matches!(error, SpineError::EmptyPlan), "{error}");
    let mut mirrored = scene.phantom.plan();
    for t in &mut mirrored.trajectories {
        t.side = t.side.opposite();
    }
    let error = scene.model.check_plan(&mirrored).unwrap_err();
    assert!(
        matches!(
            error,
            SpineError::PlanSide {
                level: Level::L1,
                ..
            }
        ),
        "{error}"
    );
    let mut swapped = scene.phantom.plan();
    for t in &mut swapped.trajectories {
        t.level = if t.level == Level::L1 {
            Level::L5
        } else {
            t.level
        };
    }
    let error = scene.model.check_plan(&swapped).unwrap_err();
    assert!(
        matches!(
            error,
            SpineError::PlanOffSpine {
                level: Level::L5,
                ..
            }
        ),
        "{error}"
    );
}

/// Makes one option nonsense.
type Spoil = fn(&mut TransferOptions);

#[test]
fn options_that_make_no_sense_are_refused() {
    let target = target_of(&simulated(Deformation::Rigid, 0.0, 14));
    let plan = scene().phantom.plan();
    let spoilt: [(&str, Spoil); 4] = [
        ("gates_mm", |o| o.search.gates_mm.clear()),
        ("n_turns", |o| o.search.n_turns = 0),
        ("truncation_mm", |o| o.search.truncation_mm = f64::NAN),
        ("n_fine_points", |o| o.search.n_fine_points = 0),
    ];
    for (name, spoil) in spoilt {
        let mut options = TransferOptions::default();
        spoil(&mut options);
        let error = transfer(&scene().model, &plan, &target, &options).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn a_source_in_other_units_is_recognised() {
    for factor in [1e-3, 0.1, 1e3] {
        let scaled = sources(&scene().phantom)
            .into_iter()
            .map(|v| {
                let vertices = v.surface.vertices().iter().map(|p| p * factor).collect();
                let surface = TriMesh::new(vertices, v.surface.faces().to_vec()).unwrap();
                SourceVertebra {
                    level: v.level,
                    surface,
                }
            })
            .collect();
        let mut landmarks = scene().phantom.landmarks();
        for landmark in &mut landmarks.landmarks {
            landmark.position_mm *= factor;
        }
        let error = SpineModel::new(scaled, &landmarks, &MapOptions::default()).unwrap_err();
        assert!(matches!(error, SpineError::SourceSize { .. }), "{error}");
    }
}

#[test]
fn a_target_in_other_units_is_recognised() {
    let simulated = simulated(Deformation::Rigid, 0.0, 12);
    for (factor, word) in [(1e-3, "metres"), (0.1, "centimetres"), (1e3, "micrometres")] {
        let vertices = simulated
            .mesh
            .vertices()
            .iter()
            .map(|p| p * factor)
            .collect();
        let surface = TriMesh::new(vertices, simulated.mesh.faces().to_vec()).unwrap();
        let mut landmarks = simulated.target_landmarks.clone();
        for landmark in &mut landmarks.landmarks {
            landmark.position_mm *= factor;
        }
        let target = Target::mesh(surface, landmarks);
        let plan = scene().phantom.plan();
        let error =
            transfer(&scene().model, &plan, &target, &TransferOptions::default()).unwrap_err();
        assert!(matches!(error, SpineError::UnitMismatch { .. }), "{error}");
        assert!(error.to_string().contains(word), "{error}");
    }
}
