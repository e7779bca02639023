//! Binary glTF, written and read by ourselves, and files that lie.

use nalgebra::{Point3, Vector3};
use pedicle::shape::{ColoredShape, glb_bytes};
use pedicle::{GlbError, read_glb};
use pedicle_mesh::TriMesh;
use serde_json::{Value, json};

fn tetrahedron() -> TriMesh {
    let vertices = vec![
        Point3::new(0.1, -0.2, 300.3),
        Point3::new(10.4, 0.0, 300.0),
        Point3::new(0.0, 10.5, 300.0),
        Point3::new(0.0, 0.0, 310.6),
    ];
    TriMesh::new(vertices, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()
}

fn bytes(translation: Vector3<f64>) -> Vec<u8> {
    let mesh = tetrahedron();
    glb_bytes(&[ColoredShape {
        name: "L3",
        mesh: &mesh,
        colors: &[[10, 20, 30]; 4],
        translation,
    }])
}

/// Reads bytes from a file.
fn read(bytes: &[u8]) -> Result<TriMesh, GlbError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bone.glb");
    std::fs::write(&path, bytes).unwrap();
    read_glb(&path)
}

/// The same file with another document in it.
fn changed(change: impl Fn(&mut Value)) -> Vec<u8> {
    let good = bytes(Vector3::zeros());
    let number = |at: usize| u32::from_le_bytes(good[at..at + 4].try_into().unwrap()) as usize;
    let end = 20 + number(12);
    let mut document: Value = serde_json::from_slice(&good[20..end]).unwrap();
    change(&mut document);
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = good[..8].to_vec();
    let length = 20 + text.len() + good.len() - end;
    file.extend((length as u32).to_le_bytes());
    file.extend((text.len() as u32).to_le_bytes());
    file.extend(b"JSON");
    file.extend(text);
    file.extend(&good[end..]);
    file
}

#[test]
fn what_is_written_is_read_as_single_floats() {
    let mesh = tetrahedron();
    let rounded = mesh
        .vertices()
        .iter()
        .map(|p| p.map(|x| f64::from(x as f32)));
    let rounded = TriMesh::new(rounded.collect(), mesh.faces().to_vec()).unwrap();
    assert_eq!(read(&bytes(Vector3::zeros())).unwrap(), rounded, "exact");
    let moved = read(&bytes(Vector3::new(5.0, -7.0, 0.5))).unwrap();
    let off = moved.vertices()[0] - rounded.vertices()[0] - Vector3::new(5.0, -7.0, 0.5);
    assert!(off.norm() < 1e-12, "nodes place their meshes: {off}");
    let twice = changed(|d| {
        d["nodes"] = json!([{"children": [1, 2]}, {"mesh": 0}, {"mesh": 0, "scale": [2, 2, 2]}]);
        d["scenes"][0]["nodes"] = json!([0]);
    });
    let twice = read(&twice).unwrap();
    assert_eq!(twice.n_faces(), 8, "all nodes");
    let far = twice.vertices()[4] - rounded.vertices()[0] * 2.0;
    assert!(far.norm() < 1e-12, "each in its place");
}

#[test]
fn files_that_lie_are_refused() {
    for length in [0, 11, 19, 100, bytes(Vector3::zeros()).len() - 8] {
        let error = read(&bytes(Vector3::zeros())[..length]).unwrap_err();
        assert!(error.to_string().contains("bone.glb"), "{length}: {error}");
    }
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 7] = [
        ("positions that are not in the file", |d| {
            d["accessors"][0]["count"] = json!(4_000_000_000_u32);
        }),
        ("positions that are not in the file", |d| {
            d["bufferViews"][0]["byteOffset"] = json!(u32::MAX);
        }),
        ("positions that are not in the file", |d| {
            d["buffers"][0]["uri"] = json!("elsewhere.bin");
        }),
        ("index beyond its positions", |d| {
            d["accessors"][0]["count"] = json!(2)
        }),
        ("not triangles", |d| {
            d["meshes"][0]["primitives"][0]["mode"] = json!(1)
        }),
        ("indices that are not in the file", |d| {
            d["accessors"][3]["componentType"] = json!(5126);
        }),
        ("circle of nodes", |d| {
            d["nodes"][0]["children"] = json!([0])
        }),
    ];
    for (words, change) in cases {
        let error = read(&changed(change)).unwrap_err();
        assert!(
            matches!(error, GlbError::Mesh { .. }) && error.to_string().contains(words),
            "{words}: {error:?}"
        );
    }
    let error = read(&changed(|d| d["scenes"] = json!([]))).unwrap_err();
    assert!(
        matches!(error, GlbError::Surface { .. } | GlbError::Broken { .. }),
        "nothing in it: {error:?}"
    );
}
