//! 3D Slicer's Markups: both spaces, exact round trips, and what is refused.

use std::path::PathBuf;

use nalgebra::Point3;
use pedicle_mesh::Space;
use pedicle_trajectory::{
    FormatError, Landmark, Landmarks, Level, MarkupsError, MarkupsOptions, Plan, Side, Trajectory,
    holds_landmarks, read_landmarks, read_landmarks_in, read_plan, read_plan_with,
    write_landmarks_in, write_plan, write_plan_in,
};
use serde_json::{Value, json};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn file(&self, name: &str, value: &Value) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, value.to_string()).unwrap();
        path
    }
}

fn plan() -> Plan {
    let third = 1.0 / 3.0;
    let trajectories = [
        (Level::L1, Side::Left),
        (Level::L1, Side::Right),
        (Level::L5, Side::Left),
    ]
    .into_iter()
    .zip([1.0, -7.3, 1e-7])
    .map(|((level, side), x)| Trajectory {
        level,
        side,
        entry_mm: Point3::new(x, -31.1 * third, 0.0),
        tip_mm: Point3::new(x + 3.0, 40.0 * third, -1024.0625),
        diameter_mm: 5.0 + x.abs() / 10.0,
    })
    .collect();
    Plan { trajectories }
}

#[test]
fn plans_keep_every_bit_in_either_space() {
    let folder = Folder::new();
    let path = folder.path("plan.mrk.json");
    for space in [Space::Ras, Space::Lps] {
        write_plan_in(&path, &plan(), space).unwrap();
        let options = MarkupsOptions {
            space,
            ..MarkupsOptions::default()
        };
        assert_eq!(read_plan_with(&path, &options).unwrap(), plan(), "{space}");
        let text = std::fs::read_to_string(&path).unwrap();
        let file: Value = serde_json::from_str(&text).unwrap();
        let line = &file["markups"][1];
        assert_eq!(
            (&line["type"], &line["name"]),
            (&json!("Line"), &json!("L1_right")),
            "name"
        );
        assert_eq!(line["coordinateSystem"], "LPS", "as 3D Slicer writes it");
        let sign = if space == Space::Ras { -1.0 } else { 1.0 };
        assert_eq!(
            line["controlPoints"][0]["position"][0],
            sign * -7.3,
            "x in LPS"
        );
        assert_eq!(line["controlPoints"][0]["label"], "entry", "labels");
        assert!(!text.contains("-0.0"), "no negative zero:\n{text}");
    }
    // Other files are in the coordinates of their surface, whatever the options say.
    let own = folder.path("plan.ron");
    write_plan(&own, &plan()).unwrap();
    let options = MarkupsOptions {
        space: Space::Lps,
        ..MarkupsOptions::default()
    };
    assert_eq!(
        read_plan_with(&own, &options).unwrap(),
        plan(),
        "not turned"
    );
}

#[test]
fn landmarks_keep_every_bit_and_are_told_from_plans() {
    let folder = Folder::new();
    let landmarks = Landmarks {
        landmarks: vec![
            Landmark {
                level: Level::L2,
                position_mm: Point3::new(0.1, -60.7, 3.3),
            },
            Landmark {
                level: Level::L4,
                position_mm: Point3::new(-0.2, -61.0, -70.0),
            },
        ],
    };
    let path = folder.path("landmarks.mrk.json");
    for space in [Space::Ras, Space::Lps] {
        write_landmarks_in(&path, &landmarks, space).unwrap();
        assert_eq!(
            read_landmarks_in(&path, space).unwrap(),
            landmarks,
            "{space}"
        );
    }
    let plain = folder.path("landmarks.json");
    write_landmarks_in(&plain, &landmarks, Space::Ras).unwrap();
    let plan_path = folder.path("plan.ron");
    write_plan(&plan_path, &plan()).unwrap();
    assert!(
        holds_landmarks(&path).unwrap() && holds_landmarks(&plain).unwrap(),
        "landmarks"
    );
    assert!(!holds_landmarks(&plan_path).unwrap(), "a plan");
}

/// A line as 3D Slicer saves it, with labels of its own and fields that we do not know.
fn line(system: &str) -> Value {
    json!({
        "type": "Line", "name": "L4 L", "coordinateSystem": system, "coordinateUnits": "mm",
        "display": {"visibility": true},
        "controlPoints": [
            {"label": "L-1", "description": "screw diameter_mm=6.5 mm", "position": [1, 2, 3],
             "positionStatus": "defined"},
            {"label": "L-2", "position": [4.5, 5, 6]},
        ],
    })
}

fn file(markup: Value) -> Value {
    json!({"markups": [markup]})
}

#[test]
fn the_files_own_coordinate_system_counts() {
    let folder = Folder::new();
    for (system, expected) in [("RAS", [1.0, 2.0, 3.0]), ("LPS", [-1.0, -2.0, 3.0])] {
        let path = folder.file("a.json", &file(line(system)));
        let t = read_plan(&path).unwrap().trajectories[0];
        assert_eq!(
            (t.level, t.side, t.diameter_mm),
            (Level::L4, Side::Left, 6.5),
            "{system}"
        );
        assert_eq!(
            t.entry_mm,
            Point3::from(expected),
            "{system} brought to RAS"
        );
    }
}

