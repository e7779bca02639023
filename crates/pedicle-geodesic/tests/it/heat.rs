//! The heat method against distances in the plane, on the sphere and on the torus.

use pedicle_geodesic::{EdgeGraph, HeatGeodesics, HeatOptions, Links};
use pedicle_mesh::TriMesh;

use crate::shapes::{scaled, sphere, square, torus, twice};

fn heat(mesh: &TriMesh) -> HeatGeodesics {
    HeatGeodesics::new(mesh, &HeatOptions::default()).unwrap()
}

/// Mean of |found - truth| over the vertices.
fn mean_error(found: &[f64], truth: impl Fn(usize) -> f64) -> f64 {
    let errors = found.iter().enumerate().map(|(v, d)| (d - truth(v)).abs());
    errors.sum::<f64>() / found.len() as f64
}

#[test]
fn the_error_in_a_square_falls_with_the_edges() {
    let errors: Vec<f64> = [16, 32, 64]
        .iter()
        .map(|&n| {
            let mesh = square(n, 0.3);
            let center = (n / 2 * (n + 1) + n / 2) as u32;
            let start = mesh.vertices()[center as usize];
            let found = heat(&mesh).distances_from(&[center]).unwrap();
            mean_error(&found, |v| (mesh.vertices()[v] - start).norm())
        })
        .collect();
    assert!(errors[2] < 0.01, "{errors:?}");
    assert!(
        errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1],
        "{errors:?}"
    );
}

#[test]
fn the_error_on_a_sphere_falls_with_the_edges() {
    // A time that falls with the edge length instead of its square converges on regular meshes too.
    let error = |level: usize, time_factor: f64| {
        let mesh = sphere(level);
        let solver = HeatGeodesics::new(&mesh, &HeatOptions { time_factor }).unwrap();
        let found = solver.distances_from(&[7]).unwrap();
        let start = mesh.vertices()[7];
        mean_error(&found, |v| {
            2.0 * (0.5 * (mesh.vertices()[v] - start).norm()).min(1.0).asin()
        })
    };
    let errors = [(3, 4.0), (4, 8.0), (5, 16.0)].map(|(level, factor)| error(level, factor));
    assert!(
        errors[1] < 0.6 * errors[0] && errors[2] < 0.6 * errors[1],
        "{errors:?}"
    );
    // The default stays within 1.1 % of the mean distance π/2.
    assert!(error(5, 1.0) < 0.011 * std::f64::consts::FRAC_PI_2);
}

#[test]
fn ways_around_a_torus_are_as_long_as_they_are() {
    // Along the inner circle half a turn is π (R - r), and no way around is shorter.
    let mesh = torus(120, 2.0, 0.5);
    let m = mesh.n_vertices() / 120;
    let inner = (m / 2) as u32;
    let found = heat(&mesh).distances_from(&[inner]).unwrap();
    let half_turn = found[60 * m + m / 2];
    let truth = std::f64::consts::PI * 1.5;
    assert!(
        (half_turn / truth - 1.0).abs() < 0.02,
        "{half_turn} for {truth}"
    );
    // Half way around the tube.
    let around = found[0];
    let truth = std::f64::consts::PI * 0.5;
    assert!((around / truth - 1.0).abs() < 0.07, "{around} for {truth}");
}

#[test]
fn paths_and_heat_agree_and_the_triangle_inequality_holds_but_for_the_error() {
    let mesh = torus(80, 2.0, 0.7);
    let (solver, graph) = (heat(&mesh), EdgeGraph::new(&mesh, Links::AcrossEdges));
    let starts = [0, 333, 1200];
    let found = starts.map(|v| solver.distances_from(&[v]).unwrap());
    for (start, found) in starts.iter().zip(&found) {
        let paths = graph.distances_from(&[*start]).unwrap();
        for (h, p) in found.iter().zip(&paths) {
            assert!((h - p).abs() < 0.1 * p + 0.05, "{h} and {p}");
        }
    }
    for v in 0..mesh.n_vertices() {
        assert!(found[0][v] <= found[0][333] + found[1][v] + 0.1);
        assert!(found[1][v] <= found[1][1200] + found[2][v] + 0.1);
    }
}

#[test]
fn distances_scale_with_the_mesh() {
    let mesh = sphere(3);
    let once = heat(&mesh).distances_from(&[0, 40]).unwrap();
    assert!(once[0] <= 0.0 && once[40] <= 0.0);
    for scale in [1e-3, 1e3] {
        let again = heat(&scaled(&mesh, scale))
            .distances_from(&[0, 40])
            .unwrap();
        for (x, y) in again.iter().zip(&once) {
            assert!((x / scale - y).abs() < 1e-9);
        }
    }
}

#[test]
fn pairs_are_columns_of_full_solutions_for_any_number_of_threads() {
    let mesh = twice(&sphere(3));
    let half = mesh.n_vertices() as u32 / 2;
    let solver = heat(&mesh);
    let mut pairs: Vec<(u32, u32)> = (0..60).map(|i| (i * 31 % half, i * 17 % half)).collect();
    pairs.extend([(4, half + 4), (half + 1, half + 9), (4, 4)]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| solver.distances_between(&pairs).unwrap())
    };
    let found = with(1);
    assert_eq!(found, with(3));
    for (&(a, b), d) in pairs.iter().zip(&found) {
        let all = solver.distances_from(&[a]).unwrap();
        if (a < half) == (b < half) {
            assert!((all[b as usize] - d).abs() < 1e-12);
        } else {
            assert!(d.is_infinite() && all[b as usize].is_infinite());
        }
    }
}

#[test]
fn a_long_thin_strip_does_not_underflow() {
    // 600 edges from end to end: heat falls to 1e-250.
    let mesh = {
        let flat = square(1, 0.0);
        let n = 600_u32;
        let vertices = (0..=n)
            .flat_map(|i| {
                flat.vertices()[..2]
                    .iter()
                    .map(move |p| p + nalgebra::Vector3::x() * f64::from(i))
            })
            .collect();
        let faces = (0..n)
            .flat_map(|i| {
                [
                    [2 * i, 2 * i + 2, 2 * i + 1],
                    [2 * i + 2, 2 * i + 3, 2 * i + 1],
                ]
            })
            .collect();
        TriMesh::new(vertices, faces).unwrap()
    };
    let found = heat(&mesh).distances_from(&[0]).unwrap();
    assert!((found[1200] / 600.0 - 1.0).abs() < 0.01, "{}", found[1200]);
}
