//! `pedicle spectrum` against references, in all formats, and on bad input.

use std::path::PathBuf;

use nalgebra::Point3;
use pedicle_mesh::{TriMesh, concatenate, read_mesh};

use crate::zoo::{Bench, bean};

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

/// A path beside the checkout; tells and returns nothing if there is none.
fn shared(relative: &str) -> Option<PathBuf> {
    let path =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(relative);
    if path.exists() {
        return Some(path);
    }
    println!("no {relative} beside the checkout: nothing to compare with");
    None
}

fn compare(mesh: &str, bench: &Bench, reference: &str) {
    let Some(reference) = shared(reference) else {
        return;
    };
    let text = std::fs::read_to_string(reference).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    bench.run(&[
        "spectrum",
        mesh,
        "-k",
        "200",
        "--json",
        &bench.name("out.json"),
    ]);
    let found = bench.json("out.json");
    assert_eq!(found["certified"], true, "certified");
    assert_eq!(found["n_vertices"], expected["n_vertices"], "vertices");
    let area = |x: &serde_json::Value| x.as_f64().unwrap();
    let relative = area(&found["area"]) / area(&expected["total_area"]) - 1.0;
    assert!(relative.abs() < 1e-12, "area {relative}");
    let (values, truth) = (
        numbers(&found["eigenvalues"]),
        numbers(&expected["eigenvalues"]),
    );
    assert_eq!(values.len(), 200, "eigenvalues");
    assert_eq!(numbers(&found["residuals"]).len(), 200, "residuals");
    let null = found["null_dimension"].as_u64().unwrap() as usize;
    for (i, (value, truth)) in values.iter().zip(&truth).enumerate() {
        if i < null {
            assert!(value.abs() < 1e-11 * values[199], "eigenvalue {i}: {value}");
        } else {
            let error = (value / truth - 1.0).abs();
            assert!(
                error <= 1e-9,
                "eigenvalue {i}: {value} for {truth}, {error:e}"
            );
        }
    }
}

#[test]
fn references_of_real_spines() {
    let bench = Bench::new();
    for name in ["vhp-male-3500", "verse010-L3"] {
        let mesh = match name {
            "verse010-L3" => shared("data/verse010/L3.ply"),
            _ => shared("reference/spectra/vhp-male-3500.ply"),
        };
        let Some(mesh) = mesh else { return };
        let reference = format!("reference/spectra/{name}.json");
        compare(mesh.to_str().unwrap(), &bench, &reference);
    }
    let parts: Vec<TriMesh> = (1..=5)
        .filter_map(|level| shared(&format!("data/vhp-male-remus/L{level}.ply")))
        .map(|path| read_mesh(path).unwrap().mesh)
        .collect();
    if parts.len() == 5 {
        let whole = concatenate(&parts.iter().collect::<Vec<_>>()).unwrap();
        let mesh = bench.mesh("whole.ply", &whole);
        compare(&mesh, &bench, "reference/spectra/vhp-male-full.json");
    }
}

#[test]
fn every_format_has_the_same_spectrum() {
    let bench = Bench::new();
    let mut first: Option<Vec<f64>> = None;
    for name in ["bean.ply", "bean.off", "bean.obj", "bean.stl"] {
        let mesh = bench.mesh(name, &bean());
        bench.run(&[
            "spectrum",
            &mesh,
            "-k",
            "30",
            "--json",
            &bench.name("out.json"),
        ]);
        let found = bench.json("out.json");
        assert_eq!(found["n_vertices"], 582, "{name}: vertices");
        assert_eq!(found["null_dimension"], 1, "{name}: one piece");
        assert_eq!(found["format"], "pedicle-spectrum", "{name}: format");
        let values = numbers(&found["eigenvalues"]);
        // Binary STL holds f32.
        let tolerance = if name.ends_with("stl") { 1e-5 } else { 1e-12 };
        let expected = first.get_or_insert_with(|| values.clone());
        for (value, expected) in values.iter().zip(expected.iter()).skip(1) {
            assert!(
                (value / expected - 1.0).abs() < tolerance,
                "{name}: {value}"
            );
        }
    }
}

#[test]
fn the_table_is_for_people() {
    let bench = Bench::new();
    let mesh = bench.mesh("bean.ply", &bean());
    let output = bench.run(&["spectrum", &mesh, "-k", "20"]);
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    for words in [
        "582 vertices",
        "20 eigenvalues, certified",
        "operators: cotangent",
        "│    19 ",
    ] {
        assert!(printed.contains(words), "no '{words}' in\n{printed}");
    }
    let help = bench.run(&["spectrum", "--help"]);
    assert!(
        String::from_utf8_lossy(&help.stdout).contains("Examples:"),
        "examples"
    );
}

#[test]
fn bad_input_is_refused() {
    let bench = Bench::new();
    let mesh = bench.mesh("bean.ply", &bean());
    let json = bench.name("out.json");
    bench.refused(&["spectrum", &bench.name("no.ply")], &["no.ply"]);
    let empty = bench.text("empty.off", "OFF\n0 0 0\n");
    bench.refused(
        &["spectrum", &empty, "--json", &json],
        &["empty.off", "empty"],
    );
    let nan = bench.text("nan.off", "OFF\n3 1 0\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n");
    bench.refused(
        &["spectrum", &nan, "--json", &json],
        &["nan.off", "line 4", "not finite"],
    );
    bench.refused(
        &["spectrum", &mesh, "-k", "583", "--json", &json],
        &["bean.ply", "583", "582"],
    );
    bench.refused(&["spectrum", &mesh, "-k", "0"], &["at least 1"]);
    bench.refused(
        &["spectrum", &mesh, "--json", &bench.name("none/out.json")],
        &["none", "does not exist"],
    );
    let folder = bench.folder.path().to_str().unwrap();
    bench.refused(&["spectrum", &mesh, "--json", folder], &[folder]);
    let lonely = "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n9 9 9\n3 0 1 2\n";
    let lonely = bench.text("lonely.off", lonely);
    bench.refused(
        &["spectrum", &lonely, "-k", "2"],
        &["lonely.off", "vertex 3"],
    );
}

#[test]
fn faces_without_area_are_refused_or_mollified() {
    let bench = Bench::new();
    // A vertex in the middle of an edge makes one face without area.
    let bean = bean();
    let [a, b, c] = bean.faces()[40];
    let middle = nalgebra::center(&bean.vertices()[a as usize], &bean.vertices()[b as usize]);
    let mut vertices: Vec<Point3<f64>> = bean.vertices().to_vec();
    let new = vertices.len() as u32;
    vertices.push(middle);
    let mut faces = bean.faces().to_vec();
    faces[40] = [a, new, c];
    faces.extend([[new, b, c], [a, b, new]]);
    let mesh = bench.mesh("flat.ply", &TriMesh::new(vertices, faces).unwrap());
    let json = bench.name("out.json");
    bench.refused(
        &["spectrum", &mesh, "-k", "9", "--json", &json],
        &["flat.ply", "face 1161"],
    );
    bench.run(&[
        "spectrum",
        &mesh,
        "-k",
        "9",
        "--operator",
        "robust",
        "--json",
        &json,
    ]);
    let found = bench.json("out.json");
    let values = numbers(&found["eigenvalues"]);
    assert!(
        values.windows(2).all(|w| w[0] <= w[1]) && values[8].is_finite(),
        "{values:?}"
    );
    assert_eq!(found["certified"], true, "certified");
}
