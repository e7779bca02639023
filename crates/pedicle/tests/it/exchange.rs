//! Import, conversion and what a transfer gives to other programs.

use std::fs;
use std::path::Path;

use nalgebra::{Matrix4, Point3};
use pedicle::{ImportFile, TransferFile, TransformsFile, read_itk_transform};
use pedicle_mesh::{Space, WriteOptions, read_mesh, write_mesh};
use pedicle_trajectory::{
    Level, MarkupsOptions, read_landmarks, read_plan, read_plan_with, write_landmarks,
};

use crate::support::{Scene, fixture, pedicle, stderr};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn meshes_of_other_programs_become_a_spine_folder() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut arguments = vec!["import".to_owned()];
    for level in Level::ALL {
        let ras = read_mesh(fixture(&format!("{level}.ply"))).unwrap().mesh;
        let lps = pedicle::in_space(&ras, Space::Ras, Space::Lps);
        let path = at(&format!("vertebra_{level}.vtp"));
        let comments = vec!["SPACE=LPS".to_owned()];
        write_mesh(
            &path,
            &lps,
            &WriteOptions {
                comments,
                ..WriteOptions::default()
            },
        )
        .unwrap();
        arguments.push(text(&path).to_owned());
    }
    let spine = at("spine");
    arguments.extend([
        "-o".to_owned(),
        text(&spine).to_owned(),
        "--json".to_owned(),
        "-".to_owned(),
    ]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let output = pedicle(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let report: ImportFile = serde_json::from_slice(&output.stdout).expect("JSON and nothing else");
    assert_eq!(
        (report.levels.len(), report.missing.len()),
        (5, 0),
        "all levels"
    );
    for (ours, theirs) in pedicle::read_spine(&spine)
        .unwrap()
        .iter()
        .zip(pedicle::read_spine(fixture("")).unwrap())
    {
        assert_eq!(
            ours.surface, theirs.surface,
            "{} exact in RAS",
            theirs.level
        );
    }
    // Nothing is written over without --force.
    let again = pedicle(&arguments);
    assert_eq!(again.status.code(), Some(2), "there already");
    assert!(
        stderr(&again).contains("L1.ply: there already; --force"),
        "{}",
        stderr(&again)
    );
    let forced = pedicle(&[&arguments[..], &["--force"]].concat());
    assert_eq!(forced.status.code(), Some(0), "{}", stderr(&forced));
}

#[test]
fn meshes_without_a_frame_or_a_level_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let spine = folder.path().join("spine");
    let unknown = pedicle(&["import", text(&fixture("L3.ply")), "-o", text(&spine)]);
    assert_eq!(unknown.status.code(), Some(2), "no frame");
    assert!(stderr(&unknown).contains("--frame"), "{}", stderr(&unknown));
    let one = pedicle(&[
        "import",
        text(&fixture("L3.ply")),
        "--frame",
        "ras",
        "-o",
        text(&spine),
    ]);
    assert_eq!(one.status.code(), Some(3), "one of five: {}", stderr(&one));
    assert!(
        String::from_utf8_lossy(&one.stdout).contains("NOT there: L1, L2, L4, L5"),
        "said"
    );
    let nameless = folder.path().join("bone.ply");
    fs::copy(fixture("L3.ply"), &nameless).unwrap();
    let refused = pedicle(&[
        "import",
        text(&nameless),
        "--frame",
        "RAS",
        "-o",
        text(&spine),
        "--force",
    ]);
    assert!(
        stderr(&refused).contains("bone.ply: the name does not tell"),
        "{}",
        stderr(&refused)
    );
}

