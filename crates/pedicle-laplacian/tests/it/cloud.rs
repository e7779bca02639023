//! Clouds of points.

use nalgebra::{Isometry3, Point3, Vector3};
use pedicle_laplacian::{
    Boundary, Construction, LaplaceOperators, LaplaceOptions, Surface, laplace_operators,
};

use crate::shapes::{
    jittered, operators_by, scattered, shuffle, spectral_difference, spectrum, sphere_points, torus,
};

fn of_cloud(points: &[Point3<f64>]) -> LaplaceOperators {
    laplace_operators(Surface::Cloud(points), &LaplaceOptions::default()).unwrap()
}

#[test]
fn random_points_on_a_sphere() {
    let exact = [0.0, 2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0];
    let errors = [500, 8000].map(|n| {
        let operators = of_cloud(&sphere_points(n));
        assert_eq!(
            operators.report.n_negative_weights, 0,
            "weights of {n} points"
        );
        let area = operators.report.area_mm2 / (4.0 * std::f64::consts::PI);
        assert!(
            (area - 1.0).abs() < 0.05,
            "area of {n} points is {area} of the sphere's"
        );
        spectral_difference(&spectrum(&operators, 9), &exact)
    });
    assert!(errors[0] < 0.06 && errors[1] < 0.012, "errors {errors:?}");
    assert!(
        errors[1] < 0.5 * errors[0],
        "more points are better: {errors:?}"
    );
}

#[test]
fn random_points_on_a_torus() {
    let fine = spectrum(
        &operators_by(&torus(120, 60, 0.0), Construction::Cotangent),
        10,
    );
    let errors = [1000, 6000].map(|n: u64| {
        // Rejection keeps the density even.
        let points = (0..).filter_map(|i: u64| {
            let v = std::f64::consts::TAU * scattered(3 * i);
            let (sin, cos) = (std::f64::consts::TAU * scattered(3 * i + 1)).sin_cos();
            let r = 2.0 + v.cos();
            (3.0 * scattered(3 * i + 2) < r).then(|| Point3::new(r * cos, r * sin, v.sin()))
        });
        let points: Vec<_> = points.take(n as usize).collect();
        spectral_difference(&spectrum(&of_cloud(&points), 10), &fine)
    });
    assert!(errors[0] < 0.08 && errors[1] < 0.02, "errors {errors:?}");
    assert!(
        errors[1] < 0.5 * errors[0],
        "more points are better: {errors:?}"
    );
}

#[test]
fn points_of_a_grid() {
    // Four points on every circle: the triangulations of neighbours must still agree.
    let size = [std::f64::consts::PI, std::f64::consts::PI / 2.0_f64.sqrt()];
    for jitter in [0.0, 0.2] {
        let mesh = jittered(size, [42, 30], jitter, 0);
        let operators = of_cloud(mesh.vertices());
        let area = operators.report.area_mm2 / (size[0] * size[1]);
        assert!(
            (area - 1.0).abs() < 0.02,
            "area {area} with jitter {jitter}"
        );
        let eigenvalues = spectrum(&operators, 9);
        let exact = [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 9.0, 9.0];
        let worst = spectral_difference(&eigenvalues, &exact);
        assert!(worst < 0.04, "jitter {jitter}: {worst}, {eigenvalues:?}");
        let on_border = |p: &Point3<f64>| {
            p.x < 1e-9 || p.y < 1e-9 || p.x > size[0] - 1e-9 || p.y > size[1] - 1e-9
        };
        let border = (0_u32..).zip(mesh.vertices()).filter(|(_, p)| on_border(p));
        let options = LaplaceOptions {
            boundary: Boundary::Fixed(border.map(|(i, _)| i).collect()),
            ..LaplaceOptions::default()
        };
        let fixed = laplace_operators(Surface::Cloud(mesh.vertices()), &options).unwrap();
        let eigenvalues = spectrum(&fixed, 5);
        let worst = spectral_difference(&eigenvalues, &[3.0, 6.0, 9.0, 11.0, 12.0]);
        assert!(worst < 0.04, "fixed border: {worst}, {eigenvalues:?}");
    }
}

#[test]
fn motion_order_and_scale() {
    let points = sphere_points(700);
    let reference = spectrum(&of_cloud(&points), 15);
    let motion = Isometry3::new(Vector3::new(3.0, -2.0, 8.0), Vector3::new(0.3, 1.1, -0.7));
    let cases: [(&str, Vec<Point3<f64>>, f64); 4] = [
        ("moved", points.iter().map(|p| motion * p).collect(), 1.0),
        (
            "shuffled",
            shuffle(700).iter().map(|&i| points[i]).collect(),
            1.0,
        ),
        ("small", points.iter().map(|p| p * 1e-3).collect(), 1e-3),
        ("large", points.iter().map(|p| p * 1e3).collect(), 1e3),
    ];
    for (name, points, scale) in cases {
        let eigenvalues = spectrum(&of_cloud(&points), 15);
        let eigenvalues: Vec<f64> = eigenvalues.iter().map(|x| x * scale * scale).collect();
        let worst = spectral_difference(&eigenvalues, &reference);
        assert!(worst < 1e-8, "{name}: {worst}");
    }
}

#[test]
fn points_at_one_place_share_a_row() {
    let points = sphere_points(400);
    let mut doubled = points.clone();
    doubled.insert(10, points[3]);
    doubled.push(points[200]);
    doubled.push(points[200]);
    let operators = of_cloud(&doubled);
    assert_eq!(operators.report.defects.coincident_points, [10, 401, 402]);
    assert_eq!(
        operators.stiffness,
        of_cloud(&points).stiffness,
        "as without them"
    );
    let rows = &operators.rows;
    assert_eq!((rows.n_rows(), rows.n_vertices()), (400, 403));
    let values: Vec<f64> = (0..400).map(f64::from).collect();
    let extended = rows.extend(&values);
    assert_eq!((extended[3], extended[10]), (3.0, 3.0));
    assert_eq!(
        (extended[201], extended[401], extended[402]),
        (200.0, 200.0, 200.0)
    );
    let total: f64 = operators.vertex_mass.iter().sum();
    assert!(
        (total / operators.report.area_mm2 - 1.0).abs() < 1e-13,
        "masses sum to the area"
    );
}
