//! Time of the operators, with the error of an eigenvalue and the wrong weights beside it.

use std::f64::consts::{PI, SQRT_2};
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Point3;
use pedicle_laplacian::{Construction, LaplaceOptions, Surface, laplace_operators};
use pedicle_mesh::TriMesh;
use pedicle_spectral::{EigenOptions, smallest_eigenpairs};

/// A rectangle of π × π/√2, sheared against its own grid so that many edges are not Delaunay.
fn sheared(nx: usize, ny: usize) -> TriMesh {
    let mut vertices = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let (u, v) = (i as f64 / nx as f64, j as f64 / ny as f64);
            let bend = 0.15 * (PI * u).sin() * (3.0 * PI * v).sin();
            vertices.push(Point3::new(PI * (u + bend), PI / SQRT_2 * v, 0.0));
        }
    }
    let at = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let mut faces = Vec::new();
    for (i, j) in (0..ny).flat_map(|j| (0..nx).map(move |i| (i, j))) {
        faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    TriMesh::new(vertices, faces).expect("a valid grid")
}

fn operators(c: &mut Criterion) {
    for (nx, ny) in [(49, 34), (159, 124)] {
        let mesh = sheared(nx, ny);
        let n = mesh.n_vertices();
        let surfaces = [
            ("cotangent", Surface::Mesh(&mesh), Construction::Cotangent),
            ("delaunay", Surface::Mesh(&mesh), Construction::Delaunay),
            ("robust", Surface::Mesh(&mesh), Construction::Robust),
            (
                "cloud",
                Surface::Cloud(mesh.vertices()),
                Construction::Robust,
            ),
        ];
        for (name, surface, construction) in surfaces {
            let options = LaplaceOptions {
                construction,
                ..LaplaceOptions::default()
            };
            let made = laplace_operators(surface, &options).expect("a valid surface");
            let eigen = EigenOptions::default();
            let pairs = smallest_eigenpairs(&made.stiffness, &made.mass, 9, &eigen);
            // The ninth eigenvalue of the rectangle is 9.
            let error = pairs.expect("eigenpairs").eigenvalues[8] / 9.0 - 1.0;
            let wrong = made.report.n_negative_weights;
            let flips = made.report.n_flips;
            let title = format!(
                "{name}, {n} vertices: error {error:+.1e}, {wrong} wrong weights, {flips} flips"
            );
            c.bench_function(&title, |b| {
                b.iter(|| laplace_operators(black_box(surface), &options));
            });
        }
    }
}

criterion_group!(benches, operators);
criterion_main!(benches);
