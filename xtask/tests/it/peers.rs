//! Our side of `cargo xtask bench-peers`, as its own process; the peers need a network to install.

use std::process::Command;

use pedicle_mesh::{WriteOptions, read_mesh, write_mesh};
use serde_json::{Value, json};

#[test]
fn a_job_is_answered_with_stages_and_maps() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let vertebra = read_mesh(crate::fixtures().join("phantom").join("L3.ply"))
        .unwrap()
        .mesh;
    let small = pedicle_mesh::simplify(&vertebra, 1200, &Default::default())
        .unwrap()
        .mesh;
    for name in ["source.off", "target.off"] {
        write_mesh(path(name), &small, &WriteOptions::default()).unwrap();
    }
    let job = json!({
        "program": "pedicle",
        "source": path("source.off"), "target": path("target.off"),
        "matrices": [path("source"), path("target")],
        "landmarks": [[0, 0], [100, 100], [200, 200], [300, 300]],
        "n_functions": 60, "n_fit": 30, "n_start": 20, "n_wave": 10, "n_threads": 1,
        "steps": [5, 1], "precise": false,
        "output": path("outcome.json"),
    });
    std::fs::write(path("job.json"), job.to_string()).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .arg("measure-pair")
        .arg(path("job.json"))
        .output()
        .unwrap();
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let text = std::fs::read_to_string(path("outcome.json")).unwrap();
    let outcome: Value = serde_json::from_str(&text).unwrap();
    let names: Vec<&str> = outcome["stages"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["name"].as_str().unwrap())
        .collect();
    for stage in [
        "operators",
        "eigenpairs",
        "descriptors",
        "fit",
        "ZoomOut step 5",
        "ZoomOut step 1",
    ] {
        assert!(names.contains(&stage), "no {stage} in {names:?}");
    }
    // The two shapes are the same, so is every vertex and its image.
    let map = outcome["maps"]["ZoomOut step 1"].as_array().unwrap();
    assert_eq!(map.len(), small.n_vertices(), "one image a vertex");
    let is_exact = map
        .iter()
        .enumerate()
        .all(|(v, image)| image.as_u64() == Some(v as u64));
    assert!(is_exact, "the identity is found");
}

#[test]
fn an_interpreter_that_is_not_there_is_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("peers.md");
    let run = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args([
            "bench-peers",
            "--sizes",
            "200",
            "--threads",
            "1",
            "--repeats",
            "1",
        ])
        .args(["--python", "no-such-python", "--output"])
        .arg(&report)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(said.contains("no-such-python"), "{said}");
    assert!(!report.exists(), "no half report");
}
