//! Operators against what is known exactly.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_laplacian::{MassKind, Mollification, OperatorOptions, cotangent_operators};
use pedicle_mesh::TriMesh;
use proptest::prelude::*;

use crate::shapes::{rectangle, scaled, tetrahedron};

#[test]
fn regular_tetrahedron() {
    let operators = cotangent_operators(&tetrahedron(), &OperatorOptions::default()).unwrap();
    let area = 3.0_f64.sqrt() * 8.0;
    assert!((operators.report.area_mm2 - area).abs() < 1e-13, "area");
    for (&w, (i, j)) in operators.stiffness.iter() {
        let off_diagonal = -1.0 / 3.0_f64.sqrt();
        let expected = if i == j {
            -3.0 * off_diagonal
        } else {
            off_diagonal
        };
        assert!((w - expected).abs() < 1e-15, "entry {i} {j} is {w}");
    }
    for &m in &operators.mass {
        assert!((m - area / 4.0).abs() < 1e-14, "mass {m}");
    }
}

#[test]
fn five_point_stencil_on_the_grid() {
    let operators =
        cotangent_operators(&rectangle(4.0, 4.0, 4, 4), &OperatorOptions::default()).unwrap();
    let centre = 12;
    let row: Vec<f64> = (0..25)
        .map(|j| operators.stiffness.get(centre, j).copied().unwrap_or(0.0))
        .collect();
    for (j, &w) in row.iter().enumerate() {
        let expected = match j {
            12 => 4.0,
            7 | 11 | 13 | 17 => -1.0,
            _ => 0.0,
        };
        assert!((w - expected).abs() < 1e-15, "entry {j} is {w}");
    }
}

#[test]
fn linear_functions_have_their_dirichlet_energy() {
    // xᵀ W x = ∫ |∇f|² is exact for linear f on a flat mesh, here 9 + 16 times the area 6.
    let mesh = rectangle(3.0, 2.0, 5, 7);
    let operators = cotangent_operators(&mesh, &OperatorOptions::default()).unwrap();
    let f: Vec<f64> = mesh
        .vertices()
        .iter()
        .map(|p| 3.0 * p.x - 4.0 * p.y)
        .collect();
    let energy: f64 = operators
        .stiffness
        .iter()
        .map(|(w, (i, j))| w * f[i] * f[j])
        .sum();
    assert!((energy - 150.0).abs() < 1e-11, "energy {energy}");
}

#[test]
fn voronoi_areas_of_the_grid() {
    let options = OperatorOptions {
        mass: MassKind::MixedVoronoi,
        ..OperatorOptions::default()
    };
    let operators = cotangent_operators(&rectangle(4.0, 4.0, 4, 4), &options).unwrap();
    assert!((operators.mass[12] - 1.0).abs() < 1e-14, "inner vertex");
    assert!((operators.mass[0] - 0.25).abs() < 1e-14, "corner");
    let total: f64 = operators.mass.iter().sum();
    assert!((total - 16.0).abs() < 1e-13, "total {total}");
}

#[test]
fn scale_and_motion() {
    let mesh = bumpy(11);
    let options = OperatorOptions::default();
    let reference = cotangent_operators(&mesh, &options).unwrap();
    let motion = Isometry3::new(Vector3::new(3.0, -20.0, 8.0), Vector3::new(0.3, 1.1, -0.7));
    for (scale, moved) in [
        (1e-3, scaled(&mesh, 1e-3)),
        (1e3, scaled(&mesh, 1e3)),
        (1.0, mesh.transformed(&motion)),
    ] {
        let operators = cotangent_operators(&moved, &options).unwrap();
        for (&w, (i, j)) in operators.stiffness.iter() {
            let expected = *reference.stiffness.get(i, j).unwrap();
            assert!(
                (w - expected).abs() < 1e-11,
                "entry {i} {j} at scale {scale}"
            );
        }
        for (m, expected) in operators.mass.iter().zip(&reference.mass) {
            let expected = expected * scale * scale;
            assert!(
                (m - expected).abs() < 1e-12 * expected,
                "mass at scale {scale}"
            );
        }
    }
}

#[test]
fn mollification_changes_nothing_on_a_good_mesh() {
    let mesh = bumpy(5);
    let options = OperatorOptions {
        mollification: Mollification::intrinsic(),
        ..OperatorOptions::default()
    };
    let plain = cotangent_operators(&mesh, &OperatorOptions::default()).unwrap();
    assert_eq!(
        cotangent_operators(&mesh, &options).unwrap(),
        plain,
        "identical"
    );
}

/// A height field over a square, never flat.
fn bumpy(seed: u64) -> TriMesh {
    let flat = rectangle(10.0, 10.0, 12, 12);
    let phase = seed as f64;
    let vertices = flat
        .vertices()
        .iter()
        .map(|p| {
            Point3::new(
                p.x,
                p.y,
                (1.3 * p.x + phase).sin() * (0.7 * p.y - phase).cos(),
            )
        })
        .collect();
    TriMesh::new(vertices, flat.faces().to_vec()).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_mesh_gives_a_symmetric_semidefinite_matrix(
        heights in proptest::collection::vec(-1.0_f64..1.0, 30),
        f in proptest::collection::vec(-1.0_f64..1.0, 30),
        log_scale in -3.0_f64..3.0,
    ) {
        let flat = rectangle(5.0, 4.0, 5, 4);
        let scale = 10.0_f64.powf(log_scale);
        let vertices = flat.vertices().iter().zip(&heights);
        let vertices = vertices.map(|(p, &z)| Point3::new(p.x, p.y, z) * scale).collect();
        let mesh = TriMesh::new(vertices, flat.faces().to_vec()).unwrap();
        let operators = cotangent_operators(&mesh, &OperatorOptions::default()).unwrap();
        let w = &operators.stiffness;
        let size: f64 = w.data().iter().map(|x| x.abs()).sum();
        for (&value, (i, j)) in w.iter() {
            prop_assert_eq!(value.to_bits(), w.get(j, i).unwrap().to_bits());
        }
        for row in w.outer_iterator() {
            prop_assert!(row.data().iter().sum::<f64>().abs() < 1e-15 * size);
        }
        let energy: f64 = w.iter().map(|(w, (i, j))| w * f[i] * f[j]).sum();
        prop_assert!(energy > -1e-14 * size);
        let total: f64 = operators.mass.iter().sum();
        prop_assert!((total - mesh.area()).abs() < 1e-13 * total);
    }
}
