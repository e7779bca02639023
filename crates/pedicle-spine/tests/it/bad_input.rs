//! Input that is refused.

use nalgebra::Point3;
use pedicle_mesh::TriMesh;
use pedicle_simulation::Deformation;
use pedicle_spine::{
    MapOptions, SensorView, SourceVertebra, SpineError, SpineModel, Target, TransferOptions,
    transfer,
};
use pedicle_trajectory::{Landmarks, Level, Plan};

use super::{scene, simulated, sources, target_of};

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

#[test]
fn clouds_of_nothing_are_refused() {
    let landmarks = simulated(Deformation::Rigid, 0.0, 12).target_landmarks;
    let plan = scene().phantom.plan();
    let refused = |points: Vec<Point3<f64>>| {
        let target = Target::cloud(points, landmarks.clone());
        transfer(&scene().model, &plan, &target, &TransferOptions::default()).unwrap_err()
    };
    let error = refused(vec![Point3::origin(); 7]);
    assert!(
        matches!(error, SpineError::TooFewPoints { n_points: 7, .. }),
        "{error}"
    );
    let mut points = vec![Point3::origin(); 100];
    points[3].y = f64::NAN;
    let error = refused(points);
    assert!(
        matches!(error, SpineError::NonFinitePoint { point: 3 }),
        "{error}"
    );
}

#[test]
fn a_camera_without_a_place_is_refused() {
    let seen = simulated(Deformation::Rigid, 0.5, 12);
    let camera_mm = Point3::new(0.0, f64::NAN, 500.0);
    let target = target_of(&seen).seen_from(SensorView { camera_mm });
    let plan = scene().phantom.plan();
    let error = transfer(&scene().model, &plan, &target, &TransferOptions::default()).unwrap_err();
    assert!(
        matches!(error, SpineError::BlindCamera { .. }) && error.to_string().contains("NaN"),
        "{error}"
    );
}
