//! All 200 reference eigenvalues of real spines, where the data are present.

use std::path::PathBuf;

use pedicle_mesh::io::read_mesh;
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs};

use crate::shapes::operators;

/// A path below the data folder; tells and returns nothing if there is none.
fn data(relative: &str) -> Option<PathBuf> {
    let path =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(relative);
    if path.exists() {
        return Some(path);
    }
    println!("no {relative} beside the checkout: nothing to compare with");
    None
}

fn compare(meshes: &[&str], reference: &str, null_dimension: usize) {
    let Some(reference) = data(reference) else {
        return;
    };
    let mut parts = Vec::new();
    for mesh in meshes {
        let Some(path) = data(mesh) else { return };
        parts.push(read_mesh(&path).unwrap().mesh);
    }
    let parts: Vec<_> = parts.iter().collect();
    let mesh = pedicle_mesh::concatenate(&parts).unwrap();
    let text = std::fs::read_to_string(reference).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let expected: Vec<f64> = json["eigenvalues"]
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_f64().unwrap())
        .collect();
    let (stiffness, mass) = operators(&mesh);
    let pairs =
        smallest_eigenpairs(&stiffness, &mass, expected.len(), &EigenOptions::default()).unwrap();
    check(&pairs, &expected, null_dimension);
}

fn check(pairs: &EigenPairs, expected: &[f64], null_dimension: usize) {
    assert!(pairs.certificate.complete, "certificate");
    assert_eq!(pairs.null_dimension, null_dimension, "null space");
    let last = expected[expected.len() - 1];
    for (i, (found, &expected)) in pairs.eigenvalues.iter().zip(expected).enumerate() {
        if i < null_dimension {
            assert!(found.abs() < 1e-11 * last, "null eigenvalue {i} is {found}");
            continue;
        }
        let error = (found - expected).abs() / expected;
        assert!(
            error <= 1e-9,
            "eigenvalue {i}: {found} against {expected}, error {error:e}"
        );
    }
    let residual = pairs.residuals.iter().fold(0.0_f64, |m, r| m.max(r / last));
    assert!(residual < 1e-9, "residual {residual}");
}

#[test]
fn male_spine_of_3500_faces() {
    compare(
        &["reference/spectra/vhp-male-3500.ply"],
        "reference/spectra/vhp-male-3500.json",
        5,
    );
}

#[test]
fn male_spine_in_full() {
    compare(
        &["L1", "L2", "L3", "L4", "L5"]
            .map(|level| format!("data/vhp-male-remus/{level}.ply"))
            .each_ref()
            .map(String::as_str),
        "reference/spectra/vhp-male-full.json",
        5,
    );
}

#[test]
fn third_vertebra_of_verse010() {
    compare(
        &["data/verse010/L3.ply"],
        "reference/spectra/verse010-L3.json",
        1,
    );
}
