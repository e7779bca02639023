//! The transfer against truth that is known.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set its scene up must fail"
)]

mod bad_input;
mod meets_truth;
mod sensor;
mod stress;
mod tracker;
mod wrong_targets;

use std::sync::OnceLock;

use pedicle_simulation::{
    Deformation, MeshingOptions, Phantom, PhantomParameters, Scenario, SimulatedTarget, SpineCase,
    SuiteCell, SuiteScenario, SuiteTarget, TargetSurface, generate_phantom, simulate,
    simulate_suite,
};
use pedicle_spine::{
    MapOptions, SensorView, SourceVertebra, SpineModel, Target, Transfer, TransferOptions, transfer,
};
use pedicle_trajectory::SafetyMargins;

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

/// A scenario of the suites with the target as the method sees it.
fn suite_target(cell: SuiteCell, draw: u32, seed: u64) -> (SuiteTarget, Target) {
    let scenario = SuiteScenario { cell, draw, seed };
    seen_by_method(simulate_suite(&scene().case, &scenario).unwrap())
}

fn seen_by_method(simulated: SuiteTarget) -> (SuiteTarget, Target) {
    let landmarks = simulated.target_landmarks.clone();
    let target = match simulated.surface.clone() {
        TargetSurface::Mesh(mesh) => Target::mesh(mesh, landmarks),
        TargetSurface::Cloud(points) => Target::cloud(points, landmarks),
    };
    let target = match &simulated.view {
        Some(view) => target.seen_from(SensorView {
            camera_mm: view.camera_mm,
        }),
        None => target,
    };
    (simulated, target)
}

/// For each vertebra, whether its pose is within the margins and whether it was accepted. None may be
/// accepted without being right.
fn verdicts(found: &Transfer, truth: &SuiteTarget) -> Vec<(bool, bool)> {
    found
        .vertebrae
        .iter()
        .zip(&truth.truth)
        .map(|(v, t)| {
            let error = t.vertebra.error_of(&v.target_from_source);
            let right = t.present
                && SafetyMargins::default().is_within(error.translation_mm, error.rotation_rad);
            assert!(
                right || !v.accepted,
                "{} falsely accepted: {error:?}",
                v.level
            );
            (right, v.accepted)
        })
        .collect()
}
