//! Mesh files: what is written is read again, and nothing hostile gets through or panics.

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use pedicle_mesh::io::Place;
use pedicle_mesh::{
    Encoding, MeshFormat, ReadError, TriMesh, WriteError, WriteOptions, concatenate, read_mesh,
    read_parts, write_mesh,
};
use proptest::prelude::*;
use tempfile::TempDir;

use crate::shapes::{cube, icosphere, scaled, spine, torus};

pub(crate) fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary directory can be made")
}

pub(crate) fn file(folder: &TempDir, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    // Some file systems flush a file that is written over, which costs milliseconds each time.
    if path.exists() {
        fs::remove_file(&path).expect("a temporary file can be removed");
    }
    fs::write(&path, content).expect("a temporary file can be written");
    path
}

/// Reads `content` as a file called `name`.
pub(crate) fn read(
    name: &str,
    content: impl AsRef<[u8]>,
) -> Result<pedicle_mesh::MeshFile, ReadError> {
    let folder = folder();
    read_mesh(file(&folder, name, content))
}

/// The error of reading `content`, which must be one sentence that begins with the path.
pub(crate) fn message(name: &str, content: impl AsRef<[u8]>) -> String {
    let error = read(name, content).expect_err("the file is not sound");
    let text = error.to_string();
    assert!(!text.contains(['\n', '\t']), "one line: {text}");
    let (_, rest) = text.split_once(name).expect("the path is named");
    rest.trim_start_matches([':', ',', ' ']).to_owned()
}

pub(crate) fn options(encoding: Encoding) -> WriteOptions<'static> {
    WriteOptions {
        encoding,
        ..WriteOptions::default()
    }
}

/// A PLY with properties and elements of every type that a mesh has no use for.
pub(crate) fn rich_ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\r\nformat {format} 1.0\r\ncomment from a scanner\r\nobj_info nothing\r\n\
         element sensor 2\r\nproperty list uchar short samples\r\nproperty char mode\r\n\
         element vertex 4\r\nproperty uchar red\r\nproperty float x\r\nproperty double y\r\n\
         property short z\r\nproperty list ushort int ring\r\nproperty char label\r\n\
         element face 2\r\nproperty int flags\r\nproperty list int ushort vertex_index\r\n\
         element edge 1\r\nproperty int a\r\nend_header\r\n"
    )
    .into_bytes();
    let vertices = [
        (0.0, 0.0, 0, 7),
        (1.5, 0.0, 0, 7),
        (1.5, 2.25, 0, 7),
        (0.0, 2.25, -3, 7),
    ];
    if format == "ascii" {
        bytes.extend(b"2 10 -20 1\n0 -1\n\n");
        for (x, y, z, label) in vertices {
            bytes.extend(format!("255 {x} {y} {z} 2 5 6 {label}\n").bytes());
        }
        bytes.extend(b"9 4 0 1 2 3\n 8   3 0 1 3 \n5\n");
        return bytes;
    }
    let little = format == "binary_little_endian";
    let mut put = |value: &[u8]| {
        // Values arrive in big-endian order.
        let mut value = value.to_vec();
        if little {
            value.reverse();
        }
        bytes.extend(value);
    };
    put(&[2]);
    put(&10_i16.to_be_bytes());
    put(&(-20_i16).to_be_bytes());
    put(&[1]);
    put(&[0]);
    put(&[255]);
    for (x, y, z, label) in vertices {
        put(&[255]);
        put(&(x as f32).to_be_bytes());
        put(&f64::to_be_bytes(y));
        put(&i16::to_be_bytes(z));
        put(&2_u16.to_be_bytes());
        put(&5_i32.to_be_bytes());
        put(&6_i32.to_be_bytes());
        put(&i8::to_be_bytes(label));
    }
    for corners in [&[0_u16, 1, 2, 3][..], &[0, 1, 3]] {
        put(&9_i32.to_be_bytes());
        put(&(corners.len() as i32).to_be_bytes());
        for corner in corners {
            put(&corner.to_be_bytes());
        }
    }
    put(&5_i32.to_be_bytes());
    bytes
}

