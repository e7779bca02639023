//! What a depth camera sees, as cloud and as mesh.

use nalgebra::Vector3;
use pedicle_simulation::{SensorForm, SuiteCell};
use pedicle_spine::{Rejection, SensorView, Target, TargetSurface};

use super::{run, suite_target, verdicts};

fn cell(form: SensorForm, cover: f64) -> SuiteCell {
    SuiteCell::Sensor {
        form,
        cover,
        noise_mm: 0.3,
    }
}

#[test]
fn bare_bone_is_accepted_as_cloud_and_as_mesh() {
    for form in SensorForm::ALL {
        let (truth, target) = suite_target(cell(form, 0.0), 0, 31);
        let found = run(&target);
        let verdicts = verdicts(&found, &truth);
        assert!(
            verdicts.iter().all(|(right, _)| *right),
            "{form:?}: {verdicts:?}"
        );
        let n_accepted = verdicts.iter().filter(|(_, accepted)| *accepted).count();
        assert!(n_accepted >= 4, "{form:?}: {verdicts:?}");
        assert!(found.map.is_none(), "no map is made of what a camera saw");
        let noise_mm = found.sensor_noise_mm.expect("pixels are dense enough");
        assert!(
            (noise_mm - truth.noise_mm).abs() < 0.5 * truth.noise_mm,
            "sensor noise {noise_mm}, truly {}",
            truth.noise_mm
        );
    }
}

#[test]
fn a_cloud_gives_the_poses_of_the_mesh_over_it() {
    let (_, mesh) = suite_target(cell(SensorForm::Mesh, 0.0), 1, 32);
    let TargetSurface::Mesh(surface) = &mesh.surface else {
        panic!("a mesh was asked for");
    };
    let cloud = Target {
        surface: TargetSurface::Cloud(surface.vertices().to_vec()),
        ..mesh.clone()
    };
    let (a, b) = (run(&mesh), run(&cloud));
    for (v, w) in a.vertebrae.iter().zip(&b.vertebrae) {
        let covariance = v.covariance.expect("a fit");
        let centre = v.target_from_source.inverse() * covariance.center;
        let apart = (v.target_from_source * centre - w.target_from_source * centre).norm();
        assert!(
            apart < covariance.translation_mm(),
            "{}: {apart} mm apart",
            v.level
        );
    }
}

#[test]
fn soft_tissue_never_leads_to_a_false_accept() {
    let mut n_right = 0;
    for (form, cover, draw) in [
        (SensorForm::Mesh, 0.2, 0),
        (SensorForm::Cloud, 0.4, 1),
        (SensorForm::Mesh, 0.4, 2),
    ] {
        let (truth, target) = suite_target(cell(form, cover), draw, 33);
        let verdicts = verdicts(&run(&target), &truth);
        n_right += verdicts.iter().filter(|(right, _)| *right).count();
    }
    assert!(n_right >= 10, "{n_right} of 15 poses are right");
}

#[test]
fn points_that_float_alone_are_removed_and_told() {
    let (truth, mut target) = suite_target(cell(SensorForm::Cloud, 0.0), 2, 34);
    let before = run(&target).target_changes.n_points_alone;
    let TargetSurface::Cloud(points) = &mut target.surface else {
        panic!("a cloud was asked for");
    };
    let camera = truth.view.expect("a camera").camera_mm;
    for i in 0..20 {
        let p = points[i * 97];
        points.push(p + (camera - p).normalize() * 40.0 + Vector3::new(i as f64, 0.0, 0.0));
    }
    let found = run(&target);
    let removed = found.target_changes.n_points_alone - before;
    assert!(removed >= 15, "{removed} of 20 removed");
    verdicts(&found, &truth);
}

#[test]
fn bone_that_the_camera_saw_through_is_rejected() {
    // The camera is said to be on the other side: it would have looked through the bodies.
    let (truth, target) = suite_target(cell(SensorForm::Mesh, 0.0), 3, 35);
    let middle =
        truth.truth[2].vertebra.target_from_source * truth.truth[2].vertebra.source_centroid;
    let camera = truth.view.expect("a camera").camera_mm;
    let behind = SensorView {
        camera_mm: middle - (camera - middle),
    };
    let found = run(&target.seen_from(behind));
    assert!(
        found.vertebrae.iter().all(|v| !v.accepted),
        "no vertebra can be seen from in front"
    );
    let reasons: Vec<&Rejection> = found.vertebrae.iter().flat_map(|v| &v.reasons).collect();
    assert!(!reasons.is_empty(), "and it is said why");
}
