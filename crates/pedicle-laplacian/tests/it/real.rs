//! Real vertebrae, where the data is at hand.

use std::path::PathBuf;

use pedicle_laplacian::{Construction, LaplaceOptions, Surface, laplace_operators};
use pedicle_mesh::{TriMesh, read_mesh};

use crate::shapes::{operators_by, spectral_difference, spectrum};

/// One vertebra, or `None` with a word about it.
#[allow(clippy::print_stdout, reason = "a test that cannot run says so")]
fn vertebra(path: &str) -> Option<TriMesh> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    let file = folder.join(path);
    if !file.exists() {
        println!("no {path}: nothing tested");
        return None;
    }
    Some(read_mesh(&file).unwrap().mesh)
}

#[test]
fn robust_operators_of_every_vertebra() {
    for spine in ["vhp-male-remus", "verse010"] {
        for level in 1..=5 {
            let Some(mesh) = vertebra(&format!("{spine}/L{level}.ply")) else {
                return;
            };
            let report = operators_by(&mesh, Construction::Robust).report;
            assert_eq!(report.n_negative_weights, 0, "{spine} L{level}");
            assert_eq!(report.n_non_delaunay_edges, 0, "{spine} L{level}");
            let ratio = report.area_mm2 / mesh.area();
            assert!((ratio - 1.0).abs() < 1e-4, "{spine} L{level}: area {ratio}");
        }
    }
}

#[test]
fn facets_that_touch_change_nothing() {
    let Some(mesh) = vertebra("verse010/L5.ply") else {
        return;
    };
    let robust = spectrum(&operators_by(&mesh, Construction::Robust), 30);
    let plain = spectrum(&operators_by(&mesh, Construction::Cotangent), 30);
    let worst = spectral_difference(&robust, &plain);
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn vertices_of_a_vertebra_as_a_cloud() {
    let Some(mesh) = vertebra("vhp-male-remus/L3.ply") else {
        return;
    };
    let options = LaplaceOptions::default();
    let cloud = laplace_operators(Surface::Cloud(mesh.vertices()), &options).unwrap();
    let ratio = cloud.report.area_mm2 / mesh.area();
    assert!((ratio - 1.0).abs() < 0.05, "area {ratio}");
    let eigenvalues = spectrum(&cloud, 20);
    let of_mesh = spectrum(&operators_by(&mesh, Construction::Auto), 20);
    let worst = spectral_difference(&eigenvalues, &of_mesh);
    // Thin processes and sharp rims are where tangent planes fit least.
    assert!(worst < 0.15, "{worst}: {eigenvalues:?} against {of_mesh:?}");
}
