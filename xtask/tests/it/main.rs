//! `cargo xtask bench-scenarios` as a whole.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot set its scene up must fail"
)]

mod peers;
mod scaling;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use pedicle_trajectory::{read_landmarks, read_plan, write_plan};

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures")
}

/// One draw a cell of the suite on the phantom.
fn bench(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["bench-scenarios", "--draws", "1", "--spine"])
        .arg(fixtures().join("phantom"))
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_one_and_two_threads() {
    let folder = tempfile::tempdir().unwrap();
    let gates = fixtures().join("gates.ron");
    let files = ["1", "2"].map(|threads| {
        let json = folder.path().join(format!("{threads}.json"));
        let markdown = folder.path().join(format!("{threads}.md"));
        let output = bench(&[
            "--threads",
            threads,
            "--seed",
            "424242",
            "--gates",
            gates.to_str().unwrap(),
            "--json",
            json.to_str().unwrap(),
            "--markdown",
            markdown.to_str().unwrap(),
        ]);
        let printed = String::from_utf8_lossy(&output.stdout).into_owned();
        let failed = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            printed.contains("false accepts"),
            "no table:\n{printed}\n{failed}"
        );
        for words in [
            "plan from plan.ron, landmarks from landmarks.ron",
            "isthmus width mm",
            "pilot drill or guide wire",
            "final poses of 45 vertebrae",
        ] {
            assert!(printed.contains(words), "no '{words}' in\n{printed}");
        }
        assert!(
            std::fs::read_to_string(markdown)
                .unwrap()
                .contains("| rigid"),
            "no Markdown table"
        );
        std::fs::read_to_string(json).unwrap()
    });
    assert_eq!(
        files[0], files[1],
        "the number of threads changed the figures"
    );

    let value: serde_json::Value = serde_json::from_str(&files[0]).unwrap();
    assert_eq!(value["suite"], "paper", "the suite is named");
    assert_eq!(value["seed"], 424_242, "the seed is named");
    assert_eq!(value["draws"], 1, "the draws are named");
    let cells = value["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 9, "three deformations and three noise levels");
    for cell in cells {
        assert_eq!(cell["trajectories"], 10, "two a vertebra");
        assert_eq!(cell["false_accepts"], 0, "{cell}");
        assert_eq!(
            cell["vertebrae"].as_array().unwrap().len(),
            5,
            "one entry a level"
        );
        for key in ["valid_by_margin", "valid_by_geometry", "vertebrae_accepted"] {
            assert!(cell[key].is_u64(), "{key} is a count");
        }
        let first = &cell["vertebrae"][0];
        assert_eq!(first["level"], "L1", "from the top down");
        for key in [
            "translation_rmse_mm",
            "rotation_rmse_deg",
            "translation_bound_mm",
            "rotation_bound_deg",
        ] {
            assert!(first[key].is_number(), "{key} is a number");
        }
    }
}

#[test]
fn a_missed_gate_is_exit_code_1_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let strict = folder.path().join("gates.ron");
    let text = std::fs::read_to_string(fixtures().join("gates.ron")).unwrap();
    // No noisy target can be met to a hundredth of a millimetre.
    let mut spoilt = String::new();
    for line in text.lines() {
        let is_limit = line.trim_start().starts_with("max_translation_rmse_mm");
        spoilt.push_str(if is_limit {
            "            max_translation_rmse_mm: 0.01,"
        } else {
            line
        });
        spoilt.push('\n');
    }
    std::fs::write(&strict, spoilt).unwrap();
    let output = bench(&["--gates", strict.to_str().unwrap()]);
    assert_eq!(
        output.status.code(),
        Some(1),
        "a missed gate is exit code 1"
    );
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        message.contains("gate missed: phantom: rigid at 0.5 mm"),
        "{message}"
    );

    std::fs::write(&strict, "(cells: [").unwrap();
    let output = bench(&["--gates", strict.to_str().unwrap()]);
    assert_eq!(
        output.status.code(),
        Some(2),
        "broken gates are exit code 2"
    );
}

#[test]
fn a_spine_that_is_not_there_is_exit_code_2() {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["bench-scenarios", "--spine", "no/such/spine"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "bad input");
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("no/such/spine"),
        "the path is named"
    );
}

#[test]
fn the_phantom_in_fixtures_is_the_one_the_command_makes() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["make-phantom", "--output"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    for level in ["L1", "L2", "L3", "L4", "L5"] {
        let name = format!("{level}.ply");
        let made = pedicle_mesh::read_mesh(folder.path().join(&name))
            .unwrap()
            .mesh;
        let kept = pedicle_mesh::read_mesh(fixtures().join("phantom").join(&name))
            .unwrap()
            .mesh;
        assert_eq!(made.faces(), kept.faces(), "{level}: other faces");
        // Mathematical functions may differ in the last digits between systems.
        let worst = made
            .vertices()
            .iter()
            .zip(kept.vertices())
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, |worst, d| if d > worst { d } else { worst });
        assert!(worst < 1e-6, "{level}: a vertex is {worst} mm off");
    }

    let [made, kept] = [folder.path().to_owned(), fixtures().join("phantom")]
        .map(|f| read_plan(f.join("plan.ron")).unwrap().trajectories);
    assert_eq!(made.len(), kept.len(), "other trajectories");
    for (a, b) in made.iter().zip(&kept) {
        assert_eq!((a.level, a.side), (b.level, b.side), "another order");
        let off_mm = (a.entry_mm - b.entry_mm)
            .norm()
            .max((a.tip_mm - b.tip_mm).norm())
            .max((a.diameter_mm - b.diameter_mm).abs());
        assert!(off_mm < 1e-6, "{} {}: {off_mm} mm off", a.level, a.side);
    }
    let [made, kept] = [folder.path().to_owned(), fixtures().join("phantom")]
        .map(|f| read_landmarks(f.join("landmarks.ron")).unwrap().landmarks);
    assert_eq!(made.len(), kept.len(), "other landmarks");
    for (a, b) in made.iter().zip(&kept) {
        assert_eq!(a.level, b.level, "another order");
        let off_mm = (a.position_mm - b.position_mm).norm();
        assert!(off_mm < 1e-6, "{}: {off_mm} mm off", a.level);
    }
}

#[test]
fn refused_scenarios_are_counted_and_miss_the_gates() {
    let folder = tempfile::tempdir().unwrap();
    let mut plan = read_plan(fixtures().join("phantom/plan.ron")).unwrap();
    // A plan of another spine: the pipeline refuses every scenario.
    let away = nalgebra::Isometry3::translation(0.0, 120.0, 0.0);
    for trajectory in &mut plan.trajectories {
        *trajectory = trajectory.transformed(&away);
    }
    let file = folder.path().join("elsewhere.ron");
    write_plan(&file, &plan).unwrap();
    let output = bench(&["--plan", file.to_str().unwrap(), "--explain"]);
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let complaints = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{printed}\n{complaints}");
    assert_eq!(
        complaints.matches("scenario refused: ").count(),
        9,
        "one line a scenario: {complaints}"
    );
    for word in ["gate missed", "vertebrae accepted"] {
        assert!(complaints.contains(word), "no '{word}' in: {complaints}");
    }
    for word in ["draw 0: refused: ", "plan from elsewhere.ron", "NaN"] {
        assert!(printed.contains(word), "no '{word}' in: {printed}");
    }
}
