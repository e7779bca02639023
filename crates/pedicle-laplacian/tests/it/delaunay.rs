//! Edge flips: what they reach, and what they leave alone.

use pedicle_laplacian::{
    Construction, LaplaceOperators, LaplaceOptions, Surface, laplace_operators,
};

use crate::shapes::{
    jittered, operators_by, rectangle, spectrum, sphere, spoiled, tetrahedron, torus,
};

/// Largest off-diagonal entry beside the diagonal entries of its row and column.
fn largest_wrong_weight(operators: &LaplaceOperators) -> f64 {
    let w = &operators.stiffness;
    let entries = w.iter().filter(|(_, (i, j))| i != j);
    let relative = entries.map(|(&x, (i, j))| x / w.get(i, i).unwrap().min(*w.get(j, j).unwrap()));
    relative.fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn no_weight_is_negative() {
    let sheared = torus(40, 20, 4.0);
    let plain = operators_by(&sheared, Construction::Cotangent);
    assert!(plain.report.n_negative_weights > 100, "something to mend");
    for mesh in [
        &sheared,
        &spoiled(&sphere(3)),
        &jittered([3.0, 0.4], [20, 20], 0.3, 1),
    ] {
        let operators = operators_by(mesh, Construction::Robust);
        assert_eq!(operators.report.n_negative_weights, 0, "report");
        assert_eq!(
            operators.report.n_non_delaunay_edges, 0,
            "all edges are Delaunay"
        );
        let worst = largest_wrong_weight(&operators);
        assert!(worst < 1e-9, "weight {worst}");
    }
    let operators = operators_by(&sheared, Construction::Delaunay);
    assert!(
        operators.report.n_flips > 100,
        "{} flips",
        operators.report.n_flips
    );
    assert!(largest_wrong_weight(&operators) < 1e-9, "one sheet");
}

#[test]
fn diagonals_of_a_flat_mesh_do_not_matter() {
    let meshes = [1, 2, 3].map(|seed| jittered([2.0, 1.5], [9, 7], 0.2, seed));
    let operators = meshes.map(|mesh| operators_by(&mesh, Construction::Delaunay));
    assert!(operators[0].report.n_flips > 0, "something to flip");
    for other in &operators[1..] {
        for (i, j) in (0..80).flat_map(|i| (0..80).map(move |j| (i, j))) {
            let [a, b] =
                [&operators[0], other].map(|o| o.stiffness.get(i, j).copied().unwrap_or(0.0));
            assert!((a - b).abs() < 1e-11, "entry {i} {j}: {a} against {b}");
        }
        let [a, b] = [&operators[0], other].map(|o| spectrum(o, 20));
        for (x, y) in a.iter().zip(&b) {
            assert!((x - y).abs() < 1e-11 * b[19], "eigenvalue {x} against {y}");
        }
    }
}

#[test]
fn delaunay_surfaces_keep_their_cotangents() {
    for mesh in [tetrahedron(), sphere(3), rectangle(3.0, 2.0, 6, 5)] {
        let plain = operators_by(&mesh, Construction::Cotangent);
        for construction in [Construction::Delaunay, Construction::Robust] {
            let operators = operators_by(&mesh, construction);
            assert_eq!(operators.report.n_flips, 0, "flips by {construction:?}");
            assert_eq!(
                operators.stiffness, plain.stiffness,
                "stiffness by {construction:?}"
            );
            assert_eq!(operators.mass, plain.mass, "mass by {construction:?}");
        }
    }
}

#[test]
fn plain_cotangents_are_the_old_ones() {
    let mesh = torus(30, 15, 2.0);
    let old = pedicle_laplacian::cotangent_operators(&mesh, &Default::default()).unwrap();
    let new = laplace_operators(Surface::from(&mesh), &LaplaceOptions::default()).unwrap();
    assert_eq!(new.report.construction, Construction::Cotangent);
    assert_eq!((new.stiffness, new.mass), (old.stiffness, old.mass));
    assert!(new.rows.is_identity(), "every vertex has its row");
}

#[test]
fn area_survives_the_flips() {
    let mesh = torus(40, 20, 4.0);
    for construction in [Construction::Delaunay, Construction::Robust] {
        let area = operators_by(&mesh, construction).report.area_mm2;
        assert!((area / mesh.area() - 1.0).abs() < 1e-12, "area {area}");
    }
}
