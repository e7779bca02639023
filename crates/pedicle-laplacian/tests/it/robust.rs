//! Spectra of spoiled surfaces.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_laplacian::Construction;
use pedicle_mesh::TriMesh;

use crate::shapes::{
    jittered, operators_by, scaled, shuffled, spectral_difference, spectrum, sphere, spoiled, torus,
};

#[test]
fn spoiled_sphere_has_the_spectrum_of_the_sphere() {
    let mesh = spoiled(&sphere(4));
    let operators = operators_by(&mesh, Construction::Auto);
    let report = &operators.report;
    assert_eq!(report.construction, Construction::Robust, "chosen");
    let defects = &report.defects;
    assert_eq!(
        defects.duplicate_faces.len(),
        defects.repeated_index_faces.len()
    );
    assert!(defects.duplicate_faces.len() > 180, "duplicates");
    assert!(defects.zero_area_faces.len() > 180, "faces without area");
    assert!(defects.sliver_faces.len() > 360, "slivers");
    assert_eq!(
        defects.unreferenced_vertices,
        [mesh.n_vertices() as u32 - 1]
    );
    assert_eq!(
        (defects.n_boundary_edges, defects.non_manifold_edges.len()),
        (0, 0)
    );
    assert!(report.relative_mollification > 0.0 && report.relative_mollification < 2e-5);
    let eigenvalues = spectrum(&operators, 16);
    let exact: Vec<f64> = (0..4)
        .flat_map(|l| vec![f64::from(l * (l + 1)); 2 * l as usize + 1])
        .collect();
    let worst = spectral_difference(&eigenvalues, &exact);
    assert!(worst < 0.015, "{worst}: {eigenvalues:?}");
}

#[test]
fn spoiled_torus_has_the_spectrum_of_a_fine_one() {
    let fine = spectrum(
        &operators_by(&torus(120, 60, 0.0), Construction::Cotangent),
        16,
    );
    let eigenvalues = spectrum(
        &operators_by(&spoiled(&torus(60, 30, 3.0)), Construction::Auto),
        16,
    );
    let worst = spectral_difference(&eigenvalues, &fine);
    assert!(worst < 0.02, "{worst}: {eigenvalues:?} against {fine:?}");
}

