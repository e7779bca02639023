//! `pedicle anatomy`, `plan` and `check` as a user calls them.

use std::path::Path;
use std::process::{Command, Output};

use pedicle_trajectory::{Plan, read_plan, write_plan};

use crate::support::{fixture, stderr};

fn pedicle(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pedicle"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_spine_is_measured_planned_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.ron");
    let spine = fixture("");
    let anatomy = pedicle(&["anatomy", text(&spine), "--json", "-"]);
    assert_eq!(anatomy.status.code(), Some(0), "{}", stderr(&anatomy));
    let value: serde_json::Value = serde_json::from_str(&stdout(&anatomy)).unwrap();
    let vertebrae = value["vertebrae"].as_array().unwrap();
    assert_eq!(vertebrae.len(), 5, "L1 to L5");
    for v in vertebrae {
        for p in v["pedicles"].as_array().unwrap() {
            assert!(p["width_mm"].as_f64().unwrap() > 7.0, "{p}");
            assert!(
                p["isthmus_contour_mm"].as_array().unwrap().len() > 10,
                "{p}"
            );
        }
        assert!(v["spinous_process_tip_mm"].is_array(), "{v}");
    }

    let planned = pedicle(&["plan", text(&spine), "-o", text(&plan)]);
    assert_eq!(planned.status.code(), Some(0), "{}", stderr(&planned));
    assert_eq!(
        read_plan(&plan).unwrap().trajectories.len(),
        10,
        "ten screws"
    );
    let again = pedicle(&["plan", text(&spine), "-o", text(&plan)]);
    assert_eq!(again.status.code(), Some(2), "not written over");
    assert!(stderr(&again).contains("--force"), "{}", stderr(&again));
    let one = [
        "plan",
        text(&spine),
        "-o",
        text(&plan),
        "--force",
        "--level",
        "L4",
        "--side",
        "left",
    ];
    let json = folder.path().join("plan.json");
    let one: Vec<&str> = one.into_iter().chain(["--json", text(&json)]).collect();
    let one = pedicle(&one);
    assert_eq!(one.status.code(), Some(0), "{}", stderr(&one));
    assert_eq!(read_plan(&plan).unwrap().trajectories.len(), 1, "L4 left");
    assert!(json.exists(), "the JSON beside it");

    let checked = pedicle(&["check", text(&spine), text(&plan), "--json", "-"]);
    assert_eq!(checked.status.code(), Some(0), "{}", stderr(&checked));
    let value: serde_json::Value = serde_json::from_str(&stdout(&checked)).unwrap();
    let screw = &value["screws"][0];
    assert_eq!(
        (&screw["level"], &screw["side"], &screw["grade"]),
        (&"L4".into(), &"left".into(), &"A".into()),
        "{screw}"
    );
    assert!(screw["clearance_mm"].as_f64().unwrap() >= 1.0, "{screw}");
    assert!(screw["direction"].is_null(), "no breach: {screw}");
}

#[test]
fn a_screw_in_the_canal_gives_exit_code_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("moved.ron");
    let mut plan: Plan = read_plan(fixture("plan.ron")).unwrap();
    for t in plan.trajectories.iter_mut().filter(|t| t.entry_mm.x > 0.0) {
        t.entry_mm.x -= 7.0;
        t.tip_mm.x -= 7.0;
    }
    write_plan(&path, &plan).unwrap();
    let output = pedicle(&["check", text(&fixture("")), text(&path)]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stdout(&output).contains("medial"), "{}", stdout(&output));
}

/// The words must all be in the one sentence on standard error.
fn refused(arguments: &[&str], words: &[&str]) {
    let output = pedicle(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "not refused: {message}");
    for word in words {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

#[test]
fn bad_plans_and_catalogues_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let spine = fixture("");
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let screw = |fields: &str| format!("(trajectories: [(level: L3, side: left, {fields})])");
    let cases = [
        (
            "entry_mm: (0, 0, 0), tip_mm: (0, 0, 0), diameter_mm: 6",
            "apart",
        ),
        (
            "entry_mm: (NaN, 0, 0), tip_mm: (0, 9, 0), diameter_mm: 6",
            "not finite",
        ),
        (
            "entry_mm: (0, 0, 0), tip_mm: (0, 9, 0), diameter_mm: -6",
            "-6",
        ),
    ];
    for (fields, word) in cases {
        let plan = file("bad.ron", &screw(fields));
        refused(
            &["check", text(&spine), text(&plan)],
            &["bad.ron", "L3 left", word],
        );
    }
    let one = "(level: L3, side: left, entry_mm: (0, 0, 0), tip_mm: (0, 9, 0), diameter_mm: 6)";
    let twice = file("twice.ron", &format!("(trajectories: [{one}, {one}])"));
    refused(
        &["check", text(&spine), text(&twice)],
        &["twice.ron", "0 and 1", "L3 left"],
    );
    let t12 = file(
        "t12.ron",
        &format!("(trajectories: [{}])", one.replace("L3", "T12")),
    );
    refused(&["check", text(&spine), text(&t12)], &["t12.ron", "T12"]);

    let mut flipped: Plan = read_plan(fixture("plan.ron")).unwrap();
    for t in &mut flipped.trajectories {
        for p in [&mut t.entry_mm, &mut t.tip_mm] {
            (p.x, p.y) = (-p.x, -p.y);
        }
    }
    let path = folder.path().join("lps.ron");
    write_plan(&path, &flipped).unwrap();
    refused(
        &["check", text(&spine), text(&path)],
        &["lps.ron", "RAS", "LPS"],
    );

    let output = folder.path().join("out.ron");
    for (content, word) in [
        ("(diameters_mm: [], lengths_mm: [40])", "empty"),
        ("(diameters_mm: [6, 5], lengths_mm: [40])", "ascend"),
        ("(diameters_mm: [-1], lengths_mm: [40])", "-1"),
    ] {
        let catalogue = file("screws.ron", content);
        refused(
            &[
                "plan",
                text(&spine),
                "-o",
                text(&output),
                "--catalogue",
                text(&catalogue),
            ],
            &["screws.ron", word],
        );
    }
    let thick = file("thick.ron", "(diameters_mm: [15], lengths_mm: [40])");
    refused(
        &[
            "plan",
            text(&spine),
            "-o",
            text(&output),
            "--catalogue",
            text(&thick),
        ],
        &["L1 left", "15 mm screw"],
    );
    assert!(!output.exists(), "a refused plan leaves no file");
    let empty = tempfile::tempdir().unwrap();
    refused(&["anatomy", text(empty.path())], &["no surface for L1"]);
}
