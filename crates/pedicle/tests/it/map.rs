//! `pedicle map` on a bean and its shuffled copy, and on bad input.

use nalgebra::Point3;
use pedicle_mesh::{TriMesh, read_mesh};
use serde_json::Value;

use crate::zoo::{Bench, bean, shuffled_bean};

fn pair(bench: &Bench) -> (String, String, Vec<u32>) {
    let (target, truth) = shuffled_bean();
    (
        bench.mesh("a.ply", &bean()),
        bench.mesh("b.off", &target),
        truth,
    )
}

fn images(result: &Value) -> Vec<u32> {
    let list = result["source_of_target"].as_array().unwrap();
    list.iter().map(|v| v.as_u64().unwrap() as u32).collect()
}

#[test]
fn a_shuffled_copy_is_recognised_exactly() {
    let bench = Bench::new();
    let (a, b, truth) = pair(&bench);
    let (json, ply, glb) = (
        bench.name("m.json"),
        bench.name("m.ply"),
        bench.name("m.glb"),
    );
    let output = bench.run(&["map", &a, &b, "--json", &json, "--ply", &ply, "--glb", &glb]);
    let result = bench.json("m.json");
    assert_eq!(images(&result), truth, "the permutation");
    assert_eq!(result["format"], "pedicle-map", "format");
    assert_eq!(result["format_version"], 1, "version");
    let quality = |key: &str| result["quality"][key].as_f64().unwrap();
    assert!((quality("coverage") - 1.0).abs() < 1e-12, "coverage");
    assert!(quality("bijectivity_error") < 1e-12, "bijectivity");
    assert!((quality("edge_stretch") - 1.0).abs() < 1e-9, "stretch");
    assert!(quality("torn_edges") < 1e-12, "tears");
    assert!(result["quality"]["energy"]["total"].is_number(), "energy");
    for key in [
        "operators",
        "eigenfunctions",
        "descriptors",
        "fit",
        "zoomout",
        "bcicp",
    ] {
        assert!(
            result["seconds"][key].as_f64().unwrap() > 0.0,
            "seconds of {key}"
        );
    }
    let remark = result["remarks"][0].as_str().unwrap();
    assert!(remark.contains("mirror"), "{remark}");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(printed.contains(remark), "the remark is printed");

    let picture = read_mesh(&ply).unwrap();
    assert_eq!(picture.mesh.n_vertices(), 2 * truth.len(), "both shapes");
    let labels = picture.vertex_labels.unwrap();
    assert_eq!((labels[0], labels[truth.len()]), (0, 1), "labels");
    let bytes = std::fs::read(&ply).unwrap();
    let header = String::from_utf8_lossy(&bytes[..600]).into_owned();
    assert!(header.contains("property uchar red"), "colours: {header}");
    let bytes = std::fs::read(&glb).unwrap();
    assert_eq!(&bytes[..4], b"glTF", "binary glTF");
    assert_eq!(
        u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize,
        bytes.len(),
        "length of the file"
    );
}

#[test]
fn landmarks_sizes_and_threads() {
    let bench = Bench::new();
    let (a, b, truth) = pair(&bench);
    let lines: String = [5, 100, 300, 480]
        .iter()
        .map(|&target: &usize| format!("{} {target}\n", truth[target]))
        .collect();
    let landmarks = bench.text("pairs.txt", &format!("# source target\n{lines}"));
    let run = |threads: &str, name: &str| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pedicle"))
            .env("RAYON_NUM_THREADS", threads)
            .args([
                "map",
                &a,
                &b,
                "--landmarks",
                &landmarks,
                "--json",
                &bench.name(name),
            ])
            .args(["--functions", "40", "--fit-functions", "25", "--step", "3"])
            .args([
                "--refine",
                "zoomout",
                "--operator",
                "cotangent",
                "--scale",
                "keep",
            ])
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            crate::support::stderr(&output)
        );
        bench.json(name)
    };
    let (one, two) = (run("1", "one.json"), run("2", "two.json"));
    assert_eq!(images(&one), truth, "the permutation");
    for key in ["source_of_target", "quality", "landmarks", "sizes"] {
        assert_eq!(one[key], two[key], "{key} depends on the number of threads");
    }
    assert_eq!(one["sizes"]["n_fit"], 25, "size of the fit");
    assert_eq!(one["landmarks"][3]["target"], 480, "landmarks");
    assert_eq!(one["landmarks"][3]["distance"], 0.0, "landmarks are kept");
    assert_eq!(
        one["remarks"].as_array().unwrap().len(),
        0,
        "nothing to say"
    );
}

#[test]
fn sizes_do_not_matter_unless_kept() {
    let bench = Bench::new();
    let (a, _, truth) = pair(&bench);
    let (target, _) = shuffled_bean();
    let vertices = target
        .vertices()
        .iter()
        .map(|p| Point3::from(p.coords * 1000.0));
    let big = TriMesh::new(vertices.collect(), target.faces().to_vec()).unwrap();
    let b = bench.mesh("big.obj", &big);
    let json = bench.name("m.json");
    bench.run(&["map", &a, &b, "--json", &json, "--functions", "40"]);
    let result = bench.json("m.json");
    assert_eq!(images(&result), truth, "the permutation");
    let remarks = result["remarks"].to_string();
    assert!(remarks.contains("--scale keep"), "{remarks}");
    bench.refused(
        &["map", &a, &b, "--functions", "40", "--scale", "keep"],
        &["a.ply and", "big.obj"],
    );
}

#[test]
fn bad_input_is_refused() {
    let bench = Bench::new();
    let (a, b, _) = pair(&bench);
    let json = bench.name("out.json");
    bench.refused(&["map", &a], &["<B>"]);
    bench.refused(
        &["map", &a, &bench.name("no.off"), "--json", &json],
        &["no.off"],
    );
    let empty = bench.text("empty.off", "OFF\n0 0 0\n");
    bench.refused(
        &["map", &empty, &b, "--json", &json],
        &["empty.off", "empty"],
    );
    let nan = bench.text("nan.off", "OFF\n3 1 0\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n");
    bench.refused(&["map", &a, &nan, "--json", &json], &["nan.off", "line 4"]);
    let text = bench.text("pairs.txt", "0 1\n7 582\n");
    bench.refused(
        &["map", &a, &b, "--landmarks", &text, "--json", &json],
        &["pairs.txt, line 2", "vertex 582 of the target", "only 582"],
    );
    let text = bench.text("words.txt", "0 one\n");
    bench.refused(
        &["map", &a, &b, "--landmarks", &text],
        &["words.txt, line 1", "\"one\""],
    );
    bench.refused(
        &["map", &a, &b, "--functions", "600", "--json", &json],
        &["a.ply", "600", "582"],
    );
    bench.refused(
        &["map", &a, &b, "--functions", "30", "--fit-functions", "40"],
        &["40", "30"],
    );
    bench.refused(&["map", &a, &b, "--step", "0"], &["at least 1"]);
    for (option, name, words) in [
        ("--json", "none/m.json", "does not exist"),
        ("--ply", "none/m.ply", "does not exist"),
        ("--ply", "m.stl", "should be .ply"),
        ("--glb", "m.gltf", "should be .glb"),
    ] {
        let output = bench.name(name);
        let mut arguments = vec!["map", &a, &b, option, &output];
        if option != "--json" {
            // The good output must not be written either.
            arguments.extend(["--json", &json]);
        }
        bench.refused(&arguments, &[words]);
    }
}
