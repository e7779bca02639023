//! Broken, cut and hostile mesh files: always an error that explains itself, never a panic.

use std::fs;

use pedicle_mesh::{Encoding, MeshError, ReadError, read_mesh, write_mesh};
use proptest::prelude::*;

use crate::io::{PLY_FORMATS, file, folder, message, options, read, rich_ply};
use crate::shapes::{icosphere, torus};

#[test]
fn a_file_cut_anywhere_is_an_error_or_a_mesh_but_never_a_panic() {
    let folder = folder();
    let mesh = torus(5, 4);
    let mut files: Vec<(String, Vec<u8>)> = PLY_FORMATS
        .iter()
        .map(|format| ((*format).to_owned() + ".ply", rich_ply(format)))
        .collect();
    for name in ["a.ply", "a.stl", "a.obj", "a.off"] {
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let path = folder.path().join(name);
            write_mesh(&path, &mesh, &options(encoding)).unwrap();
            files.push((name.to_owned(), fs::read(&path).unwrap()));
        }
    }
    for (name, bytes) in files {
        for length in (0..bytes.len()).step_by(1 + bytes.len() / 400) {
            let path = file(&folder, &name, &bytes[..length]);
            let is_binary = !bytes.is_ascii();
            match read_mesh(&path) {
                // Text can end on a number that has lost digits, or on a whole face.
                Ok(found) => {
                    let is_end = length + 8 > bytes.len();
                    assert!(is_end || name == "a.obj", "{name} cut at {length} is read");
                    assert!(found.mesh.n_faces() > 0, "a mesh has faces");
                }
                Err(error) => {
                    let text = error.to_string();
                    assert!(text.contains(&name), "{text}");
                    assert!(!text.contains('\n'), "{text}");
                    let cut_off = matches!(error, ReadError::CutOff { .. });
                    assert!(cut_off || !is_binary || length < 400, "{text}");
                }
            }
        }
    }
}

#[test]
fn cut_files_say_what_is_missing() {
    let folder = folder();
    let path = folder.path().join("s.ply");
    for (encoding, expected) in [(Encoding::Binary, "face"), (Encoding::Ascii, "face")] {
        write_mesh(&path, &icosphere(2), &options(encoding)).unwrap();
        let bytes = fs::read(&path).unwrap();
        let error = read("s.ply", &bytes[..bytes.len() - 100]).unwrap_err();
        let ReadError::CutOff {
            element,
            announced,
            found,
            ..
        } = error
        else {
            panic!("{error}");
        };
        assert_eq!(
            (element.as_str(), announced),
            (expected, 320),
            "{encoding:?}"
        );
        assert!(
            (300..320).contains(&found),
            "{encoding:?}: {found} faces are whole"
        );
    }
    let text = message("s.ply", "ply\nformat ascii 1.0\nelement vertex 3\n");
    assert!(
        text.starts_with("the file is cut off: it announces 1 of element `header`"),
        "{text}"
    );
}

#[test]
fn hostile_counts_allocate_nothing() {
    let huge = "18446744073709551615";
    for format in PLY_FORMATS {
        for (n_vertices, n_faces) in [(huge, "1"), ("0", huge), ("4000000000", "4000000000")] {
            let text = format!(
                "ply\nformat {format} 1.0\nelement vertex {n_vertices}\nproperty double x\n\
                 property double y\nproperty double z\nelement face {n_faces}\n\
                 property list uchar int vertex_indices\nend_header\n0 0 0\n"
            );
            let found = message("h.ply", text);
            assert!(found.starts_with("the file is cut off"), "{found}");
        }
    }
    // A list that announces four thousand million entries.
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n\
        property float y\nproperty float z\nelement face 1\n\
        property list uint uint vertex_indices\nend_header\n"
        .to_vec();
    bytes.extend([0; 12]);
    bytes.extend([255; 24]);
    let found = message("h.ply", bytes);
    assert!(
        found.starts_with("the file is cut off: it announces 1 of element `face`"),
        "{found}"
    );
    let off = message("h.off", format!("OFF\n{huge} 1 0\n0 0 0\n"));
    assert!(off.starts_with("the file is cut off"), "{off}");
    let mut stl = vec![0; 80];
    stl.extend(u32::MAX.to_le_bytes());
    let stl = message("h.stl", stl);
    assert!(
        stl.contains("announces 4294967295 of element `triangle`"),
        "{stl}"
    );
    let empty_rows = "ply\nformat binary_little_endian 1.0\nelement nothing 99999999999\n\
        element vertex 0\nproperty float x\nproperty float y\nproperty float z\nelement face 0\n\
        property list uchar int vertex_indices\nend_header\n";
    let found = message("h.ply", empty_rows);
    assert_eq!(
        found, "header: element `nothing` has no properties",
        "rows of no bytes"
    );
}