pub(crate) const PLY_FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

#[test]
fn every_format_gives_back_what_was_written() {
    let folder = folder();
    // Third parts have no short decimal form, so text must carry all digits.
    let mesh = scaled(&torus(7, 5), 1.0 / 3.0);
    for name in ["mesh.ply", "mesh.OBJ", "mesh.off", "mesh.stl"] {
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let path = folder.path().join(name);
            write_mesh(&path, &mesh, &options(encoding)).unwrap();
            let found = read_mesh(&path).unwrap();
            assert_eq!(
                Some(found.format),
                MeshFormat::from_path(Path::new(name)),
                "{name}"
            );
            assert_eq!(found.vertex_labels, None, "{name}");
            if name != "mesh.stl" {
                assert_eq!(found.mesh, mesh, "{name} as {encoding:?}");
                continue;
            }
            assert_eq!(
                found.mesh.n_vertices(),
                mesh.n_vertices(),
                "corners are welded"
            );
            for face in 0..mesh.n_faces() {
                for (p, q) in found.mesh.triangle(face).iter().zip(mesh.triangle(face)) {
                    let tolerance = if encoding == Encoding::Ascii {
                        0.0
                    } else {
                        1e-7
                    };
                    assert!((p - q).amax() <= tolerance, "{encoding:?}: {p} for {q}");
                }
            }
        }
    }
    let left = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 4, "no temporary file is left behind");
}

