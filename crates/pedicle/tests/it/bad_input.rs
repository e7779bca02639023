//! Bad input: exit code 2 and one sentence that names the file and the place.

use std::fs;
use std::path::Path;

use nalgebra::{Isometry3, Point3};
use pedicle_mesh::TriMesh;
use pedicle_trajectory::{Level, Plan, read_landmarks, read_plan, write_landmarks, write_plan};

use crate::support::{Scene, fixture, simulated, stderr};

/// Runs a scene that is wrong; the words must all be in the one sentence on standard error.
fn refused(scene: &Scene, words: &[&str]) {
    let json = scene.folder.path().join("result.json");
    let output = scene.transfer(&["--json", json.to_str().unwrap()]);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "not refused: {message}");
    assert!(message.starts_with("error: "), "{message}");
    assert_eq!(
        message.trim().lines().count(),
        1,
        "more than one line: {message}"
    );
    for word in words {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
    assert!(!json.exists(), "a refused input leaves no result behind");
}

fn with_target_text(text: &str, words: &[&str]) {
    let mut scene = Scene::new();
    scene.target = scene.file("bad.off", text);
    let mut all = vec!["bad.off"];
    all.extend(words);
    refused(&scene, &all);
}

#[test]
fn broken_target_meshes() {
    with_target_text("OFF\n0 0 0\n", &["empty"]);
    with_target_text(
        "OFF\n3 1 0\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n",
        &["line 4", "not finite"],
    );
    with_target_text(
        "OFF\n3 1 0\n0 0 0\ninf 0 0\n0 1 0\n3 0 1 2\n",
        &["line 4", "not finite"],
    );
    with_target_text(
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n",
        &["line 6", "vertex 9", "3"],
    );
    with_target_text("OFF\n3 1 0\n0 0 0\n1 0 0\n", &["bad.off"]);
    with_target_text("this is no mesh\n", &["bad.off"]);
}

#[test]
fn a_target_cut_off_in_the_middle() {
    let mut scene = Scene::new();
    let bytes = fs::read(&scene.target).unwrap();
    let cut = scene.folder.path().join("cut.ply");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    scene.target = cut;
    refused(&scene, &["cut.ply"]);
}

#[test]
fn a_target_in_metres() {
    let mut scene = Scene::new();
    let metres = |p: &Point3<f64>| p / 1000.0;
    let vertices = simulated().mesh.vertices().iter().map(metres).collect();
    let mesh = TriMesh::new(vertices, simulated().mesh.faces().to_vec()).unwrap();
    scene.target = scene.mesh("metres.ply", &mesh);
    let mut landmarks = simulated().target_landmarks.clone();
    for landmark in &mut landmarks.landmarks {
        landmark.position_mm = metres(&landmark.position_mm);
    }
    let path = scene.folder.path().join("metres.json");
    write_landmarks(&path, &landmarks).unwrap();
    scene.target_landmarks = path;
    refused(&scene, &["metres.ply", "in metres", "1000"]);
}

#[test]
fn a_target_too_coarse_for_the_basis() {
    let mut scene = Scene::new();
    let corner = simulated().truth[0].target_points[0];
    let at = |x: f64, y: f64, z: f64| corner + nalgebra::Vector3::new(x, y, z);
    let vertices = vec![
        at(0., 0., 0.),
        at(50., 0., 0.),
        at(0., 50., 0.),
        at(0., 0., 150.),
    ];
    let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    scene.target = scene.mesh("coarse.ply", &TriMesh::new(vertices, faces).unwrap());
    let mut landmarks = simulated().target_landmarks.clone();
    for landmark in &mut landmarks.landmarks {
        landmark.position_mm = corner;
    }
    let path = scene.folder.path().join("near.json");
    write_landmarks(&path, &landmarks).unwrap();
    scene.target_landmarks = path;
    refused(&scene, &["coarse.ply", "4 vertices", "80 eigenfunctions"]);
}