#[test]
fn broken_ply_files_are_explained() {
    let header = |vertex: &str, face: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\n{vertex}element face 1\n{face}end_header\n"
        )
    };
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let list = "property list uchar int vertex_indices\n";
    let points = "0 0 0\n1 0 0\n0 1 0\n";
    let good = header(xyz, list) + points;
    let labelled = header(&(xyz.to_owned() + "property float label\n"), list);
    let cases = [
        (
            good.clone() + "3 0 1 5\n",
            "face 0: the face names vertex 5",
        ),
        (
            good.clone() + "3 0 1 -1\n",
            "face 0: the face names vertex -1",
        ),
        (
            good.clone() + "3 0 1 1.5\n",
            "face 0: the face names vertex 1.5",
        ),
        (
            good.clone() + "2 0 1\n",
            "face 0: a face needs at least 3 corners, but this one has 2",
        ),
        (
            good.clone() + "-3 0 1 2\n",
            "line 13: -3 is not the length of a list",
        ),
        (
            good.clone() + "3 0 1 two\n",
            "line 13: \"two\" is not a number",
        ),
        (
            good.clone() + "3 0 1 2 9\n",
            "line 13: more values than element `face` has",
        ),
        (
            good + "3 0 1\n",
            "the file is cut off: it announces 1 of element `face`",
        ),
        (
            header(xyz, list) + "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n",
            "vertex 1: the coordinate NaN is not finite",
        ),
        (
            header(xyz, list) + "0 0 0\n1 0\n0 1 0\n3 0 1 2\n",
            "line 11: too few values for vertex 1",
        ),
        (
            header("property float x\n", list),
            "header: there is no x, y and z",
        ),
        (
            header(&(xyz.to_owned() + "property float x\n"), list),
            "header: two elements, or two properties",
        ),
        (
            header(xyz, "property int vertex_indices\n"),
            "header: there is no list `vertex_indices`",
        ),
        (
            header(xyz, list).replace("vertex 3", "vertex many"),
            "line 3: Couldn't parse line. It reads \"element vertex many\".",
        ),
        (header(xyz, list).replace("ascii", "utf8"), "line 2: "),
        (
            "solid\n".to_owned(),
            "line 1: Expected magic number 'ply'. It reads \"solid\".",
        ),
        (
            labelled.clone() + "0 0 0 1\n1 0 0 2.5\n0 1 0 1\n3 0 1 2\n",
            "vertex 1: the label 2.5 is not a whole number",
        ),
        (
            labelled + "0 0 0 1\n1 0 0 -1\n0 1 0 1\n3 0 1 2\n",
            "vertex 1: the label -1 is not a whole number",
        ),
    ];
    for (content, expected) in cases {
        let found = message("b.ply", &content);
        assert!(
            found.starts_with(expected),
            "{found:?} should begin {expected:?}"
        );
    }
    let empty = header(xyz, list).replace("face 1", "face 0") + points;
    let error = read("b.ply", empty).unwrap_err();
    let expected = MeshError::Empty {
        n_vertices: 3,
        n_faces: 0,
    };
    assert!(
        matches!(&error, ReadError::Mesh { source, .. } if *source == expected),
        "{error}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_bytes_are_an_error_or_a_mesh(
        mut bytes in prop::collection::vec(any::<u8>(), 0..40),
        position in 0usize..600,
        format in 0usize..3,
        name in prop::sample::select(vec!["m.ply", "m.stl", "m.obj", "m.off"]),
    ) {
        // Either nothing but noise, or noise over a sound file.
        let mut sound = rich_ply(PLY_FORMATS[format]);
        let position = position.min(sound.len());
        let end = (position + bytes.len()).min(sound.len());
        sound.splice(position..end, bytes.iter().copied());
        let _ = read("m.ply", &sound);
        bytes.splice(0..0, if name == "m.off" { b"OFF\n3 1 0\n".to_vec() } else { Vec::new() });
        let _ = read(name, &bytes);
    }
}
