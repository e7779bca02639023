use std::fs;

use nalgebra::Point3;
use pedicle_trajectory::{
    FormatError, Landmark, Landmarks, Level, Plan, PlanError, Side, Trajectory, read_landmarks,
    read_plan, write_landmarks, write_plan,
};
use proptest::prelude::*;

fn plan() -> Plan {
    let mut trajectories = Vec::new();
    for level in Level::ALL {
        for side in Side::ALL {
            let x = 20.0 * side.sign();
            let z = -35.5 * level.index() as f64;
            trajectories.push(Trajectory {
                level,
                side,
                entry_mm: Point3::new(x, 0.1, z),
                tip_mm: Point3::new(0.5 * x, 40.25, z - 1.0 / 3.0),
                diameter_mm: 6.5,
            });
        }
    }
    Plan { trajectories }
}

fn landmarks() -> Landmarks {
    let landmarks = Level::ALL
        .map(|level| Landmark {
            level,
            position_mm: Point3::new(0.25, -40.0, level.index() as f64),
        })
        .to_vec();
    Landmarks { landmarks }
}

/// What reading `text` as a plan file of the given name says.
fn complaint(name: &str, text: &str) -> FormatError {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, text).unwrap();
    let error = read_plan(&path).unwrap_err();
    let message = error.to_string();
    assert!(message.contains(name), "{message} does not name the file");
    error
}

const JSON: &str = r#"{"trajectories": [
  {"level": "L4", "side": "left", "entry_mm": [1, 2, 3], "tip_mm": [1, 42.5, 3], "diameter_mm": 6.0}
]}"#;

const RON: &str = "(
    // Kept by hand.
    trajectories: [
        (level: L4, side: left, entry_mm: (1, 2, 3), tip_mm: [1.0, 42.5, 3.0], diameter_mm: 6),
    ],
)";

#[test]
fn written_plans_read_back_exactly() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["plan.ron", "plan.json", "UPPER.JSON"] {
        let path = folder.path().join(name);
        write_plan(&path, &plan()).unwrap();
        let back = read_plan(&path).unwrap();
        for (a, b) in back.trajectories.iter().zip(&plan().trajectories) {
            assert!((a.entry_mm - b.entry_mm).norm() < 1e-12, "{name}: entry");
            assert!((a.tip_mm - b.tip_mm).norm() < 1e-12, "{name}: tip");
            assert_eq!((a.level, a.side), (b.level, b.side), "{name}: pedicle");
        }
        assert_eq!(back.trajectories.len(), 10, "{name}");
        let path = folder.path().join(format!("landmarks-{name}"));
        write_landmarks(&path, &landmarks()).unwrap();
        assert_eq!(read_landmarks(&path).unwrap(), landmarks(), "{name}");
    }
    let left_over = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left_over, 6, "no temporary file stays");
}

#[test]
fn hand_written_forms_are_natural() {
    let folder = tempfile::tempdir().unwrap();
    let expected = Plan {
        trajectories: vec![Trajectory {
            level: Level::L4,
            side: Side::Left,
            entry_mm: Point3::new(1.0, 2.0, 3.0),
            tip_mm: Point3::new(1.0, 42.5, 3.0),
            diameter_mm: 6.0,
        }],
    };
    for (name, text) in [("a.json", JSON), ("a.ron", RON)] {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        assert_eq!(read_plan(&path).unwrap(), expected, "{name}");
    }
    let named = RON
        .replacen('(', "Plan(", 1)
        .replace("(level", "Trajectory(level");
    let path = folder.path().join("named.ron");
    fs::write(&path, named).unwrap();
    assert_eq!(read_plan(&path).unwrap(), expected, "struct names");
    let path = folder.path().join("mark.json");
    fs::write(&path, format!("\u{feff}{JSON}")).unwrap();
    assert_eq!(read_plan(&path).unwrap(), expected, "byte order mark");
}

#[test]
fn ron_has_one_trajectory_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.ron");
    write_plan(&path, &plan()).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(text.lines().count(), 14, "{text}");
    assert!(text.contains("level: L1, side: left"), "{text}");
}

#[test]
fn unknown_level_is_listed_with_the_known_ones() {
    for (name, text) in [("a.json", JSON), ("a.ron", RON)] {
        let error = complaint(name, &text.replace("L4", "L7"));
        let message = error.to_string();
        assert!(message.contains("\"L7\""), "{message}");
        assert!(message.contains("L1, L2, L3, L4, L5"), "{message}");
        let FormatError::Syntax { line, .. } = error else {
            panic!("{error:?}");
        };
        assert_eq!(line, if name == "a.json" { 2 } else { 4 }, "{message}");
    }
    let message = complaint("a.ron", &RON.replace("left", "middle")).to_string();
    assert!(message.contains("left, right"), "{message}");
}