#[test]
fn levels_missing_doubled_or_unknown() {
    let mut scene = Scene::new();
    scene.source = scene.copied_source();
    fs::remove_file(scene.source.join("L3.ply")).unwrap();
    refused(&scene, &["source", "no surface for L3"]);

    fs::copy(fixture("L3.ply"), scene.source.join("L3.ply")).unwrap();
    fs::copy(fixture("L3.ply"), scene.source.join("l3.ply")).unwrap();
    refused(&scene, &["L3 is there more than once", "L3.ply", "l3.ply"]);

    scene.source = fixture("L3.ply");
    refused(&scene, &["L3.ply", "label"]);

    scene.source = Path::new("nowhere").to_owned();
    refused(&scene, &["nowhere: no such file or folder"]);
}

#[test]
fn labels_that_could_be_any_part_of_the_spine() {
    let mut scene = Scene::new();
    let labels = [1, 2, 3, 4, 5, 6, 7];
    scene.source = scene.labelled("cervical.ply", &labels);
    refused(
        &scene,
        &["cervical.ply", "[1, 2, 3, 4, 5, 6, 7]", "20 to 24"],
    );
}

#[test]
fn landmarks_missing_doubled_unknown_or_far_off() {
    let good = read_landmarks(fixture("landmarks.ron")).unwrap();
    let mut scene = Scene::new();

    let mut missing = good.clone();
    missing.landmarks.retain(|l| l.level != Level::L2);
    scene.source_landmarks = scene.folder.path().join("missing.ron");
    write_landmarks(&scene.source_landmarks, &missing).unwrap();
    refused(&scene, &["missing.ron", "source landmarks", "L2"]);

    let twice = r#"{"landmarks": [{"level": "L1", "position_mm": [0, 0, 0]},
                                  {"level": "L1", "position_mm": [1, 0, 0]}]}"#;
    scene.source_landmarks = scene.file("twice.json", twice);
    refused(&scene, &["twice.json", "L1"]);

    let unknown = r#"{"landmarks": [{"level": "L9", "position_mm": [0, 0, 0]}]}"#;
    scene.source_landmarks = scene.file("unknown.json", unknown);
    refused(&scene, &["unknown.json", "L9"]);

    let mut far = good;
    far.landmarks[3].position_mm += nalgebra::Vector3::new(0.0, -200.0, 0.0);
    scene.source_landmarks = scene.folder.path().join("far.ron");
    write_landmarks(&scene.source_landmarks, &far).unwrap();
    refused(&scene, &["far.ron", "source landmark of L4", "50 mm"]);

    scene.source_landmarks = fixture("landmarks.ron");
    let mut far = simulated().target_landmarks.clone();
    far.landmarks[0].position_mm += nalgebra::Vector3::new(0.0, 0.0, 900.0);
    scene.target_landmarks = scene.folder.path().join("far-target.json");
    write_landmarks(&scene.target_landmarks, &far).unwrap();
    refused(&scene, &["far-target.json", "target landmark of L1"]);
}

#[test]
fn plans_of_another_spine_or_broken_ones() {
    let mut scene = Scene::new();
    let plan = read_plan(fixture("plan.ron")).unwrap();
    let away = Isometry3::translation(0.0, 120.0, 0.0);
    let other = Plan {
        trajectories: plan
            .trajectories
            .iter()
            .map(|t| t.transformed(&away))
            .collect(),
    };
    scene.plan = scene.folder.path().join("other.ron");
    write_plan(&scene.plan, &other).unwrap();
    refused(&scene, &["other.ron", "L1", "another spine"]);

    let text = fs::read_to_string(fixture("plan.ron")).unwrap();
    scene.plan = scene.file("cut.ron", &text[..text.len() / 2]);
    refused(&scene, &["cut.ron"]);

    scene.plan = scene.file("empty.json", r#"{"trajectories": []}"#);
    refused(&scene, &["empty.json"]);

    scene.plan = scene.file("plan.txt", &text);
    refused(&scene, &["plan.txt", ".ron", ".json"]);
}

#[test]
fn a_result_that_cannot_be_written_is_said() {
    let scene = Scene::new();
    let output = scene.transfer(&["--json", "no-such-folder/result.json"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("no-such-folder"),
        "{}",
        stderr(&output)
    );
}