#[test]
fn labels_colors_and_comments_survive() {
    let folder = folder();
    let mesh = cube();
    let labels = [0, 1, 2, 20, 24, 255, 65_536, u32::MAX];
    let colors = [[1, 2, 3]; 8];
    for encoding in [Encoding::Ascii, Encoding::Binary] {
        let path = folder.path().join("cube.ply");
        let options = WriteOptions {
            vertex_labels: Some(&labels),
            vertex_colors: Some(&colors),
            encoding,
            comments: vec!["first\nsecond".to_owned(), "third".to_owned()],
        };
        write_mesh(&path, &mesh, &options).unwrap();
        let found = read_mesh(&path).unwrap();
        assert_eq!(found.mesh, mesh, "{encoding:?}");
        assert_eq!(
            found.vertex_labels.as_deref(),
            Some(&labels[..]),
            "{encoding:?}"
        );
        assert_eq!(found.comments, ["first", "second", "third"], "{encoding:?}");
        for name in ["cube.obj", "cube.off"] {
            let path = folder.path().join(name);
            let options = WriteOptions {
                comments: options.comments.clone(),
                ..WriteOptions::default()
            };
            write_mesh(&path, &mesh, &options).unwrap();
            let comments = read_mesh(&path).unwrap().comments;
            assert_eq!(comments, ["first", "second", "third"], "{name}");
        }
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused_before_anything_is_written() {
    let folder = folder();
    let mesh = cube();
    let path = folder.path().join("cube.stl");
    let labelled = WriteOptions {
        vertex_labels: Some(&[1; 8]),
        ..WriteOptions::default()
    };
    let refused = write_mesh(&path, &mesh, &labelled).unwrap_err();
    assert!(
        matches!(refused, WriteError::Unsupported { .. }),
        "{refused}"
    );
    let huge = scaled(&mesh, 1e60);
    let refused = write_mesh(&path, &huge, &WriteOptions::default()).unwrap_err();
    assert!(
        refused.to_string().contains("beyond the range of f32"),
        "{refused}"
    );
    let short = WriteOptions {
        vertex_labels: Some(&[1; 7]),
        ..WriteOptions::default()
    };
    let refused = write_mesh(folder.path().join("cube.ply"), &mesh, &short).unwrap_err();
    assert!(
        refused
            .to_string()
            .ends_with("7 labels are given for 8 vertices"),
        "{refused}"
    );
    let refused = write_mesh(
        folder.path().join("cube.vtk"),
        &mesh,
        &options(Encoding::Ascii),
    );
    assert!(
        matches!(refused, Err(WriteError::UnknownFormat { .. })),
        "vtk is not known"
    );
    let refused = write_mesh(
        folder.path().join("no/cube.ply"),
        &mesh,
        &options(Encoding::Ascii),
    );
    assert!(
        matches!(refused, Err(WriteError::Io { .. })),
        "there is no such directory"
    );
    let left = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(left, 0, "nothing was written");
}

#[test]
fn a_rich_ply_is_read_in_every_encoding() {
    for format in PLY_FORMATS {
        let found = read("rich.ply", rich_ply(format)).unwrap();
        let points = [
            [0.0, 0.0, 0.0],
            [1.5, 0.0, 0.0],
            [1.5, 2.25, 0.0],
            [0.0, 2.25, -3.0],
        ];
        assert_eq!(found.mesh.vertices(), points.map(Point3::from), "{format}");
        assert_eq!(
            found.mesh.faces(),
            [[0, 1, 2], [0, 2, 3], [0, 1, 3]],
            "{format}"
        );
        assert_eq!(found.vertex_labels, Some(vec![7; 4]), "{format}");
        assert_eq!(found.comments, ["from a scanner"], "{format}");
    }
}

#[test]
fn obj_takes_every_way_to_name_a_corner() {
    let text = "# made by hand\nmtllib none.mtl\no part\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.5 0.5 0.5\n\
        vt 0 0\nvn 0 0 1\ng first\nusemtl red\ns off\nf 1/1 2/1/1 3//1\n\
        g second\nv 0 1 .5\nf -4 -2 -1 # the last\nf 1 2 3 4\n";
    let found = read("m.obj", text).unwrap();
    assert_eq!(found.mesh.n_vertices(), 4, "groups share their vertices");
    assert_eq!(
        found.mesh.vertices()[3],
        Point3::new(0.0, 1.0, 0.5),
        "numbers may begin with a point"
    );
    let faces = [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]];
    assert_eq!(
        found.mesh.faces(),
        faces,
        "indices from the front, the back and a quad"
    );
    assert_eq!(
        found.comments,
        ["made by hand"],
        "whole-line comments are kept"
    );
    let cases = [
        (
            "v 0 0 0\nf 0 1 2\n",
            "line 2: a face names vertex 0, but vertices are counted from 1",
        ),
        ("v 0 0 0\nf 1 1 2\n", "line 2: the face names vertex 1, but"),
        (
            "v 0 0 0\nf 1 1 -2\n",
            "line 2: the face names vertex -1, but",
        ),
        (
            "v 0 0 0\nf 1 1\n",
            "line 2: a face needs at least 3 corners",
        ),
        ("v 0 0\n", "line 1: a vertex has 3 coordinates, this one 2"),
        ("v 0 0 inf\n", "line 1: the coordinate inf is not finite"),
        (
            "v 0 0 0\nf a b c\n",
            "line 2: \"a\" is not a corner of a face",
        ),
        ("", "the mesh is empty: 0 vertices and 0 faces"),
    ];
    for (content, expected) in cases {
        let found = message("m.obj", content);
        assert!(
            found.starts_with(expected),
            "{found:?} should begin {expected:?}"
        );
    }
}

#[test]
fn off_tolerates_comments_colors_and_counts_beside_the_keyword() {
    let tetrahedron =
        "0 0 0\n1 0 0 # a comment\n\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3 255 0 0\n3 0 3 2\n";
    for head in [
        "OFF\n4 4 6\n",
        "# first\nOFF 4 4 6\n",
        "OFF\n# between\n4 4\n",
    ] {
        let found = read("t.off", head.to_owned() + tetrahedron).unwrap();
        assert_eq!(found.mesh.n_vertices(), 4, "{head}");
        assert_eq!(found.mesh.faces()[2], [1, 2, 3], "{head}");
    }
    let coff = "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 0 0 255\n0 1 0 9 9 9 255\n3 0 1 2\n";
    assert_eq!(
        read("t.off", coff).unwrap().mesh.n_vertices(),
        3,
        "colours are passed over"
    );
    let cases = [
        (
            "PLY\n",
            "line 1: the file should begin with OFF, not \"PLY\"",
        ),
        (
            "OFF\n3\n",
            "line 2: the numbers of vertices and faces are expected here",
        ),
        ("OFF\n3 x\n", "line 2: \"x\" is not a count"),
        (
            "OFF\n1 1 0\n0 0 nan\n3 0 0 0\n",
            "line 3: the coordinate NaN is not finite",
        ),
        (
            "OFF\n1 1 0\n0 0\n3 0 0 0\n",
            "line 3: a vertex has 3 coordinates, this one 2",
        ),
        (
            "OFF\n1 1 0\n0 0 0\n3 0 0 1\n",
            "line 4: the face names vertex 1",
        ),
        (
            "OFF\n1 2 0\n0 0 0\n4 0 0 0\n3 0 0 0\n",
            "line 4: the face announces 4 corners, but has 3",
        ),
        ("OFF\n", "the file is cut off"),
        ("", "the file is cut off"),
    ];
    for (content, expected) in cases {
        let found = message("t.off", content);
        assert!(
            found.starts_with(expected),
            "{found:?} should begin {expected:?}"
        );
    }
}

#[test]
fn stl_of_several_solids_and_binary_ones_that_say_solid_are_read() {
    let facet = |z: f64| {
        format!(
            "facet normal 0 0 1\n outer loop\n  vertex 0 0 {z}\n  vertex 1 0 {z}\n  \
             vertex 0 1 -0\n endloop\nendfacet\n"
        )
    };
    let text = format!(
        "solid\n{}endsolid\nsolid two\n{}endsolid two\n",
        facet(0.0),
        facet(0.1)
    );
    let found = read("s.stl", &text).unwrap().mesh;
    assert_eq!(found.n_faces(), 2, "both solids");
    assert_eq!(found.n_vertices(), 5, "0 and -0 are one point");
    let folder = folder();
    let path = folder.path().join("s.stl");
    write_mesh(&path, &cube(), &options(Encoding::Binary)).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes[..6].copy_from_slice(b"solid ");
    assert_eq!(
        read("s.stl", &bytes).unwrap().mesh.n_vertices(),
        8,
        "a binary file"
    );
    bytes[84 + 12..84 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    let found = message("s.stl", &bytes);
    assert_eq!(
        found, "triangle 0: the coordinate NaN is not finite",
        "no NaN gets in"
    );
    let cases = [
        (
            text.replace("endloop", "end loop"),
            "line 7: \"end\" is not a keyword of STL",
        ),
        (
            text.replacen("  vertex 1 0 0\n", "", 1),
            "line 7: the facet that ends here",
        ),
        (
            text.replace("vertex 1 0 0.1", "vertex 1 0"),
            "line 14: a vertex has 3 coordinates",
        ),
        (text[..text.len() - 40].to_owned(), "the file is cut off"),
        ("solid\n".to_owned() + &facet(0.0), "the file is cut off"),
    ];
    for (content, expected) in cases {
        let found = message("s.stl", content);
        assert!(
            found.starts_with(expected),
            "{found:?} should begin {expected:?}"
        );
    }
}

#[test]
fn parts_come_from_a_directory_or_from_labels() {
    let folder = folder();
    let (first, second) = (cube(), icosphere(1));
    write_mesh(
        folder.path().join("L2.ply"),
        &second,
        &options(Encoding::Binary),
    )
    .unwrap();
    write_mesh(
        folder.path().join("L1.off"),
        &first,
        &options(Encoding::Ascii),
    )
    .unwrap();
    file(&folder, "notes.txt", "not a mesh");
    file(&folder, ".L3.ply", "hidden");
    let parts = read_parts(folder.path()).unwrap();
    let names: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
    assert_eq!(names, ["L1", "L2"], "sorted by name");
    assert_eq!(
        (&parts[0].mesh, parts[0].label),
        (&first, None),
        "the first"
    );
    let one = read_parts(folder.path().join("L2.ply")).unwrap();
    assert_eq!(
        (one.len(), one[0].name.as_str()),
        (1, "L2"),
        "a file without labels"
    );

    let both = concatenate(&[&first, &second]).unwrap();
    let mut labels: Vec<u32> = vec![24; first.n_vertices()];
    labels.extend(vec![20; second.n_vertices()]);
    let path = folder.path().join("both.ply");
    fn labelled(labels: &[u32]) -> WriteOptions<'_> {
        WriteOptions {
            vertex_labels: Some(labels),
            ..WriteOptions::default()
        }
    }
    write_mesh(&path, &both, &labelled(&labels)).unwrap();
    let parts = read_parts(&path).unwrap();
    assert_eq!(
        (parts[0].name.as_str(), parts[0].label),
        ("20", Some(20)),
        "by label"
    );
    assert_eq!(
        (&parts[0].mesh, &parts[1].mesh),
        (&second, &first),
        "the meshes come apart"
    );
    labels[0] = 20;
    write_mesh(&path, &both, &labelled(&labels)).unwrap();
    let text = read_parts(&path).unwrap_err().to_string();
    assert!(
        text.ends_with("face 0: its corners have the labels 20, 24 and 24"),
        "{text}"
    );

    let empty = tempfile::tempdir().unwrap();
    let error = read_parts(empty.path()).unwrap_err();
    assert!(matches!(error, ReadError::NoMeshFile { .. }), "{error}");
    let error = read_parts(folder.path().join("absent.ply")).unwrap_err();
    assert!(matches!(error, ReadError::Io { .. }), "{error}");
    let error = read_mesh(folder.path().join("notes.txt")).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("\"txt\" is none of ply, stl, obj, off and vtp"),
        "{error}"
    );
}

