//! Time of 100 eigenpairs, with their quality beside it: largest residual over the last eigenvalue,
//! largest entry of |XᵀMX - I|, and how many eigenvalues inertia counted and the solver found.

use std::f64::consts::TAU;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use faer::Mat;
use nalgebra::Point3;
use pedicle_laplacian::{OperatorOptions, Operators, cotangent_operators};
use pedicle_mesh::{TriMesh, concatenate};
use pedicle_spectral::{EigenOptions, EigenPairs, smallest_eigenpairs, smallest_eigenpairs_from};

const N_PAIRS: usize = 100;

/// A torus with a wavy tube: one component, no symmetry left.
fn torus(n_around: u32, n_tube: u32, phase: f64) -> TriMesh {
    let mut vertices = Vec::new();
    for i in 0..n_around {
        for j in 0..n_tube {
            let u = TAU * f64::from(i) / f64::from(n_around);
            let v = TAU * f64::from(j) / f64::from(n_tube);
            let tube = 12.0 + 3.0 * (3.0 * u + phase).sin() + 2.0 * (2.0 * v - u).cos();
            let radius = 40.0 + tube * v.cos();
            let z = tube * v.sin() + 4.0 * (u + phase).sin();
            vertices.push(Point3::new(radius * u.cos(), radius * u.sin(), z));
        }
    }
    let at = |i: u32, j: u32| (i % n_around) * n_tube + j % n_tube;
    let mut faces = Vec::new();
    for i in 0..n_around {
        for j in 0..n_tube {
            faces.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    TriMesh::new(vertices, faces).expect("a valid mesh")
}

fn five(n_around: u32, n_tube: u32) -> TriMesh {
    let parts: Vec<_> = (0..5)
        .map(|i| torus(n_around, n_tube, f64::from(i)))
        .collect();
    concatenate(&parts.iter().collect::<Vec<_>>()).expect("valid meshes")
}

fn quality(pairs: &EigenPairs, mass: &[f64]) -> String {
    let x = &pairs.eigenvectors;
    let weighted = Mat::from_fn(x.nrows(), x.ncols(), |i, j| mass[i] * x[(i, j)]);
    let gram = x.transpose() * &weighted;
    let product = (&gram - &Mat::<f64>::identity(x.ncols(), x.ncols())).norm_max();
    let last = pairs.eigenvalues[pairs.eigenvalues.len() - 1];
    let residual = pairs.residuals.iter().fold(0.0_f64, |m, r| m.max(r / last));
    format!(
        "residual {residual:.0e}, product {product:.0e}, {} of {} found",
        pairs.certificate.n_found, pairs.certificate.n_below
    )
}

fn eigenpairs(c: &mut Criterion) {
    let options = EigenOptions::default();
    let mut group = c.benchmark_group("eigenpairs");
    group.sample_size(10);
    for (name, mesh) in [
        ("one component, 1 752 vertices", torus(73, 24, 0.0)),
        ("five components, 1 750 vertices", five(25, 14)),
        ("one component, 20 000 vertices", torus(250, 80, 0.0)),
        ("five components, 20 000 vertices", five(100, 40)),
    ] {
        let Operators {
            stiffness, mass, ..
        } = cotangent_operators(&mesh, &OperatorOptions::default()).expect("operators");
        let solve = |n_pairs| {
            smallest_eigenpairs(&stiffness, &mass, n_pairs, &options).expect("eigenpairs")
        };
        let first = solve(N_PAIRS);
        let label = format!("{name}, {N_PAIRS}: {}", quality(&first, &mass));
        group.bench_function(label, |b| b.iter(|| black_box(solve(N_PAIRS))));
        if first.work.n_components > 1 {
            continue;
        }
        let known = first.eigenvectors.as_ref();
        let go_on = || {
            smallest_eigenpairs_from(&stiffness, &mass, 2 * N_PAIRS, known, &options)
                .expect("eigenpairs")
        };
        let label = format!("{name}, 200 from 100: {}", quality(&go_on(), &mass));
        group.bench_function(label, |b| b.iter(|| black_box(go_on())));
        let label = format!("{name}, 200: {}", quality(&solve(2 * N_PAIRS), &mass));
        group.bench_function(label, |b| b.iter(|| black_box(solve(2 * N_PAIRS))));
    }
    group.finish();
}

criterion_group!(benches, eigenpairs);
criterion_main!(benches);
