//! `pedicle transfer` on a scene that is right.

use std::fs;

use nalgebra::Matrix4;
use pedicle::TransferFile;
use pedicle_mesh::{MeshFormat, TriMesh, WriteOptions, concatenate, write_mesh};
use pedicle_trajectory::{Level, read_plan, write_plan};

use crate::support::{Scene, pedicle, simulated, stderr};

fn result(scene: &Scene) -> TransferFile {
    let json = scene.folder.path().join("result.json");
    let output = scene.transfer(&["--json", json.to_str().unwrap(), "--seed", "5"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap()
}

/// Largest distance of a transferred entry or tip from where it truly belongs.
fn worst_error_mm(scene: &Scene, found: &TransferFile) -> f64 {
    let plan = read_plan(&scene.plan).unwrap();
    let mut worst = 0.0_f64;
    for (entry, planned) in found.trajectories.iter().zip(&plan.trajectories) {
        let truth = &simulated().truth[planned.level.index()].target_from_source;
        let expected = planned.transformed(truth);
        for (a, b) in [
            (entry.entry_mm, expected.entry_mm),
            (entry.tip_mm, expected.tip_mm),
        ] {
            worst = worst.max((nalgebra::Point3::from(a) - b).norm());
        }
    }
    worst
}

#[test]
fn the_plan_arrives_where_it_belongs_and_the_json_is_consistent() {
    let scene = Scene::new();
    let found = result(&scene);
    assert_eq!(found.vertebrae.len(), 5, "one entry a level");
    assert_eq!(found.trajectories.len(), 10, "one entry a trajectory");
    let worst = worst_error_mm(&scene, &found);
    assert!(worst < 1.0, "a screw is {worst} mm off at 0.5 mm noise");

    let plan = read_plan(&scene.plan).unwrap();
    for (entry, planned) in found.trajectories.iter().zip(&plan.trajectories) {
        let doubt = entry.uncertainty.expect("there is a fit");
        let worst_mm = doubt.entry_std_mm.max(doubt.tip_std_mm);
        assert!(0.0 < doubt.isthmus_std_mm && worst_mm < 1.0, "{doubt:?}");
        assert!(
            doubt.breach_probability.is_some_and(|p| p < 0.005),
            "accepted: {doubt:?}"
        );
        assert_eq!(
            (entry.level, entry.side),
            (planned.level, planned.side),
            "order of the plan"
        );
        let vertebra = &found.vertebrae[planned.level.index()];
        let matrix = Matrix4::from_fn(|i, j| vertebra.target_from_source[i][j]);
        let moved = matrix.transform_point(&planned.entry_mm);
        let distance = (moved - nalgebra::Point3::from(entry.entry_mm)).norm();
        assert!(
            distance < 1e-9,
            "the matrix is not row-major source to target"
        );
        assert!(
            (matrix.fixed_view::<3, 3>(0, 0).determinant() - 1.0).abs() < 1e-9,
            "no rotation"
        );
        assert!(
            vertebra.accepted && entry.accepted && vertebra.reasons.is_empty(),
            "accepted"
        );
        assert!(
            vertebra.residual_mm.is_some() && vertebra.covariance.is_some(),
            "diagnostics"
        );
    }
}

#[test]
fn a_labelled_ply_and_a_json_plan_give_the_same_result_as_the_folder() {
    let mut scene = Scene::new();
    let from_folder = result(&scene);

    let parts = pedicle::read_spine(&scene.source).unwrap();
    let meshes: Vec<&TriMesh> = parts.iter().map(|v| &v.surface).collect();
    let whole = concatenate(&meshes).unwrap();
    let labels: Vec<u32> = parts
        .iter()
        .flat_map(|v| vec![v.level.index() as u32 + 20; v.surface.n_vertices()])
        .collect();
    let options = WriteOptions {
        vertex_labels: Some(&labels),
        ..WriteOptions::default()
    };
    let labelled = scene.folder.path().join("spine.ply");
    write_mesh(&labelled, &whole, &options).unwrap();
    let plan = scene.folder.path().join("plan.json");
    write_plan(&plan, &read_plan(&scene.plan).unwrap()).unwrap();
    scene.source = labelled;
    scene.plan = plan;
    assert_eq!(
        result(&scene),
        from_folder,
        "the same spine in another container"
    );
}

#[test]
fn lumbar_labels_are_found_in_a_whole_spine() {
    let scene = Scene::new();
    let lumbar = pedicle::read_spine(&scene.source).unwrap();
    let whole_spine: Vec<u32> = (1..=24).collect();
    for labels in [&whole_spine[..], &[0, 3, 20, 21, 22, 23, 24, 26]] {
        let found = pedicle::read_spine(scene.labelled("spine.ply", labels)).unwrap();
        for (found, expected) in found.iter().zip(&lumbar) {
            assert_eq!(found.level, expected.level, "from the top down");
            assert_eq!(
                found.surface.vertices(),
                expected.surface.vertices(),
                "{labels:?}: {} is another vertebra",
                found.level
            );
        }
    }
}

#[test]
fn every_mesh_format_of_the_target_works() {
    let mut scene = Scene::new();
    for extension in ["stl", "obj", "off"] {
        let path = scene.folder.path().join(format!("target.{extension}"));
        assert!(
            MeshFormat::from_path(&path).is_some(),
            "{extension} is a known format"
        );
        write_mesh(&path, &simulated().mesh, &WriteOptions::default()).unwrap();
        scene.target = path;
        let worst = worst_error_mm(&scene, &result(&scene));
        assert!(worst < 1.0, "{extension}: a screw is {worst} mm off");
    }
}

#[test]
fn zero_area_faces_unreferenced_vertices_and_fins_are_survived() {
    let mut scene = Scene::new();
    let clean = &simulated().mesh;
    let mut vertices = clean.vertices().to_vec();
    let mut faces = clean.faces().to_vec();
    let n = vertices.len() as u32;
    // A stray vertex, a face on a line, a doubled face, and a fin on an edge.
    let [a, b, _] = faces[0];
    vertices.push(nalgebra::center(
        &vertices[a as usize],
        &vertices[b as usize],
    ));
    vertices.push(vertices[a as usize] + nalgebra::Vector3::new(0.5, 0.4, 0.3));
    vertices.push(vertices[a as usize] + nalgebra::Vector3::new(3.0, 3.0, 3.0));
    faces.push([a, n, b]);
    faces.push(faces[1]);
    faces.push([a, b, n + 1]);
    let dirty = TriMesh::new(vertices, faces).unwrap();
    scene.target = scene.mesh("dirty.ply", &dirty);
    let worst = worst_error_mm(&scene, &result(&scene));
    assert!(worst < 1.0, "a screw is {worst} mm off");
}

#[test]
fn landmarks_on_the_target_are_not_needed_and_a_camera_has_three_coordinates() {
    let scene = Scene::new();
    let json = scene.folder.path().join("result.json");
    let transfer = |more: [&str; 2]| {
        let files = [
            ("--source", &scene.source),
            ("--plan", &scene.plan),
            ("--source-landmarks", &scene.source_landmarks),
            ("--target", &scene.target),
        ];
        let mut arguments = vec!["transfer"];
        for (name, file) in files {
            arguments.extend([name, file.to_str().unwrap()]);
        }
        arguments.extend(more);
        pedicle(&arguments)
    };
    let output = transfer(["--json", json.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    let worst = worst_error_mm(&scene, &found);
    assert!(worst < 1.0, "a screw is {worst} mm off");
    for (camera, words) in [("1,2", "2 numbers"), ("1,2,far", "'far'")] {
        let output = transfer(["--camera", camera]);
        assert_eq!(output.status.code(), Some(2), "{camera}");
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
}

#[test]
fn what_cannot_be_vouched_for_is_rejected_with_exit_code_3() {
    let mut scene = Scene::new();
    // L3 is missing from the target: only the other levels may be accepted.
    let truth = &simulated().truth;
    let hidden: std::collections::BTreeSet<u32> = truth[Level::L3.index()]
        .target_vertices
        .iter()
        .copied()
        .collect();
    let kept: Vec<u32> = (0..simulated().mesh.n_faces() as u32)
        .filter(|&f| !hidden.contains(&simulated().mesh.faces()[f as usize][0]))
        .collect();
    let part = simulated().mesh.submesh_of_faces(&kept).unwrap().mesh;
    scene.target = scene.mesh("without-l3.ply", &part);
    let json = scene.folder.path().join("result.json");
    let output = scene.transfer(&["--json", json.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let found: TransferFile = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    let l3 = &found.vertebrae[Level::L3.index()];
    assert!(
        !l3.accepted && !l3.reasons.is_empty(),
        "L3 is not there: {l3:?}"
    );
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        printed.contains("L3: "),
        "the reason is printed:\n{printed}"
    );
    for t in found.trajectories.iter().filter(|t| t.level == Level::L3) {
        assert!(!t.accepted, "no screw without its vertebra");
    }
}