#[test]
fn places_read_like_words() {
    let place = Place::Line(3);
    assert_eq!(place.to_string(), "line 3", "a line");
    assert_eq!(Place::Header.to_string(), "header", "the header");
}

#[test]
fn real_vertebrae_survive_every_lossless_format() {
    let Some(vertebrae) = spine("vhp-male-remus") else {
        return;
    };
    let folder = folder();
    for name in ["v.ply", "v.obj", "v.off"] {
        let path = folder.path().join(name);
        write_mesh(&path, &vertebrae[0], &WriteOptions::default()).unwrap();
        assert_eq!(read_mesh(&path).unwrap().mesh, vertebrae[0], "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_mesh_survives(
        points in prop::collection::vec(prop::array::uniform3(prop::num::f64::NORMAL), 1..9),
        corners in prop::collection::vec(prop::array::uniform3(0usize..9), 1..9),
        ascii in any::<bool>(),
        name in prop::sample::select(vec!["m.ply", "m.obj", "m.off"]),
    ) {
        let n = points.len();
        let faces = corners.iter().map(|c| c.map(|v| (v % n) as u32)).collect();
        let mesh = TriMesh::new(points.into_iter().map(Point3::from).collect(), faces).unwrap();
        let folder = folder();
        let path = folder.path().join(name);
        let encoding = if ascii { Encoding::Ascii } else { Encoding::Binary };
        write_mesh(&path, &mesh, &options(encoding)).unwrap();
        prop_assert_eq!(read_mesh(&path).unwrap().mesh, mesh);
    }
}