#[test]
fn a_broken_label_map_and_an_unknown_scheme() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("labels.nii.gz");
    fs::write(&path, "no NIfTI at all, whatever the name says").unwrap();
    let spine = folder.path().join("spine");
    for (more, word) in [
        (&[][..], "labels.nii.gz: broken NIfTI header"),
        (&["--scheme", "mine"], "verse nor totalsegmentator"),
        (&["--scheme", "no-such.ron"], "no-such.ron"),
        (&["--smoothing", "9"], "between 0 and 3"),
    ] {
        let output = pedicle(&[&["import", text(&path), "-o", text(&spine)], more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(
            stderr(&output).contains(word),
            "no '{word}' in: {}",
            stderr(&output)
        );
    }
    assert!(!spine.exists(), "nothing is left behind");
}

#[test]
fn plans_and_landmarks_are_converted_both_ways() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let convert = |from: &Path, to: &Path| {
        let output = pedicle(&["convert", text(from), text(to)]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    };
    let (markups, back) = (at("plan.mrk.json"), at("back.ron"));
    convert(&fixture("plan.ron"), &markups);
    convert(&markups, &back);
    assert_eq!(
        read_plan(&back).unwrap(),
        read_plan(fixture("plan.ron")).unwrap(),
        "exact"
    );
    let (markups, back) = (at("landmarks.mrk.json"), at("back.json"));
    convert(&fixture("landmarks.ron"), &markups);
    convert(&markups, &back);
    let expected = read_landmarks(fixture("landmarks.ron")).unwrap();
    assert_eq!(read_landmarks(&back).unwrap(), expected, "exact");
}

#[test]
fn a_plan_in_the_wrong_coordinates_is_detected() {
    let mut scene = Scene::new();
    let markups = scene.folder.path().join("plan.mrk.json");
    let output = pedicle(&["convert", text(&scene.plan), text(&markups)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let called_ras = fs::read_to_string(&markups)
        .unwrap()
        .replace("\"LPS\"", "\"RAS\"");
    scene.plan = scene.file("wrong.mrk.json", &called_ras);
    let output = scene.transfer(&[]);
    assert_eq!(output.status.code(), Some(2), "refused");
    let message = stderr(&output);
    for word in [
        "wrong.mrk.json",
        "10 of 10",
        "outside the spine",
        "x and y negated",
    ] {
        assert!(message.contains(word), "no '{word}' in: {message}");
    }
    // The same numbers are right for a spine in LPS.
    let path = scene.folder.path().join("lps.ron");
    let wrong = scene.plan.clone();
    let output = pedicle(&[
        "convert",
        text(&wrong),
        text(&path),
        "--spine",
        text(&scene.source),
        "--frame",
        "LPS",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn a_transfer_gives_transforms_a_plan_and_a_spine() {
    let scene = Scene::new();
    let at = |name: &str| scene.folder.path().join(name);
    let (json, plan, transforms, moved) = (
        at("r.json"),
        at("on-target.mrk.json"),
        at("transforms"),
        at("moved"),
    );
    let output = scene.transfer(&[
        "--json",
        text(&json),
        "--plan-out",
        text(&plan),
        "--transforms",
        text(&transforms),
        "--spine-out",
        text(&moved),
        "--format",
        "vtp",
        "--target-frame",
        "LPS",
        "--quiet",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(output.stdout.is_empty(), "quiet");
    let result: TransferFile = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    let listed: TransformsFile =
        serde_json::from_str(&fs::read_to_string(transforms.join("transforms.json")).unwrap())
            .unwrap();
    assert_eq!(
        (&*listed.source_space, &*listed.target_space),
        ("RAS", "LPS"),
        "spaces"
    );
    for (vertebra, source) in result
        .vertebrae
        .iter()
        .zip(pedicle::read_spine(&scene.source).unwrap())
    {
        let matrix = Matrix4::from_fn(|i, j| vertebra.target_from_source[i][j]);
        let itk = read_itk_transform(&transforms.join(format!("{}.tfm", vertebra.level))).unwrap();
        let p = Point3::new(3.0, -40.0, 17.0);
        // From the target, which is in LPS, to the source in LPS.
        let back = itk.transform_point(&matrix.transform_point(&p));
        let expected = Space::Ras.point_to(Space::Lps, &p);
        assert!((back - expected).norm() < 1e-9, "{back} for {expected}");
        let file = read_mesh(moved.join(format!("{}.vtp", vertebra.level))).unwrap();
        let expected = matrix.transform_point(&source.surface.vertices()[7]);
        assert!(
            (file.mesh.vertices()[7] - expected).norm() < 1e-9,
            "in its place"
        );
        assert_eq!(file.comments, ["SPACE=LPS"], "says its space");
    }
    let options = MarkupsOptions {
        space: Space::Lps,
        ..MarkupsOptions::default()
    };
    let found = read_plan_with(&plan, &options).unwrap();
    for (a, b) in found.trajectories.iter().zip(&result.trajectories) {
        assert_eq!(a.entry_mm, Point3::from(b.entry_mm), "exact");
    }
    // A second run must not touch them.
    let again = scene.transfer_without_force(&["--transforms", text(&transforms)]);
    assert!(
        stderr(&again).contains("L1.tfm: there already"),
        "{}",
        stderr(&again)
    );
}

#[test]
fn itk_transforms_of_other_kinds_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tfm");
    let good = "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
                Parameters: 1 0 0 0 1 0 0 0 1 4 5 6\nFixedParameters: 0 0 0\n";
    for (from, to, word) in [
        ("#Insight", "#Other", "line 1"),
        ("AffineTransform", "BSplineTransform", "no affine"),
        ("4 5 6", "4 5", "11 numbers"),
        ("4 5 6", "4 NaN 6", "NaN"),
        ("FixedParameters", "Center", "FixedParameters"),
        (
            "#Transform 0\n",
            "Transform: AffineTransform_double_3_3\n",
            "more than one",
        ),
    ] {
        fs::write(&path, good.replace(from, to)).unwrap();
        let error = read_itk_transform(&path).unwrap_err().to_string();
        assert!(
            error.contains("a.tfm: ") && error.contains(word),
            "no '{word}' in: {error}"
        );
    }
    fs::write(&path, good).unwrap();
    let image = read_itk_transform(&path)
        .unwrap()
        .transform_point(&Point3::origin());
    assert_eq!(image, Point3::new(4.0, 5.0, 6.0), "read");
}

#[test]
fn landmarks_of_the_source_are_found_from_its_shape() {
    let scene = Scene::new();
    let landmarks = scene.folder.path().join("target.mrk.json");
    let target = read_landmarks(&scene.target_landmarks).unwrap();
    write_landmarks(&landmarks, &target).unwrap();
    let output = pedicle(&[
        "transfer",
        "--source",
        text(&scene.source),
        "--plan",
        text(&scene.plan),
        "--target",
        text(&scene.target),
        "--target-landmarks",
        text(&landmarks),
        "--json",
        "-",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let result: TransferFile =
        serde_json::from_slice(&output.stdout).expect("JSON and nothing else");
    assert!(result.vertebrae.iter().all(|v| v.accepted), "all accepted");
}

#[test]
fn every_command_has_examples_and_completions_exist() {
    for command in [
        "import",
        "convert",
        "transfer",
        "demo",
        "map",
        "spectrum",
        "completions",
    ] {
        let help = pedicle(&[command, "--help"]);
        let text = String::from_utf8_lossy(&help.stdout).into_owned();
        assert!(text.contains("Examples:"), "{command}:\n{text}");
        assert!(
            text.contains("--quiet") && text.contains("--force"),
            "{command}:\n{text}"
        );
        assert!(
            !text.contains('\u{1b}'),
            "no colours where there is no terminal"
        );
    }
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let output = pedicle(&["completions", shell]);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            text.contains("spectrum") && text.contains("target-landmarks"),
            "{shell}"
        );
    }
}

/// Bounds on the import of a real label map: seconds of all threads together, so that a busy machine
/// does not count, and kB of memory.
const IMPORT_SECONDS: f64 = 5.0;
const IMPORT_KB: u64 = 500_000;

/// Runs a command to its end; processor seconds and peak memory in kB as Linux tells them.
fn measured(command: &mut std::process::Command) -> (std::process::ExitStatus, f64, u64) {
    /// Linux counts processor time in hundredths of a second, whatever the kernel's own clock.
    const TICKS_PER_SECOND: f64 = 100.0;
    let mut child = command.spawn().unwrap();
    let folder = Path::new("/proc").join(child.id().to_string());
    let (mut seconds, mut peak_kb) = (0.0, 0);
    loop {
        // What stands after the name, which is in brackets, are fields 3 and on; 14 and 15 are times.
        if let Some(ticks) = fs::read_to_string(folder.join("stat"))
            .ok()
            .and_then(|stat| {
                let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
                Some(fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?)
            })
        {
            seconds = ticks / TICKS_PER_SECOND;
        }
        let status = fs::read_to_string(folder.join("status")).unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        if let Some(kb) = peak.and_then(|text| text.split_whitespace().next()?.parse().ok()) {
            peak_kb = kb;
        }
        if let Some(status) = child.try_wait().unwrap() {
            return (status, seconds, peak_kb);
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
}

#[test]
fn a_real_label_map_is_imported_in_time_and_memory() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/verse010");
    if !data.is_dir() || !cfg!(target_os = "linux") {
        println!("skipped: no real label map beside the checkout, or not on Linux");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let spine = folder.path().join("spine");
    let (status, seconds, peak_kb) = measured(
        std::process::Command::new(env!("CARGO_BIN_EXE_pedicle"))
            .args(["import", "--quiet", "-o", text(&spine)])
            .arg(data.join("sub-verse010_seg-vert_msk.nii.gz")),
    );
    assert!(status.success(), "{status}");
    println!("imported in {seconds} s of processor time and {peak_kb} kB");
    assert!(0.0 < seconds && seconds < IMPORT_SECONDS, "{seconds} s");
    assert!(0 < peak_kb && peak_kb < IMPORT_KB, "{peak_kb} kB");
    assert_eq!(
        pedicle::read_spine(&spine).unwrap().len(),
        5,
        "a spine folder"
    );
}