#[test]
fn labels_tell_entry_and_tip_where_they_are_given() {
    let folder = Folder::new();
    let mut tip_first = line("RAS");
    tip_first["controlPoints"][0]["label"] = json!("tip");
    tip_first["controlPoints"][1]["label"] = json!("entry");
    let t = read_plan(folder.file("a.json", &file(tip_first)))
        .unwrap()
        .trajectories[0];
    assert_eq!(t.entry_mm, Point3::new(4.5, 5.0, 6.0), "the labels count");
}

#[test]
fn a_diameter_may_come_from_outside() {
    let folder = Folder::new();
    let mut bare = line("RAS");
    bare["controlPoints"][0]["description"] = json!("");
    let path = folder.file("a.json", &file(bare));
    let error = read_plan(&path).unwrap_err();
    let FormatError::Markups { source, .. } = &error else {
        panic!("{error:?}")
    };
    assert!(
        matches!(**source, MarkupsError::NoDiameter { index: 0, .. }),
        "{source:?}"
    );
    let options = MarkupsOptions {
        diameter_mm: Some(5.5),
        ..MarkupsOptions::default()
    };
    let t = read_plan_with(&path, &options).unwrap().trajectories[0];
    assert_eq!((t.level, t.diameter_mm), (Level::L4, 5.5), "given");
}

/// Reads a spoilt line as a plan; the error must name the file.
fn spoilt(spoil: impl Fn(&mut Value)) -> MarkupsError {
    let folder = Folder::new();
    let mut markup = line("LPS");
    spoil(&mut markup);
    let error = read_plan(folder.file("bad.mrk.json", &file(markup))).unwrap_err();
    assert!(
        error.to_string().contains("bad.mrk.json: markup 0"),
        "{error}"
    );
    let FormatError::Markups { source, .. } = error else {
        panic!("{error:?}")
    };
    *source
}

#[test]
fn what_is_wrong_is_said() {
    use MarkupsError as E;
    let found = spoilt(|m| _ = m.as_object_mut().unwrap().remove("coordinateSystem"));
    assert!(matches!(found, E::NoCoordinateSystem { .. }), "{found:?}");
    for bad in [json!("RAI"), json!(0), json!(["LPS"])] {
        let found = spoilt(|m| m["coordinateSystem"] = bad.clone());
        assert!(
            matches!(found, E::UnknownCoordinateSystem { .. }),
            "{found:?}"
        );
    }
    let found = spoilt(|m| m["coordinateUnits"] = json!("cm"));
    assert!(matches!(found, E::UnknownUnits { .. }), "{found:?}");
    for kind in ["Fiducial", "Curve", ""] {
        let found = spoilt(|m| m["type"] = json!(kind));
        assert!(matches!(found, E::WrongType { .. }), "{found:?}");
    }
    for name in ["L4", "left", "L4_left_right", "L4_L5_left", "L6_left", ""] {
        let found = spoilt(|m| m["name"] = json!(name));
        assert!(matches!(found, E::Name { .. }), "{name}: {found:?}");
    }
    let found = spoilt(|m| _ = m["controlPoints"].as_array_mut().unwrap().pop());
    assert!(matches!(found, E::PointCount { found: 1, .. }), "{found:?}");
    for status in ["undefined", "preview", "missing"] {
        let found = spoilt(|m| m["controlPoints"][1]["positionStatus"] = json!(status));
        assert!(matches!(found, E::NotDefined { point: 1, .. }), "{found:?}");
    }
    for bad in [
        json!([1, 2]),
        json!([1, 2, 3, 4]),
        json!(["NaN", 2, 3]),
        json!([null, 2, 3]),
        json!(null),
        json!(7),
    ] {
        let found = spoilt(|m| m["controlPoints"][0]["position"] = bad.clone());
        assert!(
            matches!(found, E::Position { point: 0, .. }),
            "{bad}: {found:?}"
        );
    }
    let found = spoilt(|m| m["controlPoints"][0]["description"] = json!("diameter_mm=thick"));
    assert!(matches!(found, E::Diameter { .. }), "{found:?}");
}

#[test]
fn nan_and_numbers_that_make_no_plan() {
    let folder = Folder::new();
    // Python writes a bare NaN, which is no JSON: the place is named.
    let text = file(line("LPS")).to_string().replace("4.5", "NaN");
    let path = folder.path("nan.mrk.json");
    std::fs::write(&path, text).unwrap();
    let error = read_plan(&path).unwrap_err();
    assert!(matches!(error, FormatError::Syntax { .. }), "{error:?}");
    assert!(error.to_string().contains("nan.mrk.json:1:"), "{error}");

    let mut thick = line("LPS");
    thick["controlPoints"][0]["description"] = json!("diameter_mm=NaN");
    let error = read_plan(folder.file("a.json", &file(thick))).unwrap_err();
    assert!(matches!(error, FormatError::Plan { .. }), "{error:?}");
    let error = read_plan(folder.file("b.json", &json!({"markups": [line("LPS"), line("LPS")]})));
    assert!(
        matches!(error, Err(FormatError::Plan { .. })),
        "twice: {error:?}"
    );
    let error = read_plan(folder.file("c.json", &json!({"markups": []})));
    assert!(
        matches!(error, Err(FormatError::Markups { .. })),
        "nothing: {error:?}"
    );
    // A plan where landmarks are expected.
    let error = read_landmarks(folder.file("d.json", &file(line("LPS"))));
    let Err(FormatError::Markups { source, .. }) = error else {
        panic!("{error:?}")
    };
    assert!(
        matches!(*source, MarkupsError::WrongType { .. }),
        "{source:?}"
    );
}