/// Rectangles of π × π/√2 that share one edge of length π/√2, `n` cells along it.
fn book(n_sheets: usize, n: usize) -> TriMesh {
    let height = std::f64::consts::PI / 2.0_f64.sqrt();
    let page = jittered([std::f64::consts::PI, height], [3 * n / 2, n], 0.2, 5);
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let mut spine = vec![u32::MAX; n + 1];
    for sheet in 0..n_sheets {
        let (sin, cos) = (0.3 + 1.9 * sheet as f64).sin_cos();
        let index: Vec<u32> = (0..page.n_vertices())
            .map(|v| {
                let p = page.vertices()[v];
                let row = v / (3 * n / 2 + 1);
                let on_spine = p.x == 0.0;
                if on_spine && spine[row] != u32::MAX {
                    return spine[row];
                }
                vertices.push(Point3::new(p.x * cos, p.x * sin, p.y));
                let new = vertices.len() as u32 - 1;
                if on_spine {
                    spine[row] = new;
                }
                new
            })
            .collect();
        faces.extend(page.faces().iter().map(|f| f.map(|v| index[v as usize])));
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// On n sheets a function is even, cos kx with k = 0, 1, 2, …, or one of n - 1 that vanish at the
/// common edge, k = ½, 3/2, …; along the edge it is cos √2 jy.
fn book_spectrum(n_sheets: usize, count: usize) -> Vec<f64> {
    let mut exact = Vec::new();
    for doubled in 0..20 {
        let k = 0.5 * f64::from(doubled);
        let multiplicity = if doubled % 2 == 0 { 1 } else { n_sheets - 1 };
        for j in 0..10 {
            exact.extend(vec![k * k + 2.0 * f64::from(j * j); multiplicity]);
        }
    }
    exact.sort_by(f64::total_cmp);
    exact.truncate(count);
    exact
}

#[test]
fn sheets_that_share_an_edge() {
    for (n_sheets, count) in [(3, 15), (4, 15), (2, 10)] {
        let mesh = book(n_sheets, 24);
        for mesh in [mesh.clone(), spoiled(&mesh)] {
            let operators = operators_by(&mesh, Construction::Robust);
            let n_edges = operators.report.defects.non_manifold_edges.len();
            assert_eq!(n_edges > 0, n_sheets > 2, "{n_edges} non-manifold edges");
            let eigenvalues = spectrum(&operators, count);
            let worst = spectral_difference(&eigenvalues, &book_spectrum(n_sheets, count));
            assert!(worst < 0.015, "{n_sheets} sheets: {worst}, {eigenvalues:?}");
        }
    }
}

#[test]
fn convergence_is_of_second_order() {
    let error = |n| {
        let eigenvalues = spectrum(&operators_by(&book(3, n), Construction::Robust), 12);
        spectral_difference(&eigenvalues, &book_spectrum(3, 12))
    };
    let errors = [8, 16, 32].map(error);
    let order = (errors[0] / errors[2]).log2() / 2.0;
    assert!((1.6..2.6).contains(&order), "order {order} of {errors:?}");
}

#[test]
fn motion_order_and_scale() {
    let mesh = spoiled(&book(3, 10));
    let reference = spectrum(&operators_by(&mesh, Construction::Robust), 20);
    let motion = Isometry3::new(Vector3::new(30.0, -20.0, 8.0), Vector3::new(0.3, 1.1, -0.7));
    let cases = [
        ("moved", mesh.transformed(&motion), 1.0),
        ("shuffled", shuffled(&mesh), 1.0),
        ("small", scaled(&mesh, 1e-3), 1e-3),
        ("large", scaled(&mesh, 1e3), 1e3),
    ];
    for (name, mesh, scale) in cases {
        let eigenvalues = spectrum(&operators_by(&mesh, Construction::Robust), 20);
        let eigenvalues: Vec<f64> = eigenvalues.iter().map(|x| x * scale * scale).collect();
        let worst = spectral_difference(&eigenvalues, &reference);
        assert!(worst < 1e-7, "{name}: {worst}");
    }
}

#[test]
fn component_without_area_is_left_out() {
    let clean = sphere(2);
    let mut vertices = clean.vertices().to_vec();
    let n = vertices.len() as u32;
    vertices.extend([5.0, 6.0, 7.0].map(|x| Point3::new(x, 0.0, 0.0)));
    let mut faces = clean.faces().to_vec();
    faces.push([n, n + 1, n + 2]);
    let operators = operators_by(&TriMesh::new(vertices, faces).unwrap(), Construction::Auto);
    assert_eq!(
        operators.report.defects.unreferenced_vertices,
        [n, n + 1, n + 2]
    );
    assert_eq!(
        operators.stiffness,
        operators_by(&clean, Construction::Auto).stiffness
    );
    assert!(operators.vertex_mass[n as usize] <= 0.0, "no mass");
}

#[test]
fn surface_with_one_side() {
    // A Möbius strip of unit width; its double cover is a ring, so only the robust way is open.
    let (n, radius) = (60, 3.0);
    let mut vertices = Vec::new();
    for i in 0..n {
        let u = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        for t in [-0.5, 0.0, 0.5] {
            let r = radius + t * (u / 2.0).cos();
            vertices.push(Point3::new(r * u.cos(), r * u.sin(), t * (u / 2.0).sin()));
        }
    }
    let at = |i: i32, j: i32| (if i < n { 3 * i + j } else { 2 - j }) as u32;
    let mut faces = Vec::new();
    for (i, j) in (0..n).flat_map(|i| [(i, 0), (i, 1)]) {
        faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    let mesh = TriMesh::new(vertices, faces).unwrap();
    let robust = spectrum(&operators_by(&mesh, Construction::Robust), 8);
    let plain = spectrum(&operators_by(&mesh, Construction::Cotangent), 8);
    let worst = spectral_difference(&robust, &plain);
    assert!(worst < 0.01, "{worst}: {robust:?} against {plain:?}");
}