#[test]
fn unknown_and_missing_fields_are_named() {
    for (name, text) in [("a.json", JSON), ("a.ron", RON)] {
        let message = complaint(name, &text.replace("tip_mm", "tip")).to_string();
        assert!(message.contains("tip"), "{message}");
        let message = complaint(name, &text.replace("trajectories", "screws")).to_string();
        assert!(message.contains("screws"), "{message}");
        let message = complaint(name, &text.replace("1, 2, 3", "1, 2")).to_string();
        assert!(
            message.contains("three numbers") || message.contains("length"),
            "{message}"
        );
    }
    let message = complaint("a.json", &JSON.replace(", \"diameter_mm\": 6.0", "")).to_string();
    assert!(message.contains("diameter_mm"), "{message}");
}

#[test]
fn truncated_files_say_so() {
    for (name, text) in [("a.json", JSON), ("a.ron", RON)] {
        let mut early = 0;
        for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)) {
            let error = complaint(name, &text[..end]);
            early += usize::from(matches!(error, FormatError::Truncated { .. }));
        }
        assert!(
            early * 10 > text.len() * 6,
            "{name}: {early} of {}",
            text.len()
        );
    }
    let error = complaint("a.json", "");
    assert!(matches!(error, FormatError::Truncated { .. }), "{error:?}");
    let error = complaint("a.ron", "");
    assert!(matches!(error, FormatError::Truncated { .. }), "{error:?}");
}

#[test]
fn wrong_numbers_are_named_with_their_trajectory() {
    let cases = [
        ("a.ron", RON.replace("(1, 2, 3)", "(1, NaN, 3)"), "entry_mm"),
        (
            "a.ron",
            RON.replace("(1, 2, 3)", "(1, inf, 3)"),
            "not finite",
        ),
        (
            "a.ron",
            RON.replace("diameter_mm: 6", "diameter_mm: 0"),
            "diameter_mm is 0",
        ),
        ("a.json", JSON.replace("6.0", "20.1"), "20.1"),
        ("a.json", JSON.replace("[1, 2, 3]", "[1, 42.5, 3]"), "apart"),
    ];
    for (name, text, expected) in cases {
        let message = complaint(name, &text).to_string();
        assert!(message.contains("trajectory 0 (L4 left)"), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    let error = complaint("a.json", "{\"trajectories\": []}");
    let empty = matches!(&error, FormatError::Plan { source, .. } if *source == PlanError::Empty);
    assert!(empty, "{error:?}");
}

#[test]
fn two_trajectories_for_one_pedicle() {
    let mut twice = plan();
    twice.trajectories.push(twice.trajectories[3]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.ron");
    let message = write_plan(&path, &twice).unwrap_err().to_string();
    assert!(message.contains("trajectories 3 and 10"), "{message}");
    assert!(message.contains("L2 right"), "{message}");
    assert!(!path.exists(), "nothing is written");

    let mut twice = landmarks();
    twice.landmarks[4].level = Level::L1;
    let message = write_landmarks(&path, &twice).unwrap_err().to_string();
    assert!(
        message.contains("landmarks 0 and 4 are both for L1"),
        "{message}"
    );
    twice.landmarks[4].position_mm.z = f64::NAN;
    let message = write_landmarks(&path, &twice).unwrap_err().to_string();
    assert!(
        message.contains("landmark 4 (L1) is not finite"),
        "{message}"
    );
}

#[test]
fn files_that_cannot_be_used() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["plan.yaml", "plan", ".ron"] {
        let error = write_plan(folder.path().join(name), &plan()).unwrap_err();
        let wrong = matches!(error, FormatError::UnknownExtension { .. });
        assert!(wrong, "{error:?}");
    }
    let error = read_plan(folder.path().join("absent.ron")).unwrap_err();
    assert!(matches!(error, FormatError::Read { .. }), "{error:?}");
    let error = write_plan(folder.path().join("no/such/folder.ron"), &plan()).unwrap_err();
    assert!(matches!(error, FormatError::Write { .. }), "{error:?}");
    let path = folder.path().join("bytes.json");
    fs::write(&path, [b'{', 0xff, 0xfe]).unwrap();
    let error = read_plan(&path).unwrap_err();
    assert!(
        matches!(error, FormatError::NotText { byte: 1, .. }),
        "{error:?}"
    );
}

#[test]
fn a_failed_write_keeps_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.json");
    write_plan(&path, &plan()).unwrap();
    let before = fs::read(&path).unwrap();
    write_plan(&path, &Plan::default()).unwrap_err();
    assert_eq!(fs::read(&path).unwrap(), before, "untouched");
}

proptest! {
    #[test]
    fn any_text_is_an_error_or_a_plan(text in ".{0,200}") {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ron", "a.json"] {
            let path = folder.path().join(name);
            fs::write(&path, &text).unwrap();
            let _ = read_plan(&path);
            let _ = read_landmarks(&path);
        }
    }
}
