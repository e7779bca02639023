//! Conditions at the boundary, rows and extension.

use pedicle_laplacian::{
    Boundary, Construction, LaplaceOperators, LaplaceOptions, Surface, laplace_operators,
};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, smallest_eigenpairs};

use crate::shapes::{jittered, operators_by, spectral_difference, spectrum, sphere, spoiled};

const SIZE: [f64; 2] = [
    std::f64::consts::PI,
    std::f64::consts::PI / std::f64::consts::SQRT_2,
];

fn with(mesh: &TriMesh, construction: Construction, boundary: Boundary) -> LaplaceOperators {
    let options = LaplaceOptions {
        construction,
        boundary,
        ..LaplaceOptions::default()
    };
    laplace_operators(Surface::Mesh(mesh), &options).unwrap()
}

/// m² + 2n² from `lowest` on.
fn exact(lowest: u32, count: usize) -> Vec<f64> {
    let pairs = (lowest..20).flat_map(|m| (lowest..20).map(move |n| f64::from(m * m + 2 * n * n)));
    let mut values: Vec<f64> = pairs.collect();
    values.sort_by(f64::total_cmp);
    values.truncate(count);
    values
}

#[test]
fn rectangle_under_both_conditions() {
    let mesh = jittered(SIZE, [54, 38], 0.25, 4);
    for mesh in [mesh.clone(), spoiled(&mesh)] {
        let natural = spectrum(&with(&mesh, Construction::Auto, Boundary::Natural), 9);
        let worst = spectral_difference(&natural, &exact(0, 9));
        assert!(worst < 0.01, "natural: {worst}, {natural:?}");
        let fixed = spectrum(&with(&mesh, Construction::Auto, Boundary::Dirichlet), 8);
        let worst = spectral_difference(&fixed, &exact(1, 8));
        assert!(worst < 0.015, "Dirichlet: {worst}, {fixed:?}");
    }
}

#[test]
fn dirichlet_converges_with_second_order() {
    for construction in [
        Construction::Cotangent,
        Construction::Delaunay,
        Construction::Robust,
    ] {
        let error = |n: usize| {
            let mesh = jittered(SIZE, [3 * n / 2, n], 0.2, 2);
            let eigenvalues = spectrum(&with(&mesh, construction, Boundary::Dirichlet), 6);
            spectral_difference(&eigenvalues, &exact(1, 6))
        };
        let errors = [10, 20, 40].map(error);
        let order = (errors[0] / errors[2]).log2() / 2.0;
        assert!(
            (1.7..2.4).contains(&order),
            "{construction:?}: {order} of {errors:?}"
        );
    }
}

#[test]
fn basis_extended_by_zeros_is_orthonormal() {
    let mesh = jittered(SIZE, [12, 9], 0.2, 3);
    let operators = with(&mesh, Construction::Robust, Boundary::Dirichlet);
    assert_eq!(operators.rows.n_rows(), 11 * 8, "inner vertices");
    assert_eq!(operators.rows.n_vertices(), 13 * 10, "all vertices");
    assert!(!operators.rows.is_identity(), "some are left out");
    let options = EigenOptions::default();
    let pairs = smallest_eigenpairs(&operators.stiffness, &operators.mass, 6, &options).unwrap();
    let basis = operators.rows.extend_columns(pairs.eigenvectors.as_ref());
    for (v, row) in operators.rows.row_of_vertex().iter().enumerate() {
        let (i, j) = (v % 13, v / 13);
        let is_inner = (1..12).contains(&i) && (1..9).contains(&j);
        assert_eq!(row.is_some(), is_inner, "vertex {v}");
        assert!(is_inner || basis[(v, 0)] == 0.0, "0 at vertex {v}");
    }
    for (a, b) in (0..6).flat_map(|a| (0..6).map(move |b| (a, b))) {
        let product: f64 = (0..130)
            .map(|v| operators.vertex_mass[v] * basis[(v, a)] * basis[(v, b)])
            .sum();
        let expected = if a == b { 1.0 } else { 0.0 };
        assert!(
            (product - expected).abs() < 1e-12,
            "product {a} {b} is {product}"
        );
    }
    let total: f64 = operators.vertex_mass.iter().sum();
    assert!(
        (total / (SIZE[0] * SIZE[1]) - 1.0).abs() < 1e-12,
        "area {total}"
    );
    let column: Vec<f64> = (0..88).map(|r| pairs.eigenvectors[(r, 2)]).collect();
    let extended = operators.rows.extend(&column);
    assert_eq!(
        extended,
        (0..130).map(|v| basis[(v, 2)]).collect::<Vec<_>>(),
        "one column"
    );
    assert_eq!(operators.rows.restrict(&extended), column, "there and back");
}

#[test]
fn fixed_vertices_are_what_the_caller_names() {
    let mesh = jittered(SIZE, [8, 6], 0.2, 3);
    let dirichlet = with(&mesh, Construction::Auto, Boundary::Dirichlet);
    let rows = dirichlet.rows.row_of_vertex().iter().zip(0_u32..);
    let mut border: Vec<u32> = rows
        .filter(|(row, _)| row.is_none())
        .map(|(_, v)| v)
        .collect();
    border.reverse();
    let fixed = with(&mesh, Construction::Auto, Boundary::Fixed(border));
    assert_eq!(fixed, dirichlet, "the same vertices");
    // The restricted matrix is a part of the whole.
    let whole = operators_by(&mesh, Construction::Auto);
    for (&w, (i, j)) in dirichlet.stiffness.iter() {
        let [a, b] = [i, j].map(|r| dirichlet.rows.vertex_of_row()[r] as usize);
        assert_eq!(whole.stiffness.get(a, b), Some(&w), "entry {i} {j}");
    }
}

#[test]
fn closed_surface_has_no_boundary() {
    let mesh = sphere(2);
    let dirichlet = with(&mesh, Construction::Auto, Boundary::Dirichlet);
    assert_eq!(
        dirichlet,
        operators_by(&mesh, Construction::Auto),
        "nothing to fix"
    );
    assert_eq!(dirichlet.report.defects.n_boundary_edges, 0, "no boundary");
}
